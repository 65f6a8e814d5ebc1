#include "features/fast_score.h"

#include <algorithm>
#include <array>
#include <cstring>

#include "features/vector_clones.h"

namespace kys_slam {

namespace {

// 32 pixels at a time; the compiler splits them where registers are narrower.
constexpr int kLanes = 32;
using Lanes = std::uint8_t __attribute__((vector_size(kLanes)));

// The circle of radius 3, clockwise from the top.
constexpr std::array<std::array<int, 2>, 16> kCircle{{{0, -3}, {1, -3}, {2, -2}, {3, -1},
                                                      {3, 0}, {3, 1}, {2, 2}, {1, 3},
                                                      {0, 3}, {-1, 3}, {-2, 2}, {-3, 1},
                                                      {-3, 0}, {-3, -1}, {-2, -2}, {-1, -3}}};

#define KYS_MIN(a, b) ((a) < (b) ? (a) : (b))
#define KYS_MAX(a, b) ((a) > (b) ? (a) : (b))

/// Largest over the 16 arcs of nine of the least difference in the arc.
#define KYS_ARC_SCORE(best, d)                                                         \
  do {                                                                                 \
    Lanes m2[16], m4[16];                                                              \
    for (int i = 0; i < 16; ++i) m2[i] = KYS_MIN(d[i], d[(i + 1) & 15]);               \
    for (int i = 0; i < 16; ++i) m4[i] = KYS_MIN(m2[i], m2[(i + 2) & 15]);             \
    for (int i = 0; i < 16; ++i) {                                                     \
      const Lanes m8 = KYS_MIN(m4[i], m4[(i + 4) & 15]);                               \
      const Lanes m9 = KYS_MIN(m8, d[(i + 8) & 15]);                                   \
      best = KYS_MAX(best, m9);                                                        \
    }                                                                                  \
  } while (false)

/// Scores of `count` pixels from `centre` on; reads up to 31 pixels further (inside the buffer).
KYS_VECTOR_CLONES
void score_row(const std::uint8_t* centre, const int* offset, int count, std::uint8_t min_threshold,
               std::uint8_t* score) {
  const Lanes least = Lanes{} + min_threshold;
  for (int x = 0; x < count; x += kLanes) {
    Lanes c;
    std::memcpy(&c, centre + x, kLanes);
    // Nine of sixteen contain two neighbouring compass points: most flat blocks stop here.
    Lanes compass[4];
    for (int i = 0; i < 4; ++i) std::memcpy(&compass[i], centre + x + offset[4 * i], kLanes);
    Lanes bright_pair{};
    Lanes dark_pair{};
    for (int i = 0; i < 4; ++i) {
      const Lanes low = KYS_MIN(compass[i], compass[(i + 1) & 3]);
      const Lanes high = KYS_MAX(compass[i], compass[(i + 1) & 3]);
      bright_pair = KYS_MAX(bright_pair, (KYS_MAX(low, c) - c));
      dark_pair = KYS_MAX(dark_pair, (c - KYS_MIN(high, c)));
    }
    const Lanes quick = KYS_MAX(KYS_MAX(bright_pair, dark_pair), least) - least;
    std::uint64_t any[4];
    std::memcpy(any, &quick, kLanes);
    if ((any[0] | any[1] | any[2] | any[3]) == 0) {
      std::memset(score + x, 0, kLanes);
      continue;
    }
    Lanes p[16];
    for (int i = 0; i < 16; ++i) std::memcpy(&p[i], centre + x + offset[i], kLanes);
    Lanes best{};
    Lanes d[16];
    for (int i = 0; i < 16; ++i) d[i] = KYS_MAX(p[i], c) - c;
    KYS_ARC_SCORE(best, d);
    for (int i = 0; i < 16; ++i) d[i] = c - KYS_MIN(p[i], c);
    KYS_ARC_SCORE(best, d);
    // All of the arc differ by more than t exactly when the least difference is t + 1 or more.
    const Lanes one = Lanes{} + std::uint8_t{1};
    const Lanes t = KYS_MAX(best, one) - one;
    const Lanes kept = t & (t >= least);
    std::memcpy(score + x, &kept, kLanes);
  }
}

}  // namespace

void fast_score_map(const GrayImage& image, int min_threshold, int margin, GrayImage& score) {
  const int width = image.width();
  const int height = image.height();
  if (score.width() != width || score.height() != height) score = GrayImage(width, height);
  std::fill(score.data(), score.data() + score.size(), std::uint8_t{0});
  const int count = width - 2 * margin;
  if (count <= 0 || height <= 2 * margin) return;
  std::array<int, 16> offset{};
  for (std::size_t i = 0; i < 16; ++i) offset[i] = kCircle[i][1] * width + kCircle[i][0];
  // Whole blocks are scored; what lies behind the row's end is thrown away. The last rows could
  // read past the buffer, so their tail goes through a copy.
  const int blocks = (count + kLanes - 1) / kLanes * kLanes;
  std::vector<std::uint8_t> row(static_cast<std::size_t>(blocks));
  const auto least = static_cast<std::uint8_t>(std::clamp(min_threshold, 1, 254));
  for (int y = margin; y < height - margin; ++y) {
    const std::uint8_t* centre = image.row(y) + margin;
    const std::uint8_t* end = image.data() + image.size();
    if (centre + 3 * width + 3 + blocks <= end) {
      score_row(centre, offset.data(), count, least, row.data());
    } else {
      std::vector<std::uint8_t> copy(static_cast<std::size_t>(7 * width + blocks + 8), 0);
      const std::uint8_t* first = centre - 3 * width - 3;
      std::copy(first, std::min(end, first + copy.size()), copy.data());
      score_row(copy.data() + 3 * width + 3, offset.data(), count, least, row.data());
    }
    std::copy_n(row.data(), count, score.row(y) + margin);
  }
}

void select_corners(const GrayImage& score, int threshold, int margin, int cell,
                    std::vector<Corner>& corners) {
  corners.clear();
  const int width = score.width();
  const int height = score.height();
  const int columns = std::max(1, (width - 2 * margin) / cell);
  const int rows = std::max(1, (height - 2 * margin) / cell);
  if (width <= 2 * margin || height <= 2 * margin) return;
  std::vector<std::uint8_t> strong(static_cast<std::size_t>(columns * rows), 0);
  const auto cell_of = [&](const Corner& c) {
    const int i = std::min(columns - 1, (c.x - margin) * columns / (width - 2 * margin));
    const int j = std::min(rows - 1, (c.y - margin) * rows / (height - 2 * margin));
    return static_cast<std::size_t>(j * columns + i);
  };
  for (int y = margin; y < height - margin; ++y) {
    const std::uint8_t* above = score.row(y - 1);
    const std::uint8_t* row = score.row(y);
    const std::uint8_t* below = score.row(y + 1);
    for (int x = margin; x < width - margin; ++x) {
      if (row[x] == 0) {
        std::uint64_t next = 0;  // most pixels are no corners: eight at a time
        if (x + 8 <= width - margin) {
          std::memcpy(&next, row + x, 8);
          if (next == 0) x += 7;
        }
        continue;
      }
      const std::uint8_t s = row[x];
      // Of equal neighbours the first in reading order wins.
      const bool peak = s > above[x - 1] && s > above[x] && s > above[x + 1] && s > row[x - 1] &&
                        s >= row[x + 1] && s >= below[x - 1] && s >= below[x] && s >= below[x + 1];
      if (!peak) continue;
      corners.push_back({static_cast<std::int16_t>(x), static_cast<std::int16_t>(y), s});
      if (s >= threshold) strong[cell_of(corners.back())] = 1;
    }
  }
  std::erase_if(corners, [&](const Corner& c) {
    return c.score < threshold && strong[cell_of(c)] != 0;
  });
}

}  // namespace kys_slam
