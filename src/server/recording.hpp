#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>

#include "frankapy/proto/state.pb.h"
#include "server/black_box.hpp"
#include "server/mcap_writer.hpp"

namespace server {

// A file that what an arm does is written to, from a black box: its states (topic "/states", ArmState) and what the journal has
// ("/skills", "/log", and "/sensors/..." under the sensors' own names). Errors of the file are thrown as std::system_error.
class Recording {
 public:
  struct Options {
    std::uint64_t past = 0;       // records from before then to begin with, and what the journal has of that time
    std::uint64_t idle_step = 1;  // of states in which the robot holds itself, one in so many
    std::optional<std::uint64_t> then{};  // how many records there were; not said: now
    std::optional<std::uint64_t> place{};  // in the journal, from where on to take all of it; not said: what is of the past
  };

  // `about`: told in the file's metadata. The file must not exist yet.
  Recording(const BlackBox& box, const std::filesystem::path& path, const Options& options,
            const McapWriter::Metadata& about);

  // For one that goes on where this one has come to.
  Options next() const { return {0, options_.idle_step, records_.position(), place_}; }

  // Writes what is new, a chunk of it at most every kFlush.
  void write();
  void close();

  const std::filesystem::path& path() const { return path_; }
  std::uint64_t size() const { return file_.size() + file_.pending() / 4; }  // bytes, as good as
  std::uint64_t states() const { return states_; }                           // written
  std::uint64_t lost() const { return records_.lost(); }                     // overwritten before they were written
  std::uint64_t lost_bytes() const { return lost_bytes_; }                   // of what the journal had, or under too many topics
  double time() const { return 1e-9 * static_cast<double>(last_ns_ - first_ns_); }  // s from the first state to the last

 private:
  static constexpr std::int64_t kFlush = 200'000'000;  // ns

  void write(const realtime::Record& record);
  void write(const Journal::Entry& entry);
  std::uint16_t channel(const std::string& topic, const std::string& type);

  const BlackBox& box_;
  const std::filesystem::path path_;
  const Options options_;
  McapWriter file_;
  bridge::RingReader<realtime::Record> records_;
  std::uint64_t place_;  // in the journal
  std::uint64_t lost_bytes_ = 0;
  std::int64_t oldest_ns_ = 0;  // of the journal's that is wanted

  std::map<std::string, std::uint16_t> schemas_, channels_;  // by type; by topic and type
  realtime::Record record_;
  Journal::Entry entry_;
  frankapy::proto::ArmState state_;
  std::string bytes_;
  std::uint64_t states_ = 0;
  std::int64_t first_ns_ = 0, last_ns_ = 0, flushed_ns_ = 0;
};

}  // namespace server
