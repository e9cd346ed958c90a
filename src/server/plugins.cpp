#include "server/plugins.hpp"

#include <dlfcn.h>
#include <poll.h>
#include <signal.h>
#include <spdlog/fmt/fmt.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <filesystem>

#include "server/part.hpp"
#include "server/registry.hpp"

namespace server {
namespace {


template <class Function>
Function* symbol(void* library, const std::string& path, const char* name) {
  auto* function = reinterpret_cast<Function*>(dlsym(library, name));
  if (function != nullptr) return function;
  throw PluginError(fmt::format("{}: is no library of parts: it does not export {} (FRANKA_INTERFACE_PARTS of server/part.hpp "
                                "in its C++ file)",
                                path, name));
}

template <class Base>
void join(const std::string& path, std::vector<Kind<Base>>&& from, std::vector<Kind<Base>>& to) {
  for (auto& each : from) {
    if (number_of(each.name) != 0) throw PluginError(fmt::format("{}: the kind {} is there already", path, each.name));
    if (each.name.find('.') == std::string::npos) {
      throw PluginError(fmt::format("{}: the message {} has no package: write one into its .proto file", path, each.name));
    }
    to.push_back(std::move(each));
  }
}

std::string in_one_line(std::string text) {
  while (!text.empty() && text.back() == '\n') text.pop_back();
  for (std::size_t at; (at = text.find('\n')) != std::string::npos;) text.replace(at, 1, "; ");
  return text;
}

}  // namespace

void load_parts(const std::string& path) {
  if (!std::filesystem::is_regular_file(path)) {
    throw PluginError(fmt::format("{}: there is no such file: expected a library of parts", path));
  }
  void* library = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr) throw PluginError(fmt::format("{}: cannot be loaded: {}", path, dlerror()));
  const std::string theirs = symbol<const char*()>(library, path, "franka_interface_abi")();
  if (theirs != abi()) {
    throw PluginError(fmt::format("{}: was built for another server: build it anew (it has: {}; expected: {})", path,
                                  theirs.substr(0, 1000), abi()));
  }
  Parts parts;
  symbol<void(Parts&)>(library, path, "franka_interface_parts")(parts);
  if (parts.trajectories.size() + parts.controllers.size() + parts.terminations.size() == 0) {
    throw PluginError(fmt::format("{}: has no parts in it", path));
  }
  join(path, std::move(parts.trajectories), trajectories());
  join(path, std::move(parts.controllers), controllers());
  join(path, std::move(parts.terminations), terminations());
}

void try_parts(const std::vector<std::string>& paths) {
  if (paths.empty()) return;
  int said[2];
  if (pipe(said) != 0) throw PluginError(fmt::format("pipe: {}", std::strerror(errno)));
  const pid_t child = fork();
  if (child < 0) throw PluginError(fmt::format("fork: {}", std::strerror(errno)));
  if (child == 0) {
    dup2(said[1], STDERR_FILENO);
    dup2(said[1], STDOUT_FILENO);
    std::string why;
    for (const auto& path : paths) {
      try {
        // In front of what the library writes, for when this is the last.
        const std::string line = path + "\1\n";
        if (write(said[1], line.data(), line.size()) < 0) _exit(2);
        load_parts(path);
      } catch (const std::exception& error) {
        why = "\2" + std::string(error.what());
        if (write(said[1], why.data(), why.size()) < 0) _exit(2);
        _exit(EXIT_FAILURE);
      }
    }
    _exit(EXIT_SUCCESS);
  }
  close(said[1]);
  std::string text;
  char bytes[4096];
  const auto deadline = std::chrono::steady_clock::now() + kLoadTime;
  bool in_time = true;
  for (ssize_t size = 1; size > 0 && in_time;) {
    pollfd ready{said[0], POLLIN, 0};
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - std::chrono::steady_clock::now());
    in_time = left.count() > 0 && poll(&ready, 1, static_cast<int>(left.count())) > 0;
    if (in_time && (size = ::read(said[0], bytes, sizeof bytes)) > 0) text.append(bytes, size);
  }
  if (!in_time) kill(child, SIGKILL);
  close(said[0]);
  int status = 0;
  waitpid(child, &status, 0);
  if (status == 0) return;
  if (const auto why = text.find('\2'); why != std::string::npos) throw PluginError(in_one_line(text.substr(why + 1)));
  const auto end = text.rfind("\1\n");
  const auto begin = text.rfind('\n', end - 1) == std::string::npos || end == 0 ? 0 : text.rfind('\n', end - 1) + 1;
  const int signal = WIFSIGNALED(status) ? WTERMSIG(status) : 0;
  if (!in_time) {
    throw PluginError(fmt::format("{}: has not come to an end of being loaded after {} s", text.substr(begin, end - begin),
                                  kLoadTime.count()));
  }
  throw PluginError(fmt::format("{}: ends the process that loads it ({}){}{}", text.substr(begin, end - begin),
                                signal != 0 ? fmt::format("signal {}, {}", signal, strsignal(signal)) : "it exits",
                                end + 2 < text.size() ? ": " : "", in_one_line(text.substr(end + 2))));
}

}  // namespace server
