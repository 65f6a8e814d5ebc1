// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/belief.h>
#include <kys/distance_model.h>
#include <kys/option_list.h>
#include <kys_slam/rigid3.h>
#include <kys_slam/segment_image.h>
#include <kys_slam/stereo_camera.h>

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "map/frame_features.h"

namespace kys_slam {

/// Motion of a segment since the image it was found in, m, in the axes of the camera then.
/// Zero: that of the scene.
using SegmentShifts = std::vector<Eigen::Vector3d>;

/// How keypoints of other frames are searched in the segmented image.
struct SegmentSearch {
  ScaleLevels scales;
  const kys::DistanceModel* model = nullptr;  ///< must outlive this
  float radius = 0;        ///< px at octave 0, around where geometry puts a keypoint
  float max_distance = 0;  ///< bits
  float ratio = 0;         ///< best / second best distance
};

/// The segments of one image, carried to other frames. A keypoint that is found again in the image
/// has the segment it is on there. Else a point seen in another frame is moved
/// to where it was when the image was taken, with the scene or with a segment that moves, and has
/// the segment of the pixel it is seen at there, if this surface is as far away. What has
/// no disparity has the segment that covers its pixel when all are moved, each at the depth of its
/// features. Immutable.
class SegmentCarrier {
 public:
  /// \param features of the left image of that frame: their disparities say how far away segments
  /// are
  /// \param segments of the image, with their identities
  /// \param is_thing by label
  /// \param carried false: for its own frame and same_segments() only
  SegmentCarrier(const StereoCamera& camera, std::shared_ptr<const SegmentImage> image,
                 std::vector<kys::Prior> segments, std::shared_ptr<const FrameFeatures> features,
                 std::vector<std::uint8_t> is_thing, bool carried = true);

  /// Per feature of another frame the number of its segment, 0: not known.
  /// \param T_s_now from the camera of that frame to that of the image
  /// \param shifts one per segment
  /// \param search null: no keypoint is searched
  [[nodiscard]] std::vector<std::uint16_t> carry(const FrameFeatures& now, const Rigid3& T_s_now,
                                                 const SegmentShifts& shifts,
                                                 const SegmentSearch* search = nullptr) const;
  /// The same for one point (m) in the camera of another frame.
  [[nodiscard]] std::uint16_t segment_of(const Eigen::Vector3d& p_now, const Rigid3& T_s_now,
                                         const SegmentShifts& shifts) const;
  /// Per feature of its own frame the number of the segment at its pixel.
  [[nodiscard]] const std::vector<std::uint16_t>& own() const { return segment_of_feature_; }
  [[nodiscard]] std::span<const kys::Prior> segments() const { return segments_; }
  [[nodiscard]] bool is_thing(std::uint16_t segment) const {
    const std::uint16_t label = segments_[segment - 1U].label;
    return label < is_thing_.size() && is_thing_[label] != 0;
  }
  /// Priors by number of segment; none for 0.
  [[nodiscard]] std::vector<kys::Prior> priors_of(std::span<const std::uint16_t> numbers) const;
  /// Points (m, in the camera of the image) that spread over a segment: pixels at equal steps, at
  /// the depth of its nearest feature. Empty when none of its features has a disparity.
  [[nodiscard]] std::vector<Eigen::Vector3d> sample(std::uint16_t segment) const;
  [[nodiscard]] const FrameFeatures& features() const { return *features_; }

 private:
  [[nodiscard]] std::uint16_t at(double u, double v) const;
  struct Surface {
    bool near = false;     // there are features of the segment around
    bool agrees = false;   // one of them is as far away
    bool in_front = true;  // the point is nearer than all of them
  };
  [[nodiscard]] Surface surface_at(std::uint16_t segment, const Eigen::Vector3d& pixel) const;
  /// Of an image, on a grid.
  struct Cell {
    std::uint16_t segment = 0;
    float depth = 0;  // m
  };
  void sample_depths();
  [[nodiscard]] double depth_at(std::uint16_t segment, std::span<const std::uint32_t> among,
                                double u, double v) const;
  void close_gaps(std::vector<Cell>& grid) const;
  void cover(const FrameFeatures& now, const Rigid3& T_s_now, const SegmentShifts& shifts,
             std::span<const Cell> moved, std::vector<std::uint16_t>& numbers) const;
  void find_again(const FrameFeatures& now, const Rigid3& T_s_now, const SegmentShifts& shifts,
                  std::span<const Cell> moved, const SegmentSearch& search,
                  std::vector<std::uint16_t>& numbers) const;
  [[nodiscard]] std::vector<Cell> cells_around(const Keypoint& k,
                                               std::span<const Cell> moved) const;
  void fill(const FrameFeatures& now, std::vector<std::uint16_t>& numbers) const;
  void put(const Cell& cell, const Eigen::Vector3d& p, std::vector<Cell>& grid) const;
  [[nodiscard]] std::vector<Cell> warp(const Rigid3& T_now_s, const SegmentShifts& shifts) const;
  [[nodiscard]] bool agrees(std::uint16_t segment, const Eigen::Vector3d& p_s) const;
  [[nodiscard]] std::uint16_t seen_at(const Eigen::Vector3d& p_s, std::uint16_t only) const;

  StereoCamera camera_;
  std::shared_ptr<const SegmentImage> image_;
  std::vector<kys::Prior> segments_;
  std::shared_ptr<const FrameFeatures> features_;
  std::vector<std::uint8_t> is_thing_;  // by label
  std::vector<std::uint16_t> segment_of_feature_;
  std::vector<std::vector<std::uint32_t>> members_;  // by segment - 1; features with disparity
  int columns_ = 0, rows_ = 0;                       // of the grid
  std::vector<Cell> cells_;                          // of the image
};

/// Which segments of `before`, carried to the frame of `now`, are those of `now`: per segment of
/// `now` the number in `before`, 0: a new one. By the overlap of surfaces; one to one; stuff is not
/// named. Classes that move by themselves may change, as networks take a truck for a car.
/// \param T_before_now between the cameras of the two images
std::vector<std::uint16_t> same_segments(const SegmentCarrier& before, const SegmentCarrier& now,
                                         const Rigid3& T_before_now, const SegmentShifts& shifts,
                                         const kys::InitialBelief& start);

}  // namespace kys_slam
