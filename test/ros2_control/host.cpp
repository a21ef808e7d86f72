// A controller manager that does what it is told, line by line, and answers each with one line.
#include <cstdlib>
#include <iostream>
#include <sstream>

#include "stand_in.hpp"

using controller_interface::CallbackReturn;
using hardware_interface::Handle;

static std::vector<std::shared_ptr<Handle>> handles;

static std::shared_ptr<Handle> handle(const std::string & name)
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

static double number(std::istream & words)
{
  std::string word;
  words >> word;
  return std::strtod(word.c_str(), nullptr);  // hexadecimal, too
}

int main()
{
  auto controller = make_controller();
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
      std::vector<hardware_interface::LoanedCommandInterface> commands;
      std::vector<hardware_interface::LoanedStateInterface> states;
      auto wanted = controller->command_interface_configuration().names;
      for (auto each = wanted.rbegin(); each != wanted.rend(); ++each) {
        commands.emplace_back(handle(*each));
        std::cout << *each << ' ';
      }
      wanted = controller->state_interface_configuration().names;
      for (auto each = wanted.rbegin(); each != wanted.rend(); ++each) {
        states.emplace_back(handle(*each));
        std::cout << *each << ' ';
      }
      controller->assign_interfaces(std::move(commands), std::move(states));
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
    } else if (what == "set") {  // a number of the hardware
      words >> name;
      handle(name)->value = number(words);
      std::cout << "taken";
    } else if (what == "busy") {
      words >> name >> handle(name)->busy;
      std::cout << "taken";
    } else if (what == "update") {
      const auto now = static_cast<std::int64_t>(number(words));
      const auto result = controller->update(rclcpp::Time(now), rclcpp::Duration(0));
      std::cout << (result == controller_interface::return_type::OK ? "ok" : "error");
      for (const auto & joint : joints) {
        char text[40];
        std::snprintf(text, sizeof text, " %a", handle(joint + "/effort")->value);
        std::cout << text;
      }
    } else if (what == "fault") {
      const auto & sent = node->publisher->sent;
      std::cout << (sent.empty() ? -1 : static_cast<int>(sent.back().data));
    } else if (what == "clear") {
      auto response = std::make_shared<std_srvs::srv::Trigger::Response>();
      node->service->callback(std::make_shared<std_srvs::srv::Trigger::Request>(), response);
      std::cout << response->message;
    } else if (what == "deactivate") {
      std::cout << said(controller->on_deactivate(state));
      for (const auto & joint : joints) {
        std::cout << ' ' << handle(joint + "/effort")->value;
      }
    }
    std::cout << std::endl;
  }
}
