#include <gtest/gtest.h>

#include <random>

#include "server/clock_estimate.hpp"

namespace server {
namespace {

constexpr std::int64_t kMs = 1'000'000, kSecond = 1000 * kMs, kStart = 1'700'000'000 * kSecond;

// A sender whose clock is ahead, over a way of 3 ms and more.
class ClockEstimateTest : public testing::Test {
 protected:
  static constexpr std::int64_t kWay = 3 * kMs;

  ClockEstimate::Way send(std::int64_t longer = 0) {
    now_ += 10 * kMs;
    drift_ += static_cast<std::int64_t>(1e-4 * 10 * kMs);  // 100 ppm
    return estimate_.take(now_ + ahead_ + drift_, now_ + kWay + longer, kWay);
  }
  std::int64_t wrong() const { return std::abs(estimate_.ahead_ns() - ahead_ - drift_); }

  ClockEstimate estimate_;
  std::int64_t now_ = kStart, ahead_ = 7 * kSecond, drift_ = 0;
};

TEST_F(ClockEstimateTest, IsThatOfTheQuickestMessagesAndFollowsAClockThatDrifts) {
  std::mt19937 random(1);
  std::exponential_distribution<double> longer(1.0 / (20 * kMs));
  for (int i = 0; i < 100'000; ++i) {
    send(static_cast<std::int64_t>(longer(random)));
    if (i > 1000) {
      ASSERT_LT(wrong(), 3 * kMs) << i;
    }
  }
}

TEST_F(ClockEstimateTest, SaysHowMuchLongerAMessageTook) {
  for (int i = 0; i < 100; ++i) send();
  EXPECT_NEAR(static_cast<double>(send(300 * kMs).longer), 300 * kMs, 0.1 * kMs);
  EXPECT_NEAR(static_cast<double>(send().longer), 0, 0.1 * kMs);
}

TEST_F(ClockEstimateTest, BelievesAClockThatWasSet) {
  for (int i = 0; i < 10; ++i) send();
  ahead_ -= 3600 * kSecond;
  EXPECT_EQ(send().longer, 0);
  EXPECT_LT(wrong(), kMs);
  ahead_ += 7200 * kSecond;
  for (int i = 0; i < 10; ++i) EXPECT_NEAR(static_cast<double>(send().in_future), 7200 * kSecond, kMs);
  EXPECT_EQ(send().in_future, 0);
  EXPECT_LT(wrong(), kMs);
}

TEST_F(ClockEstimateTest, OneTimeFromTheFutureIsNotBelieved) {
  for (int i = 0; i < 10; ++i) {
    send();
    EXPECT_GT(estimate_.take(now_ + ahead_ + 60 * kSecond, now_, kWay).in_future, 59 * kSecond);
    EXPECT_LT(wrong(), kMs);
  }
}

TEST_F(ClockEstimateTest, IsToldOnceASecond) {
  int told = 0;
  for (int i = 0; i < 1000; ++i) {
    send();
    told += estimate_.is_due(now_);
  }
  EXPECT_EQ(told, 10);
}

}  // namespace
}  // namespace server
