#pragma once

#include <kys/descriptor.h>

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "io/feature_sequence.h"

/// What version 2 of the feature file packs: frames and truth, as bytes before and after deflate.
/// Byte by byte in tools/simulator/README.md. Every decoder treats its bytes as hostile and throws
/// std::runtime_error saying what is wrong; the caller names the file.
namespace kys_slam {

/// The 256 bits that a key stands for.
kys::Descriptor expand_look(std::uint64_t key);

/// The bits that a feature's look stands for, before any bit flips; zero for kRaw.
kys::Descriptor base_descriptor(const FeatureLook& look, std::int32_t landmark, std::uint64_t seed);

std::vector<std::uint8_t> encode_frame(const FeatureFrame& frame, std::uint64_t seed);
FeatureFrame decode_frame(std::span<const std::uint8_t> bytes, std::uint64_t seed);

std::vector<std::uint8_t> encode_truth(const FeatureTruth& truth);
/// \param frames  of the file: poses of objects must lie within
FeatureTruth decode_truth(std::span<const std::uint8_t> bytes, std::int64_t frames);

std::vector<std::uint8_t> deflate(std::span<const std::uint8_t> bytes);
/// \param size  of the result. \throws std::runtime_error when the bytes do not give that
std::vector<std::uint8_t> inflate(std::span<const std::uint8_t> bytes, std::size_t size);

}  // namespace kys_slam
