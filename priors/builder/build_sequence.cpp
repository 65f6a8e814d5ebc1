// SPDX-License-Identifier: BSD-3-Clause
#include "priors/builder/build_sequence.h"

#include <kys_slam/calibration_hash.h>
#include <kys_slam/error.h>
#include <kys_slam/prior_format.h>
#include <kys_slam/util/atomic_file.h>
#include <kys_slam/util/stopwatch.h>

#include <algorithm>
#include <deque>
#include <mutex>
#include <optional>
#include <utility>

#include "priors/builder/content_key.h"
#include "priors/builder/debug_image.h"
#include "priors/builder/for_each_index.h"
#include "priors/builder/frame_preparation.h"
#include "priors/builder/frame_rows.h"
#include "priors/builder/motion_belief.h"
#include "priors/builder/prior_output.h"
#include "priors/builder/sequence_fields.h"
#include "priors/fusion/fuse.h"

namespace kys_slam {
namespace {

std::vector<PanopticReader> open_readers(const BuildInputs& inputs, const kys::LabelSpace& labels) {
  std::vector<PanopticReader> readers;
  for (const std::filesystem::path& folder : inputs.panoptic) {
    if (!folder.empty()) readers.emplace_back(folder, labels, inputs.panoptic_encoding);
  }
  if (inputs.panoptic[0].empty()) throw InputError("the left camera's segmentation is missing");
  return readers;
}

/// A frame between its measurement and its file.
struct Measured {
  std::uint64_t key = 0;
  std::optional<InstanceEvidence> kept;  // its files are there
  ImagePair now;                         // for pictures
  std::vector<MeasuredCamera> cameras;
  std::vector<FusionImages> images;
  BuildTimes times;
};

struct Things {
  std::vector<CameraFusion*> cameras;
  std::vector<const std::vector<std::int32_t>*> instances;
};

Things things_of(Measured& measured) {
  Things things;
  for (MeasuredCamera& camera : measured.cameras) {
    things.cameras.push_back(&camera.fusion);
    things.instances.push_back(&camera.input.instances);
  }
  return things;
}

class SequenceBuilder {
 public:
  SequenceBuilder(const BuildSequence& sequence, const kys::LabelSpace& labels,
                  const BuildInputs& inputs, const BuildSettings& settings)
      : sequence_(sequence),
        labels_(labels),
        inputs_(inputs),
        settings_(settings),
        readers_(open_readers(inputs, labels)),
        fields_(sequence, inputs, settings.options),
        content_keys_(sequence, labels, inputs, settings.options, readers_),
        preparation_(sequence, labels, inputs, settings.options, readers_, fields_, settings.jobs),
        output_(settings.output, sequence.names, settings.debug_images) {
    if (settings.options.detection.method == DetectionMethod::kRobust) {
      belief_.emplace(settings.options.detection, preparation_.shares_identities());
    }
  }

  BuildSummary run() {
    output_.make_folders();
    summary_.frames = frames();
    const std::size_t step = 4 * static_cast<std::size_t>(settings_.jobs);
    for (std::size_t t = 0; t < frames(); t += step) build_frames(t, std::min(t + step, frames()));
    for (std::size_t c = 0; c < readers_.size(); ++c) {
      summary_.tracks[c] = preparation_.identities_given(c);
    }
    summary_.times += preparation_.times();
    const double pixels = static_cast<double>(frames() * readers_.size()) * sequence_.camera.width *
                          sequence_.camera.height;
    output_.count_segments(pixels, summary_);
    output_.write_tables(settings_.options, summary_);
    return summary_;
  }

 private:
  [[nodiscard]] std::size_t frames() const { return sequence_.names.size(); }

  /// Measures frames from begin to end, and writes those that are decided then. Identities and
  /// keypoints need frames in order, keypoints one frame more, belief `lag` frames more.
  void build_frames(std::size_t begin, std::size_t end) {
    const std::size_t lag = belief_ ? static_cast<std::size_t>(settings_.options.detection.lag) : 0;
    const std::size_t more = std::max<std::size_t>(lag, inputs_.keypoints ? 1 : 0);
    preparation_.prepare(std::min(end + more, frames()));
    add_keys(begin, std::min(end + lag, frames()));
    std::vector<PreparedFrame> batch;
    for (std::size_t t = begin; t < end; ++t) batch.push_back(preparation_.take());
    const std::size_t waiting = measured_.size();
    for (std::size_t t = begin; t < end; ++t) {
      measured_.emplace_back().key =
          belief_ ? key_with_later(sequence_.names[t], keys_[std::min(t + lag, frames() - 1)])
                  : keys_[t];
    }
    for_each_index(end - begin, settings_.jobs, [&](std::size_t i) {
      measure_frame(begin + i, std::move(batch[i]), measured_[waiting + i]);
    });
    for (std::size_t i = 0; belief_ && i < end - begin; ++i) {
      add_to_belief(begin + i, measured_[waiting + i]);
      if (begin + i >= lag) decide(measured_[begin + i - lag - written_]);
    }
    const std::size_t ready = end == frames() ? end : std::max(end, lag) - lag;
    for (std::size_t t = std::max(end, lag) - lag; belief_ && t < ready; ++t) {
      decide(measured_[t - written_]);
    }
    for_each_index(std::max(ready, written_) - written_, settings_.jobs, [&](std::size_t i) {
      write_frame(written_ + i, std::move(measured_[i]));
      const std::lock_guard lock(mutex_);
      ++done_;
      if (settings_.progress) settings_.progress("priors", done_, frames());
    });
    for (; written_ < ready; ++written_) measured_.pop_front();
  }

  /// Keys of the frames before `end`. The earliest frame that is not taken is `begin`.
  void add_keys(std::size_t begin, std::size_t end) {
    for (std::size_t t = keys_.size(); t < end; ++t) {
      const std::uint64_t before = belief_ && t > 0 ? keys_.back() : 0;
      const FramePerception& perception = preparation_.waiting()[t - begin].perception;
      keys_.push_back(content_keys_.of_frame(t, perception, before));
    }
  }

  [[nodiscard]] bool needs_images() const {
    return settings_.debug_images || reads_images(inputs_, settings_.options);
  }

  void measure_frame(std::size_t t, PreparedFrame prepared, Measured& out) {
    if (!settings_.rebuild) out.kept = output_.kept_evidence(t, out.key);
    if (out.kept) return;
    ImagePair next;
    if (needs_images()) out.now = sequence_.read(t);
    if (needs_images() && t + 1 < frames()) next = sequence_.read(t + 1);
    DisparityPair disparity = std::move(prepared.disparity);
    if (disparity[0].empty()) {
      Stopwatch watch;
      disparity = fields_.disparities(t, out.now);
      out.times.stereo = watch.lap_ms();
      fields_.complete(disparity, prepared.perception);
      out.times.depth = watch.lap_ms();
    }
    for (std::size_t c = 0; c < prepared.perception.size(); ++c) {
      CameraPerception& in = prepared.perception[c];
      const GrayImage& image = c == 0 ? out.now.first : out.now.second;
      const GrayImage& next_image = c == 0 ? next.first : next.second;
      in.disparity = std::move(disparity[c]);
      const Stopwatch watch;
      in.flow = fields_.flow(c, t, in, image, next_image);
      out.times.flow += watch.elapsed_ms();
      if (!next_image.empty()) {
        in.now = &image;
        in.next = &next_image;
      }
      FusionImages images;
      MeasuredCamera measured = measure_camera(settings_.options, sequence_.camera, std::move(in),
                                               settings_.debug_images ? &images : nullptr);
      for (std::size_t k = 0; k < measured.fusion.statistics.size() && inputs_.keypoints; ++k) {
        measured.fusion.statistics[k].keypoints = prepared.evidence[c][k];
        if (!prepared.space.empty()) measured.fusion.statistics[k].space = prepared.space[c][k];
      }
      if (!belief_) decide_segments(settings_.options, measured.fusion);
      out.cameras.push_back(std::move(measured));
      if (settings_.debug_images) out.images.push_back(std::move(images));
    }
    if (!settings_.debug_images) out.now = {};
  }

  /// Belief over time goes through the frames in order.
  void add_to_belief(std::size_t t, Measured& measured) {
    const double time = sequence_.time_of(t);
    if (measured.kept) return belief_->restore_frame(time, *measured.kept);
    const Things things = things_of(measured);
    belief_->add_frame(time, things.cameras, things.instances);
  }

  void decide(Measured& measured) {
    const Things things = things_of(measured);
    belief_->decide(things.cameras, things.instances);
  }

  void write_frame(std::size_t t, Measured measured) {
    if (measured.kept) {
      const std::lock_guard lock(mutex_);
      ++summary_.kept;
      return;
    }
    FramePriors priors;
    priors.label_space = labels_.name();
    priors.calibration_hash = calibration_hash(sequence_.camera);
    priors.content_key = measured.key;
    priors.shares_instances = preparation_.shares_identities();
    std::string rows;
    BuildTimes& times = measured.times;
    for (std::size_t c = 0; c < measured.cameras.size(); ++c) {
      const CameraFusion fusion = export_camera(settings_.options, std::move(measured.cameras[c]));
      if (settings_.debug_images) {
        write_png(output_.picture_of(t, c),
                  draw_stages(c == 0 ? measured.now.first : measured.now.second, fusion,
                              measured.images[c]));
      }
      priors.has_motion = priors.has_motion || fusion.ego_motion.has_value() ||
                          std::any_of(fusion.decisions.begin(), fusion.decisions.end(),
                                      [](const MotionDecision& d) { return d.judged; });
      rows += table_rows(sequence_.names[t], c, fusion);
      times.fusion += fusion.times;
      priors.cameras.push_back(fusion.priors);
    }
    MotionCoding coding;
    coding.tolerance_steps = settings_.options.exported.motion_tolerance_steps;
    const Stopwatch watch;
    const std::vector<std::uint8_t> bytes =
        encode_priors(priors, output_.file_of(t).string(), coding);
    times.encoding = watch.elapsed_ms();
    write_file_atomic(output_.rows_of(t), pack_rows(measured.key, rows), Durable::kNo);
    write_file_atomic(output_.file_of(t), bytes, Durable::kNo);
    const std::lock_guard lock(mutex_);
    ++summary_.built;
    summary_.times += times;
  }

  const BuildSequence& sequence_;
  const kys::LabelSpace& labels_;
  const BuildInputs& inputs_;
  const BuildSettings& settings_;
  std::vector<PanopticReader> readers_;
  SequenceFields fields_;
  ContentKeys content_keys_;
  FramePreparation preparation_;
  PriorOutput output_;
  std::optional<MotionBelief> belief_;
  std::vector<std::uint64_t> keys_;  ///< of frames, without what comes after them
  std::deque<Measured> measured_;    ///< frames that are not written, from `written_` on
  std::size_t written_ = 0;          ///< frames
  std::mutex mutex_;                 ///< of what follows, while frames are built
  BuildSummary summary_;
  std::size_t done_ = 0;  ///< frames
};

}  // namespace

void check_build(const BuildSequence& sequence, const BuildInputs& inputs,
                 const BuildSettings& settings) {
  settings.options.check();
  if (sequence.names.empty()) throw InputError("the sequence has no frames");
  if (inputs.keypoints && settings.options.detection.method != DetectionMethod::kRobust) {
    throw InputError("keypoints judge with detection.method robust only");
  }
  if (inputs.keypoints && sequence.timestamps.size() != sequence.names.size()) {
    throw InputError("keypoints need a time stamp of every frame");
  }
}

BuildSummary build_sequence_priors(const BuildSequence& sequence, const kys::LabelSpace& labels,
                                   const BuildInputs& inputs, const BuildSettings& settings) {
  check_build(sequence, inputs, settings);
  return SequenceBuilder(sequence, labels, inputs, settings).run();
}

}  // namespace kys_slam
