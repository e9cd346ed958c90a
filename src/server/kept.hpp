#pragma once

#include <google/protobuf/message.h>

namespace server {

// A message in an open file that outlives this process (make_memory_file()); with fd -1 there is none, and nothing is done.

// False, and the message is empty, where what is there cannot be read.
bool load(int fd, google::protobuf::Message& message);

// Throws std::system_error.
void save(int fd, const google::protobuf::Message& message);

}  // namespace server
