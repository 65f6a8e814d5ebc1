// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/error.h>
#include <kys_slam/stereo_rectifier.h>
#include <kys_slam/util/memory_limit.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "camera/bouguet.h"
#include "camera/lens.h"
#include "camera/plausible.h"

namespace kys_slam {

/// For every pixel of the result, where it comes from: the offset of the upper left of four source
/// pixels, and the weights of the right and lower ones in 1/32. One core does a 752x480 image in
/// 0.8 ms; cv::remap needs 1.2 ms and, by default, threads.
struct StereoRectifier::Maps {
  int width = 0;   // of raw and rectified images
  int height = 0;  //
  std::vector<std::int32_t> offset;
  std::vector<std::uint16_t> weights;  // right | lower << 8

  /// \param source gives the raw pixel of a rectified one (u, v), if there is one
  /// \throws InputError with this message where there is none
  template <typename Source>
  Maps(int w, int h, const Source& source, const std::string& message)
      : width(w), height(h), offset(static_cast<std::size_t>(w) * h), weights(offset.size()) {
    for (int v = 0; v < height; ++v) {
      for (int u = 0; u < width; ++u) {
        const std::optional<Eigen::Vector2d> from = source(u, v);
        if (!from || !from->allFinite()) throw InputError(message);
        const auto [column, right] = split(static_cast<float>(from->x()), width);
        const auto [row, lower] = split(static_cast<float>(from->y()), height);
        const std::size_t i = static_cast<std::size_t>(v) * width + u;
        offset[i] = row * width + column;
        weights[i] = static_cast<std::uint16_t>(right | lower << 8);
      }
    }
  }

  /// Integer part and 1/32 of a coordinate; what lies outside takes the border's value.
  static std::pair<int, int> split(float coordinate, int size) {
    const double inside = std::clamp<double>(coordinate, 0.0, size - 1.0);
    const int fixed = static_cast<int>(std::lround(inside * 32.0));
    const int whole = std::min(fixed / 32, size - 2);
    return {whole, fixed - whole * 32};
  }

  [[nodiscard]] GrayImage apply(const GrayImage& raw) const {
    if (raw.width() != width || raw.height() != height) {
      throw InputError("raw image of another size than its calibration");
    }
    GrayImage rectified(width, height);
    const std::uint8_t* in = raw.data();
    std::uint8_t* out = rectified.data();
    const std::size_t count = offset.size();
    for (std::size_t i = 0; i < count; ++i) {
      const std::uint8_t* upper = in + offset[i];
      const std::uint8_t* under = upper + width;
      const unsigned right = weights[i] & 0xffU;
      const unsigned lower = weights[i] >> 8U;
      const unsigned top = upper[0] * (32 - right) + upper[1] * right;
      const unsigned bottom = under[0] * (32 - right) + under[1] * right;
      out[i] = static_cast<std::uint8_t>((top * (32 - lower) + bottom * lower + 512) >> 10U);
    }
    return rectified;
  }

  [[nodiscard]] ImageOf<std::uint16_t> nearest(const ImageOf<std::uint16_t>& raw) const {
    if (raw.width() != width || raw.height() != height) {
      throw InputError("a map of a raw image of another size than its calibration");
    }
    ImageOf<std::uint16_t> rectified(width, height);
    for (std::size_t i = 0; i < offset.size(); ++i) {
      const int right = (weights[i] & 0xffU) >= 16 ? 1 : 0;
      const int lower = (weights[i] >> 8U) >= 16 ? width : 0;
      rectified.data()[i] = raw.data()[offset[i] + right + lower];
    }
    return rectified;
  }
};

namespace {

void check(const RawCamera& camera, const std::string& name) {
  const auto& d = camera.distortion;
  const bool finite = std::isfinite(camera.cx) && std::isfinite(camera.cy) &&
                      camera.T_b_s.is_finite() &&
                      std::all_of(d.begin(), d.end(), [](double k) { return std::isfinite(k); });
  if (!finite || !std::isfinite(camera.fx) || !std::isfinite(camera.fy) || camera.fx <= 0 ||
      camera.fy <= 0 || camera.width < 2 || camera.height < 2) {
    throw InputError(name + ": calibration with non-finite or non-positive numbers");
  }
  if (camera.lens == LensModel::kEquidistant) {
    if (d.size() != 4) throw InputError(name + ": equidistant distortion needs 4 coefficients");
  } else if (!d.empty() && d.size() != 4 && d.size() != 5 && d.size() != 8) {
    throw InputError(name + ": radial-tangential distortion needs 4, 5 or 8 coefficients");
  }
}

/// A raw camera as it is seen from the rectified frame.
struct RectifiedView {
  const RawCamera* raw;
  Eigen::Matrix3d R_raw_rectified;

  [[nodiscard]] std::optional<Eigen::Vector2d> source(double u, double v,
                                                      const RectifiedIntrinsics& k) const {
    const Eigen::Vector3d ray((u - k.cx) / k.f, (v - k.cy) / k.f, 1);
    return project(*raw, R_raw_rectified * ray);
  }
  /// Whether the rectified image of this focal length has its whole border inside the raw image.
  [[nodiscard]] bool covers(double f) const {
    const RectifiedIntrinsics k{f, 0.5 * (raw->width - 1), 0.5 * (raw->height - 1)};
    const auto inside = [&](double u, double v) {
      const auto p = source(u, v, k);
      return p && p->x() >= 0 && p->y() >= 0 && p->x() <= raw->width - 1 &&
             p->y() <= raw->height - 1;
    };
    for (int u = 0; u < raw->width; ++u) {
      if (!inside(u, 0) || !inside(u, raw->height - 1)) return false;
    }
    for (int v = 0; v < raw->height; ++v) {
      if (!inside(0, v) || !inside(raw->width - 1, v)) return false;
    }
    return true;
  }
};

/// The smallest focal length (px) that both views cover, to 1e-6.
double common_focal_length(const RectifiedView& left, const RectifiedView& right,
                           const std::string& name) {
  double low = 0.05 * left.raw->fx, high = 20 * left.raw->fx;
  const auto good = [&](double f) { return left.covers(f) && right.covers(f); };
  if (!good(high)) throw InputError(name + ": the cameras do not look the same way");
  for (int i = 0; i < 60 && high - low > 1e-6; ++i) {
    const double middle = 0.5 * (low + high);
    (good(middle) ? high : low) = middle;
  }
  return high;
}

constexpr auto kNotSideBySide = ": the cameras cannot be rectified (is cam1 to the right of cam0?)";

/// T_right_left, rounded to 1e-9 (rad, m): the formats of calibration files give one rig as
/// different products of matrices, which differ in the last bits; the rectified images should not.
Rigid3 left_to_right(const RawCamera& left, const RawCamera& right) {
  const Rigid3 T_r_l = right.T_b_s.inverse() * left.T_b_s;
  const auto round = [](double value) { return std::round(value * 1e9) * 1e-9 + 0.0; };
  return {Eigen::Matrix3d(T_r_l.R().unaryExpr(round)), T_r_l.t().unaryExpr(round)};
}

}  // namespace

StereoRectifier::StereoRectifier(const RawCamera& left, const RawCamera& right,
                                 const std::string& name) {
  check(left, name);
  check(right, name);
  if (left.width != right.width || left.height != right.height) {
    throw InputError(name + ": the two cameras have different resolutions");
  }
  if (left.lens != right.lens) throw InputError(name + ": the two cameras have different lenses");
  constexpr std::size_t kBytesPerPixel = 12;  // both tables
  check_memory(name, kBytesPerPixel * static_cast<std::size_t>(left.width) *
                         static_cast<std::size_t>(left.height));
  const Rigid3 T_r_l = left_to_right(left, right);
  const auto found = rectifying_rotations(T_r_l);
  if (!found) throw InputError(name + kNotSideBySide);
  const RectifyingRotations& turns = *found;
  const RectifiedView views[2] = {{&left, turns.R_rectified_raw[0].transpose()},
                                  {&right, turns.R_rectified_raw[1].transpose()}};
  RectifiedIntrinsics k{0, 0.5 * (left.width - 1), 0.5 * (left.height - 1)};
  if (left.lens == LensModel::kEquidistant) {
    k.f = common_focal_length(views[0], views[1], name);
  } else {
    k = fitting_intrinsics(left, right, turns);
  }
  camera_.width = left.width;
  camera_.height = left.height;
  camera_.fx = camera_.fy = k.f;
  camera_.cx = k.cx;
  camera_.cy = k.cy;
  camera_.baseline = -turns.shift.x();
  if (!camera_.is_valid()) throw InputError(name + kNotSideBySide);
  require_plausible(camera_, name);
  for (std::size_t i = 0; i < 2; ++i) {
    const auto source = [&](int u, int v) { return views[i].source(u, v, k); };
    maps_[i] =
        std::make_unique<Maps>(left.width, left.height, source, name + ": absurd distortion");
  }
  T_b_c_ = left.T_b_s * Rigid3(views[0].R_raw_rectified, Eigen::Vector3d::Zero());
}

StereoRectifier::StereoRectifier(const StereoCamera& given, const RigCorrection& correction,
                                 const std::string& name)
    : camera_(given) {
  const Eigen::Vector3d along(1, correction[RigParameter::kBaselineY],
                              correction[RigParameter::kBaselineZ]);
  camera_.baseline = given.baseline * along.norm() / correction.focal_scale();
  Eigen::Matrix3d R;  // from the given left camera, with the least turn about the baseline
  R.row(0) = along.normalized();
  R.row(1) = Eigen::Vector3d::UnitZ().cross(along).normalized();
  R.row(2) = R.row(0).cross(R.row(1));
  T_b_c_ = Rigid3(Eigen::Matrix3d(R.transpose()), Eigen::Vector3d::Zero());
  for (const bool is_left : {true, false}) {
    const auto source = [&](int u, int v) {
      const Eigen::Vector3d ray =
          R.transpose() * Eigen::Vector3d((u - given.cx) / given.fx, (v - given.cy) / given.fy, 1);
      const Eigen::Vector2d ideal = given.project(ray);
      return std::optional<Eigen::Vector2d>(
          is_left ? correction.measured_left(ideal.x(), ideal.y())
                  : correction.measured_right(ideal.x(), ideal.y(), ideal.x()));
    };
    maps_[is_left ? 0 : 1] =
        std::make_unique<Maps>(given.width, given.height, source, name + ": an absurd correction");
  }
}

StereoRectifier::StereoRectifier(StereoRectifier&&) noexcept = default;
StereoRectifier& StereoRectifier::operator=(StereoRectifier&&) noexcept = default;
StereoRectifier::~StereoRectifier() = default;

GrayImage StereoRectifier::rectify_left(const GrayImage& raw) const {
  return maps_[0]->apply(raw);
}

GrayImage StereoRectifier::rectify_right(const GrayImage& raw) const {
  return maps_[1]->apply(raw);
}

ImageOf<std::uint16_t> StereoRectifier::rectify_left_map(const ImageOf<std::uint16_t>& raw) const {
  return maps_[0]->nearest(raw);
}

}  // namespace kys_slam
