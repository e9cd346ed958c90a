#pragma once

#include <spdlog/common.h>

namespace server {

// Makes the log of this program: standard error, from a thread of its own, so that a terminal that is paused, or a pipe that
// nobody reads, stops nobody who logs. What does not fit into a queue of some lines meanwhile is dropped and counted, and the
// count is told when there is room again. flush() of the logger waits a moment for the queue to be written.
void start_log();

// The same before `out`, which is the only one that may have to wait.
spdlog::sink_ptr make_patient_sink(spdlog::sink_ptr out);

}  // namespace server
