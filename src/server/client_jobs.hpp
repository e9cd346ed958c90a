#pragma once

#include <functional>
#include <set>
#include <string>

#include "server/answers.hpp"
#include "server/workbench.hpp"

namespace server {

// What takes long for a client, on a workbench: one job of each at a time.
class ClientJobs {
 public:
  explicit ClientJobs(Answers& answers) : answers_(answers) {}

  // `work` there, and if it does not throw `done` in take_finished(); what either throws is answered. Throws Refused where there
  // are too many.
  void put(const Address& from, std::function<void()> work, std::function<void()> done);
  void take_finished() { workbench_.take_finished(); }

  // Readable when there is one that is finished: for poll().
  int fd() const { return workbench_.fd(); }
  const Workbench& workbench() const { return workbench_; }

 private:
  Answers& answers_;
  std::set<std::string> at_work_;  // identities of clients
  Workbench workbench_;            // goes first, as its jobs use the rest
};

}  // namespace server
