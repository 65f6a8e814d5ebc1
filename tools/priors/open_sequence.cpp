// SPDX-License-Identifier: BSD-3-Clause
#include "open_sequence.h"

#include <kys_slam/error.h>
#include <kys_slam/sequence.h>
#include <kys_slam/util/paths.h>
#include <kys_slam/util/read_bytes.h>

#include <algorithm>
#include <memory>
#include <sstream>

namespace kys_slam {

BuildSequence open_build_sequence(const std::filesystem::path& folder, const std::string& pair) {
  SequenceOptions options;
  options.pair = parse_camera_pair(pair);
  const std::shared_ptr<const Sequence> opened = open_sequence(folder, options);
  BuildSequence sequence;
  const Sequence::Frame& first = opened->frame(0);
  sequence.images = {first.left.parent_path().filename().string(),
                     first.right.parent_path().filename().string()};
  sequence.camera = opened->camera();
  for (std::int64_t i = 0; i < opened->frame_count(); ++i) {
    const Sequence::Frame& frame = opened->frame(i);
    sequence.names.push_back(frame.name);
    sequence.timestamps.push_back(frame.timestamp);
    sequence.files.push_back({frame.left, frame.right});
  }
  sequence.read = [opened](std::size_t t) {
    StereoFrame frame = opened->read(static_cast<std::int64_t>(t));
    return std::pair(std::move(frame.left), std::move(frame.right));
  };
  return sequence;
}

void select_frames(BuildSequence& sequence, std::int64_t start,
                   std::optional<std::int64_t> frames) {
  const auto all = static_cast<std::int64_t>(sequence.names.size());
  if (start >= all) throw InputError("--start is beyond the last frame");
  const std::int64_t count = std::min(frames.value_or(all), all - start);
  const auto select = [&](auto& of_frames) {
    const auto first = of_frames.begin() + start;
    of_frames = {first, first + count};
  };
  select(sequence.names);
  select(sequence.timestamps);
  select(sequence.files);
  sequence.read = [read = sequence.read, start = static_cast<std::size_t>(start)](std::size_t t) {
    return read(start + t);
  };
}

void check_made_of(const std::filesystem::path& input, const std::string& images) {
  const auto is_pair = [](const std::string& name) {
    return name.size() == 7 && name.starts_with("image_") && name[6] >= '0' && name[6] <= '3';
  };
  constexpr std::size_t kMostBytes = 4096;
  if (!path_exists(input / "images.txt")) return;
  std::string made;
  std::istringstream(read_text(input / "images.txt", kMostBytes)) >> made;
  if (!is_pair(made) || !is_pair(images) || made == images) return;
  throw InputError(input.string() + ": made of " + made + ", but " + images +
                   " is tracked (--pair grey or colour chooses)");
}

}  // namespace kys_slam
