#pragma once

#include <signal.h>
#include <sys/prctl.h>
#include <unistd.h>

namespace testing_tools {

// fork(); the child is killed when the thread that calls has ended, however.
inline pid_t fork_child() {
  const pid_t parent = ::getpid();
  const pid_t child = ::fork();
  if (child == 0) {
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (::getppid() != parent) ::_exit(127);  // it has ended already
  }
  return child;
}

}  // namespace testing_tools
