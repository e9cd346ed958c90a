#include "server/realtime_setup.hpp"

#include <pthread.h>
#include <sched.h>
#include <spdlog/fmt/fmt.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/utsname.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <sstream>

namespace server {
namespace {

// Above interrupt threads of a PREEMPT_RT kernel (50), below its own watchdogs (99).
constexpr int kPriority = 80;
constexpr std::size_t kStack = 128 << 10;  // bytes that are touched
constexpr std::size_t kRoom = 64 << 20;    // bytes that must remain to be had once memory is locked

std::string first_line(const std::string& path) {
  std::ifstream file(path);
  std::string line;
  std::getline(file, line);
  return line;
}

void look_at_kernel(RealtimeReport& report) {
  utsname name{};
  uname(&name);
  const bool preempt_rt = first_line("/sys/kernel/realtime") == "1" ||
                          std::strstr(name.version, "PREEMPT_RT") != nullptr ||
                          std::strstr(name.version, "PREEMPT RT") != nullptr;
  report.kernel = fmt::format("{}{}", name.release, preempt_rt ? ", PREEMPT_RT" : ", no PREEMPT_RT");
  if (!preempt_rt) {
    report.deficiencies.push_back(
        fmt::format("kernel {} is not PREEMPT_RT: cycles come late when the computer is busy, and a real arm then stops "
                    "with communication_constraints_violation. Remedy: Debian: apt install linux-image-rt-amd64; Ubuntu: "
                    "pro enable realtime-kernel; then reboot into it",
                    name.release));
  }
  const std::string governor = first_line("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor");
  if (!governor.empty() && governor != "performance") {
    report.deficiencies.push_back(
        fmt::format("processor clock: governor is \"{}\". Remedy: cpupower frequency-set -g performance", governor));
  }
}

void lock_memory(RealtimeReport& report) {
  std::string why;
  if (mlockall(MCL_CURRENT | MCL_FUTURE) != 0) {
    why = std::strerror(errno);
  } else {
    // Below a limit (ulimit -l), locking what comes later makes allocations fail: rather not, then.
    void* room = mmap(nullptr, kRoom, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (room == MAP_FAILED) {
      munlockall();
      why = "the limit is too low";
    } else {
      munmap(room, kRoom);
    }
  }
  report.memory = why.empty() ? "locked" : "not locked";
  if (why.empty()) return;
  rlimit limit{};
  getrlimit(RLIMIT_MEMLOCK, &limit);
  report.deficiencies.push_back(
      fmt::format("memory is not locked ({}; limit {} KiB): a page that was swapped out costs cycles. Remedy: the line "
                  "\"<user> - memlock unlimited\" in /etc/security/limits.conf, then log in again",
                  why, limit.rlim_cur >> 10));
}

void prefault_stack() {
  char stack[kStack];
  for (std::size_t i = 0; i < kStack; i += 4096) static_cast<volatile char*>(stack)[i] = 0;
}

std::string pin(int index, std::optional<int> processor, RealtimeReport& report) {
  const auto isolated = parse_cpu_list(first_line("/sys/devices/system/cpu/isolated"));
  if (isolated.empty() && !processor) return "";
  const int cpu = processor ? *processor : isolated[index % isolated.size()];
  cpu_set_t set;
  CPU_ZERO(&set);
  CPU_SET(cpu, &set);
  if (pthread_setaffinity_np(pthread_self(), sizeof set, &set) != 0) {
    report.deficiencies.push_back(fmt::format("processor {} cannot be used: the loop runs on any. Remedy: name one of {} "
                                              "in the configuration",
                                              cpu, first_line("/sys/devices/system/cpu/online")));
    return "";
  }
  const bool alone = std::find(isolated.begin(), isolated.end(), cpu) != isolated.end();
  return fmt::format(", {}processor {}", alone ? "isolated " : "", cpu);
}

}  // namespace

std::vector<int> parse_cpu_list(const std::string& text) {
  std::vector<int> cpus;
  std::istringstream parts(text);
  for (std::string part; std::getline(parts, part, ',');) {
    int first = 0, last = 0;
    const int read = std::sscanf(part.c_str(), "%d-%d", &first, &last);
    if (read < 1) continue;
    if (read == 1) last = first;
    for (int cpu = first; cpu <= last && cpu < CPU_SETSIZE; ++cpu) cpus.push_back(cpu);
  }
  return cpus;
}

RealtimeReport prepare_process() {
  RealtimeReport report;
  look_at_kernel(report);
  lock_memory(report);
  return report;
}

void prepare_thread(int index, std::optional<int> processor, bool realtime, RealtimeReport& report) {
  prefault_stack();
  if (!realtime) {
    report.scheduling = "normal, for an arm in lockstep" + pin(index, processor, report);
    return;
  }
  const sched_param parameters{.sched_priority = kPriority};
  const int error = pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameters);
  report.scheduling = error == 0 ? fmt::format("SCHED_FIFO {}", kPriority) : "normal, not real-time";
  report.scheduling += pin(index, processor, report);
  if (error != 0) {
    report.deficiencies.push_back(
        fmt::format("SCHED_FIFO is refused ({}): other programs delay the loop. Remedy: the line \"<user> - rtprio 99\" in "
                    "/etc/security/limits.conf, then log in again",
                    std::strerror(error)));
  }
}

// Of Linux these are of a thread, where POSIX has the process.
Preferred::Preferred() : nice_(getpriority(PRIO_PROCESS, 0)) { setpriority(PRIO_PROCESS, 0, -10); }
Preferred::~Preferred() { setpriority(PRIO_PROCESS, 0, nice_); }

}  // namespace server
