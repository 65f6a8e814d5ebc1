// SPDX-License-Identifier: BSD-3-Clause
#include "measure/stored_features.h"

#include <fmt/format.h>
#include <kys_slam/error.h>

#include <cstdint>
#include <cstring>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>

namespace kys_slam {

namespace {

using ImageKey = std::pair<std::uint64_t, std::uint64_t>;

/// Sums of the pixels and of the pixels times their numbers, from 1.
ImageKey key_of(const GrayImage& image) {
  ImageKey key{0, 0};
  std::uint64_t number = 0;
  for (int y = 0; y < image.height(); ++y) {
    for (int x = 0; x < image.width(); ++x) {
      const std::uint64_t value = image.at(x, y);
      key.first += value;
      key.second += value * ++number;
    }
  }
  return key;
}

ExtractorTraits traits_of(const nlohmann::json& header) {
  ExtractorTraits traits;
  traits.name = header.at("name");
  traits.scale_factor = header.at("scale_factor");
  traits.levels = header.at("levels");
  traits.sizes = header.at("sizes");
  traits.reach = header.at("reach");
  traits.oriented = header.at("oriented");
  traits.pixel_sigma = header.at("pixel_sigma");
  traits.distances.matching = header.at("matching").get<std::vector<float>>();
  traits.distances.other = header.at("other").get<std::vector<float>>();
  check_traits(traits);
  return traits;
}

class StoredFeatures final : public FeatureExtractor {
 public:
  explicit StoredFeatures(const std::filesystem::path& file)
      : file_(file.string()), stream_(file, std::ios::binary) {
    std::string line;
    if (!std::getline(stream_, line)) throw InputError(file_ + ": cannot be read");
    try {
      traits_ = traits_of(nlohmann::json::parse(line));
    } catch (const nlohmann::json::exception& error) {
      throw InputError(fmt::format("{}: {}", file_, error.what()));
    }
    while (stream_.peek() != std::ifstream::traits_type::eof()) read_image();
  }

  [[nodiscard]] const ExtractorTraits& traits() const override { return traits_; }
  void extract(const GrayImage& left, const GrayImage& right, FeatureSet& of_left,
               FeatureSet& of_right) override {
    of_left = look_up(left);
    of_right = look_up(right);
  }

 private:
  template <typename T>
  T read() {
    T value{};
    if (!stream_.read(reinterpret_cast<char*>(&value), sizeof(value))) {
      throw InputError(file_ + ": ends in the middle of an image");
    }
    return value;
  }

  void read_image() {
    constexpr std::uint32_t kMost = 65535;
    ImageKey key;
    key.first = read<std::uint64_t>();
    key.second = read<std::uint64_t>();
    const auto count = read<std::uint32_t>();
    if (count > kMost) throw InputError(fmt::format("{}: {} features of an image", file_, count));
    FeatureSet& set = images_[key];
    set.clear();
    for (std::uint32_t i = 0; i < count; ++i) {
      Keypoint k;
      k.x = read<float>();
      k.y = read<float>();
      k.angle = read<float>();
      k.response = read<float>();
      k.octave = read<std::uint8_t>();
      set.keypoints.push_back(k);
      set.descriptors.push_back(read<kys::Descriptor>());
    }
  }

  [[nodiscard]] const FeatureSet& look_up(const GrayImage& image) const {
    const auto at = images_.find(key_of(image));
    if (at == images_.end()) throw InputError(file_ + ": holds no features of an image");
    return at->second;
  }

  std::string file_;
  std::ifstream stream_;
  ExtractorTraits traits_;
  std::map<ImageKey, FeatureSet> images_;
};

}  // namespace

std::unique_ptr<FeatureExtractor> open_stored_features(const std::filesystem::path& file) {
  return std::make_unique<StoredFeatures>(file);
}

}  // namespace kys_slam
