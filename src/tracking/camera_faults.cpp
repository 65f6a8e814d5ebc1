// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/camera_faults.h"

#include <utility>

namespace kys_slam {

namespace {

constexpr std::size_t kEnough = 50;  // features of a half by which the other camera is judged
constexpr double kNothing = 0.02;    // share of these below which it shows nothing there
constexpr std::size_t kTraced = 16;  // every n-th descriptor is kept

enum Half : std::uint8_t { kUpper, kLower, kLeft, kRight, kHalves };
using Counts = std::array<std::size_t, kHalves>;

Counts count_halves(const FeatureSet& features, int width, int height) {
  Counts counts{};
  for (const Keypoint& k : features.keypoints) {
    ++counts[2 * k.y < static_cast<float>(height) ? kUpper : kLower];
    ++counts[2 * k.x < static_cast<float>(width) ? kLeft : kRight];
  }
  return counts;
}

/// What shows nothing where the other camera shows a lot; "" when there is no such part.
std::string dead_part(const Counts& camera, const Counts& other) {
  std::array<bool, kHalves> dead{};
  for (std::size_t h = 0; h < kHalves; ++h) {
    dead[h] = other[h] >= kEnough &&
              static_cast<double>(camera[h]) < kNothing * static_cast<double>(other[h]);
  }
  if ((dead[kUpper] && dead[kLower]) || (dead[kLeft] && dead[kRight])) return "image";
  constexpr std::array<const char*, kHalves> kNames{"upper half", "lower half", "left half",
                                                    "right half"};
  for (std::size_t h = 0; h < kHalves; ++h) {
    if (dead[h]) return kNames[h];
  }
  return "";
}

std::string empty_part(const std::string& part, const std::string& camera) {
  return "the " + part + " of the " + camera + " image shows nothing, the other image does";
}

}  // namespace

CameraFaults::Trace CameraFaults::trace(const FeatureSet& features) {
  Trace trace;
  trace.features = features.size();
  for (std::size_t i = 0; i < features.size(); i += kTraced) {
    trace.some.push_back(features.descriptors[i]);
  }
  return trace;
}

/// Both cameras see the same scene, so where one has many features the other has some: a half
/// without any is a covered lens or a damaged transfer, not a dark scene. Equal descriptors in two
/// frames in a row are a repeated image; the other camera tells whether the scene stood still.
std::string CameraFaults::check(const FeatureSet& left, const FeatureSet& right, int width,
                                int height) {
  constexpr std::array<const char*, 2> kNames{"left", "right"};
  const std::array<Counts, 2> counts{count_halves(left, width, height),
                                     count_halves(right, width, height)};
  const std::array<Trace, 2> traces{trace(left), trace(right)};
  const std::array<Trace, 2> before = std::exchange(last_, traces);
  std::array<bool, 2> repeated{};
  for (std::size_t side = 0; side < 2; ++side) {
    repeated[side] = traces[side].features >= kEnough && traces[side] == before[side];
  }
  left_repeated_ = repeated[0];
  for (std::size_t side = 0; side < 2; ++side) {
    const std::string name = kNames[side];
    const std::string part = dead_part(counts[side], counts[1 - side]);
    if (part == "image") return "the " + name + " image shows nothing, the other one does";
    if (!part.empty()) {
      return empty_part(part, name);
    }
    if (repeated[side] && traces[1 - side] != before[1 - side]) {
      return "the " + name + " image is that of the frame before, the other one is new";
    }
  }
  return "";
}

}  // namespace kys_slam
