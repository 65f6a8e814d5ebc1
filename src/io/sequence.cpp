// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/error.h>
#include <kys_slam/image_file.h>
#include <kys_slam/same_image.h>
#include <kys_slam/sequence.h>
#include <kys_slam/stereo_rectifier.h>
#include <kys_slam/util/paths.h>
#include <kys_slam/util/read_bytes.h>

#include <cstdint>

namespace kys_slam {
namespace {

GrayImage read_image(const std::filesystem::path& path, const StereoCamera& camera, int bits) {
  const std::vector<std::uint8_t> bytes = read_bytes(path);
  // Before memory for an image of any other size is allocated.
  const ImageInfo info = decode_image_info(bytes, path.string());
  if (info.width != camera.width || info.height != camera.height) {
    throw InputError(path.string() + ": image is " + std::to_string(info.width) + "x" +
                     std::to_string(info.height) + ", the sequence is " +
                     std::to_string(camera.width) + "x" + std::to_string(camera.height));
  }
  return decode_gray(bytes, path.string(), bits);
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
  result.left = read_image(source.left, content_.camera, content_.bits);
  result.right = read_image(source.right, content_.camera, content_.bits);
  if (content_.rectifier) {
    // What is the same image before rectification stays one, for those who look at rectified
    // images.
    const bool same = is_same_image(result.left, result.right);
    result.left = content_.rectifier->rectify_left(result.left);
    result.right = same ? result.left : content_.rectifier->rectify_right(result.right);
  }
  return result;
}

std::optional<StereoFrame> Sequence::next() {
  if (position_ >= frame_count()) return std::nullopt;
  // The position moves on first: a caller that skips an unreadable frame gets the one after it.
  return read(position_++);
}

CameraPair parse_camera_pair(const std::string& name) {
  if (name.empty()) return CameraPair::kFirst;
  if (name == "grey") return CameraPair::kGrey;
  if (name == "colour") return CameraPair::kColour;
  throw InputError("'" + name + "' is no camera pair: grey or colour");
}

bool is_euroc_folder(const std::filesystem::path& folder) {
  const auto has = [&](const char* name) { return is_folder(folder / name); };
  return has("mav0") || (has("cam0") && has("cam1"));
}

std::unique_ptr<Sequence> open_sequence(const std::filesystem::path& folder,
                                        const SequenceOptions& options) {
  return is_euroc_folder(folder) ? open_euroc_sequence(folder, options)
                                 : open_kitti_sequence(folder, options);
}

}  // namespace kys_slam
