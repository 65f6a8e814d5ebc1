// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/shapes/materials.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "simulator/shapes/canvas.h"

namespace kys_slam::simulator {
namespace {

using Appearance = MaterialAppearance;

class Painter {
 public:
  explicit Painter(std::uint64_t seed) : seed_(seed), rng_(hash_of(seed, 17)) {
    library_.appearances.resize(kMaterialCount);
  }

  MaterialLibrary paint() {
    grime();
    ground();
    walls();
    openings();
    signs();
    vehicles();
    people_and_plants();
    hall();
    clouds();
    return std::move(library_);
  }

 private:
  void set(int material, const Canvas& canvas, double size_u, double size_v, bool grimy = false,
           bool tinted = false) {
    library_.appearances[material] = {canvas.texture(), static_cast<float>(1 / size_u),
                                      static_cast<float>(1 / size_v), grimy, tinted};
  }
  std::uint64_t next_seed() { return hash_of(seed_, ++counter_); }
  float draw(double low, double high) { return static_cast<float>(rng_.uniform(low, high)); }

  void grime() {
    Canvas c(1024, 0.5F);
    c.noise(next_seed(), 4, 9, 0.11F, 0.93F);
    c.spots(rng_, 240, 0.002F, 0.012F, 0.16F);
    library_.grime = c.texture();
  }

  // Noise that is alike at all scales, and spots of all sizes: corners at every distance.
  Canvas rough(int side, float base, float amplitude, float spots) {
    Canvas c(side, base);
    c.noise(next_seed(), 8, 8, amplitude);
    c.spots(rng_, 60, 0.012F, 0.035F, spots);
    c.spots(rng_, 400, 0.004F, 0.012F, spots);
    c.spots(rng_, 2500, 0.001F, 0.004F, spots * 1.2F);
    return c;
  }

  void ground() {
    Canvas asphalt = rough(1024, 0.24F, 0.030F, 0.085F);
    for (int i = 0; i < 3; ++i) {  // repaired strips and cracks
      const float u = draw(0, 0.8);
      const float v = draw(0, 0.8);
      asphalt.add_rect(u, v, u + 0.16F, v + 0.07F, -0.05F);
      asphalt.line(u, v, u + draw(-0.2, 0.2), v + 0.2F, 0.003F, 0.1F);
    }
    set(kAsphalt, asphalt, 6.1, 6.1, true);
    Canvas paint = rough(512, 0.80F, 0.045F, 0.22F);
    set(kRoadPaint, paint, 2.3, 2.3, true);

    Canvas slabs = rough(1024, 0.44F, 0.026F, 0.08F);
    for (int i = 0; i < 8; ++i) {
      for (int j = 0; j < 8; ++j) {
        const float u = static_cast<float>(i) / 8;
        const float v = static_cast<float>(j) / 8;
        slabs.add_rect(u, v, u + 0.125F, v + 0.125F, draw(-0.06, 0.06));
        slabs.rect(u, v, u + 0.125F, v + 0.006F, 0.22F);
        slabs.rect(u, v, u + 0.006F, v + 0.125F, 0.22F);
      }
    }
    set(kPavement, slabs, 4.0, 4.0, true);
    Canvas kerb = rough(512, 0.55F, 0.035F, 0.10F);
    for (int i = 0; i < 4; ++i) {
      const float u = static_cast<float>(i) / 4;
      kerb.rect(u, 0, u + 0.008F, 1, 0.25F);
    }
    set(kKerb, kerb, 4.0, 1.0, true);
    Canvas grass(512, 0.24F);
    grass.noise(next_seed(), 8, 7, 0.045F);
    grass.spots(rng_, 6000, 0.001F, 0.004F, 0.16F);
    set(kGrass, grass, 3.0, 3.0, true);
  }

  Canvas bricks(float base, float mortar, int across, int up, float spread) {
    Canvas c(1024, mortar);
    const float w = 1.0F / static_cast<float>(across);
    const float h = 1.0F / static_cast<float>(up);
    for (int j = 0; j < up; ++j) {
      for (int i = 0; i < across; ++i) {
        const float shade = base + spread * draw(-1, 1);
        const float u = (static_cast<float>(i) + (j % 2 == 0 ? 0 : 0.5F)) * w;
        const float v = static_cast<float>(j) * h;
        c.rect(u + 0.06F * w, v + 0.1F * h, std::min(1.0F, u + 0.97F * w), v + 0.95F * h, shade);
        if (u + w > 1) c.rect(0, v + 0.1F * h, u + 0.97F * w - 1, v + 0.95F * h, shade);
      }
    }
    c.noise(next_seed(), 8, 7, 0.022F);
    return c;
  }

  void walls() {
    set(kBrickRed, bricks(0.27F, 0.46F, 12, 40, 0.07F), 3.0, 3.0, true);
    set(kBrickPale, bricks(0.52F, 0.40F, 12, 40, 0.09F), 3.0, 3.0, true);
    Canvas light = rough(1024, 0.66F, 0.024F, 0.06F);
    set(kPlasterLight, light, 5.3, 5.3, true);
    Canvas dark = rough(1024, 0.42F, 0.024F, 0.06F);
    set(kPlasterDark, dark, 4.7, 4.7, true);
    Canvas stone = bricks(0.50F, 0.30F, 5, 8, 0.07F);
    stone.spots(rng_, 900, 0.002F, 0.008F, 0.07F);
    set(kStone, stone, 3.6, 3.6, true);
    Canvas concrete = rough(1024, 0.5F, 0.026F, 0.07F);
    for (int i = 0; i < 2; ++i) {
      const float k = 0.5F * static_cast<float>(i);
      concrete.rect(k, 0, k + 0.006F, 1, 0.33F);
      concrete.rect(0, k, 1, k + 0.006F, 0.33F);
      for (int j = 0; j < 4; ++j) concrete.disc(k + 0.1F, 0.1F + 0.25F * j, 0.008F, 0.28F);
    }
    set(kConcrete, concrete, 5.0, 5.0, true);
    Canvas tiles = bricks(0.30F, 0.14F, 14, 12, 0.06F);
    set(kRoofTile, tiles, 3.2, 3.2, true);
    set(kRoofFlat, rough(512, 0.35F, 0.03F, 0.08F), 5.0, 5.0, true);
    set(kTrim, rough(512, 0.72F, 0.022F, 0.08F), 2.0, 2.0, true);
  }

  // Glass that shows a baked sky gradient, a dim room and its curtains: the appearance does not
  // change with the viewer, so that stereo and flow can be checked on it.
  Canvas window(int kind) {
    Canvas c(256, 0.16F);
    for (int y = 0; y < 256; ++y) {
      for (int x = 0; x < 256; ++x) {
        c.at(x, y) += 0.14F * static_cast<float>(y) / 256 +
                      0.04F * std::sin(0.03F * static_cast<float>(x + y * (kind + 1)));
      }
    }
    c.noise(next_seed(), 4, 5, 0.03F);
    if (kind % 3 == 0) {  // curtains
      for (int i = 0; i < 10; ++i) {
        const float u = 0.06F + 0.03F * static_cast<float>(i);
        c.rect(u, 0.05F, u + 0.016F, 0.95F, 0.55F);
        c.rect(1 - u, 0.05F, 1 - u + 0.016F, 0.95F, 0.5F);
      }
    } else if (kind % 3 == 1) {  // blind
      for (int i = 0; i < 12; ++i) {
        const float v = 0.5F + 0.038F * static_cast<float>(i);
        c.rect(0.05F, v, 0.95F, v + 0.024F, 0.5F);
      }
    } else {  // plants on the sill
      c.spots(rng_, 30, 0.01F, 0.03F, 0.25F);
      for (int i = 0; i < 5; ++i) {
        c.disc(draw(0.15, 0.85), 0.18F, 0.07F, 0.08F);
      }
    }
    const float frame = 0.82F - 0.08F * static_cast<float>(kind);
    const float t = 0.055F;
    c.rect(0, 0, 1, t, frame);
    c.rect(0, 1 - t, 1, 1, frame);
    c.rect(0, 0, t, 1, frame);
    c.rect(1 - t, 0, 1, 1, frame);
    c.rect(0.5F - t / 2, 0, 0.5F + t / 2, 1, frame);
    if (kind % 2 == 0) c.rect(0, 0.66F, 1, 0.66F + t, frame);
    return c;
  }

  void openings() {
    for (int i = 0; i < 6; ++i) set(kWindow0 + i, window(i), 1, 1);
    for (int i = 0; i < 2; ++i) {
      Canvas door(256, i == 0 ? 0.22F : 0.4F);
      door.noise(next_seed(), 8, 5, 0.03F, 1.0F, 0.3F);
      for (int k = 0; k < 4; ++k) {
        const int column = k % 2, row = k / 2;
        const float u = 0.12F + 0.42F * static_cast<float>(column);
        const float v = 0.08F + 0.36F * static_cast<float>(row);
        door.rect(u, v, u + 0.34F, v + 0.3F, i == 0 ? 0.14F : 0.55F);
        door.rect(u + 0.03F, v + 0.02F, u + 0.31F, v + 0.28F, i == 0 ? 0.27F : 0.36F);
      }
      door.rect(0, 0.82F, 1, 0.97F, 0.6F);
      door.rect(0.06F, 0.84F, 0.94F, 0.95F, 0.12F);
      door.disc(0.9F, 0.42F, 0.025F, 0.85F);
      set(kDoor0 + i, door, 1, 1);
    }
    for (int i = 0; i < 4; ++i) set(kShop0 + i, shop(), 1, 1);
  }

  Canvas shop() {
    Canvas c(512, 0.13F);
    c.noise(next_seed(), 4, 6, 0.03F);
    for (int k = 0; k < 26; ++k) {  // goods on shelves
      const float u = draw(0.05, 0.88);
      const float v = 0.08F + 0.22F * static_cast<float>(rng_.below(3));
      const float w = draw(0.03, 0.09);
      const float h = draw(0.06, 0.17);
      c.rect(u, v, u + w, v + h, draw(0.12, 0.8));
      c.rect(u + 0.2F * w, v + 0.3F * h, u + 0.8F * w, v + 0.6F * h, draw(0.1, 0.9));
    }
    for (int s = 0; s < 3; ++s) {
      const float v = 0.06F + 0.22F * static_cast<float>(s);
      c.rect(0.03F, v, 0.97F, v + 0.015F, 0.5F);
    }
    c.text(rng_, 0.2F, 0.76F, 0.8F, 0.88F, 8, 0.85F);
    for (const float u : {0.0F, 0.32F, 0.65F, 0.975F}) c.rect(u, 0, u + 0.025F, 1, 0.62F);
    c.rect(0, 0, 1, 0.03F, 0.6F);
    c.rect(0, 0.96F, 1, 1, 0.6F);
    return c;
  }

  void signs() {
    for (int i = 0; i < 6; ++i) {
      Canvas c(512, i % 2 == 0 ? 0.18F : 0.78F);
      c.noise(next_seed(), 8, 6, 0.02F);
      const float ink = i % 2 == 0 ? 0.85F : 0.15F;
      c.text(rng_, 0.16F, 0.25F, 0.9F, 0.75F, 7 + i, ink);
      c.disc(0.08F, 0.5F, 0.05F, ink);
      c.rect(0, 0, 1, 0.06F, ink);
      c.rect(0, 0.94F, 1, 1, ink);
      set(kSign0 + i, c, 1, 1);
    }
    for (int i = 0; i < 4; ++i) {
      Canvas c(512, 0.75F);
      c.noise(next_seed(), 4, 8, 0.05F);
      for (int k = 0; k < 9; ++k) {
        const float u = draw(0.04, 0.7), v = draw(0.2, 0.8);
        const float tone = draw(0.05, 0.7), height = draw(0.04, 0.16), width = draw(0.05, 0.25);
        c.rect(u, v, u + width, v + height, tone);
        const float shade = draw(0.05, 0.9), radius = draw(0.03, 0.12);
        const float y = draw(0.3, 0.8), x = draw(0.15, 0.85);
        c.disc(x, y, radius, shade);
      }
      for (int k = 0; k < 5; ++k) {
        const float v = 0.05F + 0.045F * static_cast<float>(k);
        c.text(rng_, 0.08F, v, 0.9F, v + 0.026F, 22, 0.1F);
      }
      c.text(rng_, 0.08F, 0.86F, 0.92F, 0.96F, 7, 0.12F);
      set(kPoster0 + i, c, 1, 1);
    }
    Canvas sign(128, 0.85F);
    sign.rect(0.05F, 0.05F, 0.95F, 0.95F, 0.3F);
    sign.rect(0.15F, 0.15F, 0.85F, 0.85F, 0.85F);
    sign.line(0.25F, 0.25F, 0.75F, 0.75F, 0.1F, 0.15F);
    sign.disc(0.62F, 0.36F, 0.1F, 0.15F);
    set(kTrafficSign, sign, 1, 1);
  }

  void vehicles() {
    Canvas paint(256, 0.92F);
    paint.noise(next_seed(), 4, 6, 0.022F);
    set(kCarPaint, paint, 1.6, 1.6, false, true);
    Canvas side(512, 0.92F);  // the whole flank: door seams, handles, trim strip
    side.noise(next_seed(), 4, 7, 0.018F);
    side.rect(0, 0, 1, 0.14F, 0.25F);
    side.rect(0.02F, 0.42F, 0.98F, 0.46F, 0.4F);
    for (const float u : {0.30F, 0.53F, 0.73F}) side.rect(u, 0.1F, u + 0.006F, 1, 0.3F);
    side.rect(0.47F, 0.72F, 0.515F, 0.77F, 0.25F);
    side.rect(0.67F, 0.72F, 0.715F, 0.77F, 0.25F);
    side.disc(0.86F, 0.72F, 0.03F, 0.6F);
    set(kCarSide, side, 1, 1, false, true);
    Canvas glass(256, 0.13F);
    for (int y = 0; y < 256; ++y) {
      for (int x = 0; x < 256; ++x) {
        c_add(glass, x, y, 0.12F * static_cast<float>(y) / 256);
      }
    }
    glass.noise(next_seed(), 4, 5, 0.03F);
    for (int i = 0; i < 3; ++i) {
      glass.disc(0.22F + 0.28F * static_cast<float>(i), 0.42F, 0.085F, 0.07F);
      glass.rect(0.14F + 0.28F * static_cast<float>(i), 0, 0.3F + 0.28F * static_cast<float>(i),
                 0.3F, 0.08F);
    }
    glass.line(0.55F, 0.98F, 0.75F, 0.6F, 0.03F, 0.42F);
    set(kCarGlass, glass, 1, 1);
    set(kCarFront, car_end(true), 1, 1, false, true);
    set(kCarRear, car_end(false), 1, 1, false, true);
    set(kRubber, rough(256, 0.07F, 0.01F, 0.03F), 0.8, 0.8);
    Canvas rim(128, 0.08F);
    rim.disc(0.5F, 0.5F, 0.34F, 0.62F);
    for (int i = 0; i < 5; ++i) {
      const float a = static_cast<float>(i) * 1.2566F;
      rim.disc(0.5F + 0.2F * std::cos(a), 0.5F + 0.2F * std::sin(a), 0.075F, 0.12F);
    }
    rim.disc(0.5F, 0.5F, 0.07F, 0.3F);
    set(kRim, rim, 1, 1);
    Canvas black(64, 0.03F);
    set(kBlack, black, 1, 1);
    truck();
    bus();
  }

  static void c_add(Canvas& c, int x, int y, float delta) { c.at(x, y) += delta; }

  Canvas car_end(bool front) {
    Canvas c(256, 0.92F);
    c.noise(next_seed(), 4, 6, 0.018F);
    c.rect(0, 0, 1, 0.16F, 0.14F);
    c.rect(0.02F, 0.2F, 0.98F, 0.34F, 0.8F);
    c.rect(0.35F, 0.2F, 0.65F, 0.33F, 0.95F);
    c.text(rng_, 0.38F, 0.22F, 0.64F, 0.31F, 7, 0.08F);
    if (front) {
      c.rect(0.3F, 0.45F, 0.7F, 0.75F, 0.08F);
      for (int i = 0; i < 4; ++i) {
        c.rect(0.3F, 0.48F + 0.07F * static_cast<float>(i), 0.7F,
               0.5F + 0.07F * static_cast<float>(i), 0.5F);
      }
      c.disc(0.5F, 0.62F, 0.05F, 0.85F);
    } else {
      c.rect(0.3F, 0.5F, 0.7F, 0.54F, 0.5F);
      c.text(rng_, 0.68F, 0.62F, 0.84F, 0.7F, 5, 0.3F);
      c.disc(0.5F, 0.7F, 0.04F, 0.75F);
    }
    for (const float u : {0.04F, 0.76F}) {
      c.rect(u, 0.5F, u + 0.2F, 0.8F, front ? 0.3F : 0.16F);
      c.rect(u + 0.02F, 0.54F, u + 0.18F, 0.76F, front ? 0.95F : 0.3F);
      c.disc(u + 0.1F, 0.65F, 0.06F, front ? 0.6F : 0.5F);
    }
    return c;
  }

  void truck() {
    Canvas side = rough(512, 0.68F, 0.012F, 0.03F);
    for (int i = 0; i < 9; ++i) {
      const float u = static_cast<float>(i) / 9;
      side.rect(u, 0, u + 0.004F, 1, 0.45F);
    }
    side.text(rng_, 0.1F, 0.48F, 0.9F, 0.78F, 8, 0.16F);
    side.text(rng_, 0.2F, 0.22F, 0.8F, 0.32F, 15, 0.3F);
    side.rect(0, 0.12F, 1, 0.17F, 0.25F);
    set(kTruckSide, side, 1, 1);
    Canvas rear = rough(512, 0.62F, 0.014F, 0.05F);
    rear.rect(0.495F, 0, 0.505F, 1, 0.1F);
    for (const float u : {0.2F, 0.4F, 0.6F, 0.8F}) {
      rear.rect(u - 0.012F, 0.02F, u + 0.012F, 0.98F, 0.35F);
      rear.rect(u - 0.04F, 0.36F, u + 0.04F, 0.42F, 0.15F);
      rear.disc(u, 0.9F, 0.02F, 0.15F);
      rear.disc(u, 0.1F, 0.02F, 0.15F);
    }
    rear.text(rng_, 0.06F, 0.62F, 0.46F, 0.74F, 6, 0.12F);
    rear.text(rng_, 0.54F, 0.62F, 0.94F, 0.74F, 6, 0.12F);
    rear.text(rng_, 0.1F, 0.5F, 0.44F, 0.55F, 12, 0.25F);
    rear.text(rng_, 0.56F, 0.5F, 0.9F, 0.55F, 12, 0.25F);
    for (int i = 0; i < 12; ++i) {
      const float u = static_cast<float>(i) / 12;
      rear.rect(u, 0.0F, u + 0.04F, 0.05F, 0.9F);
    }
    rear.spots(rng_, 300, 0.002F, 0.01F, 0.12F);
    set(kTruckRear, rear, 1, 1);
    Canvas front = rough(512, 0.6F, 0.012F, 0.03F);
    front.rect(0.06F, 0.55F, 0.94F, 0.88F, 0.12F);
    front.line(0.2F, 0.6F, 0.5F, 0.56F, 0.01F, 0.4F);
    for (int i = 0; i < 5; ++i) {
      front.rect(0.2F, 0.2F + 0.05F * static_cast<float>(i), 0.8F,
                 0.22F + 0.05F * static_cast<float>(i), 0.15F);
    }
    front.text(rng_, 0.3F, 0.48F, 0.7F, 0.53F, 6, 0.1F);
    front.rect(0.04F, 0.06F, 0.18F, 0.14F, 0.95F);
    front.rect(0.82F, 0.06F, 0.96F, 0.14F, 0.95F);
    set(kTruckFront, front, 1, 1);
  }

  void bus() {
    Canvas side = rough(512, 0.6F, 0.012F, 0.03F);
    for (int i = 0; i < 7; ++i) {
      const float u = 0.02F + 0.14F * static_cast<float>(i);
      side.rect(u, 0.48F, u + 0.12F, 0.86F, 0.13F);
      side.disc(u + 0.04F, 0.56F, 0.016F, 0.3F);
      side.disc(u + 0.09F, 0.55F, 0.014F, 0.25F);
      if (i == 1 || i == 4) side.rect(u + 0.01F, 0.08F, u + 0.11F, 0.86F, 0.2F);
    }
    side.rect(0, 0.3F, 1, 0.34F, 0.2F);
    side.text(rng_, 0.2F, 0.36F, 0.6F, 0.45F, 10, 0.1F);
    side.text(rng_, 0.62F, 0.14F, 0.95F, 0.28F, 7, 0.85F);
    set(kBusSide, side, 1, 1);
    Canvas rear = rough(512, 0.58F, 0.014F, 0.04F);
    rear.rect(0.1F, 0.55F, 0.9F, 0.82F, 0.12F);
    rear.text(rng_, 0.3F, 0.86F, 0.7F, 0.95F, 4, 0.95F);
    rear.text(rng_, 0.15F, 0.34F, 0.85F, 0.48F, 9, 0.12F);
    rear.rect(0.04F, 0.12F, 0.14F, 0.3F, 0.25F);
    rear.rect(0.86F, 0.12F, 0.96F, 0.3F, 0.25F);
    for (int i = 0; i < 6; ++i) {
      rear.rect(0.25F, 0.1F + 0.03F * static_cast<float>(i), 0.75F,
                0.115F + 0.03F * static_cast<float>(i), 0.2F);
    }
    set(kBusRear, rear, 1, 1);
    Canvas front = rough(512, 0.6F, 0.012F, 0.03F);
    front.rect(0.05F, 0.34F, 0.95F, 0.8F, 0.13F);
    front.rect(0.495F, 0.34F, 0.505F, 0.8F, 0.4F);
    front.rect(0.15F, 0.83F, 0.85F, 0.96F, 0.05F);
    front.text(rng_, 0.2F, 0.85F, 0.8F, 0.94F, 9, 0.9F);
    front.rect(0.06F, 0.1F, 0.2F, 0.18F, 0.95F);
    front.rect(0.8F, 0.1F, 0.94F, 0.18F, 0.95F);
    front.rect(0.38F, 0.06F, 0.62F, 0.12F, 0.9F);
    set(kBusFront, front, 1, 1);
  }

  void people_and_plants() {
    const std::array<float, 4> shades = {0.12F, 0.3F, 0.5F, 0.68F};
    for (int i = 0; i < 4; ++i) {
      Canvas c(128, shades[i]);
      c.noise(next_seed(), 4, 5, 0.05F);
      if (i % 2 == 1) {
        for (int k = 0; k < 8; ++k) {
          c.add_rect(0, static_cast<float>(k) / 8, 1, static_cast<float>(k) / 8 + 0.06F, 0.22F);
        }
      }
      set(kCloth0 + i, c, 0.5, 0.5);
    }
    Canvas skin(64, 0.52F);
    skin.noise(next_seed(), 4, 4, 0.03F);
    set(kSkin, skin, 0.3, 0.3);
    Canvas hair(64, 0.1F);
    hair.noise(next_seed(), 8, 3, 0.04F);
    set(kHair, hair, 0.2, 0.2);
    Canvas bark(256, 0.22F);
    bark.noise(next_seed(), 16, 5, 0.05F, 1.0F, 5.0F);
    bark.spots(rng_, 60, 0.01F, 0.04F, 0.1F);
    set(kBark, bark, 0.8, 1.6);
    Canvas leaves(512, 0.18F);
    leaves.noise(next_seed(), 8, 6, 0.05F);
    leaves.spots(rng_, 900, 0.008F, 0.022F, 0.22F);
    leaves.spots(rng_, 3000, 0.003F, 0.008F, 0.2F);
    set(kLeaves, leaves, 2.0, 2.0);
    Canvas metal(256, 0.36F);
    metal.noise(next_seed(), 4, 6, 0.02F);
    metal.spots(rng_, 100, 0.004F, 0.02F, 0.1F);
    set(kMetal, metal, 1.0, 1.0);
    Canvas fence(256, 0.12F);
    for (int i = 0; i < 8; ++i) {
      const float u = static_cast<float>(i) / 8;
      fence.rect(u, 0, u + 0.09F, 1, 0.42F + 0.06F * static_cast<float>(i % 3));
    }
    fence.rect(0, 0.2F, 1, 0.27F, 0.3F);
    fence.rect(0, 0.75F, 1, 0.82F, 0.3F);
    fence.noise(next_seed(), 8, 5, 0.03F);
    set(kFence, fence, 1.4, 1.4);
    Canvas wood(256, 0.42F);
    wood.noise(next_seed(), 32, 4, 0.05F, 0.9F, 8.0F);
    for (int i = 0; i < 4; ++i) {
      wood.rect(static_cast<float>(i) / 4, 0, static_cast<float>(i) / 4 + 0.015F, 1, 0.15F);
    }
    set(kWood, wood, 0.8, 1.2);
  }

  /// One paragraph per material: long, but nothing in it depends on what is above.
  void hall() {
    Canvas floor = rough(1024, 0.45F, 0.026F, 0.09F);
    for (int i = 0; i < 4; ++i) {
      for (int j = 0; j < 4; ++j) {
        const float u = 0.25F * static_cast<float>(i);
        const float v = 0.25F * static_cast<float>(j);
        floor.add_rect(u, v, u + 0.25F, v + 0.25F, (i + j) % 2 == 0 ? 0.05F : -0.05F);
        floor.rect(u, v, u + 0.25F, v + 0.005F, 0.2F);
        floor.rect(u, v, u + 0.005F, v + 0.25F, 0.2F);
      }
    }
    set(kFloorTiles, floor, 3.2, 3.2, true);
    Canvas wall = rough(1024, 0.6F, 0.02F, 0.07F);
    for (int i = 0; i < 4; ++i) {
      const float u = 0.25F * static_cast<float>(i);
      wall.rect(u, 0, u + 0.006F, 1, 0.35F);
      for (int j = 0; j < 4; ++j) wall.disc(u + 0.02F, 0.12F + 0.25F * j, 0.006F, 0.25F);
    }
    wall.rect(0, 0, 1, 0.01F, 0.3F);
    set(kWallPanel, wall, 4.0, 4.0, true);
    Canvas ceiling = rough(512, 0.5F, 0.02F, 0.05F);
    for (int i = 0; i < 8; ++i) {
      ceiling.rect(static_cast<float>(i) / 8, 0, static_cast<float>(i) / 8 + 0.03F, 1, 0.3F);
    }
    set(kCeiling, ceiling, 4.0, 4.0, true);
    Canvas crate(512, 0.45F);
    crate.noise(next_seed(), 16, 6, 0.035F, 0.9F, 4.0F);
    for (int i = 0; i < 5; ++i) crate.rect(0, 0.2F * i, 1, 0.2F * i + 0.012F, 0.15F);
    crate.line(0.05F, 0.05F, 0.95F, 0.95F, 0.06F, 0.56F);
    crate.text(rng_, 0.2F, 0.62F, 0.8F, 0.74F, 6, 0.1F);
    set(kCrate, crate, 1, 1);
    Canvas cardboard(512, 0.5F);
    cardboard.noise(next_seed(), 8, 7, 0.02F);
    cardboard.rect(0.44F, 0, 0.56F, 1, 0.62F);
    cardboard.text(rng_, 0.08F, 0.1F, 0.4F, 0.2F, 6, 0.12F);
    cardboard.rect(0.62F, 0.1F, 0.92F, 0.32F, 0.85F);
    cardboard.text(rng_, 0.64F, 0.24F, 0.9F, 0.29F, 9, 0.1F);
    for (int i = 0; i < 12; ++i) {
      cardboard.rect(0.64F + 0.022F * i, 0.12F, 0.64F + 0.022F * i + 0.005F * (1 + i % 3), 0.22F,
                     0.08F);
    }
    set(kCardboard, cardboard, 0.8, 0.8);
    Canvas machine(512, 0.38F);
    machine.noise(next_seed(), 4, 7, 0.02F);
    for (int i = 0; i < 14; ++i) {
      const float u = draw(0, 0.8), v = draw(0, 0.8);
      const float tone = draw(0.1, 0.75), height = draw(0.04, 0.2), width = draw(0.04, 0.2);
      machine.rect(u, v, u + width, v + height, tone);
      const float shade = draw(0.05, 0.9), y = draw(0.05, 0.95), x = draw(0.05, 0.95);
      machine.disc(x, y, 0.018F, shade);
    }
    machine.text(rng_, 0.1F, 0.86F, 0.6F, 0.95F, 8, 0.85F);
    set(kMachine, machine, 1.5, 1.5);
    for (int i = 0; i < 2; ++i) {
      Canvas load(512, 0.1F);
      for (int k = 0; k < 12; ++k) {
        const float u = static_cast<float>(k) / 12;
        const float h = draw(0.5, 0.95);
        load.rect(u + 0.004F, 0, u + 0.078F, h, draw(0.2, 0.7));
        load.rect(u + 0.015F, 0.4F * h, u + 0.065F, 0.6F * h, draw(0.1, 0.9));
      }
      load.noise(next_seed(), 8, 6, 0.025F);
      set(kRackLoad0 + i, load, 1, 1);
    }
  }

  void clouds() {
    Canvas c(1024, 0.5F);
    c.noise(next_seed(), 4, 8, 0.16F, 0.82F);
    for (int y = 0; y < 1024; ++y) {
      for (int x = 0; x < 1024; ++x) {
        const float k = std::clamp((c.at(x, y) - 0.42F) / 0.3F, 0.0F, 1.0F);
        c.at(x, y) = 0.25F + 0.6F * k * k * (3 - 2 * k);
      }
    }
    c.noise(next_seed(), 32, 6, 0.035F);
    set(kClouds, c, 1, 1);
  }

  std::uint64_t seed_;
  std::uint64_t counter_ = 0;
  Rng rng_;
  MaterialLibrary library_;
};

}  // namespace

MaterialLibrary make_materials(std::uint64_t seed) {
  return Painter(seed).paint();
}

}  // namespace kys_slam::simulator
