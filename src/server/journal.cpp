#include "server/journal.hpp"

#include <algorithm>
#include <cstring>
#include <new>
#include <utility>

#include "server/clocks.hpp"

namespace server {
namespace {

// Before topic, type and bytes.
struct EntryHead {
  std::int64_t time_ns, sent_ns;
  std::uint32_t sequence, topic, type, bytes;  // sizes

  std::size_t size() const { return sizeof(EntryHead) + topic + type + bytes; }
};

}  // namespace

Journal::Journal(std::shared_ptr<void> memory, int)
    : memory_(std::move(memory)),
      header_(static_cast<Header*>(memory_.get())),
      bytes_(static_cast<char*>(memory_.get()) + sizeof(Header)),
      mutex_(std::make_unique<std::mutex>()) {}

Journal::Journal(std::shared_ptr<void> memory) : Journal(std::move(memory), 0) { new (header_) Header; }

Journal Journal::found(std::shared_ptr<void> memory) { return Journal(std::move(memory), 0); }

void Journal::put(std::uint64_t place, const void* from, std::size_t size) {
  const std::size_t at = place % kBytes, first = std::min(size, kBytes - at);
  std::memcpy(bytes_ + at, from, first);
  std::memcpy(bytes_, static_cast<const char*>(from) + first, size - first);
}

void Journal::get(std::uint64_t place, void* to, std::size_t size) const {
  const std::size_t at = place % kBytes, first = std::min(size, kBytes - at);
  std::memcpy(to, bytes_ + at, first);
  std::memcpy(static_cast<char*>(to) + first, bytes_, size - first);
}

void Journal::note(std::string_view topic, std::string_view type, std::string_view bytes, std::uint32_t sequence,
                   std::int64_t sent_ns) {
  const EntryHead head{now_ns(), sent_ns, sequence, static_cast<std::uint32_t>(topic.size()),
                       static_cast<std::uint32_t>(type.size()), static_cast<std::uint32_t>(bytes.size())};
  if (head.size() > kBytes) return;
  const std::lock_guard lock(*mutex_);
  const std::uint64_t end = header_->end;
  std::uint64_t begin = header_->begin;
  while (end + head.size() - begin > kBytes) {
    EntryHead oldest;
    get(begin, &oldest, sizeof oldest);
    begin += oldest.size();
  }
  // In this order: a process that ends on the way leaves whole entries.
  header_->begin = begin;
  std::uint64_t place = end;
  const auto append = [&](const void* from, std::size_t size) {
    put(place, from, size);
    place += size;
  };
  append(&head, sizeof head);
  append(topic.data(), topic.size());
  append(type.data(), type.size());
  append(bytes.data(), bytes.size());
  header_->end = place;
}

std::uint64_t Journal::end() const { return header_->end; }
std::uint64_t Journal::begin() const { return header_->begin; }

bool Journal::read(std::uint64_t& place, Entry& entry, std::uint64_t& lost) const {
  const std::lock_guard lock(*mutex_);
  if (const std::uint64_t begin = header_->begin; place < begin) {
    lost += begin - place;
    place = begin;
  }
  const std::uint64_t end = header_->end;
  if (place >= end) return false;
  EntryHead head;
  get(place, &head, sizeof head);
  // Overwritten by what its process died of: where another entry would begin is not known.
  if (end - place > kBytes || head.size() > end - place) {
    lost += end - place;
    place = end;
    return false;
  }
  entry.time_ns = head.time_ns;
  entry.sent_ns = head.sent_ns;
  entry.sequence = head.sequence;
  std::uint64_t at = place + sizeof head;
  const std::pair<std::string*, std::uint32_t> texts[] = {
      {&entry.topic, head.topic}, {&entry.type, head.type}, {&entry.bytes, head.bytes}};
  for (const auto& [text, size] : texts) {
    text->resize(size);
    get(at, text->data(), size);
    at += size;
  }
  place = at;
  return true;
}

}  // namespace server
