// Runs a fuzz target without libFuzzer: `<target> CORPUS [SECONDS [SEED]]`. First every file of the corpus, then mutations
// of them for so long. With clang the same target links with -fsanitize=fuzzer instead of this file.

#include <sys/resource.h>
#include <sys/time.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

// What is freed the address sanitizer keeps back, 256 MB of it unless told, and memory would seem to grow with the number of runs.
extern "C" const char* __asan_default_options() { return "quarantine_size_mb=16"; }

namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr std::size_t kMaxSize = 16384;
constexpr int kMaxMutations = 6;       // of one input
constexpr long kMaxGrowth = 64 << 10;  // KiB after the first runs: memory must not grow with what is sent
constexpr int kWarmUp = 500;           // runs
constexpr itimerval kLongest{{}, {20, 0}};  // s of the processor, for one input: what takes longer hangs

Bytes input;
std::string target;

// What is running when the program dies or hangs is kept.
void keep_input(int signal) {
  const std::string file = (signal == SIGPROF ? "hang-" : "crash-") + target;
  if (std::FILE* out = std::fopen(file.c_str(), "wb")) {
    std::fwrite(input.data(), 1, input.size(), out);
    std::fclose(out);
  }
  std::fprintf(stderr, "signal %d; its input is in %s\n", signal, file.c_str());
  std::signal(signal, SIG_DFL);
  std::raise(signal);
}

long resident() {
  rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  return usage.ru_maxrss;  // KiB
}

class Mutator {
 public:
  Mutator(const std::vector<Bytes>& corpus, std::uint64_t seed) : corpus_(corpus), random_(seed) {}

  Bytes next() {
    Bytes bytes = any();
    for (int i = pick(1, kMaxMutations); i > 0; --i) mutate(bytes);
    if (bytes.size() > kMaxSize) bytes.resize(kMaxSize);
    return bytes;
  }

 private:
  int pick(std::size_t from, std::size_t to) {
    return static_cast<int>(std::uniform_int_distribution<std::size_t>(from, to)(random_));
  }
  const Bytes& any() { return corpus_[pick(0, corpus_.size() - 1)]; }
  std::ptrdiff_t place(const Bytes& bytes) { return pick(0, bytes.size()); }

  void mutate(Bytes& bytes) {
    static constexpr std::array<std::uint8_t, 8> kEdges = {0x00, 0x01, 0x7f, 0x80, 0xff, 0xf0, 0x10, 0x39};
    const std::ptrdiff_t at = place(bytes);
    const std::ptrdiff_t length = std::min<std::ptrdiff_t>(pick(1, 64), static_cast<std::ptrdiff_t>(bytes.size()) - at);
    switch (pick(0, 7)) {
      case 0:
        if (length > 0) bytes[at] ^= static_cast<std::uint8_t>(1 << pick(0, 7));
        break;
      case 1:
        if (length > 0) bytes[at] = kEdges[pick(0, kEdges.size() - 1)];
        break;
      case 2:
        if (length > 0) bytes[at] = static_cast<std::uint8_t>(pick(0, 255));
        break;
      case 3:  // eight bytes alike: NaN, zero, infinities of any width
        std::fill_n(bytes.begin() + at, std::min<std::ptrdiff_t>(length, 8), kEdges[pick(0, kEdges.size() - 1)]);
        break;
      case 4: bytes.erase(bytes.begin() + at, bytes.begin() + at + length); break;
      case 5: {
        const Bytes copy(bytes.begin() + at, bytes.begin() + at + length);
        const std::ptrdiff_t to = place(bytes);
        bytes.insert(bytes.begin() + to, copy.begin(), copy.end());
        break;
      }
      case 6: {  // the rest from another
        const Bytes& other = any();
        bytes.resize(at);
        bytes.insert(bytes.end(), other.begin() + std::min(at, static_cast<std::ptrdiff_t>(other.size())), other.end());
        break;
      }
      default: {
        Bytes more(pick(1, 32));
        std::generate(more.begin(), more.end(), [this] { return static_cast<std::uint8_t>(pick(0, 255)); });
        bytes.insert(bytes.begin() + at, more.begin(), more.end());
      }
    }
  }

  const std::vector<Bytes>& corpus_;
  std::mt19937_64 random_;
};

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) {
    std::fprintf(stderr, "usage: %s CORPUS [SECONDS [SEED]]\n", argv[0]);
    return 2;
  }
  target = std::filesystem::path(argv[0]).filename();
  const double seconds = argc > 2 ? std::atof(argv[2]) : 0;
  const std::uint64_t seed = argc > 3 ? std::strtoull(argv[3], nullptr, 10) : std::random_device()();
  for (const int signal : {SIGSEGV, SIGABRT, SIGFPE, SIGILL, SIGBUS, SIGPROF}) std::signal(signal, keep_input);

  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(argv[1])) files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  std::vector<Bytes> corpus;
  for (const auto& file : files) {
    std::ifstream in(file, std::ios::binary);
    corpus.emplace_back(std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>());
  }
  if (corpus.empty()) {
    std::fprintf(stderr, "%s holds no files\n", argv[1]);
    return 2;
  }

  std::fprintf(stderr, "seed %llu\n", static_cast<unsigned long long>(seed));
  const auto run = [](Bytes bytes) {
    input = std::move(bytes);
    ::setitimer(ITIMER_PROF, &kLongest, nullptr);
    LLVMFuzzerTestOneInput(input.data(), input.size());
  };
  for (const Bytes& bytes : corpus) run(bytes);

  Mutator mutator(corpus, seed);
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  long runs = 0, before = 0;
  for (; std::chrono::steady_clock::now() < end; ++runs) {
    run(mutator.next());
    if (runs == kWarmUp) before = resident();
    if (runs > kWarmUp && resident() - before > kMaxGrowth) {
      std::fprintf(stderr, "memory has grown by %ld KiB over %ld runs\n", resident() - before, runs);
      return 1;
    }
  }
  std::fprintf(stderr, "%zu files and %ld mutations of them\n", corpus.size(), runs);
}
