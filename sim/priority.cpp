#include "sim/priority.hpp"

#include <sched.h>

#include <cerrno>
#include <cstring>

namespace sim {

std::string take_priority() {
  const int highest = ::sched_get_priority_max(SCHED_FIFO);
  const sched_param parameters{.sched_priority = highest};
  // Threads that this one makes are ordinary ones.
  if (::sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &parameters) == 0) {
    return "priority " + std::to_string(highest);
  }
  return std::string("no real-time priority (") + std::strerror(errno) +
         "): clients that have one make it late; to give it one, put \"<user> - rtprio 99\" into "
         "/etc/security/limits.conf and log in again";
}

}  // namespace sim
