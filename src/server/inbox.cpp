#include "server/inbox.hpp"

#include <google/protobuf/io/coded_stream.h>
#include <spdlog/spdlog.h>

#include <utility>

namespace server {
namespace {

namespace proto = frankapy::proto;

constexpr std::size_t kMostWaiting = 1024;                 // requests; further ones are refused
constexpr std::size_t kMostWaitingBytes = 64 << 20;        // likewise
constexpr int kMostGarbage = 64;                           // messages in a row, and others have their turn
constexpr std::size_t kShort = 16 << 10;                   // bytes of a request that is read at once

// What is urgent is found without reading the rest, which may be megabytes.
Head head_of(const zmq::message_t& frame) {
  constexpr int kFields = 4;  // as a request has at most
  google::protobuf::io::CodedInputStream in(frame.data<std::uint8_t>(), static_cast<int>(frame.size()));
  Head head;
  for (int field = 0; field < kFields; ++field) {
    const std::uint32_t tag = in.ReadTag();
    const int number = static_cast<int>(tag >> 3);
    std::uint64_t value;
    std::uint32_t size;
    if (tag == 0) return head;
    switch (tag & 7) {
      case 0:
        if (!in.ReadVarint64(&value)) return head;
        if (number == proto::Request::kRequestIdFieldNumber) head.request_id = value;
        break;
      case 2:
        if (!in.ReadVarint32(&size) || !in.Skip(static_cast<int>(size))) return head;
        head.call = number;  // the last one counts
        break;
      default: return head;
    }
  }
  if (in.ReadTag() != 0) head.call = proto::Request::CALL_NOT_SET;
  return head;
}

}  // namespace

bool Arrived::is_short() const { return frame.size() <= kShort; }

std::optional<Arrived> Inbox::receive() {
  for (int n = 0; n < kMostGarbage; ++n) {
    zmq::message_t identity, frame;
    if (!socket_.recv(identity, zmq::recv_flags::dontwait)) return std::nullopt;
    int frames = 0;
    bool more = identity.more();
    while (more) {
      zmq::message_t next;
      if (!socket_.recv(next)) return std::nullopt;
      more = next.more();
      if (++frames == 1) frame = std::move(next);
    }
    if (frames == 1) {
      const Head head = head_of(frame);
      Keys::Client who = sender_of(frame, keys_);
      return Arrived{identity.to_string(), std::move(who), std::move(frame), head};
    }
    count_garbage(fmt::format("a message of {} frames (expected one)", frames));
  }
  return std::nullopt;
}

bool Inbox::put(Arrived& arrived) {
  if (waiting_.size() >= kMostWaiting || waiting_bytes_ + arrived.frame.size() > kMostWaitingBytes) return false;
  waiting_bytes_ += arrived.frame.size();
  waiting_.push_back(std::move(arrived));
  return true;
}

std::optional<Arrived> Inbox::take() {
  if (waiting_.empty()) return std::nullopt;
  Arrived next = std::move(waiting_.front());
  waiting_.pop_front();
  waiting_bytes_ -= next.frame.size();
  return next;
}

void Inbox::count_garbage(const std::string& what) {
  const auto count = garbage_.fetch_add(1) + 1;
  if (const auto now = Clock::now(); now - garbage_told_ > std::chrono::seconds(1)) {
    garbage_told_ = now;
    spdlog::warn("dropped {}; {} messages like that so far", what, count);
  }
}

}  // namespace server
