#include "wire/proto/validation.hpp"

#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <string>

#include "frankapy/proto/rules.pb.h"

namespace wire {
namespace {

namespace proto = frankapy::proto;
using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using google::protobuf::Reflection;

constexpr double kUnitNormTolerance = 1e-3;

[[noreturn]] void refuse(const std::string& text) { throw Invalid(text); }

std::string full_name(const Message& message, const FieldDescriptor* field) {
  return message.GetDescriptor()->name() + "." + field->name();
}

std::string unit_of(const proto::FieldRule& rule) {
  return rule.unit().empty() ? "" : " " + rule.unit();
}

std::string in_brackets(const proto::FieldRule& rule) {
  return rule.unit().empty() ? "" : " (" + rule.unit() + ")";
}

std::string range_of(const proto::FieldRule& rule) {
  if (rule.has_min() && rule.has_max()) {
    return fmt::format("{} to {}{}", rule.min(), rule.max(), unit_of(rule));
  }
  if (rule.has_min()) return fmt::format("at least {}{}", rule.min(), unit_of(rule));
  return fmt::format("at most {}{}", rule.max(), unit_of(rule));
}

bool keeps(double value, const proto::FieldRule& rule) {
  return std::isfinite(value) && !(rule.has_min() && value < rule.min()) && !(rule.has_max() && value > rule.max());
}

void check_value(const std::string& name, double value, const proto::FieldRule& rule) {
  if (!std::isfinite(value)) {
    refuse(fmt::format("{} is {}: expected a finite number{}", name, value, in_brackets(rule)));
  }
  if ((rule.has_min() && value < rule.min()) || (rule.has_max() && value > rule.max())) {
    refuse(fmt::format("{} is {}{}: expected {}", name, value, unit_of(rule), range_of(rule)));
  }
}

std::string size_of(const proto::FieldRule& rule) {
  if (rule.row() != 0) return fmt::format("rows of {}", rule.row());
  return rule.size() != 0 ? std::to_string(rule.size()) : "at least 1";
}

// UTF-8 without NUL, which would end it where it goes on to: to other clients, to the log, into messages of errors.
bool is_text(const std::string& text) {
  for (std::size_t i = 0; i < text.size();) {
    const auto lead = static_cast<unsigned char>(text[i]);
    const int more = lead < 0x80 ? 0 : lead >> 5 == 0x6 ? 1 : lead >> 4 == 0xE ? 2 : lead >> 3 == 0x1E ? 3 : -1;
    if (lead == 0 || more < 0 || text.size() - i <= static_cast<std::size_t>(more)) return false;
    unsigned code = more == 0 ? lead : lead & (0x3F >> more);
    for (int k = 1; k <= more; ++k) {
      const auto next = static_cast<unsigned char>(text[i + k]);
      if (next >> 6 != 0x2) return false;
      code = code << 6 | (next & 0x3F);
    }
    constexpr unsigned kSmallest[] = {0, 0x80, 0x800, 0x10000};
    if (code < kSmallest[more] || code > 0x10FFFF || (code >= 0xD800 && code < 0xE000)) return false;
    i += more + 1;
  }
  return true;
}

void check_known(const Message& message) {
  const auto& unknown = message.GetReflection()->GetUnknownFields(message);
  if (unknown.empty()) return;
  const auto* descriptor = message.GetDescriptor();
  std::string known;
  for (int i = 0; i < descriptor->field_count(); ++i) {
    known += (i == 0 ? "" : ", ") + descriptor->field(i)->name();
  }
  const int field = unknown.field(0).number();
  if (const auto* of_enum = descriptor->FindFieldByNumber(field)) {
    refuse(fmt::format("{}.{} has a value that this program does not know: is the client newer? Install the same "
                       "version of both",
                       descriptor->name(), of_enum->name()));
  }
  refuse(fmt::format("{} has a field number {} that this program does not know; known are: {}. Is the client "
                     "newer? Install the same version of both",
                     descriptor->name(), field, known.empty() ? "none" : known));
}

void check_repeated_numbers(Message& message, const FieldDescriptor* field, const proto::FieldRule& rule) {
  const Reflection& reflection = *message.GetReflection();
  const std::string name = full_name(message, field);
  int size = reflection.FieldSize(message, field);
  if (size == 0 && rule.initial_size() > 0) {
    for (double value : rule.initial()) reflection.AddDouble(&message, field, value);
    size = rule.initial_size();
  }
  if (size == 0 && !rule.required()) return;
  const int row = static_cast<int>(rule.row());
  if (rule.size() != 0 ? size != static_cast<int>(rule.size()) : size == 0 || (row != 0 && size % row != 0)) {
    refuse(fmt::format("{} has {} elements: expected {}{}", name, size, size_of(rule), in_brackets(rule)));
  }
  if (row != 0 && rule.has_max_rows() && size / row > static_cast<int>(rule.max_rows())) {
    refuse(fmt::format("{} has {} rows: expected at most {}", name, size / row, rule.max_rows()));
  }
  double squares = 0;
  for (int i = 0; i < size; ++i) {
    const double value = number(message, field, i);
    if (!keeps(value, rule)) check_value(fmt::format("{}[{}]", name, i), value, rule);
    squares += value * value;
    const bool row_ends = row != 0 ? (i + 1) % row == 0 : i + 1 == size;
    if (!row_ends) continue;
    if (rule.unit_norm() && std::abs(std::sqrt(squares) - 1) > kUnitNormTolerance) {
      refuse(fmt::format("{}{} has the norm {:.6g}: expected a unit quaternion{}, 1 within {}",
                         row != 0 ? fmt::format("row {} of ", i / row) : "", name, std::sqrt(squares), in_brackets(rule),
                         kUnitNormTolerance));
    }
    squares = 0;
  }
}

void check_text(const Message& message, const FieldDescriptor* field, const proto::FieldRule& rule) {
  if (field->type() != FieldDescriptor::TYPE_STRING) return;
  const Reflection& get = *message.GetReflection();
  if (rule.required() && !field->is_repeated() && get.GetString(message, field).empty()) {
    refuse(full_name(message, field) + " is missing: expected a text");
  }
  const int count = field->is_repeated() ? get.FieldSize(message, field) : 1;
  for (int i = 0; i < count; ++i) {
    const std::string text = field->is_repeated() ? get.GetRepeatedString(message, field, i)
                                                  : get.GetString(message, field);
    if (!is_text(text)) refuse(full_name(message, field) + " is not UTF-8 text, or has NUL in it");
  }
}

void check_messages(Message& message, const FieldDescriptor* field, const proto::FieldRule& rule) {
  const Reflection& reflection = *message.GetReflection();
  if (field->is_repeated()) {
    for (int i = 0; i < reflection.FieldSize(message, field); ++i) {
      validate(*reflection.MutableRepeatedMessage(&message, field, i));
    }
  } else if (reflection.HasField(message, field)) {
    validate(*reflection.MutableMessage(&message, field));
  } else if (rule.required()) {
    refuse(full_name(message, field) + " is missing");
  }
}

}  // namespace

double number(const Message& message, const FieldDescriptor* field, int i) {
  const Reflection& get = *message.GetReflection();
  const bool repeated = field->is_repeated();
  switch (field->cpp_type()) {
    case FieldDescriptor::CPPTYPE_DOUBLE:
      return repeated ? get.GetRepeatedDouble(message, field, i) : get.GetDouble(message, field);
    case FieldDescriptor::CPPTYPE_FLOAT:
      return repeated ? get.GetRepeatedFloat(message, field, i) : get.GetFloat(message, field);
    case FieldDescriptor::CPPTYPE_INT32:
      return repeated ? get.GetRepeatedInt32(message, field, i) : get.GetInt32(message, field);
    case FieldDescriptor::CPPTYPE_UINT32:
      return repeated ? get.GetRepeatedUInt32(message, field, i) : get.GetUInt32(message, field);
    case FieldDescriptor::CPPTYPE_INT64:
      return static_cast<double>(repeated ? get.GetRepeatedInt64(message, field, i)
                                          : get.GetInt64(message, field));
    case FieldDescriptor::CPPTYPE_UINT64:
      return static_cast<double>(repeated ? get.GetRepeatedUInt64(message, field, i)
                                          : get.GetUInt64(message, field));
    case FieldDescriptor::CPPTYPE_BOOL:
      return repeated ? get.GetRepeatedBool(message, field, i) : get.GetBool(message, field);
    default: return 0;  // enum: every value that could be read is one
  }
}

void validate(Message& message) {
  check_known(message);
  const auto* descriptor = message.GetDescriptor();
  for (int i = 0; i < descriptor->field_count(); ++i) {
    const FieldDescriptor* field = descriptor->field(i);
    const proto::FieldRule& rule = field->options().GetExtension(proto::rule);
    if (field->cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE) {
      check_messages(message, field, rule);
    } else if (field->cpp_type() == FieldDescriptor::CPPTYPE_STRING) {
      check_text(message, field, rule);
    } else if (field->is_repeated()) {
      check_repeated_numbers(message, field, rule);
    } else if (message.GetReflection()->HasField(message, field)) {
      check_value(full_name(message, field), number(message, field, 0), rule);
    } else if (rule.required()) {
      refuse(fmt::format("{} is missing: expected a number{}", full_name(message, field), in_brackets(rule)));
    }
  }
}

void unpack(const google::protobuf::Any& any, Message& message) {
  if (!any.UnpackTo(&message)) {
    refuse(fmt::format("{} bytes that are no {}", any.value().size(), message.GetDescriptor()->name()));
  }
  validate(message);
}

}  // namespace wire
