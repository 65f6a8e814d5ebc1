// SPDX-License-Identifier: BSD-3-Clause
#include "priors/input/panoptic_input.h"

#include <kys_slam/error.h>
#include <kys_slam/image_file.h>
#include <kys_slam/util/paths.h>
#include <kys_slam/util/read_bytes.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>

#include "priors/input/coco_categories.h"
#include "priors/input/json_input.h"
#include "priors/input/vkitti_names.h"

namespace kys_slam {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

fs::path first_png(const fs::path& folder) {
  std::vector<fs::path> files;
  for (const fs::path& path : list_folder(folder)) {
    if (path.extension() == ".png") files.push_back(path);
  }
  if (files.empty()) throw InputError(folder.string() + ": has no segmentations (*.png)");
  return files.front();
}

/// Some images all over a folder.
std::vector<fs::path> some_pngs(const fs::path& folder) {
  constexpr std::size_t kMost = 5;
  std::vector<fs::path> all;
  for (const fs::path& path : list_folder(folder)) {
    if (path.extension() == ".png") all.push_back(path);
  }
  std::vector<fs::path> some;
  const std::size_t count = std::min(kMost, all.size());
  for (std::size_t i = 0; i < count; ++i) {
    some.push_back(all[count == 1 ? 0 : i * (all.size() - 1) / (count - 1)]);
  }
  return some;
}

/// What colour images without a JSON show.
struct ColourSigns {
  bool blue = false;       ///< two channels leave it at 0; of COCO's ids it is the third byte
  bool instances = false;  ///< green, of two channels the instance
  bool no_class = false;   ///< an instance without a category: green and blue of an id above 255
};

ColourSigns colour_signs(const fs::path& folder) {
  ColourSigns signs;
  for (const fs::path& image : some_pngs(folder)) {
    const RgbImage rgb = read_rgb(image);
    for (std::size_t i = 0; i < rgb.size(); ++i) {
      const RgbPixel& p = rgb.data()[i];
      signs.blue = signs.blue || p[2] != 0;
      signs.instances = signs.instances || p[1] != 0;
      signs.no_class = signs.no_class || (p[0] == 0 && p[1] != 0);
    }
  }
  return signs;
}

/// Whether the values of 8-bit images are 1, 2, .. without a gap, few of the classes there are:
/// the numbers of segments, not of classes.
bool counts_segments(const fs::path& folder, const kys::LabelSpace& labels) {
  std::set<std::uint8_t> values;
  for (const fs::path& path : some_pngs(folder)) {
    const ImageOf<std::uint8_t> image = read_indexed(path);
    values.insert(image.data(), image.data() + image.size());
  }
  values.erase(0);
  values.erase(255);
  constexpr std::size_t kFewest = 5;
  return values.size() >= kFewest && *values.rbegin() == values.size() &&
         2 * values.size() < labels.classes().size();
}

/// The colours of Virtual KITTI 2.0.3's class images (colors.txt; the same in every scene).
struct VkittiClass {
  RgbPixel colour;
  const char* name;
};
constexpr VkittiClass kVkittiClasses[] = {
    {{0, 0, 0}, "Undefined"},        {{210, 0, 200}, "Terrain"},     {{90, 200, 255}, "Sky"},
    {{0, 199, 0}, "Tree"},           {{90, 240, 0}, "Vegetation"},   {{140, 140, 140}, "Building"},
    {{100, 60, 100}, "Road"},        {{250, 100, 255}, "GuardRail"}, {{255, 255, 0}, "TrafficSign"},
    {{200, 200, 0}, "TrafficLight"}, {{255, 130, 0}, "Pole"},        {{80, 80, 80}, "Misc"},
    {{160, 60, 60}, "Truck"},        {{255, 127, 80}, "Car"},        {{0, 139, 139}, "Van"},
};

/// Index into kVkittiClasses; 0 is Undefined.
std::uint32_t vkitti_class(const RgbPixel& colour, const fs::path& path) {
  for (std::uint32_t i = 0; i < std::size(kVkittiClasses); ++i) {
    if (kVkittiClasses[i].colour == colour) return i;
  }
  throw InputError(path.string() + ": colour (" + std::to_string(colour[0]) + ", " +
                   std::to_string(colour[1]) + ", " + std::to_string(colour[2]) +
                   ") is no class of Virtual KITTI 2");
}

/// Brings per-pixel keys into the convention of PanopticMap. `key` has 0 for void; `segment_of`
/// gives label and id of a key (and may throw for one it does not know).
/// \throws InputError, starting with `name`, when there are more segments than a map can tell
/// apart.
template <typename SegmentOf>
PanopticMap make_panoptic_map(const ImageOf<std::uint32_t>& keys, const std::string& name,
                              SegmentOf&& segment_of) {
  struct Run {
    std::uint32_t key;
    int x0, x1;
  };
  std::vector<Run> runs;
  std::vector<std::size_t> row_end;
  std::map<std::uint32_t, InputSegment> found;  // by key
  for (int y = 0; y < keys.height(); ++y) {
    const std::uint32_t* row = keys.row(y);
    for (int x = 0, end = 0; x < keys.width(); x = end) {
      end = run_end(row, x, keys.width());
      runs.push_back({row[x], x, end});
      if (row[x] != 0 && !found.contains(row[x])) found.emplace(row[x], segment_of(row[x]));
    }
    row_end.push_back(runs.size());
  }
  // In order of (label, input id); stuff has input id 0, so that a class is one segment.
  std::map<std::pair<std::uint16_t, std::uint32_t>, std::uint16_t> number;
  for (const auto& [key, s] : found) number[{s.label, s.input_id}] = 0;
  if (number.size() > 65535) throw InputError(name + ": has more than 65535 segments");
  PanopticMap out;
  for (auto& [id, index] : number) {
    index = static_cast<std::uint16_t>(out.segments.size() + 1);
    out.segments.push_back({});
  }
  std::map<std::uint32_t, std::uint16_t> index_of = {{0, std::uint16_t{0}}};
  for (const auto& [key, s] : found) {
    const std::uint16_t index = number[{s.label, s.input_id}];
    out.segments[index - 1u] = s;
    index_of[key] = index;
  }
  out.map = ImageOf<std::uint16_t>::for_overwrite(keys.width(), keys.height());
  std::size_t next = 0;
  for (int y = 0; y < keys.height(); ++y) {
    const std::size_t first = out.runs.runs.size();
    out.runs.row_begin.push_back(static_cast<std::uint32_t>(first));
    for (; next < row_end[static_cast<std::size_t>(y)]; ++next) {
      const Run& run = runs[next];
      const std::uint16_t segment = index_of[run.key];
      std::fill(out.map.row(y) + run.x0, out.map.row(y) + run.x1, segment);
      const auto x1 = static_cast<std::uint16_t>(run.x1);
      // Several keys may be one class of stuff.
      const bool goes_on = out.runs.runs.size() > first && out.runs.runs.back().segment == segment;
      if (goes_on) {
        out.runs.runs.back().x1 = x1;
      } else {
        out.runs.runs.push_back({static_cast<std::uint16_t>(run.x0), x1, segment});
      }
    }
  }
  out.runs.row_begin.push_back(static_cast<std::uint32_t>(out.runs.runs.size()));
  return out;
}

}  // namespace

std::map<std::string, PanopticEncoding> panoptic_encodings() {
  return {{"coco", PanopticEncoding::kCoco},
          {"two-channel", PanopticEncoding::kTwoChannel},
          {"class-map", PanopticEncoding::kClassMap},
          {"vkitti", PanopticEncoding::kVkitti}};
}

PanopticReader::PanopticReader(fs::path folder, const kys::LabelSpace& labels,
                               PanopticEncoding encoding)
    : folder_(std::move(folder)), labels_(&labels), encoding_(encoding) {
  if (!is_folder(folder_)) throw InputError(folder_.string() + ": is not a folder");
  folder_ = fs::absolute(folder_).lexically_normal();  // "." has a name, too
  while (!folder_.has_filename() && folder_.has_relative_path()) folder_ = folder_.parent_path();
  const fs::path beside = folder_.parent_path() / (folder_.filename().string() + ".json");
  const bool json = path_exists(beside);
  if (encoding_ == PanopticEncoding::kAuto) {
    const fs::path first = json ? fs::path() : first_png(folder_);
    encoding_ = json                                   ? PanopticEncoding::kCoco
                : is_vkitti_instances(first)           ? PanopticEncoding::kVkitti
                : read_image_info(first).channels >= 3 ? PanopticEncoding::kTwoChannel
                                                       : PanopticEncoding::kClassMap;
    require_classes(beside, first);
  }
  if (encoding_ == PanopticEncoding::kCoco) {
    if (!json) throw InputError(beside.string() + ": missing; COCO panoptic needs it");
    json_ = beside;
    read_json();
  }
}

void PanopticReader::require_classes(const fs::path& json, const fs::path& first) const {
  const std::string missing = json.string() + ": missing; ";
  if (encoding_ == PanopticEncoding::kTwoChannel) {
    const ColourSigns signs = colour_signs(folder_);
    if (signs.blue || signs.no_class) {
      throw InputError(missing + "the colours of " + first.string() + " are ids of COCO panoptic");
    }
    if (!signs.instances) {
      throw InputError(
          missing + "the colours of " + first.string() +
          " have no instances in green: ids of COCO panoptic need the JSON, categories in "
          "red need --panoptic-encoding two-channel");
    }
  } else if (encoding_ == PanopticEncoding::kClassMap && counts_segments(folder_, *labels_)) {
    throw InputError(
        missing + "the values of " + first.string() +
        " are 1, 2, 3 .. without a gap: numbers of segments need the JSON, categories need "
        "--panoptic-encoding class-map");
  }
}

fs::path PanopticReader::path_of(const std::string& name) const {
  if (encoding_ == PanopticEncoding::kVkitti) return folder_ / vkitti_name("instancegt_", name);
  return folder_ / (name + ".png");
}

fs::path PanopticReader::class_path_of(const std::string& name) const {
  if (encoding_ != PanopticEncoding::kVkitti) return {};
  return folder_.parent_path().parent_path() / "classSegmentation" / folder_.filename() /
         vkitti_name("classgt_", name);
}

void PanopticReader::read_json() {
  const std::string text = read_text(json_);
  try {
    const Json document = parse_json(text, json_.string());
    label_of_category_ = coco_categories(document, *labels_, json_.string());
    for (const Json& annotation : document.at("annotations")) {
      auto& segments =
          annotations_[fs::path(annotation.at("file_name").get<std::string>()).stem().string()];
      for (const Json& s : annotation.at("segments_info")) {
        segments.emplace_back(integer_at<std::uint32_t>(s, "id", json_.string()),
                              integer_at<std::int64_t>(s, "category_id", json_.string()));
      }
    }
  } catch (const Json::exception& error) {
    throw InputError(json_.string() + ": is not a COCO panoptic file: " + error.what());
  }
}

std::uint16_t PanopticReader::label_of(std::int64_t category, const std::string& file) const {
  const auto missing = [&] { return unknown_category(category, *labels_, file); };
  if (encoding_ == PanopticEncoding::kCoco) {
    const auto found = label_of_category_.find(category);
    if (found == label_of_category_.end()) throw missing();
    return found->second;
  }
  try {
    return labels_->index_of(static_cast<std::int32_t>(category));
  } catch (const std::exception&) {
    throw missing();
  }
}

PanopticMap PanopticReader::read_coco(const std::string& name) const {
  const fs::path path = path_of(name);
  const RgbImage rgb = read_rgb(path);
  const auto annotation = annotations_.find(name);
  if (annotation == annotations_.end()) {
    throw InputError(json_.string() + ": has no annotation of " + name + ".png");
  }
  std::map<std::uint32_t, std::int64_t> category_of;
  for (const auto& [id, category] : annotation->second) {
    const auto [entry, inserted] = category_of.emplace(id, category);
    if (!inserted && entry->second != category) {
      throw InputError(json_.string() + ": " + name + ".png: segment " + std::to_string(id) +
                       " is listed with two categories");
    }
  }
  auto keys = ImageOf<std::uint32_t>::for_overwrite(rgb.width(), rgb.height());
  for (std::size_t i = 0; i < rgb.size(); ++i) {
    const RgbPixel& p = rgb.data()[i];
    keys.data()[i] = p[0] + 256u * p[1] + 65536u * p[2];
  }
  return make_panoptic_map(keys, path.string(), [&](std::uint32_t id) {
    const auto category = category_of.find(id);
    if (category == category_of.end()) {
      throw InputError(path.string() + ": segment " + std::to_string(id) + " is not in " +
                       json_.filename().string());
    }
    const std::uint16_t label = label_of(category->second, path.string());
    const bool thing = labels_->at(label).thing;
    return InputSegment{thing ? id : 0, label, thing};
  });
}

PanopticMap PanopticReader::read_two_channel(const std::string& name) const {
  const fs::path path = path_of(name);
  const RgbImage rgb = read_rgb(path);
  auto keys = ImageOf<std::uint32_t>::for_overwrite(rgb.width(), rgb.height());
  for (std::size_t i = 0; i < rgb.size(); ++i) {
    const RgbPixel& p = rgb.data()[i];
    keys.data()[i] = p[0] == 0 ? 0 : p[0] + 256u * p[1];
  }
  return make_panoptic_map(keys, path.string(), [&](std::uint32_t key) {
    const std::uint16_t label = label_of(key % 256, path.string());
    const bool thing = labels_->at(label).thing;
    return InputSegment{thing ? key : 0, label, thing};
  });
}

PanopticMap PanopticReader::read_class_map(const std::string& name) const {
  const fs::path path = path_of(name);
  const ImageOf<std::uint8_t> classes = read_indexed(path);
  // Keys begin at 1: of a data set that has a class 0, 0 is that class.
  const auto& known = labels_->classes();
  const bool has_zero =
      std::any_of(known.begin(), known.end(), [](const kys::LabelClass& c) { return c.id == 0; });
  auto keys = ImageOf<std::uint32_t>::for_overwrite(classes.width(), classes.height());
  for (std::size_t i = 0; i < classes.size(); ++i) {
    const std::uint32_t id = classes.data()[i];
    keys.data()[i] = id == 255 || (id == 0 && !has_zero) ? 0u : id + 1;
  }
  return make_panoptic_map(keys, path.string(), [&](std::uint32_t key) {
    // Without instances every class is one segment, and nothing of it moves.
    return InputSegment{0, label_of(key - 1, path.string()), false};
  });
}

/// Vehicles without an instance (far away, not tracked) are void: nothing tells them apart. Where
/// the two images disagree at an edge the class decides.
PanopticMap PanopticReader::read_vkitti(const std::string& name) const {
  const fs::path path = class_path_of(name);
  const ImageOf<std::uint8_t> instances = read_indexed(path_of(name));
  const RgbImage classes = read_rgb(path);
  if (classes.width() != instances.width() || classes.height() != instances.height()) {
    throw InputError(path.string() + ": has another size than " + path_of(name).string());
  }
  std::vector<std::pair<std::uint16_t, bool>> label_of(std::size(kVkittiClasses));
  for (std::size_t i = 1; i < label_of.size(); ++i) {
    try {
      const std::uint16_t label = labels_->index_of(std::string_view(kVkittiClasses[i].name));
      label_of[i] = {label, labels_->at(label).thing};
    } catch (const std::exception&) {
      throw InputError(path.string() + ": class " + kVkittiClasses[i].name +
                       " is not in label space " + labels_->name() + " (vkitti2 has it)");
    }
  }
  auto keys = ImageOf<std::uint32_t>::for_overwrite(classes.width(), classes.height());
  RgbPixel last_colour = {0, 0, 0};
  std::uint32_t last = 0;
  for (std::size_t i = 0; i < keys.size(); ++i) {
    if (classes.data()[i] != last_colour) {
      last = vkitti_class(classes.data()[i], path);
      last_colour = classes.data()[i];
    }
    const std::uint32_t instance = label_of[last].second ? instances.data()[i] : 0u;
    const bool nobody = label_of[last].second && instance == 0;
    keys.data()[i] = last == 0 || nobody ? 0 : last + 256u * instance;
  }
  return make_panoptic_map(keys, path.string(), [&](std::uint32_t key) {
    const auto& [label, thing] = label_of[key % 256];
    return InputSegment{key / 256, label, thing};
  });
}

PanopticMap PanopticReader::read(const std::string& name, int width, int height) const {
  PanopticMap map = encoding_ == PanopticEncoding::kCoco         ? read_coco(name)
                    : encoding_ == PanopticEncoding::kTwoChannel ? read_two_channel(name)
                    : encoding_ == PanopticEncoding::kVkitti     ? read_vkitti(name)
                                                                 : read_class_map(name);
  if (map.map.width() != width || map.map.height() != height) {
    throw InputError(path_of(name).string() + ": is " + std::to_string(map.map.width()) + "x" +
                     std::to_string(map.map.height()) + ", the sequence has " +
                     std::to_string(width) + "x" + std::to_string(height));
  }
  return map;
}

}  // namespace kys_slam
