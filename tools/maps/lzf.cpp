// SPDX-License-Identifier: BSD-3-Clause
#include "lzf.h"

#include <stdexcept>

namespace kys_slam {

namespace {

constexpr std::size_t kLiterals = 32;  // control bytes below: that many bytes and one follow
constexpr std::size_t kLongCopy = 7;   // upper three bits: a byte of length follows

[[noreturn]] void refuse_packed() {
  throw std::invalid_argument("is compressed, and damaged");
}

}  // namespace

std::string unpack_lzf(std::string_view packed, std::size_t size) {
  if (size > kMostLzfGrowth * packed.size()) refuse_packed();
  std::string out;
  out.reserve(size);
  std::size_t at = 0;
  const auto next = [&] {
    if (at == packed.size()) refuse_packed();
    return std::size_t{static_cast<unsigned char>(packed[at++])};
  };
  while (at < packed.size()) {
    const std::size_t control = next();
    if (control < kLiterals) {
      const std::size_t count = control + 1;
      if (count > packed.size() - at || count > size - out.size()) refuse_packed();
      out.append(packed, at, count);
      at += count;
      continue;
    }
    std::size_t count = control / kLiterals;
    if (count == kLongCopy) count += next();
    count += 2;
    const std::size_t back = (control % kLiterals) * 256 + next() + 1;
    if (back > out.size() || count > size - out.size()) refuse_packed();
    // What is copied may begin with bytes that this copy makes.
    for (std::size_t k = 0; k < count; ++k) out.push_back(out[out.size() - back]);
  }
  if (out.size() != size) refuse_packed();
  return out;
}

}  // namespace kys_slam
