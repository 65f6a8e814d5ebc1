// SPDX-License-Identifier: BSD-3-Clause
#include <kys/prior.h>
#include <kys_slam/prior_folder.h>
#include <kys_slam/rig_file.h>
#include <kys_slam/run_main.h>
#include <kys_slam/run_writer.h>
#include <kys_slam/system.h>
#include <kys_slam/util/atomic_file.h>
#include <kys_slam/util/interrupt.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/string_view.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <atomic>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <span>
#include <tuple>
#include <vector>

#include "arrays.h"
#include "bind.h"
#include "observation_pipe.h"
#include "python_extractor.h"

namespace kys_slam {

using namespace nb::literals;

namespace {

/// Priors of a frame as they were given with it, else of the folder, else those of its features.
/// With a folder those of features are not used, as in the C++ programs.
class Priors final : public PriorProvider {
 public:
  bool look_up(const StereoFrame& frame, std::span<const Keypoint> left,
               std::span<const Keypoint> right, std::vector<kys::Prior>& left_priors,
               std::vector<kys::Prior>& right_priors) override {
    segments_ = {};
    if (given) {
      segments_ = given->segment_priors(CameraSide::kLeft);
      left_priors.resize(left.size());
      right_priors.resize(right.size());
      given->lookup(CameraSide::kLeft, left, left_priors);
      given->lookup(CameraSide::kRight, right, right_priors);
      return true;
    }
    if (folder) {
      if (!folder->look_up(frame, left, right, left_priors, right_priors)) return false;
      segments_ = folder->segments();
      return true;
    }
    if (!frame.has_priors) {
      ++without_;
      return false;
    }
    if (frame.left_priors.size() != left.size() || frame.right_priors.size() != right.size()) {
      throw InputError("frame " + std::to_string(frame.index) +
                       ": features and priors differ in number");
    }
    ++of_features_;
    left_priors = frame.left_priors;
    right_priors = frame.right_priors;
    return true;
  }
  [[nodiscard]] std::span<const kys::Prior> segments() const override { return segments_; }

  /// Frames without priors where others have some.
  [[nodiscard]] std::int64_t missing() const {
    if (folder) return static_cast<std::int64_t>(folder->missing());
    return of_features_ > 0 ? without_ : 0;
  }

  std::unique_ptr<PriorFolder> folder;
  std::optional<PriorFile> given;

 private:
  std::int64_t without_ = 0, of_features_ = 0;  // frames
  std::span<const kys::Prior> segments_;
};

/// (N, 6, 6) array; NaN where there is none.
nb::ndarray<nb::numpy, double> covariances_to_numpy(
    const std::vector<FrameEstimate>& list, std::optional<RelativePose> FrameEstimate::*which) {
  std::vector<double> values;
  values.reserve(36 * list.size());
  for (const FrameEstimate& e : list) {
    RelativePose::Covariance C =
        RelativePose::Covariance::Constant(std::numeric_limits<double>::quiet_NaN());
    if (e.*which) C = (e.*which)->covariance;
    values.insert(values.end(), C.data(), C.data() + C.size());
  }
  return to_numpy(std::move(values), {list.size(), 6, 6});
}

/// One line of Python's logging, which goes to stderr unless the program says otherwise.
void warn(const std::string& message) {
  const nb::gil_scoped_acquire acquired;
  const nb::object logger = nb::module_::import_("logging").attr("getLogger")("kys_slam");
  logger.attr("warning")("%s", printable(message));
}

using MaybeArray = std::optional<AnyArray>;
using SegmentMap = nb::ndarray<const std::uint16_t, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

GrayImage mask_of(const MaybeArray& array, const char* what) {
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
    auto provider = std::make_unique<Priors>();
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
  nb::object features_;         // the extractor of the system, or None
  Priors* priors_ = nullptr;    // the system's
  std::recursive_mutex mutex_;  // of feeding and of what follows; an observer may come back here
  std::int64_t fed_ = 0;
  int bits_ = 0;  // of 16-bit images, 0: not known yet
  std::vector<std::shared_ptr<PythonPipe>> pipes_;
  std::shared_ptr<const GrayImage> left_;   // of the frame being fed
  std::span<const std::uint8_t> segments_;  // given with it
  nb::object callback_;                     // read and written with the GIL
  std::atomic<bool> has_callback_ = false;
  std::unique_ptr<System> system_;
};

int traverse(PyObject* self, visitproc visit, void* arg) {
  Py_VISIT(Py_TYPE(self));
  if (!nb::inst_ready(self)) return 0;
  Py_VISIT(nb::inst_ptr<Slam>(self)->callback().ptr());
  Py_VISIT(nb::inst_ptr<Slam>(self)->features().ptr());
  return 0;
}
int clear(PyObject* self) {
  if (nb::inst_ready(self)) nb::inst_ptr<Slam>(self)->forget_callback();
  return 0;
}
PyType_Slot slam_slots[] = {{Py_tp_traverse, reinterpret_cast<void*>(traverse)},
                            {Py_tp_clear, reinterpret_cast<void*>(clear)},
                            {0, nullptr}};

nb::dict to_dict(const StageTimes& t) {
  nb::dict d;
  d["total"] = t.total;
  d["extract"] = t.extract;
  d["priors"] = t.priors;
  d["stereo"] = t.stereo;
  d["track"] = t.track;
  d["predict"] = t.predict;
  d["local_map"] = t.local_map;
  d["local_mapping"] = t.local_mapping;
  d["local_bundle"] = t.local_bundle;
  d["loop"] = t.loop;
  return d;
}

nb::dict to_dict(const MapSnapshot& s) {
  nb::dict d;
  using K = MapSnapshot::KeyFrame;
  using L = MapSnapshot::Landmark;
  using E = MapSnapshot::Edge;
  d["frames"] = s.frames;
  d["main_submap"] = s.main_submap;
  d["keyframe_ids"] = column<std::uint32_t>(s.keyframes, [](const K& k) { return k.id; });
  d["keyframe_submaps"] = column<std::uint32_t>(s.keyframes, [](const K& k) { return k.submap; });
  d["keyframe_times"] = column<double>(s.keyframes, [](const K& k) { return k.timestamp; });
  d["keyframe_poses"] = poses_to_numpy(s.keyframes, [](const K& k) { return k.T_w_c; });
  std::vector<double> points;
  for (const L& l : s.landmarks) points.insert(points.end(), {l.p_w.x(), l.p_w.y(), l.p_w.z()});
  d["landmark_ids"] = column<std::uint32_t>(s.landmarks, [](const L& l) { return l.id; });
  d["landmark_submaps"] = column<std::uint32_t>(s.landmarks, [](const L& l) { return l.submap; });
  d["landmark_labels"] = column<std::uint16_t>(s.landmarks, [](const L& l) { return l.label; });
  d["landmark_instances"] =
      column<std::int32_t>(s.landmarks, [](const L& l) { return l.instance; });
  d["landmark_beliefs"] = column<float>(s.landmarks, [](const L& l) { return l.belief; });
  d["landmark_observations"] =
      column<std::uint32_t>(s.landmarks, [](const L& l) { return l.observations; });
  d["landmark_points"] = to_numpy(std::move(points), {s.landmarks.size(), 3});
  std::vector<std::uint32_t> edges;
  for (const E& e : s.edges) edges.insert(edges.end(), {e.keyframe, e.other});
  d["edges"] = to_numpy(std::move(edges), {s.edges.size(), 2});
  d["edge_shared"] = column<std::int32_t>(s.edges, [](const E& e) { return e.shared_landmarks; });
  d["edge_tree"] = column<std::uint8_t>(s.edges, [](const E& e) { return e.spanning_tree; });
  d["edge_loop"] = column<std::uint8_t>(s.edges, [](const E& e) { return e.loop; });
  return d;
}

nb::dict to_dict(const RigReport& report) {
  nb::dict d;
  const auto rows = [&](double RowFit::*value) {
    return report.rows ? nb::cast((*report.rows).*value) : nb::none();
  };
  d["corrected"] = report.corrected();
  d["rows_sigma_before"] = rows(&RowFit::sigma_before);
  d["rows_sigma_after"] = rows(&RowFit::sigma_after);
  d["rows_field"] = rows(&RowFit::field);
  const RigEstimate& known = report.known();
  nb::dict parameters;
  for (int k = 0; k < RigCorrection::kSize; ++k) {
    const RigParameterName& name = rig_parameter_names()[static_cast<std::size_t>(k)];
    const double variance = known.covariance(k, k);
    parameters[nb::str(name.name.data(), name.name.size())] = nb::make_tuple(
        known.correction.parameters()[k], variance > 0 ? nb::cast(std::sqrt(variance)) : nb::none(),
        nb::str(name.unit.data(), name.unit.size()));
  }
  d["parameters"] = parameters;
  d["offset_estimate"] = report.offset
                             ? nb::cast(nb::make_tuple(report.offset->value, report.offset->sigma,
                                                       report.offset->applied))
                             : nb::none();
  return d;
}

/// A C++ call without the GIL.
template <typename F>
auto without_gil(F&& f) {
  const nb::gil_scoped_release released;
  return f();
}

/// "true", "1200", "kys": the text of a value.
std::string setting_text(nb::handle value) {
  if (nb::isinstance<nb::bool_>(value)) return nb::cast<bool>(value) ? "true" : "false";
  return nb::cast<std::string>(nb::str(value));
}

void bind_settings(nb::module_& m) {
  nb::class_<Settings>(m, "Settings", "Every setting by dotted name; each has a default.")
      .def(nb::init<>())
      .def(
          "__init__",
          [](Settings* self, const nb::dict& values) {
            Settings settings;
            for (const auto [key, value] : values) {
              settings.set(nb::cast<std::string>(key), setting_text(value));
            }
            new (self) Settings(std::move(settings));
          },
          "values"_a, "From a dict, e.g. {\"orb.features\": 1200, \"kys.mode\": \"kys\"}.")
      .def(
          "__setitem__",
          [](Settings& s, const std::string& key, nb::handle value) {
            s.set(key, setting_text(value));
          },
          "key"_a, "value"_a,
          "Raises InputError naming the unknown key, or the value that is not of its type.")
      .def(
          "__getitem__", [](const Settings& s, const std::string& key) { return s.get(key); },
          "key"_a, "The present value as text.")
      .def("__copy__", [](const Settings& s) { return Settings(s); })
      .def_static("indoor", &Settings::indoor, "Defaults for a drone or hand-held camera indoors.")
      .def("load", &Settings::load, "file"_a, "Reads a YAML file over the present values.")
      .def("get", &Settings::get, "key"_a, "The present value as text.")
      .def("check", &Settings::check, "Raises InputError naming the first that makes no sense.")
      .def("to_yaml", &Settings::to_yaml, "All as annotated YAML that load() reads back.")
      .def(
          "describe",
          [](const Settings& s) {
            nb::list rows;
            for (const auto& d : s.describe()) {
              rows.append(nb::make_tuple(d.key, d.value, d.unit, d.meaning));
            }
            return rows;
          },
          nb::sig("def describe(self) -> list[tuple[str, str, str, str]]"),
          "List of (key, value, unit, meaning).");
}

void bind_report(nb::module_& m) {
  nb::class_<RelativePose>(m, "RelativePose", "Pose of a frame relative to another one.")
      .def_ro("other", &RelativePose::other,
              "index of the other frame; -1: a keyframe of a loaded map")
      .def_prop_ro(
          "pose", [](const RelativePose& p) { return pose_to_numpy(p.T_other_c); },
          nb::rv_policy::move, "(4, 4) left camera to that of the other frame, m")
      .def_prop_ro(
          "covariance", [](const RelativePose& p) { return covariance_to_numpy(p.covariance); },
          nb::rv_policy::move,
          "(6, 6) of the increment [rotation (rad), translation (m)] on the right of `pose`, in "
          "the "
          "frame of this frame's left camera");
  nb::class_<FrameReport>(m, "FrameReport", "What came of one frame.")
      .def_ro("index", &FrameReport::index,
              "number of the frame as it was fed: of a Sequence, its position there")
      .def_ro("name", &FrameReport::name, "as given with the frame")
      .def_ro("timestamp", &FrameReport::timestamp, "s")
      .def_prop_ro(
          "status", [](const FrameReport& r) { return std::string(to_string(r.status)); },
          "\"started\", \"tracked\" or \"lost\"")
      .def_prop_ro(
          "lost", [](const FrameReport& r) { return r.status == FrameStatus::kLost; },
          "whether it has no pose")
      .def_ro("reason", &FrameReport::reason, "why it is lost, or how its pose was predicted")
      .def_ro("warning", &FrameReport::warning,
              "what is wrong with one of the images or the motion, \"\" nothing")
      .def_prop_ro(
          "integrity", [](const FrameReport& r) { return std::string(to_string(r.integrity)); },
          "how far the pose can be relied on: \"ok\", \"degraded\" or \"contradicted\"")
      .def_prop_ro(
          "integrity_reason",
          [](const FrameReport& r) { return std::string(to_string(r.integrity_reason)); },
          "why it is not \"ok\", \"\" it is")
      .def_ro("relocalised", &FrameReport::relocalised,
              "tracking had lost it, but it was recognised in the map")
      .def_ro("submap", &FrameReport::submap,
              "number of the sub-map in whose frame `pose` is, as known when tracked; -1: lost")
      .def_prop_ro(
          "pose", [](const FrameReport& r) { return pose_to_numpy(r.T_w_c); }, nb::rv_policy::move,
          "(4, 4) left camera to world, m, as estimated at this frame; meaningless when lost")
      .def_ro("local", &FrameReport::local,
              "RelativePose to the reference keyframe; None unless tracked")
      .def_ro("motion", &FrameReport::motion,
              "RelativePose to the last frame with a pose; None unless tracked, and after a "
              "relocalisation")
      .def_prop_ro(
          "covariance",
          [](const FrameReport& r) -> std::optional<nb::ndarray<nb::numpy, double>> {
            if (!r.local) return std::nullopt;
            return covariance_to_numpy(r.local->covariance);
          },
          nb::rv_policy::move, "(6, 6) that of `local`, or None")
      .def_prop_ro(
          "motion_covariance",
          [](const FrameReport& r) -> std::optional<nb::ndarray<nb::numpy, double>> {
            if (!r.motion) return std::nullopt;
            return covariance_to_numpy(r.motion->covariance);
          },
          nb::rv_policy::move, "(6, 6) that of `motion`, or None")
      .def_ro("keypoints", &FrameReport::keypoints, "of the left image")
      .def_ro("stereo_matches", &FrameReport::stereo_matches,
              "keypoints with a match in the right image")
      .def_ro("matches", &FrameReport::matches, "landmarks matched")
      .def_ro("inliers", &FrameReport::inliers, "matches that fit the pose")
      .def_ro("keyframe", &FrameReport::keyframe, "whether it became a keyframe")
      .def_ro(
          "segments_of", &FrameReport::segments_of,
          "index of the frame whose segments (add_segments) took effect with this one; -1: none")
      .def_ro("masked", &FrameReport::masked, "keypoints dropped by mode `mask` or by masks")
      .def_ro("prior_coverage", &FrameReport::prior_coverage,
              "0..1, share of keypoints with a valid label")
      .def_prop_ro(
          "times_ms", [](const FrameReport& r) { return to_dict(r.times); },
          "ms per stage; those of the back end are 0 until it has done with the frame")
      .def_prop_ro(
          "loop", [](const FrameReport& r) { return std::string(to_string(r.loop)); },
          "\"\", \"closed\" or \"merged\"; known when the back end has done with the keyframe")
      .def_ro("loop_frame", &FrameReport::loop_frame, "the frame it was closed with, -1: none")
      .def_ro("loop_gap_m", &FrameReport::loop_gap_m, "m, distance by which the loop was open");
}

}  // namespace

void bind_pipe(nb::module_& m) {
  const auto released = nb::call_guard<nb::gil_scoped_release>();
  nb::class_<PythonPipe>(m, "_ObservationPipe", "See python/src/observation_pipe.h.")
      .def(nb::init<int, bool, int>(), "descriptor"_a, "wait"_a, "jpeg_quality"_a)
      .def("finish", &PythonPipe::finish, released)
      .def_prop_ro("broken", &PythonPipe::broken)
      .def_prop_ro("error", &PythonPipe::error)
      .def_prop_ro("skipped", &PythonPipe::skipped);
}

/// Python's handlers of signals wait until a call of the library returns, this one does not.
class SignalGuard {
 public:
  explicit SignalGuard(nb::callable on_interrupt) : on_interrupt_(std::move(on_interrupt)) {
    guard_ = std::make_unique<InterruptGuard>([this] { call(); });
  }
  ~SignalGuard() { close(); }

  [[nodiscard]] bool requested() const { return requested_ || (guard_ && guard_->requested()); }
  void close() {
    if (!guard_) return;
    const nb::gil_scoped_release released;  // its thread may be waiting for it
    requested_ = guard_->requested();
    guard_.reset();
  }

 private:
  void call() const {
    const nb::gil_scoped_acquire acquired;
    try {
      on_interrupt_();
    } catch (nb::python_error& error) {
      error.discard_as_unraisable("interrupt");
    }
  }

  nb::callable on_interrupt_;
  std::unique_ptr<InterruptGuard> guard_;
  bool requested_ = false;
};

void bind_guard(nb::module_& m) {
  nb::class_<SignalGuard>(m, "_InterruptGuard",
                          "Until close(), the first SIGINT, SIGTERM or SIGHUP calls `on_interrupt` "
                          "from a thread of its own, also while the library computes; a second "
                          "SIGINT or SIGTERM ends the program. Ignored signals stay ignored. Then "
                          "the handlers are the system's, not Python's. At most one at a time.")
      .def(nb::init<nb::callable>(), "on_interrupt"_a)
      .def_prop_ro("requested", &SignalGuard::requested, "whether a signal came")
      .def("close", &SignalGuard::close);
}

void bind_system(nb::module_& m) {
  m.def("_label_space_of_priors", &label_space_of_priors, "folder"_a);
  bind_settings(m);
  bind_report(m);
  bind_pipe(m);
  bind_guard(m);
  m.def("check_writable", &check_writable, "file"_a,
        "Raises InputError when the file cannot be written. Leaves no file.");
  nb::class_<Slam>(m, "System", "See kys_slam.System.", nb::type_slots(slam_slots))
      .def(nb::init<const StereoCamera&, const Settings&, const std::string&,
                    const std::optional<std::filesystem::path>&, bool, nb::object>(),
           "camera"_a, "settings"_a, "schedule"_a, "priors"_a.none(), "strict_priors"_a,
           "features"_a.none())
      .def("_feed", &Slam::feed)
      .def("_feed_frame", &Slam::feed_frame)
      .def("_add_segments", &Slam::add_segments, "frame"_a, "map"_a.none(), "segments"_a)
      .def("end_segments", &Slam::end_segments, "No more segments come: nothing is waited for.")
      .def("_set_observer", &Slam::set_observer, "callback"_a.none())
      .def("_add_pipe", &Slam::add_pipe)
      .def("_remove_pipe", &Slam::remove_pipe)
      .def(
          "finish", [](Slam& s) { without_gil([&] { s.system().finish(); }); },
          "Waits for the back end; what follows is final. No frame can be fed afterwards.")
      .def(
          "reports", [](Slam& s) { return without_gil([&] { return s.reports(); }); },
          "FrameReports of all frames fed; what the back end did is complete after finish().")
      .def("_objects",
           [](Slam& s) {
             const auto list = without_gil([&] { return s.system().objects(); });
             using O = ObjectEstimate;
             std::vector<double> positions, velocities;
             for (const O& o : list) {
               positions.insert(positions.end(), o.position.begin(), o.position.end());
               velocities.insert(velocities.end(), o.velocity.begin(), o.velocity.end());
             }
             const std::size_t n = list.size();
             return nb::make_tuple(
                 column<std::int64_t>(list, [](const O& o) { return o.frame; }),
                 column<std::int32_t>(list, [](const O& o) { return o.instance; }),
                 column<std::uint16_t>(list, [](const O& o) { return o.label; }),
                 column<double>(list, [](const O& o) { return o.p_moving; }),
                 to_numpy(std::move(positions), {n, 3}), to_numpy(std::move(velocities), {n, 3}));
           })
      .def(
          "interrupt", [](Slam& s) { s.system().interrupt(); },
          "Requests that running optimisation stops early. From any thread.")
      .def("start_rig", &Slam::start_rig, "file"_a,
           "Before the first frame and any map: begins with the correction of the calibration that "
           "is in the file, as `kys-slam calibrate` writes it.")
      .def(
          "load_map",
          [](Slam& s, const std::filesystem::path& file, bool localize_only) {
            without_gil([&] { s.system().load_map(file, localize_only); });
          },
          "file"_a, "localize_only"_a = false,
          "Before the first frame, once: goes on with a map saved earlier.")
      .def(
          "save_map",
          [](Slam& s, const std::filesystem::path& file) {
            without_gil([&] { s.system().save_map(file); });
          },
          "file"_a, "After finish(): the whole map.")
      .def(
          "_save_map_or_beside",
          [](Slam& s, const std::filesystem::path& file, const std::filesystem::path& output) {
            without_gil([&] { save_map_or_beside(s.system(), file, output); });
          },
          "file"_a, "output"_a, "save_map, or the folder's saved.map when the file is refused.")
      .def("_trajectory",
           [](Slam& s) {
             const auto list = without_gil([&] { return s.system().trajectory(); });
             using E = FrameEstimate;
             return nb::make_tuple(
                 column<double>(list, [](const E& e) { return e.timestamp; }),
                 poses_to_numpy(list, [](const E& e) { return e.T_w_c; }),
                 column<std::uint8_t>(list, [](const E& e) { return e.connected; }),
                 column<std::int64_t>(list, [](const E& e) { return e.submap; }),
                 covariances_to_numpy(list, &E::local), covariances_to_numpy(list, &E::motion));
           })
      .def("_keyframes",
           [](Slam& s) {
             const auto list = without_gil([&] { return s.system().keyframes(); });
             return nb::make_tuple(
                 column<double>(list, [](const TimedPose& p) { return p.timestamp; }),
                 poses_to_numpy(list, [](const TimedPose& p) { return p.T_w_c; }));
           })
      .def(
          "landmarks",
          [](Slam& s) {
            const auto points = without_gil([&] { return s.system().landmarks(); });
            std::vector<double> values;
            for (const Eigen::Vector3d& p : points)
              values.insert(values.end(), {p.x(), p.y(), p.z()});
            return to_numpy(std::move(values), {points.size(), 3});
          },
          "(N, 3) float64, m: landmarks of the sub-map the trajectory is expressed in.")
      .def("_snapshot",
           [](Slam& s) { return to_dict(without_gil([&] { return s.system().snapshot(); })); })
      .def("_rig", [](Slam& s) { return to_dict(without_gil([&] { return s.system().rig(); })); })
      .def_prop_ro(
          "submaps", [](Slam& s) { return without_gil([&] { return s.system().submaps(); }); },
          "number of sub-maps that were never connected")
      .def_prop_ro("settings", [](Slam& s) { return Settings(s.settings()); })
      .def("_write_run",
           [](Slam& s, const std::filesystem::path& folder, const std::string& sequence,
              const std::optional<std::tuple<Times, Poses>>& truth, double start_up_s,
              double wall_s, double cpu_s, const std::string& end_reason,
              const std::map<std::string, std::int64_t>& left_out,
              const std::vector<std::string>& warnings, const std::string& recording) {
             RunInfo info;
             info.sequence = sequence;
             info.recording = recording;
             info.start_up_s = start_up_s;
             info.wall_s = wall_s;
             info.cpu_s = cpu_s;
             info.complete = end_reason.empty();
             info.end_reason = end_reason;
             info.left_out = left_out;
             info.warnings = warnings;
             if (truth) info.ground_truth = to_poses(std::get<0>(*truth), std::get<1>(*truth));
             return s.write_run(folder, std::move(info));
           });
}

}  // namespace kys_slam
