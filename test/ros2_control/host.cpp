// A controller manager that does what it is told, line by line, and answers each with one line.
// host LAW [ROBOT]: libraries of a controller and of a system, each with its names for itself.
#include <dlfcn.h>

#include <cstdlib>
#include <iostream>
#include <sstream>

#include "stand_in.hpp"

using controller_interface::CallbackReturn;
using hardware_interface::Handle;
using Robot = hardware_interface::SystemInterface;
using Law = controller_interface::ControllerInterface;

template <typename Plugin>
static std::unique_ptr<Plugin> loaded(const char * library)
{
  void * const code = dlopen(library, RTLD_NOW | RTLD_LOCAL);
  if (!code) {
    std::fprintf(stderr, "%s\n", dlerror());
    std::exit(1);
  }
  return std::unique_ptr<Plugin>(
    reinterpret_cast<Plugin * (*)()>(dlsym(code, "make_plugin"))());
}

// Of states and of commands, which may have the same name.
using Handles = std::vector<std::shared_ptr<Handle>>;
static Handles states, commands;

static std::shared_ptr<Handle> handle(Handles & handles, const std::string & name)
{
  for (const auto & each : handles) {
    if (each->joint + "/" + each->kind == name) {
      return each;
    }
  }
  const auto slash = name.rfind('/');
  handles.push_back(
    std::make_shared<Handle>(Handle{name.substr(0, slash), name.substr(slash + 1)}));
  return handles.back();
}

static const char * said(CallbackReturn result)
{
  return result == CallbackReturn::SUCCESS ? "success"
         : result == CallbackReturn::FAILURE ? "failure"
                                             : "error";
}

static hardware_interface::HardwareInfo described(
  const std::vector<std::string> & joints,
  const std::unordered_map<std::string, std::string> & parameters, const std::string & faces)
{
  hardware_interface::HardwareInfo info;
  info.name = "robot", info.type = "system", info.hardware_parameters = parameters;
  for (const auto & name : joints) {
    hardware_interface::ComponentInfo joint;
    joint.name = name, joint.type = "joint";
    std::istringstream kinds(faces);  // the first one is the command
    for (std::string kind; kinds >> kind;) {
      hardware_interface::InterfaceInfo face;
      face.name = kind;
      auto & whose = joint.command_interfaces.empty() ? joint.command_interfaces
                                                      : joint.state_interfaces;
      whose.push_back(face);
    }
    info.joints.push_back(joint);
  }
  return info;
}

template <typename T>
static const std::vector<T> & sent(Law & law, const char * topic)
{
  return dynamic_cast<rclcpp::Publisher<T> &>(*law.get_node()->publishers.at(topic)).sent;
}

static double number(std::istream & words)
{
  std::string word;
  words >> word;
  return std::strtod(word.c_str(), nullptr);  // hexadecimal, too
}

static std::string exact(double value)
{
  char text[40];
  std::snprintf(text, sizeof text, "%a", value);
  return text;
}

static rclcpp::Duration duration(double nanoseconds)
{
  return rclcpp::Duration(std::chrono::nanoseconds(static_cast<std::int64_t>(nanoseconds)));
}

int main(int count, char ** arguments)
{
  auto controller = loaded<Law>(arguments[1]);
  auto robot = count > 2 ? loaded<Robot>(arguments[2]) : nullptr;
  std::unordered_map<std::string, std::string> parameters;
  auto node = controller->get_node();
  const rclcpp_lifecycle::State state;
  std::vector<std::string> joints;
  for (std::string line; std::getline(std::cin, line);) {
    std::istringstream words(line);
    std::string what, name;
    words >> what;
    if (what == "init") {
      words >> controller->update_rate;
      std::cout << said(controller->on_init());
    } else if (what == "number") {
      words >> name;
      node->overrides[name] = number(words);
      std::cout << "taken";
    } else if (what == "flag") {
      words >> name;
      node->overrides[name] = number(words) != 0.0;
      std::cout << "taken";
    } else if (what == "joints") {
      for (joints.clear(); words >> name;) {
        joints.push_back(name);
      }
      node->overrides["joints"] = joints;
      std::cout << "taken";
    } else if (what == "configure") {
      std::cout << said(controller->on_configure(state));
    } else if (what == "claim") {  // the hardware has its interfaces in an order of its own
      std::vector<hardware_interface::LoanedCommandInterface> lent_commands;
      std::vector<hardware_interface::LoanedStateInterface> lent_states;
      auto wanted = controller->command_interface_configuration().names;
      for (auto each = wanted.rbegin(); each != wanted.rend(); ++each) {
        lent_commands.emplace_back(handle(commands, *each));
        std::cout << *each << ' ';
      }
      wanted = controller->state_interface_configuration().names;
      for (auto each = wanted.rbegin(); each != wanted.rend(); ++each) {
        lent_states.emplace_back(handle(states, *each));
        std::cout << *each << ' ';
      }
      controller->assign_interfaces(std::move(lent_commands), std::move(lent_states));
    } else if (what == "activate") {
      node->time = static_cast<std::int64_t>(number(words));
      std::cout << said(controller->on_activate(state));
    } else if (what == "reference") {  // stamp, joints, then rows of position, velocity, ...
      auto message = std::make_shared<trajectory_msgs::msg::JointTrajectory>();
      const auto stamp = static_cast<std::int64_t>(number(words));
      message->header.stamp.sec = static_cast<std::int32_t>(stamp / 1'000'000'000);
      message->header.stamp.nanosec = static_cast<std::uint32_t>(stamp % 1'000'000'000);
      std::size_t count = 0;
      words >> count;
      for (std::size_t k = 0; k < count; ++k) {
        words >> name;
        message->joint_names.push_back(name);
      }
      message->points.resize(1);
      auto & point = message->points[0];
      for (auto row : {&point.positions, &point.velocities, &point.accelerations}) {
        for (std::size_t k = 0; k < count && words.good(); ++k) {
          row->push_back(number(words));
        }
      }
      node->subscription->callback(message);
      std::cout << "heard";
    } else if (what == "set" || what == "command") {  // a number of the hardware
      words >> name;
      handle(what == "set" ? states : commands, name)->value = number(words);
      std::cout << "taken";
    } else if (what == "busy") {
      words >> name >> handle(states, name)->busy;
      std::cout << "taken";
    } else if (what == "update") {  // now and since the update before, both in ns
      const auto now = static_cast<std::int64_t>(number(words));
      const auto result = controller->update(rclcpp::Time(now), duration(number(words)));
      std::cout << (result == controller_interface::return_type::OK ? "ok" : "error");
      for (const auto & joint : joints) {
        std::cout << ' ' << exact(handle(commands, joint + "/effort")->value);
      }
    } else if (what == "fault") {
      const auto & told = sent<std_msgs::msg::UInt8>(*controller, "~/fault");
      std::cout << (told.empty() ? -1 : static_cast<int>(told.back().data));
    } else if (what == "fault_text") {  // how often it was told, and the last
      if (const auto timer = node->timer.lock()) {
        timer->execute();
      }
      const auto & told = sent<std_msgs::msg::String>(*controller, "~/fault_text");
      std::cout << told.size() << ' ' << (told.empty() ? "" : told.back().data);
    } else if (what == "commands") {  // how many, and the last
      const auto & told = sent<std_msgs::msg::Float64MultiArray>(*controller, "~/commands");
      std::cout << told.size();
      for (const double torque : told.empty() ? std::vector<double>() : told.back().data) {
        std::cout << ' ' << exact(torque);
      }
    } else if (what == "robot") {  // describe NAME=VALUE, or a transition of the life cycle
      words >> name;
      if (name == "parameter") {
        std::string key;
        words >> key >> parameters[key];
        std::cout << "taken";
      } else if (name == "init") {
        std::string faces;
        std::getline(words, faces);
        const auto result = robot->init(described(joints, parameters, faces));
        std::cout << said(result);
        if (result == CallbackReturn::SUCCESS) {
          states.clear(), commands.clear();
          for (const auto & each : robot->on_export_state_interfaces()) {
            states.push_back(
              std::const_pointer_cast<hardware_interface::StateInterface>(each));
          }
          for (const auto & each : robot->on_export_command_interfaces()) {
            commands.push_back(each);
          }
        }
      } else {
        std::cout << said(
          name == "configure"    ? robot->on_configure(state)
          : name == "activate"   ? robot->on_activate(state)
          : name == "deactivate" ? robot->on_deactivate(state)
                                 : robot->on_error(state));
      }
    } else if (what == "read" || what == "write") {  // since the one before, in ns
      const rclcpp::Time now(0);
      const auto since = duration(number(words));
      const auto result = what == "read" ? robot->read(now, since) : robot->write(now, since);
      std::cout << (result == hardware_interface::return_type::OK ? "ok" : "error");
    } else if (what == "get") {  // numbers of the hardware
      while (words >> name) {
        std::cout << exact(handle(states, name)->value) << ' ';
      }
    } else if (what == "clear") {
      auto response = std::make_shared<std_srvs::srv::Trigger::Response>();
      node->service->callback(std::make_shared<std_srvs::srv::Trigger::Request>(), response);
      std::cout << response->message;
    } else if (what == "deactivate") {
      std::cout << said(controller->on_deactivate(state));
      for (const auto & joint : joints) {
        std::cout << ' ' << handle(commands, joint + "/effort")->value;
      }
    }
    std::cout << std::endl;
  }
}
