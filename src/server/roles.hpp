#pragma once

#include "frankapy/proto/service.pb.h"
#include "server/keys.hpp"

namespace server {

// The least role that a request needs, where it is not refused for other reasons: the one table of who may do what.
frankapy::proto::Role needed(const frankapy::proto::Request& request);

// Throws Refused, which says what the client's role is, what is needed and how to get it.
void require_role(const Keys::Client& client, const frankapy::proto::Request& request);

// What such a refusal says; `what` needs `role`.
std::string explain_role(const Keys::Client& client, const std::string& what, frankapy::proto::Role role);

}  // namespace server
