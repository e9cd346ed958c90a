#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string>

#include "frankapy/proto/simulation.pb.h"
#include "sim/cell.hpp"
#include "sim/render/camera.hpp"

namespace sim {

// What the control channel of one arm is asked for, whatever brings the bytes: has it done by the arm's cell between two
// cycles, and waits for that. Of one thread, which is not the cell's.
class ControlCalls {
 public:
  // `arm` of the cell.
  ControlCalls(Cell& cell, std::size_t arm);

  // Any bytes; the bytes of a SimulationReply.
  std::string answer(std::span<const std::byte> call);

 private:
  frankapy::proto::SimulationReply answer(frankapy::proto::SimulationCall& call);
  void put_truth(frankapy::proto::SimulationTruth& truth);
  void put_image(const frankapy::proto::TakeImage& request, frankapy::proto::Image& image);
  void step(std::uint64_t cycles);

  Cell& cell_;
  const std::size_t arm_;
  std::unique_ptr<Camera> camera_;
  int camera_changes_ = -1;  // of the world that it shows
};

}  // namespace sim
