#include "open_sequence.h"

#include <kys_slam/error.h>
#include <kys_slam/sequence.h>

#include <memory>

namespace kys_slam {

BuildSequence open_build_sequence(const std::filesystem::path& folder) {
  const std::shared_ptr<const Sequence> opened = open_sequence(folder);
  BuildSequence sequence;
  sequence.camera = opened->camera();
  for (std::int64_t i = 0; i < opened->frame_count(); ++i) {
    sequence.names.push_back(opened->frame(i).name);
    sequence.timestamps.push_back(opened->frame(i).timestamp);
  }
  sequence.read = [opened](std::size_t t) {
    StereoFrame frame = opened->read(static_cast<std::int64_t>(t));
    return std::pair(std::move(frame.left), std::move(frame.right));
  };
  return sequence;
}

}  // namespace kys_slam
