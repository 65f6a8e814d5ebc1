// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/descriptor.h>
#include <kys_slam/feature_file.h>

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

/// Frames and ground truth in version 2 of the feature file, as bytes before and after deflate.
/// tools/simulator/features/README.md describes them byte by byte. Decoders do not trust their
/// input: they throw std::runtime_error with what is wrong, and the caller adds the file name.
namespace kys_slam {

/// Of one image: the map numbers the features of a frame with 16 bits.
inline constexpr std::uint32_t kMaxFeatures = 65535;

std::vector<std::uint8_t> encode_frame(const FeatureFrame& frame, std::uint64_t seed);
FeatureFrame decode_frame(std::span<const std::uint8_t> bytes, std::uint64_t seed);

std::vector<std::uint8_t> encode_truth(const FeatureTruth& truth);
/// \param frames  number of frames; the poses of objects must lie within
FeatureTruth decode_truth(std::span<const std::uint8_t> bytes, std::int64_t frames);

std::vector<std::uint8_t> deflate(std::span<const std::uint8_t> bytes);
/// \param size  bytes of the result
/// \throws std::runtime_error when the input does not decode to that size
std::vector<std::uint8_t> inflate(std::span<const std::uint8_t> bytes, std::size_t size);

}  // namespace kys_slam
