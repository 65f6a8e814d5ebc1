// SPDX-License-Identifier: BSD-3-Clause
// What comes beside the pairs: label images and masks.
#include <kys_slam/error.h>

#include <algorithm>
#include <utility>

#include "label_image.h"
#include "node_run.h"

namespace kys_slam::ros {

namespace {

constexpr std::size_t kMostEarly = 16;  // label images before their frame

/// 255 where the message is not 0. \throws InputError
GrayImage mask_of(const ImageMessage& message) {
  if (message.encoding != "mono8" && message.encoding != "8UC1") {
    throw InputError("a mask with encoding '" + message.encoding + "': mono8 expected");
  }
  GrayImage mask = to_gray(view_of(message));
  std::transform(mask.data(), mask.data() + mask.size(), mask.data(), [](std::uint8_t value) {
    return static_cast<std::uint8_t>(value == 0 ? 0 : 255);
  });
  return mask;
}

}  // namespace

void NodeLogic::add_segments(const ImageMessage& message) {
  if (!options_.segments) {
    complain("a label image came: set the parameter segments, so that it is used");
    return;
  }
  std::shared_ptr<Run> run;
  std::int64_t frame = 0;
  bool is_first_stray = false;
  {
    const std::lock_guard lock(mutex_);
    const auto image = std::ranges::find(fed_images_, message.stamp, &FedImage::stamp);
    if (image != fed_images_.end()) {
      run = run_;
      frame = image->frame;
    } else if (fed_images_.empty() || message.stamp > fed_images_.back().stamp) {
      early_.insert_or_assign(message.stamp.nanoseconds(), message);
      if (early_.size() <= kMostEarly) return;
      early_.erase(early_.begin());
    }
    if (!run) is_first_stray = log_.stray_segments++ == 0;
  }
  if (run) {
    give_segments(*run, frame, message);
  } else if (is_first_stray) {
    output_->log(NodeOutput::Level::kWarn,
                 "a label image whose stamp is that of no tracked left image is not used");
  }
}

void NodeLogic::give_segments(Run& run, std::int64_t frame, const ImageMessage& message) {
  try {
    auto image = segments_of(message, label_space_, options_.segment_divisor);
    if (run.calibration.rectifier) {
      image->map = run.calibration.rectifier->rectify_left_map(image->map);
    }
    run.system.add_segments(frame, std::move(image));
  } catch (const InputError& error) {  // the frame is tracked without
    complain(error.what());
  }
}

void NodeLogic::set_mask(Side side, const ImageMessage& message) {
  try {
    GrayImage mask = mask_of(message);
    const std::lock_guard lock(mutex_);
    masks_[static_cast<std::size_t>(side)] = std::move(mask);
    if (run_) run_->has_masks = false;
  } catch (const InputError& error) {
    complain(error.what());
  }
}

/// The masks of the node as this run needs them; one of another size is not used.
void NodeLogic::take_masks(Run& run) {
  std::array<GrayImage, 2> masks;
  {
    const std::lock_guard lock(mutex_);
    if (std::exchange(run.has_masks, true)) return;
    masks = masks_;
  }
  for (const Side side : {Side::kLeft, Side::kRight}) {
    const auto i = static_cast<std::size_t>(side);
    if (masks[i].empty()) continue;
    if (masks[i].width() != run.images.width || masks[i].height() != run.images.height) {
      complain(std::string("the mask of the ") + to_string(side) + " camera has " +
               std::to_string(masks[i].width()) + "x" + std::to_string(masks[i].height()) +
               " px, its images " + std::to_string(run.images.width) + "x" +
               std::to_string(run.images.height) + ": it is not used");
      masks[i] = {};
      continue;
    }
    masks[i] = run.rectified(side, std::move(masks[i]));
  }
  run.masks = {std::move(masks[0]), std::move(masks[1])};
}

}  // namespace kys_slam::ros
