// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/common/feature_options.h"

namespace kys_slam::simulator {

void describe(kys::OptionList& list, FeatureOptions& o) {
  list.add("--camera", o.camera, "kitti, euroc or auto");
  list.add("--start", o.start, {0, 1e9});
  list.add("--frames", o.frames, {-1, 1e9});
  list.add("--every", o.every, {1, 1e9});
  list.add("--features", o.features, {0, 20000});
  list.add("--pixel-noise", o.pixel_noise, {0, 20}, "px");
  list.add("--wander", o.wander, {0, 20}, "px");
  list.add("--lens", o.lens, {0, 20}, "px");
  list.add("--bit-noise", o.bit_noise, {0, 0.5});
  list.add("--outliers", o.outliers, {0, 0.9});
  list.add("--dropout", o.dropout, {0, 0.9});
  list.add("--repeats", o.repeats, {0, 1});
  list.add("--rate", o.rate, {1e-3, 1e4}, "Hz");
  list.add("--frame-rate", o.frame_rate, {1e-3, 1e4}, "Hz");
  list.add("--near", o.near, {0, 1e4}, "m");
  list.add("--far", o.far, {0, 1e4}, "m");
  list.add("--width", o.width, {0, 2000}, "px");
  list.require(o.camera == "auto" || o.camera == "kitti" || o.camera == "euroc",
               "--camera must be auto, kitti or euroc");
  list.require(o.frames != 0, "--frames must be at least 1");
  list.require(o.features == 0 || o.features >= 50, "--features must be between 50 and 20000");
  list.require(o.width == 0 || o.width >= 200, "--width must be between 200 and 2000");
  const auto sensible = [](double depth) { return depth == 0 || depth >= 0.1; };
  list.require(sensible(o.near) && sensible(o.far), "--near, --far must be between 0.1 and 10000");
  list.require(o.near == 0 || o.far == 0 || o.near < o.far, "--near must be less than --far");
}

bool has_traffic(const FeatureOptions& options) {
  return options.traffic != Traffic::kNone || !options.objects.empty();
}

}  // namespace kys_slam::simulator
