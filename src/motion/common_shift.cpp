#include "motion/common_shift.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <tuple>
#include <vector>

namespace kys_slam {

namespace {

constexpr std::size_t kCandidates = 4;  // per keypoint, those with the nearest descriptors

struct Candidate {
  float distance = kys::kRejected;
  std::uint32_t feature = 0;
};

std::vector<Candidate> candidates_of(const UnknownPlace& place, const FrameFeatures& features,
                                     const CommonShiftOptions& options,
                                     const kys::DistanceModel& model, kys::Statistics& statistics) {
  const SearchQuery& query = place.query;
  std::vector<Candidate> all;
  features.for_each_near(
      query.u, query.v, query.radius, query.min_octave, query.max_octave, [&](std::size_t i) {
        if (!features.has_stereo(i)) return;
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

bool lies_at(const Eigen::Vector3d& pixel, const FrameFeatures& features, std::size_t i,
             const ScaleLevels& scales, float tolerance) {
  const Keypoint& k = features.keypoint(i);
  const double bound = tolerance * scales.scale[k.octave];
  return std::abs(k.x - pixel.x()) <= bound && std::abs(k.y - pixel.y()) <= bound &&
         std::abs(features.u_right(i) - pixel.z()) <= bound;
}

}  // namespace

std::optional<Eigen::Vector3d> common_shift(const StereoCamera& camera, const ScaleLevels& scales,
                                            const FrameFeatures& features,
                                            std::span<const UnknownPlace> places,
                                            const CommonShiftOptions& options,
                                            const kys::DistanceModel& model,
                                            kys::Statistics& statistics) {
  std::vector<std::vector<Candidate>> candidates;
  for (const UnknownPlace& place : places) {
    candidates.push_back(candidates_of(place, features, options, model, statistics));
  }
  std::optional<Eigen::Vector3d> best;
  int most =
      std::max(options.min_count, static_cast<int>(std::ceil(options.min_share *
                                                             static_cast<double>(places.size())))) -
      1;
  for (std::size_t q = 0; q < places.size(); ++q) {
    for (const Candidate& proposer : candidates[q]) {
      const Keypoint& k = features.keypoint(proposer.feature);
      const Eigen::Vector3d shift =
          camera.back_project(k.x, k.y, features.depth(proposer.feature)) - places[q].expected;
      int count = 0;
      for (std::size_t other = 0; other < places.size(); ++other) {
        const Eigen::Vector3d p = places[other].expected + shift;
        if (p.z() <= 0.1) continue;
        const Eigen::Vector3d pixel = camera.project_stereo(p);
        count +=
            std::any_of(candidates[other].begin(), candidates[other].end(),
                        [&](const Candidate& c) {
                          return lies_at(pixel, features, c.feature, scales, options.tolerance);
                        })
                ? 1
                : 0;
      }
      if (count > most) {
        most = count;
        best = shift;
      }
    }
  }
  return best;
}

}  // namespace kys_slam
