#pragma once

#include <kys/distance.h>

#include <cstdint>

namespace kys {

/// The prior of one keypoint. `label` is a dense index of the label space (LabelSpace::index_of) or
/// kVoidLabel; `scale` is a of Eq. 3 in px^2 m^2, 0 where the segment has no depth; `motion` is the
/// exported motion prior and is clipped to 0..100; `dynamic` is the segment's moving flag.
/// Takes the logarithm of Eq. 9 once. Throws Error when scale or motion is not finite or the scale
/// is negative.
Prior make_prior(std::uint16_t label, std::int32_t instance, float scale, float motion,
                 bool dynamic);

/// The prior of a map point. Label, instance, scale: those of the observation its representative
/// descriptor came from. Motion: that of its most recent observation, because an old motion above
/// the gate would bar the point from ever being matched, and so refreshed, again.
///
/// The moving flag goes with the motion. Where one of the observations has no valid label: a
/// representative without one leaves the point without one (it bypasses everything); a most recent
/// observation without one says nothing about motion, and the point counts as still.
Prior landmark_prior(const Prior& representative, const Prior& most_recent);

}  // namespace kys
