#include "matching/patch_alignment.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>

namespace kys_slam {

namespace {

constexpr int kHalf = 5;  // px
constexpr int kSide = 2 * kHalf + 1;
constexpr int kLanes = 4;
constexpr int kGroups = (kSide + kLanes - 1) / kLanes;
constexpr int kRow = kGroups * kLanes;  // with padding that weighs nothing
constexpr int kReach = 15;              // columns of the right image to either side of the start
constexpr int kStrip = 2 * kReach + 1;
constexpr int kIterations = 8;
constexpr float kWindowSigma = 4;  // px
constexpr float kMaxMove = 1.5f;   // px
constexpr float kMaxSlantU = 0.6f;
constexpr float kMaxSlantV = 0.8f;
// Slants are near zero rather than not, by as much as a hundred squared grey levels per px tell: a
// patch that shows one edge alone says nothing of them.
constexpr float kSlantPrior = 100;
// Weight of a pixel that is off by e: 1 / (1 + e^2 / (kTolerance residual^2 + kNoise)).
constexpr float kTolerance = 2.25f;
constexpr float kNoise = 9;  // grey levels squared

using Four = float __attribute__((vector_size(16)));
using FourInts = std::int32_t __attribute__((vector_size(16)));

float sum(const Four& v) {
  return (v[0] + v[1]) + (v[2] + v[3]);
}

/// Four columns' offsets from the centre and weights by distance.
struct Window {
  std::array<Four, kGroups> dx;
  std::array<std::array<Four, kGroups>, kSide> weight;
  float total = 0;

  Window() {
    for (int k = 0; k < kRow; ++k) {
      dx[at(k)][k % kLanes] = static_cast<float>(std::min(k, kSide - 1) - kHalf);
    }
    for (int y = 0; y < kSide; ++y) {
      for (int x = 0; x < kRow; ++x) {
        const int squared = (x - kHalf) * (x - kHalf) + (y - kHalf) * (y - kHalf);
        const float w = std::exp(-static_cast<float>(squared) / (2 * kWindowSigma * kWindowSigma));
        weight[static_cast<std::size_t>(y)][at(x)][x % kLanes] = x < kSide ? w : 0;
        total += x < kSide ? w : 0;
      }
    }
  }
  static std::size_t at(int column) { return static_cast<std::size_t>(column / kLanes); }
};

/// The left patch, its gradient along the rows, and the rows of the right image around the start.
class Patches {
 public:
  Patches(const GrayImage& left, const GrayImage& right, const Eigen::Vector2f& at, float start) {
    // As floats first: a conversion of what is far off or no number is not defined.
    const auto within = [](float x, float last) { return x >= 0 && x <= last; };
    const auto width = static_cast<float>(std::min(left.width(), right.width()) - 1);
    const auto height = static_cast<float>(std::min(left.height(), right.height()) - 1);
    if (!within(at.x() - kHalf - 1, width - 2 * kHalf - 3) ||
        !within(at.y() - kHalf, height - 2 * kHalf - 1) ||
        !within(start - kHalf - 1, width - 2 * kHalf - 2)) {
      return;
    }
    fits_ = true;
    first_ = static_cast<int>(start) - kReach;
    const int y0 = static_cast<int>(at.y()) - kHalf;
    const int x0 = static_cast<int>(at.x()) - kHalf;
    const float wx = at.x() - std::floor(at.x());
    const float wy = at.y() - std::floor(at.y());
    for (int r = 0; r < kSide; ++r) {
      take_left(left.row(y0 + r) + x0 - 1, left.row(y0 + r + 1) + x0 - 1, wx, wy, r);
      take_right(right.row(y0 + r), right.row(y0 + r + 1), right.width(), wy, r);
    }
  }

  [[nodiscard]] bool fits() const { return fits_; }
  [[nodiscard]] const Four& gradient(std::size_t row, std::size_t group) const {
    return gradient_[row][group];
  }
  /// Right less left at four columns of the strip.
  [[nodiscard]] Four difference(std::size_t row, std::size_t group, const Four& column) const {
    const float* strip = strip_[row].data();
    const FourInts whole = __builtin_convertvector(column, FourInts);
    Four low, high;
    for (int k = 0; k < kLanes; ++k) {
      low[k] = strip[whole[k]];
      high[k] = strip[whole[k] + 1];
    }
    return low + (column - __builtin_convertvector(whole, Four)) * (high - low) -
           wanted_[row][group];
  }
  /// Column of the strip that is column `u` of the right image.
  [[nodiscard]] float in_strip(float u) const { return u - static_cast<float>(first_); }

 private:
  void take_left(const std::uint8_t* upper, const std::uint8_t* lower, float wx, float wy, int r) {
    std::array<float, kSide + 3> value{};
    for (std::size_t k = 0; k < kSide + 3; ++k) {
      value[k] = static_cast<float>(upper[k]) + wy * static_cast<float>(lower[k] - upper[k]);
    }
    for (std::size_t k = 0; k < kSide + 2; ++k) value[k] += wx * (value[k + 1] - value[k]);
    const auto row = static_cast<std::size_t>(r);
    for (int k = 0; k < kRow; ++k) {
      const auto at = static_cast<std::size_t>(std::min(k, kSide - 1));
      wanted_[row][Window::at(k)][k % kLanes] = value[at + 1];
      gradient_[row][Window::at(k)][k % kLanes] = 0.5f * (value[at + 2] - value[at]);
    }
  }
  void take_right(const std::uint8_t* upper, const std::uint8_t* lower, int width, float wy,
                  int r) {
    auto& strip = strip_[static_cast<std::size_t>(r)];
    for (int k = 0; k < kStrip; ++k) {
      const int x = std::clamp(first_ + k, 0, width - 1);
      strip[static_cast<std::size_t>(k)] =
          static_cast<float>(upper[x]) + wy * static_cast<float>(lower[x] - upper[x]);
    }
  }

  int first_ = 0;  // column of the right image where the strip begins
  bool fits_ = false;
  std::array<std::array<Four, kGroups>, kSide> wanted_{};
  std::array<std::array<Four, kGroups>, kSide> gradient_{};
  std::array<std::array<float, kStrip>, kSide> strip_{};
};

/// Normal equations of column and slants, the mean of the differences eliminated.
struct Normal {
  Eigen::Matrix3f H;
  Eigen::Vector3f b;
};

/// Differences e of one iteration and their weighted mean and mean square about it.
struct Differences {
  std::array<std::array<Four, kGroups>, kSide> e;
  float mean = 0;
  float square = 0;
};

void compare(const Patches& patches, const Window& window, const PatchAlignment& at,
             Differences& out) {
  Four sum_e{}, sum_ee{};
  for (std::size_t r = 0; r < kSide; ++r) {
    const float middle =
        patches.in_strip(at.column) + at.slant_v * static_cast<float>(static_cast<int>(r) - kHalf);
    for (std::size_t g = 0; g < kGroups; ++g) {
      const Four e = patches.difference(r, g, middle + window.dx[g] * (1 + at.slant_u));
      const Four we = window.weight[r][g] * e;
      sum_e += we;
      sum_ee += we * e;
      out.e[r][g] = e;
    }
  }
  out.mean = sum(sum_e) / window.total;
  out.square = std::max(0.0f, sum(sum_ee) / window.total - out.mean * out.mean);
}

Normal normal_equations(const Patches& patches, const Window& window, const Differences& d) {
  const float bound = 1 / (kTolerance * d.square + kNoise);
  // Per row, sums of weight w, gradient g, difference e and offset x; rows add their own offset y.
  float w = 0, we = 0;
  Eigen::Vector3f g = Eigen::Vector3f::Zero();  // of w g (1, x, y)
  Normal n{Eigen::Matrix3f::Zero(), Eigen::Vector3f::Zero()};
  for (std::size_t r = 0; r < kSide; ++r) {
    Four s_w{}, s_we{}, s_g{}, s_gx{}, s_gg{}, s_ggx{}, s_ggxx{}, s_ge{}, s_gex{};
    for (std::size_t k = 0; k < kGroups; ++k) {
      const Four e = d.e[r][k] - d.mean;
      const Four weight = window.weight[r][k] / (1 + e * e * bound);
      const Four gradient = patches.gradient(r, k);
      const Four& x = window.dx[k];
      const Four wg = weight * gradient;
      const Four wgg = wg * gradient;
      const Four wge = wg * e;
      s_w += weight;
      s_we += weight * e;
      s_g += wg;
      s_gx += wg * x;
      s_gg += wgg;
      s_ggx += wgg * x;
      s_ggxx += wgg * x * x;
      s_ge += wge;
      s_gex += wge * x;
    }
    const float y = static_cast<float>(static_cast<int>(r) - kHalf);
    const float gg = sum(s_gg), ggx = sum(s_ggx), ge = sum(s_ge), g1 = sum(s_g);
    w += sum(s_w);
    we += sum(s_we);
    g += Eigen::Vector3f(g1, sum(s_gx), y * g1);
    n.b += Eigen::Vector3f(ge, sum(s_gex), y * ge);
    n.H(0, 0) += gg;
    n.H(1, 0) += ggx;
    n.H(1, 1) += sum(s_ggxx);
    n.H(2, 0) += y * gg;
    n.H(2, 1) += y * ggx;
    n.H(2, 2) += y * y * gg;
  }
  n.H.triangularView<Eigen::StrictlyUpper>() = n.H.transpose();
  n.H -= g * g.transpose() / w;
  n.b -= g * (we / w);
  return n;
}

}  // namespace

std::optional<PatchAlignment> align_patch(const GrayImage& left, const GrayImage& right,
                                          const Eigen::Vector2f& at, float start) {
  static const Window window;
  const Patches patches(left, right, at, start);
  if (!patches.fits()) return {};
  PatchAlignment result{start, 0, 0, 0};
  Differences differences;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    compare(patches, window, result, differences);
    result.residual = std::sqrt(differences.square);
    Normal normal = normal_equations(patches, window, differences);
    if (!(normal.H(0, 0) > 1)) return {};
    normal.H(1, 1) += kSlantPrior;
    normal.H(2, 2) += kSlantPrior;
    normal.b.y() += kSlantPrior * result.slant_u;
    normal.b.z() += kSlantPrior * result.slant_v;
    const Eigen::Vector3f step = normal.H.llt().solve(normal.b);
    result.column -= step.x();
    result.slant_u -= step.y();
    result.slant_v -= step.z();
    const bool near = std::abs(result.column - start) <= kMaxMove &&
                      std::abs(result.slant_u) <= kMaxSlantU &&
                      std::abs(result.slant_v) <= kMaxSlantV;
    if (!near) return {};  // or not a number
    if (std::abs(step.x()) < 0.01f && step.tail<2>().lpNorm<Eigen::Infinity>() < 0.005f) break;
  }
  return result;
}

}  // namespace kys_slam
