#include "matching/epipolar_matcher.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "matching/landmark_search.h"

namespace kys_slam {

namespace {

/// The part of an epipolar line between two depths, in pixels of the other image.
struct Stretch {
  Eigen::Vector2f near = Eigen::Vector2f::Zero();
  Eigen::Vector2f direction = Eigen::Vector2f::UnitX();  // from near to far, unit length
  float length = 0;
};

class EpipolarSearch {
 public:
  EpipolarSearch(const StereoCamera& camera, const ScaleLevels& scales, const FrameFeatures& b,
                 std::span<const std::uint8_t> free_b, const Rigid3& T_b_a,
                 const EpipolarOptions& options)
      : camera_(camera), scales_(scales), b_(b), free_b_(free_b), T_b_a_(T_b_a), options_(options) {
    for (const float scale : scales.scale) {
      slack_.push_back(std::sqrt(options.chi2_line) * scale);
    }
    // The epipole: where the other camera sees this one.
    const Eigen::Vector3d& t = T_b_a.translation;
    epipole_ahead_ = t.z() > 1e-6;
    if (epipole_ahead_) epipole_ = camera.project(t).cast<float>();
  }

  /// Best free feature of b on the epipolar line of a feature of a; -1: none.
  struct Found {
    std::int32_t feature = -1;
    float distance = std::numeric_limits<float>::infinity();
  };
  [[nodiscard]] Found find(const FrameFeatures& a, std::size_t i, const kys::DistanceModel& model,
                           kys::Statistics& statistics) const {
    Stretch stretch;
    if (!stretch_of(a, i, stretch)) return {};
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
    visit_along(stretch, keypoint.octave, !a.has_stereo(i), consider);
    if (best.feature < 0) return {};
    statistics.accept(tier);
    return best;
  }

 private:
  bool stretch_of(const FrameFeatures& a, std::size_t i, Stretch& stretch) const {
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
    if (!project(nearest, stretch.near) || !project(farthest, far)) return false;
    const Eigen::Vector2f along = far - stretch.near;
    stretch.length = along.norm();
    if (stretch.length > 1e-3f) stretch.direction = along / stretch.length;
    return true;
  }

  /// Visits the free features within 3.84 sigma^2 of the stretch, square by square; each one once.
  /// For a feature without depth (`mono`), others without depth near the epipole are left out.
  template <typename F>
  void visit_along(const Stretch& stretch, int octave, bool mono, F&& f) const {
    const int min_octave = octave - 1;
    const int max_octave = octave + 1;
    const float radius =
        slack_[static_cast<std::size_t>(std::min(max_octave, scales_.levels() - 1))];
    const Eigen::Vector2f& direction = stretch.direction;
    const float widest = std::max(std::abs(direction.x()), std::abs(direction.y()));
    const float step = 2 * std::max(radius, 8.0f);
    const int squares =
        std::clamp(static_cast<int>(std::ceil(stretch.length * widest / step)), 1, 200);
    const float piece = stretch.length / static_cast<float>(squares);
    const float half = 0.5f * piece * widest + radius;
    for (int s = 0; s < squares; ++s) {
      // Squares of neighbouring pieces overlap; a feature belongs to the piece it lies beside.
      const float begin = s == 0 ? -radius : static_cast<float>(s) * piece;
      const float end =
          s + 1 == squares ? stretch.length + radius : static_cast<float>(s + 1) * piece;
      const Eigen::Vector2f centre =
          stretch.near + (static_cast<float>(s) + 0.5f) * piece * direction;
      b_.for_each_near(centre.x(), centre.y(), half, min_octave, max_octave, [&](std::size_t j) {
        const Keypoint& k = b_.keypoint(j);
        const Eigen::Vector2f offset = Eigen::Vector2f(k.x, k.y) - stretch.near;
        const float position = direction.dot(offset);
        if (position < begin || position >= end) return;
        const float slack = slack_[k.octave];
        const float across = direction.x() * offset.y() - direction.y() * offset.x();
        if (std::abs(across) >= slack) return;
        if (position < -slack || position > stretch.length + slack) return;
        if (free_b_[j] == 0 || (mono && beside_epipole(j))) return;
        f(j);
      });
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
  std::span<const std::uint8_t> free_b_;
  const Rigid3& T_b_a_;
  const EpipolarOptions& options_;
  std::vector<float> slack_;  // by octave: how far from the line a feature may be, px
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
