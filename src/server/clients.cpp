#include "server/clients.hpp"

#include <spdlog/spdlog.h>

#include <algorithm>

#include "server/refused.hpp"

namespace server {
namespace {

constexpr std::size_t kMaxClients = 1024;  // remembered

}  // namespace

void Clients::hear(const std::string& client, const std::string& key) {
  const auto known = clients_.find(client);
  if (known != clients_.end() && known->second.key == key) known->second.last_heard = now_;
}

void Clients::come(const Address& from, const std::string& name) {
  if (const auto before = clients_.find(from.client); before != clients_.end() && before->second.key != from.who.key) leave(from);
  if (clients_.size() >= kMaxClients && !clients_.contains(from.client)) {
    const auto oldest = std::min_element(clients_.begin(), clients_.end(), [](const auto& a, const auto& b) {
      return a.second.last_heard < b.second.last_heard;
    });
    clients_.erase(oldest);
  }
  const std::string key = from.who.name.empty() ? "" : from.who.name + ": ";
  clients_[from.client] = {key + name.substr(0, 256), from.who.key, now_, {}};
}

void Clients::leave(const Address& from) {
  clients_.erase(from.client);
  if (commander_ == from.client) commander_.clear();
}

Clients::Client& Clients::known(const Address& from) {
  const auto client = clients_.find(from.client);
  if (client == clients_.end() || client->second.key != from.who.key) {
    throw Refused(proto::Error::UNKNOWN_CLIENT,
                  "this client has not said Hello, or the arm's process was restarted since: say Hello first");
  }
  return client->second;
}

std::string Clients::name(const Address& from) const {
  const auto client = clients_.find(from.client);
  return client == clients_.end() ? "" : client->second.name;
}

void Clients::require_lease(const Address& from) const {
  if (commander_.empty() || commander_ == from.client) return;
  const auto holder = clients_.find(commander_);
  throw Refused(proto::Error::BUSY,
                fmt::format("another client commands this arm: {}. It is free when that one has ended or said Goodbye",
                            holder == clients_.end() ? "unnamed" : holder->second.name));
}

void Clients::take_lease(const Address& from) {
  if (commander_ == from.client) return;
  commander_ = from.client;
  spdlog::info("{} commands the arm", known(from).name);
}

bool Clients::expire_lease() {
  if (commander_.empty()) return false;
  if (!is_silent(commander_, lease_time_)) return false;
  if (const auto holder = clients_.find(commander_); holder != clients_.end()) {
    spdlog::info("{} is silent: the arm is free", holder->second.name);
  }
  commander_.clear();
  return true;
}

bool Clients::is_silent(const std::string& client, std::chrono::milliseconds time) const {
  const auto known = clients_.find(client);
  return known == clients_.end() || now_ - known->second.last_heard >= time;
}

void Clients::describe(proto::ServerStatus& status) const {
  if (const auto holder = clients_.find(commander_); holder != clients_.end()) status.set_commander(holder->second.name);
  status.set_clients(static_cast<std::uint32_t>(clients_.size()));
}

}  // namespace server
