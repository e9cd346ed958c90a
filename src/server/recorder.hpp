#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "frankapy/proto/service.pb.h"
#include "server/black_box.hpp"
#include "server/config.hpp"
#include "server/recording.hpp"

namespace server {

class Gripper;

// The folder of an arm's recordings: names by time, and never more on the disk than is allowed.
class RecordingFolder {
 public:
  RecordingFolder(const RecordingsConfig& config, const std::string& arm);

  // A path for a new file: "2026-11-22T14-53-10.123Z-<what>.mcap" in the folder.
  std::filesystem::path path_now(const std::string& what) const;
  // The same; the folder is made where it is missing. Throws std::system_error.
  std::filesystem::path new_file(const std::string& what) const;
  void make() const;

  // Deletes the oldest files, none of the open ones, until all are within the limit; false when that is not enough.
  bool make_room(const std::vector<std::filesystem::path>& open) const;

 private:
  const std::filesystem::path folder_;
  const std::uint64_t most_;  // bytes
};

// Writes an arm's recordings, in a thread of its own: each skill or all the time, as configured or asked for, in files that are
// changed by size and time; and the black box, the ten seconds before an error and one after it. A disk that is full or slow
// costs the recording, which is told, and nothing else.
class Recorder {
 public:
  // `gripper` may be null.
  Recorder(BlackBox& box, const RecordingsConfig& config, const std::string& arm, const Gripper* gripper);
  ~Recorder();

  BlackBox& box() { return box_; }

  // From any thread: what happens now is worth the black box. The file's path, which is complete a second after the last such
  // call; empty where nothing is recorded.
  std::string keep(const std::string& why);

  // What a client asks for: to record all the time or no longer; not said: as it is. And what there is.
  frankapy::proto::RecordingStatus ask(const frankapy::proto::Record& request);

  // How many records it has been through, and how many there are since. From any thread.
  std::uint64_t been_through() const noexcept { return been_through_; }
  std::uint64_t behind() const noexcept { return box_.records.written() - been_through_; }

 private:
  using Clock = std::chrono::steady_clock;

  void run();
  void watch();
  bool wanted() const;
  bool skill_wanted() const;
  void start(const Recording::Options& options);
  void look_after_black_box();
  void tell(const Recording& recording);
  void write(std::unique_ptr<Recording>& recording);
  void look_after_disk();
  void note_gripper();
  void change_file();
  void close(std::unique_ptr<Recording>& recording);
  void end(std::unique_ptr<Recording>& recording);
  void give_up(std::unique_ptr<Recording>& recording, const std::string& why);

  BlackBox& box_;
  const RecordingsConfig config_;
  const std::string arm_;
  const Gripper* gripper_;
  const RecordingFolder folder_;
  bridge::RingReader<realtime::Record> watched_;

  std::unique_ptr<Recording> running_, kept_;
  Clock::time_point started_{}, kept_until_{}, disk_seen_{}, gripper_seen_{};
  std::atomic<Clock::time_point> retry_{};
  std::string gripper_state_;
  realtime::Record record_;
  bool in_error_ = false;
  Clock::time_point heard_{};                          // when a record was last seen
  std::uint64_t skill_began_ = 0, skill_last_seen_ = 0;  // how many records there were before; 0: no skill yet

  mutable std::mutex mutex_;
  bool asked_for_ = false;
  std::string keep_why_, keep_file_;  // what is to be kept, and the file of what is or was last
  bool keeps_ = false;                // keep_file_ is open
  frankapy::proto::RecordingStatus status_;

  std::atomic<std::uint64_t> been_through_;
  std::atomic<bool> quit_{false};
  std::thread thread_;
};

// Writes what an arm's process that has ended left in its black box; the file's path, empty where there was nothing.
std::filesystem::path write_black_box(int fd, const RecordingsConfig& config, const std::string& arm, const std::string& why);

// Writes what servers left that were killed with all of their processes, each to its own folder, and tells of it.
void write_left_black_boxes();

}  // namespace server
