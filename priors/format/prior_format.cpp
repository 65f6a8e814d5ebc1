#include <kys_slam/prior_format.h>

#include <bit>
#include <cmath>
#include <cstring>

namespace kys_slam::prior_format {
namespace {

using Tables = std::array<std::array<std::uint32_t, 256>, 8>;

Tables make_crc_tables() {
  Tables tables{};
  for (std::uint32_t i = 0; i < 256; ++i) {
    std::uint32_t c = i;
    for (int bit = 0; bit < 8; ++bit) c = (c >> 1) ^ ((c & 1) ? 0xEDB88320u : 0u);
    tables[0][i] = c;
  }
  for (std::size_t t = 1; t < 8; ++t) {
    for (std::size_t i = 0; i < 256; ++i) {
      const std::uint32_t c = tables[t - 1][i];
      tables[t][i] = (c >> 8) ^ tables[0][c & 0xFF];
    }
  }
  return tables;
}

}  // namespace

const std::array<float, 256>& motion_of_code() {
  static const std::array<float, 256> table = [] {
    std::array<float, 256> values{};
    for (int q = 0; q < 256; ++q) {
      values[static_cast<std::size_t>(q)] =
          static_cast<float>(std::expm1(q * std::log(101.0) / 255.0));
    }
    values[255] = 100.0F;
    return values;
  }();
  return table;
}

std::uint32_t crc32(const std::uint8_t* bytes, std::size_t size) {
  static const Tables t = make_crc_tables();
  std::uint32_t c = 0xFFFFFFFFu;
  // Eight bytes at a time: a file is checked while the tracker waits for it.
  if constexpr (std::endian::native == std::endian::little) {
    for (; size >= 8; size -= 8, bytes += 8) {
      std::uint32_t lo = 0, hi = 0;
      std::memcpy(&lo, bytes, 4);
      std::memcpy(&hi, bytes + 4, 4);
      lo ^= c;
      c = t[7][lo & 0xFF] ^ t[6][(lo >> 8) & 0xFF] ^ t[5][(lo >> 16) & 0xFF] ^ t[4][lo >> 24] ^
          t[3][hi & 0xFF] ^ t[2][(hi >> 8) & 0xFF] ^ t[1][(hi >> 16) & 0xFF] ^ t[0][hi >> 24];
    }
  }
  for (; size > 0; --size, ++bytes) c = (c >> 8) ^ t[0][(c ^ *bytes) & 0xFF];
  return ~c;
}

}  // namespace kys_slam::prior_format
