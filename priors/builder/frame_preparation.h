// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/label_space.h>

#include <array>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <vector>

#include "priors/builder/build_sequence.h"
#include "priors/builder/keypoint_motion.h"
#include "priors/builder/sequence_fields.h"
#include "priors/fusion/association.h"
#include "priors/fusion/mask_association.h"
#include "priors/fusion/object_classes.h"
#include "priors/input/panoptic_input.h"

namespace kys_slam {

/// A frame with identities, before it is measured.
struct PreparedFrame {
  FramePerception perception;                         ///< flow and depth come later
  KeypointMotion::Evidence evidence;                  ///< complete when the next frame is prepared
  std::vector<std::vector<FreeSpaceEvidence>> space;  ///< by camera and segment; or empty
  DisparityPair disparity;  ///< px, checked; where it was needed for identities
};

/// Reads the segmentations of a sequence frame by frame, gives the segments identities, and judges
/// them by keypoints and free space.
class FramePreparation {
 public:
  /// Keeps references to all but `labels` and `jobs`.
  /// \param readers  by camera
  FramePreparation(const BuildSequence& sequence, const kys::LabelSpace& labels,
                   const BuildInputs& inputs, const BuilderOptions& options,
                   const std::vector<PanopticReader>& readers, const SequenceFields& fields,
                   int jobs);
  ~FramePreparation();

  /// Prepares all frames before `end`.
  void prepare(std::size_t end);
  /// Frames that are prepared and not taken, earliest first.
  [[nodiscard]] const std::deque<PreparedFrame>& waiting() const { return waiting_; }
  /// Takes the earliest frame.
  PreparedFrame take();

  /// An object has the same identity in both cameras.
  [[nodiscard]] bool shares_identities() const { return overlap_.has_value(); }
  [[nodiscard]] std::int64_t identities_given(std::size_t camera) const {
    return overlap_ ? overlap_->identities_given() : associators_[camera].identities_given();
  }
  /// Sums over all frames prepared.
  [[nodiscard]] const BuildTimes& times() const { return times_; }

 private:
  struct Reading;

  [[nodiscard]] bool links_views() const;
  [[nodiscard]] bool needs_disparity() const;
  void read(std::size_t t, Reading& out) const;
  void read_disparity(std::size_t t, const ImagePair& pair, Reading& out) const;
  void find_objects(Reading& reading) const;
  void judge_keypoints(std::size_t t, Reading& reading, SegmentLinks& links);
  void judge_space(std::size_t t, PreparedFrame& frame);
  void identify(std::size_t t, Reading& reading, const SegmentLinks& links);
  void identify_by_overlap(PreparedFrame& frame, const SegmentLinks& links, std::size_t& camera);
  [[nodiscard]] std::vector<std::int32_t> identify_by_centroid(
      std::size_t c, const PanopticMap& panoptic, const std::vector<SegmentShape>& shapes);

  const BuildSequence& sequence_;
  const BuildInputs& inputs_;
  const std::vector<PanopticReader>& readers_;
  const SequenceFields& fields_;
  int jobs_;
  bool split_;                                   ///< things by depth
  std::optional<ObjectClasses> classes_;         ///< segments become objects
  std::vector<InstanceAssociator> associators_;  ///< by camera
  std::optional<MaskAssociator> overlap_;
  std::unique_ptr<KeypointMotion> keypoints_;  ///< null: keypoints are not used
  std::deque<DisparityPair> earlier_;          ///< latest first
  std::deque<PreparedFrame> waiting_;
  std::size_t read_ = 0;  ///< frames
  BuildTimes times_;
};

}  // namespace kys_slam
