#include "server/keys.hpp"

#include <arpa/inet.h>
#include <google/protobuf/util/json_util.h>
#include <spdlog/spdlog.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <iterator>
#include <utility>

#include "server/config.hpp"

namespace server {
namespace {

namespace proto = frankapy::proto;

constexpr std::size_t kKeySize = 40;  // characters of Z85
constexpr char kOwnFile[] = "server.json", kClientsFile[] = "clients.json";

bool is_key(const std::string& text) {
  std::array<std::uint8_t, 32> bytes{};
  return text.size() == kKeySize && zmq_z85_decode(bytes.data(), text.c_str()) != nullptr;
}

// `forbidden`: what others must not be allowed to do with it.
void read(const std::filesystem::path& path, mode_t forbidden, google::protobuf::Message& message) {
  struct stat status {};
  if (stat(path.c_str(), &status) != 0) {
    throw ConfigError(fmt::format("{}: cannot be read ({}): expected a file that `frankapy keys new` has written", path.string(),
                                  std::strerror(errno)));
  }
  if ((status.st_mode & forbidden) != 0) {
    throw ConfigError(fmt::format("{}: others can read or change it (mode {:03o}): `chmod 600` it, or make new keys (`frankapy keys "
                                  "new`) where somebody may have done so",
                                  path.string(), status.st_mode & 0777));
  }
  if (status.st_uid != 0 && status.st_uid != geteuid()) {
    throw ConfigError(fmt::format("{}: belongs to another user (number {}): expected this one, or root", path.string(), status.st_uid));
  }
  std::ifstream file(path);
  if (!file) throw ConfigError(fmt::format("{}: cannot be read: {}", path.string(), std::strerror(errno)));
  const std::string text(std::istreambuf_iterator<char>(file), {});
  if (!file || !google::protobuf::util::JsonStringToMessage(text, &message).ok()) {
    throw ConfigError(fmt::format("{}: cannot be read as a {}: expected a file that `frankapy keys` has written", path.string(),
                                  message.GetTypeName()));
  }
}

// Or others could put their files in the place of its own.
void require_own(const std::filesystem::path& folder) {
  struct stat status {};
  if (stat(folder.c_str(), &status) == 0 && (status.st_mode & (S_IWGRP | S_IWOTH)) != 0) {
    throw ConfigError(fmt::format("{}: others can write into it (mode {:03o}): `chmod 700` it, and look who its clients are (`frankapy "
                                  "keys list`)",
                                  folder.string(), status.st_mode & 0777));
  }
}

std::string version_of(const std::filesystem::path& path) {
  struct stat status {};
  if (stat(path.c_str(), &status) != 0) return "";
  // ctime: whose it is may change alone.
  return fmt::format("{} {} {}.{}", status.st_dev, status.st_ino, status.st_ctim.tv_sec, status.st_ctim.tv_nsec);
}

bool is_this_computer(const std::string& listen) {
  in_addr address;
  return inet_pton(AF_INET, listen.c_str(), &address) == 1 && (ntohl(address.s_addr) >> 24) == 127;
}

}  // namespace

Keys::Keys(std::filesystem::path folder) : folder_(std::move(folder)) {
  require_own(folder_);
  const auto file = folder_ / kOwnFile;
  read(file, S_IRWXG | S_IRWXO, own_);
  std::array<char, kKeySize + 1> derived{};
  if (!is_key(own_.secret_key()) || zmq_curve_public(derived.data(), own_.secret_key().c_str()) != 0 ||
      own_.public_key() != derived.data()) {
    throw ConfigError(fmt::format("{}: public_key and secret_key are no pair: `frankapy keys new` makes one", file.string()));
  }
  seen_ = version_of(folder_ / kClientsFile);
  clients_ = read_clients();
}

Keys::Clients Keys::read_clients() const {
  const auto file = folder_ / kClientsFile;
  Clients clients;
  if (!std::filesystem::exists(file)) return clients;
  proto::KnownClients known;
  read(file, S_IWGRP | S_IWOTH, known);
  for (const auto& client : known.clients()) {
    if (!is_key(client.public_key()) || client.name().empty() || client.role() == proto::NOBODY) {
      throw ConfigError(fmt::format("{}: the client \"{}\" lacks a name, a role (READ, USER, LAB) or a public key of {} characters",
                                    file.string(), client.name(), kKeySize));
    }
    clients[client.public_key()] = {client.public_key(), client.name(), client.role()};
  }
  return clients;
}

Keys::Client Keys::find(const std::string& key) const {
  const std::lock_guard lock(mutex_);
  const auto known = clients_.find(key);
  return known == clients_.end() ? Client{key, "", proto::NOBODY} : known->second;
}

bool Keys::knows_name(const std::string& name) const {
  const std::lock_guard lock(mutex_);
  return std::any_of(clients_.begin(), clients_.end(), [&](const auto& each) { return each.second.name == name; });
}

void Keys::refresh() {
  const std::string version = version_of(folder_ / kClientsFile);
  if (version == seen_) return;
  seen_ = version;
  try {
    Clients clients = read_clients();
    const std::lock_guard lock(mutex_);
    clients_ = std::move(clients);
  } catch (const std::exception& error) {
    spdlog::error("{}; who was known before is known still", error.what());
  }
}

std::unique_ptr<Keys> keys_for(const std::string& listen, const std::string& folder) {
  if (!folder.empty()) return std::make_unique<Keys>(folder);
  if (is_this_computer(listen)) return nullptr;
  const std::filesystem::path usual = config_folder() + "/franka-interface/keys";
  if (std::filesystem::exists(usual)) return std::make_unique<Keys>(usual);
  throw ConfigError(fmt::format("not without keys at {}: whoever reached it could move the arms. `frankapy keys new` makes the "
                                "server's, `frankapy keys add NAME --role user` one for each client (docs/keys.md). Or listen on "
                                "127.0.0.1",
                                listen));
}

void guard(zmq::socket_t& socket, const Keys& keys) {
  socket.set(zmq::sockopt::curve_server, true);
  socket.set(zmq::sockopt::curve_secretkey, keys.own().secret_key());
  socket.set(zmq::sockopt::zap_domain, "franka-interface");
}

Keys::Client sender_of(const zmq::message_t& message, const Keys* keys) {
  if (keys == nullptr) return {"", "", proto::USER};
  const char* key = zmq_msg_gets(const_cast<zmq::message_t&>(message).handle(), "User-Id");  // as the Doorkeeper has said
  return keys->find(key == nullptr ? "" : key);
}

}  // namespace server
