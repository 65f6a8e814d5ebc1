#pragma once

#include <kys/distance.h>
#include <kys_slam/frame_source.h>

#include <cstdint>
#include <span>
#include <vector>

namespace kys_slam {

/// A segment that an image shows.
struct VisibleSegment {
  kys::Prior prior;  ///< without motion
  double area = 0;   ///< px
};

/// The segments of one image on a coarse grid.
struct SegmentCells {
  int step = 0;                      ///< px, side of a cell
  int columns = 0;                   ///< cells per row; the last may reach over the border
  std::vector<std::uint16_t> cells;  ///< by row: 0 void, k: segments[k - 1] at its centre
  std::vector<VisibleSegment> segments;
};

/// Source of the priors of keypoints (paper, Sec. 3.4). Called once per frame, in order.
class PriorProvider {
 public:
  PriorProvider() = default;
  PriorProvider(const PriorProvider&) = delete;
  PriorProvider& operator=(const PriorProvider&) = delete;
  virtual ~PriorProvider() = default;

  /// Fills one prior per keypoint of each image. Returns false when the frame has no priors.
  /// \throws InputError when the priors of the frame are unusable.
  virtual bool look_up(const StereoFrame& frame, std::span<const Keypoint> left,
                       std::span<const Keypoint> right, std::vector<kys::Prior>& left_priors,
                       std::vector<kys::Prior>& right_priors) = 0;

  /// Fills the segments of both images of a frame, of which look_up() comes next; they include
  /// segments without keypoints. Returns false when they are not known.
  /// \param step px, side of a cell
  /// \throws InputError as look_up().
  virtual bool segments(const StereoFrame& frame, int step, SegmentCells& left,
                        SegmentCells& right) {
    static_cast<void>(frame), static_cast<void>(step);
    static_cast<void>(left), static_cast<void>(right);
    return false;
  }
};

}  // namespace kys_slam
