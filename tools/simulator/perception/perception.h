// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <tuple>
#include <vector>

#include "priors/fusion/association.h"
#include "simulator/features/feature_world.h"

namespace kys_slam::simulator {

/// Error model of a prior builder. Parameters of motion and depth are measured on the output of
/// build_priors for rendered worlds (fit_perception.py writes perception_levels.inc). Those of
/// segmentation are set by hand, because rendered segments have no errors. Pixels are those of
/// images `width` px wide: errors of flow scale with the image width.
struct PerceptionLevel {
  const char* name = "";
  int width = 620;
  // A segment that moves is flagged with probability logistic(moving0 + moving1 ln(r / px) +
  // moving2 ln(area / 1000 px^2)), r its motion in the image against the static world per frame.
  double moving0 = 8, moving1 = 0, moving2 = 0;
  // A static segment: logistic(still0 + still1 ln(area / 1000 px^2)).
  double still0 = -8, still1 = 0;
  double persistence = 0;   ///< correlation of such a decision with that of the frame before
  double reference = 0.1;   ///< px, median of the background's residual (m_bg of Eq. 7)
  double reference_sd = 0;  ///< standard deviation of its logarithm over frames
  double motion_sd = 0;     ///< standard deviation of the logarithm of a segment's measured motion
  double false_rho_sd = 0.5;  ///< of the logarithm of r / m_bg of static segments that are flagged
  double false_rho = 5;       ///< its median
  double scale_sd = 0;        ///< of the logarithm of a segment's scale (Eq. 3)
  /// Identities by the centroids of segments, in each image alone; they switch. Otherwise by masks,
  /// the same in both images.
  bool by_centroid = false;
  // Of segmentation; probabilities at 1000 px^2, falling with the root of the area.
  double boundary = 0;         ///< px, standard deviation of segment boundaries
  double confusion = 0;        ///< a thing has the class with the least semantic distance
  double stuff_confusion = 0;  ///< the same for a block of stuff
  double missed = 0;           ///< a thing has no segment
  double merged = 0;           ///< a thing is merged with its neighbour of the same class
  double missing_frames = 0;   ///< share of frames without priors
  double late_frames = 0;      ///< share of frames with the priors of the frame before
};

/// \throws InputError when it is none of exact, estimated, poor.
const PerceptionLevel& perception_level(const std::string& name);

/// Simulates the priors that build_priors makes, for the features of a world, frame by frame:
/// segments from the boxes in the image, identities by the association of the builder, scale and
/// motion by Eqs. 3, 7 and 8 with the errors of a level. The result depends on the world, the level
/// and the seed only.
class Perception {
 public:
  Perception(const FeatureWorld& world, const PerceptionLevel& level, std::uint64_t seed);

  /// Adds priors to a frame of the world. Call it for every frame, in order.
  void add_priors(std::size_t index, FeatureFrame& frame);

  /// Counts of thing segments so far, both cameras: truth and decisions.
  struct Score {
    std::int64_t moving = 0, moving_flagged = 0, still = 0, still_flagged = 0;
  };
  [[nodiscard]] const Score& score() const { return score_; }

 private:
  struct Segment {
    kys::Prior prior;   ///< without motion
    double motion = 0;  ///< measured r / m_bg of its centre; 0: not flagged
    double weight = 0;  ///< m_k / 100
    bool truly_moves = false;
    double area = 0, u = 0, v = 0, depth = 0;
  };
  /// Perception of one image of one frame.
  struct View {
    std::unique_ptr<BoxRaster> raster;
    std::map<std::int32_t, std::size_t> segment_of;  ///< by object
    std::vector<Segment> segments;
    std::map<std::uint16_t, float> stuff_scale;
    double reference = 0.1;
  };
  struct Side {
    explicit Side(const BuilderOptions::Association& options) : associator(options) {}
    InstanceAssociator associator;
    View now, before;
  };

  void make_segments(std::size_t index, int camera, const FrameScene& scene,
                     const FeatureFrame& frame);
  void outline_segments(std::size_t index, int camera, View& view);
  void merge(std::size_t index, int camera, View& view);
  std::int32_t identity_of(std::size_t index, std::int32_t object);
  void identify(std::size_t index, int camera, View& view);
  void judge_motion(std::size_t index, int camera, View& view);
  void measure_stuff(std::size_t index, int camera, const FeatureFrame& frame, View& view) const;
  [[nodiscard]] Eigen::Vector2d image_motion(std::size_t index, int camera, std::int32_t object,
                                             double u, double v, double depth) const;
  [[nodiscard]] kys::Prior prior_of(std::size_t index, int camera, const View& view, bool late,
                                    const Keypoint& k, std::int32_t landmark, std::size_t number);
  [[nodiscard]] kys::Prior of_stuff(int camera, const View& view, std::uint16_t label,
                                    const Keypoint& k, std::size_t index) const;
  [[nodiscard]] std::uint16_t stuff_at(std::size_t index, const Keypoint& k);
  [[nodiscard]] std::uint16_t label_beside(std::int32_t landmark, std::size_t index,
                                           double aside_u) const;
  double latent(int kind, int camera, std::int32_t object, std::size_t index, double persistence);
  [[nodiscard]] std::uint16_t confused(std::uint16_t label) const;

  const FeatureWorld& world_;
  PerceptionLevel level_;
  double shrink_;  ///< factor from pixels of the camera to pixels of the level
  std::uint64_t seed_;
  std::array<Side, 2> sides_;
  struct Identity {
    std::int32_t number = 0;
    std::size_t seen = 0;  ///< last frame
  };
  std::map<std::int32_t, Identity> identities_;  ///< by object
  std::int32_t next_identity_ = 0;
  std::vector<std::uint16_t> nearest_class_;
  std::map<std::tuple<int, int, std::int32_t>, std::pair<std::size_t, double>> latents_;
  std::vector<std::int32_t> stuff_cache_;
  std::size_t stuff_cache_of_ = 0;
  Score score_;
};

}  // namespace kys_slam::simulator
