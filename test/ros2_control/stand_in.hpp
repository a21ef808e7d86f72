// What a controller and a system of ros2_control touch of ROS 2 Jazzy, without ROS: names,
// signatures and what they refuse as in controller_interface and hardware_interface 4.46,
// realtime_tools 3.11 and rclcpp 28.
#pragma once

#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <unordered_map>
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
struct String
{
  std::string data;
};
struct MultiArrayDimension
{
  std::string label;
  std::uint32_t size = 0, stride = 0;
};
struct MultiArrayLayout
{
  std::vector<MultiArrayDimension> dim;
  std::uint32_t data_offset = 0;
};
struct Float64MultiArray
{
  MultiArrayLayout layout;
  std::vector<double> data;
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
  Duration(std::int32_t, std::uint32_t) = delete;
  explicit Duration(std::chrono::nanoseconds duration) : nanoseconds_(duration.count()) {}
  std::int64_t nanoseconds() const { return nanoseconds_; }
  double seconds() const
  {
    return std::chrono::duration<double>(std::chrono::nanoseconds(nanoseconds_)).count();
  }

private:
  std::int64_t nanoseconds_;
};

struct Logger
{
};
struct Clock
{
  using SharedPtr = std::shared_ptr<Clock>;
};

class TimerBase
{
public:
  using SharedPtr = std::shared_ptr<TimerBase>;
  virtual ~TimerBase() = default;
  virtual void execute() = 0;
};
template <typename Callback>
class WallTimer : public TimerBase
{
public:
  using SharedPtr = std::shared_ptr<WallTimer<Callback>>;
  explicit WallTimer(Callback && callback) : callback_(std::move(callback)) {}
  void execute() override { callback_(); }

private:
  Callback callback_;
};

class CallbackGroup;
class Executor
{
public:
  using WeakPtr = std::weak_ptr<Executor>;
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

struct PublisherBase
{
  virtual ~PublisherBase() = default;
};

template <typename T>
struct Publisher : PublisherBase
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

namespace node_interfaces
{
class LifecycleNodeInterface
{
public:
  enum class CallbackReturn : std::uint8_t { SUCCESS = 97, FAILURE = 98, ERROR = 99 };
  virtual ~LifecycleNodeInterface() = default;
  virtual CallbackReturn on_configure(const State &) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_cleanup(const State &) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_shutdown(const State &) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_activate(const State &) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_deactivate(const State &) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_error(const State &) { return CallbackReturn::FAILURE; }
};
}  // namespace node_interfaces

class LifecycleNode
{
public:
  std::int64_t time = 0;                         // ns
  std::map<std::string, rclcpp::Value> overrides;  // of the parameter file
  std::map<std::string, std::shared_ptr<rclcpp::PublisherBase>> publishers;  // by their topics
  std::weak_ptr<rclcpp::TimerBase> timer;
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
  std::shared_ptr<rclcpp::Publisher<T>> create_publisher(
    const std::string & topic, const rclcpp::QoS &)
  {
    auto made = std::make_shared<rclcpp::Publisher<T>>();
    publishers[topic] = made;
    return made;
  }
  template <typename Rep, typename Ratio, typename Callback>
  typename rclcpp::WallTimer<Callback>::SharedPtr create_wall_timer(
    std::chrono::duration<Rep, Ratio>, Callback callback,
    std::shared_ptr<rclcpp::CallbackGroup> = nullptr, bool = true)
  {
    auto made = std::make_shared<rclcpp::WallTimer<Callback>>(std::move(callback));
    timer = made;
    return made;
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
  using SharedPtr = std::shared_ptr<Handle>;
  std::string joint, kind;
  double value = 0.0;
  bool busy = false;
  template <typename T>
  [[nodiscard]] bool set_value(const T & given, bool wait_for_lock)
  {
    static_assert(std::is_same_v<T, double>);  // another type throws
    if (busy && !wait_for_lock) {
      return false;
    }
    value = given;
    return true;
  }
  template <typename T>
  [[nodiscard]] bool get_value(T & given, bool wait_for_lock) const
  {
    static_assert(std::is_same_v<T, double>);
    if (busy && !wait_for_lock) {
      return false;
    }
    given = value;
    return true;
  }
};
struct StateInterface : Handle
{
  using SharedPtr = std::shared_ptr<StateInterface>;
  using ConstSharedPtr = std::shared_ptr<const StateInterface>;
};
struct CommandInterface : Handle
{
  using SharedPtr = std::shared_ptr<CommandInterface>;
  CommandInterface() { value = std::numeric_limits<double>::quiet_NaN(); }
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

enum class return_type : std::uint8_t { OK = 0, ERROR = 1, DEACTIVATE = 2 };
using CallbackReturn = rclcpp_lifecycle::node_interfaces::LifecycleNodeInterface::CallbackReturn;

struct InterfaceInfo
{
  std::string name, min, max, initial_value, data_type = "double";
};
struct ComponentInfo
{
  std::string name, type;
  std::vector<InterfaceInfo> command_interfaces, state_interfaces;
  std::unordered_map<std::string, std::string> parameters;
};
struct HardwareInfo
{
  std::string name, type, group, hardware_plugin_name;
  unsigned int rw_rate = 0;
  bool is_async = false;
  std::unordered_map<std::string, std::string> hardware_parameters;
  std::vector<ComponentInfo> joints, sensors, gpios;
};
struct HardwareComponentInterfaceParams
{
  HardwareComponentInterfaceParams() = default;
  HardwareInfo hardware_info;
  rclcpp::Executor::WeakPtr executor;
};

class HardwareComponentInterface : public rclcpp_lifecycle::node_interfaces::LifecycleNodeInterface
{
public:
  HardwareComponentInterface() = default;
  HardwareComponentInterface(const HardwareComponentInterface &) = delete;
  HardwareComponentInterface(HardwareComponentInterface &&) = delete;

  // As the framework does it; `executor` and node are left out.
  CallbackReturn init(const HardwareInfo & hardware_info)
  {
    info_ = hardware_info;
    HardwareComponentInterfaceParams params;
    params.hardware_info = info_;
    return on_init(params);
  }
  [[deprecated]] virtual CallbackReturn on_init(const HardwareInfo & hardware_info)
  {
    info_ = hardware_info;
    described_ = true;
    return CallbackReturn::SUCCESS;
  }
  virtual CallbackReturn on_init(const HardwareComponentInterfaceParams & params)
  {
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wdeprecated-declarations"
    return on_init(params.hardware_info);
#pragma GCC diagnostic pop
  }
  // Made after on_init, from what its base class has parsed; in no order that is told.
  virtual std::vector<StateInterface::ConstSharedPtr> on_export_state_interfaces()
  {
    std::vector<StateInterface::ConstSharedPtr> made;
    for (auto joint = info_.joints.rbegin(); described_ && joint != info_.joints.rend(); ++joint) {
      for (const auto & each : joint->state_interfaces) {
        made.push_back(made_as(states_, joint->name, each.name));
      }
    }
    return made;
  }
  virtual std::vector<CommandInterface::SharedPtr> on_export_command_interfaces()
  {
    std::vector<CommandInterface::SharedPtr> made;
    for (auto joint = info_.joints.rbegin(); described_ && joint != info_.joints.rend(); ++joint) {
      for (const auto & each : joint->command_interfaces) {
        made.push_back(made_as(commands_, joint->name, each.name));
      }
    }
    return made;
  }
  virtual return_type read(const rclcpp::Time & time, const rclcpp::Duration & period) = 0;
  virtual return_type write(const rclcpp::Time &, const rclcpp::Duration &)
  {
    return return_type::OK;
  }
  virtual bool has_state(const std::string & name) const { return states_.count(name) > 0; }
  virtual bool has_command(const std::string & name) const { return commands_.count(name) > 0; }
  virtual const StateInterface::SharedPtr & get_state_interface_handle(
    const std::string & name) const
  {
    return found(states_, name);
  }
  virtual const CommandInterface::SharedPtr & get_command_interface_handle(
    const std::string & name) const
  {
    return found(commands_, name);
  }
  template <typename T>
  bool set_state(const StateInterface::SharedPtr & handle, const T & value, bool wait_until_set)
  {
    return there(handle).set_value(value, wait_until_set);
  }
  template <typename T>
  bool set_command(
    const CommandInterface::SharedPtr & handle, const T & value, bool wait_until_set)
  {
    return there(handle).set_value(value, wait_until_set);
  }
  template <typename T>
  bool get_command(
    const CommandInterface::SharedPtr & handle, T & command, bool wait_until_get) const
  {
    return there(handle).get_value(command, wait_until_get);
  }
  virtual rclcpp::Logger get_logger() const { return {}; }
  virtual rclcpp::Clock::SharedPtr get_clock() const { return std::make_shared<rclcpp::Clock>(); }
  const HardwareInfo & get_hardware_info() const { return info_; }

protected:
  HardwareInfo info_;

private:
  template <typename T>
  using Handles = std::map<std::string, std::shared_ptr<T>>;
  template <typename T>
  static std::shared_ptr<T> made_as(
    Handles<T> & handles, const std::string & joint, const std::string & kind)
  {
    auto made = std::make_shared<T>();
    made->joint = joint, made->kind = kind;
    return handles[joint + "/" + kind] = made;
  }
  template <typename T>
  static const std::shared_ptr<T> & found(const Handles<T> & handles, const std::string & name)
  {
    const auto it = handles.find(name);
    if (it == handles.end()) {
      throw std::runtime_error("The requested interface doesn't exist: " + name);
    }
    return it->second;
  }
  template <typename T>
  static T & there(const std::shared_ptr<T> & handle)
  {
    if (!handle) {
      throw std::runtime_error("interface handle is null");
    }
    return *handle;
  }

  bool described_ = false;
  Handles<StateInterface> states_;
  Handles<CommandInterface> commands_;
};

class SystemInterface : public HardwareComponentInterface
{
public:
  return_type write(const rclcpp::Time & time, const rclcpp::Duration & period) override = 0;
};
}  // namespace hardware_interface

namespace controller_interface
{
enum class return_type : std::uint8_t { OK = 0, ERROR = 1 };
using CallbackReturn = rclcpp_lifecycle::node_interfaces::LifecycleNodeInterface::CallbackReturn;
enum class interface_configuration_type : std::uint8_t { ALL = 0, INDIVIDUAL = 1, NONE = 2 };
struct InterfaceConfiguration
{
  interface_configuration_type type = interface_configuration_type::NONE;
  std::vector<std::string> names = {};
};

class ControllerInterface : public rclcpp_lifecycle::node_interfaces::LifecycleNodeInterface
{
public:
  unsigned int update_rate = 0;
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> node =
    std::make_shared<rclcpp_lifecycle::LifecycleNode>();

  virtual InterfaceConfiguration command_interface_configuration() const = 0;
  virtual InterfaceConfiguration state_interface_configuration() const = 0;
  virtual CallbackReturn on_init() = 0;
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
#define PLUGINLIB_EXPORT_CLASS(CLASS, BASE) \
  extern "C" BASE * make_plugin() { return new CLASS(); }
