// SPDX-License-Identifier: BSD-3-Clause
#include "readers.h"

#include <kys/error.h>
#include <kys/label_space.h>
#include <kys_slam/error.h>
#include <kys_slam/feature_file.h>
#include <kys_slam/image_file.h>
#include <kys_slam/prior_format.h>
#include <kys_slam/prior_writer.h>
#include <kys_slam/sequence.h>
#include <kys_slam/settings.h>
#include <kys_slam/stereo_rig.h>
#include <kys_slam/trajectory_file.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

#include "io/feature_payload.h"
#include "map_file/map_file.h"
#include "map_file/map_format.h"
#include "object_files.h"
#ifdef KYS_FUZZ_CLOUDS
#include "point_cloud.h"
#endif
#include "priors/input/field_input.h"
#include "priors/input/panoptic_input.h"

namespace kys_slam::fuzz {

namespace {

namespace fs = std::filesystem;

[[noreturn]] void finding(const char* what) {
  throw std::logic_error(what);
}

void put(std::vector<std::uint8_t>& bytes, std::size_t at, std::uint32_t value) {
  for (std::size_t i = 0; i < 4; ++i) bytes[at + i] = static_cast<std::uint8_t>(value >> (8 * i));
}

/// A folder of this process in memory, removed at its end.
class Scratch {
 public:
  Scratch() : folder_(base() / ("kys_fuzz_" + std::to_string(::getpid()))) {
    fs::create_directories(folder_);
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
  ~Scratch() {
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
  }
  [[nodiscard]] fs::path operator/(const fs::path& name) const { return folder_ / name; }

 private:
  static fs::path base() {
    return fs::is_directory("/dev/shm") ? fs::path("/dev/shm") : fs::temp_directory_path();
  }
  fs::path folder_;
};

const Scratch& scratch() {
  static const Scratch folder;
  return folder;
}

void write(const fs::path& path, Bytes bytes) {
  std::FILE* file = std::fopen(path.c_str(), "wb");
  if (file == nullptr) std::abort();
  if (!bytes.empty()) std::fwrite(bytes.data(), 1, bytes.size(), file);
  std::fclose(file);
}
void write(const fs::path& path, std::string_view text) {
  write(path, Bytes(reinterpret_cast<const std::uint8_t*>(text.data()), text.size()));
}

/// The bytes as a file of that name.
fs::path file_of(Bytes bytes, const char* name) {
  const fs::path path = scratch() / name;
  write(path, bytes);
  return path;
}

// --- images --------------------------------------------------------------------------------------

/// Each kind of decoding for itself: what one refuses, another may take.
template <typename Decode>
void try_decode(Decode&& decode) {
  try {
    decode();
  } catch (const InputError&) {
  }
}

/// Puts right the checksums of a PNG's chunks, without which hardly a change would get past them.
std::vector<std::uint8_t> mend_png(Bytes input) {
  std::vector<std::uint8_t> bytes(input.begin(), input.end());
  const auto load = [&](std::size_t at) {
    return std::uint32_t{bytes[at]} << 24 | std::uint32_t{bytes[at + 1]} << 16 |
           std::uint32_t{bytes[at + 2]} << 8 | std::uint32_t{bytes[at + 3]};
  };
  for (std::size_t at = 8; at + 12 <= bytes.size();) {
    const std::size_t length = load(at);
    if (length > bytes.size() - at - 12) break;
    const std::uint32_t crc = prior_format::crc32(bytes.data() + at + 4, length + 4);
    for (std::size_t i = 0; i < 4; ++i) {
      bytes[at + 8 + length + i] = static_cast<std::uint8_t>(crc >> (24 - 8 * i));
    }
    at += length + 12;
  }
  return bytes;
}

void read_image(Bytes bytes) {
  try_decode([&] {
    const ImageInfo info = decode_image_info(bytes, "fuzz");
    if (info.width < 1 || info.height < 1 || info.width > kMaxImageSide) finding("size");
    const GrayImage gray = decode_gray(bytes, "fuzz");
    if (gray.width() != info.width || gray.height() != info.height) finding("size of pixels");
  });
  try_decode([&] { decode_rgb(bytes, "fuzz"); });
  try_decode([&] { decode_u16(bytes, "fuzz"); });
  try_decode([&] { decode_rgb16(bytes, "fuzz"); });
  try_decode([&] { decode_indexed(bytes, "fuzz"); });
}

// --- sequences -----------------------------------------------------------------------------------

void read_png(Bytes bytes) {
  read_image(mend_png(bytes));
}

constexpr std::string_view kCalibration =
    "P0: 40 0 24 0 0 40 16 0 0 0 1 0\nP1: 40 0 24 -20 0 40 16 0 0 0 1 0\n";
constexpr std::string_view kSensor =
    "camera_model: pinhole\ndistortion_model: radial-tangential\n"
    "distortion_coefficients: [0.0, 0.0, 0.0, 0.0]\nresolution: [48, 32]\n"
    "intrinsics: [40, 40, 24, 16]\nT_BS:\n  cols: 4\n  rows: 4\n"
    "  data: [1.0, 0, 0, X, 0, 1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0]\n";

std::string sensor(int camera) {
  std::string text(kSensor);
  text.replace(text.find('X'), 1, camera == 0 ? "0" : "0.5");
  return text;
}

GrayImage image(int shift) {
  GrayImage image(48, 32);
  for (int y = 0; y < image.height(); ++y) {
    for (int x = 0; x < image.width(); ++x) {
      image.at(x, y) = static_cast<std::uint8_t>(((x + shift) / 5 * 37 + y / 4 * 91) % 256);
    }
  }
  return image;
}

const fs::path& kitti_folder() {
  static const fs::path folder = [] {
    const fs::path made = scratch() / "kitti";
    for (const int camera : {0, 1}) {
      const fs::path images = made / ("image_" + std::to_string(camera));
      fs::create_directories(images);
      for (const char* name : {"000000.png", "000001.png"}) {
        write_png(images / name, image(4 * camera));
      }
    }
    write(made / "calib.txt", kCalibration);
    write(made / "times.txt", "0.0\n0.1\n");
    return made;
  }();
  return folder;
}

const fs::path& euroc_folder() {
  static const fs::path folder = [] {
    const fs::path made = scratch() / "euroc";
    for (const int camera : {0, 1}) {
      const fs::path place = made / "mav0" / ("cam" + std::to_string(camera));
      fs::create_directories(place / "data");
      for (const char* name : {"1.png", "2.png"}) {
        write_png(place / "data" / name, image(4 * camera));
      }
      write(place / "data.csv", "#timestamp [ns],filename\n1000000000,1.png\n2000000000,2.png\n");
      write(place / "sensor.yaml", sensor(camera));
    }
    return made;
  }();
  return folder;
}

/// Opens a folder in which one file is the fuzzer's, and reads its frames.
void read_with(const fs::path& folder, const fs::path& file, Bytes bytes) {
  write(folder / file, bytes);
  const auto sequence = open_sequence(folder);
  while (const auto frame = sequence->next()) {
    if (frame->left.width() != sequence->camera().width) finding("frame and camera differ");
  }
}

void read_calib(Bytes bytes) {
  read_with(kitti_folder(), "calib.txt", bytes);
}
void read_times(Bytes bytes) {
  write(kitti_folder() / "calib.txt", kCalibration);
  read_with(kitti_folder(), "times.txt", bytes);
}
void read_data_csv(Bytes bytes) {
  read_with(euroc_folder(), "mav0/cam1/data.csv", bytes);
}

/// Images of two frames as `left`, `right` name them.
void write_images(const fs::path& left, const fs::path& right, const char* stem) {
  int shift = 0;
  for (const fs::path& images : {left, right}) {
    fs::create_directories(images);
    for (int i = 0; i < 2; ++i) {
      write_png(images / (stem + std::to_string(i) + ".png"), image(shift));
    }
    shift += 4;
  }
}

constexpr std::string_view kTrackingCalibration =
    "P2: 40 0 24 2 0 40 16 0 0 0 1 0\nP3: 40 0 24 -18 0 40 16 0 0 0 1 0\n"
    "R_rect 1 0 0 0 1 0 0 0 1\nTr_velo_cam 0 -1 0 0 0 0 -1 -0.1 1 0 0 -0.3\n"
    "Tr_imu_velo 1 0 0 -0.8 0 1 0 0.3 0 0 1 -0.8\n";
constexpr std::string_view kOxts =
    "49.01 8.43 112.8 0.02 0.01 -1.9 0 0\n49.010001 8.43 112.8 0.02 0.01 -1.9 0 0\n";

/// Sequence 0000 of KITTI Tracking; the images' folder names the sequence.
const fs::path& tracking_folder() {
  static const fs::path folder = [] {
    const fs::path made = scratch() / "tracking";
    write_images(made / "image_02" / "0000", made / "image_03" / "0000", "00000");
    for (const char* name : {"calib", "oxts"}) fs::create_directories(made / name);
    write(made / "calib" / "0000.txt", kTrackingCalibration);
    write(made / "oxts" / "0000.txt", kOxts);
    return made;
  }();
  return folder;
}

/// Opens a sequence and looks at what its texts say.
void check_texts(const fs::path& folder) {
  const auto sequence = open_sequence(folder);
  if (!sequence->camera().is_valid()) finding("an invalid camera");
  for (const TimedPose& pose : sequence->ground_truth()) {
    if (!pose.T_w_c.is_finite()) finding("a pose that is not finite");
  }
}

void read_tracking(const char* file, Bytes bytes) {
  write(tracking_folder() / file, bytes);
  check_texts(tracking_folder() / "image_02" / "0000");
}
void read_tracking_calib(Bytes bytes) {
  write(tracking_folder() / "oxts" / "0000.txt", kOxts);
  read_tracking("calib/0000.txt", bytes);
}
void read_tracking_oxts(Bytes bytes) {
  write(tracking_folder() / "calib" / "0000.txt", kTrackingCalibration);
  read_tracking("oxts/0000.txt", bytes);
}

constexpr std::string_view kIntrinsics =
    "frame cameraID K[0,0] K[1,1] K[0,2] K[1,2]\n0 0 40 40 24 16\n0 1 40 40 24 16\n";
constexpr std::string_view kExtrinsics =
    "0 0 1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n0 1 1 0 0 -0.5 0 1 0 0 0 0 1 0 0 0 0 1\n"
    "1 0 1 0 0 0 0 1 0 0 0 0 1 -1 0 0 0 1\n1 1 1 0 0 -0.5 0 1 0 0 0 0 1 -1 0 0 0 1\n";

const fs::path& virtual_folder() {
  static const fs::path folder = [] {
    const fs::path made = scratch() / "Scene01" / "clone";
    const fs::path images = made / "frames" / "rgb";
    write_images(images / "Camera_0", images / "Camera_1", "rgb_0000");
    write(made / "intrinsic.txt", kIntrinsics);
    write(made / "extrinsic.txt", kExtrinsics);
    return made;
  }();
  return folder;
}

void read_virtual(const char* file, Bytes bytes) {
  write(virtual_folder() / file, bytes);
  check_texts(virtual_folder());
}
void read_virtual_intrinsic(Bytes bytes) {
  write(virtual_folder() / "extrinsic.txt", kExtrinsics);
  read_virtual("intrinsic.txt", bytes);
}
void read_virtual_extrinsic(Bytes bytes) {
  write(virtual_folder() / "intrinsic.txt", kIntrinsics);
  read_virtual("extrinsic.txt", bytes);
}

// --- moving objects ------------------------------------------------------------------------------

constexpr std::string_view kFrames =
    "index,name,timestamp,status,submap\n0,a,0.0,tracked,0\n1,b,0.1,tracked,0\n2,c,0.2,lost,-1\n";
constexpr std::string_view kEstimates =
    "frame,name,timestamp,instance,class,p_moving,keypoints,x,y,z,vx,vy,vz,sigma_v\n"
    "1,b,0.1,7,car,0.9,12,1,0,8,0,0,1,0.1\n";

const fs::path& run_folder() {
  static const fs::path folder = [] {
    const fs::path made = scratch() / "run";
    fs::create_directories(made);
    write(made / "objects.csv", kEstimates);
    write(made / "frames.csv", kFrames);
    std::string poses;
    for (int i = 0; i < 3; ++i) poses += "1 0 0 0 0 1 0 0 0 0 1 " + std::to_string(i) + "\n";
    write(made / "trajectory.kitti", poses);
    return made;
  }();
  return folder;
}

void read_run_objects(Bytes bytes) {
  write(run_folder() / "frames.csv", kFrames);
  write(run_folder() / "objects.csv", bytes);
  (void)read_object_run(run_folder());
}

/// frames.csv of a run; two objects stand in its first frames.
void read_run_frames(Bytes bytes) {
  write(run_folder() / "objects.csv", kEstimates);
  write(run_folder() / "frames.csv", bytes);
  const ObjectRun run = read_object_run(run_folder());
  constexpr std::string_view kLabel = " 4 Car 0 0 0.1 10 5 20 15 1.5 1.6 4 1 2 15 0.1\n";
  std::string labels;
  for (const auto& [frame, poses] : run.frames) labels += std::to_string(frame).append(kLabel);
  write(scratch() / "0000.txt", labels);
  (void)read_true_objects(scratch() / "0000.txt", run.frames);
}

/// Labels of KITTI Tracking, objects.csv of simulate_sequence, pose.txt of Virtual KITTI 2: the
/// first line says which.
void read_true(Bytes bytes) {
  write(run_folder() / "frames.csv", kFrames);
  write(run_folder() / "objects.csv", kEstimates);
  static const ObjectRun run = read_object_run(run_folder());
  for (const TrueObject& object : read_true_objects(file_of(bytes, "objects.txt"), run.frames)) {
    if (!object.T_g_o.is_finite() || !(object.half.minCoeff() > 0)) finding("an absurd box");
  }
}

constexpr std::string_view kPoses =
    "frame cameraID trackID alpha width height length wx wy wz ry rp rr cx cy cz crx cry crz\n"
    "0 0 3 1.5 1.8 1.5 4.3 0 0 0 0 0 0 -5 1.6 20 -1.5 0 0\n"
    "1 0 3 1.5 1.8 1.5 4.3 0 0 0 0 0 0 -5 1.6 19 -1.5 0 0\n";

void read_boxes(Bytes bytes) {
  const fs::path folder = scratch() / "vkitti";
  fs::create_directories(folder);
  write(folder / "pose.txt", kPoses);
  write(folder / "bbox.txt", bytes);
  const std::map<int, FramePoses> frames{{0, {0.0, {}, {}}}, {1, {0.1, {}, {}}}};
  (void)read_true_objects(folder / "pose.txt", frames);
}

void read_sensor(Bytes bytes) {
  read_sensor_yaml(file_of(bytes, "sensor.yaml"));
}

/// A calibration in one file; the rectifier is made when the images are small.
void read_rig(Bytes bytes) {
  const fs::path path = file_of(bytes, "rig.yaml");
  StereoRig rig = read_stereo_rig(std::vector<fs::path>{path});
  rig.set_image_size(48, 32);
  if (!rig.rectified()) (void)StereoRectifier(rig.left, rig.right, rig.name);
}

// --- trajectories, settings, label spaces --------------------------------------------------------

void read_kitti_trajectory(Bytes bytes) {
  (void)format_kitti(read_kitti_poses(file_of(bytes, "poses.txt")));
}
void read_tum_trajectory(Bytes bytes) {
  const fs::path path = file_of(bytes, "poses.tum");
  try_decode([&] { (void)format_tum(read_tum_poses(path)); });
  try_decode([&] { (void)read_tum_poses(path, Stamps::kMayRepeat); });
}
void read_euroc_trajectory(Bytes bytes) {
  (void)read_euroc_poses(file_of(bytes, "data.csv"));
}

void read_config(Bytes bytes) {
  Settings settings;
  settings.load(file_of(bytes, "config.yaml"));
  settings.check();
  write(scratch() / "again.yaml", settings.to_yaml());
  Settings again;
  again.load(scratch() / "again.yaml");
  if (again.to_yaml() != settings.to_yaml()) finding("settings change when they are read again");
}

/// Classes and table in one input, the line "====" between them.
void read_label_space(Bytes bytes) {
  constexpr std::string_view kBetween = "====\n";
  const auto at =
      std::search(bytes.begin(), bytes.end(), kBetween.begin(), kBetween.end()) - bytes.begin();
  const auto size = static_cast<std::size_t>(at);
  const Bytes table = bytes.subspan(std::min(bytes.size(), size + kBetween.size()));
  const fs::path classes = file_of(bytes.first(size), "l.classes.csv");
  const kys::LabelSpace labels = kys::load_label_space(classes, file_of(table, "l.table.csv"));
  (void)labels.size();
}

// --- perception ----------------------------------------------------------------------------------

constexpr std::string_view kSegments =
    R"({"annotations": [{"file_name": "a.png", "segments_info": [
        {"id": 1, "category_id": 3, "isthing": 1}, {"id": 2, "category_id": 149}]}],
        "categories": [{"id": 3, "isthing": 1, "name": "car"}, {"id": 149, "isthing": 0, "name": "road"}]})";

const fs::path& panoptic_folder() {
  static const fs::path folder = [] {
    const fs::path made = scratch() / "panoptic";
    fs::create_directories(made);
    RgbImage ids(24, 16);
    for (int y = 0; y < 16; ++y) {
      for (int x = 0; x < 24; ++x) {
        ids.at(x, y) = {static_cast<std::uint8_t>(x < 8 ? 0 : x < 16 ? 1 : 2), 0, 0};
      }
    }
    write_png(made / "a.png", ids);
    return made;
  }();
  return folder;
}

void read_panoptic(PanopticEncoding encoding) {
  static const kys::LabelSpace labels = kys::load_label_space("coco_panoptic_133");
  const PanopticReader reader(panoptic_folder(), labels, encoding);
  (void)reader.read("a", 24, 16);
}

void read_coco_json(Bytes bytes) {
  write(scratch() / "panoptic.json", bytes);
  read_panoptic(PanopticEncoding::kCoco);
}

void read_segmentation(Bytes bytes) {
  write(scratch() / "panoptic.json", kSegments);
  write(panoptic_folder() / "a.png", bytes);
  for (const auto encoding :
       {PanopticEncoding::kCoco, PanopticEncoding::kTwoChannel, PanopticEncoding::kClassMap}) {
    try_decode([&] { read_panoptic(encoding); });
  }
}

/// The first byte chooses the kind of file.
void read_field(Bytes bytes) {
  if (bytes.empty()) return;
  constexpr std::array<const char*, 4> kNames{"f.png", "f.pfm", "f.npy", "f.flo"};
  const fs::path path = file_of(bytes.subspan(1), kNames[bytes[0] % kNames.size()]);
  for (const auto encoding : {FieldEncoding::kKitti, FieldEncoding::kVkitti}) {
    try_decode([&] { (void)read_disparity(path, encoding, 20); });
    try_decode([&] { (void)read_flow(path, encoding); });
  }
}

// --- our own formats -----------------------------------------------------------------------------

/// Size and checksum are made right first, otherwise hardly an input would get past them.
void read_prior_file(Bytes input) {
  namespace pf = prior_format;
  std::vector<std::uint8_t> bytes(input.begin(), input.end());
  if (bytes.size() >= pf::kHeaderSize && (bytes[pf::kAtReserved] & 1) == 0) {
    std::copy(pf::kMagic.begin(), pf::kMagic.end(), bytes.begin());
    put(bytes, pf::kAtFileSize, static_cast<std::uint32_t>(bytes.size()));
    put(bytes, pf::kAtChecksum,
        pf::crc32(bytes.data() + pf::kAtChecked, bytes.size() - pf::kAtChecked));
  }
  const PriorFile file = PriorFile::parse(std::move(bytes), "fuzz");
  std::vector<Keypoint> keypoints(64);
  for (std::size_t i = 0; i < keypoints.size(); ++i) {
    keypoints[i].x = static_cast<float>((i * 7919) % static_cast<std::size_t>(file.width()));
    keypoints[i].y = static_cast<float>((i * 104729) % static_cast<std::size_t>(file.height()));
  }
  std::vector<kys::Prior> priors(keypoints.size());
  file.lookup(CameraSide::kLeft, keypoints, priors);
  file.lookup(CameraSide::kRight, keypoints, priors);
  if (static_cast<std::int64_t>(file.width()) * file.height() >= 100000) return;
  const FramePriors decoded = decode_priors(file);
  const PriorFile again = PriorFile::parse(encode_priors(decoded, "fuzz"), "again");
  if (again.segments(CameraSide::kLeft) != file.segments(CameraSide::kLeft)) finding("round trip");
}

void read_map(Bytes input) {
  namespace mf = map_format;
  std::vector<std::uint8_t> bytes(input.begin(), input.end());
  if (bytes.size() >= mf::kHeaderSize && (bytes[mf::kAtFlags] & 2) == 0) {
    std::copy(mf::kMagic.begin(), mf::kMagic.end(), bytes.begin());
    put(bytes, mf::kAtFileSize, static_cast<std::uint32_t>(bytes.size()));
    put(bytes, mf::kAtFileSize + 4, 0);
    put(bytes, mf::kAtChecksum, mf::checksum(std::span(bytes).subspan(mf::kAtChecked)));
  }
  const Map map = parse_map(std::move(bytes), "fuzz", "cityscapes19");
  const auto once = encode_map(map, "cityscapes19");
  if (encode_map(parse_map(once, "again", "cityscapes19"), "cityscapes19") != once) {
    finding("round trip");
  }
}

/// The payloads of a feature file of version 2; the first byte chooses which.
void read_payload(Bytes input) {
  const Bytes bytes = input.subspan(1);
  if (input[0] % 3 == 0) {
    const FeatureFrame frame = decode_frame(bytes, 1);
    const FeatureFrame again = decode_frame(encode_frame(frame, 1), 1);
    if (again.left.descriptors != frame.left.descriptors ||
        again.right_landmarks != frame.right_landmarks) {
      finding("round trip of a frame");
    }
  } else if (input[0] % 3 == 1) {
    const FeatureTruth truth = decode_truth(bytes, 100);
    if (decode_truth(encode_truth(truth), 100).landmarks.size() != truth.landmarks.size()) {
      finding("round trip of the truth");
    }
  } else {
    (void)inflate(bytes, 1 << 16);
  }
}

/// Its decoders leave it to the caller to name the file.
void read_feature_payload(Bytes input) {
  if (input.empty()) return;
  try {
    read_payload(input);
  } catch (const std::runtime_error& error) {
    throw InputError(error.what());
  }
}

void read_feature_file(Bytes bytes) {
  FeatureSequence sequence(file_of(bytes, "f.features"));
  while (sequence.next()) {
  }
  (void)sequence.truth();
}

#ifdef KYS_FUZZ_CLOUDS
void read_cloud(Bytes input) {
  const std::string_view bytes(reinterpret_cast<const char*>(input.data()), input.size());
  const PointCloud cloud = parse_point_cloud(bytes, "fuzz");
  const std::size_t count = cloud.points.size();
  if (count == 0 || (!cloud.classes.empty() && cloud.classes.size() != count) ||
      (!cloud.normals.empty() && cloud.normals.size() != count)) {
    finding("columns of different lengths");
  }
  for (const Eigen::Vector3d& p : cloud.points) {
    if (!p.allFinite()) finding("a point that is not finite");
  }
}
#endif

/// Bytes per byte of an image: a bit per pixel in deflate's best case, given out as 16-bit colour.
constexpr double kImageGrowth = 1032 * 8 * 6;

constexpr std::array kReaders{
#ifdef KYS_FUZZ_CLOUDS
    Reader{"point_cloud", read_cloud},
#endif
    Reader{"png", read_png, kImageGrowth},
    Reader{"jpeg", read_image, 3.0 * (1 << 14)},
    Reader{"pnm", read_image, kImageGrowth},
    Reader{"kitti_calib", read_calib},
    Reader{"kitti_times", read_times},
    Reader{"euroc_data", read_data_csv},
    Reader{"tracking_calib", read_tracking_calib},
    Reader{"tracking_oxts", read_tracking_oxts},
    Reader{"vkitti_intrinsic", read_virtual_intrinsic},
    Reader{"vkitti_extrinsic", read_virtual_extrinsic},
    Reader{"true_objects", read_true},
    Reader{"vkitti_boxes", read_boxes},
    Reader{"run_objects", read_run_objects},
    Reader{"run_frames", read_run_frames},
    Reader{"sensor_yaml", read_sensor},
    Reader{"rig", read_rig},
    Reader{"kitti_poses", read_kitti_trajectory},
    Reader{"tum_poses", read_tum_trajectory},
    Reader{"euroc_poses", read_euroc_trajectory},
    Reader{"config", read_config},
    Reader{"label_space", read_label_space},
    Reader{"coco_json", read_coco_json},
    Reader{"segmentation", read_segmentation, kImageGrowth},
    Reader{"field", read_field, kImageGrowth},
    Reader{"prior_file", read_prior_file},
    Reader{"map", read_map},
    Reader{"feature_payload", read_feature_payload},
    Reader{"feature_file", read_feature_file},
};

}  // namespace

std::span<const Reader> readers() {
  return kReaders;
}

const Reader* find_reader(std::string_view name) {
  const auto found = std::find_if(kReaders.begin(), kReaders.end(),
                                  [&](const Reader& r) { return r.name == name; });
  return found == kReaders.end() ? nullptr : &*found;
}

}  // namespace kys_slam::fuzz
