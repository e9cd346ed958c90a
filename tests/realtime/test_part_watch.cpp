#include "realtime/part_watch.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <thread>

namespace realtime {
namespace {

using std::chrono::microseconds;

TEST(PartWatch, APartThatWaitsIsAtFaultAlthoughItUsesNoTime) {
  PartWatch watch({});
  for (int k = 0; k < PartWatch::kWindow && !watch.at_fault(); ++k) {
    watch.step(PartWatch::kController, 7, [] { return std::this_thread::sleep_for(microseconds(500)), true; });
  }
  EXPECT_EQ(watch.fault().why, PartFault::Why::kTooLong);
  EXPECT_EQ(watch.fault().part, 7);
  EXPECT_TRUE(watch.at_fault(PartWatch::kController));
  EXPECT_FALSE(watch.at_fault(PartWatch::kTrajectory));
}

TEST(PartWatch, OneLongStepIsNoFault) {
  PartWatch watch({});
  for (int k = 0; k < 200; ++k) {
    watch.step(PartWatch::kController, 7, [k] {
      if (k == 20) std::this_thread::sleep_for(microseconds(3000));
      return true;
    });
  }
  EXPECT_FALSE(watch.at_fault());
  EXPECT_GE(watch.longest().ns, 3'000'000);
}

TEST(PartWatch, AStartThatTakesLongIsRememberedByItsPart) {
  PartWatch watch({});
  watch.start(PartWatch::kTrajectory, 3, [] { std::this_thread::sleep_for(microseconds(5000)); });
  watch.step(PartWatch::kController, 7, [] { return true; });
  EXPECT_FALSE(watch.at_fault());
  EXPECT_EQ(watch.longest().part, 3);
  EXPECT_GE(watch.longest().ns, 5'000'000);
}

}  // namespace
}  // namespace realtime
