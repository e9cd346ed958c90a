#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <zmq.hpp>

#include "frankapy/proto/keys.pb.h"

namespace server {

// The keys of a server, CurveZMQ's: its own pair, and whom it knows. They are in a folder that `frankapy keys` writes.
class Keys {
 public:
  struct Client {
    std::string key;   // public, Z85; empty: this server has no keys
    std::string name;  // of the key
    frankapy::proto::Role role = frankapy::proto::NOBODY;
  };

  // Throws ConfigError where something of it cannot be read, is no key, or is not only its user's.
  explicit Keys(std::filesystem::path folder);

  const frankapy::proto::ServerKey& own() const { return own_; }
  const std::filesystem::path& folder() const { return folder_; }

  // From any thread: of one that is not known only the key is given.
  Client find(const std::string& key) const;
  bool knows_name(const std::string& name) const;

  // Reads again whom it knows where that has changed; what cannot be read then is told in the log, and changes nothing. For one
  // thread.
  void refresh();

 private:
  using Clients = std::map<std::string, Client>;  // by key

  Clients read_clients() const;

  const std::filesystem::path folder_;
  frankapy::proto::ServerKey own_;
  std::string seen_;  // what tells versions of the file apart
  mutable std::mutex mutex_;
  Clients clients_;
};

// Of a server that listens there: of that folder, else, where others than this computer reach it, of franka-interface/keys in
// the user's configuration. Null: there are none, and none are needed. Throws ConfigError, which says what to do.
std::unique_ptr<Keys> keys_for(const std::string& listen, const std::string& folder);

// Lets only clients whose key is known connect to a socket that is not bound yet. There has to be a Doorkeeper in its context.
void guard(zmq::socket_t& socket, const Keys& keys);

// Who has sent a message that came over such a socket: by the key of the connection, which nobody can claim. Without keys it is
// somebody without a name who may command.
Keys::Client sender_of(const zmq::message_t& message, const Keys* keys);

}  // namespace server
