#pragma once

// How a struct becomes packed little-endian bytes. Every struct of this folder has one function
//
//   template <class Visitor, class Self> void walk(Visitor& v, Self& self);
//
// which names its fields in wire order; writing, reading, measuring and listing are visitors of it,
// so a field exists in one place for all protocol versions.

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

namespace fci {

static_assert(std::endian::native == std::endian::little, "the wire is little-endian");

// Protocol version of the arm's server, as exchanged by Connect.
using Version = std::uint16_t;
inline constexpr Version kOldestVersion = 5;   // Panda system 4.2.1, libfranka 0.9
inline constexpr Version kNewestVersion = 10;  // FR3 system 5.9.0, libfranka 0.18 to 0.21
inline constexpr Version kFloatStateVersion = 10;  // from here on the state's reals are float32

namespace detail {
template <class T>
struct Elements {
  static constexpr std::size_t kCount = 1;
  using Type = T;
};
template <class T, std::size_t N>
struct Elements<std::array<T, N>> {
  static constexpr std::size_t kCount = N;
  using Type = T;
};
template <class T>
struct Elements<const T> : Elements<T> {};
}  // namespace detail

// What the visitors share: `field<Wire>` is a field of that wire type, `real` one that is float64
// up to version 9 and float32 from version 10 (robot states only).
template <class Derived>
class Visitor {
 public:
  explicit Visitor(Version version) : version_(version) {}
  Version version() const { return version_; }

  template <class T>
  void real(const char* name, T& value) {
    if (version_ >= kFloatStateVersion) {
      self().template field<float>(name, value);
    } else {
      self().template field<double>(name, value);
    }
  }
  template <class T>
  void f64(const char* name, T& value) {
    self().template field<double>(name, value);
  }
  template <class T>
  void u8(const char* name, T& value) {  // also bool, bool arrays and enums of one byte
    self().template field<std::uint8_t>(name, value);
  }
  template <class T>
  void u16(const char* name, T& value) {
    self().template field<std::uint16_t>(name, value);
  }
  template <class T>
  void u32(const char* name, T& value) {
    self().template field<std::uint32_t>(name, value);
  }
  template <class T>
  void u64(const char* name, T& value) {
    self().template field<std::uint64_t>(name, value);
  }

 private:
  Derived& self() { return static_cast<Derived&>(*this); }
  Version version_;
};

class Writer : public Visitor<Writer> {
 public:
  Writer(Version version, std::byte* out) : Visitor(version), at_(out) {}

  template <class Wire, class T>
  void field(const char*, const T& value) {
    if constexpr (detail::Elements<T>::kCount == 1 && !requires { value[0]; }) {
      put(static_cast<Wire>(value));
    } else {
      for (const auto& element : value) put(static_cast<Wire>(element));
    }
  }

 private:
  template <class Wire>
  void put(Wire wire) {
    std::memcpy(at_, &wire, sizeof(Wire));
    at_ += sizeof(Wire);
  }
  std::byte* at_;
};

// Reads without checks: the caller has compared the size of what arrived with size_of().
class Reader : public Visitor<Reader> {
 public:
  Reader(Version version, const std::byte* in) : Visitor(version), at_(in) {}

  template <class Wire, class T>
  void field(const char*, T& value) {
    if constexpr (detail::Elements<T>::kCount == 1 && !requires { value[0]; }) {
      value = get<Wire, T>();
    } else {
      for (auto& element : value) element = get<Wire, typename detail::Elements<T>::Type>();
    }
  }

 private:
  template <class Wire, class T>
  T get() {
    Wire wire;
    std::memcpy(&wire, at_, sizeof(Wire));
    at_ += sizeof(Wire);
    return static_cast<T>(wire);
  }
  const std::byte* at_;
};

struct Field {
  std::string name;
  std::size_t offset = 0;  // bytes from the start of the struct
  std::size_t size = 0;    // bytes
  std::size_t count = 1;   // elements
};

class Lister : public Visitor<Lister> {
 public:
  explicit Lister(Version version) : Visitor(version) {}

  template <class Wire, class T>
  void field(const char* name, T&) {
    constexpr std::size_t count = detail::Elements<T>::kCount;
    fields.push_back({name, total, count * sizeof(Wire), count});
    total += count * sizeof(Wire);
  }
  std::vector<Field> fields;
  std::size_t total = 0;  // bytes
};

class Measure : public Visitor<Measure> {
 public:
  explicit Measure(Version version) : Visitor(version) {}

  template <class Wire, class T>
  void field(const char*, T&) {
    total += detail::Elements<T>::kCount * sizeof(Wire);
  }
  std::size_t total = 0;  // bytes
};

// Bytes of a T on the wire.
template <class T>
std::size_t size_of(Version version) {
  T value{};
  Measure measure(version);
  walk(measure, value);
  return measure.total;
}

// Writes `value` to `out`, which has room for size_of<T>(version); returns the bytes written.
template <class T>
std::size_t write(Version version, const T& value, std::span<std::byte> out) {
  Writer writer(version, out.data());
  walk(writer, value);
  return size_of<T>(version);
}

// Reads a T from `in`. False, and `value` untouched, when `in` is shorter than a T is in this version.
template <class T>
bool read(Version version, std::span<const std::byte> in, T& value) {
  if (in.size() < size_of<T>(version)) return false;
  Reader reader(version, in.data());
  walk(reader, value);
  return true;
}

}  // namespace fci
