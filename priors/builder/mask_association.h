#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "priors/builder/options.h"
#include "priors/builder/panoptic.h"

namespace kys_slam {

/// Keypoints that were found on two segments (numbers from 1), and how they moved.
struct SegmentLinks {
  using Votes = std::map<std::pair<std::uint16_t, std::uint16_t>, int>;
  struct Shift {
    float u = 0, v = 0;  ///< px, median
    int count = 0;
  };
  std::array<Votes, 2> in_time;                          ///< by camera; (last frame, this frame)
  std::array<std::map<std::uint16_t, Shift>, 2> shifts;  ///< by camera; of the last frame's segment
  Votes in_stereo;                                       ///< this frame; (left, right)
  Votes by_disparity;  ///< likewise, pixels of the left segment whose disparity leads to the right
};

/// Pixels of left things that end on a thing of the right view by their disparity (px, NaN
/// unknown).
SegmentLinks::Votes links_by_disparity(const PanopticMap& left, const PanopticMap& right,
                                       const ImageOf<float>& disparity);

/// Gives thing segments of both cameras identities that persist, and one object the same identity
/// in both: assignment by the overlap of masks, those of the past moved to where they are expected,
/// and by keypoints found on both. A track is remembered over `max_missed_frames` frames and moves
/// on with its last speed in the image. Two tracks, one of each view, that turn out to be one
/// object become the older one. Whatever moves by itself may change its class (networks call a far
/// car a person), other things may not.
class MaskAssociator {
 public:
  /// \param pooled by label: classes that one object may change between
  MaskAssociator(const BuilderOptions::Association& options, std::vector<bool> pooled)
      : options_(options), pooled_(std::move(pooled)) {}

  /// The next frame. \param cameras left, and right if there is one
  /// \return identities 0, 1, 2, ... by camera and segment; -1 of stuff
  std::vector<std::vector<std::int32_t>> next_frame(std::span<const PanopticMap* const> cameras,
                                                    const SegmentLinks& links);

  [[nodiscard]] std::int32_t identities_given() const { return next_identity_; }

 private:
  struct MaskRun {
    std::int32_t y, x0, x1;
  };
  struct View {
    std::vector<MaskRun> mask;        ///< empty: never seen by this camera
    std::uint16_t segment = 0;        ///< its number in the frame it was last seen in
    double u = 0, v = 0;              ///< px, centroid
    double speed_u = 0, speed_v = 0;  ///< px per frame
    int missed = 0;                   ///< frames since
  };
  struct Track {
    std::int32_t identity = 0;
    std::uint16_t label = 0;
    std::array<View, 2> views;
  };
  [[nodiscard]] int group_of(std::uint16_t label) const {
    return label < pooled_.size() && pooled_[label] ? -1 : label;
  }
  [[nodiscard]] std::map<std::uint16_t, double> overlaps(const View& view, std::size_t c,
                                                         const PanopticMap& map,
                                                         const std::vector<SegmentShape>& shapes,
                                                         const SegmentLinks& links) const;
  void associate(std::size_t c, const PanopticMap& map, const SegmentLinks& links,
                 const std::vector<std::vector<std::int32_t>>& given,
                 std::vector<std::int32_t>& identities);

  void join_views(const PanopticMap& left, const PanopticMap& right, const SegmentLinks& links,
                  std::vector<std::vector<std::int32_t>>& identities);

  BuilderOptions::Association options_;
  std::vector<bool> pooled_;
  std::vector<Track> tracks_;  ///< in order of identity
  std::int32_t next_identity_ = 0;
};

}  // namespace kys_slam
