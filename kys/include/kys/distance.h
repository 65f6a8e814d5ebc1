#pragma once

#include <kys/descriptor.h>

#include <cstddef>
#include <cstdint>
#include <limits>

namespace kys {

/// Segment label of a keypoint outside every labelled segment: such a keypoint keeps the native
/// distance to everything, in every mode.
inline constexpr std::uint16_t kVoidLabel = 0xFFFF;

/// Instance identities of the left camera lie below this, those of the right one from here on.
inline constexpr std::int32_t kRightInstances = 1 << 30;

/// The prior tuple of one keypoint or map point: (label, instance, scale, motion) of the paper's
/// Sec. 3.4. 20 bytes; a default-constructed one has no valid label. Made by make_prior().
struct Prior {
  std::uint16_t label = kVoidLabel;  ///< dense class index in the label space of the prior file
  std::uint8_t dynamic = 0;          ///< 1: the segment is flagged as moving (mode `mask`)
  std::uint8_t unjudged = 0;         ///< 1: nothing says whether the segment moves
  std::int32_t instance = -1;        ///< temporally consistent identity, disjoint between cameras
  float scale = 0;                   ///< a, area x (mean depth)^2, px^2 m^2 (Eq. 3)
  float motion = 0;                  ///< mu, 0..100 (exported motion prior)
  float log_motion = 0;              ///< ln(1 + mu), taken once per keypoint

  friend bool operator==(const Prior&, const Prior&) = default;
};

/// Where a comparison happens: they differ in the motion gate (Sec. 3.4). `kInstance`, between
/// frames to follow a thing whether it moves or not, has none in any mode.
enum class Context : std::uint8_t { kStereo, kTemporal, kInstance };
inline constexpr std::size_t kContextCount = 3;

/// What became of a pair. The first three name its structural tier, i.e. how its factor was chosen
/// (Eq. 5). `kBypassed`: native distance, because a keypoint has no valid label or the mode uses no
/// priors. `kGated`: rejected by the motion gate. `kFiltered`: rejected by a label filter (modes
/// `hard_mismatch`, `soft_filter`). `kSkipped`: its lower bound already was no better than the
/// bound given by the caller, so no prior was looked at and its tier is not known.
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

/// The distance of a pair, in bits of the descriptor, and how it came about.
struct Distance {
  float value = kRejected;
  Tier tier = Tier::kBypassed;

  friend bool operator==(const Distance&, const Distance&) = default;
};

}  // namespace kys
