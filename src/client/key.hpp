#pragma once

#include <optional>
#include <string>
#include <zmq.hpp>

#include "frankapy/proto/keys.pb.h"

namespace client {

// The key with which a program connects to a server that has keys (docs/keys.md).
class Key {
 public:
  // Of that file; where it is empty of $FRANKAPY_KEY, else of frankapy/key.json in the user's configuration; none where there is
  // none. Throws std::invalid_argument for a file that is no key, or that others can read.
  static std::optional<Key> find(const std::string& file);

  const std::string& file() const { return file_; }

  // For a socket that is not connected yet: it then connects to nobody but the key's server.
  void use_for(zmq::socket_t& socket) const;

 private:
  explicit Key(std::string file);

  std::string file_;
  frankapy::proto::ClientKey content_;
};

}  // namespace client
