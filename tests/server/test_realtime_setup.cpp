#include <gtest/gtest.h>
#include <sys/mman.h>

#include <thread>

#include "server/realtime_setup.hpp"

namespace server {
namespace {

TEST(RealtimeSetup, ReadsTheKernelsListsOfProcessors) {
  EXPECT_EQ(parse_cpu_list(""), std::vector<int>());
  EXPECT_EQ(parse_cpu_list("3"), std::vector<int>({3}));
  EXPECT_EQ(parse_cpu_list("2-4,7"), std::vector<int>({2, 3, 4, 7}));
  EXPECT_EQ(parse_cpu_list("x,1-"), std::vector<int>({1}));
}

TEST(RealtimeSetup, WhateverIsLessThanItShouldBeComesWithItsRemedy) {
  RealtimeReport report = prepare_process();
  std::thread([&] { prepare_thread(0, {}, true, report); }).join();
  munlockall();
  const auto told = [&](const std::string& what) {
    for (const auto& each : report.deficiencies) {
      if (each.find(what) != std::string::npos) return true;
    }
    return false;
  };
  EXPECT_NE(report.kernel.find("PREEMPT_RT"), std::string::npos);
  EXPECT_EQ(told("is not PREEMPT_RT"), report.kernel.find("no PREEMPT_RT") != std::string::npos);
  EXPECT_EQ(told("memory is not locked"), report.memory != "locked");
  EXPECT_EQ(told("SCHED_FIFO is refused"), !report.scheduling.starts_with("SCHED_FIFO"));
  for (const auto& each : report.deficiencies) EXPECT_NE(each.find("Remedy: "), std::string::npos) << each;
}

}  // namespace
}  // namespace server
