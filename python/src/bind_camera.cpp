// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/calibration_hash.h>
#include <kys_slam/check_pair.h>
#include <kys_slam/pair_watch.h>
#include <kys_slam/rig_file.h>
#include <kys_slam/row_field.h>
#include <kys_slam/same_image.h>
#include <kys_slam/stereo_rig.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "arrays.h"
#include "bind.h"

namespace kys_slam {

using namespace nb::literals;

namespace {

nb::ndarray<nb::numpy, std::uint8_t> rectify(const StereoRectifier& rectifier, const AnyArray& raw,
                                             bool bgr, int bits, bool left) {
  ImageView view = view_of(raw, "image", bgr);
  view.bits = bits;
  GrayImage result;
  {
    const nb::gil_scoped_release released;
    const GrayImage gray = to_gray(view);
    result = left ? rectifier.rectify_left(gray) : rectifier.rectify_right(gray);
  }
  return image_to_numpy(std::move(result));
}

/// \throws nb::cast_error for values of other types or out of range
CameraInfo camera_info_of(const nb::dict& d) {
  CameraInfo info;
  info.width = nb::cast<int>(d["width"]);
  info.height = nb::cast<int>(d["height"]);
  info.distortion_model = nb::cast<std::string>(d["distortion_model"]);
  info.D = nb::cast<std::vector<double>>(d["D"]);
  info.K = nb::cast<std::array<double, 9>>(d["K"]);
  info.R = nb::cast<std::array<double, 9>>(d["R"]);
  info.P = nb::cast<std::array<double, 12>>(d["P"]);
  const auto number = [&](const char* key) { return d.contains(key) ? nb::cast<int>(d[key]) : 0; };
  info.binning_x = number("binning_x");
  info.binning_y = number("binning_y");
  if (!d.contains("roi")) return info;
  const auto roi = nb::cast<std::array<int, 4>>(d["roi"]);
  info.roi = {roi[0], roi[1], roi[2], roi[3]};
  return info;
}

std::string describe(const StereoCamera& c) {
  char text[200];
  std::snprintf(text, sizeof text,
                "StereoCamera(width=%d, height=%d, fx=%.10g, fy=%.10g, cx=%.10g, cy=%.10g, "
                "baseline=%.10g)",
                c.width, c.height, c.fx, c.fy, c.cx, c.cy, c.baseline);
  return text;
}

/// (rows, columns) of one value of the cells.
template <typename T>
nb::ndarray<nb::numpy, T> cells_of(const RowField& field, T RowField::Cell::*value) {
  std::vector<T> values;
  for (const auto& row : field.cells) {
    for (const RowField::Cell& cell : row) values.push_back(cell.*value);
  }
  return to_numpy(std::move(values), {RowField::kRows, RowField::kColumns});
}

nb::ndarray<nb::numpy, float> matches_of(const RowField& field) {
  std::vector<float> values;
  for (const RowObservation& match : field.matches) {
    const RigCorrection::Measured& m = match.measured;
    values.insert(values.end(), {m.u, m.v, m.u_right, m.v_right});
  }
  return to_numpy(std::move(values), {field.matches.size(), 4});
}

const char* verdict_of(const RowField& field) {
  switch (field.verdict()) {
    case RowVerdict::kRectified:
      return "rectified";
    case RowVerdict::kUnrectified:
      return "not rectified";
    case RowVerdict::kUnknown:
      break;
  }
  return "unknown";
}

void bind_rows(nb::module_& m) {
  nb::class_<RowField>(m, "RowField",
                       "Differences of rows, right less left, over the left image. Cells are of "
                       "equal size, the first one is top left.")
      .def_ro("pairs", &RowField::pairs)
      .def_ro("stereo_matches", &RowField::stereo_matches, "also those without a measured row")
      .def_prop_ro(
          "matches", [](const RowField& f) { return matches_of(f); }, nb::rv_policy::move,
          "(N, 4) float32: u, v in the left, u, v in the right image, px")
      .def_prop_ro(
          "counts", [](const RowField& f) { return cells_of(f, &RowField::Cell::matches); },
          nb::rv_policy::move, "(4, 6) matches per cell")
      .def_prop_ro(
          "medians", [](const RowField& f) { return cells_of(f, &RowField::Cell::median); },
          nb::rv_policy::move, "(4, 6) float64, px; NaN: fewer than 8 matches")
      .def_prop_ro(
          "medians_after",
          [](const RowField& f) { return cells_of(f, &RowField::Cell::median_after); },
          nb::rv_policy::move, "(4, 6) float64, px: what the fitted correction leaves")
      .def_prop_ro(
          "sigma_before", [](const RowField& f) { return f.fit.sigma_before; },
          "px, robust standard deviation of the differences")
      .def_prop_ro(
          "sigma_after", [](const RowField& f) { return f.fit.sigma_after; },
          "px, the same with the fitted correction")
      .def_prop_ro(
          "field", [](const RowField& f) { return f.fit.field; },
          "px, root mean square of what the correction changes in rows")
      .def_prop_ro("largest", &RowField::largest, "px, largest absolute median of the cells")
      .def_prop_ro("largest_after", &RowField::largest_after, "px, the same with the correction")
      .def_prop_ro("verdict", &verdict_of, "\"rectified\", \"not rectified\" or \"unknown\"")
      .def(
          "__str__", [](const RowField& f) { return f.describe(); },
          "The verdict in one line, with its figure.");
  nb::class_<RowMeter>(m, "RowMeter",
                       "Measures the rows of stereo matches in pairs of one camera, to show how "
                       "well they are rectified. The pairs may show anything with texture.")
      .def(
          "__init__",
          [](RowMeter* self, const StereoCamera& camera,
             const std::optional<std::filesystem::path>& correction) {
            if (correction) {
              new (self) RowMeter(camera, read_rig_correction(*correction, camera));
            } else {
              new (self) RowMeter(camera);
            }
          },
          "camera"_a, "correction"_a = nb::none(),
          "`correction`: a calibration file with a correction of the camera's calibration, which "
          "is "
          "applied; what it leaves is measured.")
      .def(
          "add",
          [](RowMeter& meter, const AnyArray& left, const AnyArray& right, bool bgr) {
            const ImageView l = view_of(left, "left image", bgr);
            const ImageView r = view_of(right, "right image", bgr);
            const nb::gil_scoped_release released;
            meter.add(to_gray(l), to_gray(r));
          },
          "left"_a, "right"_a, nb::kw_only(), "bgr"_a = false,
          "A rectified pair of the camera's size; about 100 ms.")
      .def("field", &RowMeter::field, nb::call_guard<nb::gil_scoped_release>(),
           "The RowField of all pairs so far.");
}

}  // namespace

void bind_camera(nb::module_& m) {
  nb::class_<StereoCamera>(
      m, "StereoCamera",
      "A rectified stereo pair: two pinhole cameras with equal intrinsics, the "
      "right one `baseline` metres to the right of the left one.")
      .def(
          "__init__",
          [](StereoCamera* self, int width, int height, double fx, double fy, double cx, double cy,
             double baseline) {
            const StereoCamera camera{width, height, fx, fy, cx, cy, baseline};
            if (!camera.is_valid()) throw InputError("the camera's calibration makes no sense");
            new (self) StereoCamera(camera);
          },
          "width"_a, "height"_a, "fx"_a, "fy"_a, "cx"_a, "cy"_a, "baseline"_a,
          "width, height, fx, fy, cx, cy in px (integer coordinates are pixel centres), baseline "
          "in "
          "m.")
      .def_ro("width", &StereoCamera::width, "px")
      .def_ro("height", &StereoCamera::height, "px")
      .def_ro("fx", &StereoCamera::fx, "px")
      .def_ro("fy", &StereoCamera::fy, "px")
      .def_ro("cx", &StereoCamera::cx, "px")
      .def_ro("cy", &StereoCamera::cy, "px")
      .def_ro("baseline", &StereoCamera::baseline, "m")
      .def("calibration_hash", &calibration_hash,
           "Identifies the calibration in prior files; never 0.")
      .def(
          "__eq__", [](const StereoCamera& a, const StereoCamera& b) { return a == b; },
          nb::sig("def __eq__(self, other: object, /) -> bool"), nb::is_operator())
      .def("__repr__", &describe);

  nb::class_<StereoRig>(m, "StereoRig", "Two raw cameras and where they are to each other.")
      .def_ro("name", &StereoRig::name, "the calibration file")
      .def_prop_ro("baseline", &StereoRig::baseline, "m")
      .def_prop_ro(
          "size", [](const StereoRig& r) { return nb::make_tuple(r.left.width, r.left.height); },
          nb::for_getter(nb::sig("def size(self) -> tuple[int, int]")),
          "(width, height) of the raw images, px; (0, 0): the file does not say")
      .def("set_image_size", &StereoRig::set_image_size, "width"_a, "height"_a,
           "Raises InputError when the calibration was made for another image size, or when the "
           "baseline is not between 5 mm and 5 m.")
      .def("check_baseline", &StereoRig::check_baseline,
           "Raises InputError when the baseline is not between 5 mm and 5 m.")
      .def("rectified", &StereoRig::rectified,
           "The StereoCamera when the images need no rectification, else None.")
      .def(
          "to_yaml", [](const StereoRig& r) { return to_yaml(r); },
          "The rig as own YAML, lengths in m, which read_stereo_rig reads. Raises InputError when "
          "the size of the images is not known.");

  m.def(
      "read_stereo_rig",
      [](const std::vector<std::filesystem::path>& files, double unit) {
        return read_stereo_rig(files, unit);
      },
      "files"_a, "unit"_a = 1.0,
      "Reads a stereo calibration: Kalibr camchain, OpenCV stereoCalibrate, own YAML (one file), "
      "or "
      "ROS camera_info of both cameras (two files: left, right). `unit`: m per unit of length in "
      "the file (0.001 for mm).");
  m.def(
      "has_rig_correction",
      [](const std::filesystem::path& file) { return read_correction_file(file).has_value(); },
      "file"_a,
      "Whether a calibration file has a correction in it (`kys-slam calibrate`). Raises InputError "
      "when it is damaged.");
  m.def(
      "rig_from_camera_info",
      [](const std::vector<nb::dict>& infos, const std::string& name,
         const std::array<int, 2>& size) {
        if (infos.size() != 2) throw InputError(name + ": camera_info of two cameras is needed");
        try {
          const CameraInfo left = camera_info_of(infos[0]), right = camera_info_of(infos[1]);
          return rig_from_camera_info(left, right, name, size[0], size[1]);
        } catch (const nb::cast_error&) {
          throw InputError(name + ": camera_info with numbers out of range");
        }
      },
      "infos"_a, "name"_a, "size"_a = std::array<int, 2>{0, 0},
      "A rig from two dicts with the fields of ROS's CameraInfo: width, height, distortion_model, "
      "D, "
      "K, R, P; binning_x, binning_y and roi (x_offset, y_offset, width, height) if there are any. "
      "Left first. `size`: (width, height) of the images, px, which tells whether a driver has "
      "applied binning and roi to K.");

  nb::class_<StereoRectifier>(m, "StereoRectifier",
                              "Turns raw images of two cameras into a rectified pair.")
      .def(
          "__init__",
          [](StereoRectifier* self, const StereoRig& rig) {
            new (self) StereoRectifier(rig.left, rig.right, rig.name);
          },
          "rig"_a)
      .def_prop_ro("camera", &StereoRectifier::camera, "the rectified pair")
      .def(
          "rectify_left",
          [](const StereoRectifier& r, const AnyArray& image, bool bgr, int bits) {
            return rectify(r, image, bgr, bits, true);
          },
          "image"_a, nb::kw_only(), "bgr"_a = false, "bits"_a = 16,
          "(H, W) or (H, W, 3) uint8, or (H, W) uint16 of which `bits` bits are used, to (H, W) "
          "uint8.")
      .def(
          "rectify_right",
          [](const StereoRectifier& r, const AnyArray& image, bool bgr, int bits) {
            return rectify(r, image, bgr, bits, false);
          },
          "image"_a, nb::kw_only(), "bgr"_a = false, "bits"_a = 16, "As rectify_left.");

  nb::class_<PairCheck>(m, "PairCheck", "What matches say about a stereo pair.")
      .def_ro("matches", &PairCheck::matches, "features found in both images")
      .def_ro("row_offset", &PairCheck::row_offset, "px, median of right row - left row")
      .def_ro("row_spread", &PairCheck::row_spread, "px")
      .def_ro("backward_share", &PairCheck::backward_share, "of matches with disparity < -2 px")
      .def_ro("median_disparity", &PairCheck::median_disparity, "px")
      .def_ro("problem", &PairCheck::problem, "one sentence, or \"\"");
  m.def(
      "check_stereo_pair",
      [](const AnyArray& left, const AnyArray& right, bool bgr) {
        const ImageView l = view_of(left, "left image", bgr);
        const ImageView r = view_of(right, "right image", bgr);
        const nb::gil_scoped_release released;
        return check_stereo_pair(to_gray(l), to_gray(r));
      },
      "left"_a, "right"_a, nb::kw_only(), "bgr"_a = false,
      "Says whether two images that should be a rectified pair are swapped or not rectified.");
  m.def(
      "is_same_image",
      [](const AnyArray& left, const AnyArray& right) {
        const ImageView l = view_of(left, "left image", false);
        const ImageView r = view_of(right, "right image", false);
        const nb::gil_scoped_release released;
        return is_same_image(to_gray(l), to_gray(r));
      },
      "left"_a, "right"_a, "Whether two images are the same, also when one was encoded again.");
  nb::class_<PairHistory>(
      m, "PairHistory",
      "Compares some pairs of a drive; reports when left and right image do not "
      "belong together: swapped, not rectified, not of the same moment.")
      .def(nb::init<>())
      .def("count_frame", &PairHistory::count_frame,
           "The next frame; whether its pair is to be compared.")
      .def(
          "check",
          [](PairHistory& history, const AnyArray& left, const AnyArray& right, std::int64_t index,
             bool bgr) {
            const ImageView l = view_of(left, "left image", bgr);
            const ImageView r = view_of(right, "right image", bgr);
            const nb::gil_scoped_release released;
            history.check(to_gray(l), to_gray(r), index);
          },
          "left"_a, "right"_a, "index"_a, nb::kw_only(), "bgr"_a = false,
          "The pair of that frame; about 20 ms.")
      .def("finish", &PairHistory::finish, "No more frames: what few pairs showed counts.")
      .def_prop_ro("warning", &PairHistory::warning, "What is wrong, or \"\".");
  bind_rows(m);
  m.def(
      "to_gray",
      [](const AnyArray& image, bool bgr, int bits) {
        ImageView view = view_of(image, "image", bgr);
        view.bits = bits;
        return image_to_numpy(to_gray(view));
      },
      "image"_a, nb::kw_only(), "bgr"_a = false, "bits"_a = 16,
      "(H, W) or (H, W, 3) uint8, or (H, W) uint16 of which `bits` bits are used (the upper 8 of "
      "them count), as (H, W) uint8 grey.");
  m.def(
      "used_bits", [](const AnyArray& image) { return used_bits(view_of(image, "image", false)); },
      "image"_a,
      "Bits that a uint16 image uses, by its largest pixel: 8, 10, 12, 14 or 16; 0: black, or "
      "uint8.");
  m.def("note_of_bits", &note_of_bits, "bits"_a,
        "A warning for the user about images that use this many of 16 bits, or \"\".");
}

}  // namespace kys_slam
