// Whatever bytes: the reader refuses them with InputError or makes a consistent map, and what it
// accepts can be written and read again. Size and checksum are made right
// first, otherwise hardly an input would get past them.
#include <kys_slam/error.h>

#include <cstdlib>

#include "map_file/map_file.h"
#include "map_file/map_format.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace kys_slam;
  namespace mf = map_format;
  std::vector<std::uint8_t> bytes(data, data + size);
  if (size >= mf::kHeaderSize && (bytes[mf::kAtReserved] & 1) == 0) {
    const auto put = [&](std::size_t at, std::uint32_t value) {
      for (std::size_t i = 0; i < 4; ++i) {
        bytes[at + i] = static_cast<std::uint8_t>(value >> (8 * i));
      }
    };
    std::copy(mf::kMagic.begin(), mf::kMagic.end(), bytes.begin());
    put(mf::kAtFileSize, static_cast<std::uint32_t>(size));
    put(mf::kAtFileSize + 4, 0);
    put(mf::kAtChecksum, mf::checksum(std::span(bytes).subspan(mf::kAtChecked)));
  }
  try {
    const Map map = parse_map(std::move(bytes), "fuzz", "cityscapes19");
    const auto once = encode_map(map, "cityscapes19");
    if (encode_map(parse_map(once, "again", "cityscapes19"), "cityscapes19") != once) std::abort();
  } catch (const InputError&) {
  }
  return 0;
}
