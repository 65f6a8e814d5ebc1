// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/frame_input.h>
#include <kys_slam/image_file.h>
#include <kys_slam/image_pair.h>
#include <kys_slam/prior_writer.h>
#include <kys_slam/read_ahead.h>
#include <kys_slam/settings.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cstring>
#include <fstream>
#include <memory>
#include <span>

#include "arrays.h"
#include "bind.h"

namespace kys_slam {

using namespace nb::literals;

namespace {

/// A frame input with its frames read ahead.
struct Input {
  explicit Input(FrameInput given) : input(std::move(given)) {}

  std::optional<StereoFrame> next() {
    const nb::gil_scoped_release released;
    if (!ahead) ahead = std::make_unique<ReadAhead>(*input.frames);
    return ahead->next();
  }

  FrameInput input;
  std::unique_ptr<ReadAhead> ahead;  // joins before `input` goes
};

SequenceOptions part(std::int64_t start, std::optional<std::int64_t> frames, double tolerance) {
  SequenceOptions options;
  options.start = start;
  options.frames = frames;
  options.pairing_tolerance = tolerance;
  return options;
}

nb::object image_of(nb::handle frame, const GrayImage& image) {
  if (image.empty()) return nb::none();
  return nb::cast(nb::ndarray<nb::numpy, const std::uint8_t>(
      image.data(),
      {static_cast<std::size_t>(image.height()), static_cast<std::size_t>(image.width())}, frame));
}

/// One camera of a prior file as Python gives it.
CameraPriors camera_priors(const nb::dict& camera) {
  using Map = nb::ndarray<const std::uint16_t, nb::ndim<2>, nb::device::cpu, nb::c_contig>;
  using Motion = nb::ndarray<const float, nb::ndim<2>, nb::device::cpu, nb::c_contig>;
  CameraPriors priors;
  const auto map = nb::cast<Map>(camera["segment_map"]);
  if (map.shape(0) < 1 || map.shape(1) < 1 || map.shape(0) > 16384 || map.shape(1) > 16384) {
    throw InputError("segment_map: sides must be 1 to 16384 px");
  }
  const int width = static_cast<int>(map.shape(1)), height = static_cast<int>(map.shape(0));
  priors.segment_map = ImageOf<std::uint16_t>(width, height);
  std::memcpy(priors.segment_map.data(), map.data(), map.nbytes());
  if (!camera["motion"].is_none()) {
    const auto motion = nb::cast<Motion>(camera["motion"]);
    if (motion.shape(0) != map.shape(0) || motion.shape(1) != map.shape(1)) {
      throw InputError("motion and segment_map differ in size");
    }
    priors.motion = ImageOf<float>(width, height);
    std::memcpy(priors.motion.data(), motion.data(), motion.nbytes());
  }
  for (const nb::handle row : camera["segments"]) {
    PriorSegment segment;
    segment.label = nb::cast<std::uint16_t>(row[0]);
    segment.flags = nb::cast<std::uint16_t>(row[1]);
    segment.instance = nb::cast<std::int32_t>(row[2]);
    segment.scale = nb::cast<float>(row[3]);
    segment.score = nb::cast<float>(row[4]);
    priors.segments.push_back(segment);
  }
  return priors;
}

nb::bytes encode(const std::string& label_space, const std::vector<nb::dict>& cameras,
                 std::uint64_t calibration_hash, std::uint64_t content_key, bool has_motion,
                 bool shares_instances) {
  FramePriors frame;
  frame.label_space = label_space;
  frame.calibration_hash = calibration_hash;
  frame.content_key = content_key;
  frame.has_motion = has_motion;
  frame.shares_instances = shares_instances;
  for (const nb::dict& camera : cameras) frame.cameras.push_back(camera_priors(camera));
  std::vector<std::uint8_t> bytes;
  {
    const nb::gil_scoped_release released;
    bytes = encode_priors(frame, "priors");
  }
  return nb::bytes(bytes.data(), bytes.size());
}

nb::list rows_of(const std::vector<PriorSegment>& segments) {
  nb::list rows;
  for (const PriorSegment& s : segments) {
    rows.append(nb::make_tuple(s.label, s.flags, s.instance, s.scale, s.score, s.area));
  }
  return rows;
}

PriorFile parse(const nb::bytes& data, const std::string& name) {
  const auto* begin = static_cast<const std::uint8_t*>(data.data());
  return PriorFile::parse({begin, begin + data.size()}, name);
}

/// Widens boxes (x0, y0, x1, y1 per segment, ends exclusive) by the segments of row `y`.
void widen_boxes(std::span<const std::uint16_t> row, int y, std::vector<int>& boxes) {
  const int width = static_cast<int>(row.size());
  for (int x = 0, end = 0; x < width; x = end) {
    for (end = x + 1; end < width && row[end] == row[x];) ++end;
    if (row[x] == 0) continue;
    int* box = boxes.data() + 4 * (row[x] - 1);
    const bool first = box[3] == 0;
    box[0] = first ? x : std::min(box[0], x);
    if (first) box[1] = y;
    box[2] = std::max(box[2], end);
    box[3] = y + 1;
  }
}

/// What is drawn of the left camera: segments, which of them each pixel is, and their boxes.
nb::dict left_segments(const nb::bytes& data, const std::string& name) {
  const PriorFile file = parse(data, name);
  const std::vector<PriorSegment>& segments = file.segments(CameraSide::kLeft);
  const auto w = static_cast<std::size_t>(file.width()),
             h = static_cast<std::size_t>(file.height());
  std::vector<std::uint16_t> map(w * h);
  std::vector<float> motion(w);  // not used
  std::vector<int> boxes(4 * segments.size(), 0);
  for (std::size_t y = 0; y < h; ++y) {
    const std::span row(map.data() + y * w, w);
    file.expand_row(CameraSide::kLeft, static_cast<int>(y), row, motion);
    widen_boxes(row, static_cast<int>(y), boxes);
  }
  nb::dict d;
  d["segments"] = rows_of(segments);
  d["segment_map"] = to_numpy(std::move(map), {h, w});
  d["boxes"] = to_numpy(std::move(boxes), {segments.size(), 4});
  return d;
}

nb::dict decode(const nb::bytes& data, const std::string& name) {
  const PriorFile file = parse(data, name);
  FramePriors frame = decode_priors(file);
  nb::list cameras;
  const auto w = static_cast<std::size_t>(file.width()),
             h = static_cast<std::size_t>(file.height());
  for (CameraPriors& camera : frame.cameras) {
    const auto* map = camera.segment_map.data();
    nb::dict d;
    d["segments"] = rows_of(camera.segments);
    d["segment_map"] = to_numpy(std::vector<std::uint16_t>(map, map + w * h), {h, w});
    std::vector<float> motion(w * h, 0.0F);
    if (!camera.motion.empty()) motion.assign(camera.motion.data(), camera.motion.data() + w * h);
    d["motion"] = to_numpy(std::move(motion), {h, w});
    cameras.append(d);
  }
  nb::dict result;
  result["label_space"] = frame.label_space;
  result["calibration_hash"] = frame.calibration_hash;
  result["content_key"] = frame.content_key;
  result["has_motion"] = frame.has_motion;
  result["shares_instances"] = frame.shares_instances;
  result["cameras"] = cameras;
  return result;
}

}  // namespace

void bind_sequence(nb::module_& m) {
  nb::class_<StereoFrame>(m, "StereoFrame", "A rectified stereo pair, or features in its place.")
      .def_ro("index", &StereoFrame::index, "position in the sequence, from 0")
      .def_ro("name", &StereoFrame::name, "stem of the left image's file name; \"\": none")
      .def_ro("timestamp", &StereoFrame::timestamp, "s")
      .def_prop_ro(
          "left",
          [](nb::handle_t<StereoFrame> self) {
            return image_of(self, nb::cast<const StereoFrame&>(self).left);
          },
          nb::for_getter(nb::sig("def left(self) -> numpy.typing.NDArray[numpy.uint8] | None")),
          "(H, W) uint8; None when the frame has features")
      .def_prop_ro(
          "right",
          [](nb::handle_t<StereoFrame> self) {
            return image_of(self, nb::cast<const StereoFrame&>(self).right);
          },
          nb::for_getter(nb::sig("def right(self) -> numpy.typing.NDArray[numpy.uint8] | None")),
          "(H, W) uint8; None when the frame has features");

  nb::class_<Input>(m, "Sequence", "Recorded stereo frames, in order: iterate over it once.")
      .def_prop_ro(
          "name", [](const Input& s) { return s.input.name; }, "of its folder or file")
      .def_prop_ro(
          "layout", [](const Input& s) { return s.input.layout; },
          "\"KITTI odometry\", \"KITTI Tracking\", \"Virtual KITTI 2\", \"EuRoC\", \"TUM-VI\", "
          "\"image pair\", \"features\"")
      .def_prop_ro(
          "recording", [](const Input& s) { return s.input.recording; },
          "tells recordings of one name apart: \"frame I: DIGEST\" of the first frame; \"\": not "
          "known")
      .def_prop_ro(
          "camera", [](const Input& s) { return s.input.frames->camera(); }, "the rectified pair")
      .def_prop_ro(
          "has_images", [](const Input& s) { return s.input.has_images; },
          "False: feature files, whose frames hold keypoints")
      .def_prop_ro(
          "label_space", [](const Input& s) { return s.input.label_space; },
          "of the priors in a feature file; \"\": the recording has none of its own")
      .def_prop_ro(
          "paired_by_time",
          [](const Input& s) {
            const auto* sequence = dynamic_cast<const Sequence*>(s.input.frames.get());
            return sequence != nullptr && sequence->paired_by_time();
          },
          "whether left and right images are pairs by their time stamps, with the tolerance, and "
          "not by number")
      .def_prop_ro(
          "ground_truth",
          [](const Input& s) -> nb::object {
            const auto& truth = s.input.ground_truth;
            if (truth.empty()) return nb::none();
            return nb::make_tuple(
                column<double>(truth, [](const TimedPose& p) { return p.timestamp; }),
                poses_to_numpy(truth, [](const TimedPose& p) { return p.T_w_c; }));
          },
          nb::for_getter(nb::sig("def ground_truth(self) -> tuple[numpy.typing.NDArray["
                                 "numpy.float64], numpy.typing.NDArray[numpy.float64]] | None")),
          "Times (N,) s and poses (N, 4, 4) of the left camera; None: the sequence has none.")
      .def_prop_ro(
          "dropped",
          [](const Input& s) {
            const auto* sequence = dynamic_cast<const Sequence*>(s.input.frames.get());
            return sequence == nullptr ? 0 : sequence->dropped();
          },
          "Images without a partner in the other camera.")
      .def_prop_ro(
          "counts", [](const Input& s) { return s.input.left_out; },
          "Images that were left out, by why.")
      .def_prop_ro(
          "notes", [](const Input& s) { return s.input.notes; },
          "Warnings for the user about how the images are read.")
      .def("__len__", [](const Input& s) { return s.input.frames->size().value_or(0); })
      .def(
          "read",
          [](const Input& s, std::int64_t position) {
            const auto* sequence = dynamic_cast<const Sequence*>(s.input.frames.get());
            if (sequence == nullptr)
              throw InputError("frames of a feature file come in order only");
            if (position < 0 || position >= sequence->frame_count()) {
              throw nb::index_error("no such frame");
            }
            const nb::gil_scoped_release released;
            return sequence->read(position);
          },
          "position"_a, "The frame at a position, 0 to len - 1; from any thread.")
      .def(
          "left_file",
          [](const Input& s, std::int64_t index) -> std::optional<std::filesystem::path> {
            const auto* sequence = dynamic_cast<const Sequence*>(s.input.frames.get());
            const Sequence::Frame* frame = sequence != nullptr ? sequence->find(index) : nullptr;
            if (frame == nullptr) return std::nullopt;
            return frame->left;
          },
          "index"_a,
          "The file of the left image of the frame of this index (StereoFrame.index), as it is; "
          "None: there is none.")
      .def_prop_ro(
          "rectifier",
          [](const Input& s) -> const StereoRectifier* {
            const auto* sequence = dynamic_cast<const Sequence*>(s.input.frames.get());
            return sequence != nullptr ? sequence->rectifier() : nullptr;
          },
          nb::rv_policy::reference_internal,
          nb::for_getter(nb::sig("def rectifier(self) -> StereoRectifier | None")),
          "What images of the files go through; None: they are rectified.")
      .def(
          "check_features",
          [](const Input& s, const Settings& settings) {
            check_features(s.input, settings, s.input.name);
          },
          "settings"_a,
          "Raises InputError when features have other octaves, or priors of another label space, "
          "than the settings say.")
      .def(
          "__iter__", [](nb::handle self) { return nb::borrow(self); },
          nb::sig("def __iter__(self) -> collections.abc.Iterator[StereoFrame]"))
      .def("__next__", [](Input& s) {
        std::optional<StereoFrame> frame = s.next();
        if (!frame) throw nb::stop_iteration();
        return std::move(*frame);
      });

  m.def(
      "open_sequence",
      [](const std::filesystem::path& path, std::int64_t start, std::optional<std::int64_t> frames,
         double pairing_tolerance, const std::string& pair) {
        SequenceOptions options = part(start, frames, pairing_tolerance);
        options.pair = parse_camera_pair(pair);
        return Input(open_frame_input(path, options));
      },
      "path"_a, "start"_a = 0, "frames"_a = nb::none(), "pairing_tolerance"_a = 0.003,
      "pair"_a = "",
      "Opens a sequence folder of any known layout, or a feature file. `pair`: of KITTI odometry, "
      "\"grey\" (image_0, image_1) or \"colour\" (image_2, image_3); \"\": the first there is.");
  m.def(
      "open_image_pair",
      [](const std::filesystem::path& left, const std::filesystem::path& right,
         const StereoRig& rig, std::int64_t start, std::optional<std::int64_t> frames,
         double pairing_tolerance, std::optional<double> rate, const std::filesystem::path& times) {
        ImagePairOptions options;
        options.part = part(start, frames, pairing_tolerance);
        options.rate = rate;
        options.times = times;
        return Input(frame_input_of(open_image_pair(left, right, rig, options), start));
      },
      "left"_a, "right"_a, "rig"_a, "start"_a = 0, "frames"_a = nb::none(),
      "pairing_tolerance"_a = 0.003, "rate"_a = nb::none(), "times"_a = "",
      "Opens the images of two folders. `rate`: frames per second, for names that are no time "
      "stamps; `times`: a file with one stamp per image; not both. Names of 13 digits or more "
      "are time stamps. Stamps are in the unit (in a file s, else ms, us, ns) in which images are "
      "1 ms "
      "to 10 s apart. `pairing_tolerance`: s, of names that are stamps.");

  m.def(
      "decode_gray",
      [](const nb::bytes& data, const std::string& name) {
        const std::span<const std::uint8_t> bytes(static_cast<const std::uint8_t*>(data.data()),
                                                  data.size());
        return image_to_numpy(decode_gray(bytes, name));
      },
      "data"_a, "name"_a, "PNG or JPEG bytes as (H, W) uint8 grey. `name` starts messages.");
  m.def(
      "decode_image",
      [](const nb::bytes& data, const std::string& name) -> nb::object {
        const std::span<const std::uint8_t> bytes(static_cast<const std::uint8_t*>(data.data()),
                                                  data.size());
        const ImageInfo info = decode_image_info(bytes, name);
        if (info.bits != 16 || info.channels != 1) {
          return nb::cast(image_to_numpy(decode_gray(bytes, name)));
        }
        const Image16 image = decode_u16(bytes, name);
        return nb::cast(to_numpy(
            std::vector<std::uint16_t>(image.data(), image.data() + image.size()),
            {static_cast<std::size_t>(image.height()), static_cast<std::size_t>(image.width())}));
      },
      "data"_a, "name"_a,
      nb::sig("def decode_image(data: bytes, name: str) -> numpy.typing.NDArray[numpy.uint8] | "
              "numpy.typing.NDArray[numpy.uint16]"),
      "PNG or JPEG bytes as (H, W) grey: uint16 of a 16-bit grey PNG, else uint8. `name` starts "
      "messages.");
  m.def(
      "read_indexed",
      [](const std::filesystem::path& path) { return image_to_numpy(read_indexed(path)); },
      "path"_a, "The values of an indexed or 8-bit grey PNG, (H, W) uint8.");
  m.def("_encode_priors", &encode, "label_space"_a, "cameras"_a, "calibration_hash"_a,
        "content_key"_a, "has_motion"_a, "shares_instances"_a);
  m.def("_left_segments", &left_segments, "data"_a, "name"_a);
  m.def("_decode_priors", &decode, "data"_a, "name"_a);
}

}  // namespace kys_slam
