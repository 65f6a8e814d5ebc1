// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/descriptor.h>

#include <cstddef>
#include <cstdint>
#include <limits>

namespace kys {

/// Label of a keypoint outside every labelled segment. Its pairs keep the Hamming distance, in
/// every mode but `scaled`.
inline constexpr std::uint16_t kVoidLabel = 0xFFFF;

/// Instances of the left camera are below this number, those of the right camera are not.
inline constexpr std::int32_t kRightInstances = 1 << 30;

/// The prior of one keypoint or map point: (label, instance, scale, motion), paper, Sec. 3.4. 20
/// bytes. A default-constructed prior has no valid label. Made by make_prior().
struct Prior {
  std::uint16_t label = kVoidLabel;  ///< dense class index in the label space of the prior file
  std::uint8_t dynamic = 0;          ///< 1: the segment is flagged as moving (mode `mask`)
  std::uint8_t unjudged = 0;         ///< 1: the motion of the segment was not measured
  std::int32_t instance = -1;        ///< identity; equal: one object, in either camera; -1: none
  float scale = 0;                   ///< a, area x (mean depth)^2, px^2 m^2 (Eq. 3)
  float motion = 0;                  ///< mu, 0..100, motion score (Eq. 8)
  float log_motion = 0;              ///< ln(1 + mu), taken once per keypoint

  friend bool operator==(const Prior&, const Prior&) = default;
};

/// Context of a comparison, which selects the motion gate (Sec. 3.4). `kStereo`: left to right.
/// `kTemporal`: between frames, and between a frame and the map. `kInstance`: between frames, to
/// track an instance whether it moves or not; no gate in any mode.
enum class Context : std::uint8_t { kStereo, kTemporal, kInstance };
inline constexpr std::size_t kContextCount = 3;

/// Result class of a pair. The first three are its structural tier, which selects its factor (Eq.
/// 5). `kBypassed`: Hamming distance, because a keypoint has no valid label or the mode uses no
/// priors. `kGated`: rejected by the motion gate. `kFiltered`: rejected by a label filter (modes
/// `hard_mismatch`, `soft_filter`). `kSkipped`: the lower bound is not below the caller's bound, so
/// no prior was read and the tier is not known.
enum class Tier : std::uint8_t {
  kSameInstance,
  kCrossInstance,
  kCrossClass,
  kBypassed,
  kGated,
  kFiltered,
  kSkipped,
};
inline constexpr std::size_t kTierCount = 7;

/// Distance of a pair that a gate or filter rejects.
inline constexpr float kRejected = std::numeric_limits<float>::infinity();

/// The distance of a pair, in bits of the descriptor, and its tier.
struct Distance {
  float value = kRejected;
  Tier tier = Tier::kBypassed;

  friend bool operator==(const Distance&, const Distance&) = default;
};

}  // namespace kys
