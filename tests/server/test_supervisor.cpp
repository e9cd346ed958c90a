#include <fcntl.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <signal.h>
#include <sys/wait.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <sstream>

#include "client/sensor_publisher.hpp"
#include "frankapy/proto/sensors.pb.h"
#include "tests/child.hpp"
#include "tests/server/client.hpp"
#include "tests/server/fake_robot.hpp"
#include "tests/server/key_folder.hpp"
#include "wire/proto/validation.hpp"

namespace server {
namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

// A running franka-interface on a free port.
class Program {
 public:
  explicit Program(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), BIN_DIR "/franka-interface");
    std::vector<char*> words;
    for (auto& argument : arguments) words.push_back(argument.data());
    words.push_back(nullptr);
    int out[2], err[2];
    if (pipe2(out, O_CLOEXEC) != 0 || pipe2(err, O_CLOEXEC) != 0) throw std::runtime_error("pipe");
    pid_ = testing_tools::fork_child();
    if (pid_ == 0) {
      for (const int number : {SIGINT, SIGHUP}) signal(number, SIG_DFL);  // as tests in the background are started without them
      dup2(out[1], STDOUT_FILENO);
      dup2(err[1], STDERR_FILENO);
      execv(words[0], words.data());
      _exit(127);
    }
    close(out[1]);
    close(err[1]);
    char byte;
    while (::read(out[0], &byte, 1) == 1 && byte != '\n') first_line_ += byte;
    close(out[0]);
    err_ = err[0];
    fcntl(err_, F_SETPIPE_SZ, 4096);
    log_ = std::thread([this] {
      char bytes[4096];
      pollfd ready{err_, POLLIN, 0};
      while (!paused_) {
        if (poll(&ready, 1, 10) == 0) continue;
        const ssize_t size = ::read(err_, bytes, sizeof bytes);
        if (size <= 0) return;
        text_.append(bytes, size);
      }
    });
  }
  ~Program() {
    if (pid_ > 0) stop(SIGKILL);
  }

  // Returns the exit status.
  int stop(int signal = SIGINT) {
    if (signal != 0) kill(pid_, signal);
    int status = 0;
    waitpid(pid_, &status, 0);
    pid_ = 0;
    if (log_.joinable()) log_.join();
    close(err_);
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }

  std::string endpoint() const { return first_line_.substr(first_line_.rfind(' ') + 1); }
  const std::string& log() const { return text_; }  // after stop()

  // From now on nobody takes what it logs.
  void stop_reading() {
    paused_ = true;
    log_.join();
  }

  // Process ids of the arms' processes.
  std::vector<pid_t> children() const {
    const std::string path = "/proc/" + std::to_string(pid_) + "/task/" + std::to_string(pid_) + "/children";
    std::ifstream file(path);
    return {std::istream_iterator<pid_t>(file), {}};
  }

 private:
  pid_t pid_ = 0;
  int err_ = -1;
  std::atomic<bool> paused_{false};
  std::string first_line_, text_;
  std::thread log_;
};

bool eventually(const std::function<bool()>& condition) {
  for (const auto deadline = Clock::now() + 60s; Clock::now() < deadline; std::this_thread::sleep_for(20ms)) {
    if (condition()) return true;
  }
  return false;
}

// Two arms, of which the first is there. In lockstep, as one that this computer stops for a second has not gone.
class SupervisorTest : public testing::Test {
 protected:
  SupervisorTest() : robot_(left_) {
    std::ofstream(file_) << "[server]\nport = 0\n[[arm]]\nname = 'left'\naddress = '" << left_
                         << "'\ngripper = false\nlockstep = true\n[[arm]]\nname = 'right'\naddress = '" << right_
                         << "'\ngripper = false\nlockstep = true\n";
    program_.emplace(std::vector<std::string>{"--config", file_});
    client_.emplace(context_, program_->endpoint());
  }
  ~SupervisorTest() override { std::filesystem::remove(file_); }

  proto::Arms::Arm arm(int index) {
    const auto reply = client_->list_arms();
    EXPECT_EQ(reply.arms().version(), proto::CURRENT);
    EXPECT_EQ(reply.arms().arms_size(), 2);
    return reply.arms().arms(index);
  }
  bool ready(int index) { return arm(index).status() == "ready" && arm(index).has_endpoint(); }

  const std::string left_ = free_address(), right_ = free_address();
  const std::string file_ = testing::TempDir() + "arms_" + std::to_string(getpid()) + ".toml";
  FakeRobot robot_;
  std::optional<Program> program_;
  zmq::context_t context_;
  std::optional<Client> client_;
};

TEST_F(SupervisorTest, SaysWhereEachArmIsOrWhyNot) {
  ASSERT_TRUE(eventually([&] { return ready(0); })) << arm(0).status();
  EXPECT_EQ(arm(0).name(), "left");
  EXPECT_EQ(arm(0).address(), left_);
  ASSERT_TRUE(eventually([&] { return arm(1).status().find("refused") != std::string::npos; })) << arm(1).status();
  EXPECT_FALSE(arm(1).has_endpoint());

  Client client(context_, arm(0).endpoint());
  const auto welcome = client.hello().welcome();
  EXPECT_EQ(welcome.arm(), "left");
  EXPECT_EQ(welcome.model(), "fer");
  EXPECT_EQ(welcome.protocol_version(), FakeRobot::kVersion);
  EXPECT_EQ(welcome.limits().q_max_size(), 7);
  EXPECT_FALSE(welcome.gripper());
  ASSERT_TRUE(eventually([&] { return client.state().has_state(); }));  // the first may be on its way still
  EXPECT_EQ(client.state().state().robot().q(3), models::kHome[3]);
  EXPECT_EQ(arm(0).state_endpoint(), welcome.state_endpoint());

  // Requests for an arm are not for the supervisor.
  EXPECT_EQ(client_->state().error().code(), proto::Error::INVALID_ARGUMENT);
  EXPECT_EQ(client_->hello().error().code(), proto::Error::INVALID_ARGUMENT);

  EXPECT_EQ(program_->stop(), 0);
  EXPECT_NE(program_->log().find("protocol version 5"), std::string::npos) << program_->log();
  EXPECT_NE(program_->log().find("scheduling"), std::string::npos);
}

TEST_F(SupervisorTest, AProgramInCppPublishesSensorMessages) {
  ASSERT_TRUE(eventually([&] { return ready(0); })) << arm(0).status();
  proto::JointPositionSensorMessage message;
  for (int i = 0; i < 7; ++i) message.add_joints(models::kHome[i]);
  {
    client::SensorPublisher publisher("policy", program_->endpoint());
    for (int i = 0; i < 100; ++i) publisher.publish(message);
    message.set_joints(3, NAN);
    EXPECT_THROW(publisher.publish(message), wire::Invalid);
  }
  Client client(context_, arm(0).endpoint());
  client.hello();
  proto::Request request;
  request.mutable_list_topics();
  ASSERT_TRUE(eventually([&] {
    const auto topics = client.ask(request).topics();
    return topics.topics_size() == 1 && topics.topics(0).received() == 100;
  }));
  const auto topic = client.ask(request).topics().topics(0);
  EXPECT_EQ(topic.topic(), "policy");
  EXPECT_EQ(topic.message(), "JointPositionSensorMessage");
  EXPECT_EQ(topic.lost() + topic.out_of_order() + topic.refused(), 0u);

  EXPECT_THROW(client::SensorPublisher("policy", program_->endpoint(), 3), std::invalid_argument);
  EXPECT_THROW(client::SensorPublisher("policy", program_->endpoint(), 2), std::runtime_error);  // is not there
  EXPECT_THROW(client::SensorPublisher("", program_->endpoint()), std::invalid_argument);
  EXPECT_THROW(client::SensorPublisher("policy", "127.0.0.1:1"), std::runtime_error);

  // A key of the lab does not keep from a server without keys on this computer, unless it was named for it.
  const KeyFolder lab;
  proto::ClientKey key;
  const auto pair = KeyFolder::pair();
  key.set_public_key(pair[0]);
  key.set_secret_key(pair[1]);
  key.set_server_key(lab.own.public_key());
  lab.write("key.json", key);
  const std::string file = lab.path / "key.json";
  setenv("FRANKAPY_KEY", file.c_str(), 1);
  EXPECT_NO_THROW(client::SensorPublisher("policy", program_->endpoint()));
  unsetenv("FRANKAPY_KEY");
  EXPECT_THROW(client::SensorPublisher("policy", program_->endpoint(), 1, file), std::runtime_error);
}

TEST_F(SupervisorTest, AnArmThatDiesIsStartedAgainWhereItWas) {
  ASSERT_TRUE(eventually([&] { return ready(0); }));
  const std::string endpoint = arm(0).endpoint();
  Client client(context_, endpoint);
  ASSERT_TRUE(client.hello().has_welcome());
  const auto before = program_->children();
  ASSERT_EQ(before.size(), 2u);
  const int connections = robot_.connections();

  kill(before[0], SIGKILL);
  ASSERT_TRUE(eventually([&] { return robot_.connections() > connections && ready(0); })) << arm(0).status();
  EXPECT_EQ(arm(0).starts(), 2u);
  EXPECT_EQ(arm(0).ended(), "was killed by signal 9 (Killed)");
  EXPECT_EQ(arm(1).starts(), 1u);
  EXPECT_EQ(arm(1).ended(), "");
  const auto after = program_->children();
  EXPECT_EQ(std::count(after.begin(), after.end(), before[0]), 0);
  EXPECT_EQ(std::count(after.begin(), after.end(), before[1]), 1);  // the other arm does not notice
  EXPECT_EQ(arm(0).endpoint(), endpoint);

  // The client's connection comes back by itself, and it is asked for its name again.
  EXPECT_EQ(client.state().error().code(), proto::Error::UNKNOWN_CLIENT);
  EXPECT_TRUE(client.hello().has_welcome());
  EXPECT_TRUE(eventually([&] { return client.state().has_state(); }));
}

TEST_F(SupervisorTest, AnArmThatHangsIsStartedAgain) {
  ASSERT_TRUE(eventually([&] { return ready(0); }));
  const auto before = program_->children();
  ASSERT_EQ(before.size(), 2u);
  const int connections = robot_.connections();
  kill(before[0], SIGSTOP);
  ASSERT_TRUE(eventually([&] { return robot_.connections() > connections && ready(0); })) << arm(0).status();
  const auto after = program_->children();
  EXPECT_EQ(std::count(after.begin(), after.end(), before[0]), 0);
  EXPECT_EQ(std::count(after.begin(), after.end(), before[1]), 1);
}

TEST_F(SupervisorTest, ARobotThatAppearsIsConnected) {
  ASSERT_TRUE(eventually([&] { return arm(1).status().find("refused") != std::string::npos; }));
  FakeRobot other(right_);
  EXPECT_TRUE(eventually([&] { return ready(1); })) << arm(1).status();
}

TEST_F(SupervisorTest, GarbageDoesNotDisturbIt) {
  client_->send_bytes("garbage");
  client_->send_bytes("");
  client_->send_frames({"a", "b", "c"});
  EXPECT_TRUE(eventually([&] { return ready(0); }));
}

// A pipe that nobody reads, as a terminal that is paused.
TEST_F(SupervisorTest, ALogThatNobodyReadsStopsNobody) {
  ASSERT_TRUE(eventually([&] { return ready(0); }));
  program_->stop_reading();
  Client client(context_, arm(0).endpoint());
  for (int i = 0; i < 100; ++i) {  // each makes a line that names the client, of which the pipe takes some ten
    proto::Request hello, recover;
    hello.mutable_hello()->set_version(proto::CURRENT);
    hello.mutable_hello()->set_client(std::string(256, 'x'));
    ASSERT_TRUE(client.ask(hello).has_welcome()) << i;
    recover.mutable_recover();
    const auto reply = client.ask(recover);
    ASSERT_TRUE(reply.has_recovery() || reply.has_error()) << i;
    ASSERT_TRUE(client.say_goodbye().has_done()) << i;
  }
  EXPECT_EQ(arm(0).starts(), 1u);
  EXPECT_EQ(arm(0).status(), "ready");
}

TEST_F(SupervisorTest, TheArmsEndWithIt) {
  ASSERT_TRUE(eventually([&] { return ready(0); }));
  const auto children = program_->children();
  EXPECT_NE(program_->stop(SIGKILL), 0);
  for (const pid_t child : children) {
    EXPECT_TRUE(eventually([&] { return kill(child, 0) != 0; })) << child;
  }
}

TEST(Supervisor, AModelThatTheRobotContradictsMovesNothing) {
  const std::string address = free_address(), file = testing::TempDir() + "model_" + std::to_string(getpid()) + ".toml";
  const FakeRobot robot(address);
  std::ofstream(file) << "[server]\nport = 0\n[[arm]]\nname = 'left'\naddress = '" << address << "'\ngripper = false\nmodel = 'fr3'\n";
  const Program program({"--config", file});
  zmq::context_t context;
  Client client(context, program.endpoint());
  std::string status;
  EXPECT_TRUE(eventually([&] {
    const auto arm = client.list_arms().arms().arms(0);
    EXPECT_FALSE(arm.has_endpoint());
    status = arm.status();
    return status.find("limits and masses of another arm would apply") != std::string::npos;
  })) << status;
  std::filesystem::remove(file);
}

TEST(Supervisor, ATakenPortIsNamedWithTheRemedy) {
  Program first({"--robot", free_address(), "--port", "0", "--no-gripper"});
  const std::string endpoint = first.endpoint();
  Program second({"--robot", free_address(), "--port", endpoint.substr(endpoint.rfind(':') + 1)});
  EXPECT_EQ(second.stop(0), 1);
  EXPECT_NE(second.log().find("does another franka-interface run? Stop it, or choose another --port"), std::string::npos)
      << second.log();
  EXPECT_EQ(first.stop(SIGTERM), 0);
}

TEST(Supervisor, EndsByTheSignalsOfATerminal) {
  for (const int number : {SIGINT, SIGTERM, SIGHUP}) {
    Program program({"--robot", free_address(), "--port", "0"});
    EXPECT_EQ(program.stop(number), 0) << number;
    EXPECT_NE(program.log().find("stopping: the arms brake and finish"), std::string::npos) << program.log();
  }
}

// With keys a thread asks whose they are, which must not be ended by them.
TEST(Supervisor, EndsByASignalWithKeysToo) {
  const KeyFolder keys;
  Program program({"--robot", free_address(), "--port", "0", "--keys", keys.path.string()});
  EXPECT_EQ(program.stop(SIGTERM), 0);
  EXPECT_NE(program.log().find("stopping: the arms brake and finish"), std::string::npos) << program.log();
}

TEST(Supervisor, ABadFileEndsTheProgramBeforeAnythingStarts) {
  const std::string file = testing::TempDir() + "bad_" + std::to_string(getpid()) + ".toml";
  std::ofstream(file) << "[[arm]]\nname = 'left'\nadress = '172.16.0.2'\n";
  Program program({"--config", file});
  EXPECT_EQ(program.stop(0), 1);
  EXPECT_NE(program.log().find(file + ":1: arm.address is missing"), std::string::npos) << program.log();
  std::filesystem::remove(file);
}

}  // namespace
}  // namespace server
