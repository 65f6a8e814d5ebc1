// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "util/byte_stream.h"

/// Constants of the map file format, versions 2 and 3, which README.md describes byte by byte.
namespace kys_slam::map_format {

using byte_stream::ByteReader;
using byte_stream::ByteWriter;
using byte_stream::Damage;
using byte_stream::require;

inline constexpr std::array<std::uint8_t, 8> kMagic = {'K', 'Y', 'S', 'M', 0x0D, 0x0A, 0x1A, 0x0A};
inline constexpr std::uint16_t kVersion = 2;
inline constexpr std::uint16_t kExtractorVersion =
    3;                                              ///< says which extractor, where it is not ORB
inline constexpr std::uint16_t kOffsetVersion = 1;  ///< a disparity offset in place of a rig
inline constexpr std::size_t kHeaderSize = 40;
inline constexpr std::size_t kAtVersion = 8;
inline constexpr std::size_t kAtHeaderSize = 10;
inline constexpr std::size_t kAtChecksum = 12;
inline constexpr std::size_t kAtChecked = 16;  ///< the checksum covers everything from here on
inline constexpr std::size_t kAtFileSize = 16;
inline constexpr std::size_t kAtKeyframes = 24;
inline constexpr std::size_t kAtCulled = 28;
inline constexpr std::size_t kAtLandmarks = 32;
inline constexpr std::size_t kAtFlags = 36;

inline constexpr std::uint32_t kBatch = 4096;    ///< culled keyframes or landmarks per chunk
inline constexpr std::uint32_t kMaxLevels = 64;  ///< of the pyramid
inline constexpr int kMaxSide = 16384;           ///< px
inline constexpr float kMaxPixel = 65536;        ///< px, of any coordinate
inline constexpr double kMaxMetres = 1e9;        ///< of any coordinate
inline constexpr std::uint32_t kHasBeliefs = 1;  ///< flag of the header
inline constexpr std::uint8_t kHasPriors = 1;    ///< flag of a keyframe
inline constexpr std::uint8_t kHasAligned = 2;   ///< flag of a keyframe
inline constexpr std::uint8_t kHasRows = 4;      ///< flag of a keyframe
inline constexpr std::uint8_t kMoves = 1;        ///< flag of a prior
inline constexpr std::uint8_t kNotJudged = 2;    ///< flag of a prior
/// Limit of ids beyond the number of objects in the file, because tables are allocated by the
/// largest id.
inline constexpr std::uint64_t kIdsAtLeast = 65536;
inline constexpr std::uint64_t kIdsPerObject = 1024;  ///< features or keyframe records
/// Ids of landmarks that a culled keyframe may have used: with it went its features.
inline constexpr std::uint64_t kIdsPerCulled = 4096;

/// CRC-32 of zlib, PNG and Ethernet.
std::uint32_t checksum(std::span<const std::uint8_t> bytes);

/// Appends a chunk: its size, its bytes.
void append_chunk(ByteWriter& file, std::span<const std::uint8_t> content);
/// Reads the next chunk. \throws Damage when it is incomplete.
std::span<const std::uint8_t> take_chunk(ByteReader& file);

}  // namespace kys_slam::map_format
