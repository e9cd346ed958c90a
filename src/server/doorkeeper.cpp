#include "server/doorkeeper.hpp"

#include <spdlog/spdlog.h>

#include <array>
#include <bit>
#include <chrono>
#include <vector>

namespace server {
namespace {

namespace proto = frankapy::proto;

constexpr auto kWait = std::chrono::milliseconds(200);  // after which it is seen that keys have changed
// Frames of a request; the last but one names the mechanism, and CURVE has one of credentials: the key, 32 bytes.
enum Frame { kVersion, kRequestId, kDomain, kAddress, kIdentity, kMechanism, kKey, kFrames };
constexpr std::size_t kKeyBytes = 32;

}  // namespace

Doorkeeper::Doorkeeper(zmq::context_t& context, Keys& keys) : keys_(keys), socket_(context, zmq::socket_type::rep) {
  socket_.set(zmq::sockopt::linger, 0);
  socket_.bind("inproc://zeromq.zap.01");
  thread_ = std::thread([this] { run(); });
}

Doorkeeper::~Doorkeeper() {
  quit_ = true;
  thread_.join();
}

void Doorkeeper::run() {
  while (!quit_) {
    zmq::pollitem_t item{socket_.handle(), 0, ZMQ_POLLIN, 0};
    zmq::poll(&item, 1, kWait);
    keys_.refresh();
    while (!quit_ && answer()) {
    }
  }
}

// False when nobody asks.
bool Doorkeeper::answer() {
  std::vector<zmq::message_t> request;
  do {
    request.emplace_back();
    if (!socket_.recv(request.back(), request.size() == 1 ? zmq::recv_flags::dontwait : zmq::recv_flags::none)) return false;
  } while (request.back().more());
  std::string key;
  if (request.size() == kFrames && request[kMechanism].to_string_view() == "CURVE" && request[kKey].size() == kKeyBytes) {
    std::array<char, kKeyBytes * 5 / 4 + 1> text{};
    zmq_z85_encode(text.data(), request[kKey].data<std::uint8_t>(), kKeyBytes);
    key = text.data();
  }
  const bool known = keys_.find(key).role != proto::NOBODY;
  if (!known) count_refused(request.size() > kAddress ? request[kAddress].to_string() : "");
  const std::string id = request.size() > kRequestId ? request[kRequestId].to_string() : "";
  const std::array<std::string, 6> reply = {"1.0", id, known ? "200" : "400", known ? "" : "unknown key", known ? key : "", ""};
  for (const std::string& frame : reply) {
    socket_.send(zmq::buffer(frame), &frame == &reply.back() ? zmq::send_flags::none : zmq::send_flags::sndmore);
  }
  return true;
}

// Tells of each power of two, so that whoever goes on does not fill the log.
void Doorkeeper::count_refused(const std::string& address) {
  const std::uint64_t count = refused_.fetch_add(1, std::memory_order_relaxed) + 1;
  if (std::has_single_bit(count)) {
    spdlog::warn("a client at {} was refused, as its key is not known ({} like that so far): `frankapy keys add` makes one", address,
                 count);
  }
}

}  // namespace server
