// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/binariser.h>
#include <kys_slam/feature_extractor.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <cstring>

#include "arrays.h"
#include "bind.h"

namespace kys_slam {

using namespace nb::literals;

namespace {

using Floats = nb::ndarray<const float, nb::ndim<2>, nb::device::cpu, nb::c_contig>;

nb::ndarray<nb::numpy, std::uint8_t> bits_to_numpy(const std::vector<kys::Descriptor>& bits) {
  std::vector<std::uint8_t> bytes(32 * bits.size());
  if (!bits.empty()) std::memcpy(bytes.data(), bits.data(), bytes.size());
  return to_numpy(std::move(bytes), {bits.size(), 32});
}

nb::ndarray<nb::numpy, std::uint8_t> binarise(const Floats& descriptors, std::uint64_t seed,
                                              std::vector<float> centre, double period) {
  std::vector<kys::Descriptor> bits;
  if (descriptors.shape(0) > 0) {
    const nb::gil_scoped_release released;
    const Binariser binariser(static_cast<int>(descriptors.shape(1)), seed, std::move(centre),
                              period);
    binariser.apply({descriptors.data(), descriptors.size()}, bits);
  }
  return bits_to_numpy(bits);
}

nb::dict to_dict(const FeatureSet& set) {
  std::vector<float> pixels;
  for (const Keypoint& k : set.keypoints) pixels.insert(pixels.end(), {k.x, k.y});
  nb::dict d;
  d["positions"] = to_numpy(std::move(pixels), {set.size(), 2});
  d["descriptors"] = bits_to_numpy(set.descriptors);
  d["octaves"] = column<std::uint8_t>(set.keypoints, [](const Keypoint& k) { return k.octave; });
  d["angles"] = column<float>(set.keypoints, [](const Keypoint& k) { return k.angle; });
  d["scores"] = column<float>(set.keypoints, [](const Keypoint& k) { return k.response; });
  return d;
}

}  // namespace

void bind_features(nb::module_& m) {
  m.def("_binarise", &binarise, "descriptors"_a, "seed"_a, "centre"_a, "period"_a);
  m.attr("MATCHING_SHARES") =
      nb::cast(std::vector<double>(kMatchingShares.begin(), kMatchingShares.end()));
  m.attr("OTHER_SHARES") = nb::cast(std::vector<double>(kOtherShares.begin(), kOtherShares.end()));
  m.def(
      "_equivalent_distance",
      [](float bits, std::vector<float> matching, std::vector<float> other) {
        return equivalent_distance(bits, {std::move(matching), std::move(other)});
      },
      "bits"_a, "matching"_a, "other"_a);
  m.def(
      "_orb_features",
      [](const AnyArray& left, const AnyArray& right, const Settings& settings) {
        FeatureSet of_left, of_right;
        const ImageView l = view_of(left, "left image", false);
        const ImageView r = view_of(right, "right image", false);
        {
          const nb::gil_scoped_release released;
          make_orb_extractor(settings)->extract(to_gray(l), to_gray(r), of_left, of_right);
        }
        return nb::make_tuple(to_dict(of_left), to_dict(of_right));
      },
      "left"_a, "right"_a, "settings"_a);
}

}  // namespace kys_slam
