#include "server/black_box.hpp"

#include <cstddef>
#include <utility>

#include "server/shared_memory.hpp"

namespace server {
namespace {

constexpr std::size_t kPage = 4096;

constexpr std::size_t whole_pages(std::size_t size) { return (size + kPage - 1) / kPage * kPage; }

std::size_t journal_size() { return whole_pages(Journal::size()); }
std::size_t records_size() { return whole_pages(bridge::Ring<realtime::Record>::size(BlackBox::kRecords)); }

// Memory of the journal, then of the records, which share its life.
std::pair<std::shared_ptr<void>, std::shared_ptr<void>> map(int fd) {
  const std::shared_ptr<void> all = map_memory(fd, journal_size() + records_size());
  return {all, std::shared_ptr<void>(all, static_cast<std::byte*>(all.get()) + journal_size())};
}

}  // namespace

BlackBox::BlackBox(bridge::Ring<realtime::Record> of_records, Journal of_journal)
    : records(std::move(of_records)), journal(std::move(of_journal)) {}

BlackBox::BlackBox(std::shared_ptr<void> journal_memory, std::shared_ptr<void> records_memory)
    : records(std::move(records_memory), kRecords), journal(std::move(journal_memory)) {}

BlackBox::BlackBox() : BlackBox(in(-1)) {}

BlackBox BlackBox::in(int fd) {
  auto [journal, records] = map(fd);
  return BlackBox(std::move(journal), std::move(records));
}

std::unique_ptr<BlackBox> BlackBox::found(int fd) {
  auto [journal, records] = map(fd);
  std::unique_ptr<BlackBox> box(new BlackBox(bridge::Ring<realtime::Record>::found(std::move(records), kRecords),
                                             Journal::found(std::move(journal))));
  return box->records.written() == 0 ? nullptr : std::move(box);
}

int make_black_box_file() { return make_memory_file("black box", journal_size() + records_size()); }

}  // namespace server
