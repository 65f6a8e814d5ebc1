// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "priors/fusion/detection.h"
#include "priors/fusion/object_segments.h"
#include "priors/fusion/options.h"
#include "priors/fusion/panoptic.h"

namespace kys_slam {

/// Keypoints found on two segments (numbers from 1), and their shift in the image.
struct SegmentLinks {
  using Votes = std::map<std::pair<std::uint16_t, std::uint16_t>, int>;
  struct Shift {
    float u = 0, v = 0;  ///< px, median
    int count = 0;
  };
  std::array<Votes, 2> in_time;                          ///< by camera; (last frame, this frame)
  std::array<std::map<std::uint16_t, Shift>, 2> shifts;  ///< by camera; of the last frame's segment
  Votes in_stereo;                                       ///< this frame; (left, right)
  Votes by_disparity;  ///< this frame; (left, right), counted in pixels linked by disparity
};

/// Counts the pixels of left things that fall on a thing of the right view by their disparity (px,
/// NaN: not known).
SegmentLinks::Votes links_by_disparity(const PanopticMap& left, const PanopticMap& right,
                                       const ImageOf<float>& disparity);

/// Gives the thing segments of both cameras identities over time, and an object the same identity
/// in both cameras. Assignment is by the overlap of masks, those of earlier frames shifted to their
/// predicted position, and by common keypoints. A track survives `max_missed_frames` frames without
/// a match and moves with its last image velocity. Two tracks, one of each view, that prove to be
/// one object are merged into the older one. Classes that move by themselves may change (networks
/// label a far car as a person); other classes may not.
class MaskAssociator {
 public:
  /// \param pooled by label: true for classes between which an object may change
  MaskAssociator(const BuilderOptions::Association& options, std::vector<bool> pooled)
      : options_(options), pooled_(std::move(pooled)) {}

  /// The next frame. \param cameras left, and right if there is one
  /// \param c the camera whose things are assigned: after an error, the one at fault
  /// \return identities 0, 1, 2, ... by camera and segment; -1 of stuff
  /// \throws InputError as check_assignment() does
  std::vector<std::vector<std::int32_t>> next_frame(std::span<const PanopticMap* const> cameras,
                                                    const SegmentLinks& links, std::size_t& c);
  std::vector<std::vector<std::int32_t>> next_frame(std::span<const PanopticMap* const> cameras,
                                                    const SegmentLinks& links) {
    std::size_t c = 0;
    return next_frame(cameras, links, c);
  }

  [[nodiscard]] std::int32_t identities_given() const { return next_identity_; }

  /// Where the things of the frames before are expected in the next image of a camera.
  [[nodiscard]] std::vector<ExpectedThing> expected(std::size_t camera) const;
  /// What keypoints say of the last frame's segments. Call it before next_frame().
  void observe(std::size_t camera, std::span<const KeypointEvidence> evidence);
  /// Median disparities of the last frame's segments (px; 0: not known), by segment number. Call it
  /// after next_frame().
  void observe_depth(std::size_t camera, std::span<const float> disparity);
  /// The class an identity of the last frame has by the votes of its segments over time.
  [[nodiscard]] std::uint16_t label_of(std::int32_t identity) const;

 private:
  struct View {
    std::vector<MaskRun> mask;        ///< empty: never seen by this camera
    std::uint16_t segment = 0;        ///< its number in the frame it was last seen in
    double u = 0, v = 0;              ///< px, centroid
    double speed_u = 0, speed_v = 0;  ///< px per frame
    int missed = 0;                   ///< frames since
    float disparity = 0;              ///< px, median; 0: not known
  };
  struct Track {
    std::int32_t identity = 0;
    std::uint16_t label = 0;
    std::array<View, 2> views;
    std::map<std::uint16_t, double> votes;  ///< for classes
    std::optional<ThingMotion> motion;      ///< by keypoints, those of the last frames count most
    int frames = 0;                         ///< in which a camera saw it
  };
  void vote(Track& track, std::uint16_t label) const;
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
