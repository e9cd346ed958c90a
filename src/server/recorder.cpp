#include "server/recorder.hpp"

#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <ctime>
#include <system_error>
#include <utility>
#include <vector>

#include "server/clocks.hpp"
#include "server/convert.hpp"
#include "server/gripper.hpp"

namespace server {
namespace {

namespace fs = std::filesystem;
namespace proto = frankapy::proto;
using namespace std::chrono_literals;

constexpr auto kWritePeriod = 10ms;
constexpr auto kAfterError = 1s;             // that the black box goes on after an error
constexpr std::uint64_t kBeforeSkill = 200;  // records
constexpr std::uint64_t kAfterSkill = 500;   // records
constexpr auto kSilence = 5s;                // without a record, after which a skill is over
constexpr auto kDiskRetry = 10s;             // after the disk has failed
constexpr std::uint64_t kIdleStep = 10;      // 100 Hz while the robot holds itself
constexpr auto kDiskPeriod = 1s;
constexpr auto kGripperPeriod = 50ms;
constexpr std::uint64_t kReserve = 20;       // of this many parts of the room one is left, until it is looked at again
constexpr double kFiles = 4;                 // at least, that the room is for
constexpr double kBytesPerMB = 1e6;

std::string in_file_name(std::string text) {
  for (char& c : text) {
    if (!std::isalnum(static_cast<unsigned char>(c)) && c != '_' && c != '-') c = '-';
  }
  return text.substr(0, 80);
}

McapWriter::Metadata about(const std::string& arm, const std::string& why) { return {{"arm", arm}, {"why", why}}; }

bool in_error(const realtime::Record& record) {
  return record.state.robot_mode == fci::RobotMode::kReflex || fci::any(record.state.errors);
}

}  // namespace

// --- the folder ----------------------------------------------------------------------------------------------------

RecordingFolder::RecordingFolder(const RecordingsConfig& config, const std::string& arm)
    : folder_(fs::path(config.folder) / arm), most_(static_cast<std::uint64_t>(config.max_gb * 1e9)) {}

void RecordingFolder::make() const { fs::create_directories(folder_); }

fs::path RecordingFolder::new_file(const std::string& what) const {
  make();
  return path_now(what);
}

fs::path RecordingFolder::path_now(const std::string& what) const {
  const std::int64_t now = clock_ns(CLOCK_REALTIME);
  const std::time_t second = now / 1'000'000'000;
  std::tm utc{};
  gmtime_r(&second, &utc);
  const std::string time = fmt::format("{:04}-{:02}-{:02}T{:02}-{:02}-{:02}.{:03}Z", utc.tm_year + 1900, utc.tm_mon + 1, utc.tm_mday,
                                       utc.tm_hour, utc.tm_min, utc.tm_sec, now / 1'000'000 % 1000);
  return folder_ / fmt::format("{}-{}.mcap", time, in_file_name(what));
}

bool RecordingFolder::make_room(const std::vector<fs::path>& open) const {
  std::vector<std::pair<fs::path, std::uint64_t>> files;
  std::uint64_t all = 0;
  for (const auto& entry : fs::directory_iterator(folder_)) {
    std::error_code gone;
    if (entry.path().extension() != ".mcap" || !entry.is_regular_file(gone)) continue;
    const std::uint64_t size = entry.file_size(gone);
    if (gone) continue;
    all += size;
    if (std::find(open.begin(), open.end(), entry.path()) == open.end()) files.emplace_back(entry.path(), size);
  }
  std::sort(files.begin(), files.end());  // names begin with the time
  for (const auto& [path, size] : files) {
    if (all <= most_ - most_ / kReserve) break;
    std::error_code error;
    if (fs::remove(path, error)) all -= size;
  }
  return all <= most_;
}

// --- the recorder --------------------------------------------------------------------------------------------------

Recorder::Recorder(BlackBox& box, const RecordingsConfig& config, const std::string& arm, const Gripper* gripper)
    : box_(box),
      config_(config),
      arm_(arm),
      gripper_(gripper),
      folder_(config, arm),
      watched_(box.records),
      been_through_(box.records.written()) {
  thread_ = std::thread([this] { run(); });
}

Recorder::~Recorder() {
  quit_ = true;
  thread_.join();
}

std::string Recorder::keep(const std::string& why) {
  if (config_.mode == RecordingsConfig::Mode::kOff) return {};
  const std::lock_guard lock(mutex_);
  if (!keeps_ && keep_why_.empty()) keep_file_ = folder_.path_now("error-" + why);
  if (keep_why_.empty()) keep_why_ = why;
  return keep_file_;
}

proto::RecordingStatus Recorder::ask(const proto::Record& request) {
  const std::lock_guard lock(mutex_);
  if (request.on() && !asked_for_) {  // what stood in the way of others may be gone
    status_.clear_error();
    retry_ = Clock::time_point{};
  }
  if (request.has_on()) asked_for_ = request.on();
  return status_;
}

void Recorder::run() {
  while (!quit_) {
    const std::uint64_t there = box_.records.written();
    watch();
    note_gripper();
    if (!wanted()) {
      close(running_);
    } else if (!running_ && Clock::now() >= retry_.load()) {
      // From the skill's begin on, however late it is: states come while the file is opened.
      start(skill_wanted() ? Recording::Options{kBeforeSkill, kIdleStep, skill_began_} : Recording::Options{0, kIdleStep});
    }
    look_after_black_box();
    write(running_);
    write(kept_);
    look_after_disk();
    // Of little room a file is a part, or its end would be that of recording.
    const double most_of_file = std::min(config_.file_mb * kBytesPerMB, 1e9 * config_.max_gb / kFiles);
    if (running_ && (running_->size() > most_of_file ||
                     Clock::now() - started_ > std::chrono::duration<double>(60 * config_.file_minutes))) {
      change_file();
    }
    if (running_) tell(*running_);
    {
      const std::lock_guard lock(mutex_);
      status_.set_open(running_ != nullptr);
    }
    been_through_ = there;
    std::this_thread::sleep_for(kWritePeriod);
  }
  watch();
  look_after_black_box();
  close(running_);
  close(kept_);
}

void Recorder::tell(const Recording& recording) {
  const std::lock_guard lock(mutex_);
  status_.set_file(recording.path());
  status_.set_bytes(recording.size());
  status_.set_states(recording.states());
  status_.set_lost(recording.lost());
  status_.set_time(recording.time());
}

void Recorder::write(std::unique_ptr<Recording>& recording) {
  if (!recording) return;
  try {
    recording->write();
  } catch (const std::system_error& error) {
    give_up(recording, error.what());
  }
}

void Recorder::look_after_disk() {
  if ((!running_ && !kept_) || Clock::now() - disk_seen_ < kDiskPeriod) return;
  disk_seen_ = Clock::now();
  std::vector<fs::path> open;
  for (const auto* recording : {&running_, &kept_}) {
    if (*recording) open.push_back((*recording)->path());
  }
  try {
    if (folder_.make_room(open)) return;
  } catch (const std::system_error& error) {
    spdlog::warn("{}", error.what());
    return;
  }
  for (auto* recording : {&running_, &kept_}) {
    if (*recording) give_up(*recording, fmt::format("recordings would take more than the {} GB that they may", config_.max_gb));
  }
}

void Recorder::note_gripper() {
  if (gripper_ == nullptr || Clock::now() - gripper_seen_ < kGripperPeriod) return;
  gripper_seen_ = Clock::now();
  proto::ArmState state;
  gripper_->put_state(state);
  if (!state.has_gripper()) return;
  std::string bytes = state.gripper().SerializeAsString();
  if (bytes == gripper_state_) return;
  box_.journal.note("/gripper", state.gripper().GetTypeName(), bytes);
  gripper_state_ = std::move(bytes);
}

// Looks at every record for what begins or ends.
void Recorder::watch() {
  while (watched_.next(record_)) {
    heard_ = Clock::now();
    if (record_.skill_id != 0) {
      // In records, not by the clock: this thread may come late, and a skill is one recording all the same.
      if (!skill_wanted()) skill_began_ = watched_.position();
      skill_last_seen_ = watched_.position();
    }
    const bool was = std::exchange(in_error_, in_error(record_));
    if (in_error_ && !was) keep(errors_of(record_.state));
  }
}

bool Recorder::wanted() const {
  if (config_.mode == RecordingsConfig::Mode::kAlways) return true;
  {
    const std::lock_guard lock(mutex_);
    if (asked_for_) return true;
  }
  return skill_wanted();
}

bool Recorder::skill_wanted() const {
  return config_.mode == RecordingsConfig::Mode::kSkills && skill_last_seen_ != 0 &&
         watched_.position() - skill_last_seen_ < kAfterSkill && Clock::now() - heard_ < kSilence;
}

void Recorder::start(const Recording::Options& options) {
  const char* what = skill_wanted() ? "skill" : "all";
  try {
    running_ = std::make_unique<Recording>(box_, folder_.new_file(what), options, about(arm_, what));
    started_ = Clock::now();
    const std::lock_guard lock(mutex_);
    if (!asked_for_) status_.clear_error();  // else who asked is to know
  } catch (const std::system_error& error) {
    give_up(running_, error.what());
  }
}

// The ten seconds before what it is kept for, and one after it.
void Recorder::look_after_black_box() {
  std::string why, path;
  {
    const std::lock_guard lock(mutex_);
    const bool over = kept_ && keep_why_.empty() && Clock::now() > kept_until_;
    keeps_ = !over && (kept_ || !keep_why_.empty());
    why = std::exchange(keep_why_, {});
    path = keep_file_;
  }
  if (!why.empty()) {
    kept_until_ = Clock::now() + kAfterError;
    if (!kept_) {
      try {
        folder_.make();
        kept_ = std::make_unique<Recording>(box_, path, Recording::Options{BlackBox::kKept, 1}, about(arm_, why));
        spdlog::info("the black box is written to {}", path);
      } catch (const std::system_error& error) {
        give_up(kept_, error.what());
      }
    }
  }
  if (!keeps_) close(kept_);
}

// Nothing twice, and nothing left out.
void Recorder::change_file() {
  std::unique_ptr<Recording> full = std::move(running_);
  start(full->next());
  end(full);
}

void Recorder::close(std::unique_ptr<Recording>& recording) {
  write(recording);
  end(recording);
}

void Recorder::end(std::unique_ptr<Recording>& recording) {
  if (!recording) return;
  try {
    recording->close();
    if (&recording == &running_) tell(*recording);  // all that there came to be in it
    if (recording->lost() > 0) spdlog::warn("{}: {} states were lost, as the disk is too slow", recording->path().string(), recording->lost());
  } catch (const std::system_error& error) {
    give_up(recording, error.what());
  }
  recording.reset();
}

void Recorder::give_up(std::unique_ptr<Recording>& recording, const std::string& why) {
  const bool again = &recording == &running_;
  recording.reset();
  if (again) retry_ = Clock::now() + kDiskRetry;
  spdlog::error("not recorded: {}{}", why, again ? fmt::format(". Next attempt in {} s", kDiskRetry / 1s) : "");
  const std::lock_guard lock(mutex_);
  status_.set_error(why);
}

fs::path write_black_box(int fd, const RecordingsConfig& config, const std::string& arm, const std::string& why) {
  if (config.mode == RecordingsConfig::Mode::kOff) return {};
  const auto box = BlackBox::found(fd);
  if (!box) return {};
  const RecordingFolder folder(config, arm);
  const fs::path path = folder.new_file("crash-" + why);
  Recording recording(*box, path, {BlackBox::kKept, 1}, about(arm, why));
  recording.write();
  recording.close();
  folder.make_room({path});
  return path;
}

void write_left_black_boxes() {
  for (const auto& [fd, owner] : left_black_boxes()) {
    RecordingsConfig config;
    config.folder = owner.folder;
    config.max_gb = owner.max_gb;
    try {
      const fs::path path = write_black_box(fd, config, owner.arm, "the server was killed");
      if (!path.empty()) spdlog::info("a server was killed: the black box of its arm {} is in {}", owner.arm, path.string());
      forget_black_box(fd);
    } catch (const std::exception& error) {
      spdlog::error("a server was killed: the black box of its arm {} was not written: {}. {}", owner.arm, error.what(),
                    leave_black_box(fd));
    }
    close(fd);
  }
}

}  // namespace server
