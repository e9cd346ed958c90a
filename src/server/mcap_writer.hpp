#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

struct ZSTD_CCtx_s;

namespace server {

// Writes an MCAP file (mcap.dev/spec, version 0) of chunks that zstd has compressed: what was flushed is readable whatever
// becomes of the process, and the file complete after close(). Throws std::system_error where the file cannot be made or
// written to; it is then closed. Not for several threads.
class McapWriter {
 public:
  using Metadata = std::map<std::string, std::string>;

  // The file must not exist yet.
  explicit McapWriter(const std::filesystem::path& path);
  // Closes, and forgives.
  ~McapWriter();
  McapWriter(const McapWriter&) = delete;

  // A protobuf message type: its full name and a FileDescriptorSet that has all it needs.
  std::uint16_t add_schema(const std::string& name, const std::string& descriptors);
  std::uint16_t add_channel(std::uint16_t schema, const std::string& topic);
  // Times in ns since 1970: when it was logged and when it was sent.
  void write(std::uint16_t channel, std::uint32_t sequence, std::int64_t log_time, std::int64_t publish_time,
             std::string_view bytes);
  void add_metadata(const std::string& name, const Metadata& values);

  // The chunk to the disk. Without it a chunk ends at kChunk.
  void flush();
  void close();

  std::uint64_t size() const { return size_; }          // bytes in the file
  std::uint64_t pending() const { return chunk_.size(); }  // bytes not yet in it

 private:
  static constexpr std::size_t kChunk = 4 << 20;  // bytes, before compression

  struct FreeContext {
    void operator()(ZSTD_CCtx_s* context) const;
  };
  struct Channel {
    std::uint64_t messages = 0;
    std::string index;  // of the chunk: entries of MessageIndex
  };
  struct Times {
    std::uint64_t first = 0, last = 0;
    bool any = false;
    void add(std::uint64_t time);
  };

  void put(const std::string& bytes);
  [[noreturn]] void fail(const char* what);

  const std::filesystem::path path_;
  int fd_ = -1;
  const std::unique_ptr<ZSTD_CCtx_s, FreeContext> zstd_;
  std::uint64_t size_ = 0, messages_ = 0;
  std::string chunk_, compressed_;
  Times chunk_times_, times_;
  std::vector<Channel> channels_;       // by id, from 1
  std::vector<std::string> schemas_;    // their records, for the summary; by id, from 1
  std::vector<std::string> channel_records_;
  std::vector<std::string> chunk_indexes_, metadata_indexes_;
};

}  // namespace server
