// SPDX-License-Identifier: BSD-3-Clause
#include "priors/builder/content_key.h"

#include <kys_slam/calibration_hash.h>
#include <kys_slam/util/hash.h>

#include <algorithm>
#include <bit>
#include <filesystem>
#include <system_error>

#include "priors/input/field_input.h"

namespace kys_slam {
namespace {

namespace fs = std::filesystem;

/// Hash of texts: what a prior file was made from.
class Digest {
 public:
  void add(const std::string& text) {
    hash_.add(text);
    hash_.add(std::uint8_t{0xFF});
  }
  void add_file(const fs::path& path) {
    std::error_code error;
    const auto size = fs::file_size(path, error);
    const auto time = fs::last_write_time(path, error);
    add(path.string() + " " + std::to_string(size) + " " +
        std::to_string(time.time_since_epoch().count()));
  }
  [[nodiscard]] std::uint64_t value() const { return hash_.value() == 0 ? 1 : hash_.value(); }

 private:
  Fnv1a hash_;
};

std::uint64_t hash_of_classes(const kys::LabelSpace& labels) {
  Digest digest;
  for (const kys::LabelClass& c : labels.classes()) {
    digest.add(std::to_string(c.id) + (c.thing ? " thing " : " stuff ") + c.name);
  }
  return digest.value();
}

}  // namespace

ContentKeys::ContentKeys(const BuildSequence& sequence, const kys::LabelSpace& labels,
                         const BuildInputs& inputs, const BuilderOptions& options,
                         const std::vector<PanopticReader>& readers)
    : sequence_(sequence),
      labels_(labels),
      inputs_(inputs),
      options_(options),
      readers_(readers),
      classes_(hash_of_classes(labels)) {}

std::uint64_t ContentKeys::of_frame(std::size_t t, std::span<const CameraPerception> perception,
                                    std::uint64_t before) const {
  const std::string& name = sequence_.names[t];
  const bool last = t + 1 == sequence_.names.size();
  Digest digest;
  digest.add(inputs_.keypoints ? "keypoints" : "");
  digest.add(std::to_string(before));
  digest.add("kysp builder 10\n" + to_text(options_) + labels_.name());
  digest.add(std::to_string(classes_));
  // Version 10 took equal numbers of the two cameras for one object.
  if (options_.detection.method == DetectionMethod::kRobust &&
      options_.association.method == AssociationMethod::kCentroid) {
    digest.add("cameras apart");
  }
  digest.add(std::to_string(calibration_hash(sequence_.camera)));
  digest.add(last ? "last" : sequence_.names[t + 1]);
  digest.add(std::to_string(static_cast<int>(inputs_.disparity_encoding)) +
             std::to_string(static_cast<int>(inputs_.flow_encoding)));
  if (reads_images(inputs_, options_)) {
    for (std::size_t i = t; i < std::min(t + 2, sequence_.names.size()); ++i) {
      digest.add(std::to_string(std::bit_cast<std::uint64_t>(sequence_.time_of(i))));
      if (i >= sequence_.files.size()) continue;
      for (const fs::path& image : sequence_.files[i]) digest.add_file(image);
    }
  }
  for (std::size_t c = 0; c < readers_.size(); ++c) {
    digest.add_file(readers_[c].path_of(name));
    const fs::path classes = readers_[c].class_path_of(name);
    if (!classes.empty()) digest.add_file(classes);
    for (const std::int32_t i : perception[c].instances) digest.add(std::to_string(i));
    // The classes of COCO segments are in a file for all frames.
    for (const InputSegment& s : perception[c].panoptic.segments) {
      digest.add(std::to_string(s.input_id) + " " + std::to_string(s.part) + " " +
                 std::to_string(s.label) + (s.thing ? " thing" : " stuff"));
    }
  }
  const auto add_source = [&](const std::string& source, auto&& find) {
    const bool folder = !source.empty() && source != "sgbm" && source != "dis";
    if (folder) digest.add_file(find(source, name));
    digest.add(source);
  };
  add_source(inputs_.disparity, find_disparity);
  add_source(inputs_.disparity_right, find_right_disparity);
  if (!last) {
    for (const std::string& source : inputs_.flow) add_source(source, find_flow);
    for (const std::string& source : inputs_.flow_back) {
      if (!source.empty()) digest.add_file(find_back_flow(source, name, sequence_.names[t + 1]));
      digest.add(source);
    }
  }
  return digest.value();
}

bool reads_images(const BuildInputs& inputs, const BuilderOptions& options) {
  return inputs.disparity == "sgbm" || inputs.flow[0] == "dis" || inputs.flow[1] == "dis" ||
         inputs.keypoints || options.detection.method == DetectionMethod::kRobust;
}

std::uint64_t key_with_later(const std::string& name, std::uint64_t last) {
  Digest digest;
  digest.add(name);
  digest.add(std::to_string(last));
  return digest.value();
}

}  // namespace kys_slam
