// How regularly fci-sim sends its states, by the kernel's time stamps of their datagrams, beside a bare loop that does
// nothing but send one at each of its absolute deadlines, at the same time. 60 s.
//   sim_period_jitter_vs_timer_p50   median deviation of the period from 1 ms, over that of the bare loop; the median of
//                                    ten windows
//   sim_rate_hz                      over the quietest 10 s: those in which it was least off, begun on time
//   sim_states_skipped               numbers that are missing between the first state and the last

#include <fcntl.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <thread>
#include <vector>

#include "bench/fci_client.hpp"
#include "sim/clock.hpp"
#include "tests/child.hpp"

namespace {

constexpr std::int64_t kSecond = 1'000'000'000;  // ns
constexpr int kSeconds = 60, kWindows = 10, kQuiet = 10;

struct Datagrams {
  std::vector<std::int64_t> times;  // ns
  std::vector<std::uint64_t> numbers;
};

// Everything that comes to a socket until `end` (ns, WallClock), by when it came.
Datagrams collect(int socket, std::int64_t end) {
  const int on = 1, room = 1 << 24;
  const timeval patience{0, 100'000};
  ::setsockopt(socket, SOL_SOCKET, SO_TIMESTAMPNS, &on, sizeof on);
  ::setsockopt(socket, SOL_SOCKET, SO_RCVBUF, &room, sizeof room);
  ::setsockopt(socket, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  Datagrams all;
  while (sim::WallClock().now() < end) {
    std::uint64_t number = 0;
    alignas(cmsghdr) char control[256];
    iovec data{&number, sizeof number};
    msghdr message{};
    message.msg_iov = &data;
    message.msg_iovlen = 1;
    message.msg_control = control;
    message.msg_controllen = sizeof control;
    if (::recvmsg(socket, &message, 0) < static_cast<ssize_t>(sizeof number)) continue;
    for (cmsghdr* c = CMSG_FIRSTHDR(&message); c != nullptr; c = CMSG_NXTHDR(&message, c)) {
      if (c->cmsg_level != SOL_SOCKET || c->cmsg_type != SCM_TIMESTAMPNS) continue;
      timespec time;
      std::memcpy(&time, CMSG_DATA(c), sizeof time);
      all.times.push_back(time.tv_sec * kSecond + time.tv_nsec);
      all.numbers.push_back(number);
    }
  }
  return all;
}

// Another process: it has nothing in common with the arm but the computer.
pid_t start_timer(const sockaddr_in& to) {
  const pid_t child = testing_tools::fork_child();
  if (child != 0) return child;
  ::prctl(PR_SET_TIMERSLACK, 1);
  const int socket = ::socket(AF_INET, SOCK_DGRAM, 0);
  ::connect(socket, reinterpret_cast<const sockaddr*>(&to), sizeof to);
  std::array<char, 1377> datagram{};  // as long as a state
  std::int64_t deadline = sim::WallClock().now();
  for (std::uint64_t number = 0;; ++number) {
    deadline += kSecond / 1000;
    const timespec until{deadline / kSecond, deadline % kSecond};
    ::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr);
    std::memcpy(datagram.data(), &number, sizeof number);
    ::send(socket, datagram.data(), datagram.size(), MSG_DONTWAIT);
  }
}

pid_t start_arm(const std::string& address) {
  const pid_t child = testing_tools::fork_child();
  if (child != 0) return child;
  ::dup2(::open("/dev/null", O_WRONLY), 1);
  ::execl(BIN_DIR "/fci-sim", "fci-sim", "--listen", address.c_str(), nullptr);
  ::_exit(127);
}

// Of the datagrams that came from `begin` to `end`: median deviation of what lies between two from 1 ms, ns.
double deviation(const Datagrams& all, std::int64_t begin, std::int64_t end) {
  std::vector<double> off;
  for (std::size_t i = 1; i < all.times.size(); ++i) {
    if (all.times[i - 1] < begin || all.times[i] >= end) continue;
    off.push_back(std::abs(static_cast<double>(all.times[i] - all.times[i - 1]) - 1e6));
  }
  std::nth_element(off.begin(), off.begin() + static_cast<std::ptrdiff_t>(off.size() / 2), off.end());
  return off[off.size() / 2];
}

// The `seconds` in which the periods were least off, in all: their begin, ns. Not while an earlier stall is being made up for.
std::int64_t quietest(const Datagrams& all, int seconds) {
  constexpr std::size_t kMakingUp = 500;  // cycles after a stall
  constexpr double kStall = 1.5e6;        // ns
  const std::size_t n = static_cast<std::size_t>(1000 * seconds);
  std::vector<double> off(all.times.size());  // sums
  std::vector<std::size_t> stall(all.times.size());  // the last one before
  for (std::size_t i = 1; i < all.times.size(); ++i) {
    const double period = static_cast<double>(all.times[i] - all.times[i - 1]);
    off[i] = off[i - 1] + std::abs(period - 1e6);
    stall[i] = period > kStall ? i : stall[i - 1];
  }
  std::size_t best = 0;
  bool found = false;
  for (std::size_t i = 0; i + n < off.size(); ++i) {
    const bool on_time = stall[i] == 0 || stall[i] + kMakingUp < i;
    if (found && !on_time) continue;
    if ((on_time && !found) || off[i + n] - off[i] < off[best + n] - off[best]) best = i;
    found |= on_time;
  }
  return all.times[best];
}

// Hz.
double rate(const Datagrams& all, std::int64_t begin, std::int64_t end) {
  const auto first = std::lower_bound(all.times.begin(), all.times.end(), begin);
  const auto last = std::lower_bound(first, all.times.end(), end) - 1;
  return 1e9 * static_cast<double>(last - first) / static_cast<double>(*last - *first);
}

}  // namespace

int main() {
  const std::string address = bench::some_address();
  const pid_t arm = start_arm(address);
  bench::FciClient client(address);
  sockaddr_in own{};
  own.sin_family = AF_INET;
  ::inet_pton(AF_INET, address.c_str(), &own.sin_addr);
  const int plain = ::socket(AF_INET, SOCK_DGRAM, 0);
  ::bind(plain, reinterpret_cast<sockaddr*>(&own), sizeof own);
  socklen_t size = sizeof own;
  ::getsockname(plain, reinterpret_cast<sockaddr*>(&own), &size);
  const pid_t timer = start_timer(own);

  const std::int64_t end = sim::WallClock().now() + (kSeconds + 1) * kSecond;
  Datagrams bare;
  std::thread other([&] { bare = collect(plain, end); });
  const Datagrams states = collect(client.udp(), end);
  other.join();
  for (pid_t child : {arm, timer}) {
    ::kill(child, SIGKILL);
    ::waitpid(child, nullptr, 0);
  }
  if (states.times.size() < 1000 * kQuiet + 1 || bare.times.size() < 1000 * kQuiet + 1) {
    std::fprintf(stderr, "only %zu states and %zu ticks came in %d s\n", states.times.size(), bare.times.size(), kSeconds);
    return 1;
  }
  const std::int64_t begin = std::max(states.times.front(), bare.times.front()) + kSecond / 10;
  std::vector<double> ratios;
  for (int i = 0; i < kWindows; ++i) {
    const std::int64_t from = begin + i * kSeconds / kWindows * kSecond, to = from + kSeconds / kWindows * kSecond;
    const double ours = deviation(states, from, to), timer_alone = deviation(bare, from, to);
    std::fprintf(stderr, "%.1f us beside %.1f us\n", 1e-3 * ours, 1e-3 * timer_alone);
    ratios.push_back(ours / timer_alone);
  }
  std::sort(ratios.begin(), ratios.end());
  const std::int64_t quiet = quietest(states, kQuiet);
  const std::uint64_t expected = states.numbers.back() - states.numbers.front() + 1;
  std::printf("{\"sim_period_jitter_vs_timer_p50\": %.3f, \"sim_rate_hz\": %.3f, \"sim_states_skipped\": %.0f}\n",
              0.5 * (ratios[kWindows / 2 - 1] + ratios[kWindows / 2]), rate(states, quiet, quiet + kQuiet * kSecond),
              static_cast<double>(expected - states.numbers.size()));
}
