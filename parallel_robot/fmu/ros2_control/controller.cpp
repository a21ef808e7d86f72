// Compiled against stand-ins, not yet run: an older version was run in a controller manager.
//
// A control law with its whole cycle as a controller of ros2_control (Jazzy): written by
// parallel_robot. native/ holds the code of the law; this file joins it to the hardware.

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "controller_interface/controller_interface.hpp"
#include "controller_interface/helpers.hpp"
#include "hardware_interface/types/hardware_interface_type_values.hpp"
#include "rclcpp/rclcpp.hpp"
#include "realtime_tools/realtime_publisher.hpp"
#include "realtime_tools/realtime_thread_safe_box.hpp"
#include "std_msgs/msg/float64_multi_array.hpp"
#include "std_msgs/msg/string.hpp"
#include "std_msgs/msg/u_int8.hpp"
#include "std_srvs/srv/trigger.hpp"
#include "trajectory_msgs/msg/joint_trajectory.hpp"

extern "C" {
#include "native/instance.h"
}
#include "native/layout.h"

namespace @package@
{
using controller_interface::CallbackReturn;
using controller_interface::InterfaceConfiguration;
using controller_interface::return_type;
using Row = std::array<double, layout::JOINTS>;

// Desired motion of the joints at a moment.
struct Reference
{
  bool heard = false;
  std::int64_t stamp = 0;  // ns
  Row position{}, velocity{}, acceleration{};
};

struct Delete
{
  void operator()(Instance * instance) const { instance_free(instance); }
};

class LawController : public controller_interface::ControllerInterface
{
public:
  CallbackReturn on_init() override
  {
    try {
      auto_declare<std::vector<std::string>>("joints", layout::joint_names());
      auto_declare<double>("reference_timeout", layout::REFERENCE_TIMEOUT);
      for (std::int64_t k = 0; k < variable_count; ++k) {
        const Variable & each = variables[k];
        if (each.role == PARAMETER && each.kind == BOOLEAN) {
          auto_declare<bool>(each.name, each.value != 0.0 || k == layout::JOINS);
        } else if (each.role == PARAMETER && each.kind == INTEGER) {
          auto_declare<std::int64_t>(each.name, static_cast<std::int64_t>(each.value));
        } else if (each.role == PARAMETER) {
          auto_declare<double>(each.name, each.value);
        }
      }
    } catch (const std::exception & error) {
      fprintf(stderr, "a parameter cannot be declared: %s\n", error.what());
      return CallbackReturn::ERROR;
    }
    return CallbackReturn::SUCCESS;
  }

  InterfaceConfiguration command_interface_configuration() const override
  {
    return individual({hardware_interface::HW_IF_EFFORT});
  }

  InterfaceConfiguration state_interface_configuration() const override
  {
    std::vector<std::string> kinds{
      hardware_interface::HW_IF_POSITION, hardware_interface::HW_IF_VELOCITY};
    if (effort_known_) {
      kinds.push_back(hardware_interface::HW_IF_EFFORT);
    }
    return individual(kinds);
  }

  CallbackReturn on_configure(const rclcpp_lifecycle::State &) override
  {
    const auto logger = get_node()->get_logger();
    joints_ = get_node()->get_parameter("joints").as_string_array();
    timeout_ = get_node()->get_parameter("reference_timeout").as_double();
    if (joints_.size() != layout::JOINTS) {
      RCLCPP_ERROR(
        logger, "joints must be %zu names, in the order of the law, not %zu", layout::JOINTS,
        joints_.size());
      return CallbackReturn::ERROR;
    }
    if (!(timeout_ > 0.0)) {
      RCLCPP_ERROR(logger, "reference_timeout must be above 0 s, not %g", timeout_);
      return CallbackReturn::ERROR;
    }
    const double rate = 1.0 / period;
    if (std::abs(get_update_rate() - rate) > 1e-6 * rate) {
      RCLCPP_ERROR(
        logger, "update_rate must be %g Hz, for which the law was made, not %u", rate,
        get_update_rate());
      return CallbackReturn::ERROR;
    }
    if (!begin() || !take_parameters()) {
      RCLCPP_ERROR(logger, "%s", instance_ ? instance_->message : "there is no memory");
      return CallbackReturn::ERROR;
    }
    told_ = get_node()->create_publisher<std_msgs::msg::UInt8>(
      "~/fault", rclcpp::QoS(1).reliable().transient_local());
    fault_publisher_ = std::make_unique<FaultPublisher>(told_);
    commanded_ = get_node()->create_publisher<std_msgs::msg::Float64MultiArray>(
      "~/commands", rclcpp::QoS(1).reliable());
    command_publisher_ = std::make_unique<CommandPublisher>(commanded_);
    command_.data.assign(layout::JOINTS, 0.0);
    text_ = get_node()->create_publisher<std_msgs::msg::String>(
      "~/fault_text", rclcpp::QoS(1).reliable().transient_local());
    timer_.reset();
    named_ = std::nullopt;
    timer_ = get_node()->create_wall_timer(std::chrono::milliseconds(50), [this]() { name(); });
    subscription_ = get_node()->create_subscription<trajectory_msgs::msg::JointTrajectory>(
      "~/reference", rclcpp::QoS(1).best_effort(),
      [this](const trajectory_msgs::msg::JointTrajectory::SharedPtr message) {
        take_reference(*message);
      });
    service_ = get_node()->create_service<std_srvs::srv::Trigger>(
      "~/clear_fault", [this](
                         const std_srvs::srv::Trigger::Request::SharedPtr,
                         const std_srvs::srv::Trigger::Response::SharedPtr response) {
        clear_ = true;
        response->success = true;
        response->message = "the law begins anew in the next cycle";
      });
    return CallbackReturn::SUCCESS;
  }

  CallbackReturn on_activate(const rclcpp_lifecycle::State &) override
  {
    const auto logger = get_node()->get_logger();
    const auto ordered = [this](auto & loaned, const char * kind, auto & interfaces) {
      interfaces.clear();
      return controller_interface::get_ordered_interfaces(loaned, joints_, kind, interfaces);
    };
    if (
      !ordered(command_interfaces_, hardware_interface::HW_IF_EFFORT, torques_) ||
      !ordered(state_interfaces_, hardware_interface::HW_IF_POSITION, positions_) ||
      !ordered(state_interfaces_, hardware_interface::HW_IF_VELOCITY, velocities_) ||
      (effort_known_ && !ordered(state_interfaces_, hardware_interface::HW_IF_EFFORT, efforts_)))
    {
      RCLCPP_ERROR(logger, "the hardware has not position, velocity and effort of each joint");
      return CallbackReturn::ERROR;
    }
    reference_ = box_.get();
    if (!is_fresh(reference_, get_node()->now().nanoseconds())) {
      RCLCPP_ERROR(logger, "no reference comes on ~/reference: start the trajectory first");
      return CallbackReturn::FAILURE;
    }
    begin_anew();
    clear_ = false;
    published_ = std::nullopt;
    return CallbackReturn::SUCCESS;
  }

  CallbackReturn on_deactivate(const rclcpp_lifecycle::State &) override
  {
    write({});
    torques_.clear(), positions_.clear(), velocities_.clear(), efforts_.clear();
    return CallbackReturn::SUCCESS;
  }

  return_type update(const rclcpp::Time & time, const rclcpp::Duration & elapsed) override
  {
    if (clear_.exchange(false)) {
      begin_anew();
    }
    // The newest reference; one that is just being written is taken in the next cycle.
    if (const auto heard = box_.try_get()) {
      reference_ = *heard;
    }
    Row torque{};
    if (!read(positions_, layout::POSITION) || !read(velocities_, layout::VELOCITY) ||
      (effort_known_ && !read(efforts_, layout::EFFORT)))
    {
      fault_ = layout::STATES_INVALID;
    }
    if (fault_ != layout::STATES_INVALID) {
      step(time.nanoseconds(), elapsed.seconds(), torque);
    }
    const bool written = write(torque);
    tell(torque);
    return written ? return_type::OK : return_type::ERROR;
  }

private:
  using FaultPublisher = realtime_tools::RealtimePublisher<std_msgs::msg::UInt8>;
  using CommandPublisher = realtime_tools::RealtimePublisher<std_msgs::msg::Float64MultiArray>;
  using States = std::vector<std::reference_wrapper<hardware_interface::LoanedStateInterface>>;
  using Commands = std::vector<std::reference_wrapper<hardware_interface::LoanedCommandInterface>>;

  InterfaceConfiguration individual(const std::vector<std::string> & kinds) const
  {
    InterfaceConfiguration found{
      controller_interface::interface_configuration_type::INDIVIDUAL, {}};
    for (const auto & kind : kinds) {
      for (const auto & joint : joints_) {
        found.names.push_back(joint + "/" + kind);
      }
    }
    return found;
  }

  // A law before its first state, with the memory that it keeps until the end.
  bool begin()
  {
    instance_.reset(instance_new());
    return instance_ && instance_begin(instance_.get());
  }

  void begin_anew()
  {
    state_write(instance_.get(), first_state_.data());
    fault_ = 0;
  }

  bool take_parameters()
  {
    effort_known_ = false;
    for (std::int64_t k = 0; k < variable_count; ++k) {
      const Variable & each = variables[k];
      if (each.role != PARAMETER) {
        continue;
      }
      const auto parameter = get_node()->get_parameter(each.name);
      double value = 0.0;
      if (each.kind == BOOLEAN) {
        value = parameter.as_bool() ? 1.0 : 0.0;
      } else if (each.kind == INTEGER) {
        value = static_cast<double>(parameter.as_int());
      } else {
        value = parameter.as_double();
      }
      if (!instance_set(instance_.get(), static_cast<std::uint32_t>(k), each.kind, value)) {
        return false;
      }
      effort_known_ |= k == layout::EFFORT_KNOWN && value != 0.0;
    }
    first_state_.resize(state_bytes());
    state_read(instance_.get(), first_state_.data());
    return true;
  }

  bool is_fresh(const Reference & reference, std::int64_t now) const
  {
    const double age = 1e-9 * static_cast<double>(now - reference.stamp);
    return reference.heard && std::abs(age) <= timeout_;
  }

  // Outside the loop: a message of one point, with the joints in any order.
  void take_reference(const trajectory_msgs::msg::JointTrajectory & message)
  {
    Reference reference;
    const auto & stamp = message.header.stamp;
    reference.heard = true;
    reference.stamp = 1'000'000'000LL * stamp.sec + stamp.nanosec;
    bool whole = message.points.size() == 1;
    for (std::size_t j = 0; whole && j < joints_.size(); ++j) {
      const auto & names = message.joint_names;
      const auto & point = message.points[0];
      std::size_t k = 0;
      while (k < names.size() && names[k] != joints_[j]) {
        ++k;
      }
      whole = k < names.size() && k < point.positions.size() && k < point.velocities.size() &&
        k < point.accelerations.size();
      if (whole) {
        reference.position[j] = point.positions[k];
        reference.velocity[j] = point.velocities[k];
        reference.acceleration[j] = point.accelerations[k];
        whole = std::isfinite(
          point.positions[k] + point.velocities[k] + point.accelerations[k]);
      }
    }
    if (!whole) {
      RCLCPP_WARN_THROTTLE(
        get_node()->get_logger(), *get_node()->get_clock(), 1000,
        "a reference has not one point with position, velocity and acceleration of each joint");
      return;
    }
    box_.set(reference);
  }

  bool read(const States & interfaces, std::uint32_t first)
  {
    for (std::size_t j = 0; j < interfaces.size(); ++j) {
      // One that is just being written keeps the value of the cycle before.
      if (const auto value = interfaces[j].get().get_optional()) {
        if (!std::isfinite(*value)) {
          return false;
        }
        instance_set(instance_.get(), first + static_cast<std::uint32_t>(j), REAL, *value);
      }
    }
    return true;
  }

  // `elapsed`: since the update before [s]. In a pause of the manager states were missing.
  void step(std::int64_t now, double elapsed, Row & torque)
  {
    // A reference that is too old makes no number, at which the law acts safely from then on.
    const bool fresh = is_fresh(reference_, now);
    const double nothing = std::numeric_limits<double>::quiet_NaN();
    const double later = 1e-9 * static_cast<double>(now - reference_.stamp);
    Instance * instance = instance_.get();
    for (std::uint32_t j = 0; j < layout::JOINTS; ++j) {
      const double v = reference_.velocity[j], a = reference_.acceleration[j];
      const double q = reference_.position[j] + later * (v + 0.5 * later * a);
      instance_set(instance, layout::REFERENCE_POSITION + j, REAL, fresh ? q : nothing);
      instance_set(
        instance, layout::REFERENCE_VELOCITY + j, REAL, fresh ? v + later * a : nothing);
      instance_set(instance, layout::REFERENCE_ACCELERATION + j, REAL, fresh ? a : nothing);
    }
    instance_set(instance, layout::ELAPSED, REAL, elapsed);
    instance_set(instance, layout::REFERENCE_AGE, REAL, later);
    double fault = 0.0;
    instance_step(instance, instance->time, period);
    for (std::uint32_t j = 0; j < layout::JOINTS; ++j) {
      instance_get(instance, layout::TORQUE + j, REAL, &torque[j]);
    }
    instance_get(instance, layout::FAULT, INTEGER, &fault);
    if (fault_ == 0 && fault != 0.0) {
      const bool stale = !fresh && fault == layout::TORQUE_NOT_FINITE;
      fault_ = stale ? layout::REFERENCE_STALE : static_cast<std::uint8_t>(fault);
    }
  }

  bool write(const Row & torque)
  {
    bool written = true;
    for (std::size_t j = 0; j < torques_.size(); ++j) {
      written &= torques_[j].get().set_value(torque[j]);
    }
    return written;
  }

  // The torque in each cycle, as far as the publisher keeps up, and the fault when it changes.
  // Copies of one length allocate nothing, but for the first.
  void tell(const Row & torque)
  {
    std::copy(torque.begin(), torque.end(), command_.data.begin());
    command_publisher_->try_publish(command_);
    const std::uint8_t fault = fault_;
    if (published_ == fault) {
      return;
    }
    std_msgs::msg::UInt8 message;
    message.data = fault;
    if (fault_publisher_->try_publish(message)) {
      published_ = fault;
    }
  }

  // Outside the loop: the fault in words, once.
  void name()
  {
    const std::uint8_t fault = fault_;
    if (named_ == fault) {
      return;
    }
    named_ = fault;
    std_msgs::msg::String message;
    message.data = layout::fault_text(fault);
    text_->publish(message);
    if (fault != 0) {
      RCLCPP_ERROR(
        get_node()->get_logger(), "fault %u: %s; ~/clear_fault ends it",
        static_cast<unsigned>(fault), layout::fault_text(fault));
    }
  }

  std::vector<std::string> joints_;
  double timeout_ = 0.0;
  bool effort_known_ = false;
  std::unique_ptr<Instance, Delete> instance_;
  std::vector<unsigned char> first_state_;
  realtime_tools::RealtimeThreadSafeBox<Reference> box_;
  Reference reference_;
  std::atomic<bool> clear_{false};
  std::atomic<std::uint8_t> fault_{0};
  std::optional<std::uint8_t> published_, named_;
  States positions_, velocities_, efforts_;
  Commands torques_;
  rclcpp::Publisher<std_msgs::msg::UInt8>::SharedPtr told_;
  std::unique_ptr<FaultPublisher> fault_publisher_;
  rclcpp::Publisher<std_msgs::msg::Float64MultiArray>::SharedPtr commanded_;
  std::unique_ptr<CommandPublisher> command_publisher_;
  std_msgs::msg::Float64MultiArray command_;
  rclcpp::Publisher<std_msgs::msg::String>::SharedPtr text_;
  rclcpp::TimerBase::SharedPtr timer_;
  rclcpp::Subscription<trajectory_msgs::msg::JointTrajectory>::SharedPtr subscription_;
  rclcpp::Service<std_srvs::srv::Trigger>::SharedPtr service_;
};
}  // namespace @package@

#include "pluginlib/class_list_macros.hpp"
PLUGINLIB_EXPORT_CLASS(@package@::LawController, controller_interface::ControllerInterface)
