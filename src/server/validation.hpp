#pragma once

#include <google/protobuf/message.h>

namespace server {

// Checks a message and all messages in it by the rules of their fields (wire/proto/rules.proto), and
// fills in what rules say for repeated fields that are not given. NaN and infinity are refused
// everywhere, and so is what this server does not know: fields and enum values of a newer client.
// Does not look into an Any. Throws Refused (INVALID_ARGUMENT) which names message, field and element,
// what was received, and what was expected in which unit.
void validate(google::protobuf::Message& message);

}  // namespace server
