// What a controller of ros2_control touches of ROS 2 Jazzy, without ROS: names, signatures and
// what they refuse as in controller_interface 4.x, realtime_tools 3.x and rclcpp 28.
#pragma once

#include <cstdint>
#include <cstdio>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <variant>
#include <vector>

namespace builtin_interfaces::msg
{
struct Time
{
  std::int32_t sec = 0;
  std::uint32_t nanosec = 0;
};
}  // namespace builtin_interfaces::msg

namespace std_msgs::msg
{
struct Header
{
  builtin_interfaces::msg::Time stamp;
  std::string frame_id;
};
struct UInt8
{
  std::uint8_t data = 0;
};
}  // namespace std_msgs::msg

namespace std_srvs::srv
{
struct Trigger
{
  struct Request
  {
    using SharedPtr = std::shared_ptr<Request>;
  };
  struct Response
  {
    using SharedPtr = std::shared_ptr<Response>;
    bool success = false;
    std::string message;
  };
};
}  // namespace std_srvs::srv

namespace trajectory_msgs::msg
{
struct JointTrajectoryPoint
{
  std::vector<double> positions, velocities, accelerations, effort;
};
struct JointTrajectory
{
  using SharedPtr = std::shared_ptr<JointTrajectory>;
  std_msgs::msg::Header header;
  std::vector<std::string> joint_names;
  std::vector<JointTrajectoryPoint> points;
};
}  // namespace trajectory_msgs::msg

namespace rclcpp
{
class Time
{
public:
  explicit Time(std::int64_t nanoseconds) : nanoseconds_(nanoseconds) {}
  std::int64_t nanoseconds() const { return nanoseconds_; }

private:
  std::int64_t nanoseconds_;
};

class Duration
{
public:
  explicit Duration(std::int64_t) {}
};

struct Logger
{
};
struct Clock
{
};

class QoS
{
public:
  explicit QoS(std::size_t) {}
  QoS & reliable() { return *this; }
  QoS & best_effort() { return *this; }
  QoS & transient_local() { return *this; }
};

using Value = std::variant<bool, std::int64_t, double, std::vector<std::string>>;

class Parameter
{
public:
  explicit Parameter(Value value) : value_(std::move(value)) {}
  bool as_bool() const { return get_value<bool>(); }
  std::int64_t as_int() const { return get_value<std::int64_t>(); }
  double as_double() const { return get_value<double>(); }
  std::vector<std::string> as_string_array() const
  {
    return get_value<std::vector<std::string>>();
  }
  template <typename T>
  T get_value() const
  {
    if (!std::holds_alternative<T>(value_)) {
      throw std::runtime_error("ParameterTypeException");
    }
    return std::get<T>(value_);
  }

private:
  Value value_;
};

template <typename T>
struct Publisher
{
  using SharedPtr = std::shared_ptr<Publisher<T>>;
  std::vector<T> sent;
  void publish(const T & message) { sent.push_back(message); }
};

template <typename T>
struct Subscription
{
  using SharedPtr = std::shared_ptr<Subscription<T>>;
  std::function<void(std::shared_ptr<T>)> callback;
};

template <typename T>
struct Service
{
  using SharedPtr = std::shared_ptr<Service<T>>;
  std::function<void(std::shared_ptr<typename T::Request>, std::shared_ptr<typename T::Response>)>
    callback;
};
}  // namespace rclcpp

#define RCLCPP_ERROR(logger, ...) \
  ((void)(logger), std::fprintf(stderr, __VA_ARGS__), (void)std::fputc('\n', stderr))
#define RCLCPP_WARN_THROTTLE(logger, clock, duration, ...) \
  ((void)(clock), (void)(duration), RCLCPP_ERROR(logger, __VA_ARGS__))

namespace rclcpp_lifecycle
{
struct State
{
};

class LifecycleNode
{
public:
  std::int64_t time = 0;                         // ns
  std::map<std::string, rclcpp::Value> overrides;  // of the parameter file
  std::shared_ptr<rclcpp::Publisher<std_msgs::msg::UInt8>> publisher;
  std::shared_ptr<rclcpp::Subscription<trajectory_msgs::msg::JointTrajectory>> subscription;
  std::shared_ptr<rclcpp::Service<std_srvs::srv::Trigger>> service;

  rclcpp::Logger get_logger() const { return {}; }
  std::shared_ptr<rclcpp::Clock> get_clock() { return std::make_shared<rclcpp::Clock>(); }
  rclcpp::Time now() const { return rclcpp::Time(time); }
  bool has_parameter(const std::string & name) const { return declared_.count(name) > 0; }
  template <typename T>
  T declare_parameter(const std::string & name, const T & value)
  {
    if (has_parameter(name)) {
      throw std::runtime_error("ParameterAlreadyDeclaredException: " + name);
    }
    const auto found = overrides.find(name);
    const rclcpp::Value taken = found == overrides.end() ? rclcpp::Value(value) : found->second;
    if (!std::holds_alternative<T>(taken)) {
      throw std::runtime_error("InvalidParameterTypeException: " + name);
    }
    declared_[name] = taken;
    return std::get<T>(taken);
  }
  rclcpp::Parameter get_parameter(const std::string & name) const
  {
    if (!has_parameter(name)) {
      throw std::runtime_error("ParameterNotDeclaredException: " + name);
    }
    return rclcpp::Parameter(declared_.at(name));
  }
  template <typename T>
  std::shared_ptr<rclcpp::Publisher<T>> create_publisher(const std::string &, const rclcpp::QoS &)
  {
    return publisher = std::make_shared<rclcpp::Publisher<T>>();
  }
  template <typename T, typename Callback>
  std::shared_ptr<rclcpp::Subscription<T>> create_subscription(
    const std::string &, const rclcpp::QoS &, Callback && callback)
  {
    subscription = std::make_shared<rclcpp::Subscription<T>>();
    subscription->callback = callback;
    return subscription;
  }
  template <typename T, typename Callback>
  std::shared_ptr<rclcpp::Service<T>> create_service(const std::string &, Callback && callback)
  {
    service = std::make_shared<rclcpp::Service<T>>();
    service->callback = callback;
    return service;
  }

private:
  std::map<std::string, rclcpp::Value> declared_;
};
}  // namespace rclcpp_lifecycle

namespace hardware_interface
{
constexpr char HW_IF_POSITION[] = "position";
constexpr char HW_IF_VELOCITY[] = "velocity";
constexpr char HW_IF_EFFORT[] = "effort";

// A number of the hardware; `busy`: it is just being written.
struct Handle
{
  std::string joint, kind;
  double value = 0.0;
  bool busy = false;
};

class Loaned
{
public:
  explicit Loaned(std::shared_ptr<Handle> handle) : handle_(std::move(handle)) {}
  Loaned(const Loaned &) = delete;
  Loaned(Loaned &&) = default;
  const std::string & get_prefix_name() const { return handle_->joint; }
  const std::string & get_interface_name() const { return handle_->kind; }
  std::string get_name() const { return handle_->joint + "/" + handle_->kind; }
  template <typename T = double>
  [[nodiscard]] std::optional<T> get_optional(unsigned int = 10) const
  {
    return handle_->busy ? std::nullopt : std::optional<T>(handle_->value);
  }

protected:
  std::shared_ptr<Handle> handle_;
};

using LoanedStateInterface = Loaned;

class LoanedCommandInterface : public Loaned
{
public:
  using Loaned::Loaned;
  template <typename T>
  [[nodiscard]] bool set_value(const T & value, unsigned int = 10)
  {
    if (handle_->busy) {
      return false;
    }
    handle_->value = value;
    return true;
  }
};
}  // namespace hardware_interface

namespace controller_interface
{
enum class return_type : std::uint8_t { OK = 0, ERROR = 1 };
enum class CallbackReturn : std::uint8_t { SUCCESS = 97, FAILURE = 98, ERROR = 99 };
enum class interface_configuration_type : std::uint8_t { ALL = 0, INDIVIDUAL = 1, NONE = 2 };
struct InterfaceConfiguration
{
  interface_configuration_type type = interface_configuration_type::NONE;
  std::vector<std::string> names = {};
};

class ControllerInterface
{
public:
  unsigned int update_rate = 0;
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> node =
    std::make_shared<rclcpp_lifecycle::LifecycleNode>();

  virtual ~ControllerInterface() = default;
  virtual InterfaceConfiguration command_interface_configuration() const = 0;
  virtual InterfaceConfiguration state_interface_configuration() const = 0;
  virtual CallbackReturn on_init() = 0;
  virtual CallbackReturn on_configure(const rclcpp_lifecycle::State &) = 0;
  virtual CallbackReturn on_activate(const rclcpp_lifecycle::State &) = 0;
  virtual CallbackReturn on_deactivate(const rclcpp_lifecycle::State &) = 0;
  virtual return_type update(const rclcpp::Time &, const rclcpp::Duration &) = 0;
  void assign_interfaces(
    std::vector<hardware_interface::LoanedCommandInterface> && commands,
    std::vector<hardware_interface::LoanedStateInterface> && states)
  {
    command_interfaces_ = std::move(commands);
    state_interfaces_ = std::move(states);
  }
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> get_node() { return node; }
  std::shared_ptr<const rclcpp_lifecycle::LifecycleNode> get_node() const { return node; }
  unsigned int get_update_rate() const { return update_rate; }
  template <typename T>
  auto auto_declare(const std::string & name, const T & value)
  {
    return node->has_parameter(name) ? node->get_parameter(name).template get_value<T>()
                                     : node->declare_parameter<T>(name, value);
  }

protected:
  std::vector<hardware_interface::LoanedCommandInterface> command_interfaces_;
  std::vector<hardware_interface::LoanedStateInterface> state_interfaces_;
};

template <typename T>
bool get_ordered_interfaces(
  std::vector<T> & unordered, const std::vector<std::string> & names, const std::string & kind,
  std::vector<std::reference_wrapper<T>> & ordered)
{
  for (const auto & name : names) {
    for (auto & each : unordered) {
      if (name == each.get_prefix_name() && kind == each.get_interface_name()) {
        ordered.push_back(std::ref(each));
      }
    }
  }
  return names.size() == ordered.size();
}
}  // namespace controller_interface

namespace realtime_tools
{
template <class T>
class RealtimeThreadSafeBox
{
public:
  void set(const T & value)
  {
    std::lock_guard<std::mutex> guard(lock_);
    value_ = value;
  }
  [[nodiscard]] T get() const
  {
    std::lock_guard<std::mutex> guard(lock_);
    return value_;
  }
  [[nodiscard]] std::optional<T> try_get() const
  {
    std::unique_lock<std::mutex> guard(lock_, std::try_to_lock);
    return guard.owns_lock() ? std::optional<T>(value_) : std::nullopt;
  }

private:
  T value_{};
  mutable std::mutex lock_;
};

template <class T>
class RealtimePublisher
{
public:
  explicit RealtimePublisher(typename rclcpp::Publisher<T>::SharedPtr publisher)
  : publisher_(std::move(publisher))
  {
  }
  bool try_publish(const T & message) { return publisher_->publish(message), true; }

private:
  typename rclcpp::Publisher<T>::SharedPtr publisher_;
};
}  // namespace realtime_tools

// The factory of pluginlib: one class in a library.
std::unique_ptr<controller_interface::ControllerInterface> make_controller();
#define PLUGINLIB_EXPORT_CLASS(CLASS, BASE)                   \
  std::unique_ptr<BASE> make_controller()                     \
  {                                                           \
    return std::make_unique<CLASS>();                         \
  }
