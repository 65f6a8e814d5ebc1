#pragma once

#include <kys/descriptor.h>
#include <kys_slam/feature_file.h>

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

/// What version 2 of the feature file packs: frames and truth, as bytes before and after deflate.
/// Byte by byte in tools/simulator/README.md. Every decoder treats its bytes as hostile and throws
/// std::runtime_error saying what is wrong; the caller names the file.
namespace kys_slam {

std::vector<std::uint8_t> encode_frame(const FeatureFrame& frame, std::uint64_t seed);
FeatureFrame decode_frame(std::span<const std::uint8_t> bytes, std::uint64_t seed);

std::vector<std::uint8_t> encode_truth(const FeatureTruth& truth);
/// \param frames  of the file: poses of objects must lie within
FeatureTruth decode_truth(std::span<const std::uint8_t> bytes, std::int64_t frames);

std::vector<std::uint8_t> deflate(std::span<const std::uint8_t> bytes);
/// \param size  of the result. \throws std::runtime_error when the bytes do not give that
std::vector<std::uint8_t> inflate(std::span<const std::uint8_t> bytes, std::size_t size);

}  // namespace kys_slam
