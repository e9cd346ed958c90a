#include "robot/gripper_client.hpp"

#include <gtest/gtest.h>
#include <netinet/tcp.h>

#include <future>

#include "robot/socket.hpp"
#include "scripted_server.hpp"

namespace {

using namespace std::chrono_literals;
namespace gripper = fci::gripper;
using robot::GripperClient;
using Outcome = GripperClient::Outcome;
using testing_tools::Bytes;
using testing_tools::ScriptedServer;

class ScriptedHand : public ScriptedServer {
 public:
  ScriptedHand() : ScriptedServer(gripper::kPort) {}

  struct Request {
    gripper::Header header;
    Bytes body;
  };
  Request request() {
    Request request;
    fci::read(3, read(gripper::kHeaderSize), request.header);
    if (request.header.size > gripper::kHeaderSize) request.body = read(request.header.size - gripper::kHeaderSize);
    return request;
  }
  template <class Body>
  void answer(const gripper::Header& to, const Body& body, std::size_t padding = 0) {
    const std::size_t size = gripper::kHeaderSize + fci::size_of<Body>(3) + padding;
    Bytes bytes(size);
    fci::write(3, gripper::Header{to.command, to.command_id, static_cast<std::uint32_t>(size)}, bytes);
    fci::write(3, body, std::span(bytes).subspan(gripper::kHeaderSize));
    write(bytes);
  }
  void serve_connect(gripper::ConnectStatus status = gripper::ConnectStatus::kSuccess, std::uint16_t version = 3) {
    accept();
    const Request connect = request();
    EXPECT_EQ(connect.header.command, gripper::Command::kConnect);
    gripper::Connect body;
    fci::read(3, connect.body, body);
    EXPECT_EQ(body.version, 3);
    client_port = body.udp_port;
    answer(connect.header, gripper::ConnectResponse{status, version});
  }
  void send_state(const gripper::State& state) {
    Bytes bytes(gripper::kStateSize);
    fci::write(3, state, bytes);
    send_datagram(bytes);
  }
};

class Gripper : public testing::Test {
 protected:
  void SetUp() override { connect({.connect = 20s, .answer = 20s}); }
  void connect(const robot::GripperTimes& times) {
    client.reset();
    auto side = std::async(std::launch::async, [this] { hand.serve_connect(); });
    client = std::make_unique<GripperClient>(hand.address(), times);
    side.get();
  }
  // What the client makes of a call that the hand answers so.
  template <class Call>
  Outcome outcome(Call call, gripper::Command expected, gripper::Status status) {
    auto result = std::async(std::launch::async, call);
    const auto request = hand.request();
    EXPECT_EQ(request.header.command, expected);
    hand.answer(request.header, gripper::Response{status});
    return result.get();
  }

  ScriptedHand hand;
  std::unique_ptr<GripperClient> client;
};

TEST_F(Gripper, CallsReturnWhatTheHandAnswers) {
  using Status = gripper::Status;
  for (const auto& [status, expected] : {std::pair{Status::kSuccess, Outcome::kSuccess},
                                         {Status::kFail, Outcome::kFailed},
                                         {Status::kUnsuccessful, Outcome::kUnsuccessful},
                                         {Status::kAborted, Outcome::kAborted},
                                         {static_cast<Status>(77), Outcome::kFailed}}) {
    EXPECT_EQ(outcome([&] { return client->homing(); }, gripper::Command::kHoming, status), expected);
    EXPECT_EQ(outcome([&] { return client->move(0.04, 0.1); }, gripper::Command::kMove, status), expected);
    EXPECT_EQ(outcome([&] { return client->grasp({}); }, gripper::Command::kGrasp, status), expected);
    EXPECT_EQ(outcome([&] { return client->stop(); }, gripper::Command::kStop, status), expected);
  }
}

TEST_F(Gripper, RequestsCarryTheirValues) {
  auto result = std::async(std::launch::async, [&] { return client->grasp({0.03, 0.001, 0.002, 0.05, 40}); });
  auto request = hand.request();
  gripper::Grasp grasp;
  ASSERT_EQ(request.body.size(), 40u);
  fci::read(3, request.body, grasp);
  EXPECT_EQ(grasp.width, 0.03);
  EXPECT_EQ(grasp.epsilon_inner, 0.001);
  EXPECT_EQ(grasp.epsilon_outer, 0.002);
  EXPECT_EQ(grasp.speed, 0.05);
  EXPECT_EQ(grasp.force, 40);
  hand.answer(request.header, gripper::Response{}, 3);  // padded
  EXPECT_EQ(result.get(), Outcome::kSuccess);

  result = std::async(std::launch::async, [&] { return client->move(0.06, 0.02); });
  request = hand.request();
  gripper::Move move;
  fci::read(3, request.body, move);
  EXPECT_EQ(move.width, 0.06);
  EXPECT_EQ(move.speed, 0.02);
  hand.answer(request.header, gripper::Response{});
  EXPECT_EQ(result.get(), Outcome::kSuccess);
}

TEST_F(Gripper, StopReachesTheHandWhileAnotherCallWaits) {
  auto moving = std::async(std::launch::async, [&] { return client->move(0.08, 0.01); });
  const auto move = hand.request();
  auto stopping = std::async(std::launch::async, [&] { return client->stop(); });
  const auto stop = hand.request();
  EXPECT_EQ(stop.header.command, gripper::Command::kStop);
  hand.answer(stop.header, gripper::Response{});  // in the other order
  EXPECT_EQ(stopping.get(), Outcome::kSuccess);
  hand.answer(move.header, gripper::Response{gripper::Status::kAborted});
  EXPECT_EQ(moving.get(), Outcome::kAborted);
}

TEST_F(Gripper, CancelEndsAWaitingCall) {
  auto moving = std::async(std::launch::async, [&] { return client->move(0.08, 0.01); });
  hand.request();
  client->cancel();
  EXPECT_EQ(moving.get(), Outcome::kCancelled);
  EXPECT_EQ(client->homing(), Outcome::kCancelled);
}

TEST_F(Gripper, AHandThatGivesNoAnswerEndsTheCallAndNothingElse) {
  using Status = gripper::Status;
  connect({.connect = 20s, .answer = 50ms, .homing = 50ms});
  EXPECT_EQ(client->homing(), Outcome::kSilent);
  EXPECT_EQ(client->move(0.08, 10), Outcome::kSilent);
  EXPECT_EQ(client->grasp({0.03, 0.001, 0.002, 10, 40}), Outcome::kSilent);
  EXPECT_EQ(client->stop(), Outcome::kSilent);
  EXPECT_EQ(client->lost(), "");
  // What comes later is passed over.
  for (int i = 0; i < 4; ++i) hand.answer(hand.request().header, gripper::Response{Status::kFail});
  connect({.connect = 20s, .answer = 20s});
  EXPECT_EQ(outcome([&] { return client->homing(); }, gripper::Command::kHoming, Status::kSuccess), Outcome::kSuccess);
}

using WallTimeGripper = Gripper;

// That of a simulated arm which is slower than time is.
TEST_F(WallTimeGripper, AHandThatMovesIsWaitedFor) {
  connect({.connect = 20s, .answer = 300ms});
  auto moving = std::async(std::launch::async, [&] { return client->move(0.08, 10); });
  const auto request = hand.request();
  for (std::uint32_t i = 1; i <= 100; ++i) {
    hand.send_state({i, 2e-4 * i, 0.08, false, 31});
    std::this_thread::sleep_for(10ms);
  }
  hand.answer(request.header, gripper::Response{gripper::Status::kSuccess});
  EXPECT_EQ(moving.get(), Outcome::kSuccess);
}

TEST_F(Gripper, ALostConnectionEndsAWaitingCall) {
  auto moving = std::async(std::launch::async, [&] { return client->move(0.08, 0.01); });
  hand.request();
  hand.hang_up();
  EXPECT_EQ(moving.get(), Outcome::kLost);
  EXPECT_EQ(client->homing(), Outcome::kLost);
  EXPECT_NE(client->lost(), "");
  EXPECT_FALSE(client->state());
}

TEST_F(Gripper, GarbageEndsTheConnection) {
  hand.write(Bytes(64, std::byte{0xCD}));
  while (client->lost().empty()) std::this_thread::sleep_for(1ms);
  EXPECT_NE(client->lost().find("garbage"), std::string::npos);
}

TEST_F(Gripper, AnswersInPiecesAreOne) {
  auto moving = std::async(std::launch::async, [&] { return client->homing(); });
  const auto request = hand.request();
  Bytes bytes(gripper::kHeaderSize + 2);
  fci::write(3, gripper::Header{request.header.command, request.header.command_id, 12}, bytes);
  for (const std::byte& byte : bytes) {
    hand.write(std::span(&byte, 1));
    std::this_thread::sleep_for(1ms);
  }
  EXPECT_EQ(moving.get(), Outcome::kSuccess);
}

TEST_F(Gripper, KeepsTheNewestStateAndDropsWhatIsNone) {
  EXPECT_FALSE(client->state());
  // What it makes of a state, which is sent again as often as it has become a second old unread.
  const auto read = [&](gripper::State sent) {
    for (;; ++sent.message_id) {
      hand.send_state(sent);
      for (int i = 0; i < 500; ++i) {
        const auto state = client->state();
        if (state && state->width == sent.width) return state;
        std::this_thread::sleep_for(1ms);
      }
    }
  };
  const auto first = read({5, 0.03, 0.08, true, 31});
  EXPECT_TRUE(first->is_grasped);
  EXPECT_EQ(first->temperature, 31);
  hand.send_state({4, 0.01, 0.08, true, 31});         // older
  hand.send_state({first->message_id + 1, std::nan(""), 0.08, true, 31});
  hand.send_datagram(Bytes(22));
  hand.send_datagram(Bytes(24));
  EXPECT_FALSE(read({first->message_id + 2, 0.05, 0.08, false, 31})->is_grasped);
  while (client->state()) std::this_thread::sleep_for(10ms);  // until it is a second old
}

// A hand without power says no goodbye.
TEST(GripperConnect, IsKeptAlive) {
  ScriptedHand hand;
  const robot::Peer peer("the hand", hand.address(), gripper::kPort, "");
  const robot::Socket tcp = peer.connect(robot::Clock::now() + 20s);
  const auto option = [&](int level, int name) {
    int value = 0;
    socklen_t size = sizeof value;
    ::getsockopt(tcp.fd(), level, name, &value, &size);
    return value;
  };
  EXPECT_EQ(option(SOL_SOCKET, SO_KEEPALIVE), 1);
  EXPECT_EQ(option(IPPROTO_TCP, TCP_KEEPIDLE), 1);
  EXPECT_EQ(option(IPPROTO_TCP, TCP_KEEPINTVL), 1);
  EXPECT_EQ(option(IPPROTO_TCP, TCP_KEEPCNT), 3);
  EXPECT_EQ(option(IPPROTO_TCP, TCP_USER_TIMEOUT), 4000);
}

TEST(GripperConnect, SaysWhatIsWrong) {
  const auto refusal = [](const std::string& address) -> std::string {
    try {
      GripperClient client(address, {.connect = 20s});
    } catch (const robot::ConnectError& error) {
      return error.what();
    }
    return "connected";
  };
  ScriptedHand nobody;
  nobody.stop_listening();
  EXPECT_NE(refusal(nobody.address()).find("TCP port 1338 refused"), std::string::npos);

  ScriptedHand old;
  auto side = std::async(std::launch::async,
                         [&] { old.serve_connect(gripper::ConnectStatus::kIncompatibleLibraryVersion, 2); });
  EXPECT_NE(refusal(old.address()).find("speaks protocol version 2"), std::string::npos);
  side.get();

  ScriptedHand other;
  side = std::async(std::launch::async, [&] {
    other.accept();
    other.read(14);
    const std::string text = "SSH-2.0-OpenSSH_9.2p1 Debian\r\n";
    other.write(std::as_bytes(std::span(text)));
  });
  EXPECT_NE(refusal(other.address()).find("is no hand"), std::string::npos);
  side.get();
}

}  // namespace
