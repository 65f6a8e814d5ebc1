// SPDX-License-Identifier: BSD-3-Clause
#include "python_extractor.h"

#include <kys_slam/binariser.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <cstring>
#include <optional>
#include <utility>

#include "arrays.h"

namespace kys_slam {

namespace {

template <typename T>
using Column = nb::ndarray<const T, nb::ndim<1>, nb::device::cpu, nb::c_contig>;
using Pixels = nb::ndarray<const float, nb::shape<-1, 2>, nb::device::cpu, nb::c_contig>;
using Bits = nb::ndarray<const std::uint8_t, nb::shape<-1, 32>, nb::device::cpu, nb::c_contig>;
using Floats = nb::ndarray<const float, nb::ndim<2>, nb::device::cpu, nb::c_contig>;

ExtractorTraits traits_of(nb::handle extractor) {
  const auto number = [&](const char* name) { return nb::cast<double>(extractor.attr(name)); };
  ExtractorTraits traits;
  traits.name = nb::cast<std::string>(extractor.attr("name"));
  traits.scale_factor = number("scale_factor");
  traits.levels = nb::cast<int>(extractor.attr("levels"));
  traits.sizes = nb::cast<bool>(extractor.attr("sizes"));
  traits.reach = number("reach");
  traits.oriented = nb::cast<bool>(extractor.attr("oriented"));
  traits.pixel_sigma = number("pixel_sigma");
  const nb::object distances = extractor.attr("distances");
  if (!distances.is_none()) {
    traits.distances.matching = nb::cast<std::vector<float>>(distances["matching"]);
    traits.distances.other = nb::cast<std::vector<float>>(distances["other"]);
  }
  check_traits(traits);
  return traits;
}

class PythonExtractor final : public FeatureExtractor {
 public:
  explicit PythonExtractor(nb::handle extractor)
      : extractor_(extractor),
        traits_(traits_of(extractor)),
        seed_(nb::cast<std::uint64_t>(extractor.attr("seed"))),
        centre_(nb::cast<std::vector<float>>(extractor.attr("centre"))),
        period_(nb::cast<double>(extractor.attr("period"))) {}

  [[nodiscard]] const ExtractorTraits& traits() const override { return traits_; }

  void extract(const GrayImage& left, const GrayImage& right, FeatureSet& of_left,
               FeatureSet& of_right) override {
    const nb::gil_scoped_acquire acquired;
    extract_one(left, of_left);
    extract_one(right, of_right);
  }

 private:
  void extract_one(const GrayImage& image, FeatureSet& features) {
    const nb::object result = extractor_.attr("_of_image")(image_to_numpy(image));
    const auto pixels = nb::cast<Pixels>(result["positions"]);
    const auto octaves = nb::cast<Column<std::uint8_t>>(result["octaves"]);
    const auto angles = nb::cast<Column<float>>(result["angles"]);
    const auto scores = nb::cast<Column<float>>(result["scores"]);
    features.clear();
    for (std::size_t i = 0; i < pixels.shape(0); ++i) {
      Keypoint k;
      k.x = pixels(i, 0);
      k.y = pixels(i, 1);
      k.octave = octaves(i);
      k.angle = angles(i);
      k.response = scores(i);
      features.keypoints.push_back(k);
    }
    if (nb::cast<bool>(result["binary"])) {
      const auto bits = nb::cast<Bits>(result["descriptors"]);
      features.descriptors.resize(bits.shape(0));
      if (bits.shape(0) > 0)
        std::memcpy(features.descriptors.data(), bits.data(), 32 * bits.shape(0));
      return;
    }
    const auto floats = nb::cast<Floats>(result["descriptors"]);
    if (floats.shape(0) == 0) return;
    const auto length = static_cast<int>(floats.shape(1));
    if (!binariser_) binariser_.emplace(length, seed_, centre_, period_);
    if (binariser_->dimensions() != length) {
      throw InputError("features '" + traits_.name + "': descriptors of " + std::to_string(length) +
                       " numbers, before of " + std::to_string(binariser_->dimensions()));
    }
    const nb::gil_scoped_release released;
    binariser_->apply({floats.data(), floats.size()}, features.descriptors);
  }

  nb::handle extractor_;
  ExtractorTraits traits_;
  std::uint64_t seed_;
  std::vector<float> centre_;
  double period_;
  std::optional<Binariser> binariser_;
};

}  // namespace

std::unique_ptr<FeatureExtractor> make_python_extractor(nb::handle extractor) {
  return std::make_unique<PythonExtractor>(extractor);
}

}  // namespace kys_slam
