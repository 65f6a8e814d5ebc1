// SPDX-License-Identifier: BSD-3-Clause
#include "matching/stereo_matcher.h"

#include <kys_slam/error.h>
#include <kys_slam/util/median.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <tuple>
#include <utility>

#include "matching/patch_alignment.h"
#include "matching/patch_kernels.h"

namespace kys_slam {

void describe(kys::OptionList& list, StereoOptions& o) {
  list.add("stereo.max_distance", o.max_distance, {1, 256}, "bits",
           "largest distance of a stereo match");
  list.add("stereo.row_tolerance", o.row_tolerance, {0.1, 100}, "px",
           "half width of the row band, octave 0");
  list.add("stereo.refine", o.refine, "sub-pixel disparity by correlation");
  list.add("stereo.median_cut", o.median_cut, {0.1, 1000}, "",
           "matches with a patch residual above this times the median are dropped");
  list.add("stereo.moving_keypoints", o.moving_keypoints, {0, 60000}, "",
           "keypoints with disparity per instance flagged as moving (mode verified)");
  list.add("stereo.added_disparity", o.added_disparity, {-100, 100}, "px",
           "artificial error, to test the regression suite");
}

namespace {

using patch::kHalf;  // px at the keypoint's octave
using patch::kSlide;
const kys::Prior kNoPrior{};

const kys::Prior& prior_of(const StereoView& view, std::size_t i) {
  return view.priors.empty() ? kNoPrior : view.priors[i];
}

/// Position of a keypoint in an image of the perfect pair, px.
struct Place {
  float x, y;
};

std::vector<Place> places_of(const FeatureSet& features, const RigCorrection& rig, bool left) {
  std::vector<Place> places;
  places.reserve(features.size());
  for (const Keypoint& k : features.keypoints) {
    if (!rig.bends()) {
      places.push_back({k.x, k.y});
      continue;
    }
    const Eigen::Vector2f p = (left ? rig.left(k.x, k.y) : rig.right(k.x, k.y)).cast<float>();
    places.push_back({p.x(), p.y()});
  }
  return places;
}

/// A right keypoint, as far as most are looked at.
struct Candidate {
  float x;  // px
  std::uint32_t index;
  std::int32_t octave;
};

/// Right keypoints by the image rows on which their left partners may lie.
class RowIndex {
 public:
  RowIndex(const FeatureSet& right, std::span<const Place> places, int height,
           const ScaleLevels& scales, float tolerance)
      : start_(static_cast<std::size_t>(height) + 1, 0) {
    const auto rows = [&](std::size_t i) {
      const float reach = tolerance * scales.scale[right.keypoints[i].octave];
      const float y = places[i].y;
      return std::array<int, 2>{std::clamp(static_cast<int>(std::floor(y - reach)), 0, height - 1),
                                std::clamp(static_cast<int>(std::ceil(y + reach)), 0, height - 1)};
    };
    for (std::size_t i = 0; i < right.size(); ++i) {
      const auto [first, last] = rows(i);
      for (int r = first; r <= last; ++r) ++start_[static_cast<std::size_t>(r) + 1];
    }
    for (std::size_t r = 1; r < start_.size(); ++r) start_[r] += start_[r - 1];
    candidates_.resize(start_.back());
    std::vector<std::uint32_t> next(start_.begin(), start_.end() - 1);
    for (std::size_t i = 0; i < right.size(); ++i) {
      const Candidate candidate{places[i].x, static_cast<std::uint32_t>(i),
                                right.keypoints[i].octave};
      const auto [first, last] = rows(i);
      for (int r = first; r <= last; ++r) {
        candidates_[next[static_cast<std::size_t>(r)]++] = candidate;
      }
    }
  }
  [[nodiscard]] std::span<const Candidate> at(float y) const {
    const auto last_row = static_cast<float>(start_.size() - 2);
    const auto row = static_cast<std::size_t>(std::clamp(y, 0.0f, last_row));
    return {candidates_.data() + start_[row], candidates_.data() + start_[row + 1]};
  }

 private:
  std::vector<std::uint32_t> start_;
  std::vector<Candidate> candidates_;
};

struct Refined {
  float u_right = 0;   // px, level 0
  float residual = 0;  // grey levels, between the aligned patches
};

/// Slides the left keypoint's patch along the row of the right image at the left keypoint's octave
/// and aligns it there to a fraction of a pixel.
/// \param row of the right image where the left keypoint is seen, px
std::optional<Refined> refine(const Keypoint& left, const Keypoint& right, float row,
                              const ImagePyramid& left_pyramid, const ImagePyramid& right_pyramid) {
  const std::size_t octave = left.octave;
  if (octave >= left_pyramid.levels.size() || octave >= right_pyramid.levels.size()) return {};
  const GrayImage& l = left_pyramid.levels[octave];
  const GrayImage& r = right_pyramid.levels[octave];
  const Eigen::Vector2f left_at = left_pyramid.to_level(octave, left.x, left.y);
  const int xl = static_cast<int>(std::lround(left_at.x()));
  const int y = static_cast<int>(std::lround(left_at.y()));
  const Eigen::Vector2f right_at = right_pyramid.to_level(octave, right.x, row);
  const int xr = static_cast<int>(std::lround(right_at.x()));
  const int yr = static_cast<int>(std::lround(right_at.y()));
  const bool fits = y - kHalf >= 0 && y + kHalf < l.height() && yr - kHalf >= 0 &&
                    yr + kHalf < r.height() && xl - kHalf >= 0 && xl + kHalf < l.width() &&
                    xr - kSlide - kHalf >= 0 && xr + kSlide + kHalf < r.width();
  if (!fits) return {};
  std::array<std::int32_t, 2 * kSlide + 1> difference;
  patch::kernels().slide(l.row(y - kHalf) + xl - kHalf, l.width(),
                         r.row(yr - kHalf) + xr - kSlide - kHalf, r.width(), difference.data());
  const auto best = std::min_element(difference.begin(), difference.end()) - difference.begin();
  if (best == 0 || best == 2 * kSlide) return {};  // no minimum inside the range
  // The whole-pixel search was centred on the rounded left pixel: its remainder moves both alike.
  const float remainder = left_at.x() - static_cast<float>(xl);
  const auto start = static_cast<float>(xr + static_cast<int>(best) - kSlide) + remainder;
  const std::optional<PatchAlignment> aligned = align_patch(l, r, left_at, {start, right_at.y()});
  if (!aligned) return {};
  return Refined{right_pyramid.to_full(octave, aligned->column, 0).x(), aligned->residual};
}

/// \param x of the left keypoint in the perfect pair
/// \param octaves how many they may differ by
std::int32_t nearest_candidate(std::size_t i, float x, const StereoView& left,
                               const StereoView& right, std::span<const Candidate> candidates,
                               float max_disparity, int octaves, const StereoOptions& options,
                               const kys::DistanceModel& model, kys::Statistics& statistics) {
  const Keypoint& l = left.features->keypoints[i];
  float best = options.max_distance;
  std::int32_t chosen = -1;
  kys::Tier tier = kys::Tier::kBypassed;
  for (const Candidate& r : candidates) {
    if (r.x > x || r.x < x - max_disparity) continue;
    if (std::abs(l.octave - r.octave) > octaves) continue;
    const std::uint32_t j = r.index;
    const kys::Distance d = model.evaluate(left.features->descriptors[i], prior_of(left, i),
                                           right.features->descriptors[j], prior_of(right, j),
                                           kys::Context::kStereo, best, statistics);
    if (d.value < best) {
      best = d.value;
      chosen = static_cast<std::int32_t>(j);
      tier = d.tier;
    }
  }
  if (chosen >= 0) statistics.accept(tier);
  return chosen;
}

/// Keypoints that need no disparity, as flags, or empty: of each thing that its prior file calls
/// moving, all but `most`. They hold no pose and add no landmark, and a few tell how the thing
/// moves. Orientation decides, since it chooses the same keypoints in the next frame wherever they
/// are on the thing. The strongest corners would be poor: many are where the thing's edge crosses
/// what is behind it.
std::vector<std::uint8_t> unneeded(const StereoView& left, const kys::DistanceModel& model,
                                   int most) {
  struct Moving {
    std::int32_t instance;
    float angle;
    std::uint32_t index;
  };
  std::vector<Moving> moving;
  for (std::size_t i = 0; i < left.priors.size(); ++i) {
    const kys::Prior& prior = left.priors[i];
    if (prior.dynamic == 0 || prior.instance < 0 || !model.is_on_thing(prior)) continue;
    moving.push_back(
        {prior.instance, left.features->keypoints[i].angle, static_cast<std::uint32_t>(i)});
  }
  std::sort(moving.begin(), moving.end(), [](const Moving& a, const Moving& b) {
    return std::tie(a.instance, b.angle, a.index) < std::tie(b.instance, a.angle, b.index);
  });
  std::vector<std::uint8_t> flags;
  int count = 0;
  for (std::size_t k = 0; k < moving.size(); ++k) {
    count = k > 0 && moving[k].instance == moving[k - 1].instance ? count + 1 : 1;
    if (count <= most) continue;
    if (flags.empty()) flags.assign(left.priors.size(), 0);
    flags[moving[k].index] = 1;
  }
  return flags;
}

/// Of every left keypoint.
struct Columns {
  explicit Columns(std::size_t n)
      : u_right(n, std::numeric_limits<float>::quiet_NaN()), residual(n, -1) {}

  std::vector<float> u_right;   // px, NaN: no match
  std::vector<float> rows;      // px, of right keypoints; empty: with images
  std::vector<float> residual;  // grey levels, -1: not aligned
};

/// What is the same for all keypoints of a pair.
struct Pair {
  const StereoView& left;
  const StereoView& right;
  const RigCorrection& rig;
  std::vector<Place> left_places, right_places;
  RowIndex rows;
  std::vector<std::uint8_t> left_out;  // flags, or empty
  float max_disparity;                 // px
  int octaves;                         // by which partners may differ
};

/// The column in the right image, or nothing when the disparity is impossible.
std::optional<float> checked_column(const Pair& pair, const Keypoint& l, float u,
                                    const StereoOptions& options) {
  if (pair.rig.bends()) {
    u -= options.added_disparity;
    const RigCorrection::Ideal ideal = pair.rig.pair({l.x, l.y, u});
    const double disparity = ideal.u - ideal.u_right;
    if (!(disparity >= 0 && disparity < pair.max_disparity)) return {};
    return u;
  }
  const float disparity = l.x - u + options.added_disparity;
  if (!(disparity >= 0 && disparity < pair.max_disparity)) return {};
  // A point at infinity still has a side: a hundredth of a pixel keeps its depth finite.
  return l.x - std::max(disparity, 0.01f);
}

/// Matches the left keypoints [begin, end); nothing else of `columns` is touched.
void match_some(std::size_t begin, std::size_t end, const Pair& pair, const StereoOptions& options,
                const kys::DistanceModel& model, kys::Statistics& statistics, Columns& columns) {
  const StereoView& left = pair.left;
  const StereoView& right = pair.right;
  const bool with_images = options.refine && left.pyramid != nullptr && right.pyramid != nullptr;
  for (std::size_t i = begin; i < end; ++i) {
    if (!pair.left_out.empty() && pair.left_out[i] != 0) continue;
    const Keypoint& l = left.features->keypoints[i];
    const Place& place = pair.left_places[i];
    const std::int32_t j =
        nearest_candidate(i, place.x, left, right, pair.rows.at(place.y), pair.max_disparity,
                          pair.octaves, options, model, statistics);
    if (j < 0) continue;
    const Keypoint& r = right.features->keypoints[static_cast<std::size_t>(j)];
    float u = r.x;
    if (with_images) {
      float row = l.y;
      if (pair.rig.bends()) {
        const float right_x = pair.right_places[static_cast<std::size_t>(j)].x;
        row = static_cast<float>(pair.rig.measured_right(place.x, place.y, right_x).y());
      }
      const std::optional<Refined> refined = refine(l, r, row, *left.pyramid, *right.pyramid);
      if (!refined) continue;
      u = refined->u_right;
      columns.residual[i] = refined->residual;
    }
    const auto column = checked_column(pair, l, u, options);
    if (!column) continue;
    columns.u_right[i] = *column;
    if (!columns.rows.empty()) columns.rows[i] = r.y;
  }
}

/// Takes out what is aligned much worse than most.
void cut_poor(const StereoView& left, const StereoOptions& options, const kys::DistanceModel& model,
              Columns& columns) {
  // What moves close by and is sharp would set the bound for the scene behind it.
  for (const bool apart : {false, true}) {
    std::vector<float> residuals;
    for (std::size_t i = 0; i < columns.residual.size(); ++i) {
      if (columns.residual[i] >= 0 && model.is_on_thing(prior_of(left, i)) == apart) {
        residuals.push_back(columns.residual[i]);
      }
    }
    if (residuals.empty()) continue;
    const float bound = options.median_cut * median(residuals);
    for (std::size_t i = 0; i < columns.residual.size(); ++i) {
      if (columns.residual[i] > bound && model.is_on_thing(prior_of(left, i)) == apart) {
        columns.u_right[i] = std::numeric_limits<float>::quiet_NaN();
      }
    }
  }
}

}  // namespace

RightPositions match_stereo(const StereoCamera& camera, const ScaleLevels& scales,
                            const StereoView& left, const StereoView& right,
                            const StereoOptions& options, const kys::DistanceModel& model,
                            kys::Statistics& statistics, Worker* helper, const RigCorrection& rig) {
  const std::size_t n = left.features->size();
  Columns columns(n);
  if (n == 0 || right.features->size() == 0) return std::move(columns.u_right);
  if (left.pyramid == nullptr || right.pyramid == nullptr) {
    columns.rows.assign(n, std::numeric_limits<float>::quiet_NaN());
  }
  std::vector<Place> right_places = places_of(*right.features, rig, false);
  RowIndex rows(*right.features, right_places, camera.height, scales, options.row_tolerance);
  const Pair pair{left,
                  right,
                  rig,
                  places_of(*left.features, rig, true),
                  std::move(right_places),
                  std::move(rows),
                  unneeded(left, model, options.moving_keypoints),
                  static_cast<float>(camera.fx),  // nothing is nearer than the baseline
                  scales.sizes ? 1 : scales.levels()};
  const auto match = [&](std::size_t begin, std::size_t end, kys::Statistics& counts) {
    match_some(begin, end, pair, options, model, counts, columns);
  };
  if (helper != nullptr) {
    kys::Statistics others;
    helper->run_beside([&] { match(n / 2, n, others); }, [&] { match(0, n / 2, statistics); });
    statistics += others;
  } else {
    match(0, n, statistics);
  }
  cut_poor(left, options, model, columns);
  return {std::move(columns.u_right), std::move(columns.rows)};
}

}  // namespace kys_slam
