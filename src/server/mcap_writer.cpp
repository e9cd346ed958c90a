#include "server/mcap_writer.hpp"

#include <fcntl.h>
#include <unistd.h>
#include <zstd.h>

#include <algorithm>
#include <cerrno>
#include <system_error>

namespace server {
namespace {

constexpr char kMagic[] = "\x89MCAP0\r\n";
constexpr std::string_view kMagicText(kMagic, 8);
constexpr int kLevel = 1;  // of zstd: twice the speed of its default for a few per cent more

enum Opcode : std::uint8_t {
  kHeader = 0x01,
  kFooter = 0x02,
  kSchema = 0x03,
  kChannel = 0x04,
  kMessage = 0x05,
  kChunkRecord = 0x06,
  kMessageIndex = 0x07,
  kChunkIndex = 0x08,
  kStatistics = 0x0B,
  kMetadata = 0x0C,
  kMetadataIndex = 0x0D,
  kDataEnd = 0x0F,
};

// The fields of a record, little-endian.
class Fields {
 public:
  template <class Integer>
  Fields& number(Integer value) {
    for (std::size_t i = 0; i < sizeof value; ++i) bytes_ += static_cast<char>(value >> (8 * i));
    return *this;
  }
  Fields& text(std::string_view value) {
    number(static_cast<std::uint32_t>(value.size()));
    return raw(value);
  }
  Fields& raw(std::string_view value) {
    bytes_ += value;
    return *this;
  }
  Fields& map(const McapWriter::Metadata& values) {
    Fields entries;
    for (const auto& [key, value] : values) entries.text(key).text(value);
    return text(entries.bytes_);
  }
  const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_;
};

std::string record(Opcode opcode, const Fields& fields) {
  return Fields()
      .number(static_cast<std::uint8_t>(opcode))
      .number(static_cast<std::uint64_t>(fields.bytes().size()))
      .raw(fields.bytes())
      .bytes();
}

constexpr std::uint32_t kUnchecked = 0;  // for a CRC

}  // namespace

void McapWriter::Times::add(std::uint64_t time) {
  first = any ? std::min(first, time) : time;
  last = any ? std::max(last, time) : time;
  any = true;
}

McapWriter::McapWriter(const std::filesystem::path& path) : path_(path), zstd_(ZSTD_createCCtx()) {
  fd_ = ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0644);
  if (fd_ < 0) fail("cannot be made");
  ZSTD_CCtx_setParameter(zstd_.get(), ZSTD_c_compressionLevel, kLevel);
  ZSTD_CCtx_setParameter(zstd_.get(), ZSTD_c_checksumFlag, 1);
  try {
    put(std::string(kMagicText) + record(kHeader, Fields().text("").text("franka-interface")));
  } catch (...) {
    ::unlink(path.c_str());  // nothing is in it
    throw;
  }
}

McapWriter::~McapWriter() {
  try {
    close();
  } catch (const std::system_error&) {
  }
}

void McapWriter::FreeContext::operator()(ZSTD_CCtx_s* context) const { ZSTD_freeCCtx(context); }

void McapWriter::fail(const char* what) {
  const int error = errno;
  if (fd_ >= 0) ::close(fd_);
  fd_ = -1;
  throw std::system_error(error, std::generic_category(), path_.string() + " " + what);
}

void McapWriter::put(const std::string& bytes) {
  for (std::size_t done = 0; done < bytes.size();) {
    const ssize_t n = ::write(fd_, bytes.data() + done, bytes.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) fail("cannot be written to");
    done += static_cast<std::size_t>(n);
  }
  size_ += bytes.size();
}

std::uint16_t McapWriter::add_schema(const std::string& name, const std::string& descriptors) {
  const auto id = static_cast<std::uint16_t>(schemas_.size() + 1);
  schemas_.push_back(record(kSchema, Fields().number(id).text(name).text("protobuf").text(descriptors)));
  chunk_ += schemas_.back();
  return id;
}

std::uint16_t McapWriter::add_channel(std::uint16_t schema, const std::string& topic) {
  channels_.emplace_back();
  const auto id = static_cast<std::uint16_t>(channels_.size());
  channel_records_.push_back(
      record(kChannel, Fields().number(id).number(schema).text(topic).text("protobuf").map({})));
  chunk_ += channel_records_.back();
  return id;
}

void McapWriter::write(std::uint16_t channel, std::uint32_t sequence, std::int64_t log_time, std::int64_t publish_time,
                       std::string_view bytes) {
  if (fd_ < 0) return;
  const auto time = static_cast<std::uint64_t>(log_time);
  Channel& of = channels_.at(channel - 1);
  of.index += Fields().number(time).number(static_cast<std::uint64_t>(chunk_.size())).bytes();
  ++of.messages;
  ++messages_;
  chunk_times_.add(time);
  chunk_ += record(kMessage, Fields()
                                 .number(channel)
                                 .number(sequence)
                                 .number(time)
                                 .number(static_cast<std::uint64_t>(publish_time))
                                 .raw(bytes));
  if (chunk_.size() >= kChunk) flush();
}

void McapWriter::add_metadata(const std::string& name, const Metadata& values) {
  if (fd_ < 0) return;
  flush();
  const std::string bytes = record(kMetadata, Fields().text(name).map(values));
  metadata_indexes_.push_back(record(
      kMetadataIndex, Fields().number(size_).number(static_cast<std::uint64_t>(bytes.size())).text(name)));
  put(bytes);
}

void McapWriter::flush() {
  if (fd_ < 0 || chunk_.empty()) return;
  compressed_.resize(ZSTD_compressBound(chunk_.size()));
  const std::size_t compressed =
      ZSTD_compress2(zstd_.get(), compressed_.data(), compressed_.size(), chunk_.data(), chunk_.size());
  if (ZSTD_isError(compressed)) {
    errno = ENOMEM;
    fail("cannot be compressed");
  }
  const auto size = static_cast<std::uint64_t>(chunk_.size());
  const std::string bytes = record(kChunkRecord, Fields()
                                                     .number(chunk_times_.first)
                                                     .number(chunk_times_.last)
                                                     .number(size)
                                                     .number(kUnchecked)
                                                     .text("zstd")
                                                     .number(static_cast<std::uint64_t>(compressed))
                                                     .raw({compressed_.data(), compressed}));
  const std::uint64_t begin = size_;
  std::string indexes;
  Fields offsets;
  for (std::size_t i = 0; i < channels_.size(); ++i) {
    if (channels_[i].index.empty()) continue;
    const auto id = static_cast<std::uint16_t>(i + 1);
    offsets.number(id).number(begin + bytes.size() + indexes.size());
    indexes += record(kMessageIndex, Fields().number(id).text(channels_[i].index));
    channels_[i].index.clear();
  }
  chunk_indexes_.push_back(record(kChunkIndex, Fields()
                                                   .number(chunk_times_.first)
                                                   .number(chunk_times_.last)
                                                   .number(begin)
                                                   .number(static_cast<std::uint64_t>(bytes.size()))
                                                   .text(offsets.bytes())
                                                   .number(static_cast<std::uint64_t>(indexes.size()))
                                                   .text("zstd")
                                                   .number(static_cast<std::uint64_t>(compressed))
                                                   .number(size)));
  if (chunk_times_.any) {
    times_.add(chunk_times_.first);
    times_.add(chunk_times_.last);
  }
  chunk_.clear();
  chunk_times_ = {};
  put(bytes + indexes);
  if (::fdatasync(fd_) != 0 && errno != EINVAL) fail("cannot be written to");
}

void McapWriter::close() {
  if (fd_ < 0) return;
  flush();
  put(record(kDataEnd, Fields().number(kUnchecked)));
  const std::uint64_t summary = size_;
  for (const auto* group : {&schemas_, &channel_records_, &chunk_indexes_, &metadata_indexes_}) {
    for (const auto& bytes : *group) put(bytes);
  }
  Fields counts;
  for (std::size_t i = 0; i < channels_.size(); ++i) {
    counts.number(static_cast<std::uint16_t>(i + 1)).number(channels_[i].messages);
  }
  put(record(kStatistics, Fields()
                              .number(messages_)
                              .number(static_cast<std::uint16_t>(schemas_.size()))
                              .number(static_cast<std::uint32_t>(channels_.size()))
                              .number(std::uint32_t{0})
                              .number(static_cast<std::uint32_t>(metadata_indexes_.size()))
                              .number(static_cast<std::uint32_t>(chunk_indexes_.size()))
                              .number(times_.first)
                              .number(times_.last)
                              .text(counts.bytes())));
  put(record(kFooter, Fields().number(summary).number(std::uint64_t{0}).number(kUnchecked)) + std::string(kMagicText));
  if (::fdatasync(fd_) != 0 && errno != EINVAL) fail("cannot be written to");
  ::close(fd_);
  fd_ = -1;
}

}  // namespace server
