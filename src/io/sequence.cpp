#include "io/sequence.h"

#include <kys_slam/error.h>

#include "camera/stereo_rectifier.h"
#include "io/image_io.h"

namespace kys_slam {
namespace {

GrayImage read_image(const std::filesystem::path& path, const StereoCamera& camera) {
  GrayImage image = read_gray(path);
  if (image.width() != camera.width || image.height() != camera.height) {
    throw InputError(path.string() + ": image is " + std::to_string(image.width()) + "x" +
                     std::to_string(image.height()) + ", the sequence is " +
                     std::to_string(camera.width) + "x" + std::to_string(camera.height));
  }
  return image;
}

}  // namespace

Sequence::Sequence(Content content, std::int64_t first_index)
    : content_(std::move(content)), first_index_(first_index) {}

Sequence::~Sequence() = default;

StereoFrame Sequence::read(std::int64_t position) const {
  const Frame& source = frame(position);
  StereoFrame result;
  result.index = first_index_ + position;
  result.name = source.name;
  result.timestamp = source.timestamp;
  result.left = read_image(source.left, content_.camera);
  result.right = read_image(source.right, content_.camera);
  if (content_.rectifier) {
    result.left = content_.rectifier->rectify_left(result.left);
    result.right = content_.rectifier->rectify_right(result.right);
  }
  return result;
}

std::optional<StereoFrame> Sequence::next() {
  if (position_ >= frame_count()) return std::nullopt;
  // The position moves on first: a caller that skips an unreadable frame gets the one after it.
  return read(position_++);
}

bool is_euroc_folder(const std::filesystem::path& folder) {
  const auto has = [&](const char* name) { return std::filesystem::is_directory(folder / name); };
  return has("mav0") || (has("cam0") && has("cam1"));
}

std::unique_ptr<Sequence> open_sequence(const std::filesystem::path& folder,
                                        const SequenceOptions& options) {
  return is_euroc_folder(folder) ? open_euroc_sequence(folder, options)
                                 : open_kitti_sequence(folder, options);
}

}  // namespace kys_slam
