// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/error.h>
#include <kys_slam/image_file.h>
#include <kys_slam/trajectory_file.h>
#include <kys_slam/util/median.h>
#include <kys_slam/util/text_table.h>

#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "camera/plausible.h"
#include "io/sequence_parts.h"

namespace kys_slam {
namespace fs = std::filesystem;
namespace {

/// Rows "frame cameraID ..."; a header line of words comes first.
template <typename Function>
void for_each_row(const TextTable& table, std::size_t columns, Function&& use) {
  bool first = true;
  for (const TextRow& row : table.rows()) {
    if (std::exchange(first, false) && row.fields[0] == "frame") continue;
    if (row.fields.size() != columns) {
      table.fail(row, std::to_string(row.fields.size()) + " columns instead of " +
                          std::to_string(columns));
    }
    use(row, table.integer(row, 0), table.integer(row, 1));
  }
}

/// Focal lengths and principal point, which must be the same on every row.
void read_intrinsics(const fs::path& file, StereoCamera& camera) {
  const TextTable table(file);
  std::vector<double> K;
  for_each_row(table, 6, [&](const TextRow& row, std::int64_t, std::int64_t) {
    const std::vector<double> values = table.numbers(row, 2);
    if (K.empty()) K = values;
    if (values != K) table.fail(row, "intrinsics change within the sequence");
  });
  if (K.empty()) throw InputError(file.string() + ": no intrinsics");
  camera.fx = K[0];
  camera.fy = K[1];
  camera.cx = K[2];
  camera.cy = K[3];
}

using Extrinsics = std::map<std::int64_t, std::array<std::optional<Rigid3>, 2>>;

/// World-to-camera transforms T_c_w by frame and camera.
Extrinsics read_extrinsics(const fs::path& file) {
  const TextTable table(file);
  Extrinsics extrinsics;
  for_each_row(table, 18, [&](const TextRow& row, std::int64_t frame, std::int64_t camera) {
    if (camera < 0 || camera > 1) table.fail(row, "camera is neither 0 nor 1");
    const std::vector<double> values = table.numbers(row, 2);
    const auto pose = rigid_from_row_major(values.data());
    if (!pose) table.fail(row, "not a rotation matrix");
    auto& entry = extrinsics[frame][static_cast<std::size_t>(camera)];
    if (entry) table.fail(row, "a second pose of this frame and camera");
    entry = *pose;
  });
  return extrinsics;
}

std::int64_t number_of(const std::string& stem) {
  const std::size_t begin = stem.find_last_not_of("0123456789") + 1;  // npos + 1 is 0
  return begin < stem.size() && stem.size() - begin < 18 ? std::stoll(stem.substr(begin)) : -1;
}

}  // namespace

std::unique_ptr<Sequence> open_virtual_kitti(const fs::path& folder,
                                             const SequenceOptions& options) {
  Sequence::Content content;
  content.name = folder.parent_path().filename().string() + "-" + folder.filename().string();
  content.layout = "Virtual KITTI 2";
  const fs::path images = folder / "frames" / "rgb";
  NamedPairs pairs = pair_by_name(images / "Camera_0", images / "Camera_1");
  content.dropped = pairs.dropped;
  content.frames = std::move(pairs.frames);
  const fs::path intrinsic_file = folder / "intrinsic.txt";
  read_intrinsics(intrinsic_file, content.camera);
  const ImageInfo info = read_image_info(content.frames.front().left);
  content.camera.width = info.width;
  content.camera.height = info.height;

  const fs::path extrinsic_file = folder / "extrinsic.txt";
  const Extrinsics extrinsics = read_extrinsics(extrinsic_file);
  std::vector<double> baselines;
  for (std::size_t i = 0; i < content.frames.size(); ++i) {
    Sequence::Frame& frame = content.frames[i];
    frame.timestamp = pairs.time_of(i, kFrameRate);
    const auto found = extrinsics.find(number_of(frame.name));
    if (found == extrinsics.end() || !found->second[0] || !found->second[1]) {
      throw InputError(extrinsic_file.string() + ": no pose of both cameras for " + frame.name);
    }
    const Rigid3& T_c_w = *found->second[0];
    const Rigid3 T_r_c = *found->second[1] * T_c_w.inverse();
    baselines.push_back(-T_r_c.t().x());
    if (std::abs(baselines.back() - baselines.front()) > 1e-2 ||
        T_r_c.t().tail<2>().norm() > 1e-2 || rotation_angle(T_r_c) > 1e-2) {
      throw InputError(extrinsic_file.string() + ": the cameras of " + frame.name +
                       " are not a rectified pair");
    }
    content.ground_truth.push_back({frame.timestamp, T_c_w.inverse()});
  }
  // Positions far from the world's origin are rounded to a tenth of a millimetre: one frame's
  // baseline would be off by as much.
  content.camera.baseline = median(baselines);
  if (!content.camera.is_valid()) {
    throw InputError(intrinsic_file.string() + ": invalid calibration");
  }
  require_plausible(content.camera, intrinsic_file.string() + ", " + extrinsic_file.string());
  make_relative_to_first(content.ground_truth);
  return make_sequence(std::move(content), options, folder);
}

}  // namespace kys_slam
