#include "priors/builder/build_sequence.h"

#include <kys_slam/calibration_hash.h>
#include <kys_slam/error.h>
#include <kys_slam/prior_format.h>

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
#include "util/atomic_file.h"
#include "util/stopwatch.h"

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
      summary_.tracks[c] = associators_[c].identities_given();
    }
    write_tables();
    return summary_;
  }

 private:
  [[nodiscard]] std::size_t frames() const { return sequence_.names.size(); }

  /// The left and the right camera at one frame; flow and depth come later.
  using FramePerception = std::vector<CameraPerception>;

  /// Frames from begin to end: only identities need them in order.
  void build_frames(std::size_t begin, std::size_t end) {
    std::vector<FramePerception> perceptions(end - begin);
    std::vector<std::vector<std::vector<SegmentShape>>> shapes(end - begin);
    for_each_index(end - begin, settings_.jobs, [&](std::size_t i) {
      for (const PanopticReader& reader : readers_) {
        CameraPerception& in = perceptions[i].emplace_back();
        in.panoptic = reader.read(sequence_.names[begin + i], sequence_.camera.width,
                                  sequence_.camera.height);
        const Stopwatch watch;
        shapes[i].push_back(segment_shapes(in.panoptic.runs, in.panoptic.segments.size()));
        add_association(watch.elapsed_ms());
      }
    });
    const Stopwatch watch;
    for (std::size_t i = 0; i < perceptions.size(); ++i) {
      for (std::size_t c = 0; c < readers_.size(); ++c) {
        perceptions[i][c].instances = identify(c, perceptions[i][c].panoptic, shapes[i][c]);
      }
    }
    add_association(watch.elapsed_ms());
    for_each_index(end - begin, settings_.jobs, [&](std::size_t i) {
      build_frame(begin + i, std::move(perceptions[i]));
      const std::lock_guard lock(mutex_);
      ++done_;
      if (settings_.progress) settings_.progress("priors", done_, frames());
    });
  }

  void add_association(double ms) {
    const std::lock_guard lock(mutex_);
    summary_.times.association += ms;
  }

  /// Identities of the segments of one camera's next frame.
  std::vector<std::int32_t> identify(std::size_t c, const PanopticMap& panoptic,
                                     const std::vector<SegmentShape>& shapes) {
    std::vector<Detection> things;
    for (std::size_t k = 0; k < shapes.size(); ++k) {
      const InputSegment& s = panoptic.segments[k];
      if (s.thing) things.push_back({s.label, shapes[k].u, shapes[k].v});
    }
    const std::vector<std::int32_t> identities = associators_[c].next_frame(things);
    // Stuff has one identity per class, below those of things.
    const std::int32_t base = c == 0 ? 0 : prior_format::kRightInstances;
    std::vector<std::int32_t> instances;
    std::size_t next = 0;
    for (const InputSegment& s : panoptic.segments) {
      instances.push_back(base + (s.thing ? 65536 + identities[next++] : s.label));
    }
    return instances;
  }

  [[nodiscard]] bool needs_images() const {
    return inputs_.disparity == "sgbm" || inputs_.flow[0] == "dis" || inputs_.flow[1] == "dis" ||
           settings_.debug_images;
  }

  [[nodiscard]] fs::path back_flow(const std::string& folder, std::size_t t) const {
    return find_back_flow(folder, sequence_.names[t], sequence_.names[t + 1]);
  }

  /// Digest of everything the file of frame t depends on.
  [[nodiscard]] std::uint64_t content_key(std::size_t t, const FramePerception& perception) const {
    const std::string& name = sequence_.names[t];
    Digest digest;
    digest.add("kysp builder 3\n" + to_text(settings_.options) + labels_.name());
    digest.add(std::to_string(calibration_hash(sequence_.camera)));
    digest.add(t + 1 < frames() ? sequence_.names[t + 1] : "last");
    digest.add(std::to_string(static_cast<int>(inputs_.disparity_encoding)) +
               std::to_string(static_cast<int>(inputs_.flow_encoding)));
    for (std::size_t c = 0; c < readers_.size(); ++c) {
      digest.add_file(readers_[c].path_of(name));
      const fs::path classes = readers_[c].class_path_of(name);
      if (!classes.empty()) digest.add_file(classes);
      for (const std::int32_t i : perception[c].instances) digest.add(std::to_string(i));
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

  /// Disparities that agree, of both views: the right one's from the left one unless it was read.
  void complete(std::array<ImageOf<float>, 2>& d, const FramePerception& in) const {
    if (d[0].empty()) return;
    const double tolerance = settings_.options.depth.left_right_tolerance;
    const bool right_is_read = !inputs_.disparity_right.empty();
    if (!d[1].empty()) {
      const ImageOf<float> left = right_is_read ? d[0] : ImageOf<float>();
      check_left_right(d[0], d[1], -1, tolerance);
      if (right_is_read) check_left_right(d[1], left, +1, tolerance);
    }
    if (in.size() == 2 && !right_is_read) d[1] = warp(d[0], in);
  }

  [[nodiscard]] std::optional<FlowField> flow(std::size_t c, std::size_t t, const GrayImage& now,
                                              const GrayImage& next) const {
    if (inputs_.flow[c].empty() || t + 1 == frames()) return std::nullopt;
    const BuilderOptions::FlowCheck& check = settings_.options.flow_check;
    if (inputs_.flow[c] == "dis") {
      FlowField forward = estimate_flow(now, next);
      if (check.enabled) {
        check_forward_backward(forward, estimate_flow(next, now), check.tolerance,
                               check.relative_tolerance);
      }
      return forward;
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

  void build_frame(std::size_t t, FramePerception perception) {
    const std::string& name = sequence_.names[t];
    const fs::path file = settings_.output / (name + ".kysp");
    const fs::path rows_file = settings_.output / ".rows" / (name + ".csv");
    const std::uint64_t key = content_key(t, perception);
    if (is_current(file, rows_file, key)) {
      const std::lock_guard lock(mutex_);
      ++summary_.kept;
      return;
    }
    Pair now, next;
    if (needs_images()) now = sequence_.read(t);
    if (needs_images() && t + 1 < frames()) next = sequence_.read(t + 1);
    std::array<ImageOf<float>, 2> disparity = disparities(t, now);
    BuildTimes times;
    Stopwatch watch;
    complete(disparity, perception);
    times.depth = watch.lap_ms();

    FramePriors priors;
    priors.label_space = labels_.name();
    priors.calibration_hash = calibration_hash(sequence_.camera);
    priors.content_key = key;
    std::string rows;
    bool without_motion = false;
    for (std::size_t c = 0; c < perception.size(); ++c) {
      CameraPerception& in = perception[c];
      in.disparity = std::move(disparity[c]);
      in.flow = flow(c, t, c == 0 ? now.first : now.second, c == 0 ? next.first : next.second);
      FusionImages images;
      CameraFusion fusion = fuse_camera(settings_.options, sequence_.camera, std::move(in),
                                        settings_.debug_images ? &images : nullptr);
      if (settings_.debug_images) {
        write_png(settings_.output / "debug" / (name + (c == 0 ? "_left.png" : "_right.png")),
                  draw_stages(c == 0 ? now.first : now.second, fusion, images));
      }
      priors.has_motion = priors.has_motion || fusion.ego_motion.has_value();
      rows += table_rows(name, c, fusion);
      times.fusion += fusion.times;
      without_motion |= c == 0 && !fusion.ego_motion;
      priors.cameras.push_back(std::move(fusion.priors));
    }
    MotionCoding coding;
    coding.tolerance_steps = settings_.options.exported.motion_tolerance_steps;
    watch.lap_ms();
    const std::vector<std::uint8_t> bytes = encode_priors(priors, file.string(), coding);
    times.encoding = watch.lap_ms();
    write_file_atomic(rows_file, rows, Durable::kNo);
    write_file_atomic(file, bytes, Durable::kNo);
    const std::lock_guard lock(mutex_);
    ++summary_.built;
    summary_.frames_without_motion += without_motion;
    summary_.times += times;
  }

  static std::string table_rows(const std::string& name, std::size_t c, const CameraFusion& f) {
    const char* camera = c == 0 ? "left" : "right";
    std::string rows;
    char line[512];
    for (std::size_t k = 0; k < f.segments.size(); ++k) {
      const InputSegment& s = f.segments[k];
      if (!s.thing) continue;
      const SegmentStatistics& m = f.statistics[k];
      const MotionDecision& d = f.decisions[k];
      std::snprintf(line, sizeof line,
                    "S%s,%s,%u,%d,%u,%u,%.4f,%.4f,%.4f,%.4f,%.4f,%d,%d,%.4f,%.4f\n", name.c_str(),
                    camera, s.input_id, f.priors.segments[k].instance, s.label, m.area,
                    m.mean_depth, m.residual, m.radial, m.coverage, d.omega, d.magnitude_test,
                    d.radial_test, d.rho, d.score);
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
  std::vector<InstanceAssociator> associators_;
  std::mutex mutex_;  ///< of what follows, while frames are built
  BuildSummary summary_;
  std::size_t done_ = 0;  ///< frames
};

}  // namespace

BuildSummary build_sequence_priors(const BuildSequence& sequence, const kys::LabelSpace& labels,
                                   const BuildInputs& inputs, const BuildSettings& settings) {
  settings.options.check();
  if (sequence.names.empty()) throw InputError("the sequence has no frames");
  return SequenceBuilder(sequence, labels, inputs, settings).run();
}

}  // namespace kys_slam
