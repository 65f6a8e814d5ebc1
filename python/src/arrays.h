// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/error.h>
#include <kys_slam/frame_source.h>
#include <kys_slam/image_view.h>
#include <kys_slam/rigid3.h>
#include <kys_slam/trajectory_file.h>
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cmath>
#include <cstddef>
#include <initializer_list>
#include <string>
#include <utility>
#include <vector>

/// NumPy arrays in and out.
namespace kys_slam {

namespace nb = nanobind;

/// Any array in memory of the host, read only.
using AnyArray = nb::ndarray<nb::ro, nb::device::cpu>;

/// An array that owns `values`.
template <typename T>
nb::ndarray<nb::numpy, T> to_numpy(std::vector<T> values,
                                   std::initializer_list<std::size_t> shape) {
  auto* kept = new std::vector<T>(std::move(values));
  nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
  return nb::ndarray<nb::numpy, T>(kept->data(), shape, owner);
}

/// (H, W) array that owns the image.
inline nb::ndarray<nb::numpy, std::uint8_t> image_to_numpy(GrayImage image) {
  auto* kept = new GrayImage(std::move(image));
  nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<GrayImage*>(p); });
  return nb::ndarray<nb::numpy, std::uint8_t>(
      kept->data(),
      {static_cast<std::size_t>(kept->height()), static_cast<std::size_t>(kept->width())}, owner);
}

/// Appends the 16 numbers of a 4x4 matrix.
inline void append_matrix(const Rigid3& T, std::vector<double>& values) {
  const Eigen::Matrix<double, 3, 4> M = T.matrix();
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 4; ++j) values.push_back(M(i, j));
  }
  values.insert(values.end(), {0, 0, 0, 1});
}

inline nb::ndarray<nb::numpy, double> pose_to_numpy(const Rigid3& T) {
  std::vector<double> values;
  append_matrix(T, values);
  return to_numpy(std::move(values), {4, 4});
}

/// (6, 6) array.
inline nb::ndarray<nb::numpy, double> covariance_to_numpy(const Eigen::Matrix<double, 6, 6>& C) {
  return to_numpy(std::vector<double>(C.data(), C.data() + C.size()), {6, 6});  // symmetric
}

/// (N, 4, 4) array of the poses of all items.
template <typename List, typename Pose>
nb::ndarray<nb::numpy, double> poses_to_numpy(const List& list, Pose&& pose_of) {
  std::vector<double> values;
  values.reserve(16 * list.size());
  for (const auto& item : list) append_matrix(pose_of(item), values);
  return to_numpy(std::move(values), {list.size(), 4, 4});
}

/// (N,) array of one number per item.
template <typename T, typename List, typename Value>
nb::ndarray<nb::numpy, T> column(const List& list, Value&& value_of) {
  std::vector<T> values;
  values.reserve(list.size());
  for (const auto& item : list) values.push_back(static_cast<T>(value_of(item)));
  const std::size_t n = values.size();
  return to_numpy(std::move(values), {n});
}

/// Times (N,), s, and poses (N, 4, 4).
using Times = nb::ndarray<const double, nb::ndim<1>, nb::device::cpu, nb::c_contig>;
using Poses = nb::ndarray<const double, nb::shape<-1, 4, 4>, nb::device::cpu, nb::c_contig>;

/// \throws InputError when they differ in length, are not finite or are not rigid transformations.
inline std::vector<TimedPose> to_poses(const Times& times, const Poses& poses) {
  if (times.shape(0) != poses.shape(0)) {
    throw InputError(std::to_string(times.shape(0)) + " time stamps, but " +
                     std::to_string(poses.shape(0)) + " poses");
  }
  std::vector<TimedPose> result;
  for (std::size_t i = 0; i < times.shape(0); ++i) {
    const double t = times.data()[i];
    const auto T = rigid_from_row_major(poses.data() + 16 * i);
    if (!T) throw InputError("pose " + std::to_string(i) + " is not a rigid transformation");
    if (!std::isfinite(t) || (i > 0 && t < result.back().timestamp)) {
      throw InputError("time stamp " + std::to_string(i) + " is not finite or decreases");
    }
    result.push_back({t, *T});
  }
  return result;
}

/// A view of the pixels of an array, without a copy.
/// \param bgr true: three channels are in the order blue, green, red
/// \throws nb::type_error for other types than uint8 and uint16, InputError for other shapes than
///   (H, W), (H, W, 1) and, with uint8, (H, W, 3).
ImageView view_of(const AnyArray& array, const char* what, bool bgr);

}  // namespace kys_slam
