#include "server/sockets.hpp"

#include <cstdlib>

namespace server {

std::string bind(zmq::socket_t& socket, const std::string& listen, std::uint16_t port) {
  try {
    socket.bind("tcp://" + listen + ":" + (port == 0 ? "*" : std::to_string(port)));
  } catch (const zmq::error_t& error) {
    if (port == 0 || error.num() != EADDRINUSE) throw;
    socket.bind("tcp://" + listen + ":*");
  }
  return socket.get(zmq::sockopt::last_endpoint);
}

std::uint16_t port_of(const std::string& endpoint) {
  const auto colon = endpoint.rfind(':');
  return colon == std::string::npos ? 0 : static_cast<std::uint16_t>(std::atoi(endpoint.c_str() + colon + 1));
}

}  // namespace server
