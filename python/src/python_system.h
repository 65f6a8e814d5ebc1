// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/prior.h>
#include <kys_slam/prior_folder.h>
#include <kys_slam/rig_file.h>
#include <kys_slam/run_main.h>
#include <kys_slam/run_writer.h>
#include <kys_slam/system.h>
#include <nanobind/nanobind.h>

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "arrays.h"
#include "given_priors.h"
#include "observation_pipe.h"
#include "python_extractor.h"

namespace kys_slam {

/// One line of Python's logging, which goes to stderr unless the program says otherwise.
inline void warn(const std::string& message) {
  const nb::gil_scoped_acquire acquired;
  const nb::object logger = nb::module_::import_("logging").attr("getLogger")("kys_slam");
  logger.attr("warning")("%s", printable(message));
}

using MaybeArray = std::optional<AnyArray>;
using SegmentMap = nb::ndarray<const std::uint16_t, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

inline GrayImage mask_of(const MaybeArray& array, const char* what) {
  if (!array) return {};
  ImageView view = view_of(*array, what, false);
  view.bits = 8;  // of 16-bit numbers of instances none becomes 0
  return to_gray(view);
}

/// The writing thread takes the GIL to let go of a frame that Python owns, so nobody may wait for
/// that thread with the GIL.
class PythonPipe final : public ObservationPipe {
 public:
  using ObservationPipe::ObservationPipe;
  ~PythonPipe() override {
    const nb::gil_scoped_release released;
    stop();
  }
};

/// The system with what Python gives it.
class Slam {
 public:
  Slam(const StereoCamera& camera, const Settings& settings, const std::string& schedule,
       const std::optional<std::filesystem::path>& priors, bool strict_priors, nb::object features)
      : camera_(camera),
        settings_(settings),
        schedule_(parse_schedule(schedule)),
        features_(std::move(features)) {
    auto provider = std::make_unique<GivenPriors>();
    expected_ = expected_priors(camera, settings.get("control.label_space"));
    if (priors) {
      provider->folder = std::make_unique<PriorFolder>(*priors, expected_, strict_priors, warn);
    }
    priors_ = provider.get();
    std::unique_ptr<FeatureExtractor> extractor;
    if (!features_.is_none()) extractor = make_python_extractor(features_);
    const nb::gil_scoped_release released;
    system_ = std::make_unique<System>(camera, settings, schedule_, std::move(provider),
                                       std::move(extractor));
  }
  ~Slam() {
    const nb::gil_scoped_release released;  // the back end's thread is joined
    system_.reset();
  }

  /// The correction in the file, which is refused for another camera.
  void start_rig(const std::filesystem::path& file) {
    const nb::gil_scoped_release released;
    system_->start_rig(read_rig_correction(file, camera_));
  }

  FrameReport feed(const AnyArray& left, const AnyArray& right, double timestamp,
                   const std::string& name, const std::optional<nb::bytes>& segments,
                   const std::tuple<MaybeArray, MaybeArray>& masks, bool bgr,
                   std::optional<std::int64_t> index) {
    ImageView l = view_of(left, "left image", bgr), r = view_of(right, "right image", bgr);
    const auto frame = std::make_shared<StereoFrame>();
    frame->name = name;
    frame->timestamp = timestamp;
    std::optional<PriorFile> given = parse(segments);
    const auto bytes = bytes_of(segments);
    const nb::gil_scoped_release released;
    const std::lock_guard lock(mutex_);
    if (bits_ == 0) {  // the first pair of 16 bits decides for all
      bits_ = std::max(used_bits(l), used_bits(r));
      if (const std::string note = note_of_bits(bits_); !note.empty()) warn(note);
    }
    l.bits = r.bits = bits_;
    frame->left = to_gray(l);
    frame->right = to_gray(r);
    frame->index = index.value_or(fed_);
    return feed_locked(frame, std::move(given), bytes, masks);
  }

  FrameReport feed_frame(const std::shared_ptr<StereoFrame>& frame,
                         const std::optional<nb::bytes>& segments,
                         const std::tuple<MaybeArray, MaybeArray>& masks) {
    std::optional<PriorFile> given = parse(segments);
    const auto bytes = bytes_of(segments);
    const nb::gil_scoped_release released;
    const std::lock_guard lock(mutex_);
    return feed_locked(frame, std::move(given), bytes, masks);
  }

  /// \param segments (label, instance, flagged as moving, motion not judged) per segment
  void add_segments(
      std::int64_t frame, const std::optional<SegmentMap>& map,
      const std::vector<std::tuple<std::uint16_t, std::int32_t, bool, bool>>& segments) {
    std::shared_ptr<SegmentImage> image;
    if (map) {
      image = std::make_shared<SegmentImage>();
      image->map = ImageOf<std::uint16_t>::for_overwrite(static_cast<int>(map->shape(1)),
                                                         static_cast<int>(map->shape(0)));
      std::copy_n(map->data(), image->map.size(), image->map.data());
      for (const auto& [label, instance, moves, unjudged] : segments) {
        kys::Prior& prior = image->segments.emplace_back();
        prior = kys::make_prior(label, instance, 0, moves ? 100 : 0, moves);
        prior.unjudged = unjudged ? 1 : 0;
      }
    }
    const nb::gil_scoped_release released;
    system_->add_segments(frame, std::move(image));
  }
  void end_segments() {
    const nb::gil_scoped_release released;
    system_->end_segments();
  }

  void set_observer(nb::object callback) {
    has_callback_ = !callback.is_none();
    callback_ = std::move(callback);
    observe();
  }
  /// What is fed from now on goes into `pipe` as well.
  void add_pipe(std::shared_ptr<PythonPipe> pipe) {
    {
      const nb::gil_scoped_release released;
      const std::lock_guard lock(mutex_);
      pipes_.push_back(std::move(pipe));
    }
    observe();
  }
  void remove_pipe(const std::shared_ptr<PythonPipe>& pipe) {
    const nb::gil_scoped_release released;
    const std::lock_guard lock(mutex_);
    std::erase(pipes_, pipe);
  }
  /// For the garbage collector: an observer often refers to its system.
  [[nodiscard]] const nb::object& callback() const { return callback_; }
  [[nodiscard]] const nb::object& features() const { return features_; }
  void forget_callback() {
    callback_.reset();
    features_.reset();
  }

  nb::dict write_run(const std::filesystem::path& folder, RunInfo info) {
    info.missing_priors = priors_->missing();
    info.mode = settings_.get("kys.mode");
    RunOutcome outcome;
    std::string text;
    {
      const nb::gil_scoped_release released;
      outcome = summarise_run(*system_, info);
      kys_slam::write_run(folder, *system_, settings_, schedule_, info, outcome);
      text = describe_run(*system_, info, outcome);
    }
    nb::dict d;
    d["frames"] = outcome.trajectory.size();
    d["tracked"] = outcome.tracked;
    d["connected"] = outcome.connected.size();
    d["failure"] = describe_failure_to_track(*system_, outcome);
    d["loops"] = outcome.loops;
    d["table"] = text;
    return d;
  }

  std::vector<FrameReport> reports() {
    const std::lock_guard lock(mutex_);
    return system_->reports();
  }
  System& system() { return *system_; }
  const Settings& settings() const { return settings_; }

 private:
  std::optional<PriorFile> parse(const std::optional<nb::bytes>& segments) const {
    if (!segments) return std::nullopt;
    const auto* begin = static_cast<const std::uint8_t*>(segments->data());
    return PriorFile::parse({begin, begin + segments->size()}, "segments", expected_);
  }

  static std::span<const std::uint8_t> bytes_of(const std::optional<nb::bytes>& segments) {
    if (!segments) return {};
    return {static_cast<const std::uint8_t*>(segments->data()), segments->size()};
  }

  FrameReport feed_locked(const std::shared_ptr<StereoFrame>& frame, std::optional<PriorFile> given,
                          std::span<const std::uint8_t> segments,
                          const std::tuple<MaybeArray, MaybeArray>& masks) {
    priors_->given = std::move(given);
    left_ = std::shared_ptr<const GrayImage>(frame, &frame->left);
    segments_ = segments;
    const std::int64_t before = fed_;
    FrameReport report = system_->feed(*frame, {mask_of(std::get<0>(masks), "left mask"),
                                                mask_of(std::get<1>(masks), "right mask")});
    left_.reset();
    if (fed_ == before) ++fed_;  // with an observer it is counted already
    return report;
  }

  /// Has the system tell pipes and callback, as far as there are any.
  void observe() {
    const nb::gil_scoped_release released;
    const std::lock_guard lock(mutex_);
    if (pipes_.empty() && !has_callback_) {
      system_->set_observer({});
      return;
    }
    system_->set_observer([this](const FrameObservation& seen) {  // called with the lock
      ++fed_;  // first: the system has the frame, also when the callback raises
      for (const auto& pipe : pipes_) pipe->put(seen, left_, segments_);
      if (!has_callback_) return;
      const nb::gil_scoped_acquire acquired;
      const nb::object callback = callback_;  // it may put another one in its place
      if (callback.is_valid() && !callback.is_none()) callback(observation(seen));
    });
  }

  static nb::dict observation(const FrameObservation& seen) {
    const auto& keypoints = seen.keypoints;
    const std::size_t n = keypoints.size();
    std::vector<float> pixels;
    for (const Keypoint& k : keypoints) pixels.insert(pixels.end(), {k.x, k.y});
    nb::dict d;
    d["report"] = nb::cast(*seen.report);
    d["keypoints"] = to_numpy(std::move(pixels), {n, 2});
    d["octaves"] = column<std::uint8_t>(keypoints, [](const Keypoint& k) { return k.octave; });
    d["depths"] = column<float>(seen.depths, [](float z) { return z; });
    d["landmarks"] = column<std::int64_t>(seen.landmarks, [](std::int64_t id) { return id; });
    if (seen.priors.empty()) {
      d["labels"] = nb::none();
      d["instances"] = nb::none();
      d["motions"] = nb::none();
    } else {
      d["labels"] = column<std::uint16_t>(seen.priors, [](const kys::Prior& p) { return p.label; });
      d["instances"] =
          column<std::int32_t>(seen.priors, [](const kys::Prior& p) { return p.instance; });
      d["motions"] = column<float>(seen.priors, [](const kys::Prior& p) { return p.motion; });
    }
    d["tiers"] = column<std::uint8_t>(seen.tiers, [](kys::Tier t) { return t; });
    nb::list instances;
    for (const ObservedInstance& i : seen.instances) {
      instances.append(nb::make_tuple(i.instance, i.label, i.p_moving, i.keypoints));
    }
    d["instances_seen"] = instances;
    return d;
  }

  StereoCamera camera_;
  Settings settings_;
  Schedule schedule_;
  ExpectedPriors expected_;
  nb::object features_;            // the extractor of the system, or None
  GivenPriors* priors_ = nullptr;  // the system's
  std::recursive_mutex mutex_;     // of feeding and of what follows; an observer may come back here
  std::int64_t fed_ = 0;
  int bits_ = 0;  // of 16-bit images, 0: not known yet
  std::vector<std::shared_ptr<PythonPipe>> pipes_;
  std::shared_ptr<const GrayImage> left_;   // of the frame being fed
  std::span<const std::uint8_t> segments_;  // given with it
  nb::object callback_;                     // read and written with the GIL
  std::atomic<bool> has_callback_ = false;
  std::unique_ptr<System> system_;
};

}  // namespace kys_slam
