#include "server/sensor_samples.hpp"

#include <google/protobuf/dynamic_message.h>
#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <limits>
#include <memory>

#include "frankapy/proto/rules.pb.h"
#include "frankapy/proto/sensors.pb.h"
#include "wire/proto/validation.hpp"

namespace server {
namespace {

namespace proto = frankapy::proto;
using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using realtime::SensorSample;

constexpr int kMostOfChunk = 200;

bool is_number(const FieldDescriptor* field) {
  return field->cpp_type() != FieldDescriptor::CPPTYPE_STRING && field->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE;
}

double number(const Message& message, const FieldDescriptor* field, int i) {
  if (field->cpp_type() != FieldDescriptor::CPPTYPE_ENUM) return wire::number(message, field, i);
  const auto& get = *message.GetReflection();
  return field->is_repeated() ? get.GetRepeatedEnumValue(message, field, i) : get.GetEnumValue(message, field);
}

SensorSample flattened(const Message& message) {
  SensorSample sample;
  sample.values.fill(std::numeric_limits<double>::quiet_NaN());
  const auto* descriptor = message.GetDescriptor();
  const auto& get = *message.GetReflection();
  std::size_t at = 0;
  for (int f = 0; f < descriptor->field_count(); ++f) {
    const FieldDescriptor* field = descriptor->field(f);
    if (!is_number(field)) continue;
    const auto& rule = field->options().GetExtension(proto::rule);
    const int given = field->is_repeated() ? get.FieldSize(message, field) : get.HasField(message, field) ? 1 : 0;
    const int size = !field->is_repeated() ? 1 : rule.size() != 0 ? static_cast<int>(rule.size()) : given;
    if (at + static_cast<std::size_t>(size) > SensorSample::kMost) {
      throw wire::Invalid(fmt::format("{} has more than {} numbers", descriptor->name(), SensorSample::kMost));
    }
    for (int i = 0; i < given; ++i) sample.values[at + static_cast<std::size_t>(i)] = number(message, field, i);
    at += static_cast<std::size_t>(size);
  }
  return sample;
}

// Of N numbers for each of the times.
template <class Fill>
std::vector<SensorSample> chunk(const std::string& name, const google::protobuf::RepeatedField<double>& times, Fill fill) {
  if (times.empty() || times.size() > kMostOfChunk) {
    throw wire::Invalid(fmt::format("{}.times has {} elements: expected 1 to {}", name, times.size(), kMostOfChunk));
  }
  std::vector<SensorSample> samples(static_cast<std::size_t>(times.size()));
  for (int i = 0; i < times.size(); ++i) {
    if (i > 0 && times[i] <= times[i - 1]) {
      throw wire::Invalid(fmt::format("{}.times[{}] is {}: expected more than the time before, {}", name, i, times[i],
                                      times[i - 1]));
    }
    SensorSample& sample = samples[static_cast<std::size_t>(i)];
    sample.lead = times[i];
    sample.replaces = i == 0;
    fill(i, sample);
  }
  return samples;
}

void require_size(const std::string& field, int size, int expected) {
  if (size != expected) throw wire::Invalid(fmt::format("{} has {} elements: expected {}", field, size, expected));
}

std::vector<SensorSample> samples_of(const proto::JointChunk& message) {
  require_size("JointChunk.joints", message.joints_size(), 7 * message.times_size());
  return chunk("JointChunk", message.times(), [&](int i, SensorSample& sample) {
    std::copy_n(message.joints().data() + 7 * i, 7, sample.values.begin());
  });
}

std::vector<SensorSample> samples_of(const proto::PoseChunk& message) {
  require_size("PoseChunk.positions", message.positions_size(), 3 * message.times_size());
  require_size("PoseChunk.quaternions", message.quaternions_size(), 4 * message.times_size());
  return chunk("PoseChunk", message.times(), [&](int i, SensorSample& sample) {
    const double* q = message.quaternions().data() + 4 * i;
    const double norm = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    if (std::abs(norm - 1) > 1e-3) {
      throw wire::Invalid(fmt::format("PoseChunk.quaternions: number {} has the norm {:.6g}: expected 1", i, norm));
    }
    std::copy_n(message.positions().data() + 3 * i, 3, sample.values.begin());
    std::copy_n(q, 4, sample.values.begin() + 3);
  });
}

}  // namespace

std::vector<SensorSample> samples_of(const google::protobuf::Any& any) {
  const std::string name = any.type_url().substr(any.type_url().rfind('/') + 1);
  const auto* descriptor = google::protobuf::DescriptorPool::generated_pool()->FindMessageTypeByName(name);
  if (descriptor == nullptr) throw wire::Invalid(fmt::format("\"{}\" is no message that this server knows", name));
  const std::unique_ptr<Message> message(
      google::protobuf::MessageFactory::generated_factory()->GetPrototype(descriptor)->New());
  if (!message->ParseFromString(any.value())) {
    throw wire::Invalid(fmt::format("{} bytes that are no {}", any.value().size(), descriptor->name()));
  }
  wire::validate(*message);
  if (const auto* joints = dynamic_cast<const proto::JointChunk*>(message.get())) return samples_of(*joints);
  if (const auto* poses = dynamic_cast<const proto::PoseChunk*>(message.get())) return samples_of(*poses);
  return {flattened(*message)};
}

}  // namespace server
