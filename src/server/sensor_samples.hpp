#pragma once

#include <google/protobuf/any.pb.h>

#include <string>
#include <vector>

#include "realtime/sensor_input.hpp"

namespace server {

// What the loop gets of a sensor message: one sample, of a chunk one for each of its times. Throws wire::Invalid: an unknown
// kind, bytes that are not the message, values against its rules.
std::vector<realtime::SensorSample> samples_of(const google::protobuf::Any& any);

}  // namespace server
