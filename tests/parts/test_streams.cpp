#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "realtime/joint_range.hpp"
#include "realtime/sensor_input.hpp"
#include "realtime/trajectories/stream_velocity.hpp"
#include "realtime/trajectories/target_stream.hpp"
#include "realtime/trajectories/velocity_stream.hpp"
#include "tests/realtime/allocation_counter.hpp"
#include "tests/realtime/simulated_arm.hpp"

namespace realtime {
namespace {

using Stream = TargetStream<2>;
using Vector = Stream::Vector;

constexpr double kTick = 0.001;  // s
constexpr double kNoClock = std::numeric_limits<double>::quiet_NaN();
constexpr std::array<models::Limits::Rates, 2> kRates = {{{1.5, 6, 300}, {1.5, 6, 300}}};

Vector wave(double t) { return {0.1 * std::sin(2 * t), 0.08 * std::sin(3 * t)}; }

struct Watched {
  double most_v = 0, most_a = 0, most_error = 0;
};

// Backward differences of what comes out, and how far it is from the wave `delay` before.
struct Watch {
  double delay;
  std::vector<Vector> x;
  double from = 0.5;

  Watched judge() const {
    Watched all;
    for (std::size_t i = 2; i < x.size(); ++i) {
      const Vector v = (x[i] - x[i - 1]) / kTick, a = (x[i] - 2 * x[i - 1] + x[i - 2]) / (kTick * kTick);
      all.most_v = std::max(all.most_v, v.cwiseAbs().maxCoeff());
      all.most_a = std::max(all.most_a, a.cwiseAbs().maxCoeff());
      const double t = static_cast<double>(i) * kTick;
      if (t > from) all.most_error = std::max(all.most_error, (x[i] - wave(t - delay)).cwiseAbs().maxCoeff());
    }
    return all;
  }
};

TEST(TargetStream, PassesTargetsOfASmoothMotionAfterTheDelay) {
  Stream stream(0.15, 0, kRates);
  stream.start({});
  Watch watch{0.15, {}, 1.0};
  for (int i = 0; i < 4000; ++i) {
    const double t = i * kTick;
    if (i % 50 == 0) stream.add(t, {wave(t), t, 0, false});
    watch.x.push_back(stream.at(t, t).x);
  }
  EXPECT_LT(watch.judge().most_error, 5e-4);
}

TEST(TargetStream, TheLongestDelayIsKeptAtTheHighestRate) {
  Stream stream(1.0, 0, kRates);
  stream.start({});
  Watch watch{1.0, {}, 2.0};
  for (int i = 0; i < 5000; ++i) {
    const double t = i * kTick;
    stream.add(t, {wave(t), t, 0, false});
    watch.x.push_back(stream.at(t, t).x);
  }
  EXPECT_LT(watch.judge().most_error, 1e-5);
}

TEST(TargetStream, OfTargetsInOneCycleTheLastIsGoneTo) {
  Stream flooded(0, 0, kRates), calm(0, 0, kRates);
  flooded.start({});
  calm.start({});
  for (int i = 0; i < 1000; ++i) {
    const double t = i * kTick;
    for (int k = 100; k > 0; --k) flooded.add(t, {wave(t) + k * Vector(0.01, -0.01), t, 0, false});
    flooded.add(t, {wave(t), t, 0, false});
    calm.add(t, {wave(t), t, 0, false});
    ASSERT_EQ(flooded.at(t, t).x, calm.at(t, t).x) << i;
  }
}

// Each of 200 targets in 2 s, as long as there may be.
TEST(TargetStream, ChunksThatExtendEachOtherAreAllPassed) {
  Stream stream(std::nullopt, 0, kRates);
  stream.start({});
  Watch watch{0, {}, 0.5};
  for (int i = 0; i < 5500; ++i) {
    const double t = i * kTick;
    for (int k = 1; i < 3 && k <= 200; ++k) {
      const double lead = 2.0 * i + 0.01 * k;
      stream.add(t, {wave(lead), 0, lead, false});
    }
    watch.x.push_back(stream.at(t, t).x);
  }
  EXPECT_LT(watch.judge().most_error, 5e-4);
}

TEST(TargetStream, IsSmoothWhateverTheNetworkDoes) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> jitter(-0.3, 0.3), way(0, 0.03), lost(0, 1);
  for (const double period : {0.2, 0.1, 0.05, 0.02, 0.01}) {
    Stream stream(std::nullopt, 0, kRates);
    stream.start({});
    struct Message {
      double arrives, sent;
    };
    std::vector<Message> messages;
    for (double sent = 0.2; sent < 8; sent += period * (1 + jitter(random))) {
      if (lost(random) > 0.1) messages.push_back({sent + way(random) * period / 0.05, sent});
    }
    std::vector<Vector> x;
    std::size_t next = 0;
    for (int i = 0; i < 8000; ++i) {
      const double t = i * kTick;
      for (; next < messages.size() && messages[next].arrives <= t; ++next) {
        // The publisher's clock is another.
        stream.add(t, {wave(messages[next].sent), messages[next].sent + 1e5, 0, false});
      }
      x.push_back(stream.at(t, t).x);
    }
    Watch watch{0, x, 100};
    const Watched seen = watch.judge();
    // The wave itself has 0.24 m/s and 0.72 m/s².
    EXPECT_LT(seen.most_v, 0.6) << period;
    EXPECT_LT(seen.most_a, 18) << period;  // at the start and where targets come back; the limiter rounds it
    // It follows the wave, so much later as is best.
    double least = 1;
    for (double delay = 0; delay < 0.8; delay += 0.005) {
      double worst = 0;
      for (std::size_t i = 2000; i < x.size(); ++i) {
        worst = std::max(worst, (x[i] - wave(static_cast<double>(i) * kTick - delay)).cwiseAbs().maxCoeff());
      }
      least = std::min(least, worst);
    }
    EXPECT_LT(least, 0.006 + 0.15 * period) << period;
  }
}

TEST(TargetStream, RestsAtTheLastWhereTargetsCeaseAndComesBackSmoothly) {
  Stream stream(0.05, 0, kRates);
  stream.start({});
  std::vector<Vector> x;
  for (int i = 0; i < 6000; ++i) {
    const double t = i * kTick;
    const bool silent = t > 1.5 && t < 3;
    if (i % 20 == 0 && !silent) stream.add(t, {wave(t), t, 0, false});
    x.push_back(stream.at(t, t).x);
  }
  EXPECT_LT((x[2990] - wave(1.5)).norm(), 1e-8);
  const Watched seen = Watch{0, x, 100}.judge();
  EXPECT_LT(seen.most_a, 12);
  EXPECT_LT((x[5000] - wave(5.0 - 0.05)).norm(), 2e-3);
}

TEST(TargetStream, BrakesUntilTheFirstTargetWhereItBeginsInMotion) {
  Stream stream(std::nullopt, 0, kRates);
  stream.start({Vector::Zero(), Vector(0.3, 0), Vector::Zero()});
  std::vector<Vector> x;
  for (int i = 1; i < 1000; ++i) x.push_back(stream.at(i * kTick, i * kTick).x);
  EXPECT_NEAR(x.front()[0], 0.3 * kTick, 1e-6);
  EXPECT_LT(Watch({0, x, 100}).judge().most_a, 6 * 1.01);
  EXPECT_GT(x.back()[0], 0.3 * 0.3 / (2 * 6));
  EXPECT_LT((x.back() - x[900]).norm(), 1e-9);
}

// A publisher, or the network, stands still and then sends all that it had in a heap, in `within` s.
TEST(TargetStream, TargetsInAHeapAreNoFastMotion) {
  for (const double within : {0.0, 0.002, 0.01, 0.04, 0.1, 0.2, 0.3}) {
    for (const std::optional<double> delay : {std::optional<double>(), std::optional(0.04)}) {
      Stream stream(delay, 0, kRates);
      stream.start({});
      std::vector<Vector> x;
      int sent = 0;  // messages, one each 20 ms, of an even motion of 0.3 m/s
      const auto arrives = [&](int i) { return i < 50 ? 0.02 * i : i < 100 ? 2 + within * (i - 50) / 50 : 4e9; };
      for (int i = 0; i < 4000; ++i) {
        const double t = i * kTick;
        for (; arrives(sent) <= t; ++sent) stream.add(t, {Vector(0.3, -0.2) * 0.02 * sent, 0.02 * sent, 0, false});
        x.push_back(stream.at(t, t).x);
      }
      const Vector last = Vector(0.3, -0.2) * 0.02 * 99;
      double beyond = 0;
      for (const Vector& at : x) beyond = std::max({beyond, at[0] - last[0], last[1] - at[1]});
      EXPECT_LT(beyond, 0.012) << within;  // 0.3 m/s come to rest within 10 mm inside the rates
      EXPECT_LT((x.back() - last).norm(), 1e-8) << within;
      EXPECT_LT(Watch({0, x, 100}).judge().most_a, 6 * 1.75) << within;
    }
  }
}

// The arm's time goes faster or slower than the publisher's, unevenly: a simulated arm that does not keep real time.
TEST(TargetStream, HoweverFastTheArmsTimeGoesTheMotionStaysAmongTargets) {
  constexpr std::array<models::Limits::Rates, 2> slow = {{{0.34, 2.6, 2000}, {0.34, 2.6, 2000}}};
  for (const double rate : {0.3, 0.7, 1.0, 1.5, 2.0, 3.0, 4.7, 8.0, 15.0, 28.0}) {
    for (unsigned seed = 0; seed < 10; ++seed) {
      std::mt19937 random(seed);
      std::uniform_real_distribution<double> uneven(0.5, 1.5);
      Stream stream(std::nullopt, 0, slow);
      stream.start({});
      double publisher = 0;
      int sent = 0;
      for (double t = 0; sent < 150; t += kTick) {
        publisher += kTick / rate * uneven(random) * (static_cast<int>(publisher / 0.1) % 2 ? 0.6 : 1.4);
        const auto circle = [](double angle) { return Vector(0.05 * std::sin(angle), 0.05 * std::cos(angle) - 0.05); };
        for (; 0.022 * sent <= publisher; ++sent) stream.add(t, {circle(0.063 * sent), 0.022 * sent, 0, false});
        const Vector x = stream.at(t, t).x;
        ASSERT_LT((x - Vector(0, -0.05)).norm(), 0.05 + 0.02) << "at " << t << " s, rate " << rate << ", seed " << seed;
      }
    }
  }
}

TEST(TargetStream, AJumpIsGoneToInsideTheRates) {
  for (const std::optional<double> delay : {std::optional(0.0), std::optional(0.1)}) {
    Stream stream(delay, 0, kRates);
    stream.start({});
    std::vector<Vector> x;
    for (int i = 0; i < 4000; ++i) {
      const double t = i * kTick;
      if (i % 50 == 0) stream.add(t, {t < 1 ? Vector(0, 0) : Vector(1, -0.5), t, 0, false});
      x.push_back(stream.at(t, t).x);
    }
    const Watched seen = Watch{0, x, 100}.judge();
    EXPECT_LT(seen.most_v, 1.5 * 1.02);
    EXPECT_LT(seen.most_a, 6 * 1.1);
    EXPECT_LT((x.back() - Vector(1, -0.5)).norm(), 1e-6);
  }
}

// Messages that take longer and longer than at first: by `late` s from 2 s on, for 3 s; or the arm's time that leaps, as when
// its computer stood still, so that all that comes is late.
TEST(TargetStream, HoweverLateTargetsAreTheMotionStaysAmongThem) {
  for (const double late : {0.05, 0.1, 0.3, 1.0}) {
    for (const double leap : {0.0, 0.7}) {
      Stream stream(std::nullopt, 0, kRates);
      stream.start({});
      std::vector<Vector> x;
      int sent = 0;  // messages, one each 20 ms
      for (int i = 0; i < 9000; ++i) {
        const double t = i * kTick;
        const double publisher = t < 2 ? t : t - leap;
        const auto arrives = [&](double time) { return time + (time > 2 && time < 5 ? late : 0); };
        for (; arrives(0.02 * sent) <= publisher && !(t > 2 && t < 2 + leap); ++sent) {
          stream.add(t, {wave(0.02 * sent), 0.02 * sent, 0, false});
        }
        x.push_back(stream.at(t, t).x);
        ASSERT_LT(x.back()[0], 0.13) << late << " s, " << leap << " s, at " << t;
        ASSERT_GT(x.back()[0], -0.13) << late << " s, " << leap << " s, at " << t;
      }
      const Watched seen = Watch{0, x, 100}.judge();
      EXPECT_LT(seen.most_v, 0.9);
      EXPECT_LT(seen.most_a, 12);
      // When they come in time again it follows as before.
      double least = 1;
      for (double delay = 0; delay < 0.2; delay += 0.005) least = std::min(least, (x.back() - wave(9 - leap - delay)).norm());
      EXPECT_LT(least, 0.01) << late << " s, " << leap << " s";
    }
  }
}

TEST(TargetStream, AtOnceItAnswersInTheSameTickAndStopsAfterTheTimeout) {
  Stream stream(0.0, 0.2, kRates);
  stream.start({});
  stream.at(0, 0);
  stream.add(0, {Vector(1, 1), kNoClock, 0, false});
  EXPECT_GT(stream.at(kTick, kTick).a.norm(), 0);
  std::vector<Vector> x;
  for (int i = 2; i < 2000; ++i) x.push_back(stream.at(i * kTick, i * kTick).x);
  EXPECT_LT((x.back() - x[x.size() - 100]).norm(), 1e-9);
  EXPECT_LT(x.back()[0], 0.6);
  // Another target goes on from there.
  stream.add(2, {Vector(1, 1), kNoClock, 0, false});
  for (int i = 2000; i < 2150; ++i) stream.at(i * kTick, i * kTick);
  EXPECT_GT(stream.at(2.15, 2.15).x[0], x.back()[0]);
}

TEST(TargetStream, ChunksAreFollowedAtTheirTimesExtendedAndReplaced) {
  Stream stream(std::nullopt, 0, kRates);
  stream.start({});
  std::vector<Vector> x;
  const auto send = [&](double t, double from, const auto& where) {
    for (int k = 1; k <= 20; ++k) {
      const double lead = from + 0.05 * k;
      stream.add(t, {where(t + lead), t, lead, k == 1});
    }
  };
  for (int i = 0; i < 3500; ++i) {
    const double t = i * kTick;
    if (i == 0) send(t, 0, wave);
    if (i == 800) send(t, 0.05, wave);  // before the first has run out
    if (i == 1500) send(t, 0.1, [](double) { return Vector(0.05, 0.05); });
    x.push_back(stream.at(t, t).x);
  }
  for (double t : {0.5, 0.9, 1.4}) EXPECT_LT((x[static_cast<std::size_t>(t / kTick)] - wave(t)).norm(), 5e-3) << t;
  EXPECT_LT((x.back() - Vector(0.05, 0.05)).norm(), 1e-6);
  EXPECT_LT((Watch{0, x, 100}.judge().most_a), 12);
}

TEST(TargetStream, WithATimeoutItBrakesWhateverTargetsAreLeftAndGoesOnWithTheNext) {
  for (const std::optional<double> timeout : {std::optional(0.5), std::optional(0.0), std::optional<double>()}) {
    Stream stream(std::nullopt, timeout, kRates);
    stream.start({});
    const auto send = [&](double t) {
      for (int k = 1; k <= 40; ++k) stream.add(t, {wave(t + 0.05 * k), t, 0.05 * k, k == 1});
    };
    std::vector<Vector> x;
    for (int i = 0; i < 3000; ++i) {
      const double t = i * kTick;
      if (i == 0 || i == 1200) send(t);
      x.push_back(stream.at(t, t).x);
    }
    EXPECT_LT((x[490] - wave(0.49)).norm(), 5e-3);
    const bool brakes = timeout && *timeout > 0;
    EXPECT_EQ((x[1100] - wave(1.1)).norm() > 0.02, brakes);
    EXPECT_EQ(x[1100] == x[1199], brakes);
    EXPECT_LT((x[1690] - wave(1.69)).norm(), 5e-3);
    EXPECT_EQ(x[2200] == x[2999], brakes);
    EXPECT_LT((Watch{0, x, 100}.judge().most_a), 12);
  }
}

TEST(TargetStream, SaysWhenTargetsAreFartherApartThanTheRatesAllow) {
  Stream stream(0.1, 0, kRates);
  stream.start({});
  auto limited = [&, sent = 0](double speed) mutable {
    int points = 0;
    for (int i = 0; i < 1000; ++i, ++sent) {
      const double t = sent * kTick;
      if (sent % 50 == 0) stream.add(t, {(sent / 50 % 2 == 0 ? 1 : -1) * Vector(speed * 0.025, 0), t, 0, false});
      stream.at(t, t);
      points += i > 200 && stream.limited();
    }
    return points;
  };
  EXPECT_EQ(limited(1.4), 0);
  EXPECT_EQ(limited(1.6), 799);
  EXPECT_EQ(limited(1.0), 0);
}

TEST(TargetStream, AllocatesNothing) {
  Stream stream(std::nullopt, 0, kRates);
  testing_tools::AllocationCounter counter;
  stream.start({});
  for (int i = 0; i < 2000; ++i) {
    const double t = i * kTick;
    if (i % 30 == 0) stream.add(t, {i % 300 == 0 ? Vector(0.5, 0) : wave(t), t, 0, false});
    stream.at(t, t);
  }
  EXPECT_EQ(counter.count(), 0u);
}

TEST(VelocityStream, ReachesWhatComesInsideTheRatesAndStopsAfterTheTimeout) {
  VelocityStream<2> stream(0.2, kRates);
  stream.start({});
  EXPECT_FALSE(stream.limited());
  std::vector<Vector> x;
  for (int i = 0; i < 3000; ++i) {
    const double t = i * kTick;
    x.push_back(stream.at(t, t).x);
    if (i % 50 == 0 && t < 1) stream.add(Vector(0.3, -3));
    ASSERT_EQ(stream.limited(), t < 1.15) << t;
  }
  const Watched seen = Watch{0, x, 100}.judge();
  EXPECT_NEAR((x[900][0] - x[899][0]) / kTick, 0.3, 1e-6);
  EXPECT_NEAR((x[900][1] - x[899][1]) / kTick, -1.5, 1e-6);
  EXPECT_LT(seen.most_a, 6.01);
  EXPECT_LT((x.back() - x[2000]).norm(), 1e-9);
}

TEST(VelocityStream, GoesOnFromAnotherPlaceWithTheSameMotion) {
  VelocityStream<2> stream(1, kRates);
  stream.start({});
  stream.add(Vector(0.3, -0.2));
  for (int i = 0; i < 200; ++i) stream.at(i * kTick, i * kTick);
  const auto before = stream.point();
  stream.move_to(before.x + Vector(1, 2));
  const auto after = stream.at(200 * kTick, 200 * kTick);
  EXPECT_NEAR((after.x - before.x - Vector(1, 2) - kTick * after.v).norm(), 0, 1e-5);
  EXPECT_NEAR((after.v - before.v).norm(), 0, 0.01);
}

TEST(StreamJointVelocity, StaysWhereItBeginsBeyondWhereMotionsEnd) {
  const models::Limits limits = models::limits(models::arm("fr3"), 10);
  StreamJointVelocity stream({"pace", 0.2, 1}, limits);
  Reference from, reference;
  from.motion = Channels::kJoint;
  from.joint.q = Vector7::Map(models::kHome.data());
  from.joint.q[0] = rest_max(limits, 0) + 0.01;
  stream.start(from);
  const testing_tools::SimulatedArm arm("fr3");
  for (int i = 0; i < 100; ++i) stream.step(arm.cycle, i * kTick, reference);
  EXPECT_EQ(reference.joint.q, from.joint.q);
}

TEST(SensorInput, OfWhatWaitsTheNewestIsKept) {
  SensorInput input("topic", {"JointPositionSensorMessage"});
  const auto put = [&input](double value) {
    SensorSample sample;
    sample.values[0] = value;
    return input.put(sample);
  };
  for (int i = 0; i < 255; ++i) ASSERT_TRUE(put(i)) << i;
  for (int i = 255; i < 1000; ++i) ASSERT_FALSE(put(i)) << i;
  double last = -1;
  int taken = 0;
  for (SensorSample sample; input.take(sample); ++taken) {
    ASSERT_GT(sample.values[0], last);
    last = sample.values[0];
  }
  EXPECT_EQ(last, 999);
  EXPECT_GE(taken, 128);
  EXPECT_TRUE(put(1000));
  SensorSample sample;
  EXPECT_TRUE(input.newest(sample));
  EXPECT_EQ(sample.values[0], 1000);
  EXPECT_FALSE(input.newest(sample));
}

TEST(SensorInput, WhatIsOlderThanTheTimeoutWhenTheSkillBeginsIsNotTaken) {
  SensorInput input("topic", {"JointChunk"}, 0.5);
  const auto put = [&input](std::uint64_t came, double lead, bool replaces) {
    SensorSample sample;
    sample.came = came;
    sample.lead = lead;
    sample.replaces = replaces;
    sample.values[0] = static_cast<double>(came) + lead;
    input.put(sample);
  };
  SensorSample sample;
  put(1000, 0, false);
  for (const double lead : {0.5, 1.0, 1.5}) put(1200, lead, lead == 0.5);  // that is of the last still
  put(2000, 0, false);
  input.begin(2500);
  ASSERT_TRUE(input.take(sample));
  EXPECT_EQ(sample.values[0], 1201);
  EXPECT_TRUE(sample.replaces);  // as the one before would have
  EXPECT_DOUBLE_EQ(sample.waited, 1.3);
  ASSERT_TRUE(input.take(sample));
  EXPECT_EQ(sample.values[0], 1201.5);
  EXPECT_FALSE(sample.replaces);
  ASSERT_TRUE(input.take(sample));
  EXPECT_EQ(sample.values[0], 2000);
  EXPECT_FALSE(input.take(sample));
  EXPECT_EQ(input.outdated(), 2u);
  put(2600, 0, false);
  ASSERT_TRUE(input.take(sample));
  EXPECT_EQ(sample.waited, 0);
  put(2700, 0, false);
  input.begin(9000);
  sample.values[0] = -1;
  EXPECT_FALSE(input.newest(sample));
  EXPECT_EQ(sample.values[0], -1);
  EXPECT_EQ(input.outdated(), 3u);

  SensorInput any("end", {"ShouldTerminateSensorMessage"});
  sample.came = 1;
  any.put(sample);
  any.begin(1'000'000);
  EXPECT_TRUE(any.take(sample));
}

}  // namespace
}  // namespace realtime
