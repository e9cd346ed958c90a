#include <gtest/gtest.h>
#include <poll.h>

#include <future>
#include <stdexcept>
#include <string>
#include <vector>

#include "server/sign_of_life.hpp"
#include "server/workbench.hpp"

namespace server {
namespace {

using namespace std::chrono_literals;

void wait_for(const Workbench& bench) {
  pollfd ready{bench.fd(), POLLIN, 0};
  ASSERT_EQ(poll(&ready, 1, 20000), 1);
}

TEST(Workbench, DoesOneJobAfterTheOtherAndTheAskerDealsWithThem) {
  Workbench bench;
  std::vector<std::string> said;
  const auto asker = std::this_thread::get_id();
  const auto done = [&](const std::exception_ptr& thrown) {
    EXPECT_EQ(std::this_thread::get_id(), asker);
    try {
      if (thrown) std::rethrow_exception(thrown);
      said.push_back("done");
    } catch (const std::exception& error) {
      said.push_back(error.what());
    }
  };
  EXPECT_TRUE(bench.add({[&] { EXPECT_NE(std::this_thread::get_id(), asker); }, done}));
  EXPECT_TRUE(bench.add({[] { throw std::runtime_error("broken"); }, done}));
  while (said.size() < 2) {
    wait_for(bench);
    bench.take_finished();
  }
  EXPECT_EQ(said, std::vector<std::string>({"done", "broken"}));
  EXPECT_EQ(bench.begun(), 2u);
  EXPECT_EQ(bench.finished(), 2u);
}

TEST(Workbench, TakesOnlySoManyJobs) {
  std::promise<void> begun, go_on;
  int done = 0;
  Workbench bench;
  const auto count = [&](const std::exception_ptr&) { ++done; };
  ASSERT_TRUE(bench.add({[&] {
                           begun.set_value();
                           go_on.get_future().wait();
                         },
                         count}));
  begun.get_future().wait();
  for (std::size_t i = 0; i < Workbench::kMostJobs; ++i) EXPECT_TRUE(bench.add({[] {}, count}));
  EXPECT_FALSE(bench.add({[] {}, count}));
  EXPECT_NE(bench.begun(), bench.finished());
  go_on.set_value();
  while (done <= static_cast<int>(Workbench::kMostJobs)) {
    wait_for(bench);
    bench.take_finished();
  }
  EXPECT_TRUE(bench.add({[] {}, count}));
}

TEST(SignOfLife, IsANumberThatGrowsWhileThereIsSomethingToDo) {
  SignOfLife sign;
  EXPECT_EQ(sign.silence(1, true, 5s), 0s);
  EXPECT_EQ(sign.silence(1, true, 6s), 1s);
  EXPECT_EQ(sign.silence(2, true, 7s), 0s);
  EXPECT_EQ(sign.silence(2, true, 9s), 2s);
  EXPECT_EQ(sign.silence(2, false, 9s), 0s);
  EXPECT_EQ(sign.silence(2, true, 10s), 1s);
}

}  // namespace
}  // namespace server
