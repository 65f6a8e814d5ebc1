// SPDX-License-Identifier: BSD-3-Clause
#include "features/pair_extractor.h"

#include <fmt/format.h>
#include <kys_slam/error.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "util/worker.h"

namespace kys_slam {

namespace {

constexpr std::size_t kMostOfAnImage = 65535;  // the map numbers features with 16 bits

class OrbPairs final : public FeatureExtractor {
 public:
  explicit OrbPairs(const OrbOptions& options)
      : extractors_{OrbExtractor(options), OrbExtractor(options)} {
    traits_.scale_factor = options.scale_factor;
    traits_.levels = options.levels;
  }

  [[nodiscard]] const ExtractorTraits& traits() const override { return traits_; }
  void extract(const GrayImage& left, const GrayImage& right, FeatureSet& of_left,
               FeatureSet& of_right) override {
    worker_.run_beside([&] { extractors_[1].extract(right, of_right); },
                       [&] { extractors_[0].extract(left, of_left); });
  }
  [[nodiscard]] const ImagePyramid* pyramid(std::size_t side) const override {
    return &extractors_[side].pyramid();
  }

 private:
  ExtractorTraits traits_;
  std::array<OrbExtractor, 2> extractors_;  // left, right
  Worker worker_;
};

bool increases(const std::vector<float>& distances) {
  return std::is_sorted(distances.begin(), distances.end()) &&
         std::all_of(distances.begin(), distances.end(),
                     [](float d) { return d >= 0 && d <= 256; });
}

void check_distances(const DistanceQuantiles& d, const std::string& name) {
  if (d.matching.empty() && d.other.empty()) return;
  if (d.matching.size() != kMatchingShares.size() || d.other.size() != kOtherShares.size()) {
    throw InputError(fmt::format("extractor {}: {} and {} quantiles of distances, not {} and {}",
                                 name, d.matching.size(), d.other.size(), kMatchingShares.size(),
                                 kOtherShares.size()));
  }
  if (!increases(d.matching) || !increases(d.other)) {
    throw InputError(fmt::format(
        "extractor {}: quantiles of distances that do not increase within 0 to 256 bits", name));
  }
}

}  // namespace

const ImagePyramid* FeatureExtractor::pyramid(std::size_t /*side*/) const {
  return nullptr;
}

std::unique_ptr<FeatureExtractor> make_orb_extractor(const OrbOptions& options) {
  return std::make_unique<OrbPairs>(options);
}

void check_traits(const ExtractorTraits& t) {
  const bool plain =
      !t.name.empty() && t.name.size() <= 255 &&
      std::all_of(t.name.begin(), t.name.end(), [](char c) { return c > 32 && c < 127; });
  if (!plain) throw InputError("an extractor needs a name of printable characters without blanks");
  const auto check = [&](double value, double low, double high, const char* what) {
    // As floats, which maps keep.
    const auto f = static_cast<float>(value);
    if (f >= static_cast<float>(low) && f <= static_cast<float>(high)) return;
    throw InputError(
        fmt::format("extractor {}: {} is {:g}, not {:g} to {:g}", t.name, what, value, low, high));
  };
  check(t.scale_factor, 1.01, 4, "the scale factor of levels");
  check(t.levels, 1, 32, "the number of levels");
  check(t.reach, 1, 100, "the reach of descriptors");
  check(t.pixel_sigma, 0.01, 100, "the standard deviation of positions");
  check_distances(t.distances, t.name);
}

void check_feature_set(const FeatureSet& set, int width, int height, std::size_t levels,
                       std::size_t most, const std::string& where,
                       const std::string& levels_said_by) {
  if (set.keypoints.size() != set.descriptors.size()) {
    throw InputError(fmt::format("{}: {} keypoints, but {} descriptors", where,
                                 set.keypoints.size(), set.descriptors.size()));
  }
  if (set.size() > most) throw InputError(fmt::format("{}: more than {} features", where, most));
  constexpr float kTurn = 2 * std::numbers::pi_v<float>;
  for (std::size_t i = 0; i < set.size(); ++i) {
    const Keypoint& k = set.keypoints[i];
    // Corners refined to a fraction of a pixel of their octave may lie outside. A NaN does not.
    constexpr float kMargin = 16;  // px
    const bool inside = k.x >= -kMargin && k.x <= static_cast<float>(width) + kMargin &&
                        k.y >= -kMargin && k.y <= static_cast<float>(height) + kMargin;
    if (!inside) {
      throw InputError(fmt::format("{}: feature {} at ({:g}, {:g}) px is outside the image", where,
                                   i, k.x, k.y));
    }
    if (k.octave >= levels) {
      throw InputError(fmt::format("{}: feature {} is of octave {}; {} says {} octaves", where, i,
                                   k.octave, levels_said_by, levels));
    }
    if (!(k.angle >= 0 && k.angle <= kTurn)) {
      throw InputError(fmt::format("{}: the orientation of feature {} is {:g}, not in 0..2 pi",
                                   where, i, k.angle));
    }
    if (!std::isfinite(k.response)) {
      throw InputError(fmt::format("{}: the response of feature {} is not finite", where, i));
    }
  }
}

PairExtractor::PairExtractor(std::unique_ptr<FeatureExtractor> extractor)
    : extractor_(std::move(extractor)) {
  check_traits(extractor_->traits());
}

void PairExtractor::extract(const GrayImage& left, const GrayImage& right, const std::string& frame,
                            std::array<FeatureSet, 2>& features) {
  extractor_->extract(left, right, features[0], features[1]);
  if (extractor_->pyramid(0) != nullptr) return;  // of the core
  const ExtractorTraits& t = extractor_->traits();
  for (std::size_t side = 0; side < 2; ++side) {
    const GrayImage& image = side == 0 ? left : right;
    check_feature_set(features[side], image.width(), image.height(),
                      static_cast<std::size_t>(t.levels), kMostOfAnImage,
                      "extractor " + t.name + ", frame " + frame + ", " +
                          (side == 0 ? "left" : "right") + " image",
                      "extractor " + t.name);
    builders_[side].build(image, t.scale_factor, t.levels, pyramids_[side]);
  }
}

}  // namespace kys_slam
