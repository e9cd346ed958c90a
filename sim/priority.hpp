#pragma once

#include <string>

namespace sim {

// Gives the calling thread the highest real-time priority: above that of clients on the same computer, which would keep
// it from sending the states that they wait for (libfranka takes the same one: equals do not interrupt each other). What
// came of it, for people: "priority 99", or why not.
std::string take_priority();

}  // namespace sim
