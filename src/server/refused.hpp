#pragma once

#include <stdexcept>
#include <string>

#include "frankapy/proto/service.pb.h"

namespace server {

namespace proto = frankapy::proto;

// A request that is answered with an Error. The text says what was received, what was expected and
// what to do.
class Refused : public std::runtime_error {
 public:
  Refused(proto::Error::Code code, const std::string& message) : runtime_error(message), code(code) {}

  proto::Error::Code code;
};

// What somebody sent is not what was expected.
[[noreturn]] inline void refuse(const std::string& text) { throw Refused(proto::Error::INVALID_ARGUMENT, text); }

}  // namespace server
