// SPDX-License-Identifier: BSD-3-Clause
#include <kys/error.h>
#include <kys_slam/error.h>
#include <kys_slam/logic_error.h>
#include <nanobind/nanobind.h>

#include "arrays.h"
#include "bind.h"

namespace kys_slam {

ImageView view_of(const AnyArray& array, const char* what, bool bgr) {
  const bool byte = array.dtype() == nb::dtype<std::uint8_t>();
  const bool word = array.dtype() == nb::dtype<std::uint16_t>();
  if (!byte && !word) {
    throw nb::type_error((std::string(what) + ": pixels must be uint8 or uint16").c_str());
  }
  const std::size_t channels = array.ndim() == 3 ? array.shape(2) : 1;
  if (array.ndim() < 2 || array.ndim() > 3 || (channels != 1 && !(channels == 3 && byte))) {
    throw InputError(std::string(what) +
                     ": shape must be (H, W), or (H, W, 3) of uint8; these are " +
                     std::to_string(array.ndim()) + " dimensions" +
                     (array.ndim() == 3 ? ", " + std::to_string(channels) + " channels" : ""));
  }
  if (array.shape(0) == 0 || array.shape(1) == 0 || array.shape(0) > 16384 ||
      array.shape(1) > 16384) {
    throw InputError(std::string(what) + ": sides must be 1 to 16384 px");
  }
  const auto item = static_cast<std::ptrdiff_t>(array.itemsize());
  ImageView view;
  view.data = array.data();
  view.height = static_cast<int>(array.shape(0));
  view.width = static_cast<int>(array.shape(1));
  view.row_step = array.stride(0) * item;
  view.pixel_step = array.stride(1) * item;
  if (channels == 3) {
    view.channel_step = array.stride(2) * item;
    view.format = bgr ? PixelFormat::kBgr8 : PixelFormat::kRgb8;
  } else {
    view.format = word ? PixelFormat::kGray16 : PixelFormat::kGray8;
  }
  return view;
}

}  // namespace kys_slam

NB_MODULE(_core, m) {
  using namespace kys_slam;
  m.doc() = "KYS-SLAM: the C++ library as Python sees it. Use the package kys_slam.";
  m.attr("__version__") = KYS_SLAM_VERSION;
  static nb::exception<InputError> input_error(m, "InputError", PyExc_ValueError);
  static nb::exception<LogicError> logic_error(m, "LogicError", PyExc_RuntimeError);
  input_error.attr("__doc__") =
      "An input that is wrong: a file, an array, a setting; one line says what.";
  logic_error.attr("__doc__") = "A call that makes no sense now, e.g. feed() after finish().";
  nb::register_exception_translator([](const std::exception_ptr& p, void*) {
    try {
      std::rethrow_exception(p);
    } catch (const kys::Error& error) {
      PyErr_SetString(input_error.ptr(), error.what());
    }
  });
  bind_camera(m);
  bind_evaluation(m);
  bind_matching(m);
  bind_sequence(m);
  bind_system(m);
  bind_features(m);
}
