#pragma once

#include <atomic>
#include <memory>
#include <string>
#include <thread>
#include <zmq.hpp>

#include "frankapy/proto/simulation.pb.h"
#include "sim/cell.hpp"
#include "sim/render/camera.hpp"

namespace sim {

// The control channel of one arm (wire/proto/simulation.proto): takes calls in a thread of its own and has them done by
// the arm's cell between two cycles.
class ControlServer {
 public:
  static constexpr int kPort = 1339;

  // `arm` of the cell. Throws std::runtime_error when the port cannot be had.
  ControlServer(Cell& cell, std::size_t arm, const std::string& address);
  ~ControlServer();

 private:
  void run();
  frankapy::proto::SimulationReply answer(frankapy::proto::SimulationCall& call);
  void put_truth(frankapy::proto::SimulationTruth& truth);
  void put_image(const frankapy::proto::TakeImage& request, frankapy::proto::Image& image);
  void step(std::uint64_t cycles);

  Cell& cell_;
  const std::size_t arm_;
  zmq::context_t context_;
  zmq::socket_t socket_;
  std::unique_ptr<Camera> camera_;
  int camera_changes_ = -1;  // of the world that it shows
  std::atomic<bool> ends_ = false;
  std::thread thread_;
};

}  // namespace sim
