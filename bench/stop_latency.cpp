// How soon a stop is at the loop's door while clients do what they can to be in its way: 16 send unreachable goals without a pause,
// 8 subscribe to every state and read none.
//   stop_latency_ms_p50, _p99   from StopSkill into the client's socket to Door::stop_up_to
// Who stops goes before the others, as on a computer of its own. The server's threads are as in an arm's process; at the door,
// instead of a loop, this program makes a record each millisecond.

#include <atomic>
#include <chrono>
#include <cstdio>
#include <thread>
#include <vector>
#include <zmq.hpp>

#include "bench/percentile.hpp"
#include "server/publisher.hpp"
#include "server/realtime_setup.hpp"
#include "server/recorder.hpp"
#include "server/sensor_hub.hpp"
#include "server/sockets.hpp"
#include "server/transport.hpp"
#include "tests/server/skills.hpp"

namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;
namespace proto = frankapy::proto;

constexpr int kBadClients = 16, kSlowSubscribers = 8;
constexpr int kGoalsAhead = 16;  // that a client has sent and not heard of
constexpr int kStops = 1000;

class Client {
 public:
  Client(zmq::context_t& context, const std::string& endpoint) : socket_(context, zmq::socket_type::dealer) {
    socket_.set(zmq::sockopt::linger, 0);
    socket_.set(zmq::sockopt::rcvtimeo, 10'000);
    socket_.connect(endpoint);
    proto::Request request;
    request.mutable_hello()->set_version(proto::CURRENT);
    send(request);
    receive();
  }
  void send(proto::Request& request) {
    request.set_request_id(++id_);
    socket_.send(zmq::buffer(request.SerializeAsString()), zmq::send_flags::none);
  }
  void receive() {
    zmq::message_t message;
    (void)socket_.recv(message);
  }

 private:
  zmq::socket_t socket_;
  std::uint64_t id_ = 0;
};

proto::Request unreachable_goal() {
  proto::Request request;
  *request.mutable_start_skill()->mutable_skill() = server::skill_of(server::pose_motion(3, 0, 0), proto::CartesianImpedance());
  return request;
}

}  // namespace

int main() {
  zmq::context_t context = server::preferred_context(), own = server::preferred_context(), others;
  server::BlackBox box;
  realtime::Door door(box.records);
  server::Publisher publisher(context, "127.0.0.1", 0, door, nullptr);
  server::SensorHub sensors(context, "127.0.0.1", 0, box.journal, door.robot_time, false);
  server::Recorder recorder(box, {.mode = server::RecordingsConfig::Mode::kOff, .folder = {}}, "arm", nullptr);
  server::Transport transport(context, "127.0.0.1", 0, door, publisher, sensors, recorder, nullptr);
  std::atomic<bool> quit{false};
  std::atomic<bool> bad{true};
  std::vector<std::thread> threads, clients;
  threads.emplace_back([&] { transport.run(quit); });
  threads.emplace_back([&] {
    auto record = server::record_at_home();
    for (auto next = Clock::now(); !quit; std::this_thread::sleep_until(next += 1ms)) {
      ++record.cycles;
      ++record.state.message_id;
      door.records.push(record);
    }
  });
  proto::Welcome welcome;
  welcome.set_model("fr3");
  transport.connected(std::make_shared<server::SkillBuilder>(server::fr3_model(), server::fr3_limits()), welcome);

  std::vector<zmq::socket_t> subscribers;
  for (int i = 0; i < kSlowSubscribers; ++i) {
    auto& socket = subscribers.emplace_back(others, zmq::socket_type::sub);
    socket.set(zmq::sockopt::linger, 0);
    socket.set(zmq::sockopt::rcvhwm, 1);
    socket.set(zmq::sockopt::subscribe, std::string("1\0", 2));
    socket.connect(publisher.endpoint());
  }
  std::atomic<std::uint64_t> answered{0};
  for (int i = 0; i < kBadClients; ++i) {
    clients.emplace_back([&] {
      Client client(others, transport.endpoint());
      proto::Request request = unreachable_goal();
      for (int n = 0; n < kGoalsAhead; ++n) client.send(request);
      while (bad) {
        client.receive();
        ++answered;
        client.send(request);
      }
    });
  }
  const server::Preferred preferred;
  Client stopper(own, transport.endpoint());
  while (answered < 10 * kBadClients) std::this_thread::sleep_for(1ms);

  proto::Request stop, goal = unreachable_goal();
  stop.mutable_stop_skill();
  std::vector<double> ms;
  const auto began = Clock::now();
  const std::uint64_t before = answered, built = transport.workbench().finished();
  for (int n = 0; n < kStops; ++n) {
    std::this_thread::sleep_for(2ms);
    stopper.send(goal);  // so that there is a skill which is not yet stopped
    stopper.receive();
    const std::uint64_t last = door.stop_up_to;
    const auto sent = Clock::now();
    stopper.send(stop);
    while (door.stop_up_to == last) std::this_thread::sleep_for(50us);
    ms.push_back(std::chrono::duration<double, std::milli>(Clock::now() - sent).count());
    stopper.receive();
  }
  const double seconds = std::chrono::duration<double>(Clock::now() - began).count();
  std::fprintf(stderr, "%.0f goals refused a second, %.0f of them looked at\n", static_cast<double>(answered - before) / seconds,
               static_cast<double>(transport.workbench().finished() - built) / seconds);
  std::fprintf(stderr, "stop: p50 %.3f, p90 %.3f, p99 %.3f, worst %.3f ms\n", percentile(ms, 0.5), percentile(ms, 0.9), percentile(ms, 0.99),
               percentile(ms, 1));
  bad = false;
  for (auto& thread : clients) thread.join();
  quit = true;
  for (auto& thread : threads) thread.join();
  std::printf("{\"stop_latency_ms_p50\": %.3f, \"stop_latency_ms_p99\": %.3f}\n", percentile(ms, 0.5), percentile(ms, 0.99));
}
