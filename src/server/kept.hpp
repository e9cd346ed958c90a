#pragma once

#include <google/protobuf/message.h>

#include <string>

namespace server {

// A message in a file that outlives this process: an open one (make_memory_file()), or one of that path, which may not be there
// yet. With fd -1 or an empty path there is none, and nothing is done.

// False, and the message is empty, where what is there cannot be read.
bool load(int fd, google::protobuf::Message& message);
bool load(const std::string& path, google::protobuf::Message& message);

// Whole, or as it was; of an empty message there is no file of a path. Throws std::system_error.
void save(int fd, const google::protobuf::Message& message);
void save(const std::string& path, const google::protobuf::Message& message);

}  // namespace server
