// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/images/segments.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "simulator/common/coco_classes.h"
#include "simulator/common/rng.h"

namespace kys_slam::simulator {

std::vector<bool> moving_objects(const World& world, int frame) {
  const int count = static_cast<int>(world.times.size());
  std::vector<bool> moving(world.scene.objects.size(), false);
  if (count < 2) return moving;
  const int a = std::min(frame, count - 2);
  const auto now = instance_poses(world, a);
  const auto next = instance_poses(world, a + 1);
  for (std::size_t i = 0; i < now.size(); ++i) {
    const double shift = (now[i].t() - next[i].t()).norm();
    if (shift > 1e-3 || now[i].rotation.angularDistance(next[i].rotation) > 1e-3) {
      moving[static_cast<std::size_t>(world.scene.instances[i].object)] = true;
    }
  }
  return moving;
}

Panoptic make_panoptic(const World& world, const ViewTruth& truth, int frame, int camera,
                       const std::vector<bool>& moving) {
  const int width = truth.instance.width();
  const int height = truth.instance.height();
  // Key: things by object (positive), stuff by category (negative). Ordered, hence reproducible.
  std::map<int, Segment> found;
  const auto key_of = [&](int instance) {
    if (instance < 0) return -static_cast<int>(kSky);
    const int object = world.scene.instances[static_cast<std::size_t>(instance)].object;
    const int category = world.scene.objects[static_cast<std::size_t>(object)].category;
    if (category == kUnlabelled) return 0;
    return coco_is_thing(category) ? object + 1 : -category;
  };
  std::vector<int> keys(world.scene.instances.size() + 1);
  for (std::size_t i = 0; i < keys.size(); ++i) keys[i] = key_of(static_cast<int>(i) - 1);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const int key = keys[static_cast<std::size_t>(truth.instance.at(x, y)) + 1];
      if (key == 0) continue;
      Segment& s = found[key];
      if (s.area == 0) {
        s.object = key > 0 ? key - 1 : -1;
        s.category =
            key > 0 ? world.scene.objects[static_cast<std::size_t>(key - 1)].category : -key;
        s.moving = key > 0 && moving[static_cast<std::size_t>(key - 1)];
        s.x0 = s.x1 = x;
        s.y0 = s.y1 = y;
      }
      ++s.area;
      s.x0 = std::min(s.x0, x);
      s.x1 = std::max(s.x1, x);
      s.y1 = y;
    }
  }
  std::set<std::uint32_t> used;
  for (auto& [key, s] : found) {
    std::uint64_t h =
        hash_of(world.seed, static_cast<std::uint64_t>(frame), static_cast<std::uint64_t>(camera),
                static_cast<std::uint64_t>(static_cast<std::uint32_t>(key)));
    do {
      s.id = static_cast<std::uint32_t>(h & 0xffffff);
      h = mix(h);
    } while (s.id == 0 || !used.insert(s.id).second);
  }
  Panoptic out;
  out.ids = RgbImage(width, height, RgbPixel{0, 0, 0});
  for (int y = 0; y < height; ++y) {
    int last_key = 0;
    RgbPixel colour{0, 0, 0};
    for (int x = 0; x < width; ++x) {
      const int key = keys[static_cast<std::size_t>(truth.instance.at(x, y)) + 1];
      if (key != last_key) {
        const std::uint32_t id = key == 0 ? 0 : found[key].id;
        colour = {static_cast<std::uint8_t>(id), static_cast<std::uint8_t>(id >> 8),
                  static_cast<std::uint8_t>(id >> 16)};
        last_key = key;
      }
      out.ids.at(x, y) = colour;
    }
  }
  for (const auto& [key, s] : found) out.segments.push_back(s);
  std::sort(out.segments.begin(), out.segments.end(),
            [](const Segment& a, const Segment& b) { return a.id < b.id; });
  return out;
}

Image16 encode_disparity(const ViewTruth& truth, double bf) {
  Image16 out(truth.depth.width(), truth.depth.height());
  for (std::size_t i = 0; i < out.size(); ++i) {
    const double depth = truth.depth.data()[i];
    if (depth <= 0) continue;
    const double disparity =
        truth.disparity.empty() ? 256.0 * bf / depth : 256.0 * truth.disparity.data()[i];
    if (!(disparity > 0)) continue;
    const double value = std::floor(disparity + 0.5);
    if (value <= 65535) out.data()[i] = static_cast<std::uint16_t>(std::max(value, 1.0));
  }
  return out;
}

Rgb16Image encode_flow(const ViewTruth& truth) {
  Rgb16Image out(truth.flow.width(), truth.flow.height(), Rgb16Pixel{0, 0, 0});
  for (std::size_t i = 0; i < out.size(); ++i) {
    const Eigen::Vector2f& f = truth.flow.data()[i];
    if (!std::isfinite(f.x()) || !std::isfinite(f.y())) continue;
    const double u = std::floor(f.x() * 64.0 + 32768.5);
    const double v = std::floor(f.y() * 64.0 + 32768.5);
    if (u < 1 || v < 1 || u > 65535 || v > 65535) continue;
    out.data()[i] = {static_cast<std::uint16_t>(u), static_cast<std::uint16_t>(v), 1};
  }
  return out;
}

}  // namespace kys_slam::simulator
