// Compiled against stand-ins, not yet run.
//
// A simulated robot as hardware of ros2_control (Jazzy, 4.34 or newer): written by parallel_robot.
// native/ holds the code of the robot; this file joins it to the controller manager.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "hardware_interface/hardware_info.hpp"
#include "hardware_interface/system_interface.hpp"
#include "hardware_interface/types/hardware_component_interface_params.hpp"
#include "hardware_interface/types/hardware_interface_return_values.hpp"
#include "hardware_interface/types/hardware_interface_type_values.hpp"
#include "rclcpp/rclcpp.hpp"
#include "rclcpp_lifecycle/state.hpp"

extern "C" {
#include "native/instance.h"
}
#include "native/layout.h"

namespace @package@
{
using hardware_interface::CallbackReturn;
using hardware_interface::return_type;

struct Delete
{
  void operator()(Instance * instance) const { instance_free(instance); }
};

// The joints stand still, as with brakes, until the first command whose torques are all finite.
class RobotSystem : public hardware_interface::SystemInterface
{
public:
  CallbackReturn on_init(
    const hardware_interface::HardwareComponentInterfaceParams & params) override
  {
    if (SystemInterface::on_init(params) != CallbackReturn::SUCCESS) {
      return CallbackReturn::ERROR;
    }
    const auto & info = get_hardware_info();
    instance_.reset(instance_new());
    std::string wrong = instance_ ? wrong_joints(info) : "there is no memory";
    for (const auto & [name, text] : info.hardware_parameters) {
      wrong = wrong.empty() ? set_parameter(name, text) : wrong;
    }
    if (wrong.empty() && !instance_begin(instance_.get())) {
      wrong = instance_->message;
    }
    if (!wrong.empty()) {
      RCLCPP_ERROR(get_logger(), "%s", wrong.c_str());
      return CallbackReturn::ERROR;
    }
    first_state_.resize(state_bytes());
    state_read(instance_.get(), first_state_.data());
    return CallbackReturn::SUCCESS;
  }

  CallbackReturn on_configure(const rclcpp_lifecycle::State &) override
  {
    const auto names = layout::joint_names();
    for (std::size_t j = 0; j < layout::JOINTS; ++j) {
      for (std::size_t k = 0; k < STATES.size(); ++k) {
        const std::string name = names[j] + "/" + STATES[k].kind;
        states_[j][k] = has_state(name) ? get_state_interface_handle(name) : nullptr;
      }
      commands_[j] = get_command_interface_handle(
        names[j] + "/" + hardware_interface::HW_IF_EFFORT);
    }
    begin_anew();
    return CallbackReturn::SUCCESS;
  }

  CallbackReturn on_activate(const rclcpp_lifecycle::State &) override
  {
    begin_anew();
    for (const auto & command : commands_) {
      set_command(command, std::numeric_limits<double>::quiet_NaN(), true);
    }
    return CallbackReturn::SUCCESS;
  }

  CallbackReturn on_deactivate(const rclcpp_lifecycle::State &) override
  {
    moves_ = false;
    for (const auto & joint : states_) {
      for (std::size_t k = 1; k < STATES.size(); ++k) {
        if (joint[k]) {
          set_state(joint[k], 0.0, true);
        }
      }
    }
    return CallbackReturn::SUCCESS;
  }

  // Unconfigured, and no more than that: it can be configured and activated again.
  CallbackReturn on_error(const rclcpp_lifecycle::State &) override
  {
    moves_ = false;
    return CallbackReturn::SUCCESS;
  }

  // One period; after a pause of the manager all that have passed.
  return_type read(const rclcpp::Time &, const rclcpp::Duration & elapsed) override
  {
    if (!moves_) {
      return return_type::OK;
    }
    Instance * instance = instance_.get();
    for (std::int64_t k = periods_of(elapsed.seconds()); k > 0; --k) {
      if (!instance_step(instance, instance->time, period)) {
        RCLCPP_ERROR(get_logger(), "%s", instance->message);
        return return_type::ERROR;
      }
    }
    tell(false);
    return return_type::OK;
  }

  return_type write(const rclcpp::Time &, const rclcpp::Duration &) override
  {
    std::array<double, layout::JOINTS> torque{};
    bool finite = true;
    for (std::size_t j = 0; j < layout::JOINTS; ++j) {
      finite = finite && get_command(commands_[j], torque[j], false) && std::isfinite(torque[j]);
    }
    if (!finite) {  // left out: the torque of before holds
      return return_type::OK;
    }
    moves_ = true;
    for (std::uint32_t j = 0; j < layout::JOINTS; ++j) {
      instance_set(instance_.get(), layout::TORQUE + j, REAL, torque[j]);
    }
    return return_type::OK;
  }

private:
  struct Kind
  {
    const char * kind;
    std::uint32_t first;  // variable of the first joint
  };
  static constexpr std::array<Kind, 3> STATES{{
    {hardware_interface::HW_IF_POSITION, layout::POSITION},
    {hardware_interface::HW_IF_VELOCITY, layout::VELOCITY},
    {hardware_interface::HW_IF_EFFORT, layout::EFFORT},
  }};
  static constexpr double LONGEST = 1.0;  // s that one read moves the robot, at most

  // What is wrong with the joints of the description, which may have any order; empty if nothing.
  static std::string wrong_joints(const hardware_interface::HardwareInfo & info)
  {
    const auto names = layout::joint_names();
    for (const auto & joint : info.joints) {
      if (std::find(names.begin(), names.end(), joint.name) == names.end()) {
        return "joint " + joint.name + " is none of this robot, which has " + list(names);
      }
      const auto & commands = joint.command_interfaces;
      if (commands.size() != 1 || commands[0].name != hardware_interface::HW_IF_EFFORT) {
        return "joint " + joint.name + " must have effort as its only command interface";
      }
      for (const auto & state : joint.state_interfaces) {
        const auto is_it = [&state](const Kind & each) { return state.name == each.kind; };
        if (std::none_of(STATES.begin(), STATES.end(), is_it)) {
          return "joint " + joint.name + " has no state interface " + state.name +
                 ": position, velocity and effort are there";
        }
      }
    }
    for (const auto & name : names) {
      const auto is_it = [&name](const auto & joint) { return joint.name == name; };
      if (std::count_if(info.joints.begin(), info.joints.end(), is_it) != 1) {
        return "joint " + name + " must be there once: the robot has " + list(names);
      }
    }
    return "";
  }

  static std::string list(const std::vector<std::string> & names)
  {
    std::string whole;
    for (const auto & name : names) {
      whole += (whole.empty() ? "" : ", ") + name;
    }
    return whole;
  }

  // What is wrong with a parameter of the description; empty if nothing.
  std::string set_parameter(const std::string & name, const std::string & text)
  {
    for (std::uint32_t k = 0; k < variable_count; ++k) {
      const Variable & each = variables[k];
      if (each.role != PARAMETER || name != each.name) {
        continue;
      }
      char * end = nullptr;
      double value = std::strtod(text.c_str(), &end);
      bool number = !text.empty() && *end == '\0';
      if (each.kind == BOOLEAN) {
        number = text == "true" || text == "false";
        value = text == "true" ? 1.0 : 0.0;
      }
      if (!number) {
        return "parameter " + name + " must be a " +
               (each.kind == BOOLEAN ? "true or false" : "number") + ", not " + text;
      }
      return instance_set(instance_.get(), k, each.kind, value) ? "" : instance_->message;
    }
    return "parameter " + name + " is unknown: config/robot.urdf of the package names all";
  }

  // Periods that have passed; one where a read is early or late, is the first, or a clock was set.
  static std::int64_t periods_of(double elapsed)
  {
    if (!(elapsed > 1.5 * period)) {
      return 1;
    }
    return std::llround(std::min(elapsed, LONGEST) / period);
  }

  void begin_anew()
  {
    state_write(instance_.get(), first_state_.data());
    moves_ = false;
    tell(true);
  }

  // A state that is just being read by another thread keeps its value, unless it must not.
  void tell(bool wait)
  {
    for (std::uint32_t j = 0; j < layout::JOINTS; ++j) {
      for (std::size_t k = 0; k < STATES.size(); ++k) {
        double value = 0.0;
        if (states_[j][k] && instance_get(instance_.get(), STATES[k].first + j, REAL, &value)) {
          set_state(states_[j][k], value, wait);
        }
      }
    }
  }

  std::unique_ptr<Instance, Delete> instance_;
  std::vector<unsigned char> first_state_;
  std::array<std::array<hardware_interface::StateInterface::SharedPtr, 3>, layout::JOINTS> states_;
  std::array<hardware_interface::CommandInterface::SharedPtr, layout::JOINTS> commands_;
  bool moves_ = false;
};
}  // namespace @package@

#include "pluginlib/class_list_macros.hpp"
PLUGINLIB_EXPORT_CLASS(@package@::RobotSystem, hardware_interface::SystemInterface)
