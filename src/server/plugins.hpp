#pragma once

#include <chrono>
#include <stdexcept>
#include <string>
#include <vector>

namespace server {

constexpr std::chrono::seconds kLoadTime{20};  // for all libraries

// One line that names the library.
class PluginError : public std::runtime_error {
 public:
  using runtime_error::runtime_error;
};

// Loads a library of parts (server/part.hpp), whose kinds then are kinds like any other, for the life of the process. Before
// threads begin. Throws PluginError: not there, no library, no library of parts, built for another server, a kind that is
// there already or whose message has no package.
void load_parts(const std::string& path);

// Loads them all in a process that then ends: what a library does when it is loaded, its own code decides. Throws as
// load_parts(), also when that process does not survive it.
void try_parts(const std::vector<std::string>& paths);

}  // namespace server
