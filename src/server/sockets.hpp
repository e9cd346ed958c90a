#pragma once

#include <cstdint>
#include <string>
#include <zmq.hpp>

namespace server {

// Binds to tcp://listen:port, or to a free port where `port` is 0 or taken; returns the endpoint.
std::string bind(zmq::socket_t& socket, const std::string& listen, std::uint16_t port);

// Port of "tcp://address:port"; 0 when there is none.
std::uint16_t port_of(const std::string& endpoint);

}  // namespace server
