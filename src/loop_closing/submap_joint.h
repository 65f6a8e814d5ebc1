// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance_model.h>
#include <kys/option_list.h>

#include <cstdint>
#include <optional>
#include <vector>

#include "loop_closing/place_verification.h"

namespace kys_slam {

struct JointOptions {
  bool enabled = true;
  std::size_t candidates = 5;  ///< places of other sub-maps tried per keyframe
  int min_matches = 8;         ///< without prediction; fewer: no alignment is tried
  int min_aligned = 6;         ///< inliers of the alignment
  std::size_t neighbours = 9;  ///< covisible keyframes compared besides the keyframe
  int min_inliers = 12;        ///< landmarks that a keyframe must match to count
  double min_share = 0.1;      ///< ... as a share of those it has in view
  int min_keyframes = 3;       ///< keyframes that count
  int min_total = 90;          ///< landmarks matched by them, each counted once per keyframe
  int min_landmarks = 40;      ///< different ones among them
  double min_area = 0.3;       ///< mean share of the image area in view that has matches
  double max_shift = 0.1;      ///< m, and share of the distance from the keyframe
  double max_turn = 2;         ///< deg
};
/// For check_options().
void describe(kys::OptionList& list, JointOptions& options);

/// Two sub-maps at one place, as several keyframes together see it.
struct Joint {
  VerifiedPlace place;                 ///< of the keyframe
  std::vector<KeyFrameId> neighbours;  ///< the other keyframes that count
  int total = 0;                       ///< landmarks matched, once per keyframe
};

/// What a keyframe covisible with `current` sees of a place where `current` has been verified.
/// Nothing where it sees the place from elsewhere than its pose relative to `current` says.
/// \param max_shift m, and share of its distance from `current`
/// \param max_turn deg
std::optional<VerifiedPlace> match_neighbour(const Map& map, KeyFrameId current,
                                             const Rigid3& T_current_place, KeyFrameId neighbour,
                                             const std::vector<LandmarkId>& around,
                                             const PlaceVerificationOptions& options,
                                             double max_shift, double max_turn,
                                             const kys::DistanceModel& model,
                                             kys::Statistics& statistics);

/// Tests whether a keyframe is at a place of another sub-map. In a dim or bare scene no single
/// keyframe matches as many landmarks as verify_place() wants. So a few matches give a pose, and
/// the keyframe and those around it, whose poses relative to it are known, have to match together
/// what one keyframe and two neighbours match there.
std::optional<Joint> find_joint(const Map& map, KeyFrameId current, KeyFrameId place,
                                const JointOptions& options,
                                const PlaceVerificationOptions& verification,
                                const kys::DistanceModel& model, kys::Statistics& statistics);

}  // namespace kys_slam
