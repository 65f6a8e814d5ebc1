// SPDX-License-Identifier: BSD-3-Clause
#include "priors/builder/seeded_flow.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "priors/builder/estimators.h"

namespace kys_slam {
namespace {

constexpr int kCoarse = 2;               // halvings of the image, of the flow that gives the motion
constexpr float kLeastDisparity = 0.5F;  // px, where a row has none
constexpr int kFinestWidth = 640;        // px, of the images that the flow is refined on, about

/// Values of a row that are not numbers become those of the side with the smaller `key`.
void fill_row(const float* key, int width, std::vector<int>& source) {
  int last = -1;
  for (int x = 0; x < width; ++x) {
    if (key[x] == key[x]) last = x;
    source[static_cast<std::size_t>(x)] = last;
  }
  int next = -1;
  for (int x = width - 1; x >= 0; --x) {
    if (key[x] == key[x]) next = x;
    int& from = source[static_cast<std::size_t>(x)];
    if (from < 0 || (next >= 0 && key[next] < key[from])) from = next;
  }
}

FlowField empty_flow(int width, int height) {
  return {ImageOf<float>(width, height), ImageOf<float>(width, height)};
}

}  // namespace

ImageOf<float> fill_disparity(const ImageOf<float>& disparity, float least) {
  ImageOf<float> filled(disparity.width(), disparity.height());
  std::vector<int> source(static_cast<std::size_t>(disparity.width()));
  for (int y = 0; y < disparity.height(); ++y) {
    const float* row = disparity.row(y);
    fill_row(row, disparity.width(), source);
    for (int x = 0; x < disparity.width(); ++x) {
      const int from = source[static_cast<std::size_t>(x)];
      filled.at(x, y) = from < 0 ? least : row[from];
    }
  }
  return filled;
}

FlowField static_flow(const EgoMotion& motion, const InverseDepth& inverse_depth,
                      const ImageOf<float>& disparity, float limit) {
  const int width = disparity.width();
  FlowField flow = empty_flow(width, disparity.height());
  std::vector<float> rho(static_cast<std::size_t>(width));
  for (int y = 0; y < disparity.height(); ++y) {
    for (int x = 0; x < width; ++x) {
      rho[static_cast<std::size_t>(x)] = inverse_depth(disparity.at(x, y));
    }
    float *u = flow.u.row(y), *v = flow.v.row(y);
    motion.predict_row(y, rho.data(), u, v);
    for (int x = 0; x < width; ++x) {
      if (!(std::abs(u[x]) <= limit && std::abs(v[x]) <= limit)) u[x] = v[x] = 0;
    }
  }
  return flow;
}

FlowField reverse_flow(const FlowField& forward, const ImageOf<float>& disparity) {
  const int width = disparity.width(), height = disparity.height();
  FlowField back = empty_flow(width, height);
  ImageOf<float> nearest(width, height);
  for (int y = 0; y < height; ++y) std::fill_n(nearest.row(y), width, kNoValue);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const float u = forward.u.at(x, y), v = forward.v.at(x, y);
      const auto tx = static_cast<int>(std::lround(static_cast<float>(x) + u));
      const auto ty = static_cast<int>(std::lround(static_cast<float>(y) + v));
      if (tx < 0 || ty < 0 || tx >= width || ty >= height) continue;
      float& there = nearest.at(tx, ty);
      if (there >= disparity.at(x, y)) continue;
      there = disparity.at(x, y);
      back.u.at(tx, ty) = -u;
      back.v.at(tx, ty) = -v;
    }
  }
  std::vector<int> source(static_cast<std::size_t>(width));
  for (int y = 0; y < height; ++y) {
    fill_row(nearest.row(y), width, source);
    for (int x = 0; x < width; ++x) {
      const int from = source[static_cast<std::size_t>(x)];
      if (from < 0 || from == x) continue;
      back.u.at(x, y) = back.u.at(from, y);
      back.v.at(x, y) = back.v.at(from, y);
    }
  }
  return back;
}

FlowField estimate_checked_flow(const BuilderOptions& options, const StereoCamera& camera,
                                const GrayImage& now, const GrayImage& next,
                                const ImageOf<float>& disparity,
                                const ImageOf<std::uint16_t>& segment_map,
                                const std::vector<std::uint8_t>& is_stuff) {
  int finest = options.flow_estimate.finest_level;
  if (finest < 0) finest = now.width() > 3 * kFinestWidth / 2 ? 1 : 0;
  std::optional<EgoMotion> motion;
  const InverseDepth inverse_depth(camera.bf(), options.depth.max_depth);
  if (options.flow_estimate.seeded && !disparity.empty()) {
    const FlowField coarse = estimate_flow(now, next, std::max(kCoarse, finest), nullptr);
    motion = fit_ego_motion(options.ego_motion, camera, coarse, disparity, inverse_depth,
                            segment_map, is_stuff);
  }
  FlowField seed, back_seed;
  if (motion) {
    const ImageOf<float> filled = fill_disparity(disparity, kLeastDisparity);
    seed = static_flow(*motion, inverse_depth, filled, static_cast<float>(now.width()) / 2);
    if (options.flow_check.enabled) back_seed = reverse_flow(seed, filled);
  }
  FlowField flow = estimate_flow(now, next, finest, motion ? &seed : nullptr);
  if (options.flow_check.enabled) {
    check_forward_backward(flow, estimate_flow(next, now, finest, motion ? &back_seed : nullptr),
                           options.flow_check.tolerance, options.flow_check.relative_tolerance);
  }
  return flow;
}

}  // namespace kys_slam
