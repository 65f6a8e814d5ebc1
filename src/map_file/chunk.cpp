#include <libdeflate.h>

#include <memory>

#include "map_file/byte_stream.h"
#include "map_file/map_format.h"

namespace kys_slam::map_format {

namespace {

constexpr int kLevel = 1;  // descriptors do not shrink; what does, does at the fastest level

struct Free {
  void operator()(libdeflate_compressor* c) const { libdeflate_free_compressor(c); }
  void operator()(libdeflate_decompressor* d) const { libdeflate_free_decompressor(d); }
};

}  // namespace

std::uint32_t checksum(std::span<const std::uint8_t> bytes) {
  return libdeflate_crc32(0, bytes.data(), bytes.size());
}

void append_chunk(std::vector<std::uint8_t>& file, std::span<const std::uint8_t> content) {
  const std::unique_ptr<libdeflate_compressor, Free> compressor(
      libdeflate_alloc_compressor(kLevel));
  if (!compressor) throw std::bad_alloc();
  std::vector<std::uint8_t> stored(content.size());
  std::size_t size = libdeflate_deflate_compress(compressor.get(), content.data(), content.size(),
                                                 stored.data(), stored.size());
  // Zero: no smaller than it was. Content that shrinks absurdly is kept as it is, so that readers
  // can refuse any chunk that claims to.
  if (size == 0 || size >= content.size() || size * kMaxRatio < content.size()) {
    size = content.size();
    stored.assign(content.begin(), content.end());
  }
  ByteWriter sizes;
  sizes.u32(static_cast<std::uint32_t>(size));
  sizes.u32(static_cast<std::uint32_t>(content.size()));
  file.insert(file.end(), sizes.bytes().begin(), sizes.bytes().end());
  file.insert(file.end(), stored.begin(), stored.begin() + static_cast<std::ptrdiff_t>(size));
}

std::vector<std::uint8_t> take_chunk(std::span<const std::uint8_t>& rest) {
  ByteReader reader(rest);
  const std::size_t stored_size = reader.u32();
  const std::size_t size = reader.u32();
  const auto stored = reader.raw(stored_size);
  rest = rest.last(reader.left());
  if (size == stored_size) return {stored.begin(), stored.end()};
  require(size > stored_size && size <= stored_size * kMaxRatio, "has a chunk of impossible size");
  const std::unique_ptr<libdeflate_decompressor, Free> decompressor(
      libdeflate_alloc_decompressor());
  if (!decompressor) throw std::bad_alloc();
  std::vector<std::uint8_t> content(size);
  const libdeflate_result result = libdeflate_deflate_decompress(
      decompressor.get(), stored.data(), stored.size(), content.data(), size, nullptr);
  require(result == LIBDEFLATE_SUCCESS, "has a chunk that cannot be decompressed");
  return content;
}

}  // namespace kys_slam::map_format
