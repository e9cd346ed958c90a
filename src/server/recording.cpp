#include "server/recording.hpp"

#include <google/protobuf/any.pb.h>
#include <google/protobuf/descriptor.h>
#include <google/protobuf/descriptor.pb.h>

#include <algorithm>
#include <set>

#include "server/clocks.hpp"
#include "server/convert.hpp"

namespace server {
namespace {

namespace pb = google::protobuf;

constexpr std::int64_t kCycle = 1'000'000;  // ns
constexpr std::size_t kMostChannels = 1000;

// The number of the record to begin with.
std::uint64_t first_of(const BlackBox& box, const Recording::Options& options) {
  const std::uint64_t then = options.then.value_or(box.records.written());
  return then - std::min(options.past, then);
}

// When the newest state came, which may be long ago where a black box was left.
std::int64_t newest_ns(const BlackBox& box, std::int64_t now) {
  realtime::Record record;
  const std::uint64_t written = box.records.written();
  return written > 0 && box.records.read(written - 1, record) ? std::min(record.received_ns, now) : now;
}

// The type's file and all that it imports, each after its own imports.
std::string descriptors_of(const pb::Descriptor& type) {
  pb::FileDescriptorSet set;
  std::set<const pb::FileDescriptor*> seen;
  const auto add = [&](const pb::FileDescriptor& file, const auto& self) -> void {
    if (!seen.insert(&file).second) return;
    for (int i = 0; i < file.dependency_count(); ++i) self(*file.dependency(i), self);
    file.CopyTo(set.add_file());
  };
  add(*type.file(), add);
  return set.SerializeAsString();
}

}  // namespace

Recording::Recording(const BlackBox& box, const std::filesystem::path& path, const Options& options,
                     const McapWriter::Metadata& about)
    : box_(box),
      path_(path),
      options_(options),
      file_(path),
      records_(box.records, first_of(box, options)),
      place_(options.place.value_or(options.past > 0 ? box.journal.begin() : box.journal.end())) {
  file_.add_metadata("recording", about);
  flushed_ns_ = now_ns();
  if (options.place) return;
  const std::uint64_t written = box.records.written();
  oldest_ns_ = newest_ns(box, flushed_ns_) -
               static_cast<std::int64_t>(options.past + written - options.then.value_or(written)) * kCycle;
}

void Recording::write() {
  // What there is now: on a slow disk more comes than is written, without end.
  const std::uint64_t end = box_.records.written(), noted = box_.journal.end();
  while (records_.position() < end && records_.next(record_)) write(record_);
  while (place_ < noted && box_.journal.read(place_, entry_, lost_bytes_)) {
    if (entry_.time_ns >= oldest_ns_) write(entry_);
  }
  if (const std::int64_t now = now_ns(); now - flushed_ns_ >= kFlush) {
    file_.flush();
    flushed_ns_ = now_ns();
  }
}

void Recording::close() {
  file_.add_metadata("end", {{"states", std::to_string(states_)},
                             {"lost", std::to_string(lost())},
                             {"lost_bytes", std::to_string(lost_bytes())}});
  file_.close();
}

void Recording::write(const realtime::Record& record) {
  if (record.phase == realtime::Phase::kIdle && record.cycles % options_.idle_step != 0) return;
  convert(record, state_);
  state_.SerializeToString(&bytes_);
  const std::int64_t time = since_epoch_ns(record.received_ns);
  file_.write(channel("/states", state_.GetTypeName()), static_cast<std::uint32_t>(record.cycles), time, time, bytes_);
  if (states_ == 0) first_ns_ = record.received_ns;
  last_ns_ = record.received_ns;
  ++states_;
}

void Recording::write(const Journal::Entry& entry) {
  const std::int64_t time = since_epoch_ns(entry.time_ns);
  const std::uint16_t to = channel(entry.topic, entry.type);
  if (to == 0) {
    lost_bytes_ += entry.bytes.size();
  } else {
    file_.write(to, entry.sequence, time, entry.sent_ns != 0 ? entry.sent_ns : time, entry.bytes);
  }
}

// 0 for a sensor topic too many: publishers may name as many as they like.
std::uint16_t Recording::channel(const std::string& topic, const std::string& type) {
  const std::string name = topic + '\n' + type;
  if (const auto known = channels_.find(name); known != channels_.end()) return known->second;
  if (channels_.size() >= kMostChannels && topic.starts_with("/sensors/")) return 0;
  const auto [schema, schema_is_new] = schemas_.try_emplace(type, 0);
  if (schema_is_new) {
    const auto* descriptor = pb::DescriptorPool::generated_pool()->FindMessageTypeByName(type);
    // Of a part that only the arm's process had loaded: its name at least.
    schema->second = file_.add_schema(type, descriptor != nullptr ? descriptors_of(*descriptor) : "");
  }
  return channels_[name] = file_.add_channel(schema->second, topic);
}

}  // namespace server
