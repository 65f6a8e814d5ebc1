// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/common/euroc_rig.h"

#include <cstdio>

namespace kys_slam::simulator {
namespace {

struct Calibration {
  double f_u, f_v, c_u, c_v;
  std::array<double, 4> distortion;
  double T_BS[12];  ///< rows of [R|t]
};

const Calibration& calibration(int camera) {
  static const Calibration cameras[2] = {
      {458.654,
       457.296,
       367.215,
       248.375,
       {-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05},
       {0.0148655429818, -0.999880929698, 0.00414029679422, -0.0216401454975, 0.999557249008,
        0.0149672133247, 0.025715529948, -0.064676986768, -0.0257744366974, 0.00375618835797,
        0.999660727178, 0.00981073058949}},
      {457.587,
       456.134,
       379.999,
       255.238,
       {-0.28368365, 0.07451284, -0.00010473, -3.55590700e-05},
       {0.0125552670891, -0.999755099723, 0.0182237714554, -0.0198435579556, 0.999598781151,
        0.0130119051815, 0.0251588363115, 0.0453689425024, -0.0253898008918, 0.0179005838253,
        0.999517347078, 0.00786212447038}}};
  return cameras[camera];
}

}  // namespace

Lens euroc_lens(int camera, int width, int height) {
  const Calibration& k = calibration(camera);
  const double sx = static_cast<double>(width) / kEurocWidth;
  const double sy = static_cast<double>(height) / kEurocHeight;
  return {k.f_u * sx, k.f_v * sy, (k.c_u + 0.5) * sx - 0.5, (k.c_v + 0.5) * sy - 0.5, k.distortion};
}

StereoRectifier euroc_rectifier(int width, int height) {
  RawCamera raw[2];
  for (int i = 0; i < 2; ++i) {
    const Lens k = euroc_lens(i, width, height);
    raw[i] = {width,
              height,
              k.f_x,
              k.f_y,
              k.c_x,
              k.c_y,
              std::vector<double>(k.distortion.begin(), k.distortion.end()),
              euroc_extrinsics(i)};
  }
  return {raw[0], raw[1], "EuRoC calibration"};
}

Rigid3 euroc_extrinsics(int camera) {
  const double* m = calibration(camera).T_BS;
  Eigen::Matrix3d R;
  R << m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10];
  return {R, Eigen::Vector3d(m[3], m[7], m[11])};
}

std::string euroc_sensor_yaml(int camera, int width, int height) {
  const Calibration& k = calibration(camera);
  const Lens s = euroc_lens(camera, width, height);
  const double* m = k.T_BS;
  char text[1600];
  std::snprintf(text, sizeof text,
                "%%YAML:1.0\n# General sensor definitions.\nsensor_type: camera\n"
                "comment: simulated cam%d\n\n# Sensor extrinsics wrt. the body-frame.\nT_BS:\n"
                "  cols: 4\n  rows: 4\n"
                "  data: [%.12g, %.12g, %.12g, %.12g,\n         %.12g, %.12g, %.12g, %.12g,\n"
                "         %.12g, %.12g, %.12g, %.12g,\n         0.0, 0.0, 0.0, 1.0]\n\n"
                "# Camera specific definitions.\nrate_hz: 20\nresolution: [%d, %d]\n"
                "camera_model: pinhole\n"
                "intrinsics: [%.9g, %.9g, %.9g, %.9g] #fu, fv, cu, cv\n"
                "distortion_model: radial-tangential\n"
                "distortion_coefficients: [%.9g, %.9g, %.9g, %.9g]\n",
                camera, m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8], m[9], m[10], m[11],
                width, height, s.f_x, s.f_y, s.c_x, s.c_y, k.distortion[0], k.distortion[1],
                k.distortion[2], k.distortion[3]);
  return text;
}

}  // namespace kys_slam::simulator
