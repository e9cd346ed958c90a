#pragma once

#include <google/protobuf/util/json_util.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <zmq.hpp>

#include "frankapy/proto/keys.pb.h"

namespace server {

// A folder of keys as `frankapy keys` writes it, for as long as a test takes.
class KeyFolder {
 public:
  KeyFolder() {
    std::string name = testing::TempDir() + "keys-XXXXXX";
    if (mkdtemp(name.data()) == nullptr) throw std::runtime_error("mkdtemp");
    path = name;
    const auto [pub, secret] = pair();
    own.set_public_key(pub);
    own.set_secret_key(secret);
    write("server.json", own);
  }
  ~KeyFolder() { std::filesystem::remove_all(path); }
  KeyFolder(const KeyFolder&) = delete;

  static std::array<std::string, 2> pair() {
    std::array<char, 41> pub{}, secret{};
    EXPECT_EQ(zmq_curve_keypair(pub.data(), secret.data()), 0);
    return {pub.data(), secret.data()};
  }

  // A client's pair which the folder knows.
  std::array<std::string, 2> add(const std::string& name, frankapy::proto::Role role) {
    const auto keys = pair();
    auto& client = *clients.add_clients();
    client.set_name(name);
    client.set_role(role);
    client.set_public_key(keys[0]);
    write("clients.json", clients);
    return keys;
  }
  void remove_all() {
    clients.Clear();
    write("clients.json", clients);
  }

  void write(const std::string& file, const google::protobuf::Message& message) const {
    std::string text;
    EXPECT_TRUE(google::protobuf::util::MessageToJsonString(message, &text).ok());
    write(file, text);
  }
  // Whole, as the server may look at any moment.
  void write(const std::string& file, const std::string& text) const {
    std::ofstream(path / "part") << text;
    chmod((path / "part").c_str(), 0600);
    std::filesystem::rename(path / "part", path / file);
  }

  std::filesystem::path path;
  frankapy::proto::ServerKey own;
  frankapy::proto::KnownClients clients;
};

}  // namespace server
