// SPDX-License-Identifier: BSD-3-Clause
// Whatever is wrong with a file, it is refused in one line or read as a consistent map.
#include <gtest/gtest.h>

#include <random>

#include "io/temporary_folder.h"
#include "map_file/map_file.h"
#include "map_file/map_format.h"
#include "map_file/sample_map.h"

namespace kys_slam {
namespace {

namespace mf = map_format;
using Bytes = std::vector<std::uint8_t>;
using testing::kSampleLabelSpace;
using testing::sample_map;

void put_u32(Bytes& bytes, std::size_t at, std::uint32_t value) {
  for (std::size_t i = 0; i < 4; ++i) bytes[at + i] = static_cast<std::uint8_t>(value >> (8 * i));
}
void put_f64(Bytes& bytes, std::size_t at, double value) {
  const auto bits = std::bit_cast<std::uint64_t>(value);
  put_u32(bytes, at, static_cast<std::uint32_t>(bits));
  put_u32(bytes, at + 4, static_cast<std::uint32_t>(bits >> 32));
}

/// A file as its header and the content of its chunks, so that single fields can be spoilt and the
/// whole put together again with sizes and checksum right.
struct Parts {
  Bytes header;
  std::vector<Bytes> chunks;

  explicit Parts(const Bytes& file) : header(file.begin(), file.begin() + mf::kHeaderSize) {
    mf::ByteReader rest{std::span(file).subspan(mf::kHeaderSize)};
    while (rest.left() > 0) {
      const auto chunk = mf::take_chunk(rest);
      chunks.emplace_back(chunk.begin(), chunk.end());
    }
  }
  [[nodiscard]] Bytes file() const {
    mf::ByteWriter writer;
    writer.raw(header);
    for (const Bytes& chunk : chunks) mf::append_chunk(writer, chunk);
    Bytes bytes = writer.bytes();
    put_u32(bytes, mf::kAtFileSize, static_cast<std::uint32_t>(bytes.size()));
    put_u32(bytes, mf::kAtFileSize + 4, 0);
    put_u32(bytes, mf::kAtChecksum, mf::checksum(std::span(bytes).subspan(mf::kAtChecked)));
    return bytes;
  }
};

Bytes small_file() {
  return encode_map(sample_map(6, 10), kSampleLabelSpace);
}

/// Chunks of the small file: 0 shared, 1.. keyframes 0, 1, 4, 5, then culled, then landmarks.
constexpr std::size_t kFirstKeyframe = 1;
constexpr std::size_t kCulledChunk = 5;
constexpr std::size_t kLandmarkChunk = 6;

void expect_refused(const Bytes& bytes, std::initializer_list<std::string> parts) {
  expect_input_error([&] { parse_map(bytes, "x.map", kSampleLabelSpace); }, parts);
}

TEST(DamagedMap, PartsPutTogetherAreTheFile) {
  EXPECT_EQ(Parts(small_file()).file(), small_file());
  EXPECT_EQ(Parts(small_file()).chunks.size(), kLandmarkChunk + 1);
}

TEST(DamagedMap, EveryFlippedByteIsNoticed) {
  Bytes bytes = small_file();
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    for (const std::uint8_t flip : {0x01, 0x80, 0xFF}) {
      bytes[i] ^= flip;
      EXPECT_THROW(parse_map(bytes, "x.map", kSampleLabelSpace), InputError) << i;
      bytes[i] ^= flip;
    }
  }
}

TEST(DamagedMap, EveryTruncationIsNoticed) {
  const Bytes bytes = small_file();
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    const Bytes part(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(size));
    EXPECT_THROW(parse_map(part, "x.map", kSampleLabelSpace), InputError) << size;
  }
  Bytes extended = bytes;
  extended.push_back(0);
  expect_refused(extended, {"x.map", "extended"});
}

TEST(DamagedMap, SaysWhatIsWrong) {
  Bytes bytes = small_file();
  expect_refused({}, {"x.map", "magic"});
  expect_refused({bytes.begin(), bytes.begin() + 20}, {"truncated"});
  expect_refused({bytes.begin(), bytes.end() - 1}, {"x.map", "truncated"});
  bytes[mf::kAtVersion] = 4;
  expect_refused(bytes, {"x.map", "version 4", "reads versions 1 to 3"});
  bytes = small_file();
  bytes.back() ^= 1;
  expect_refused(bytes, {"checksum"});
}

TEST(DamagedMap, CountsBeyondTheFileTakeNoMemory) {
  for (const std::size_t at : {mf::kAtKeyframes, mf::kAtCulled, mf::kAtLandmarks}) {
    for (const std::uint32_t count : {0xFFFFFFFFu, 0x7FFFFFFFu, 1000000u, 0u}) {
      Parts parts(small_file());
      put_u32(parts.header, at, count);
      expect_refused(parts.file(), {"x.map"});
    }
  }
  Parts parts(small_file());
  put_u32(parts.chunks[kFirstKeyframe], 3 * 4 + 8 + 8 + 7 * 8, 0x40000000);  // loop edges
  expect_refused(parts.file(), {"count larger"});
  Bytes bytes = small_file();  // a chunk larger than the file
  put_u32(bytes, mf::kHeaderSize, 0xFFFFFFF0);
  put_u32(bytes, mf::kAtChecksum, mf::checksum(std::span(bytes).subspan(mf::kAtChecked)));
  expect_refused(bytes, {"count larger"});
}

TEST(DamagedMap, NumbersThatAreNoneAreRefused) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto spoil = [](std::size_t chunk, std::size_t at, double value) {
    Parts parts(small_file());
    put_f64(parts.chunks[chunk], at, value);
    return parts.file();
  };
  constexpr std::size_t kPose = 3 * 4 + 8 + 8;
  expect_refused(spoil(0, 8, nan), {"camera"});
  expect_refused(spoil(0, 8, -700), {"camera"});
  expect_refused(spoil(kFirstKeyframe, kPose - 8, nan), {"time stamp"});
  expect_refused(spoil(kFirstKeyframe, kPose, nan), {"rotation"});
  expect_refused(spoil(kFirstKeyframe, kPose, 0.5), {"rotation"});
  expect_refused(spoil(kFirstKeyframe, kPose + 32, HUGE_VAL), {"pose"});
  expect_refused(spoil(kCulledChunk, 8, nan), {"rotation"});
  expect_refused(spoil(kLandmarkChunk, 20, nan), {"landmark"});
}

TEST(DamagedMap, ContradictionsAreRefused) {
  const auto spoil = [](std::size_t chunk, std::size_t at, std::uint32_t value) {
    Parts parts(small_file());
    put_u32(parts.chunks[chunk], at, value);
    return parts.file();
  };
  expect_refused(spoil(kFirstKeyframe, 0, 4), {"contradicts itself", "out of order"});
  expect_refused(spoil(kFirstKeyframe, 0, 0x7FFFFFFF), {"beyond the ids"});
  expect_refused(spoil(kFirstKeyframe + 1, 8, 99), {"absent parent"});
  expect_refused(spoil(kFirstKeyframe, 8, 1), {"cycle"});  // the root's parent is its child
  expect_refused(spoil(kFirstKeyframe, 4, 0x7FFFFFFF), {"sub-map"});
  expect_refused(spoil(kFirstKeyframe, 4, 4), {"contradicts itself", "sub-map"});
  expect_refused(spoil(kFirstKeyframe, 4, 0xFFFFFFFF), {"contradicts itself", "sub-map"});
  expect_refused(spoil(kCulledChunk, 4, 99), {"absent parent"});
  expect_refused(spoil(kCulledChunk, 4, 3), {"ancestor"});  // 2 and 3 hang on each other
  expect_refused(spoil(kCulledChunk, 0, 1), {"both alive and culled"});
  expect_refused(spoil(kLandmarkChunk, 4, 2), {"reference"});
  Parts parts(small_file());
  const std::size_t ids = parts.chunks[0].size() - 1 - std::string(kSampleLabelSpace).size() - 8;
  put_u32(parts.chunks[0], ids, 0xFFFFFFFF);
  expect_refused(parts.file(), {"proportion"});
  put_u32(parts.chunks[0], ids, 6);
  put_u32(parts.chunks[0], ids + 4, 0xFFFFFFFE);
  expect_refused(parts.file(), {"proportion"});
}

/// With a right checksum every field is spoilt in turn: refused, or a consistent map that can be
/// written and read again.
TEST(DamagedMap, EverySpoiltFieldIsRefusedOrHarmless) {
  const Parts good(small_file());
  int accepted = 0;
  int refused = 0;
  for (std::size_t c = 0; c < good.chunks.size(); ++c) {
    Parts parts = good;
    for (std::size_t i = 0; i < good.chunks[c].size(); ++i) {
      for (const std::uint8_t flip : {0x01, 0xFF}) {
        parts.chunks[c][i] ^= flip;
        try {
          const Map map = parse_map(parts.file(), "x.map", kSampleLabelSpace);
          const Bytes again = encode_map(map, kSampleLabelSpace);
          EXPECT_EQ(encode_map(parse_map(again, "y", kSampleLabelSpace), kSampleLabelSpace), again);
          ++accepted;
        } catch (const InputError& error) {
          EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
          ++refused;
        }
        parts.chunks[c][i] ^= flip;
      }
    }
  }
  EXPECT_GT(accepted, 100);  // bits of descriptors and of numbers
  EXPECT_GT(refused, 100);
}

TEST(DamagedMap, RandomDamageIsRefusedOrHarmless) {
  std::mt19937 random(3);
  const Parts good(small_file());
  for (int round = 0; round < 3000; ++round) {
    Parts parts = good;
    Bytes& chunk = parts.chunks[random() % parts.chunks.size()];
    const int kind = static_cast<int>(random() % 3);
    if (kind == 0) chunk.resize(random() % chunk.size());
    if (kind == 1) chunk.resize(chunk.size() + random() % 50, static_cast<std::uint8_t>(random()));
    for (unsigned k = random() % 8; k > 0 && !chunk.empty(); --k) {
      chunk[random() % chunk.size()] = static_cast<std::uint8_t>(random());
    }
    if (random() % 4 == 0) std::swap(parts.chunks[1], parts.chunks[random() % 7]);
    try {
      parse_map(parts.file(), "x.map", kSampleLabelSpace).check_consistency();
    } catch (const InputError&) {
    }
  }
}

}  // namespace
}  // namespace kys_slam
