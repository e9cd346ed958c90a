#pragma once

#include <google/protobuf/any.pb.h>
#include <google/protobuf/message.h>

#include <stdexcept>

namespace wire {

// The text says what was received, what was expected and what to do.
class Invalid : public std::runtime_error {
 public:
  using runtime_error::runtime_error;
};

// Checks a message and all messages in it by the rules of their fields (wire/proto/rules.proto), and
// fills in what rules say for repeated fields that are not given. NaN and infinity are refused
// everywhere, and so is what this program does not know: fields and enum values of a newer client.
// Does not look into an Any. Throws Invalid which names message, field and element,
// what was received, and what was expected in which unit.
void validate(google::protobuf::Message& message);

// Element `i` of a repeated field, or a field that is not repeated; 0 where it is no number.
double number(const google::protobuf::Message& message, const google::protobuf::FieldDescriptor* field, int i);

// Reads a message out of an Any, and checks it. Throws Invalid; also for bytes that are none.
void unpack(const google::protobuf::Any& any, google::protobuf::Message& message);

}  // namespace wire
