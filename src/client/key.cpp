#include "client/key.hpp"

#include <google/protobuf/util/json_util.h>
#include <sys/stat.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <utility>

namespace client {
namespace {

std::string of_environment(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

std::string usual_file() {
  const std::string config = of_environment("XDG_CONFIG_HOME");
  return (config.empty() ? of_environment("HOME") + "/.config" : config) + "/frankapy/key.json";
}

}  // namespace

std::optional<Key> Key::find(const std::string& file) {
  if (!file.empty()) return Key(file);
  if (const std::string variable = of_environment("FRANKAPY_KEY"); !variable.empty()) return Key(variable);
  return std::filesystem::exists(usual_file()) ? std::optional(Key(usual_file())) : std::nullopt;
}

Key::Key(std::string file) : file_(std::move(file)) {
  struct stat status {};
  std::ifstream in(file_);
  const std::string text(std::istreambuf_iterator<char>(in), {});
  if (stat(file_.c_str(), &status) != 0 || !google::protobuf::util::JsonStringToMessage(text, &content_).ok()) {
    throw std::invalid_argument(file_ + ": cannot be read as a key: expected a file that `frankapy keys add` has made");
  }
  if ((status.st_mode & (S_IRWXG | S_IRWXO)) != 0) {
    throw std::invalid_argument(file_ + ": others can read or change it: `chmod 600` it, or have a new key made");
  }
}

void Key::use_for(zmq::socket_t& socket) const {
  try {
    socket.set(zmq::sockopt::curve_publickey, content_.public_key());
    socket.set(zmq::sockopt::curve_secretkey, content_.secret_key());
    socket.set(zmq::sockopt::curve_serverkey, content_.server_key());
  } catch (const zmq::error_t&) {
    throw std::invalid_argument(file_ + ": has no keys in it: expected a file that `frankapy keys add` has made");
  }
}

}  // namespace client
