// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/label_space.h>

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "priors/fusion/panoptic.h"

namespace kys_slam {

/// How a folder of segmentations is encoded.
enum class PanopticEncoding {
  kAuto,        ///< kCoco when DIR.json exists, else by the first image
  kCoco,        ///< DIR/<name>.png with id = R + 256 G + 65536 B, 0 void, and DIR.json
  kTwoChannel,  ///< R category id of the data set, G instance; category 0 void
  kClassMap,    ///< 8-bit: category id of the data set, 255 void, and 0 unless a class has that id;
                ///< no instances
  kVkitti,      ///< Virtual KITTI 2: .../instanceSegmentation/Camera_c/instancegt_*.png and
                ///< .../classSegmentation/Camera_c/classgt_*.png
};

/// By name, as options have them: coco, two-channel, class-map, vkitti.
std::map<std::string, PanopticEncoding> panoptic_encodings();

/// Reads segmentations from a folder, frame by frame, and converts them to one convention. Category
/// ids are those of the data set and are looked up in the label space. Stuff is merged by class;
/// thing segments stay separate.
class PanopticReader {
 public:
  /// Reads DIR.json, if it exists. \throws InputError naming file and reason; with kAuto also for
  /// images without DIR.json whose values may be numbers of segments.
  PanopticReader(std::filesystem::path folder, const kys::LabelSpace& labels,
                 PanopticEncoding encoding = PanopticEncoding::kAuto);

  /// \throws InputError for a missing or corrupt image, another size than `width` x `height`, a
  /// segment or category that is not declared.
  [[nodiscard]] PanopticMap read(const std::string& name, int width, int height) const;

  /// The segmentation file of a frame; `name` is the stem of the camera image.
  [[nodiscard]] std::filesystem::path path_of(const std::string& name) const;
  /// kVkitti: the file with the classes of a frame. Empty for other encodings.
  [[nodiscard]] std::filesystem::path class_path_of(const std::string& name) const;
  [[nodiscard]] PanopticEncoding encoding() const { return encoding_; }
  /// Path of the JSON; empty without one.
  [[nodiscard]] const std::filesystem::path& json() const { return json_; }

 private:
  void read_json();
  /// \throws InputError when images without the JSON hold numbers of segments, or may do so
  void require_classes(const std::filesystem::path& json, const std::filesystem::path& first) const;
  [[nodiscard]] std::uint16_t label_of(std::int64_t category, const std::string& file) const;
  [[nodiscard]] PanopticMap read_coco(const std::string& name) const;
  [[nodiscard]] PanopticMap read_two_channel(const std::string& name) const;
  [[nodiscard]] PanopticMap read_class_map(const std::string& name) const;
  [[nodiscard]] PanopticMap read_vkitti(const std::string& name) const;

  std::filesystem::path folder_;
  std::filesystem::path json_;
  const kys::LabelSpace* labels_;
  PanopticEncoding encoding_;
  std::map<std::int64_t, std::uint16_t> label_of_category_;
  /// By stem: input id and category id.
  std::map<std::string, std::vector<std::pair<std::uint32_t, std::int64_t>>> annotations_;
};

}  // namespace kys_slam
