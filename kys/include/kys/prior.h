// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance.h>

#include <cstdint>

namespace kys {

/// The prior of one keypoint. `label`: dense index of the label space (LabelSpace::index_of) or
/// kVoidLabel. `scale`: a of Eq. 3, px^2 m^2; 0 where the segment has no depth. `motion`: mu of Eq.
/// 8, clipped to 0..100. `dynamic`: the segment is flagged as moving. Computes the logarithm of Eq.
/// 9 once. Throws Error when scale or motion is not finite or the scale is negative.
Prior make_prior(std::uint16_t label, std::int32_t instance, float scale, float motion,
                 bool dynamic);

/// The prior of a map point. Label, instance and scale are those of the observation of its
/// representative descriptor. Motion is that of its most recent observation: an old motion above
/// the gate would prevent every later match, and so every update.
///
/// The moving flag is that of the motion. A representative without a valid label gives a point
/// without a valid label. A most recent observation without a valid label has no motion, and the
/// point counts as static.
Prior landmark_prior(const Prior& representative, const Prior& most_recent);

}  // namespace kys
