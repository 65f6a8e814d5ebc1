#include "features/orb_descriptor.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "features/orb_pattern.h"
#include "features/vector_clones.h"

namespace kys_slam {

namespace {

constexpr int kRadius = 15;                  // px, disc of the orientation
constexpr int kSide = 32;                    // one row of the disc, padded
constexpr int kBins = 256;                   // steps of a turn
constexpr int kReach = 19;                   // px, farthest rounded point of the turned pattern
constexpr int kPatchStride = 64;             // bytes between rows of the local patch
constexpr float kTwoPi = 2.0f * std::numbers::pi_v<float>;

struct DiscWeights {
  std::array<std::array<std::int16_t, kSide>, 2 * kRadius + 1> column{};  // u inside, else 0
  std::array<std::array<std::int16_t, kSide>, 2 * kRadius + 1> inside{};  // 1 inside, else 0

  DiscWeights() {
    for (int v = -kRadius; v <= kRadius; ++v) {
      const int reach = static_cast<int>(std::lround(std::sqrt(kRadius * kRadius - v * v)));
      for (int u = -reach; u <= reach; ++u) {
        const auto row = static_cast<std::size_t>(v + kRadius);
        const auto at = static_cast<std::size_t>(u + kRadius);
        column[row][at] = static_cast<std::int16_t>(u);
        inside[row][at] = 1;
      }
    }
  }
};

KYS_VECTOR_CLONES
void disc_moments(const std::uint8_t* top_left, std::ptrdiff_t stride, const DiscWeights& weights,
                  int& m10, int& m01) {
  int sum_u = 0;
  int sum_v = 0;
  for (int v = 0; v <= 2 * kRadius; ++v) {
    const std::uint8_t* row = top_left + v * stride;
    const auto& column = weights.column[static_cast<std::size_t>(v)];
    const auto& inside = weights.inside[static_cast<std::size_t>(v)];
    int row_u = 0;
    int row_sum = 0;
    for (std::size_t u = 0; u < kSide; ++u) {
      row_u += row[u] * column[u];
      row_sum += row[u] * inside[u];
    }
    sum_u += row_u;
    sum_v += (v - kRadius) * row_sum;
  }
  m10 = sum_u;
  m01 = sum_v;
}

/// Offsets of the 512 test points into the local patch for every turn.
class TurnedPattern {
 public:
  TurnedPattern() : offsets_(static_cast<std::size_t>(kBins) * 512) {
    for (int bin = 0; bin < kBins; ++bin) {
      const double angle = 2 * std::numbers::pi * bin / kBins;
      const double c = std::cos(angle);
      const double s = std::sin(angle);
      for (std::size_t k = 0; k < 512; ++k) {
        const double px = kOrbPattern[k / 2][k % 2][0];
        const double py = kOrbPattern[k / 2][k % 2][1];
        const int x = static_cast<int>(std::lround(px * c - py * s));
        const int y = static_cast<int>(std::lround(px * s + py * c));
        offsets_[static_cast<std::size_t>(bin) * 512 + k] =
            static_cast<std::int16_t>((y + kReach) * kPatchStride + x + kReach);
      }
    }
  }
  [[nodiscard]] const std::int16_t* at(int bin) const {
    return offsets_.data() + static_cast<std::size_t>(bin) * 512;
  }

 private:
  std::vector<std::int16_t> offsets_;
};

}  // namespace

float corner_angle(const GrayImage& image, int x, int y) {
  static const DiscWeights weights;
  int m10 = 0;
  int m01 = 0;
  disc_moments(image.row(y - kRadius) + x - kRadius, image.width(), weights, m10, m01);
  const float angle = std::atan2(static_cast<float>(m01), static_cast<float>(m10));
  return angle < 0 ? angle + kTwoPi : angle;
}

kys::Descriptor orb_descriptor(const GrayImage& blurred, int x, int y, float angle) {
  static const TurnedPattern pattern;
  // A patch of fixed stride around the corner: the same offsets serve every level.
  std::array<std::uint8_t, (2 * kReach + 1) * kPatchStride> patch;
  const std::uint8_t* source = blurred.row(y - kReach) + x - kReach;
  for (int r = 0; r <= 2 * kReach; ++r) {
    std::memcpy(patch.data() + r * kPatchStride, source + r * blurred.width(), 2 * kReach + 1);
  }
  const int bin = static_cast<int>(std::lround(angle / kTwoPi * kBins)) % kBins;
  const std::int16_t* offset = pattern.at(bin);
  kys::Descriptor descriptor;
  for (std::uint64_t& word : descriptor.words) {
    std::uint64_t bits = 0;
    for (unsigned b = 0; b < 64; ++b, offset += 2) {
      const bool less = patch[static_cast<std::size_t>(offset[0])] <
                        patch[static_cast<std::size_t>(offset[1])];
      bits |= static_cast<std::uint64_t>(less) << b;
    }
    word = bits;
  }
  return descriptor;
}

void blur_for_descriptors(const GrayImage& image, GrayImage& blurred) {
  if (blurred.width() != image.width() || blurred.height() != image.height()) {
    blurred = GrayImage(image.width(), image.height());
  }
  const cv::Mat source(image.height(), image.width(), CV_8U,
                       const_cast<std::uint8_t*>(image.data()));
  cv::Mat target(image.height(), image.width(), CV_8U, blurred.data());
  cv::GaussianBlur(source, target, cv::Size(7, 7), 2, 2, cv::BORDER_REFLECT_101);
}

}  // namespace kys_slam
