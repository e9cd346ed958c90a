#include "server/keys.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <functional>
#include <optional>
#include <set>
#include <thread>

#include "frankapy/proto/sensors.pb.h"
#include "server/arm_process.hpp"
#include "server/clocks.hpp"
#include "server/config.hpp"
#include "server/doorkeeper.hpp"
#include "server/publisher.hpp"
#include "server/recorder.hpp"
#include "server/refused.hpp"
#include "server/roles.hpp"
#include "server/sensor_hub.hpp"
#include "server/transport.hpp"
#include "tests/server/client.hpp"
#include "tests/server/key_folder.hpp"
#include "tests/server/skills.hpp"

namespace server {
namespace {

using namespace std::chrono_literals;
using Pair = std::array<std::string, 2>;

std::string refusal(const std::function<void()>& action) {
  try {
    action();
  } catch (const std::exception& error) {
    return error.what();
  }
  return "";
}

void expect(const std::string& text, const std::string& part) { EXPECT_NE(text.find(part), std::string::npos) << text; }

// --- the folder ---

TEST(Keys, AFolderIsReadWithNamesAndRoles) {
  KeyFolder folder;
  const auto anna = folder.add("anna", proto::LAB);
  const Keys keys(folder.path);
  EXPECT_EQ(keys.own().public_key(), folder.own.public_key());
  EXPECT_EQ(keys.find(anna[0]).name, "anna");
  EXPECT_EQ(keys.find(anna[0]).role, proto::LAB);
  EXPECT_EQ(keys.find(KeyFolder::pair()[0]).role, proto::NOBODY);
  EXPECT_EQ(keys.find("").role, proto::NOBODY);
  EXPECT_TRUE(keys.knows_name("anna"));
  EXPECT_FALSE(keys.knows_name(""));
}

TEST(Keys, SecretsThatOthersCanReadAreRefused) {
  KeyFolder folder;
  for (const mode_t mode : {0640, 0604, 0620}) {
    chmod((folder.path / "server.json").c_str(), mode);
    expect(refusal([&] { Keys{folder.path}; }), "chmod 600");
  }
  chmod((folder.path / "server.json").c_str(), 0600);
  folder.add("anna", proto::USER);
  chmod((folder.path / "clients.json").c_str(), 0666);  // whoever writes there lets himself in
  expect(refusal([&] { Keys{folder.path}; }), "clients.json: others can read or change it (mode 666)");
}

TEST(Keys, AFolderThatOthersWriteIntoIsRefused) {
  KeyFolder folder;
  for (const mode_t mode : {0770, 0707}) {
    chmod(folder.path.c_str(), mode);
    expect(refusal([&] { Keys{folder.path}; }), "chmod 700");
  }
  chmod(folder.path.c_str(), 0700);
  if (geteuid() != 0) GTEST_SKIP() << "only root gives files away";
  ASSERT_EQ(chown((folder.path / "server.json").c_str(), 12345, 12345), 0);
  expect(refusal([&] { Keys{folder.path}; }), "belongs to another user (number 12345)");
}

TEST(Keys, AnArmSProcessThatCannotReadThemSaysSoAndEnds) {
  KeyFolder folder;
  chmod((folder.path / "server.json").c_str(), 0644);
  ArmOptions options;
  options.keys = folder.path;
  EXPECT_EXIT(std::exit(run_arm({}, {}, options)), testing::ExitedWithCode(EXIT_FAILURE), "");
}

TEST(Keys, WhatIsNoKeyIsRefusedWithItsFile) {
  KeyFolder folder;
  expect(refusal([&] { Keys{folder.path / "nowhere"}; }), "frankapy keys new");
  folder.write("server.json", std::string("{"));
  expect(refusal([&] { Keys{folder.path}; }), "server.json: cannot be read as a frankapy.proto.ServerKey");
  auto other = folder.own;
  other.set_public_key(KeyFolder::pair()[0]);
  folder.write("server.json", other);
  expect(refusal([&] { Keys{folder.path}; }), "no pair");
  folder.write("server.json", folder.own);
  auto& client = *folder.clients.add_clients();
  client.set_name("anna");
  client.set_role(proto::USER);
  client.set_public_key("short");
  folder.write("clients.json", folder.clients);
  expect(refusal([&] { Keys{folder.path}; }), "the client \"anna\" lacks");
}

TEST(Keys, WhomItKnowsIsReadAgainWhenItHasChangedAndKeptWhenItCannotBe) {
  KeyFolder folder;
  const auto anna = folder.add("anna", proto::USER);
  Keys keys(folder.path);
  const auto bob = folder.add("bob", proto::READ);
  EXPECT_EQ(keys.find(bob[0]).role, proto::NOBODY);
  keys.refresh();
  EXPECT_EQ(keys.find(bob[0]).role, proto::READ);
  folder.write("clients.json", std::string("no JSON"));
  keys.refresh();
  EXPECT_EQ(keys.find(anna[0]).role, proto::USER);
  folder.remove_all();
  keys.refresh();
  EXPECT_EQ(keys.find(anna[0]).role, proto::NOBODY);
}

TEST(Keys, AServerThatOthersReachDoesNotStartWithout) {
  KeyFolder folder;
  setenv("XDG_CONFIG_HOME", folder.path.c_str(), 1);
  EXPECT_EQ(keys_for("127.0.0.1", ""), nullptr);
  EXPECT_EQ(keys_for("127.3.2.1", ""), nullptr);
  for (const char* address : {"0.0.0.0", "192.168.1.10", "127.everywhere", "*", "eth0"}) {
    expect(refusal([&] { keys_for(address, ""); }), "`frankapy keys new`");
  }
  EXPECT_NE(keys_for("0.0.0.0", folder.path), nullptr);
  EXPECT_NE(keys_for("127.0.0.1", folder.path), nullptr);
  expect(refusal([&] { keys_for("127.0.0.1", folder.path / "nowhere"); }), "server.json");
  std::filesystem::create_directories(folder.path / "franka-interface");
  std::filesystem::create_symlink(folder.path, folder.path / "franka-interface/keys");
  EXPECT_NE(keys_for("0.0.0.0", ""), nullptr);
  EXPECT_EQ(keys_for("127.0.0.1", ""), nullptr);  // a simulated arm beside the arms of a lab
  unsetenv("XDG_CONFIG_HOME");
}

// --- the table ---

proto::Request request(const std::function<void(proto::Request&)>& fill) {
  proto::Request request;
  fill(request);
  return request;
}

TEST(Roles, EachCallHasOne) {
  const std::set<std::string> reads = {"hello", "get_state", "skill_status", "list_arms", "list_topics", "get_server_status", "check_skill",
                                       "alive", "goodbye",   "record",       "change_walls", "change_limits"};
  const auto* calls = proto::Request::descriptor()->FindOneofByName("call");
  for (int i = 0; i < calls->field_count(); ++i) {
    proto::Request call;
    call.GetReflection()->MutableMessage(&call, calls->field(i));
    const std::string name = calls->field(i)->name();
    EXPECT_EQ(needed(call), name == "stop_skill" ? proto::NOBODY : reads.contains(name) ? proto::READ : proto::USER) << name;
  }
}

TEST(Roles, WhatIsChangedNeedsMoreThanWhatIsRead) {
  EXPECT_EQ(needed(request([](auto& r) { r.mutable_gripper()->mutable_stop(); })), proto::NOBODY);
  EXPECT_EQ(needed(request([](auto& r) { r.mutable_gripper()->mutable_move(); })), proto::USER);
  EXPECT_EQ(needed(request([](auto& r) { r.mutable_record()->set_on(false); })), proto::USER);
  EXPECT_EQ(needed(request([](auto& r) { r.mutable_change_walls()->add_remove("table"); })), proto::USER);
  EXPECT_EQ(needed(request([](auto& r) { r.mutable_change_walls()->add_put(); })), proto::USER);
  EXPECT_EQ(needed(request([](auto& r) { r.mutable_change_walls()->add_put()->set_fixed(true); })), proto::LAB);
  EXPECT_EQ(needed(request([](auto& r) { r.mutable_change_limits()->set_reset(true); })), proto::USER);
  EXPECT_EQ(needed(request([](auto& r) { r.mutable_change_limits()->mutable_limits(); })), proto::USER);
  EXPECT_EQ(needed(request([](auto& r) { r.mutable_change_limits()->mutable_most(); })), proto::LAB);
}

TEST(Roles, ARefusalSaysWhatIsNeededAndHowToGetIt) {
  const auto start = request([](auto& r) { r.mutable_start_skill(); });
  expect(refusal([&] { require_role({"key", "anna", proto::READ}, start); }),
         "StartSkill needs the role user, and the key \"anna\" has read. Whoever runs the server makes one");
  expect(refusal([&] { require_role({"key", "", proto::NOBODY}, start); }), "was removed");
  const auto most = request([](auto& r) { r.mutable_change_limits()->mutable_most(); });
  expect(refusal([&] { require_role({"", "", proto::USER}, most); }), "nobody has where a server has no keys: `frankapy keys new`");
  EXPECT_EQ(refusal([&] { require_role({"", "", proto::USER}, start); }), "");
  EXPECT_EQ(refusal([&] { require_role({"key", "anna", proto::LAB}, most); }), "");
}

// --- sockets ---

// A socket of a client, which sees how its handshake ends.
class Knocking {
 public:
  Knocking(zmq::context_t& context, zmq::socket_type type, const std::string& endpoint, const std::optional<Pair>& own,
           const std::string& server)
      : socket(context, type), events_(context, zmq::socket_type::pair) {
    static int count = 0;
    const std::string address = "inproc://knocking " + std::to_string(++count);
    constexpr int kEvents = ZMQ_EVENT_HANDSHAKE_SUCCEEDED | ZMQ_EVENT_HANDSHAKE_FAILED_AUTH | ZMQ_EVENT_DISCONNECTED;
    zmq_socket_monitor(socket.handle(), address.c_str(), kEvents);
    events_.connect(address);
    events_.set(zmq::sockopt::linger, 0);
    socket.set(zmq::sockopt::linger, 0);
    if (own) {
      socket.set(zmq::sockopt::curve_publickey, (*own)[0]);
      socket.set(zmq::sockopt::curve_secretkey, (*own)[1]);
      socket.set(zmq::sockopt::curve_serverkey, server);
    }
    socket.connect(endpoint);
  }
  ~Knocking() { zmq_socket_monitor(socket.handle(), nullptr, 0); }

  int first_event() {
    zmq::message_t event, address;
    EXPECT_TRUE(events_.recv(event));
    EXPECT_TRUE(events_.recv(address));
    return *event.data<std::uint16_t>();
  }

  zmq::socket_t socket;

 private:
  zmq::socket_t events_;
};

TEST(Doorkeeper, LetsInWhomItKnowsAndNobodyElse) {
  KeyFolder folder;
  const auto anna = folder.add("anna", proto::READ);
  Keys keys(folder.path);
  zmq::context_t context, others;
  Doorkeeper doorkeeper(context, keys);
  zmq::socket_t router(context, zmq::socket_type::router);
  const std::string endpoint = bind(router, {"127.0.0.1", &keys}, 0);
  const std::string server = folder.own.public_key();

  Knocking known(others, zmq::socket_type::dealer, endpoint, anna, server);
  EXPECT_EQ(known.first_event(), ZMQ_EVENT_HANDSHAKE_SUCCEEDED);
  known.socket.send(zmq::str_buffer("hello"), zmq::send_flags::none);
  zmq::message_t identity, frame;
  ASSERT_TRUE(router.recv(identity) && router.recv(frame));
  EXPECT_EQ(sender_of(frame, &keys).name, "anna");
  EXPECT_EQ(sender_of(frame, &keys).role, proto::READ);
  EXPECT_EQ(sender_of(frame, nullptr).role, proto::USER);

  EXPECT_EQ(doorkeeper.refused(), 0U);
  Knocking unknown(others, zmq::socket_type::dealer, endpoint, KeyFolder::pair(), server);
  EXPECT_EQ(unknown.first_event(), ZMQ_EVENT_HANDSHAKE_FAILED_AUTH);
  EXPECT_GE(doorkeeper.refused(), 1U);
  Knocking without(others, zmq::socket_type::dealer, endpoint, std::nullopt, server);
  EXPECT_EQ(without.first_event(), ZMQ_EVENT_DISCONNECTED);
  Knocking elsewhere(others, zmq::socket_type::dealer, endpoint, anna, KeyFolder::pair()[0]);
  EXPECT_EQ(elsewhere.first_event(), ZMQ_EVENT_DISCONNECTED);

  known.socket.send(zmq::str_buffer("still here"), zmq::send_flags::none);
  ASSERT_TRUE(router.recv(identity) && router.recv(frame));
  EXPECT_EQ(frame.to_string(), "still here");
}

// Transport and sensors with keys, at a door whose other side is the test.
class KeyedTransportTest : public testing::Test {
 protected:
  KeyedTransportTest() {
    thread_ = std::thread([this] { transport_.run(quit_); });
    proto::Welcome welcome;
    welcome.set_model("fr3");
    transport_.connected(std::make_shared<SkillBuilder>(fr3_model(), fr3_limits()), welcome);
    door_.records.push(record_at_home());
  }
  ~KeyedTransportTest() override {
    quit_ = true;
    thread_.join();
  }

  Client client(const Pair& own, const std::string& identity = "") {
    return Client(others_, transport_.endpoint(), [&](zmq::socket_t& socket) {
      if (!identity.empty()) socket.set(zmq::sockopt::routing_id, identity);
      use(socket, own);
    });
  }
  void use(zmq::socket_t& socket, const Pair& own) const {
    socket.set(zmq::sockopt::curve_publickey, own[0]);
    socket.set(zmq::sockopt::curve_secretkey, own[1]);
    socket.set(zmq::sockopt::curve_serverkey, folder_.own.public_key());
  }

  KeyFolder folder_;
  const Pair reader_ = folder_.add("reader", proto::READ), anna_ = folder_.add("anna", proto::USER);
  const Pair bob_ = folder_.add("bob", proto::USER), lab_ = folder_.add("lab", proto::LAB);
  Keys keys_{folder_.path};
  zmq::context_t context_, others_;
  Doorkeeper doorkeeper_{context_, keys_};
  BlackBox box_;
  realtime::Door door_{box_.records};
  Publisher publisher_{context_, {"127.0.0.1", &keys_}, 0, door_, nullptr};
  SensorHub sensors_{context_, {"127.0.0.1", &keys_}, 0, box_.journal, door_.robot_time, false};
  Recorder recorder_{box_, RecordingsConfig{.mode = RecordingsConfig::Mode::kOff, .folder = {}}, "arm", nullptr};
  Transport transport_{context_, {"127.0.0.1", &keys_}, 0, door_, publisher_, sensors_, recorder_, nullptr, WallStore({}),
                       {.clock = [] { return std::chrono::steady_clock::duration{}; }}};  // no lease falls free
  std::atomic<bool> quit_{false};
  std::thread thread_;
  const proto::Skill skill_ = skill_of(joint_motion(), proto::JointImpedance());
};

TEST_F(KeyedTransportTest, AReaderReadsAndStopsAndDoesNotCommand) {
  auto reader = client(reader_);
  const auto welcome = reader.hello().welcome();
  EXPECT_EQ(welcome.role(), proto::READ);
  EXPECT_EQ(welcome.key(), "reader");
  EXPECT_TRUE(reader.state().has_state());
  EXPECT_EQ(reader.start(skill_).error().code(), proto::Error::NOT_PERMITTED);
  EXPECT_EQ(reader.recover().error().code(), proto::Error::NOT_PERMITTED);
  EXPECT_TRUE(reader.stop().has_done());
  auto anna = client(anna_);
  EXPECT_EQ(anna.hello().welcome().role(), proto::USER);
  EXPECT_TRUE(anna.start(skill_).has_skill_started());
}

TEST_F(KeyedTransportTest, WhatIsTooLongToBeReadAtOnceNeedsTheRoleToo) {
  auto reader = client(reader_);
  reader.hello();
  auto skill = skill_;
  skill.set_description(std::string(100'000, 'x'));
  EXPECT_EQ(reader.start(skill).error().code(), proto::Error::NOT_PERMITTED);
}

TEST_F(KeyedTransportTest, TheCommanderIsNamedByItsKey) {
  auto anna = client(anna_);
  anna.hello();
  ASSERT_TRUE(anna.start(skill_).has_skill_started());
  auto bob = client(bob_);
  bob.hello();
  const auto error = bob.start(skill_).error();
  EXPECT_EQ(error.code(), proto::Error::BUSY);
  EXPECT_NE(error.message().find("anna: test"), std::string::npos) << error.message();
}

TEST_F(KeyedTransportTest, AnIdentityOfAnotherKeyIsNoWayToItsRoleOrItsLease) {
  auto anna = client(anna_, "me");
  anna.hello();
  ASSERT_TRUE(anna.start(skill_).has_skill_started());
  auto reader = client(reader_, "me");
  EXPECT_EQ(reader.state().error().code(), proto::Error::UNKNOWN_CLIENT);
  EXPECT_EQ(reader.start(skill_).error().code(), proto::Error::UNKNOWN_CLIENT);
  EXPECT_TRUE(reader.hello().has_welcome());
  EXPECT_EQ(reader.start(skill_).error().code(), proto::Error::NOT_PERMITTED);
}

TEST_F(KeyedTransportTest, ARemovedKeyIsRefusedAtOnceButMayStop) {
  auto anna = client(anna_);
  anna.hello();
  folder_.remove_all();
  while (anna.state().has_state()) std::this_thread::sleep_for(10ms);
  const auto error = anna.start(skill_).error();
  EXPECT_EQ(error.code(), proto::Error::NOT_PERMITTED);
  EXPECT_NE(error.message().find("was removed"), std::string::npos) << error.message();
  EXPECT_TRUE(anna.stop().has_done());
}

TEST_F(KeyedTransportTest, OnlyLabChangesWhatIsProtectedWhoeverCommands) {
  auto anna = client(anna_), lab = client(lab_);
  anna.hello();
  lab.hello();
  ASSERT_TRUE(anna.start(skill_).has_skill_started());  // and has the lease
  proto::Request put;
  auto& wall = *put.mutable_change_walls()->add_put();
  wall.set_name("table");
  wall.mutable_sphere()->set_radius(0.1);
  wall.set_fixed(true);
  EXPECT_EQ(anna.ask(put).error().code(), proto::Error::NOT_PERMITTED);
  EXPECT_TRUE(lab.ask(put).walls().walls(0).fixed());
  proto::Request remove;
  remove.mutable_change_walls()->add_remove("table");
  const auto error = anna.ask(remove).error();
  EXPECT_EQ(error.code(), proto::Error::NOT_PERMITTED);
  EXPECT_NE(error.message().find("wall \"table\" is protected"), std::string::npos) << error.message();
  wall.set_fixed(false);
  EXPECT_EQ(anna.ask(put).error().code(), proto::Error::NOT_PERMITTED);
  EXPECT_EQ(lab.ask(remove).walls().walls_size(), 0);

  proto::Request allow;
  allow.mutable_change_limits()->mutable_most()->set_tool_speed(0.5);
  EXPECT_EQ(anna.ask(allow).error().code(), proto::Error::NOT_PERMITTED);
  EXPECT_EQ(lab.ask(allow).limits().now().tool_speed(), 0.5);
  proto::Request set;
  set.mutable_change_limits()->mutable_limits()->set_tool_speed(0.6);
  EXPECT_EQ(anna.ask(set).error().code(), proto::Error::INVALID_ARGUMENT);
}

// --- sensor messages ---

class KeyedSensorTest : public KeyedTransportTest {
 protected:
  struct Sender {
    zmq::socket_t socket;
    std::uint64_t sequence = 0;
  };

  Sender sender(const Pair& own) {
    Sender sender{zmq::socket_t(others_, zmq::socket_type::push)};
    sender.socket.set(zmq::sockopt::linger, 0);
    use(sender.socket, own);
    sender.socket.connect(sensors_.endpoint());
    return sender;
  }
  static void publish(Sender& sender, std::uint64_t publisher, std::uint64_t sequence, std::int64_t sent_ns = 0) {
    proto::SensorMessage message;
    if (sent_ns != 0) message.set_sent_ns(sent_ns);
    message.set_topic("left");
    message.set_publisher(publisher);
    message.set_sequence(sequence);
    proto::JointPositionSensorMessage joints;
    for (int i = 0; i < 7; ++i) joints.add_joints(0);
    message.mutable_message()->PackFrom(joints);
    sender.socket.send(zmq::buffer(message.SerializeAsString()), zmq::send_flags::none);
  }
  static bool comes(realtime::SensorInput& input) {
    realtime::SensorSample sample;
    bool came = false;
    for (int i = 0; !(came = input.take(sample)) && i < 10'000; ++i) std::this_thread::sleep_for(1ms);
    return came;
  }
  proto::Topics::Topic topic(const std::function<bool(const proto::Topics&)>& once) {
    for (;;) {
      proto::Topics topics;
      sensors_.describe(topics);
      if (once(topics)) return topics.topics_size() > 0 ? topics.topics(0) : proto::Topics::Topic();
      std::this_thread::sleep_for(2ms);
    }
  }
};

TEST_F(KeyedSensorTest, AReadersAreNotTaken) {
  auto reader = sender(reader_), anna = sender(anna_);
  publish(reader, 1, 1);
  topic([](const auto& topics) { return topics.garbage() == 1; });
  publish(anna, 1, 1);
  topic([](const auto& topics) { return topics.topics_size() == 1; });
  publish(reader, 1, 2);
  const auto left = topic([](const auto& topics) { return topics.topics(0).refused() == 1; });
  EXPECT_EQ(left.received(), 1U);
  expect(left.why_refused(), "needs the role user, and the key \"reader\" has read");
}

TEST_F(KeyedSensorTest, ASkillTakesThoseOfThePublishersThatItNames) {
  const auto input = std::make_shared<realtime::SensorInput>("left", std::vector<std::string>{"JointPositionSensorMessage"});
  SensorHub::Publishers publishers;
  auto& only = *publishers.Add();
  only.set_topic("left");
  only.add_names("anna");
  sensors_.check(publishers, {input});
  sensors_.bind(1, {input}, false, "bob", publishers);
  auto anna = sender(anna_), bob = sender(bob_);
  publish(bob, 1, 9);
  const auto refused = [](const auto& topics) { return topics.topics_size() == 1 && topics.topics(0).refused() == 1; };
  const auto left = topic(refused);
  EXPECT_EQ(left.why_refused(), "it is of the key \"bob\": the skill that listens takes anna (its `publishers`)");
  realtime::SensorSample sample;
  EXPECT_FALSE(input->take(sample));
  publish(anna, 1, 1);  // the number of another's is no way to make hers old
  topic([](const auto& topics) { return topics.topics(0).received() == 2; });
  EXPECT_EQ(topic([](const auto&) { return true; }).out_of_order(), 0U);
  EXPECT_TRUE(comes(*input));

  only.add_names("carl");
  expect(refusal([&] { sensors_.check(publishers, {input}); }), "\"carl\" of the topic \"left\": expected names of keys");
  only.set_topic("right");
  expect(refusal([&] { sensors_.check(publishers, {input}); }), "the topic \"right\": expected one that a part of the skill listens to");
}

TEST_F(KeyedSensorTest, ASkillThatNamesNoneTakesThoseOfItsCommander) {
  const auto input = std::make_shared<realtime::SensorInput>("left", std::vector<std::string>{"JointPositionSensorMessage"});
  sensors_.bind(1, {input}, false, "anna");
  auto anna = sender(anna_), bob = sender(bob_);
  publish(bob, 1, 9);
  topic([](const auto& topics) { return topics.topics_size() == 1 && topics.topics(0).refused() == 1; });
  realtime::SensorSample sample;
  EXPECT_FALSE(input->take(sample));
  publish(anna, 1, 1);
  topic([](const auto& topics) { return topics.topics(0).received() == 2; });
  EXPECT_TRUE(comes(*input));
}

TEST_F(KeyedSensorTest, OnlyPublishersThatASkillTakesOvertakeEachOther) {
  auto anna = sender(anna_), bob = sender(bob_);
  std::uint64_t sequence = 0, received = 0;
  const auto say = [&](Sender& who, std::int64_t sent_ns) {
    publish(who, 1, ++sequence, sent_ns);
    ++received;
    return topic([&](const auto& topics) { return topics.topics_size() == 1 && topics.topics(0).received() == received; });
  };
  for (const bool both : {false, true}) {
    const auto input = std::make_shared<realtime::SensorInput>("left", std::vector<std::string>{"JointPositionSensorMessage"});
    SensorHub::Publishers publishers;
    auto& names = *publishers.Add();
    names.set_topic("left");
    names.add_names("anna");
    if (both) names.add_names("bob");
    const std::uint64_t skill = both ? 2 : 1;
    sensors_.bind(skill, {input}, false, "bob", publishers);
    const std::int64_t sent = since_epoch_ns(now_ns());
    say(anna, sent);
    std::this_thread::sleep_for(100ms);
    say(bob, since_epoch_ns(now_ns()));
    EXPECT_EQ(say(anna, sent + 1).out_of_order(), both ? 1U : 0U);
    int taken = 0;
    for (realtime::SensorSample sample; input->take(sample);) ++taken;
    EXPECT_EQ(taken, 2) << (both ? "hers and his" : "both of hers");
    sensors_.release(skill);
  }
}

}  // namespace
}  // namespace server
