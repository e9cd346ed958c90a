#include <gtest/gtest.h>
#include <spdlog/fmt/fmt.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <fstream>
#include <functional>
#include <thread>

#include "server/recorded_driver.hpp"
#include "server/recorder.hpp"
#include "tests/child.hpp"

namespace server {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

// Python's MCAP library reads what was written: topic, sequence and size of each message.
std::vector<std::string> read(const fs::path& path) {
  const std::string command = std::string(PYTHON) + " -c '" +
                              "import sys\n"
                              "from mcap.reader import make_reader\n"
                              "for schema, channel, message in make_reader(open(sys.argv[1], \"rb\"), validate_crcs=True).iter_messages():\n"
                              "    print(channel.topic, schema.name, message.sequence, len(message.data))\n' " +
                              path.string();
  FILE* pipe = popen(command.c_str(), "r");
  std::vector<std::string> lines;
  char line[512];
  while (fgets(line, sizeof line, pipe) != nullptr) lines.emplace_back(line, strcspn(line, "\n"));
  EXPECT_EQ(pclose(pipe), 0);
  return lines;
}

std::size_t count(const std::vector<std::string>& lines, const std::string& start) {
  return std::count_if(lines.begin(), lines.end(), [&](const auto& line) { return line.starts_with(start); });
}

class RecordingTest : public testing::Test {
 protected:
  RecordingTest() {
    for (const auto& folder : {folder_, boxes_}) {
      fs::remove_all(folder);
      fs::create_directories(folder);
    }
    setenv("FRANKA_INTERFACE_BLACK_BOXES", boxes_.c_str(), 1);  // no server of this user takes them
    config_.folder = folder_;
  }
  ~RecordingTest() override {
    fs::remove_all(folder_);
    fs::remove_all(boxes_);
  }

  // Cycles of an arm.
  void cycles(int n, realtime::Phase phase = realtime::Phase::kRunning, std::uint64_t skill = 1) {
    for (; n > 0; --n) {
      ++record_.cycles;
      record_.phase = phase;
      record_.skill_id = skill;
      record_.received_ns = start_ + static_cast<std::int64_t>(record_.cycles) * 1'000'000;
      record_.state.q.fill(1e-3 * static_cast<double>(record_.cycles));
      record_.state.robot_mode = robot_mode_;
      box_.records.push(record_);
    }
  }

  std::vector<fs::path> files() const {
    std::vector<fs::path> files;
    if (fs::exists(folder_ / "arm")) {
      for (const auto& entry : fs::directory_iterator(folder_ / "arm")) files.push_back(entry.path());
    }
    std::sort(files.begin(), files.end());
    return files;
  }
  bool wait_for(const std::function<bool()>& so) const {
    for (int i = 0; i < 6000 && !so(); ++i) std::this_thread::sleep_for(10ms);
    return so();
  }
  void expect_nothing_lost_where_files_change();

  const fs::path folder_ = fs::temp_directory_path() / fmt::format("test-recording-{}", getpid());
  const fs::path boxes_ = fmt::format("/dev/shm/test-recording-{}", getpid());
  RecordingsConfig config_;
  BlackBox box_;
  realtime::Record record_;
  fci::RobotMode robot_mode_ = fci::RobotMode::kMove;
  const std::int64_t start_ = 1'000'000'000;
};

TEST_F(RecordingTest, IsReadByAnIndependentLibrary) {
  Recording recording(box_, folder_ / "a.mcap", {}, {{"arm", "left"}});
  cycles(2500);
  box_.journal.note("/log", "frankapy.proto.LogLine", "", 7);
  recording.write();
  recording.close();
  EXPECT_EQ(recording.states(), 2500u);
  EXPECT_EQ(recording.lost(), 0u);
  const auto lines = read(folder_ / "a.mcap");
  EXPECT_EQ(count(lines, "/states frankapy.proto.ArmState"), 2500u);
  EXPECT_EQ(count(lines, "/log frankapy.proto.LogLine 7 0"), 1u);
  EXPECT_TRUE(lines.at(0).starts_with("/states frankapy.proto.ArmState 1 ")) << lines.at(0);
}

TEST_F(RecordingTest, BeginsInThePast) {
  cycles(4000);
  Recording recording(box_, folder_ / "a.mcap", {.past = 1000}, {});
  cycles(10);
  recording.write();
  recording.close();
  EXPECT_EQ(recording.states(), 1010u);
  EXPECT_NEAR(recording.time(), 1.009, 1e-9);
}

// States that come between the decision to record and the open file are not taken for the past.
TEST_F(RecordingTest, BeginsBeforeARecord) {
  cycles(4000);
  Recording recording(box_, folder_ / "a.mcap", {.past = 1000, .then = 1500}, {});
  recording.write();
  EXPECT_EQ(recording.states(), 3500u);
  Recording all(box_, folder_ / "b.mcap", {.past = 1000, .then = 200}, {});
  all.write();
  EXPECT_EQ(all.states(), 4000u);
}

TEST_F(RecordingTest, MoreTopicsThanAFileMayHaveAreCounted) {
  Recording recording(box_, folder_ / "a.mcap", {}, {});
  constexpr int kTopics = 70'000;  // more than there are numbers for
  for (int n = 0; n < kTopics; ++n) {
    box_.journal.note(fmt::format("/sensors/{}", n), "frankapy.proto.SensorMessage", "x");
    if (n % 1000 == 0) recording.write();
  }
  cycles(1);
  recording.write();
  recording.close();
  EXPECT_EQ(recording.lost_bytes(), 69'000u);
  EXPECT_EQ(count(read(folder_ / "a.mcap"), "/sensors/"), 1000u);
  EXPECT_EQ(recording.states(), 1u);
}

TEST_F(RecordingTest, WhatIsOverwrittenIsCounted) {
  Recording recording(box_, folder_ / "a.mcap", {}, {});
  cycles(BlackBox::kRecords + 100);
  recording.write();
  EXPECT_GT(recording.lost(), 100u);
  EXPECT_EQ(recording.lost() + recording.states(), BlackBox::kRecords + 100);
  EXPECT_EQ(recording.lost_bytes(), 0u);
  const std::string message(100'000, 'x');
  for (int n = 0; n < 100; ++n) box_.journal.note("/sensors/camera", "frankapy.proto.SensorMessage", message);
  recording.write();
  EXPECT_GT(recording.lost_bytes(), 5'000'000u);
  EXPECT_LT(recording.lost_bytes(), 10'000'000u);
}

TEST_F(RecordingTest, AnIdleArmTakesATenthOfIt) {
  Recording recording(box_, folder_ / "a.mcap", {.idle_step = 10}, {});
  cycles(1000, realtime::Phase::kIdle, 0);
  cycles(100);
  recording.write();
  EXPECT_EQ(recording.states(), 200u);
}

TEST_F(RecordingTest, EachSkillHasItsFile) {
  config_.mode = RecordingsConfig::Mode::kSkills;
  Recorder recorder(box_, config_, "arm", nullptr);
  cycles(1000, realtime::Phase::kIdle, 0);
  std::this_thread::sleep_for(50ms);
  EXPECT_TRUE(files().empty());
  cycles(500);
  ASSERT_TRUE(wait_for([&] { return recorder.ask({}).open(); }));
  ASSERT_TRUE(wait_for([&] { return !recorder.ask({}).open(); }));  // as no more states come
  ASSERT_EQ(files().size(), 1u);
  const auto lines = read(files()[0]);
  EXPECT_GE(count(lines, "/states"), 500u);
  EXPECT_LE(count(lines, "/states"), 700u);
}

TEST_F(RecordingTest, AnErrorIsKeptWithTheTenSecondsBefore) {
  std::chrono::steady_clock::duration took{};
  {
    Recorder recorder(box_, config_, "arm", nullptr);
    box_.journal.note("/log", "frankapy.proto.LogLine", "");
    cycles(9000);
    const auto begin = std::chrono::steady_clock::now();
    robot_mode_ = fci::RobotMode::kReflex;
    record_.state.reflex_reason[static_cast<std::size_t>(fci::Error::kJointReflex)] = true;
    cycles(10, realtime::Phase::kError, 0);
    ASSERT_TRUE(wait_for([&] { return !files().empty(); }));
    cycles(20, realtime::Phase::kError, 0);
    took = std::chrono::steady_clock::now() - begin;
  }
  ASSERT_EQ(files().size(), 1u);
  EXPECT_NE(files()[0].string().find("error-joint_reflex"), std::string::npos) << files()[0];
  const auto lines = read(files()[0]);
  EXPECT_GE(count(lines, "/states"), 9010u);
  if (took < 1s) {  // for which it goes on; a computer may stand still for longer
    EXPECT_EQ(count(lines, "/states"), 9030u);
  }
  EXPECT_EQ(count(lines, "/log"), 1u);
}

TEST_F(RecordingTest, NeverTakesMoreThanItMay) {
  config_.mode = RecordingsConfig::Mode::kAlways;
  config_.max_gb = 0.01;
  fs::create_directories(folder_ / "arm");
  std::ofstream(folder_ / "arm" / "2020-01-01T00-00-00.000Z-all.mcap") << std::string(8'000'000, 'x');
  std::ofstream(folder_ / "arm" / "2020-01-02T00-00-00.000Z-all.mcap") << std::string(8'000'000, 'x');
  std::ofstream(folder_ / "arm" / "notes.txt") << std::string(8'000'000, 'x');
  Recorder recorder(box_, config_, "arm", nullptr);
  cycles(100);
  ASSERT_TRUE(wait_for([&] { return !fs::exists(folder_ / "arm" / "2020-01-01T00-00-00.000Z-all.mcap"); }));
  EXPECT_TRUE(fs::exists(folder_ / "arm" / "2020-01-02T00-00-00.000Z-all.mcap"));
  EXPECT_TRUE(fs::exists(folder_ / "arm" / "notes.txt"));
}

// And of a file that would fill it the next one begins in time.
TEST_F(RecordingTest, LittleRoomIsForSeveralFiles) {
  config_.mode = RecordingsConfig::Mode::kAlways;
  config_.max_gb = 0.0008;
  Recorder recorder(box_, config_, "arm", nullptr);
  ASSERT_TRUE(wait_for([&] { return recorder.ask({}).open(); }));
  while (files().size() <= 2) {
    const auto before = recorder.ask({});
    cycles(100);
    ASSERT_TRUE(wait_for([&] {
      const auto now = recorder.ask({});
      return now.states() != before.states() || now.file() != before.file();
    })) << recorder.ask({}).error();
  }
  EXPECT_FALSE(recorder.ask({}).has_error()) << recorder.ask({}).error();
}

// Records all until there are four files, and looks for what was to be in them.
void RecordingTest::expect_nothing_lost_where_files_change() {
  config_.mode = RecordingsConfig::Mode::kAlways;
  constexpr std::size_t kBatch = 100;
  std::size_t batches = 0;
  {
    Recorder recorder(box_, config_, "arm", nullptr);
    ASSERT_TRUE(wait_for([&] { return recorder.ask({}).open(); }));
    for (; files().size() <= 3; ++batches) {
      const auto before = recorder.ask({});
      cycles(kBatch);
      box_.journal.note("/log", "frankapy.proto.LogLine", "", static_cast<std::uint32_t>(batches));
      ASSERT_TRUE(wait_for([&] {
        const auto now = recorder.ask({});
        return now.states() != before.states() || now.file() != before.file();
      }));
    }
  }
  std::vector<std::string> lines;
  for (const auto& file : files()) {
    for (const auto& line : read(file)) lines.push_back(line.substr(0, line.rfind(' ')));
  }
  EXPECT_EQ(count(lines, "/states"), batches * kBatch);
  EXPECT_EQ(count(lines, "/log"), batches);
  std::sort(lines.begin(), lines.end());
  EXPECT_EQ(std::adjacent_find(lines.begin(), lines.end()), lines.end());
}

TEST_F(RecordingTest, NothingIsLostOrTwiceWhereAFileIsLongEnough) {
  config_.file_mb = 0.2;
  expect_nothing_lost_where_files_change();
}

TEST_F(RecordingTest, NothingIsLostOrTwiceWhereAFileIsOldEnough) {
  config_.file_minutes = 0.002;
  expect_nothing_lost_where_files_change();
}

// An arm whose states are there as soon as they are asked for.
struct RestlessDriver : robot::Driver {
  robot::Received receive(fci::RobotState&) noexcept override { return robot::Received::kState; }
  std::int64_t received_ns() const noexcept override { return 0; }
  void send(const fci::RobotCommand&) noexcept override {}
  std::optional<std::uint32_t> post(const robot::Request&) noexcept override { return {}; }
  std::optional<robot::Answer> poll() noexcept override { return {}; }
  fci::Version version() const noexcept override { return {}; }
};

TEST_F(RecordingTest, OfAnArmInLockstepNothingIsLost) {
  config_.mode = RecordingsConfig::Mode::kAlways;
  fs::path kept;
  {
    Recorder recorder(box_, config_, "arm", nullptr);
    ASSERT_TRUE(wait_for([&] { return recorder.ask({}).open(); }));
    RestlessDriver arm;
    RecordedDriver driver(arm, recorder);
    for (int i = 0; i < 40'000; ++i) {
      ASSERT_EQ(driver.receive(record_.state), robot::Received::kState);
      cycles(1);
      if (i == 20'000) kept = recorder.keep("test");
    }
  }
  ASSERT_EQ(files().size(), 2u);
  EXPECT_EQ(count(read(files()[files()[0] == kept]), "/states"), 40'000u);
  EXPECT_GE(count(read(kept), "/states"), 10'000u);
}

TEST_F(RecordingTest, ADiskThatTakesNothingIsSaid) {
  config_.mode = RecordingsConfig::Mode::kAlways;
  config_.folder = "/proc/nowhere";
  Recorder recorder(box_, config_, "arm", nullptr);
  ASSERT_TRUE(wait_for([&] { return recorder.ask({}).has_error(); }));
  EXPECT_NE(recorder.ask({}).error().find("/proc/nowhere"), std::string::npos) << recorder.ask({}).error();
  EXPECT_FALSE(recorder.ask({}).open());
}

TEST_F(RecordingTest, AClientAsksForIt) {
  Recorder recorder(box_, config_, "arm", nullptr);
  frankapy::proto::Record request;
  request.set_on(true);
  recorder.ask(request);
  ASSERT_TRUE(wait_for([&] { return recorder.ask({}).open(); }));
  cycles(300);
  ASSERT_TRUE(wait_for([&] { return recorder.ask({}).states() == 300; }));
  cycles(77);
  request.set_on(false);
  recorder.ask(request);
  ASSERT_TRUE(wait_for([&] { return !recorder.ask({}).open(); }));
  const auto told = recorder.ask({});
  EXPECT_EQ(count(read(told.file()), "/states"), 377u);
  EXPECT_EQ(told.states(), 377u);
  EXPECT_EQ(told.bytes(), fs::file_size(told.file()));
}

// A process that records is killed: what it wrote is readable to the last chunk, and what it had not yet written is in its black
// box.
TEST_F(RecordingTest, SurvivesItsProcess) {
  const int fd = make_black_box_file();
  const pid_t child = testing_tools::fork_child();
  if (child == 0) {
    BlackBox box = BlackBox::in(fd);
    Recording recording(box, folder_ / "a.mcap", {}, {});
    record_.phase = realtime::Phase::kRunning;
    for (int i = 1;; ++i) {
      record_.cycles = static_cast<std::uint64_t>(i);
      record_.received_ns = start_ + i * 1'000'000ll;
      box.records.push(record_);
      recording.write();
      usleep(1000);
    }
  }
  const fs::path file = folder_ / "a.mcap";
  ASSERT_TRUE(wait_for([&] { return fs::exists(file) && fs::file_size(file) > 5000; }));
  kill(child, SIGKILL);
  waitpid(child, nullptr, 0);
  // Without its end the file is read from the beginning, as far as it goes.
  const std::string command = std::string(PYTHON) + " -c '" +
                              "import sys\n"
                              "from mcap.reader import NonSeekingReader\n"
                              "n = 0\n"
                              "try:\n"
                              "    for _ in NonSeekingReader(open(sys.argv[1], \"rb\")).iter_messages(log_time_order=False): n += 1\n"
                              "except Exception as error:\n"
                              "    print(type(error).__name__, file=sys.stderr)\n"
                              "sys.exit(n < 100)\n' " +
                              file.string();
  EXPECT_EQ(std::system(command.c_str()), 0);
  const fs::path left = write_black_box(fd, config_, "arm", "was killed by signal 9");
  EXPECT_NE(left.string().find("crash-was-killed-by-signal-9"), std::string::npos) << left;
  EXPECT_GE(count(read(left), "/states"), 100u);
  close(fd);
}

// Nobody is left of a server but what lies in its named file: that is written to its own folder, once, by whoever starts next.
TEST_F(RecordingTest, WhatAllOfItsProcessesLeaveIsFound) {
  const BlackBoxOwner owner{"left", folder_, 1};
  const int fd = make_black_box_file(owner);
  const pid_t child = testing_tools::fork_child();
  if (child == 0) {
    BlackBox box = BlackBox::in(fd);
    box.journal.note("/log", "frankapy.proto.LogLine", "");
    record_.phase = realtime::Phase::kRunning;
    for (int i = 1;; ++i) {
      record_.cycles = static_cast<std::uint64_t>(i);
      record_.received_ns = start_ + i * 1'000'000ll;
      box.records.push(record_);
      usleep(1000);
    }
  }
  std::unique_ptr<BlackBox> box;
  ASSERT_TRUE(wait_for([&] {
    if (!box) box = BlackBox::found(fd);
    return box && box->records.written() > 200;
  }));
  box.reset();  // its memory holds the file as well
  EXPECT_TRUE(left_black_boxes().empty());  // two hold it
  close(fd);
  EXPECT_TRUE(left_black_boxes().empty());  // one does still
  kill(child, SIGKILL);
  waitpid(child, nullptr, 0);
  auto boxes = left_black_boxes();
  ASSERT_EQ(boxes.size(), 1u);
  EXPECT_EQ(boxes[0].owner.arm, "left");
  EXPECT_EQ(boxes[0].owner.max_gb, 1);
  EXPECT_TRUE(left_black_boxes().empty());  // it is ours now
  close(boxes[0].fd);
  write_left_black_boxes();
  EXPECT_TRUE(left_black_boxes().empty());
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(folder_ / "left")) files.push_back(entry.path());
  ASSERT_EQ(files.size(), 1u);
  EXPECT_NE(files[0].string().find("crash-the-server-was-killed"), std::string::npos) << files[0];
  const auto lines = read(files[0]);
  EXPECT_GE(count(lines, "/states"), 200u);
  EXPECT_EQ(count(lines, "/log"), 1u);
}

// A disk that is full, or not there, at the next start.
TEST_F(RecordingTest, WhatCouldNotBeWrittenIsLeft) {
  const fs::path folder = folder_ / "not there" / "recordings";
  std::ofstream(folder_ / "not there") << "a file, and no folder";
  int fd = make_black_box_file(BlackBoxOwner{"left", folder, 1});
  {
    BlackBox box = BlackBox::in(fd);
    record_.received_ns = start_;
    box.records.push(record_);
  }
  close(fd);
  write_left_black_boxes();
  fs::remove(folder_ / "not there");
  write_left_black_boxes();
  EXPECT_EQ(std::distance(fs::directory_iterator(folder / "left"), fs::directory_iterator()), 1);
  EXPECT_TRUE(left_black_boxes().empty());
  // Of many that last is forgotten.
  std::vector<int> fds;
  for (int i = 0; i < 9; ++i) fds.push_back(make_black_box_file(BlackBoxOwner{"left", folder, 1}));
  EXPECT_EQ(leave_black_box(fds.back()), "It is gone");
  EXPECT_NE(leave_black_box(fds.front()), "It is gone");
  for (const int each : fds) {
    forget_black_box(each);
    close(each);
  }
}

TEST_F(RecordingTest, ABlackBoxOfAnotherUserOrBuildIsNotRead) {
  const fs::path theirs = boxes_ / fmt::format("franka-interface-{}-test", geteuid());
  const fs::path target = folder_ / "target";
  std::ofstream(target) << "theirs";
  fs::create_symlink(target, theirs);
  write_left_black_boxes();
  EXPECT_TRUE(fs::is_symlink(theirs));  // is no file of ours
  fs::remove(theirs);
  std::ofstream(theirs) << "of another build";
  if (geteuid() == 0) {
    ASSERT_EQ(chown(theirs.c_str(), 12345, 12345), 0);
    write_left_black_boxes();
    EXPECT_TRUE(fs::exists(theirs));
    ASSERT_EQ(chown(theirs.c_str(), 0, 0), 0);
  }
  write_left_black_boxes();
  EXPECT_FALSE(fs::exists(theirs));

  const int fd = make_black_box_file(BlackBoxOwner{"left", folder_, 1});
  struct stat file {};
  ASSERT_EQ(fstat(fd, &file), 0);
  EXPECT_EQ(file.st_nlink, 1u);
  forget_black_box(fd);
  ASSERT_EQ(fstat(fd, &file), 0);
  EXPECT_EQ(file.st_nlink, 0u);
  close(fd);
}

TEST(Journal, KeepsTheNewestWholeEntries) {
  BlackBox box;
  const std::string bytes(100'000, 'x');
  for (std::uint32_t i = 1; i <= 100; ++i) box.journal.note("/topic", "type", bytes, i, 17);
  std::uint64_t place = 0, lost = 0;
  Journal::Entry entry;
  std::uint32_t last = 0, n = 0;
  while (box.journal.read(place, entry, lost)) {
    EXPECT_EQ(entry.topic, "/topic");
    EXPECT_EQ(entry.type, "type");
    EXPECT_EQ(entry.bytes, bytes);
    EXPECT_EQ(entry.sent_ns, 17);
    EXPECT_TRUE(last == 0 || entry.sequence == last + 1) << entry.sequence;
    last = entry.sequence;
    ++n;
  }
  EXPECT_EQ(last, 100u);
  EXPECT_NEAR(lost, 59 * 100e3, 59 * 100.);
  EXPECT_EQ(n, 41u);  // of 100 kB in 4 MiB
}

// What its process wrote over before it died of that is no entry, and costs what comes behind it.
TEST(Journal, WhatIsOverwrittenIsNotRead) {
  const std::shared_ptr<void> memory(std::calloc(1, Journal::size()), std::free);
  Journal journal(memory);
  journal.note("/topic", "type", "first");
  const std::uint64_t second = journal.end();
  journal.note("/topic", "type", "second");
  std::memset(static_cast<char*>(memory.get()) + Journal::size() - (4 << 20) + second, 0xff, 64);
  const Journal found = Journal::found(memory);
  std::uint64_t place = found.begin(), lost = 0;
  Journal::Entry entry;
  ASSERT_TRUE(found.read(place, entry, lost));
  EXPECT_EQ(entry.bytes, "first");
  EXPECT_FALSE(found.read(place, entry, lost));
  EXPECT_EQ(place, found.end());
  EXPECT_EQ(lost, found.end() - second);
}

}  // namespace
}  // namespace server
