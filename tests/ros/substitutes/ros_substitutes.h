// SPDX-License-Identifier: BSD-3-Clause
#pragma once

// rclcpp, tf2_ros and image_transport as far as the node uses them, to compile and run it without
// ROS: one bus within the process. Signatures are those of ROS 2 Humble.
#include <any>
#include <chrono>
#include <cstdio>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "ros_messages.h"

/// What nodes send and how they are called.
struct Bus {
  using Handler = std::function<void(const std::any&)>;
  std::mutex mutex;
  std::map<std::string, std::vector<std::any>> sent;     // messages by topic
  std::map<std::string, std::vector<Handler>> handlers;  // by topic; std::shared_ptr<const T>
  std::map<std::string, Handler> services;               // std::pair of request and response
  std::vector<std::function<void()>> timers;
  std::map<std::string, rcl_interfaces::msg::ParameterDescriptor> parameters;
  std::vector<std::string> log;
  std::vector<geometry_msgs::msg::TransformStamped> transforms;  // of others
  std::map<std::string, std::string> transports;                 // of images, by topic

  static Bus& get() {
    static Bus bus;
    return bus;
  }
  void clear() {
    const std::lock_guard lock(mutex);
    sent.clear(), handlers.clear(), services.clear(), timers.clear(), parameters.clear();
    log.clear(), transports.clear(), transforms.clear();
  }
  template <typename T>
  void give(const std::string& topic, const T& message) {
    const std::any any(std::make_shared<const T>(message));
    for (const Handler& handler : handlers.at(topic)) handler(any);
  }
  template <typename T>
  std::vector<T> all(const std::string& topic) {
    const std::lock_guard lock(mutex);
    std::vector<T> messages;
    for (const std::any& message : sent[topic]) messages.push_back(std::any_cast<T>(message));
    return messages;
  }
  template <typename Service>
  typename Service::Response call(const std::string& name,
                                  const typename Service::Request& request) {
    auto response = std::make_shared<typename Service::Response>();
    services.at(name)(std::pair(std::make_shared<typename Service::Request>(request), response));
    return *response;
  }
  void send(const std::string& topic, std::any message) {
    const std::lock_guard lock(mutex);
    sent[topic].push_back(std::move(message));
  }
};

struct rmw_qos_profile_t {
  bool reliable;
};
inline constexpr rmw_qos_profile_t rmw_qos_profile_default{true};
inline constexpr rmw_qos_profile_t rmw_qos_profile_sensor_data{false};

namespace rclcpp {

enum class ParameterType { PARAMETER_BOOL, PARAMETER_INTEGER, PARAMETER_DOUBLE, PARAMETER_STRING };
class ParameterValue {
 public:
  explicit ParameterValue(bool value) : value_(value) {}
  explicit ParameterValue(std::int64_t value) : value_(value) {}
  explicit ParameterValue(double value) : value_(value) {}
  explicit ParameterValue(const std::string& value) : value_(value) {}
  [[nodiscard]] ParameterType get_type() const {
    return static_cast<ParameterType>(value_.index());
  }
  template <typename T>
  [[nodiscard]] const T& get() const {
    return std::get<T>(value_);
  }

 private:
  std::variant<bool, std::int64_t, double, std::string> value_;
};

class NodeOptions {
 public:
  std::map<std::string, ParameterValue> overrides;
};

class QoS {
 public:
  explicit QoS(std::size_t) {}
  QoS& reliable() { return *this; }
  QoS& transient_local() { return *this; }
};
struct SensorDataQoS : QoS {
  SensorDataQoS() : QoS(5) {}
};

class SubscriptionBase {
 public:
  using SharedPtr = std::shared_ptr<SubscriptionBase>;
  virtual ~SubscriptionBase() = default;
};
struct TimerBase {
  using SharedPtr = std::shared_ptr<TimerBase>;
};
template <typename S>
struct Service {
  using SharedPtr = std::shared_ptr<Service>;
};
template <typename T>
class Publisher {
 public:
  using SharedPtr = std::shared_ptr<Publisher>;
  explicit Publisher(std::string topic) : topic_(std::move(topic)) {}
  void publish(const T& message) { Bus::get().send(topic_, message); }
  [[nodiscard]] std::size_t get_subscription_count() const { return 1; }

 private:
  std::string topic_;
};
struct Logger {};
struct Clock {
  using SharedPtr = std::shared_ptr<Clock>;
};

class Node {
 public:
  Node(const std::string& name, const NodeOptions& options) : name_(name), options_(options) {}
  virtual ~Node() = default;
  [[nodiscard]] const char* get_name() const { return name_.c_str(); }
  [[nodiscard]] Logger get_logger() const { return {}; }
  [[nodiscard]] Clock::SharedPtr get_clock() const { return std::make_shared<Clock>(); }
  [[nodiscard]] builtin_interfaces::msg::Time now() const { return {}; }

  const ParameterValue& declare_parameter(const std::string& name, const ParameterValue& value,
                                          const rcl_interfaces::msg::ParameterDescriptor& d) {
    if (!Bus::get().parameters.emplace(name, d).second) {
      throw std::logic_error("parameter " + name + " is declared twice");
    }
    const auto given = options_.overrides.find(name);
    const ParameterValue& used = given != options_.overrides.end() ? given->second : value;
    if (used.get_type() != value.get_type()) throw std::invalid_argument(name + ": wrong type");
    return values_.insert_or_assign(name, used).first->second;
  }
  struct Parameters {
    using SharedPtr = std::shared_ptr<Parameters>;
    [[nodiscard]] const std::map<std::string, ParameterValue>& get_parameter_overrides() const {
      return *overrides;
    }
    const std::map<std::string, ParameterValue>* overrides;
  };
  Parameters::SharedPtr get_node_parameters_interface() {
    return std::make_shared<Parameters>(Parameters{&options_.overrides});
  }
  template <typename T>
  typename Publisher<T>::SharedPtr create_publisher(const std::string& topic, int) {
    return std::make_shared<Publisher<T>>(topic);
  }
  template <typename T, typename F>
  SubscriptionBase::SharedPtr create_subscription(const std::string& topic, const QoS&,
                                                  F callback) {
    Bus::get().handlers[topic].push_back([callback](const std::any& message) {
      callback(std::any_cast<std::shared_ptr<const T>>(message));
    });
    return std::make_shared<SubscriptionBase>();
  }
  template <typename S, typename F>
  typename Service<S>::SharedPtr create_service(const std::string& name, F callback) {
    Bus::get().services[name] = [callback](const std::any& call) {
      using Request = typename S::Request::SharedPtr;
      using Response = typename S::Response::SharedPtr;
      const auto& [request, response] = std::any_cast<const std::pair<Request, Response>&>(call);
      callback(request, response);
    };
    return std::make_shared<Service<S>>();
  }
  template <typename F>
  TimerBase::SharedPtr create_wall_timer(std::chrono::seconds, F callback) {
    Bus::get().timers.push_back(callback);
    return std::make_shared<TimerBase>();
  }

 private:
  std::string name_;
  NodeOptions options_;
  std::map<std::string, ParameterValue> values_;
};

inline void init(int, char**) {}
inline void spin(const std::shared_ptr<Node>&) {}
inline void shutdown() {}

}  // namespace rclcpp

template <typename... Args>
void substitute_log(const char* level, const char* format, Args... args) {
  char text[1000];
  std::snprintf(text, sizeof text, format, args...);
  const std::lock_guard lock(Bus::get().mutex);
  Bus::get().log.push_back(std::string(level) + text);
}
#define RCLCPP_INFO(logger, ...) ((void)(logger), substitute_log("INFO ", __VA_ARGS__))
#define RCLCPP_WARN(logger, ...) ((void)(logger), substitute_log("WARN ", __VA_ARGS__))
#define RCLCPP_ERROR(logger, ...) ((void)(logger), substitute_log("ERROR ", __VA_ARGS__))
#define RCLCPP_COMPONENTS_REGISTER_NODE(Class)

namespace tf2 {
using TimePoint = std::chrono::time_point<std::chrono::system_clock, std::chrono::nanoseconds>;
inline constexpr TimePoint TimePointZero{};
struct TransformException : std::runtime_error {
  using std::runtime_error::runtime_error;
};
}  // namespace tf2

namespace tf2_ros {
/// Knows what was sent to Bus::transforms, of neighbours alone.
struct Buffer {
  explicit Buffer(const rclcpp::Clock::SharedPtr&) {}
  [[nodiscard]] geometry_msgs::msg::TransformStamped lookupTransform(const std::string& target,
                                                                     const std::string& source,
                                                                     const tf2::TimePoint&) const {
    const std::lock_guard lock(Bus::get().mutex);
    for (const auto& t : Bus::get().transforms) {
      if (t.header.frame_id == target && t.child_frame_id == source) return t;
    }
    throw tf2::TransformException('"' + target + "\" passed to lookupTransform does not exist.");
  }
};
struct TransformListener {
  explicit TransformListener(Buffer&) {}
};
struct TransformBroadcaster {
  explicit TransformBroadcaster(rclcpp::Node&) {}
  void sendTransform(const std::vector<geometry_msgs::msg::TransformStamped>& transforms) {
    for (const auto& t : transforms) Bus::get().send("/tf", t);
  }
};
struct StaticTransformBroadcaster {
  explicit StaticTransformBroadcaster(rclcpp::Node&) {}
  void sendTransform(const geometry_msgs::msg::TransformStamped& t) {
    Bus::get().send("/tf_static", t);
  }
};
}  // namespace tf2_ros

namespace image_transport {
struct Subscriber {};
inline Subscriber create_subscription(
    rclcpp::Node*, const std::string& topic,
    const std::function<void(const sensor_msgs::msg::Image::ConstSharedPtr&)>& callback,
    const std::string& transport, rmw_qos_profile_t) {
  Bus::get().transports[topic] = transport;
  Bus::get().handlers[topic].push_back([callback](const std::any& message) {
    callback(std::any_cast<std::shared_ptr<const sensor_msgs::msg::Image>>(message));
  });
  return {};
}
}  // namespace image_transport
