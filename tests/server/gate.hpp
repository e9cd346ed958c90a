#pragma once

#include <algorithm>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <stdexcept>
#include <string>

#include "server/kinds/kind.hpp"

namespace server {

// While it lives and until it is opened, whoever makes a trajectory of that kind waits in its constructor.
class Gate {
 public:
  explicit Gate(const std::string& kind)
      : kind_(*std::find_if(trajectories().begin(), trajectories().end(), [&](const auto& each) { return each.name == kind; })) {
    make_ = kind_.make;
    kind_.make = [this](const google::protobuf::Any& any, const realtime::Arm& arm) {
      std::unique_lock lock(mutex_);
      ++waiting_;
      changed_.notify_all();
      changed_.wait(lock, [this] { return open_; });
      return make_(any, arm);
    };
  }
  ~Gate() {
    open();
    kind_.make = make_;
  }

  // Until so many have come.
  void wait_for(int count) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return waiting_ >= count; });
  }
  void open() {
    const std::lock_guard lock(mutex_);
    open_ = true;
    changed_.notify_all();
  }

 private:
  Kind<realtime::TrajectoryGenerator>& kind_;
  std::function<std::unique_ptr<realtime::TrajectoryGenerator>(const google::protobuf::Any&, const realtime::Arm&)> make_;
  std::mutex mutex_;
  std::condition_variable changed_;
  int waiting_ = 0;
  bool open_ = false;
};

}  // namespace server
