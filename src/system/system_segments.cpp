// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <kys/label_space.h>
#include <kys_slam/error.h>
#include <kys_slam/util/stopwatch.h>

#include <algorithm>
#include <utility>

#include "system/system_impl.h"

// Segmentations that come late.

namespace kys_slam {

namespace {

void check_image(const SegmentImage& image, std::int64_t frame, const StereoCamera& camera,
                 std::size_t labels) {
  const std::string name = fmt::format("segments of frame {}", frame);
  if (image.map.width() != camera.width || image.map.height() != camera.height) {
    throw InputError(fmt::format("{}: a map of {}x{} px where the calibration says {}x{}", name,
                                 image.map.width(), image.map.height(), camera.width,
                                 camera.height));
  }
  const std::uint16_t* end = image.map.data() + image.map.size();
  const std::uint16_t largest = *std::max_element(image.map.data(), end);
  if (largest > image.segments.size()) {
    throw InputError(fmt::format("{}: the map has segment {}, the list {} segments", name, largest,
                                 image.segments.size()));
  }
  for (const kys::Prior& segment : image.segments) {
    if (segment.label >= labels) {
      throw InputError(fmt::format("{}: label {} is not in the label space ({} classes)", name,
                                   segment.label, labels));
    }
  }
}

}  // namespace

void System::add_segments(std::int64_t frame, std::shared_ptr<const SegmentImage> image) {
  Impl& s = *impl_;
  if (image) check_image(*image, frame, s.camera, s.labels());
  s.segments.put(frame, std::move(image));
}

void System::end_segments() {
  impl_->segments.end();
}

/// By the label space of the settings. \throws InputError
std::size_t System::Impl::labels() {
  std::call_once(labels_known, [&] { is_thing = things_of(options.control.label_space); });
  return is_thing.size();
}

/// What takes effect at this frame; waits for it where it is due.
std::vector<SegmentQueue::Delivery> System::Impl::take_segments(const FrontEndResult& seen) {
  if (!model.uses_priors() || !segments.in_use()) return {};
  if (!late_segments) {
    labels();
    const kys::InitialBelief start(options.belief,
                                   kys::load_label_space(options.control.label_space));
    late_segments.emplace(camera, scales, options.tracking.instances, model, start, is_thing,
                          options.control.segments.memory);
    late_segments->continue_after(instance_end);
  }
  // A frame with priors of its own needs no segments.
  if (!seen.features->priors().empty()) return {};
  return segments.take(count);
}

/// Whether the frame waits for the first segments: without priors a map may follow a vehicle.
bool System::Impl::must_hold(const std::vector<SegmentQueue::Delivery>& arrived,
                             const FrontEndResult& seen) {
  if (!model.uses_belief() || tracker.has_map() || options.control.segments.every == 0)
    return false;
  if (segments.over() || !seen.features->priors().empty()) return false;
  const auto first = count - static_cast<std::int64_t>(held.size());
  return std::ranges::none_of(
      arrived, [&](const SegmentQueue::Delivery& delivery) { return delivery.frame >= first; });
}

void System::Impl::hold(const StereoFrame& frame, const FrontEndResult& seen, FrameReport& report) {
  constexpr std::size_t kMostHeld = 100;
  if (held.size() == kMostHeld) held.erase(held.begin());
  HeldFrame& kept = held.emplace_back();
  kept.frame.index = frame.index;
  kept.frame.name = frame.name;
  kept.frame.timestamp = frame.timestamp;
  kept.seen = seen;
  if (seen.left != nullptr) kept.left = *seen.left;
  TrackResult none;
  none.taken = frame.timestamp;
  none.reason = "waits for the first segments";
  note(none, seen, report);
  reports.push_back(report);
  if (observer) {
    seen_features = seen.features;
    observe(report, *seen.features, {});
  }
  frame_poses.add(none.pose);
  objects.add(none.taken, {});
  ++count;
}

/// The frames that waited, from the first one with segments on, as if these had been there in time;
/// all of them when no segments come.
void System::Impl::track_held(const std::vector<SegmentQueue::Delivery>& arrived) {
  std::vector<HeldFrame> frames = std::exchange(held, {});
  auto first = frames.begin();
  const std::int64_t end = count;
  const std::int64_t begin = end - static_cast<std::int64_t>(frames.size());
  for (const SegmentQueue::Delivery& delivery : arrived) {
    if (delivery.frame < begin) continue;
    first += std::min(delivery.frame, end) - begin;
    break;
  }
  const auto again = static_cast<std::size_t>(frames.end() - first);
  const auto at = static_cast<std::ptrdiff_t>(reports.size() - again);
  const std::vector<FrameReport> before(reports.begin() + at, reports.end());
  reports.resize(reports.size() - again);
  frame_poses.take_back(again);
  objects.take_back(again);
  count -= static_cast<std::int64_t>(again);
  const FrameObserver silent = std::exchange(observer, {});  // it has seen them
  for (auto frame = first; frame != frames.end(); ++frame) {
    FrameReport report = before[static_cast<std::size_t>(frame - first)];
    frame->seen.left = frame->left.levels.empty() ? nullptr : &frame->left;
    std::vector<SegmentQueue::Delivery> own;
    for (const SegmentQueue::Delivery& delivery : arrived) {
      if (delivery.frame == count) own.push_back(delivery);
    }
    track(frame->frame, frame->seen, own, report);
    reports.back().segments_of = -1;  // they are known with the frame being fed
  }
  observer = silent;
}

/// Priors of the frame from segments of an earlier one. Returns the frame whose segments take
/// effect; -1: none.
std::int64_t System::Impl::attach_segments(const StereoFrame& frame, FrontEndResult& seen,
                                           const std::vector<SegmentQueue::Delivery>& arrived) {
  if (!late_segments) return -1;
  Stopwatch watch;
  std::int64_t latest = -1;
  for (const SegmentQueue::Delivery& delivery : arrived) {
    if (late_segments->arrive(delivery.frame, delivery.image, count, frame.timestamp, seen.features,
                              tracker) ||
        delivery.frame == late_segments->latest()) {
      latest = delivery.frame;
    }
  }
  if (!seen.features->priors().empty()) return latest;
  std::vector<kys::Prior> carried = late_segments->carry(frame.timestamp, *seen.features, tracker);
  if (carried.empty()) return latest;
  const auto labelled = std::ranges::count_if(
      carried, [](const kys::Prior& prior) { return prior.label != kys::kVoidLabel; });
  seen.prior_coverage = static_cast<double>(labelled) / static_cast<double>(carried.size());
  FrameFeatures features = seen.features->with_priors(std::move(carried));
  std::vector<std::uint8_t> keep(features.size());
  for (std::size_t i = 0; i < keep.size(); ++i) {
    keep[i] = model.keeps_keypoint(features.prior(i)) ? 1 : 0;
  }
  if (const auto dropped = std::ranges::count(keep, 0); dropped > 0) {
    seen.masked += static_cast<int>(dropped);
    features = features.subset(keep);
  }
  seen.features = std::make_shared<const FrameFeatures>(std::move(features));
  seen.times.priors += watch.lap_ms();
  return latest;
}

}  // namespace kys_slam
