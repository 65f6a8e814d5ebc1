// SPDX-License-Identifier: BSD-3-Clause
#include "matching/epipolar_matcher.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "matching/landmark_search.h"

namespace kys_slam {

void describe(kys::OptionList& list, EpipolarOptions& o) {
  list.add("mapping.triangulation_distance", o.max_distance, {0, 1e6}, "bits",
           "largest distance of a match along an epipolar line");
  const kys::OptionList::Fixed fixed(list);
  list.add("mapping.epipolar_chi2", o.chi2_line, {0.01, 1e6});
  list.add("mapping.epipolar_min_depth", o.min_depth, {1e-3, 1e6}, "m");
  list.add("mapping.epipolar_max_depth", o.max_depth, {1e-3, 1e6}, "m");
  list.add("mapping.epipolar_depth_sigma", o.depth_sigma_px, {0, 1000}, "px");
  list.require(o.min_depth <= o.max_depth,
               "mapping.epipolar_min_depth must be at most mapping.epipolar_max_depth");
}

namespace {

/// The part of an epipolar line between two depths, in pixels of the other image.
struct EpipolarSegment {
  Eigen::Vector2f near = Eigen::Vector2f::Zero();
  Eigen::Vector2f direction = Eigen::Vector2f::UnitX();  // from near to far, unit length
  float length = 0;
};

/// The free features of an image in bands of rows, by column within their band.
class RowBands {
 public:
  struct Entry {
    float x, y;  // px
    std::uint16_t feature;
    std::uint8_t octave;
    bool beside_epipole;
  };
  static constexpr float kHeight = 8;  // px

  void add(const Entry& entry) { entries_.push_back(entry); }
  /// After the last one.
  void sort(int image_width, int image_height) {
    bands_ = std::max(1, static_cast<int>(static_cast<float>(image_height) / kHeight) + 1);
    columns_ = std::max(1, static_cast<int>(static_cast<float>(image_width) / kWidth) + 1);
    start_.assign(static_cast<std::size_t>(bands_ * columns_) + 1, 0);
    for (const Entry& e : entries_) ++start_[cell(e) + 1];
    for (std::size_t c = 1; c < start_.size(); ++c) start_[c] += start_[c - 1];
    std::vector<Entry> sorted(entries_.size());
    std::vector<std::uint32_t> next(start_.begin(), start_.end() - 1);
    for (const Entry& e : entries_) sorted[next[cell(e)]++] = e;
    entries_ = std::move(sorted);
    for (std::size_t c = 0; c + 1 < start_.size(); ++c) {
      if (start_[c + 1] - start_[c] < 2) continue;
      std::sort(entries_.begin() + start_[c], entries_.begin() + start_[c + 1],
                [](const Entry& l, const Entry& r) {
                  return l.x != r.x ? l.x < r.x : l.feature < r.feature;
                });
    }
  }
  [[nodiscard]] std::size_t band(float y) const {
    return static_cast<std::size_t>(
        std::clamp(y * (1 / kHeight), 0.0f, static_cast<float>(bands_ - 1)));
  }
  /// Entries of a band from column `x` or a little before on, to its last.
  [[nodiscard]] std::span<const Entry> from(std::size_t band, float x) const {
    const std::size_t row = band * static_cast<std::size_t>(columns_);
    return {entries_.begin() + start_[row + column(x)],
            entries_.begin() + start_[row + static_cast<std::size_t>(columns_)]};
  }

 private:
  static constexpr float kWidth = 16;  // px

  /// The first one where x is no number.
  [[nodiscard]] std::size_t column(float x) const {
    return static_cast<std::size_t>(
        std::min(std::max(0.0f, x * (1 / kWidth)), static_cast<float>(columns_ - 1)));
  }
  [[nodiscard]] std::size_t cell(const Entry& e) const {
    return band(e.y) * static_cast<std::size_t>(columns_) + column(e.x);
  }

  int bands_ = 1;
  int columns_ = 1;
  std::vector<Entry> entries_;
  std::vector<std::uint32_t> start_;  // of each cell, row by row
};

class EpipolarSearch {
 public:
  EpipolarSearch(const StereoCamera& camera, const ScaleLevels& scales, const FrameFeatures& b,
                 std::span<const std::uint8_t> free_b, const Rigid3& T_b_a,
                 const EpipolarOptions& options)
      : camera_(camera), scales_(scales), b_(b), T_b_a_(T_b_a), options_(options) {
    for (const float scale : scales.scale) {
      slack_.push_back(std::sqrt(options.chi2_line) * scale);
    }
    // The epipole: where the other camera sees this one.
    const Eigen::Vector3d& t = T_b_a.translation;
    epipole_ahead_ = t.z() > 1e-6;
    if (epipole_ahead_) epipole_ = camera.project(t).cast<float>();
    for (std::size_t j = 0; j < b.size(); ++j) {
      if (free_b[j] == 0) continue;
      const Keypoint& k = b.keypoint(j);
      bands_.add({k.x, k.y, static_cast<std::uint16_t>(j), k.octave, beside_epipole(j)});
    }
    bands_.sort(camera.width, camera.height);
  }

  /// Best free feature of b on the epipolar line of a feature of a; -1: none.
  struct Found {
    std::int32_t feature = -1;
    float distance = std::numeric_limits<float>::infinity();
  };
  [[nodiscard]] Found find(const FrameFeatures& a, std::size_t i, const kys::DistanceModel& model,
                           kys::Statistics& statistics) const {
    EpipolarSegment segment;
    if (!segment_of(a, i, segment)) return {};
    const Keypoint& keypoint = a.keypoint(i);
    Found best;
    best.distance = std::nextafter(options_.max_distance, std::numeric_limits<float>::infinity());
    kys::Tier tier = kys::Tier::kBypassed;
    const auto consider = [&](std::size_t j) {
      const kys::Distance d =
          model.evaluate(a.descriptor(i), a.prior(i), b_.descriptor(j), b_.prior(j),
                         kys::Context::kTemporal, best.distance, statistics);
      if (d.value < best.distance) {
        best = {static_cast<std::int32_t>(j), d.value};
        tier = d.tier;
      }
    };
    visit_along(segment, keypoint.octave, !a.has_stereo(i), consider);
    if (best.feature < 0) return {};
    statistics.accept(tier);
    return best;
  }

 private:
  bool segment_of(const FrameFeatures& a, std::size_t i, EpipolarSegment& segment) const {
    const Keypoint& k = a.keypoint(i);
    // Nearer than about two baselines along the way the two views differ too much in scale for
    // their octaves to be neighbours.
    double nearest = std::max<double>(options_.min_depth, 2 * std::abs(T_b_a_.translation.z()));
    double farthest = options_.max_depth;
    if (a.has_stereo(i)) {
      const double disparity = k.x - a.u_right(i);
      const double reach =
          2.0 * options_.depth_sigma_px * static_cast<double>(scales_.scale[k.octave]);
      nearest = camera_.bf() / (disparity + reach);
      farthest = disparity > reach ? camera_.bf() / (disparity - reach) : farthest;
      farthest = std::max(farthest, nearest);
    }
    const auto project = [&](double depth, Eigen::Vector2f& pixel) {
      const Eigen::Vector3d p_b = T_b_a_ * camera_.back_project(k.x, k.y, depth);
      if (p_b.z() < 0.1) return false;
      pixel = camera_.project(p_b).cast<float>();
      return true;
    };
    Eigen::Vector2f far;
    if (!project(nearest, segment.near) || !project(farthest, far)) return false;
    const Eigen::Vector2f along = far - segment.near;
    segment.length = along.norm();
    if (segment.length > 1e-3f) segment.direction = along / segment.length;
    return true;
  }

  /// Visits the free features within 3.84 sigma^2 of the segment, band by band; each one once.
  /// For a feature without depth (`mono`), others without depth near the epipole are left out.
  template <typename F>
  void visit_along(const EpipolarSegment& segment, int octave, bool mono, F&& f) const {
    const int min_octave = scales_.lowest(octave - 1);
    const int max_octave = scales_.highest(octave + 1);
    const float reach =
        slack_[static_cast<std::size_t>(std::min(max_octave, scales_.levels() - 1))];
    const Eigen::Vector2f& direction = segment.direction;
    const Eigen::Vector2f far = segment.near + segment.length * direction;
    // What lies beside the segment and not beyond its ends by more than the reach has a column
    // within `wide` of that of the line in its row, or of where the line enters or leaves its band.
    const float wide = reach * (1 + std::abs(direction.x()));
    const float top = std::min(segment.near.y(), far.y()) - reach;
    const float bottom = std::max(segment.near.y(), far.y()) + reach;
    if (!(bottom >= 0 && top <= static_cast<float>(camera_.height))) return;
    const bool level = std::abs(direction.y()) < 1e-3f;
    const std::size_t last = bands_.band(bottom);
    for (std::size_t band = bands_.band(top); band <= last; ++band) {
      float begin = 0, end = segment.length;
      if (!level) {
        const float y = static_cast<float>(band) * RowBands::kHeight;
        const float s0 = (y - reach - segment.near.y()) / direction.y();
        const float s1 = (y + RowBands::kHeight + reach - segment.near.y()) / direction.y();
        begin = std::clamp(std::min(s0, s1), 0.0f, segment.length);
        end = std::clamp(std::max(s0, s1), 0.0f, segment.length);
      }
      const float x0 = segment.near.x() + begin * direction.x();
      const float x1 = segment.near.x() + end * direction.x();
      const float left = std::min(x0, x1) - wide;
      const float right = std::max(x0, x1) + wide;
      for (const RowBands::Entry& e : bands_.from(band, left)) {
        if (e.x > right) break;
        if (e.x < left) continue;
        if (e.octave < min_octave || e.octave > max_octave) continue;
        const Eigen::Vector2f offset(e.x - segment.near.x(), e.y - segment.near.y());
        const float slack = slack_[e.octave];
        const float across = direction.x() * offset.y() - direction.y() * offset.x();
        const float position = direction.dot(offset);
        if (std::abs(across) >= slack) continue;
        if (position < -slack || position > segment.length + slack) continue;
        if (mono && e.beside_epipole) continue;
        f(e.feature);
      }
    }
  }

  /// Too near the epipole for a depth to be had from the two views.
  [[nodiscard]] bool beside_epipole(std::size_t j) const {
    if (!epipole_ahead_ || b_.has_stereo(j)) return false;
    const Keypoint& k = b_.keypoint(j);
    return (Eigen::Vector2f(k.x, k.y) - epipole_).squaredNorm() < 100 * scales_.scale[k.octave];
  }

  const StereoCamera& camera_;
  const ScaleLevels& scales_;
  const FrameFeatures& b_;
  const Rigid3& T_b_a_;
  const EpipolarOptions& options_;
  std::vector<float> slack_;  // by octave: how far from the line a feature may be, px
  RowBands bands_;            // free features of b
  bool epipole_ahead_ = false;
  Eigen::Vector2f epipole_ = Eigen::Vector2f::Zero();
};

}  // namespace

std::vector<FeaturePair> match_epipolar(
    const StereoCamera& camera, const ScaleLevels& scales, const FrameFeatures& a,
    std::span<const std::uint8_t> free_a, const FrameFeatures& b,
    std::span<const std::uint8_t> free_b, const Rigid3& T_b_a, const EpipolarOptions& options,
    const kys::DistanceModel& model, kys::Statistics& statistics) {
  const EpipolarSearch search(camera, scales, b, free_b, T_b_a, options);
  std::vector<std::int32_t> owner(b.size(), -1);  // feature of a that holds a feature of b
  std::vector<float> distance(b.size(), 0);
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (free_a[i] == 0) continue;
    const auto found = search.find(a, i, model, statistics);
    if (found.feature < 0) continue;
    const auto j = static_cast<std::size_t>(found.feature);
    if (owner[j] >= 0 && distance[j] <= found.distance) continue;
    owner[j] = static_cast<std::int32_t>(i);
    distance[j] = found.distance;
  }
  std::vector<FeaturePair> pairs;
  std::vector<float> turns;
  for (std::size_t j = 0; j < b.size(); ++j) {
    if (owner[j] < 0) continue;
    const auto i = static_cast<std::size_t>(owner[j]);
    pairs.push_back({static_cast<std::uint32_t>(i), static_cast<std::uint32_t>(j)});
    turns.push_back(a.keypoint(i).angle - b.keypoint(j).angle);
  }
  const std::vector<std::uint8_t> kept = consistent_rotations(turns);
  std::size_t n = 0;
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    if (kept[k] != 0) pairs[n++] = pairs[k];
  }
  pairs.resize(n);
  std::sort(pairs.begin(), pairs.end(),
            [](const FeaturePair& x, const FeaturePair& y) { return x.a < y.a; });
  return pairs;
}

}  // namespace kys_slam
