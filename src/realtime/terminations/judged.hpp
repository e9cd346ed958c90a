#pragma once

namespace realtime {

// Which of the two a termination that knows a goal looks at.
enum class Judged {
  kReference,  // commanded; it waits for an arm that is held
  kArm,        // measured
};

}  // namespace realtime
