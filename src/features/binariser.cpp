// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <kys_slam/binariser.h>
#include <kys_slam/error.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace kys_slam {

namespace {

constexpr std::size_t kBits = 256;

/// SplitMix64 (Steele et al., 2014).
std::uint64_t next_state(std::uint64_t& state) {
  state += 0x9E3779B97F4A7C15ULL;
  std::uint64_t z = state;
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ULL;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBULL;
  return z ^ (z >> 31);
}

/// Nearly normal: the number of ones among 128 random bits, less its mean. Does not depend on a
/// mathematical library.
double next_weight(std::uint64_t& state) {
  int ones = 0;
  for (int word = 0; word < 2; ++word) {
    for (std::uint64_t left = next_state(state); left != 0; left &= left - 1) ++ones;
  }
  return ones - 64;
}

double dot(std::span<const double> a, std::span<const double> b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
  return sum;
}

/// The 256 projections, one after the other: random, orthonormal in groups of as many as there are
/// dimensions.
std::vector<double> make_projections(std::size_t length, std::uint64_t state) {
  constexpr double kLeast = 1e-3;  // of a direction that is left when those before are taken out
  std::vector<double> all(kBits * length);
  const auto projection = [&](std::size_t b) {
    return std::span<double>(&all[b * length], length);
  };
  for (std::size_t b = 0; b < kBits; ++b) {
    const std::span<double> own = projection(b);
    double left = 0, drawn = 0;
    while (!(left > kLeast * drawn)) {
      for (double& w : own) w = next_weight(state);
      drawn = std::sqrt(dot(own, own));
      for (std::size_t k = b - b % length; k < b; ++k) {
        const double share = dot(projection(k), own);
        for (std::size_t i = 0; i < length; ++i) own[i] -= share * projection(k)[i];
      }
      left = std::sqrt(dot(own, own));
    }
    for (double& w : own) w /= left;
  }
  return all;
}

/// Where on their circle the bits of a projection change, in periods, by bit: evenly; those with
/// even numbers come first, so that the first half of all bits is even as well.
std::vector<float> make_phases(std::size_t circles) {
  std::vector<float> phases(kBits);
  for (std::size_t b = 0; b < kBits; ++b) {
    const std::size_t circle = b % circles, nth = b / circles;
    const std::size_t count = (kBits - circle + circles - 1) / circles;
    const std::size_t place = 2 * nth < count ? 2 * nth : 2 * (nth - (count + 1) / 2) + 1;
    phases[b] = (static_cast<float>(place) + 0.5F) / static_cast<float>(count);
  }
  return phases;
}

/// Whether the whole number below is odd.
bool in_odd_period(float value) {
  return value - 2 * std::floor(value / 2) >= 1;
}

}  // namespace

Binariser::Binariser(int dimensions, std::uint64_t seed, std::vector<float> centre, double period)
    : dimensions_(dimensions), circles_(period != 0), centre_(std::move(centre)), phases_(kBits) {
  if (dimensions < 1 || dimensions > kMostDimensions) {
    throw InputError(
        fmt::format("descriptors of {} numbers: 1 to {} expected", dimensions, kMostDimensions));
  }
  if (!centre_.empty() && centre_.size() != static_cast<std::size_t>(dimensions)) {
    throw InputError(fmt::format("the centre of descriptors has {} numbers, descriptors have {}",
                                 centre_.size(), dimensions));
  }
  for (const float c : centre_) {
    if (!(std::abs(c) <= 1e30F)) throw InputError("the centre of descriptors is not finite");
  }
  if (circles_ && !(period >= 1e-6 && period <= 1e6)) {
    throw InputError(fmt::format("a period of {} of descriptors: 1e-6 to 1e6 expected", period));
  }
  const auto length = static_cast<std::size_t>(dimensions);
  const std::size_t circles = std::min(length, kBits);
  if (circles_) phases_ = make_phases(circles);
  const std::vector<double> projections = make_projections(length, seed);
  weights_.resize(projections.size());
  for (std::size_t d = 0; d < length; ++d) {
    for (std::size_t b = 0; b < kBits; ++b) {
      const std::size_t k = circles_ ? b % circles : b;
      weights_[d * kBits + b] =
          static_cast<float>(projections[k * length + d] / (circles_ ? period : 1));
    }
  }
}

void Binariser::apply(std::span<const float> values, std::vector<kys::Descriptor>& bits) const {
  const auto length = static_cast<std::size_t>(dimensions_);
  if (values.size() % length != 0) {
    throw InputError(fmt::format("{} numbers are no descriptors of {}", values.size(), length));
  }
  const std::size_t count = values.size() / length;
  bits.assign(count, {});
  for (std::size_t i = 0; i < count; ++i) {
    const std::span<const float> descriptor = values.subspan(i * length, length);
    // Lanes are bits: vector instructions of any width add the dimensions in the same order.
    std::array<float, kBits> sums{};
    for (std::size_t d = 0; d < length; ++d) {
      if (!(std::abs(descriptor[d]) <= 1e30F)) {
        throw InputError(fmt::format("descriptor {} has a number that is not finite", i));
      }
      const float x = centre_.empty() ? descriptor[d] : descriptor[d] - centre_[d];
      const float* weights = &weights_[d * kBits];
      for (std::size_t b = 0; b < kBits; ++b) sums[b] += x * weights[b];
    }
    for (std::size_t b = 0; b < kBits; ++b) {
      const bool one = circles_ ? in_odd_period(sums[b] + phases_[b]) : sums[b] > 0;
      if (one) bits[i].words[b / 64] |= std::uint64_t{1} << (b % 64);
    }
  }
}

}  // namespace kys_slam
