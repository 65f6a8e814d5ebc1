// SPDX-License-Identifier: BSD-3-Clause
// segment_motion: how far each thing segment really moves, from exact perception and poses.
#include <kys_slam/error.h>
#include <kys_slam/run_main.h>
#include <kys_slam/sequence.h>
#include <kys_slam/util/atomic_file.h>
#include <kys_slam/util/median.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "common/command_line.h"
#include "priors/input/field_input.h"
#include "priors/input/panoptic_input.h"

namespace {

using namespace kys_slam;

struct Arguments {
  std::string sequence, output, disparity, label_space = "coco_panoptic_133";
  std::string panoptic[2], flow[2];
  PanopticEncoding panoptic_encoding = PanopticEncoding::kAuto;
  FieldEncoding encoding = FieldEncoding::kUnspecified;
};

/// The disparity of a camera at a frame, px.
ImageOf<float> disparity_of(const Arguments& a, const Sequence& sequence,
                            const std::vector<PanopticReader>& readers, std::int64_t t,
                            int camera) {
  const StereoCamera& k = sequence.camera();
  const std::string& name = sequence.frame(t).name;
  ImageOf<float> left = read_disparity(find_disparity(a.disparity, name), a.encoding, k.bf());
  if (left.width() != k.width || left.height() != k.height) {
    throw InputError(a.disparity + ": " + name + " has another size than the images");
  }
  if (camera == 0) return left;
  const PanopticMap left_map = readers[0].read(name, k.width, k.height);
  const PanopticMap right_map = readers[1].read(name, k.width, k.height);
  const ClassImage left_classes = class_image(left_map), right_classes = class_image(right_map);
  return warp_disparity_to_right(left, &left_classes, &right_classes);
}

Rigid3 pose_of(const Sequence& sequence, std::int64_t t, int camera) {
  const double shift = camera == 0 ? 0 : sequence.camera().baseline;
  const Rigid3 T_left_camera(Eigen::Quaterniond::Identity(), Eigen::Vector3d(shift, 0, 0));
  return sequence.ground_truth()[static_cast<std::size_t>(t)].T_w_c * T_left_camera;
}

/// Rows of the table: the median over a segment's pixels of how far the point seen there moves in
/// the world. A pixel counts when its flow ends in the image on a surface with disparity; pixels
/// whose end is hidden are outvoted.
std::string measure(const Arguments& a, const Sequence& sequence,
                    const std::vector<PanopticReader>& readers, std::int64_t t, int camera) {
  const StereoCamera& k = sequence.camera();
  const std::string& name = sequence.frame(t).name;
  const ImageOf<float> now = disparity_of(a, sequence, readers, t, camera);
  const ImageOf<float> next = disparity_of(a, sequence, readers, t + 1, camera);
  const Rigid3 T_w_now = pose_of(sequence, t, camera), T_w_next = pose_of(sequence, t + 1, camera);
  const FlowField flow = read_flow(find_flow(a.flow[camera], name), a.encoding);
  const PanopticMap map = readers[static_cast<std::size_t>(camera)].read(name, k.width, k.height);
  if (flow.u.width() != k.width || flow.u.height() != k.height) {
    throw InputError(a.flow[camera] + ": " + name + " has another size");
  }
  std::vector<std::vector<double>> shifts(map.segments.size()), depths(map.segments.size());
  for (int y = 0; y < k.height; ++y) {
    for (int x = 0; x < k.width; ++x) {
      const std::uint16_t s = map.map.at(x, y);
      const float d = now.at(x, y), u = flow.u.at(x, y), v = flow.v.at(x, y);
      if (s == 0 || !map.segments[s - 1u].thing || !(d > 0) || !std::isfinite(u)) continue;
      depths[s - 1u].push_back(k.bf() / d);
      const int x1 = static_cast<int>(std::lround(x + u)),
                y1 = static_cast<int>(std::lround(y + v));
      if (!next.contains(x1, y1) || !(next.at(x1, y1) > 0)) continue;
      const double z1 = k.bf() / next.at(x1, y1);
      const Eigen::Vector3d before = T_w_now * k.back_project(x, y, k.bf() / d);
      const Eigen::Vector3d after = T_w_next * k.back_project(x + double{u}, y + double{v}, z1);
      shifts[s - 1u].push_back((after - before).norm());
    }
  }
  std::string rows;
  char line[128];
  for (std::size_t i = 0; i < map.segments.size(); ++i) {
    if (shifts[i].empty()) continue;
    std::snprintf(line, sizeof line, ",%s,%u,%.4f,%.3f\n", camera == 0 ? "left" : "right",
                  map.segments[i].input_id, median(shifts[i]), median(depths[i]));
    rows += csv_field(name) + line;
  }
  return rows;
}

void run(const Arguments& a) {
  const auto sequence = open_kitti_sequence(a.sequence);
  if (static_cast<std::int64_t>(sequence->ground_truth().size()) != sequence->frame_count()) {
    throw InputError(a.sequence + ": has no pose of every frame");
  }
  const kys::LabelSpace labels = kys::load_label_space(a.label_space);
  std::string table = "frame,camera,input_id,shift_m,depth_m\n";
  std::vector<PanopticReader> readers;
  for (const std::string& folder : a.panoptic) {
    if (!folder.empty()) readers.emplace_back(folder, labels, a.panoptic_encoding);
  }
  for (int camera = 0; camera < 2; ++camera) {
    if (a.panoptic[camera].empty() || a.flow[camera].empty()) continue;
    for (std::int64_t t = 0; t + 1 < sequence->frame_count(); ++t) {
      table += measure(a, *sequence, readers, t, camera);
      if (t % 50 == 49) std::fprintf(stderr, "frame %lld\n", static_cast<long long>(t + 1));
    }
  }
  write_file_atomic(a.output, table);
}

int run(int argc, char** argv) {
  CLI::App app(
      "From exact disparity, flow and poses: how far each thing segment moves between two frames "
      "(m, in the world) and how deep it is. For score_detection.py.");
  Arguments a;
  app.add_option("sequence", a.sequence, "Sequence folder with ground truth")->required();
  app.add_option("--panoptic-left", a.panoptic[0], "Panoptic maps")->required();
  app.add_option("--panoptic-right", a.panoptic[1], "The same of the right camera");
  app.add_option("--disparity", a.disparity, "Left disparity, folder")->required();
  app.add_option("--flow-left", a.flow[0], "Flow to the next frame, folder")->required();
  app.add_option("--flow-right", a.flow[1], "The same of the right camera");
  app.add_option("--output", a.output, "Table to write (CSV)")->required();
  app.add_option("--label-space", a.label_space, "Label space")->capture_default_str();
  app.add_option("--panoptic-encoding", a.panoptic_encoding,
                 "Of panoptic maps: coco, two-channel, class-map, vkitti (default: by content)")
      ->transform(CLI::CheckedTransformer(panoptic_encodings()));
  const std::map<std::string, FieldEncoding> encodings = {{"kitti", FieldEncoding::kKitti},
                                                          {"vkitti", FieldEncoding::kVkitti}};
  app.add_option("--encoding", a.encoding, "Of PNGs: kitti, vkitti")
      ->transform(CLI::CheckedTransformer(encodings));
  if (const auto status = parse_command_line(app, argc, argv)) return *status;
  check_writable(a.output);
  run(a);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  return kys_slam::run_main("segment_motion", [&] { return run(argc, argv); });
}
