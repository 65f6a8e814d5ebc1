// SPDX-License-Identifier: BSD-3-Clause
#include "motion/common_shift.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <tuple>
#include <vector>

namespace kys_slam {

void describe(kys::OptionList& list, CommonShiftOptions& o) {
  const kys::OptionList::Fixed fixed(list);
  list.add("common_shift.max_distance", o.max_distance, {0, 1e6}, "bits");
  list.add("common_shift.min_count", o.min_count, {1, 60000});
  list.add("common_shift.min_share", o.min_share, {0, 1});
  list.add("common_shift.tolerance", o.tolerance, {0.1, 1000}, "px");
}

namespace {

// Per keypoint, those with the nearest descriptors: on repeated texture the right one is among the
// nearest few, but often not the nearest.
constexpr std::size_t kCandidates = 4;

struct Candidate {
  float distance = kys::kRejected;
  std::uint32_t feature = 0;
};

/// A candidate's place, and how far from it a prediction may lie.
struct Target {
  float u, v, u_right;  // px
  float bound;          // px
};

std::vector<Candidate> candidates_of(const UnknownPlace& place, const FrameFeatures& features,
                                     const CommonShiftOptions& options,
                                     const kys::DistanceModel& model, kys::Statistics& statistics) {
  const SearchQuery& query = place.query;
  std::vector<Candidate> all;
  features.for_each_near(
      query.u, query.v, query.radius, query.min_octave, query.max_octave, [&](std::size_t i) {
        if (!features.has_stereo(i) || (!options.taken.empty() && options.taken[i] != 0)) return;
        const kys::Distance d = model.evaluate(
            *query.descriptor, *query.prior, features.descriptor(i), features.prior(i),
            kys::Context::kInstance, options.max_distance, statistics);
        if (d.value >= options.max_distance) return;
        all.push_back({d.value, static_cast<std::uint32_t>(i)});
      });
  const std::size_t kept = std::min(kCandidates, all.size());
  std::partial_sort(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(kept), all.end(),
                    [](const Candidate& a, const Candidate& b) {
                      return std::tie(a.distance, a.feature) < std::tie(b.distance, b.feature);
                    });
  all.resize(kept);
  return all;
}

bool lies_at(const Eigen::Vector3d& pixel, const Target& target) {
  return std::abs(target.u - pixel.x()) <= target.bound &&
         std::abs(target.v - pixel.y()) <= target.bound &&
         std::abs(target.u_right - pixel.z()) <= target.bound;
}

}  // namespace

/// Votes of pairs, as a Hough transform: every keypoint proposes the shifts to its nearest
/// descriptors, and the shift that most keypoints support wins. Single nearest neighbours fail on
/// wheels, windows and fences, whose right match is among the nearest few only. A translation is
/// enough: between two frames an object turns by less than the tolerance (method:
/// src/motion/README.md, one instance).
std::optional<Eigen::Vector3d> common_shift(const StereoCamera& camera, const ScaleLevels& scales,
                                            const FrameFeatures& features,
                                            std::span<const UnknownPlace> places,
                                            const CommonShiftOptions& options,
                                            const kys::DistanceModel& model,
                                            kys::Statistics& statistics) {
  const int least =
      std::max(options.min_count,
               static_cast<int>(std::ceil(options.min_share * static_cast<double>(places.size()))));
  if (static_cast<int>(places.size()) < least) return std::nullopt;
  std::vector<Target> targets;  // of all places, one after the other
  std::vector<std::size_t> start{0};
  std::vector<Eigen::Vector3d> shifts;
  for (const UnknownPlace& place : places) {
    for (const Candidate& c : candidates_of(place, features, options, model, statistics)) {
      const Keypoint& k = features.keypoint(c.feature);
      targets.push_back(
          {k.x, k.y, features.u_right(c.feature), options.tolerance * scales.scale[k.octave]});
      shifts.push_back(camera.back_project(k.x, k.y, features.depth(c.feature)) - place.expected);
    }
    start.push_back(targets.size());
  }
  const auto agrees = [&](std::size_t place, const Eigen::Vector3d& shift) {
    if (start[place] == start[place + 1]) return false;
    const Eigen::Vector3d p = places[place].expected + shift;
    if (p.z() <= 0.1) return false;
    const Eigen::Vector3d pixel = camera.project_stereo(p);
    return std::any_of(targets.begin() + static_cast<std::ptrdiff_t>(start[place]),
                       targets.begin() + static_cast<std::ptrdiff_t>(start[place + 1]),
                       [&](const Target& target) { return lies_at(pixel, target); });
  };
  // Exhaustive, as there are few proposals; one is given up when those left cannot make it the
  // best.
  std::optional<Eigen::Vector3d> best;
  int most = least - 1;
  for (const Eigen::Vector3d& shift : shifts) {
    int count = 0;
    auto left = static_cast<int>(places.size());
    for (std::size_t place = 0; place < places.size() && count + left > most; ++place, --left) {
      count += agrees(place, shift) ? 1 : 0;
    }
    if (count <= most) continue;
    most = count;
    best = shift;
  }
  return best;
}

}  // namespace kys_slam
