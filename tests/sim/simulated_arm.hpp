#pragma once

#include <fcntl.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "free_address.hpp"
#include "tests/child.hpp"

namespace testing_tools {

// A child process fci-sim on an address of its own, ready when the constructor returns.
class SimulatedArm {
 public:
  explicit SimulatedArm(std::vector<std::string> arguments = {}, std::string address = free_address())
      : address_(std::move(address)), folder_(make_folder()) {
    arguments.insert(arguments.begin(), {BIN_DIR "/fci-sim", "--listen", address_});
    start(arguments);
    char byte = 0;
    while (::read(out_, &byte, 1) == 1 && byte != '\n') ready_line_ += byte;
  }
  ~SimulatedArm() {
    if (process_ > 0) terminate();
    ::close(out_);
    std::filesystem::remove_all(folder_);
  }
  SimulatedArm(const SimulatedArm&) = delete;

  const std::string& address() const { return address_; }
  // Of the arm after it, where there are several.
  std::string next_address() const {
    const auto dot = address_.rfind('.');
    return address_.substr(0, dot + 1) + std::to_string(std::stoi(address_.substr(dot + 1)) + 1);
  }
  pid_t process() const { return process_; }
  const std::string& ready_line() const { return ready_line_; }
  // What else it says before it is ready.
  std::string until_ready() {
    std::string said;
    for (char byte = 0; !said.ends_with("ready\n") && ::read(out_, &byte, 1) == 1;) said += byte;
    return said;
  }

  // What it said on stderr.
  std::string log() const {
    std::ifstream file(folder_ / "log");
    std::stringstream text;
    text << file.rdbuf();
    return text.str();
  }
  bool runs() {
    return process_ > 0 && ::waitpid(process_, &status_, WNOHANG) == 0;
  }
  // Ends it as a user would; its exit code.
  int terminate() {
    ::kill(process_, SIGTERM);
    return wait();
  }
  int wait() {
    ::waitpid(process_, &status_, 0);
    process_ = 0;
    return WIFEXITED(status_) ? WEXITSTATUS(status_) : -WTERMSIG(status_);
  }

 private:
  static std::filesystem::path make_folder() {
    std::string name = (std::filesystem::temp_directory_path() / "fci-sim.XXXXXX").string();
    return ::mkdtemp(name.data());
  }

  void start(std::vector<std::string>& arguments) {
    std::array<int, 2> pipe;
    ASSERT_EQ(::pipe2(pipe.data(), O_CLOEXEC), 0);
    const std::string log = (folder_ / "log").string();
    std::vector<char*> argv;
    for (auto& argument : arguments) argv.push_back(argument.data());
    argv.push_back(nullptr);
    process_ = fork_child();
    if (process_ == 0) {
      ::dup2(pipe[1], 1);
      ::dup2(::open(log.c_str(), O_CREAT | O_WRONLY, 0600), 2);
      ::execv(argv[0], argv.data());
      ::_exit(127);
    }
    ::close(pipe[1]);
    out_ = pipe[0];
  }

  std::string address_;
  std::filesystem::path folder_;
  std::string ready_line_;
  pid_t process_ = 0;
  int out_ = -1;
  int status_ = 0;
};

}  // namespace testing_tools
