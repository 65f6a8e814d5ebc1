#include "priors/builder/build_sequence.h"

#include <kys/belief.h>
#include <kys_slam/calibration_hash.h>
#include <kys_slam/error.h>
#include <kys_slam/prior_format.h>
#include <kys_slam/run_main.h>
#include <kys_slam/util/atomic_file.h>
#include <kys_slam/util/hash.h>
#include <kys_slam/util/parse_number.h>
#include <kys_slam/util/read_bytes.h>
#include <kys_slam/util/stopwatch.h>

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <cstring>
#include <deque>
#include <exception>
#include <fstream>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <sstream>
#include <thread>

#include "priors/builder/association.h"
#include "priors/builder/debug_image.h"
#include "priors/builder/estimators.h"
#include "priors/builder/free_space.h"
#include "priors/builder/fuse.h"
#include "priors/builder/keypoint_motion.h"
#include "priors/builder/motion_belief.h"
#include "priors/builder/seeded_flow.h"

namespace kys_slam {
namespace {

namespace fs = std::filesystem;
constexpr const char* kSegmentsHeader =
    "frame,camera,input_id,identity,label,area_px,mean_depth_m,residual_px,radial_px,coverage,"
    "omega,magnitude_test,radial_test,rho,m,valid,median_px,coherent_px,scatter_px,parallax_px,"
    "disparity_px,keypoints,keypoint_inliers,keypoint_log_ratio,keypoint_span_s,"
    "keypoint_shift_m,keypoint_shift_px,patches,flow_patches,still_alike,flow_alike,"
    "place_occupied,place_free,place_hidden,place_span_s,"
    "evidence_flow,evidence_appearance,evidence_keypoints,evidence_space,evidence,state,log_odds\n";
constexpr const char* kBackgroundHeader =
    "frame,camera,model,samples,fit_residual_px,m_bg_px,mu_par_px,sigma_par_px,stuff_px,"
    "p1,p2,p3,p4,p5,p6,p7,p8\n";

/// The rows of a frame in the folder .rows, from which a later run goes on without its images: a
/// line with the content key of the prior file and the checksum of the rows, then the rows.
std::string pack_rows(std::uint64_t key, const std::string& rows) {
  char line[64];
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(rows.data());
  std::snprintf(line, sizeof line, "%016llx %08x\n", static_cast<unsigned long long>(key),
                static_cast<unsigned>(prior_format::crc32(bytes, rows.size())));
  return line + rows;
}

/// The rows of such a file; nothing when they are not those of the key, or damaged.
std::optional<std::string> unpack_rows(const fs::path& path, std::uint64_t key) {
  const std::string text = read_text(path);
  const std::size_t end = text.find('\n');
  if (end == std::string::npos) return std::nullopt;
  std::string rows = text.substr(end + 1);
  if (pack_rows(key, rows) != text) return std::nullopt;
  return rows;
}

using Evidence = std::vector<std::pair<std::int32_t, double>>;  // by instance

/// Instances and evidence in the rows of a frame. Fields are counted from the end: a name may have
/// commas in it. Nothing when a row is not as it is written.
std::optional<Evidence> evidence_of(const std::string& rows) {
  static const auto kFields = static_cast<std::size_t>(
      std::count(kSegmentsHeader, kSegmentsHeader + std::strlen(kSegmentsHeader), ',') + 1);
  Evidence evidence;
  std::istringstream lines(rows);
  for (std::string row; std::getline(lines, row);) {
    if (row.empty() || row[0] != 'S') continue;
    std::vector<std::string> fields;
    std::istringstream in(row);
    for (std::string field; std::getline(in, field, ',');) fields.push_back(field);
    if (fields.size() < kFields) return std::nullopt;
    const auto instance = parse_int(fields[fields.size() - kFields + 3]);
    const auto nats = parse_double(fields[fields.size() - 3]);
    constexpr std::int64_t kMost = std::numeric_limits<std::int32_t>::max();
    if (!instance || *instance < 0 || *instance > kMost || !nats) return std::nullopt;
    evidence.emplace_back(static_cast<std::int32_t>(*instance), *nats);
  }
  return evidence;
}

/// Runs function(i) for i in 0..count-1 on `jobs` threads. Of several failures the one of the
/// lowest i is thrown, after all threads have stopped.
template <typename Function>
void for_each_index(std::size_t count, int jobs, Function&& function) {
  std::atomic<std::size_t> next{0};
  std::mutex mutex;
  std::size_t failed_at = count;
  std::exception_ptr failure;
  const auto work = [&] {
    for (std::size_t i = next++; i < count; i = next++) {
      try {
        function(i);
      } catch (...) {
        const std::lock_guard lock(mutex);
        if (i < failed_at) {
          failed_at = i;
          failure = std::current_exception();
        }
        next = count;
      }
    }
  };
  {
    std::vector<std::jthread> threads;
    for (int j = 1; j < jobs; ++j) threads.emplace_back(work);
    work();
  }
  if (failure) std::rethrow_exception(failure);
}

/// Hash of texts: what a prior file was made from.
class Digest {
 public:
  void add(const std::string& text) {
    hash_.add(text);
    hash_.add(std::uint8_t{0xFF});
  }
  void add_file(const fs::path& path) {
    std::error_code error;
    const auto size = fs::file_size(path, error);
    const auto time = fs::last_write_time(path, error);
    add(path.string() + " " + std::to_string(size) + " " +
        std::to_string(time.time_since_epoch().count()));
  }
  [[nodiscard]] std::uint64_t value() const { return hash_.value() == 0 ? 1 : hash_.value(); }

 private:
  Fnv1a hash_;
};

class SequenceBuilder {
 public:
  SequenceBuilder(const BuildSequence& sequence, const kys::LabelSpace& labels,
                  const BuildInputs& inputs, const BuildSettings& settings)
      : sequence_(sequence), labels_(labels), inputs_(inputs), settings_(settings) {
    for (const kys::LabelClass& c : labels.classes()) {
      classes_.add(std::to_string(c.id) + (c.thing ? " thing " : " stuff ") + c.name);
    }
    for (std::size_t c = 0; c < 2; ++c) {
      if (inputs.panoptic[c].empty()) continue;
      readers_.emplace_back(inputs.panoptic[c], labels, inputs.panoptic_encoding);
    }
    if (inputs.panoptic[0].empty()) throw InputError("the left camera's segmentation is missing");
    if (inputs.keypoints) {
      keypoints_ = std::make_unique<KeypointMotion>(sequence.camera, settings.options.keypoints);
    }
    if (settings.options.association.method == AssociationMethod::kOverlap) {
      std::vector<bool> pooled;
      for (const kys::LabelClass& c : labels.classes()) {
        pooled.push_back(kys::mobility(c) == kys::Mobility::kMobile);
      }
      overlap_.emplace(settings.options.association, std::move(pooled));
    }
    if (settings.options.detection.method == DetectionMethod::kRobust) {
      belief_.emplace(settings.options.detection);
    }
    associators_.assign(readers_.size(), InstanceAssociator(settings.options.association));
  }

  BuildSummary run() {
    make_output_folder(settings_.output);
    make_output_folder(settings_.output / ".rows");
    if (settings_.debug_images) make_output_folder(settings_.output / "debug");
    summary_.frames = frames();
    const std::size_t step = 4 * static_cast<std::size_t>(settings_.jobs);
    for (std::size_t t = 0; t < frames(); t += step) build_frames(t, std::min(t + step, frames()));
    for (std::size_t c = 0; c < readers_.size(); ++c) {
      summary_.tracks[c] =
          overlap_ ? overlap_->identities_given() : associators_[c].identities_given();
    }
    write_tables();
    return summary_;
  }

 private:
  [[nodiscard]] std::size_t frames() const { return sequence_.names.size(); }

  /// The left and the right camera at one frame; flow and depth come later.
  using FramePerception = std::vector<CameraPerception>;
  using FrameEvidence = std::vector<std::vector<KeypointEvidence>>;  // by camera and segment

  /// A frame before it is fused.
  struct Prepared {
    FramePerception perception;
    std::vector<std::vector<SegmentShape>> shapes;  // by camera
    std::shared_ptr<const FrameFeatures> features;  // null: keypoints are not asked for
    FrameEvidence evidence;  // of the frame with those before it; then with the next one
    std::vector<std::vector<FreeSpaceEvidence>> space;  // by camera and segment; or empty
    std::array<ImageOf<float>, 2> disparity;  // px, checked; where it was needed for identities
    SegmentLinks::Votes by_disparity;
  };

  using Pair = std::pair<GrayImage, GrayImage>;

  /// A frame between its measurement and its file.
  struct Measured {
    std::uint64_t key = 0;
    std::optional<Evidence> kept;  // its files are there
    Pair now;                      // for pictures
    std::vector<MeasuredCamera> cameras;
    std::vector<FusionImages> images;
    BuildTimes times;
  };

  /// Measures frames from begin to end, and writes those that are decided then. Identities and
  /// keypoints need frames in order, keypoints one frame more, belief `lag` frames more.
  void build_frames(std::size_t begin, std::size_t end) {
    const std::size_t lag = belief_ ? static_cast<std::size_t>(settings_.options.detection.lag) : 0;
    prepare(std::min(end + std::max<std::size_t>(lag, inputs_.keypoints ? 1 : 0), frames()));
    for (; keyed_ < std::min(end + lag, frames()); ++keyed_) {
      keys_.push_back(content_key(keyed_, prepared_[keyed_ - begin].perception));
      if (belief_) chain_ = keys_.back();
    }
    std::vector<Prepared> batch;
    for (std::size_t t = begin; t < end; ++t) {
      batch.push_back(std::move(prepared_.front()));
      prepared_.pop_front();
    }
    const std::size_t waiting = measured_.size();
    for (std::size_t t = begin; t < end; ++t) {
      measured_.emplace_back().key = belief_ ? key_with_later(t, lag) : keys_[t];
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

  /// Key of a frame whose decision depends on later ones: the key of the last of them covers all
  /// that come before it.
  [[nodiscard]] std::uint64_t key_with_later(std::size_t t, std::size_t lag) const {
    Digest digest;
    digest.add(sequence_.names[t]);
    digest.add(std::to_string(keys_[std::min(t + lag, frames() - 1)]));
    return digest.value();
  }

  /// Reads frames up to `end` and gives their segments identities.
  void prepare(std::size_t end) {
    const std::size_t begin = read_;
    if (end <= begin) return;
    std::vector<Prepared> batch(end - begin);
    for_each_index(end - begin, settings_.jobs, [&](std::size_t i) {
      for (const PanopticReader& reader : readers_) {
        CameraPerception& in = batch[i].perception.emplace_back();
        in.panoptic = reader.read(sequence_.names[begin + i], sequence_.camera.width,
                                  sequence_.camera.height);
        const Stopwatch watch;
        batch[i].shapes.push_back(segment_shapes(in.panoptic.runs, in.panoptic.segments.size()));
        add_time(&BuildTimes::association, watch.elapsed_ms());
      }
      const bool linked = needs_early_disparity();
      Pair pair;
      if (keypoints_ || (linked && inputs_.disparity == "sgbm")) pair = sequence_.read(begin + i);
      if (keypoints_) {
        const Stopwatch watch;
        batch[i].features = keypoints_->extract(pair.first, pair.second);
        add_time(&BuildTimes::keypoints, watch.elapsed_ms());
      }
      if (linked) read_disparity_early(begin + i, pair, batch[i]);
    });
    for (Prepared& frame : batch) {
      SegmentLinks links;
      links.by_disparity = std::move(frame.by_disparity);
      Stopwatch watch;
      if (keypoints_) judge_keypoints(read_, frame, links);
      if (keypoints_ && needs_early_disparity()) judge_space(read_, frame);
      add_time(&BuildTimes::keypoints, watch.lap_ms());
      identify(read_, frame, links);
      add_time(&BuildTimes::association, watch.lap_ms());
      frame.features.reset();
      prepared_.push_back(std::move(frame));
      ++read_;
    }
  }

  /// Disparities are needed before frames are measured.
  [[nodiscard]] bool needs_early_disparity() const {
    return overlap_ && readers_.size() == 2 && !inputs_.disparity.empty();
  }

  /// Where the frame's things are now: what did earlier frames see there? The longest span counts
  /// for which enough pixels are known.
  void judge_space(std::size_t t, Prepared& frame) {
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
          out[k].span = time_of(t) - time_of(t - back);
        }
      }
    }
    earlier_.push_front(frame.disparity);
    if (earlier_.size() > kSpan) earlier_.pop_back();
  }

  void read_disparity_early(std::size_t t, const Pair& pair, Prepared& frame) {
    Stopwatch watch;
    frame.disparity = disparities(t, pair);
    add_time(&BuildTimes::stereo, watch.lap_ms());
    complete(frame.disparity, frame.perception);
    add_time(&BuildTimes::depth, watch.lap_ms());
    frame.by_disparity = links_by_disparity(frame.perception[0].panoptic,
                                            frame.perception[1].panoptic, frame.disparity[0]);
    add_time(&BuildTimes::association, watch.lap_ms());
  }

  /// What a frame's keypoints say about the segments of the frame before.
  void judge_keypoints(std::size_t t, Prepared& frame, SegmentLinks& links) {
    std::vector<CameraSegments> cameras;
    for (const CameraPerception& in : frame.perception) cameras.push_back({&in.panoptic});
    FrameEvidence evidence =
        keypoints_->next_frame(sequence_.timestamps[t], frame.features, cameras, links);
    for (const CameraPerception& in : frame.perception) {
      frame.evidence.emplace_back(in.panoptic.segments.size());
    }
    if (!prepared_.empty()) prepared_.back().evidence = std::move(evidence);
  }

  void add_time(double BuildTimes::*stage, double ms) {
    const std::lock_guard lock(mutex_);
    summary_.times.*stage += ms;
  }

  /// Numbers of segments as they go into the file. Stuff has one per class, below those of things.
  static std::vector<std::int32_t> instances_of(std::size_t c, const PanopticMap& panoptic,
                                                const std::vector<std::int32_t>& identities) {
    const std::int32_t base = c == 0 ? 0 : prior_format::kRightInstances;
    std::vector<std::int32_t> instances;
    for (std::size_t k = 0; k < panoptic.segments.size(); ++k) {
      const InputSegment& s = panoptic.segments[k];
      instances.push_back(base + (s.thing ? 65536 + identities[k] : s.label));
    }
    return instances;
  }

  /// Identities of the next frame's segments.
  void identify(std::size_t t, Prepared& frame, const SegmentLinks& links) {
    std::size_t c = 0;  // the camera whose segments are too many
    try {
      if (overlap_) return identify(frame, links, c);
      for (; c < readers_.size(); ++c) {
        CameraPerception& in = frame.perception[c];
        in.instances = identify(c, in.panoptic, frame.shapes[c]);
      }
    } catch (const InputError& error) {
      throw InputError(readers_[c].path_of(sequence_.names[t]).string() + ": " + error.what());
    }
  }

  /// Identities of the next frame's segments, both cameras together.
  void identify(Prepared& frame, const SegmentLinks& links, std::size_t& camera) {
    std::vector<const PanopticMap*> maps;
    for (const CameraPerception& in : frame.perception) maps.push_back(&in.panoptic);
    const auto identities = overlap_->next_frame(maps, links, camera);
    for (std::size_t c = 0; c < maps.size(); ++c) {
      frame.perception[c].instances = instances_of(c, *maps[c], identities[c]);
    }
  }

  /// Identities of the segments of one camera's next frame.
  std::vector<std::int32_t> identify(std::size_t c, const PanopticMap& panoptic,
                                     const std::vector<SegmentShape>& shapes) {
    std::vector<Detection> things;
    for (std::size_t k = 0; k < shapes.size(); ++k) {
      const InputSegment& s = panoptic.segments[k];
      if (s.thing) things.push_back({s.label, shapes[k].u, shapes[k].v});
    }
    const std::vector<std::int32_t> found = associators_[c].next_frame(things);
    std::vector<std::int32_t> identities;
    std::size_t next = 0;
    for (const InputSegment& s : panoptic.segments)
      identities.push_back(s.thing ? found[next++] : 0);
    return instances_of(c, panoptic, identities);
  }

  [[nodiscard]] bool needs_images() const {
    return inputs_.disparity == "sgbm" || inputs_.flow[0] == "dis" || inputs_.flow[1] == "dis" ||
           settings_.debug_images || settings_.options.detection.method == DetectionMethod::kRobust;
  }

  [[nodiscard]] fs::path back_flow(const std::string& folder, std::size_t t) const {
    return find_back_flow(folder, sequence_.names[t], sequence_.names[t + 1]);
  }

  /// Digest of everything the file of frame t depends on.
  [[nodiscard]] std::uint64_t content_key(std::size_t t, const FramePerception& perception) const {
    const std::string& name = sequence_.names[t];
    Digest digest;
    digest.add(inputs_.keypoints ? "keypoints" : "");
    digest.add(std::to_string(chain_));
    digest.add("kysp builder 10\n" + to_text(settings_.options) + labels_.name());
    digest.add(std::to_string(classes_.value()));
    digest.add(std::to_string(calibration_hash(sequence_.camera)));
    digest.add(t + 1 < frames() ? sequence_.names[t + 1] : "last");
    digest.add(std::to_string(static_cast<int>(inputs_.disparity_encoding)) +
               std::to_string(static_cast<int>(inputs_.flow_encoding)));
    for (std::size_t c = 0; c < readers_.size(); ++c) {
      digest.add_file(readers_[c].path_of(name));
      const fs::path classes = readers_[c].class_path_of(name);
      if (!classes.empty()) digest.add_file(classes);
      for (const std::int32_t i : perception[c].instances) digest.add(std::to_string(i));
      // The classes of COCO segments are in a file for all frames.
      for (const InputSegment& s : perception[c].panoptic.segments) {
        digest.add(std::to_string(s.input_id) + " " + std::to_string(s.label) +
                   (s.thing ? " thing" : " stuff"));
      }
    }
    const auto add_source = [&](const std::string& source, auto&& find) {
      const bool folder = !source.empty() && source != "sgbm" && source != "dis";
      if (folder) digest.add_file(find(source, name));
      digest.add(source);
    };
    add_source(inputs_.disparity, find_disparity);
    add_source(inputs_.disparity_right, find_disparity);
    if (t + 1 < frames()) {
      for (const std::string& source : inputs_.flow) add_source(source, find_flow);
      for (const std::string& source : inputs_.flow_back) {
        if (!source.empty()) digest.add_file(back_flow(source, t));
        digest.add(source);
      }
    }
    return digest.value();
  }

  /// The evidence of a frame whose files are there and made from the same; else nothing.
  [[nodiscard]] std::optional<Evidence> kept_evidence(std::size_t t, std::uint64_t key) const {
    const fs::path file = file_of(t);
    std::error_code error;
    if (settings_.rebuild || !fs::exists(file, error) || !fs::exists(rows_of(t), error)) return {};
    if (settings_.debug_images &&
        !fs::exists(settings_.output / "debug" / (file.stem().string() + "_left.png"), error)) {
      return {};
    }
    try {
      if (PriorFile::open(file).content_key() != key) return {};
      const std::optional<std::string> rows = unpack_rows(rows_of(t), key);
      return rows ? evidence_of(*rows) : std::nullopt;
    } catch (const InputError&) {
      return {};
    }
  }

  void check_size(const fs::path& path, const ImageOf<float>& field) const {
    if (field.width() == sequence_.camera.width && field.height() == sequence_.camera.height) {
      return;
    }
    throw InputError(path.string() + ": is " + std::to_string(field.width()) + "x" +
                     std::to_string(field.height()) + ", the sequence has " +
                     std::to_string(sequence_.camera.width) + "x" +
                     std::to_string(sequence_.camera.height));
  }

  /// Disparity (px) of both views; of the right one only where it is read or estimated.
  [[nodiscard]] std::array<ImageOf<float>, 2> disparities(std::size_t t, const Pair& now) const {
    std::array<ImageOf<float>, 2> d;
    if (inputs_.disparity.empty()) return d;
    if (inputs_.disparity == "sgbm") {
      return {estimate_disparity(now.first, now.second, false),
              estimate_disparity(now.first, now.second, true)};
    }
    const auto read = [&](const std::string& folder) {
      const fs::path path = find_disparity(folder, sequence_.names[t]);
      ImageOf<float> field =
          read_disparity(path, inputs_.disparity_encoding, sequence_.camera.bf());
      check_size(path, field);
      return field;
    };
    d[0] = read(inputs_.disparity);
    if (!inputs_.disparity_right.empty()) d[1] = read(inputs_.disparity_right);
    return d;
  }

  [[nodiscard]] ImageOf<float> warp(const ImageOf<float>& left, const FramePerception& in) const {
    if (!settings_.options.depth.match_labels) return warp_disparity_to_right(left);
    const ClassImage left_classes = class_image(in[0].panoptic);
    const ClassImage right_classes = class_image(in[1].panoptic);
    return warp_disparity_to_right(left, &left_classes, &right_classes);
  }

  /// Disparities that agree, of both views: the right one's from the left one where there is none.
  void complete(std::array<ImageOf<float>, 2>& d, const FramePerception& in) const {
    if (d[0].empty()) return;
    const double tolerance = settings_.options.depth.left_right_tolerance;
    if (!d[1].empty()) {
      const ImageOf<float> left = d[0];
      check_left_right(d[0], d[1], -1, tolerance);
      check_left_right(d[1], left, +1, tolerance);
    } else if (in.size() == 2) {
      d[1] = warp(d[0], in);
    }
  }

  [[nodiscard]] std::optional<FlowField> flow(std::size_t c, std::size_t t,
                                              const CameraPerception& in, const GrayImage& now,
                                              const GrayImage& next) const {
    if (inputs_.flow[c].empty() || t + 1 == frames()) return std::nullopt;
    const BuilderOptions::FlowCheck& check = settings_.options.flow_check;
    if (inputs_.flow[c] == "dis") {
      return estimate_checked_flow(settings_.options, sequence_.camera, now, next, in.disparity,
                                   in.panoptic.map, stuff_mask(in.panoptic));
    }
    const auto read = [&](const fs::path& path) {
      FlowField field = read_flow(path, inputs_.flow_encoding);
      check_size(path, field.u);
      return field;
    };
    FlowField forward = read(find_flow(inputs_.flow[c], sequence_.names[t]));
    if (check.enabled && !inputs_.flow_back[c].empty()) {
      check_forward_backward(forward, read(back_flow(inputs_.flow_back[c], t)), check.tolerance,
                             check.relative_tolerance);
    }
    return forward;
  }

  [[nodiscard]] fs::path file_of(std::size_t t) const {
    return settings_.output / (sequence_.names[t] + ".kysp");
  }
  [[nodiscard]] fs::path rows_of(std::size_t t) const {
    return settings_.output / ".rows" / (sequence_.names[t] + ".csv");
  }
  [[nodiscard]] double time_of(std::size_t t) const {
    return t < sequence_.timestamps.size() ? sequence_.timestamps[t] : 0.1 * static_cast<double>(t);
  }

  void measure_frame(std::size_t t, Prepared prepared, Measured& out) {
    FramePerception& perception = prepared.perception;
    out.kept = kept_evidence(t, out.key);
    if (out.kept) return;
    Pair next;
    if (needs_images()) out.now = sequence_.read(t);
    if (needs_images() && t + 1 < frames()) next = sequence_.read(t + 1);
    std::array<ImageOf<float>, 2> disparity = std::move(prepared.disparity);
    if (disparity[0].empty()) {
      Stopwatch watch;
      disparity = disparities(t, out.now);
      out.times.stereo = watch.lap_ms();
      complete(disparity, perception);
      out.times.depth = watch.lap_ms();
    }
    for (std::size_t c = 0; c < perception.size(); ++c) {
      CameraPerception& in = perception[c];
      const GrayImage& image = c == 0 ? out.now.first : out.now.second;
      const GrayImage& next_image = c == 0 ? next.first : next.second;
      in.disparity = std::move(disparity[c]);
      const Stopwatch watch;
      in.flow = flow(c, t, in, image, next_image);
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

  struct Things {
    std::vector<CameraFusion*> cameras;
    std::vector<const std::vector<std::int32_t>*> instances;
  };
  static Things things_of(Measured& measured) {
    Things things;
    for (MeasuredCamera& camera : measured.cameras) {
      things.cameras.push_back(&camera.fusion);
      things.instances.push_back(&camera.input.instances);
    }
    return things;
  }

  /// Belief over time goes through the frames in order.
  void add_to_belief(std::size_t t, Measured& measured) {
    if (measured.kept) return belief_->restore_frame(time_of(t), *measured.kept);
    const Things things = things_of(measured);
    belief_->add_frame(time_of(t), things.cameras, things.instances);
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
    const std::string& name = sequence_.names[t];
    FramePriors priors;
    priors.label_space = labels_.name();
    priors.calibration_hash = calibration_hash(sequence_.camera);
    priors.content_key = measured.key;
    priors.shares_instances = overlap_.has_value();
    std::string rows;
    bool without_motion = false;
    BuildTimes& times = measured.times;
    for (std::size_t c = 0; c < measured.cameras.size(); ++c) {
      const CameraFusion fusion = export_camera(settings_.options, std::move(measured.cameras[c]));
      if (settings_.debug_images) {
        write_png(settings_.output / "debug" / (name + (c == 0 ? "_left.png" : "_right.png")),
                  draw_stages(c == 0 ? measured.now.first : measured.now.second, fusion,
                              measured.images[c]));
      }
      priors.has_motion = priors.has_motion || fusion.ego_motion.has_value() ||
                          std::any_of(fusion.decisions.begin(), fusion.decisions.end(),
                                      [](const MotionDecision& d) { return d.judged; });
      rows += table_rows(name, c, fusion);
      times.fusion += fusion.times;
      without_motion |= c == 0 && !fusion.ego_motion;
      priors.cameras.push_back(fusion.priors);
    }
    MotionCoding coding;
    coding.tolerance_steps = settings_.options.exported.motion_tolerance_steps;
    const Stopwatch watch;
    const std::vector<std::uint8_t> bytes = encode_priors(priors, file_of(t).string(), coding);
    times.encoding = watch.elapsed_ms();
    write_file_atomic(rows_of(t), pack_rows(measured.key, rows), Durable::kNo);
    write_file_atomic(file_of(t), bytes, Durable::kNo);
    const std::lock_guard lock(mutex_);
    ++summary_.built;
    summary_.frames_without_motion += without_motion;
    summary_.times += times;
  }

  static std::string table_rows(const std::string& name, std::size_t c, const CameraFusion& f) {
    const std::string frame = csv_field(name);
    const char* camera = c == 0 ? "left" : "right";
    std::string rows;
    char line[1024];
    for (std::size_t k = 0; k < f.segments.size(); ++k) {
      const InputSegment& s = f.segments[k];
      if (!s.thing) continue;
      const SegmentStatistics& m = f.statistics[k];
      const MotionDecision& d = f.decisions[k];
      std::snprintf(
          line, sizeof line,
          ",%s,%u,%d,%u,%u,%.4f,%.4f,%.4f,%.4f,%.4f,%d,%d,%.4f,%.4f,%.4f,%.4f,%.4f,%.4f,"
          "%.4f,%.4f,%d,%d,%.4f,%.4f,%.4f,%.4f,%d,%d,%.4f,%.4f,%d,%d,%d,%.4f,%.3f,%.3f,%.3f,%.3f,"
          "%.17g,%s,%.17g\n",
          camera, s.input_id, f.priors.segments[k].instance, s.label, m.area, m.mean_depth,
          m.residual, m.radial, m.coverage, d.omega, d.magnitude_test, d.radial_test, d.rho,
          d.score, m.area > 0 ? static_cast<double>(m.flow_count) / m.area : 0.0, m.median.length,
          m.median.coherent, m.median.scatter, m.median.parallax, m.median.disparity,
          m.keypoints.matches, m.keypoints.inliers, m.keypoints.log_ratio, m.keypoints.span,
          m.keypoints.shift, m.keypoints.pixels, m.appearance.patches, m.appearance.flow_patches,
          m.appearance.still, m.appearance.flow, m.space.occupied, m.space.free, m.space.hidden,
          m.space.span, d.evidence_flow, d.evidence_appearance, d.evidence_keypoints,
          d.evidence_space, d.evidence,
          d.dynamic  ? "moving"
          : d.judged ? "static"
                     : "not_judged",
          d.log_odds);
      rows += "S" + frame + line;
    }
    if (!f.ego_motion) return rows;
    const EgoMotion& e = *f.ego_motion;
    std::array<double, 8> p = e.c;
    if (e.model == EgoMotionModel::kSe3) {
      const Eigen::Vector3d w = so3_log(e.T_next_now.rotation), v = e.T_next_now.t();
      p = {w.x(), w.y(), w.z(), v.x(), v.y(), v.z(), 0, 0};
    }
    static constexpr const char* kNames[] = {"se3", "rigid", "as_printed"};
    std::snprintf(line, sizeof line,
                  ",%s,%s,%d,%.4f,%.4f,%.4f,%.4f,%.0f,%.8g,%.8g,%.8g,%.8g,%.8g,%.8g,%.8g,%.8g\n",
                  camera, kNames[static_cast<std::size_t>(e.model)], e.samples, e.mean_residual,
                  f.background.m_bg, f.background.mu_par, f.background.sigma_par,
                  f.background.pixels, p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7]);
    return rows + "B" + frame + line;
  }

  /// Joins the rows of all frames, and counts what is in the files.
  void write_tables() {
    std::string segments = kSegmentsHeader, background = kBackgroundHeader;
    double labelled = 0, flagged = 0;
    for (const std::string& name : sequence_.names) {
      std::ifstream rows(settings_.output / ".rows" / (name + ".csv"));
      for (std::string line; std::getline(rows, line);) {
        if (line.starts_with('S')) segments += line.substr(1) + "\n";
        if (line.starts_with('B')) background += line.substr(1) + "\n";
      }
      const PriorFile file = PriorFile::open(settings_.output / (name + ".kysp"));
      summary_.bytes += file.file_size();
      for (std::size_t c = 0; c < file.camera_count(); ++c) {
        for (const PriorSegment& s : file.segments(static_cast<CameraSide>(c))) {
          const bool dynamic = (s.flags & prior_format::kDynamic) != 0;
          labelled += s.area;
          flagged += dynamic ? s.area : 0;
          summary_.thing_segments += (s.flags & prior_format::kThing) != 0;
          summary_.dynamic_segments += dynamic;
          summary_.radial_only_segments += (s.flags & prior_format::kRadialOnly) != 0;
        }
      }
    }
    const double pixels = static_cast<double>(frames() * readers_.size()) * sequence_.camera.width *
                          sequence_.camera.height;
    summary_.labelled_pixels = pixels > 0 ? labelled / pixels : 0;
    summary_.flagged_pixels = pixels > 0 ? flagged / pixels : 0;
    write_file_atomic(settings_.output / "segments.csv", segments);
    write_file_atomic(settings_.output / "background.csv", background);
    write_file_atomic(settings_.output / "settings.txt", to_text(settings_.options));
  }

  const BuildSequence& sequence_;
  const kys::LabelSpace& labels_;
  Digest classes_;  ///< of the label space
  const BuildInputs& inputs_;
  const BuildSettings& settings_;
  std::vector<PanopticReader> readers_;
  std::vector<InstanceAssociator> associators_;
  std::optional<MaskAssociator> overlap_;
  std::optional<MotionBelief> belief_;
  std::uint64_t chain_ = 0;  ///< content key of the frame before, where belief depends on it
  std::unique_ptr<KeypointMotion> keypoints_;
  std::deque<std::array<ImageOf<float>, 2>> earlier_;  ///< disparities (px), latest first
  std::deque<Prepared> prepared_;                      ///< frames that are read and not yet built
  std::size_t read_ = 0;                               ///< frames
  std::vector<std::uint64_t> keys_;                    ///< of frames, without what comes after them
  std::size_t keyed_ = 0;                              ///< frames
  std::deque<Measured> measured_;  ///< frames that are not written, from `written_` on
  std::size_t written_ = 0;        ///< frames
  std::mutex mutex_;               ///< of what follows, while frames are built
  BuildSummary summary_;
  std::size_t done_ = 0;  ///< frames
};

}  // namespace

BuildSummary build_sequence_priors(const BuildSequence& sequence, const kys::LabelSpace& labels,
                                   const BuildInputs& inputs, const BuildSettings& settings) {
  settings.options.check();
  if (sequence.names.empty()) throw InputError("the sequence has no frames");
  if (inputs.keypoints && settings.options.detection.method != DetectionMethod::kRobust) {
    throw InputError("keypoints judge with detection.method robust only");
  }
  if (inputs.keypoints && sequence.timestamps.size() != sequence.names.size()) {
    throw InputError("keypoints need a time stamp of every frame");
  }
  return SequenceBuilder(sequence, labels, inputs, settings).run();
}

}  // namespace kys_slam
