#include "priors/builder/build_sequence.h"

#include <kys_slam/error.h>

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <exception>
#include <fstream>
#include <mutex>
#include <optional>
#include <sstream>
#include <thread>

#include "priors/builder/association.h"
#include "priors/builder/debug_image.h"
#include "priors/builder/estimators.h"
#include "priors/format/calibration_hash.h"
#include "priors/format/prior_format.h"
#include "util/atomic_file.h"

namespace kys_slam {
namespace {

namespace fs = std::filesystem;
constexpr const char* kSegmentsHeader =
    "frame,camera,input_id,identity,label,area_px,mean_depth_m,residual_px,radial_px,coverage,"
    "omega,magnitude_test,radial_test,rho,m\n";
constexpr const char* kBackgroundHeader =
    "frame,camera,model,samples,fit_residual_px,m_bg_px,mu_par_px,sigma_par_px,stuff_px,"
    "p1,p2,p3,p4,p5,p6,p7,p8\n";

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

/// FNV-1a of text: what a prior file was made from.
class Digest {
 public:
  void add(const std::string& text) {
    for (const char c : text) {
      value_ = (value_ ^ static_cast<std::uint8_t>(c)) * 0x100000001B3ull;
    }
    value_ = (value_ ^ 0xFF) * 0x100000001B3ull;
  }
  void add_file(const fs::path& path) {
    std::error_code error;
    const auto size = fs::file_size(path, error);
    const auto time = fs::last_write_time(path, error);
    add(path.string() + " " + std::to_string(size) + " " +
        std::to_string(time.time_since_epoch().count()));
  }
  [[nodiscard]] std::uint64_t value() const { return value_ == 0 ? 1 : value_; }

 private:
  std::uint64_t value_ = 0xCBF29CE484222325ull;
};

class SequenceBuilder {
 public:
  SequenceBuilder(const BuildSequence& sequence, const kys::LabelSpace& labels,
                  const BuildInputs& inputs, const BuildSettings& settings)
      : sequence_(sequence), labels_(labels), inputs_(inputs), settings_(settings) {
    for (std::size_t c = 0; c < 2; ++c) {
      if (inputs.panoptic[c].empty()) continue;
      readers_.emplace_back(inputs.panoptic[c], labels, inputs.panoptic_encoding);
    }
    if (inputs.panoptic[0].empty()) throw InputError("the left camera's segmentation is missing");
    instances_.assign(readers_.size(), std::vector<std::vector<std::int32_t>>(frames()));
  }

  BuildSummary run() {
    make_output_folder(settings_.output);
    make_output_folder(settings_.output / ".rows");
    if (settings_.debug_images) make_output_folder(settings_.output / "debug");
    summary_.frames = frames();
    for (std::size_t c = 0; c < readers_.size(); ++c) associate(c);
    std::atomic<std::size_t> done{0};
    for_each_index(frames(), settings_.jobs, [&](std::size_t t) {
      build_frame(t);
      report("priors", ++done, frames());
    });
    write_tables();
    return summary_;
  }

 private:
  [[nodiscard]] std::size_t frames() const { return sequence_.names.size(); }

  void report(const std::string& stage, std::size_t done, std::size_t total) {
    if (!settings_.progress) return;
    const std::lock_guard lock(mutex_);
    settings_.progress(stage, done, total);
  }

  [[nodiscard]] PanopticMap read_panoptic(std::size_t c, std::size_t t) const {
    return readers_[c].read(sequence_.names[t], sequence_.camera.width, sequence_.camera.height);
  }

  /// Identities of every segment of one camera's stream. Centroids are taken in parallel, the
  /// association itself runs in order.
  void associate(std::size_t c) {
    struct Seen {
      std::vector<InputSegment> segments;
      std::vector<SegmentShape> shapes;
    };
    std::vector<Seen> seen(frames());
    std::atomic<std::size_t> done{0};
    for_each_index(frames(), settings_.jobs, [&](std::size_t t) {
      const PanopticMap map = read_panoptic(c, t);
      seen[t] = {map.segments, segment_shapes(find_runs(map.map), map.segments.size())};
      report(c == 0 ? "segments, left" : "segments, right", ++done, frames());
    });
    InstanceAssociator associator(settings_.options.association);
    const std::int32_t base = c == 0 ? 0 : prior_format::kRightInstances;
    for (std::size_t t = 0; t < frames(); ++t) {
      std::vector<Detection> detections;
      for (std::size_t k = 0; k < seen[t].segments.size(); ++k) {
        const InputSegment& s = seen[t].segments[k];
        if (s.thing) detections.push_back({s.label, seen[t].shapes[k].u, seen[t].shapes[k].v});
      }
      const std::vector<std::int32_t> identities = associator.next_frame(detections);
      std::size_t d = 0;
      // Stuff has one identity per class, below those of things.
      for (const InputSegment& s : seen[t].segments) {
        instances_[c][t].push_back(base + (s.thing ? 65536 + identities[d++] : s.label));
      }
    }
    summary_.tracks[c] = associator.identities_given();
  }

  [[nodiscard]] bool needs_images() const {
    return inputs_.disparity == "sgbm" || inputs_.flow[0] == "dis" || inputs_.flow[1] == "dis" ||
           settings_.debug_images;
  }

  [[nodiscard]] fs::path back_flow(const std::string& folder, std::size_t t) const {
    return find_back_flow(folder, sequence_.names[t], sequence_.names[t + 1]);
  }

  /// Digest of everything the file of frame t depends on.
  [[nodiscard]] std::uint64_t content_key(std::size_t t) const {
    const std::string& name = sequence_.names[t];
    Digest digest;
    digest.add("kysp builder 2\n" + to_text(settings_.options) + labels_.name());
    digest.add(std::to_string(calibration_hash(sequence_.camera)));
    digest.add(t + 1 < frames() ? sequence_.names[t + 1] : "last");
    digest.add(std::to_string(static_cast<int>(inputs_.disparity_encoding)) +
               std::to_string(static_cast<int>(inputs_.flow_encoding)));
    for (std::size_t c = 0; c < readers_.size(); ++c) {
      digest.add_file(readers_[c].path_of(name));
      const fs::path classes = readers_[c].class_path_of(name);
      if (!classes.empty()) digest.add_file(classes);
      for (const std::int32_t instance : instances_[c][t]) digest.add(std::to_string(instance));
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

  [[nodiscard]] bool is_current(const fs::path& file, const fs::path& rows,
                                std::uint64_t key) const {
    std::error_code error;
    if (settings_.rebuild || !fs::exists(file, error) || !fs::exists(rows, error)) return false;
    if (settings_.debug_images &&
        !fs::exists(settings_.output / "debug" / (file.stem().string() + "_left.png"), error)) {
      return false;
    }
    try {
      return PriorFile::open(file).content_key() == key;
    } catch (const InputError&) {
      return false;
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

  using Pair = std::pair<GrayImage, GrayImage>;

  [[nodiscard]] ImageOf<float> warp(const ImageOf<float>& left,
                                    const std::vector<PanopticMap>& maps) const {
    if (maps.size() < 2) return {};
    if (!settings_.options.depth.match_labels) return warp_disparity_to_right(left);
    const ImageOf<std::uint16_t> left_labels = label_image(maps[0]);
    const ImageOf<std::uint16_t> right_labels = label_image(maps[1]);
    return warp_disparity_to_right(left, &left_labels, &right_labels);
  }

  [[nodiscard]] std::array<ImageOf<float>, 2> disparities(
      std::size_t t, const Pair& now, const std::vector<PanopticMap>& maps) const {
    std::array<ImageOf<float>, 2> d;
    if (inputs_.disparity.empty()) return d;
    const double tolerance = settings_.options.depth.left_right_tolerance;
    if (inputs_.disparity == "sgbm") {
      d[0] = estimate_disparity(now.first, now.second, false);
      check_left_right(d[0], estimate_disparity(now.first, now.second, true), -1, tolerance);
      d[1] = warp(d[0], maps);
      return d;
    }
    const auto read = [&](const std::string& folder) {
      const fs::path path = find_disparity(folder, sequence_.names[t]);
      ImageOf<float> field =
          read_disparity(path, inputs_.disparity_encoding, sequence_.camera.bf());
      check_size(path, field);
      return field;
    };
    d[0] = read(inputs_.disparity);
    if (inputs_.disparity_right.empty()) {
      d[1] = warp(d[0], maps);
      return d;
    }
    d[1] = read(inputs_.disparity_right);
    const ImageOf<float> left = d[0];
    check_left_right(d[0], d[1], -1, tolerance);
    check_left_right(d[1], left, +1, tolerance);
    return d;
  }

  [[nodiscard]] std::optional<FlowField> flow(std::size_t c, std::size_t t, const GrayImage& now,
                                              const GrayImage& next) const {
    if (inputs_.flow[c].empty() || t + 1 == frames()) return std::nullopt;
    const BuilderOptions::FlowCheck& check = settings_.options.flow_check;
    if (inputs_.flow[c] == "dis") {
      FlowField forward = estimate_flow(now, next);
      check_forward_backward(forward, estimate_flow(next, now), check.tolerance,
                             check.relative_tolerance);
      return forward;
    }
    const auto read = [&](const fs::path& path) {
      FlowField field = read_flow(path, inputs_.flow_encoding);
      check_size(path, field.u);
      return field;
    };
    FlowField forward = read(find_flow(inputs_.flow[c], sequence_.names[t]));
    if (!inputs_.flow_back[c].empty()) {
      check_forward_backward(forward, read(back_flow(inputs_.flow_back[c], t)), check.tolerance,
                             check.relative_tolerance);
    }
    return forward;
  }

  void build_frame(std::size_t t) {
    const std::string& name = sequence_.names[t];
    const fs::path file = settings_.output / (name + ".kysp");
    const fs::path rows_file = settings_.output / ".rows" / (name + ".csv");
    const std::uint64_t key = content_key(t);
    if (is_current(file, rows_file, key)) {
      const std::lock_guard lock(mutex_);
      ++summary_.kept;
      return;
    }
    Pair now, next;
    if (needs_images()) now = sequence_.read(t);
    if (needs_images() && t + 1 < frames()) next = sequence_.read(t + 1);
    std::vector<PanopticMap> maps;
    for (std::size_t c = 0; c < readers_.size(); ++c) maps.push_back(read_panoptic(c, t));
    std::array<ImageOf<float>, 2> disparity = disparities(t, now, maps);

    FramePriors priors;
    priors.label_space = labels_.name();
    priors.calibration_hash = calibration_hash(sequence_.camera);
    priors.content_key = key;
    std::string rows;
    std::vector<CameraFusion> fusions;
    for (std::size_t c = 0; c < readers_.size(); ++c) {
      CameraPerception in;
      in.panoptic = std::move(maps[c]);
      in.instances = instances_[c][t];
      if (!disparity[c].empty()) {
        in.inverse_depth =
            inverse_depth(disparity[c], sequence_.camera.bf(), settings_.options.depth.max_depth);
      }
      in.flow = flow(c, t, c == 0 ? now.first : now.second, c == 0 ? next.first : next.second);
      FusionImages images;
      CameraFusion fusion = fuse_camera(settings_.options, sequence_.camera, in,
                                        settings_.debug_images ? &images : nullptr);
      if (settings_.debug_images) {
        write_png(settings_.output / "debug" / (name + (c == 0 ? "_left.png" : "_right.png")),
                  draw_stages(c == 0 ? now.first : now.second, in, fusion, images));
      }
      priors.has_motion = priors.has_motion || fusion.ego_motion.has_value();
      rows += table_rows(name, c, in, fusion);
      priors.cameras.push_back(std::move(fusion.priors));
      fusions.push_back(std::move(fusion));
    }
    MotionCoding coding;
    coding.tolerance_steps = settings_.options.exported.motion_tolerance_steps;
    const std::vector<std::uint8_t> bytes = encode_priors(priors, file.string(), coding);
    write_file_atomic(rows_file, rows, Durable::kNo);
    write_file_atomic(file, bytes, Durable::kNo);
    count(fusions);
  }

  void count(const std::vector<CameraFusion>& fusions) {
    const std::lock_guard lock(mutex_);
    ++summary_.built;
    if (!fusions[0].ego_motion) ++summary_.frames_without_motion;
    for (const CameraFusion& f : fusions) {
      summary_.times.runs += f.times.runs;
      summary_.times.fit += f.times.fit;
      summary_.times.residual += f.times.residual;
      summary_.times.drift += f.times.drift;
      summary_.times.statistics += f.times.statistics;
      summary_.times.decide_export += f.times.decide_export;
    }
  }

  std::string table_rows(const std::string& name, std::size_t c, const CameraPerception& in,
                         const CameraFusion& f) const {
    const char* camera = c == 0 ? "left" : "right";
    std::string rows;
    char line[512];
    for (std::size_t k = 0; k < in.panoptic.segments.size(); ++k) {
      const InputSegment& s = in.panoptic.segments[k];
      if (!s.thing) continue;
      const SegmentStatistics& m = f.statistics[k];
      const MotionDecision& d = f.decisions[k];
      std::snprintf(line, sizeof line,
                    "S%s,%s,%u,%d,%u,%u,%.4f,%.4f,%.4f,%.4f,%.4f,%d,%d,%.4f,%.4f\n", name.c_str(),
                    camera, s.input_id, in.instances[k], s.label, m.area, m.mean_depth, m.residual,
                    m.radial, m.coverage, d.omega, d.magnitude_test, d.radial_test, d.rho, d.score);
      rows += line;
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
                  "B%s,%s,%s,%d,%.4f,%.4f,%.4f,%.4f,%.0f,%.8g,%.8g,%.8g,%.8g,%.8g,%.8g,%.8g,%.8g\n",
                  name.c_str(), camera, kNames[static_cast<std::size_t>(e.model)], e.samples,
                  e.mean_residual, f.background.m_bg, f.background.mu_par, f.background.sigma_par,
                  f.background.pixels, p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7]);
    return rows + line;
  }

  /// Joins the rows of all frames, and counts what is in the files.
  void write_tables() {
    std::string segments = kSegmentsHeader, background = kBackgroundHeader;
    double labelled = 0, flagged = 0;
    for (const std::string& name : sequence_.names) {
      std::ifstream rows(settings_.output / ".rows" / (name + ".csv"));
      for (std::string line; std::getline(rows, line);) {
        if (!line.empty()) (line[0] == 'S' ? segments : background) += line.substr(1) + "\n";
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
  const BuildInputs& inputs_;
  const BuildSettings& settings_;
  std::vector<PanopticReader> readers_;
  std::vector<std::vector<std::vector<std::int32_t>>> instances_;  ///< camera, frame, segment
  std::mutex mutex_;
  BuildSummary summary_;
};

}  // namespace

BuildSummary build_sequence_priors(const BuildSequence& sequence, const kys::LabelSpace& labels,
                                   const BuildInputs& inputs, const BuildSettings& settings) {
  settings.options.check();
  if (sequence.names.empty()) throw InputError("the sequence has no frames");
  return SequenceBuilder(sequence, labels, inputs, settings).run();
}

}  // namespace kys_slam
