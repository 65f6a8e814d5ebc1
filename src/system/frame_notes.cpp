// SPDX-License-Identifier: BSD-3-Clause
#include "system/frame_notes.h"

#include <fmt/format.h>
#include <kys_slam/error.h>
#include <kys_slam/same_image.h>

#include <algorithm>

#include "system/system_impl.h"

/// Warnings about a frame.
namespace kys_slam {

void add_phrase(std::string& text, const std::string& phrase) {
  if (!phrase.empty()) text += (text.empty() ? "" : "; ") + phrase;
}

std::string note_of_times(const FrameReports& reports) {
  constexpr std::size_t kFrames = 5;
  constexpr double kLongest = 10;  // s; what moves between is not tracked
  if (reports.size() != kFrames) return "";
  for (std::size_t i = 1; i < kFrames; ++i) {
    if (reports[i].timestamp - reports[i - 1].timestamp <= kLongest) return "";
  }
  return fmt::format(
      "the first frames are {:.4g} s and more apart by their time stamps, which have to be in s",
      reports[1].timestamp - reports[0].timestamp);
}

void note_integrity(const IntegrityResult& result, FrameReport& report) {
  report.integrity = result.integrity;
  report.integrity_reason = result.reason;
  if (result.reason == IntegrityReason::kTwoMotions) {
    add_phrase(report.warning,
               "a large part of the image moves otherwise than the pose says: an object that "
               "fills the view, or the camera's own vehicle (mask it: --mask)");
  }
  if (result.keeps_place) {
    add_phrase(report.warning,
               "a part of the image keeps its place while the camera moves: its own vehicle "
               "(mask it: --mask), or one that it follows");
  }
}

bool is_by_parallax(const std::string& fault, const FrameFeatures& left, int width) {
  const bool of_right = fault.starts_with("the right half of the right");
  if (!of_right && !fault.starts_with("the left half of the left")) return false;
  constexpr double kLeast = 0.3;  // share that is shifted across the middle
  const auto middle = static_cast<float>(width) / 2;
  std::size_t across = 0, all = 0;
  for (std::size_t i = 0; i < left.size(); ++i) {
    const bool matched = left.has_stereo(i);
    const bool in_right_half = left.keypoint(i).x >= middle;
    if (of_right ? in_right_half : matched) ++all;
    if (matched && in_right_half && left.u_right(i) < middle) ++across;
  }
  return all > 0 && static_cast<double>(across) >= kLeast * static_cast<double>(all);
}

/// Masks that are inverted, as the first fault to suspect, and masks as the reason of a lost frame.
void System::Impl::note_masks(const StereoMasks& masks, FrameReport& report) const {
  constexpr double kMost = 0.75;  // share of an image that no robot and no traffic covers
  bool covers = false;
  for (const GrayImage* mask : {&masks.left, &masks.right}) {
    if (mask->empty()) continue;
    const auto unused =
        static_cast<double>(mask->size()) -
        static_cast<double>(std::count(mask->data(), mask->data() + mask->size(), 0));
    covers = covers || unused > kMost * static_cast<double>(mask->size());
  }
  if (covers) {
    add_phrase(report.warning,
               "a mask covers most of the image: 0 means use, anything else means do "
               "not use; is the mask inverted?");
  }
  const bool any = !masks.left.empty() || !masks.right.empty();
  if (any && report.status == FrameStatus::kLost && report.masked > 3 * report.keypoints) {
    report.reason = report.keypoints == 0
                        ? "masks leave no corners of the image"
                        : report.reason + "; masks leave few corners of the image";
  }
}

/// A frame whose two images are the same shows nothing but depths that are wrong: it is lost. A
/// recording that begins with nothing else is not one of two cameras.
bool System::Impl::drop_same_image(const StereoFrame& frame, FrontEndResult& seen) {
  constexpr std::int64_t kMost = 5;  // frames
  if (frame.left_features || !is_same_image(frame.left, frame.right)) return false;
  if (same_images == count && ++same_images >= kMost) {
    throw InputError(
        fmt::format("frame {}: {}, as in all frames before; give the images of two cameras",
                    frame.name.empty() ? std::to_string(frame.index) : frame.name, kSameImage));
  }
  seen.features =
      std::make_shared<const FrameFeatures>(FrameFeatures(camera, FeatureSet{}, {}, {}));
  seen.stereo_matches = 0;
  return true;
}

void System::Impl::set_images(const ImageView& left, const ImageView& right, StereoFrame& frame) {
  ImageView views[2] = {left, right};
  if (bits == 0 && left.bits == 0) {
    bits = std::max(used_bits(left), used_bits(right));
    add_phrase(first_note, note_of_bits(bits));
  }
  for (ImageView& view : views) {
    if (view.bits == 0) view.bits = bits;
  }
  frame.left = to_gray(views[0]);
  frame.right = to_gray(views[1]);
}

}  // namespace kys_slam
