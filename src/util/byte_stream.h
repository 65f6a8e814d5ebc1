// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstring>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

/// Little-endian numbers in a byte sequence, as in all our binary files.
namespace kys_slam::byte_stream {

/// The bytes violate the format. The message does not contain the name of the file.
struct Damage : std::runtime_error {
  using std::runtime_error::runtime_error;
};

inline void require(bool good, const char* what) {
  if (!good) throw Damage(what);
}

/// Appends little-endian numbers.
class ByteWriter {
 public:
  void u8(std::uint8_t x) { bytes_.push_back(x); }
  void u16(std::uint16_t x) { number(x); }
  void u32(std::uint32_t x) { number(x); }
  void u64(std::uint64_t x) { number(x); }
  void f32(float x) { number(std::bit_cast<std::uint32_t>(x)); }
  void f64(double x) { number(std::bit_cast<std::uint64_t>(x)); }
  void raw(std::span<const std::uint8_t> bytes) {
    const std::size_t at = bytes_.size();
    bytes_.resize(at + bytes.size());
    std::copy(bytes.begin(), bytes.end(), bytes_.begin() + static_cast<std::ptrdiff_t>(at));
  }
  void reserve(std::size_t size) { bytes_.reserve(size); }
  void put_u32(std::size_t at, std::uint32_t x) { put(at, x); }
  void put_u64(std::size_t at, std::uint64_t x) { put(at, x); }

  [[nodiscard]] std::size_t size() const { return bytes_.size(); }
  [[nodiscard]] const std::vector<std::uint8_t>& bytes() const { return bytes_; }
  [[nodiscard]] std::vector<std::uint8_t>& bytes() { return bytes_; }
  void clear() { bytes_.clear(); }

 private:
  template <typename T>
  void number(T x) {
    const std::size_t at = bytes_.size();
    bytes_.resize(at + sizeof(T));
    put(at, x);
  }
  template <typename T>
  void put(std::size_t at, T x) {
    for (std::size_t i = 0; i < sizeof(T); ++i) {
      bytes_[at + i] = static_cast<std::uint8_t>(x >> (8 * i));
    }
  }

  std::vector<std::uint8_t> bytes_;
};

/// Reads little-endian numbers in sequence. \throws Damage beyond the end.
class ByteReader {
 public:
  explicit ByteReader(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}

  std::uint8_t u8() { return number<std::uint8_t>(); }
  std::uint16_t u16() { return number<std::uint16_t>(); }
  std::uint32_t u32() { return number<std::uint32_t>(); }
  std::uint64_t u64() { return number<std::uint64_t>(); }
  float f32() { return std::bit_cast<float>(u32()); }
  double f64() { return std::bit_cast<double>(u64()); }
  std::span<const std::uint8_t> raw(std::size_t size) {
    require(size <= bytes_.size(), "is truncated");
    const auto front = bytes_.first(size);
    bytes_ = bytes_.subspan(size);
    return front;
  }
  /// Reads a number of elements. \throws Damage when that many elements of `size` bytes exceed the
  /// remaining bytes, so that the caller can allocate memory for them.
  std::size_t count(std::size_t size) {
    const std::uint32_t n = u32();
    require(n <= bytes_.size() / size, "has a count larger than what follows it");
    return n;
  }
  [[nodiscard]] std::size_t left() const { return bytes_.size(); }
  void expect_end() const { require(left() == 0, "has bytes left over"); }

 private:
  template <typename T>
  T number() {
    const auto front = raw(sizeof(T));
    T x = 0;
    for (std::size_t i = 0; i < sizeof(T); ++i) x = static_cast<T>(x | T{front[i]} << (8 * i));
    return x;
  }

  std::span<const std::uint8_t> bytes_;
};

}  // namespace kys_slam::byte_stream
