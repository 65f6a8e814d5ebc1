// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/common/rig_error.h"

#include <kys_slam/check_options.h>
#include <kys_slam/options_file.h>
#include <kys_slam/util/parse_number.h>

#include <cmath>
#include <string_view>

#include "simulator/common/rng.h"

namespace kys_slam::simulator {
namespace {

void describe_lens(kys::OptionList& list, const std::string& side, std::array<double, 4>& lens) {
  list.add(side + ".k1", lens[0], {-0.1, 0.1}, "", "radial distortion, r^2");
  list.add(side + ".k2", lens[1], {-0.1, 0.1}, "", "radial distortion, r^4");
  list.add(side + ".p1", lens[2], {-0.03, 0.03}, "", "tangential distortion");
  list.add(side + ".p2", lens[3], {-0.03, 0.03}, "", "tangential distortion");
}

/// Sets the right principal point so that the centre of the image, at infinity, is displaced by
/// (u, v) px, whatever yaw and pitch are.
void hold_centre(RigError& error, const StereoCamera& given, double u, double v) {
  error.cx = error.cy = 0;
  constexpr double kInfinity = 1e12;  // m
  const Eigen::Vector4d centre = TruePair(given, error).observe({0, 0, kInfinity});
  error.cx = u - (centre[2] - centre[0]);
  error.cy = v - (centre[3] - centre[1]);
}

// The focal ratio, k1, p2 and the sizes of yaw and cx were measured; their signs, roll and cy are
// those with which the field of vertical differences is the measured one (README).
RigError kitti_error(const StereoCamera& given) {
  constexpr double kFocal = 718.856;  // px, of the images in which it was measured
  RigError error;
  error.focal = 0.991;
  error.left[0] = error.right[0] = 0.011;
  error.right[3] = -0.0069;
  error.yaw = -17.6 / kFocal;
  error.roll = 0.0005;
  error.focal_ratio = 1.0011;
  error.cx = -17 * given.fx / kFocal;
  error.cy = 0.15 * given.fy / kFocal;
  return error;
}

RigError random_error(std::uint64_t seed, const StereoCamera& given) {
  constexpr double kRadial = 0.008, kCommon = 0.7, kTangential = 0.0015, kTurn = 0.002;
  Rng rng(hash_of(seed, 31));
  const auto draw = [&](double sigma) { return sigma * rng.gaussian(); };
  RigError error;
  error.left[0] = draw(kRadial);
  error.right[0] = kCommon * error.left[0] + draw(kRadial * std::sqrt(1 - kCommon * kCommon));
  for (const std::size_t i : {2, 3}) {
    error.left[i] = draw(kTangential);
    error.right[i] = draw(kTangential);
  }
  error.yaw = draw(kTurn);
  error.pitch = draw(kTurn);
  error.roll = draw(kTurn);
  error.focal_ratio = 1 + draw(0.0008);
  error.focal = 1 + draw(0.004);
  error.baseline_y = draw(0.003);
  error.baseline_z = draw(0.003);
  const double u = draw(0.3), v = draw(0.5);
  hold_centre(error, given, u, v);
  return error;
}

std::string with_unit(const kys::Option& option) {
  return (option.unit.empty() ? "" : std::string(option.unit) + ", ") + std::string(option.meaning);
}

}  // namespace

void describe(kys::OptionList& list, RigError& e) {
  list.add("focal", e.focal, {0.8, 1.25}, "",
           "true focal lengths / given ones; the true baseline is the given one / this");
  describe_lens(list, "left", e.left);
  describe_lens(list, "right", e.right);
  list.add("right.yaw", e.yaw, {-0.1, 0.1}, "rad", "R_left_right = Ry(yaw) Rx(pitch) Rz(roll)");
  list.add("right.pitch", e.pitch, {-0.1, 0.1}, "rad", "as above");
  list.add("right.roll", e.roll, {-0.1, 0.1}, "rad", "as above");
  list.add("right.focal_ratio", e.focal_ratio, {0.9, 1.1}, "", "right focal lengths / left ones");
  list.add("right.cx", e.cx, {-200, 200}, "px", "added to the right principal point");
  list.add("right.cy", e.cy, {-200, 200}, "px", "as above");
  list.add("right.baseline_y", e.baseline_y, {-0.2, 0.2}, "",
           "position of the right camera, y / x, in the left camera's axes");
  list.add("right.baseline_z", e.baseline_z, {-0.2, 0.2}, "", "z / x");
}

RigError make_rig_error(const std::string& text, const StereoCamera& given) {
  constexpr std::string_view kRandom = "random:";
  if (text == "kitti") return kitti_error(given);
  if (text.starts_with(kRandom)) {
    const auto seed = parse_int(std::string_view(text).substr(kRandom.size()));
    if (!seed || *seed < 0) throw InputError(text + ": random:N needs a whole number, at least 0");
    return random_error(static_cast<std::uint64_t>(*seed), given);
  }
  RigError error;
  load_options_file(text, error);
  return error;
}

std::string to_yaml(const RigError& error) {
  RigError copy = error;
  kys::OptionList list;
  describe(list, copy);
  std::string text = "# How the true cameras differ from the calibration of this sequence.\n";
  std::string section;
  for (const kys::Option& option : list.options()) {
    const std::size_t dot = option.key.find('.');
    const std::string head = dot == std::string::npos ? "" : option.key.substr(0, dot);
    if (head != section) text += head + ":\n";
    section = head;
    const std::string name = dot == std::string::npos ? option.key : option.key.substr(dot + 1);
    text += (head.empty() ? "" : "  ") + name + ": " + option.text() + "  # " + with_unit(option) +
            "\n";
  }
  return text;
}

TruePair::TruePair(const StereoCamera& given, const RigError& error)
    : given_(given), baseline_y_(error.baseline_y), baseline_z_(error.baseline_z) {
  check_options(error);
  left_ = {given.fx * error.focal, given.fy * error.focal, given.cx, given.cy, error.left};
  right_ = {left_.f_x * error.focal_ratio, left_.f_y * error.focal_ratio, given.cx + error.cx,
            given.cy + error.cy, error.right};
  const Eigen::Quaterniond turn = Eigen::AngleAxisd(error.yaw, Eigen::Vector3d::UnitY()) *
                                  Eigen::AngleAxisd(error.pitch, Eigen::Vector3d::UnitX()) *
                                  Eigen::AngleAxisd(error.roll, Eigen::Vector3d::UnitZ());
  T_left_right_ =
      Rigid3(turn, given.baseline / error.focal * Eigen::Vector3d(1, baseline_y_, baseline_z_));
  if (!left_.is_invertible(given.width, given.height) ||
      !right_.is_invertible(given.width, given.height)) {
    throw InputError("--rig-error: the distortion is too strong for the field of view");
  }
}

Eigen::Vector4d TruePair::observe(const Eigen::Vector3d& p_c) const {
  const Eigen::Vector3d p_r =
      T_left_right_.rotation.conjugate() * (p_c - T_left_right_.translation);
  Eigen::Vector4d pixels;
  pixels << left_.project(p_c.x() / p_c.z(), p_c.y() / p_c.z()),
      right_.project(p_r.x() / p_r.z(), p_r.y() / p_r.z());
  return pixels;
}

Eigen::Vector2d TruePair::right_ray(double u, double v) const {
  return (T_left_right_.rotation * right_.ray(u, v).homogeneous()).hnormalized();
}

Eigen::Vector2d TruePair::left_ideal(double u, double v) const {
  return given_.project(left_.ray(u, v).homogeneous());
}

Eigen::Vector2d TruePair::right_ideal_far(double u, double v) const {
  return given_.project(right_ray(u, v).homogeneous());
}

TruePair::IdealPair TruePair::pair_ideal(double u, double v, double u_right, double v_right) const {
  const Eigen::Vector2d l = left_.ray(u, v);
  const Eigen::Vector2d r = right_ray(u_right, v_right);
  // The point is Z (l, 1) = b (1, baseline_y, baseline_z) + s (r, 1); b / Z from x and z.
  const double q = (l.x() - r.x()) / (1 - r.x() * baseline_z_);
  const double y_from_right = baseline_y_ * q + (1 - baseline_z_ * q) * r.y();
  const Eigen::Vector2d ideal = given_.project(l.homogeneous());
  const double inverse_depth = q / T_left_right_.translation.x();
  return {ideal.x(), ideal.y(), ideal.x() - given_.bf() * inverse_depth,
          given_.fy * (y_from_right - l.y())};
}

}  // namespace kys_slam::simulator
