#include "server/client_jobs.hpp"

#include <spdlog/fmt/fmt.h>

#include <utility>

#include "server/refused.hpp"

namespace server {

void ClientJobs::put(const Address& from, std::function<void()> work, std::function<void()> done) {
  if (at_work_.contains(from.client)) {
    throw Refused(proto::Error::BUSY, "another request of this client is being looked at: wait for its answer");
  }
  const bool taken = workbench_.add({std::move(work), [this, from, done = std::move(done)](const std::exception_ptr& thrown) {
                                       at_work_.erase(from.client);
                                       try {
                                         if (thrown) std::rethrow_exception(thrown);
                                         done();
                                       } catch (...) {
                                         answers_.refuse(from, std::current_exception());
                                       }
                                     }});
  if (!taken) {
    throw Refused(proto::Error::BUSY,
                  fmt::format("{} skills of other clients are being looked at: try again", Workbench::kMostJobs));
  }
  at_work_.insert(from.client);
}

}  // namespace server
