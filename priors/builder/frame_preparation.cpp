// SPDX-License-Identifier: BSD-3-Clause
#include "priors/builder/frame_preparation.h"

#include <kys_slam/error.h>
#include <kys_slam/prior_format.h>
#include <kys_slam/util/stopwatch.h>

#include <algorithm>
#include <utility>

#include "priors/builder/for_each_index.h"
#include "priors/fusion/depth_split.h"
#include "priors/fusion/free_space.h"
#include "priors/fusion/object_claims.h"

namespace kys_slam {
namespace {

/// Numbers of segments as they go into the file. Stuff has one per class, below those of things.
std::vector<std::int32_t> instances_of(std::size_t c, const PanopticMap& panoptic,
                                       const std::vector<std::int32_t>& identities) {
  const std::int32_t base = c == 0 ? 0 : prior_format::kRightInstances;
  std::vector<std::int32_t> instances;
  for (std::size_t k = 0; k < panoptic.segments.size(); ++k) {
    const InputSegment& s = panoptic.segments[k];
    instances.push_back(base + (s.thing ? 65536 + identities[k] : s.label));
  }
  return instances;
}

}  // namespace

/// What is read of a frame, without the frames before it.
struct FramePreparation::Reading {
  PreparedFrame frame;
  std::vector<std::vector<SegmentShape>> shapes;  // by camera
  std::shared_ptr<const FrameFeatures> features;  // null: keypoints are not used
  BuildTimes times;
};

FramePreparation::FramePreparation(const BuildSequence& sequence, const kys::LabelSpace& labels,
                                   const BuildInputs& inputs, const BuilderOptions& options,
                                   const std::vector<PanopticReader>& readers,
                                   const SequenceFields& fields, int jobs)
    : sequence_(sequence),
      inputs_(inputs),
      readers_(readers),
      fields_(fields),
      jobs_(jobs),
      split_(options.segments.split_by_depth),
      associators_(readers.size(), InstanceAssociator(options.association)) {
  if (inputs.keypoints) {
    keypoints_ = std::make_unique<KeypointMotion>(sequence.camera, options.keypoints);
  }
  if (options.association.method != AssociationMethod::kOverlap) return;
  const ObjectClasses classes(labels);
  overlap_.emplace(options.association, classes.moving());
  if (options.segments.make_objects && !inputs.disparity.empty()) classes_ = classes;
}

FramePreparation::~FramePreparation() = default;

PreparedFrame FramePreparation::take() {
  PreparedFrame frame = std::move(waiting_.front());
  waiting_.pop_front();
  return frame;
}

/// Disparity links the segments of the two views.
bool FramePreparation::links_views() const {
  return overlap_ && readers_.size() == 2 && !inputs_.disparity.empty();
}

/// Disparities are needed before frames are measured.
bool FramePreparation::needs_disparity() const {
  return links_views() || classes_ || (split_ && !inputs_.disparity.empty());
}

void FramePreparation::prepare(std::size_t end) {
  const std::size_t begin = read_;
  if (end <= begin) return;
  std::vector<Reading> batch(end - begin);
  for_each_index(end - begin, jobs_, [&](std::size_t i) { read(begin + i, batch[i]); });
  for (Reading& reading : batch) {
    SegmentLinks links;
    Stopwatch watch;
    if (classes_) find_objects(reading);
    if (links_views()) {
      const FramePerception& views = reading.frame.perception;
      links.by_disparity =
          links_by_disparity(views[0].panoptic, views[1].panoptic, reading.frame.disparity[0]);
    }
    reading.times.association += watch.lap_ms();
    if (keypoints_) judge_keypoints(read_, reading, links);
    if (keypoints_ && links_views()) judge_space(read_, reading.frame);
    reading.times.keypoints += watch.lap_ms();
    identify(read_, reading, links);
    reading.times.association += watch.lap_ms();
    times_ += reading.times;
    reading.features.reset();
    waiting_.push_back(std::move(reading.frame));
    ++read_;
  }
}

/// Reads a frame. Several threads read frames at a time.
void FramePreparation::read(std::size_t t, Reading& out) const {
  for (const PanopticReader& reader : readers_) {
    CameraPerception& in = out.frame.perception.emplace_back();
    in.panoptic = reader.read(sequence_.names[t], sequence_.camera.width, sequence_.camera.height);
  }
  ImagePair pair;
  if (keypoints_ || (needs_disparity() && inputs_.disparity == "sgbm")) pair = sequence_.read(t);
  if (keypoints_) {
    const Stopwatch watch;
    out.features = keypoints_->extract(pair.first, pair.second);
    out.times.keypoints += watch.elapsed_ms();
  }
  if (needs_disparity()) read_disparity(t, pair, out);
  const Stopwatch watch;
  for (const CameraPerception& in : out.frame.perception) {
    out.shapes.push_back(segment_shapes(in.panoptic.runs, in.panoptic.segments.size()));
  }
  out.times.association += watch.elapsed_ms();
}

void FramePreparation::read_disparity(std::size_t t, const ImagePair& pair, Reading& out) const {
  PreparedFrame& frame = out.frame;
  Stopwatch watch;
  frame.disparity = fields_.disparities(t, pair);
  out.times.stereo += watch.lap_ms();
  fields_.complete(frame.disparity, frame.perception);
  out.times.depth += watch.lap_ms();
  for (std::size_t c = 0; split_ && c < frame.perception.size(); ++c) {
    split_by_depth(frame.disparity[c], frame.perception[c].panoptic);
  }
  out.times.association += watch.lap_ms();
}

/// Makes objects of the segments of a frame, with the things of the frames before.
void FramePreparation::find_objects(Reading& reading) const {
  for (std::size_t c = 0; c < reading.frame.perception.size(); ++c) {
    PanopticMap& panoptic = reading.frame.perception[c].panoptic;
    make_objects(reading.frame.disparity[c], *classes_, overlap_->expected(c), panoptic);
    reading.shapes[c] = segment_shapes(panoptic.runs, panoptic.segments.size());
  }
}

/// What a frame's keypoints say about the segments of the frame before.
void FramePreparation::judge_keypoints(std::size_t t, Reading& reading, SegmentLinks& links) {
  PreparedFrame& frame = reading.frame;
  std::vector<CameraSegments> cameras;
  for (const CameraPerception& in : frame.perception) cameras.push_back({&in.panoptic});
  KeypointMotion::Evidence evidence =
      keypoints_->next_frame(sequence_.timestamps[t], reading.features, cameras, links);
  for (const CameraPerception& in : frame.perception) {
    frame.evidence.emplace_back(in.panoptic.segments.size());
  }
  for (std::size_t c = 0; classes_ && c < evidence.size(); ++c) overlap_->observe(c, evidence[c]);
  if (!waiting_.empty()) waiting_.back().evidence = std::move(evidence);
}

/// Where the frame's things are now: what did earlier frames see there? The longest span counts for
/// which enough pixels are known.
void FramePreparation::judge_space(std::size_t t, PreparedFrame& frame) {
  constexpr std::size_t kSpan = 4;  // frames
  for (std::size_t c = 0; c < frame.perception.size(); ++c) {
    const PanopticMap& panoptic = frame.perception[c].panoptic;
    std::vector<bool> things{false};
    for (const InputSegment& s : panoptic.segments) things.push_back(s.thing);
    std::vector<FreeSpaceEvidence>& out = frame.space.emplace_back(panoptic.segments.size());
    const std::size_t known = std::min(keypoints_->frames_back(), earlier_.size());
    for (std::size_t back = 1; back <= std::min(kSpan, known); ++back) {
      const std::vector<FreeSpaceEvidence> found =
          compare_space(sequence_.camera, keypoints_->T_before_last(back), c == 1,
                        frame.disparity[c], earlier_[back - 1][c], panoptic.runs, things);
      for (std::size_t k = 0; k < out.size(); ++k) {
        const FreeSpaceEvidence& e = found[k + 1];
        if (e.occupied + e.free == 0) continue;
        out[k] = e;
        out[k].span = sequence_.time_of(t) - sequence_.time_of(t - back);
      }
    }
  }
  earlier_.push_front(frame.disparity);
  if (earlier_.size() > kSpan) earlier_.pop_back();
}

/// Identities of the next frame's segments.
void FramePreparation::identify(std::size_t t, Reading& reading, const SegmentLinks& links) {
  FramePerception& perception = reading.frame.perception;
  std::size_t c = 0;  // the camera whose segments are too many
  try {
    if (overlap_) return identify_by_overlap(reading.frame, links, c);
    for (; c < perception.size(); ++c) {
      perception[c].instances = identify_by_centroid(c, perception[c].panoptic, reading.shapes[c]);
    }
  } catch (const InputError& error) {
    throw InputError(readers_[c].path_of(sequence_.names[t]).string() + ": " + error.what());
  }
}

/// Identities of the next frame's segments, both cameras together.
void FramePreparation::identify_by_overlap(PreparedFrame& frame, const SegmentLinks& links,
                                           std::size_t& camera) {
  FramePerception& perception = frame.perception;
  const DisparityPair& disparity = frame.disparity;
  std::vector<const PanopticMap*> maps;
  for (const CameraPerception& in : perception) maps.push_back(&in.panoptic);
  const auto identities = overlap_->next_frame(maps, links, camera);
  for (std::size_t c = 0; c < maps.size(); ++c) {
    if (classes_) overlap_->observe_depth(c, median_disparities(disparity[c], *maps[c]));
    for (std::size_t k = 0; classes_ && k < identities[c].size(); ++k) {
      InputSegment& segment = perception[c].panoptic.segments[k];
      if (segment.thing) segment.label = overlap_->label_of(identities[c][k]);
    }
    perception[c].instances = instances_of(c, *maps[c], identities[c]);
  }
}

/// Identities of the segments of one camera's next frame.
std::vector<std::int32_t> FramePreparation::identify_by_centroid(
    std::size_t c, const PanopticMap& panoptic, const std::vector<SegmentShape>& shapes) {
  std::vector<Detection> things;
  for (std::size_t k = 0; k < shapes.size(); ++k) {
    const InputSegment& s = panoptic.segments[k];
    if (s.thing) things.push_back({s.label, shapes[k].u, shapes[k].v});
  }
  const std::vector<std::int32_t> found = associators_[c].next_frame(things);
  std::vector<std::int32_t> identities;
  std::size_t next = 0;
  for (const InputSegment& s : panoptic.segments) identities.push_back(s.thing ? found[next++] : 0);
  return instances_of(c, panoptic, identities);
}

}  // namespace kys_slam
