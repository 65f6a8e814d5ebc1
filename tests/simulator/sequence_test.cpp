// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/error.h>
#include <kys_slam/image_file.h>
#include <kys_slam/trajectory_file.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "scratch_folder.h"
#include "simulator/common/coco_classes.h"
#include "simulator/common/euroc_rig.h"
#include "simulator/images/sensor.h"
#include "simulator/images/sequence_writer.h"

// What is checked here is read back from the files of a sequence, as a user would read them.
namespace kys_slam::simulator {
namespace {

namespace fs = std::filesystem;

constexpr int kWidth = 620;
constexpr int kHeight = 188;
constexpr int kFrames = 3;
constexpr int kSkipped = 40;

std::uint32_t id_of(const RgbPixel& p) {
  return p[0] + 256U * p[1] + 65536U * p[2];
}

float bilinear(const ImageOf<float>& image, double x, double y) {
  const int x0 = static_cast<int>(x);
  const int y0 = static_cast<int>(y);
  const auto fx = static_cast<float>(x - x0);
  const auto fy = static_cast<float>(y - y0);
  return (image.at(x0, y0) * (1 - fx) + image.at(x0 + 1, y0) * fx) * (1 - fy) +
         (image.at(x0, y0 + 1) * (1 - fx) + image.at(x0 + 1, y0 + 1) * fx) * fy;
}

double gradient(const ImageOf<float>& image, int x, int y) {
  return std::hypot(image.at(x + 1, y) - image.at(x - 1, y),
                    image.at(x, y + 1) - image.at(x, y - 1)) /
         2;
}

// The differences of a warp: where the image is smooth they are the sensor's noise.
struct Warp {
  std::vector<double> smooth, all;
  void add(double difference, double slope) {
    all.push_back(difference);
    if (slope < 4) smooth.push_back(difference);
  }
  static double robust_sigma(std::vector<double> v) {
    for (double& x : v) x = std::abs(x);
    std::nth_element(v.begin(), v.begin() + static_cast<long>(v.size() / 2), v.end());
    return 1.4826 * v[v.size() / 2];
  }
};

// One written sequence per world, shared by the tests.
class Sequence : public testing::TestWithParam<const char*> {
 protected:
  void SetUp() override {
    const std::string name = GetParam();
    folder_ = *scratch_ / name;
    if (!fs::exists(folder_)) {
      WriteOptions options;
      options.output = folder_;
      options.command = "test";
      options.quiet = true;
      // From the middle of the way, where the camera moves.
      World world = make_world({name, 5, kSkipped + kFrames, kWidth, kHeight});
      for (auto* poses : {&world.T_w_c, &world.T_w_b, &world.T_w_truth}) {
        if (!poses->empty()) poses->erase(poses->begin(), poses->begin() + kSkipped);
      }
      world.times.erase(world.times.begin(), world.times.begin() + kSkipped);
      write_sequence(world, options);
    }
    for (const auto& entry : fs::directory_iterator(folder_ / "panoptic_left")) {
      stems_.push_back(entry.path().stem().string());
    }
    std::sort(stems_.begin(), stems_.end());
    ASSERT_EQ(stems_.size(), static_cast<std::size_t>(kFrames));
    if (is_hall()) {
      open_hall();
    } else {
      open_kitti();
    }
    ASSERT_TRUE(camera_.is_valid());
    ASSERT_EQ(poses_.size(), static_cast<std::size_t>(kFrames));
    std::ifstream table(folder_ / "ground_truth.csv");
    std::string line;
    std::getline(table, line);
    while (std::getline(table, line)) {
      std::istringstream fields(line);
      std::vector<std::string> f;
      for (std::string x; std::getline(fields, x, ',');) f.push_back(x);
      ASSERT_EQ(f.size(), 9U) << line;
      rows_[{std::stoi(f[0]), f[1]}][static_cast<std::uint32_t>(std::stoul(f[2]))] = {
          std::stoi(f[3]), std::stoi(f[5]), f[7] == "1", std::stol(f[8])};
    }
  }
  static void SetUpTestSuite() { scratch_ = std::make_unique<ScratchFolder>("sequence"); }
  static void TearDownTestSuite() { scratch_.reset(); }

  [[nodiscard]] static bool is_hall() { return std::string(GetParam()) == "hall"; }
  void open_kitti() {
    poses_ = read_kitti_poses(folder_ / "poses.txt");
    std::ifstream calib(folder_ / "calib.txt");
    std::string label;
    double P[2][12];
    for (auto& row : P) {
      calib >> label;
      for (double& v : row) calib >> v;
    }
    camera_ = {kWidth, kHeight, P[0][0], P[0][5], P[0][2], P[0][6], -P[1][3] / P[1][0]};
  }
  void open_hall() {
    rectifier_ = std::make_unique<StereoRectifier>(euroc_rectifier(kWidth, kHeight));
    camera_ = rectifier_->camera();
    const auto body =
        read_euroc_poses(folder_ / "mav0" / "state_groundtruth_estimate0" / "data.csv");
    for (const TimedPose& pose : body) poses_.push_back(pose.T_w_c * rectifier_->T_b_c());
  }

  struct Row {
    int object, category;
    bool moving;
    long area;
  };
  [[nodiscard]] fs::path file(const std::string& folder, int frame) const {
    return folder_ / folder / (stems_[static_cast<std::size_t>(frame)] + ".png");
  }
  // Which thing (by object) or stuff (by class) each pixel shows; 0 unlabelled.
  ImageOf<int> things(const std::string& side, int frame) const {
    const RgbImage ids = read_rgb(file("panoptic_" + side, frame));
    const auto& rows = rows_.at({frame, side});
    ImageOf<int> out(kWidth, kHeight);
    for (std::size_t i = 0; i < ids.size(); ++i) {
      const std::uint32_t id = id_of(ids.data()[i]);
      if (id == 0) continue;
      const Row& row = rows.at(id);
      out.data()[i] = row.object >= 0 ? row.object + 1 : -row.category;
    }
    return out;
  }
  // The image without exposure and vignetting, rectified.
  [[nodiscard]] ImageOf<float> corrected(int camera, int frame) const {
    const std::string number = std::to_string(camera);
    GrayImage image =
        read_gray(file(is_hall() ? "mav0/cam" + number + "/data" : "image_" + number, frame));
    ImageOf<float> out(kWidth, kHeight);
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        out.at(x, y) = static_cast<float>(image.at(x, y)) / Sensor::exposure(frame, camera) /
                       Sensor::vignetting(x, y, kWidth, kHeight);
        image.at(x, y) = static_cast<std::uint8_t>(std::min(255.0F, out.at(x, y) + 0.5F));
      }
    }
    if (!is_hall()) return out;
    image = camera == 0 ? rectifier_->rectify_left(image) : rectifier_->rectify_right(image);
    std::copy_n(image.data(), image.size(), out.data());
    return out;
  }

  [[nodiscard]] Warp warp_right_to_left(double shift) const;

  static std::unique_ptr<ScratchFolder> scratch_;
  fs::path folder_;
  std::vector<std::string> stems_;
  StereoCamera camera_;
  std::unique_ptr<StereoRectifier> rectifier_;
  std::vector<Rigid3> poses_;  ///< of the rectified left camera
  std::map<std::pair<int, std::string>, std::map<std::uint32_t, Row>> rows_;
};
std::unique_ptr<ScratchFolder> Sequence::scratch_;

TEST_P(Sequence, StaticFlowAgreesWithDisparityAndPose) {
  double moving_flow = 0;
  for (int i = 0; i < 2 * (kFrames - 1); ++i) {
    const int frame = i / 2;
    const bool right = i % 2 == 1;
    const std::string side = right ? "right" : "left";
    const Image16 disparity = read_u16(file(right ? "disparity_right" : "disparity", frame));
    const Rgb16Image flow = read_rgb16(file("flow_" + side, frame));
    const RgbImage ids = read_rgb(file("panoptic_" + side, frame));
    const auto& rows = rows_.at({frame, side});
    const Rigid3 T_left_camera(Eigen::Quaterniond::Identity(),
                               Eigen::Vector3d(right ? camera_.baseline : 0, 0, 0));
    const Rigid3 T_next_now = T_left_camera.inverse() *
                              poses_[static_cast<std::size_t>(frame) + 1].inverse() *
                              poses_[static_cast<std::size_t>(frame)] * T_left_camera;
    long checked = 0;
    double worst = 0;
    for (int v = 0; v < kHeight; ++v) {
      for (int u = 0; u < kWidth; ++u) {
        const double d = disparity.at(u, v) / 256.0;
        if (d == 0 || flow.at(u, v)[2] == 0) continue;
        const Eigen::Vector3d p = T_next_now * camera_.back_project(u, v, camera_.bf() / d);
        const Eigen::Vector2d expected = camera_.project(p) - Eigen::Vector2d(u, v);
        const Eigen::Vector2d given((flow.at(u, v)[0] - 32768.0) / 64,
                                    (flow.at(u, v)[1] - 32768.0) / 64);
        const double error = (expected - given).norm();
        const std::uint32_t id = id_of(ids.at(u, v));
        if (id != 0 && rows.at(id).moving) {
          moving_flow = std::max(moving_flow, error);
          continue;
        }
        worst = std::max(worst, error);
        ++checked;
      }
    }
    EXPECT_GT(checked, kWidth * kHeight / 3) << side;
    EXPECT_LT(worst, 0.05) << side;
  }
  if (std::string(GetParam()) == "street") {
    EXPECT_GT(moving_flow, 2.0);
  }
}

// Left minus right image, by the disparities of a frame, where both see the same surface.
// `shift` px are added to every disparity: with a wrong one the images do not fit.
Warp Sequence::warp_right_to_left(double shift) const {
  const ImageOf<float> left = corrected(0, 1);
  const ImageOf<float> right = corrected(1, 1);
  const Image16 disparity = read_u16(file("disparity", 1));
  const ImageOf<int> seen_left = things("left", 1);
  const ImageOf<int> seen_right = things("right", 1);
  Warp warp;
  for (int v = 1; v + 1 < kHeight; ++v) {
    std::vector<float> nearest(kWidth + 1, 0.0F);  // disparity of what is in front, by right pixel
    for (int u = 0; u < kWidth; ++u) {
      const double d = disparity.at(u, v) / 256.0;
      const double x = u - d;
      if (d == 0 || x < 0) continue;
      for (const int k : {static_cast<int>(x), static_cast<int>(x) + 1}) {
        nearest[static_cast<std::size_t>(k)] =
            std::max(nearest[static_cast<std::size_t>(k)], static_cast<float>(d));
      }
    }
    for (int u = 1; u + 1 < kWidth; ++u) {
      const double d = disparity.at(u, v) / 256.0;
      const double x = u - d;
      if (d == 0 || x < 4 || x > kWidth - 2) continue;
      const auto k = static_cast<std::size_t>(x);
      if (std::max(nearest[k], nearest[k + 1]) > d + 0.7) continue;  // hidden
      const int thing = seen_left.at(u, v);
      const int at = static_cast<int>(x);
      if (seen_right.at(at, v) != thing || seen_right.at(at + 1, v) != thing) continue;
      warp.add(bilinear(right, x - shift, v) - left.at(u, v), gradient(left, u, v));
    }
  }
  return warp;
}

TEST_P(Sequence, RightImageWarpsOntoTheLeft) {
  const Warp warp = warp_right_to_left(0);
  ASSERT_GT(warp.smooth.size(), 5000U);
  // Noise of 1.5 in both; interpolation takes some of the right one's.
  EXPECT_LT(Warp::robust_sigma(warp.smooth), 2.8);
  EXPECT_GT(Warp::robust_sigma(warp.smooth), is_hall() ? 1.0 : 1.5);  // rectification smooths
  EXPECT_LT(Warp::robust_sigma(warp.all), 3.5);
  EXPECT_GT(Warp::robust_sigma(warp_right_to_left(2.0).all), 1.3 * Warp::robust_sigma(warp.all));
}

TEST_P(Sequence, NextImageWarpsOntoThisOne) {
  for (const int camera : {0, 1}) {
    const std::string side = camera == 0 ? "left" : "right";
    const ImageOf<float> now = corrected(camera, 0);
    const ImageOf<float> next = corrected(camera, 1);
    const Rgb16Image flow = read_rgb16(file("flow_" + side, 0));
    const ImageOf<int> seen_now = things(side, 0);
    const ImageOf<int> seen_next = things(side, 1);
    Warp warp;
    for (int v = 1; v + 1 < kHeight; ++v) {
      for (int u = 1; u + 1 < kWidth; ++u) {
        const Rgb16Pixel f = flow.at(u, v);
        const double x = u + (f[0] - 32768.0) / 64;
        const double y = v + (f[1] - 32768.0) / 64;
        if (f[2] == 0 || x < 1 || y < 1 || x > kWidth - 3 || y > kHeight - 3) continue;
        if (seen_next.at(static_cast<int>(x), static_cast<int>(y)) != seen_now.at(u, v)) continue;
        warp.add(bilinear(next, x, y) - now.at(u, v), gradient(now, u, v));
      }
    }
    ASSERT_GT(warp.smooth.size(), 5000U);
    EXPECT_LT(Warp::robust_sigma(warp.smooth), 2.8) << side;
    EXPECT_LT(Warp::robust_sigma(warp.all), 4.0) << side;
  }
}

TEST_P(Sequence, PanopticImagesAndTextAgree) {
  std::set<std::uint32_t> all_ids;
  std::size_t id_count = 0;
  for (const std::string side : {"left", "right"}) {
    const auto json = nlohmann::json::parse(read_all(folder_ / ("panoptic_" + side + ".json")));
    ASSERT_EQ(json["annotations"].size(), static_cast<std::size_t>(kFrames));
    std::set<int> categories;
    for (const auto& c : json["categories"]) categories.insert(c["id"].get<int>());
    for (int frame = 0; frame < kFrames; ++frame) {
      const RgbImage ids = read_rgb(file("panoptic_" + side, frame));
      std::map<std::uint32_t, std::array<int, 5>> drawn;  // area, x0, y0, x1, y1
      for (int y = 0; y < kHeight; ++y) {
        for (int x = 0; x < kWidth; ++x) {
          const std::uint32_t id = id_of(ids.at(x, y));
          if (id == 0) continue;
          auto [at, first] = drawn.try_emplace(id, std::array<int, 5>{0, x, y, x, y});
          auto& b = at->second;
          b = {b[0] + 1, std::min(b[1], x), b[2], std::max(b[3], x), y};
        }
      }
      const auto& note = json["annotations"][static_cast<std::size_t>(frame)];
      EXPECT_EQ(note["image_id"], frame);
      EXPECT_EQ(note["file_name"], file("", frame).filename().string());
      ASSERT_EQ(note["segments_info"].size(), drawn.size());
      for (const auto& s : note["segments_info"]) {
        const auto id = s["id"].get<std::uint32_t>();
        ASSERT_TRUE(drawn.contains(id));
        const auto& b = drawn[id];
        EXPECT_EQ(s["area"], b[0]);
        EXPECT_EQ(s["bbox"], nlohmann::json({b[1], b[2], b[3] - b[1] + 1, b[4] - b[2] + 1}));
        EXPECT_TRUE(categories.contains(s["category_id"].get<int>()));
        const Row& row = rows_.at({frame, side}).at(id);
        EXPECT_EQ(row.category, s["category_id"]);
        EXPECT_EQ(row.area, b[0]);
        EXPECT_EQ(row.object >= 0, row.category <= 90);
        all_ids.insert(id);
        ++id_count;
      }
    }
  }
  EXPECT_EQ(all_ids.size(), id_count) << "ids are drawn anew for every frame and camera";
}

// What a pixel of an object shows lies in the object's box, at the pose that objects.csv gives.
TEST_P(Sequence, ObjectsAreWhereTheirPixelsAre) {
  std::ifstream table(folder_ / "objects.csv");
  std::string line;
  std::getline(table, line);
  EXPECT_EQ(line,
            "frame,timestamp,object,class,category_id,moving,x,y,z,qx,qy,qz,qw,vx,vy,vz,"
            "box_x,box_y,box_z,length,width,height,left_id,left_pixels,right_id,right_pixels");
  std::map<std::pair<int, int>, std::vector<double>> seen;  // by object and frame
  std::size_t pixels_checked = 0;
  while (std::getline(table, line)) {
    std::istringstream fields(line);
    std::vector<double> f;
    int column = 0;
    for (std::string x; std::getline(fields, x, ','); ++column) {
      f.push_back(column == 3 ? 0.0 : std::stod(x));
    }
    ASSERT_EQ(f.size(), 26U) << line;
    const int frame = static_cast<int>(f[0]);
    seen[{static_cast<int>(f[2]), frame}] = f;
    const auto id = static_cast<std::uint32_t>(f[22]);
    if (id == 0) continue;
    const Row& row = rows_.at({frame, "left"}).at(id);
    EXPECT_EQ(row.object, static_cast<int>(f[2]));
    EXPECT_EQ(row.category, static_cast<int>(f[4]));
    EXPECT_EQ(row.moving, f[5] == 1);
    EXPECT_EQ(row.area, static_cast<long>(f[23]));
    const Rigid3 T_g_o(Eigen::Quaterniond(f[12], f[9], f[10], f[11]),
                       Eigen::Vector3d(f[6], f[7], f[8]));
    const Rigid3 T_o_c = T_g_o.inverse() * poses_[static_cast<std::size_t>(frame)];
    const Image16 disparity = read_u16(file("disparity", frame));
    const RgbImage ids = read_rgb(file("panoptic_left", frame));
    for (int v = 0; v < kHeight; ++v) {
      for (int u = 0; u < kWidth; ++u) {
        if (id_of(ids.at(u, v)) != id || disparity.at(u, v) == 0) continue;
        const double depth = camera_.bf() / (disparity.at(u, v) / 256.0);
        const Eigen::Vector3d p =
            T_o_c * camera_.back_project(u, v, depth) - Eigen::Vector3d(f[16], f[17], f[18]);
        const Eigen::Vector3d half(f[19] / 2, f[20] / 2, f[21] / 2);
        const double slack = row.category == kPerson ? 0.35 : 0.02;  // limbs swing
        const double rounding = depth * depth / (512 * camera_.bf());
        ASSERT_LE((p.cwiseAbs() - half).maxCoeff(), slack + rounding) << line;
        ++pixels_checked;
      }
    }
  }
  EXPECT_GT(pixels_checked, 100U);
  std::size_t steps = 0;
  for (const auto& [key, now] : seen) {
    const auto next = seen.find({key.first, key.second + 1});
    if (next == seen.end()) continue;
    const auto at = [](const std::vector<double>& f, int k) {
      return Eigen::Vector3d(f[static_cast<std::size_t>(k)], f[static_cast<std::size_t>(k) + 1],
                             f[static_cast<std::size_t>(k) + 2]);
    };
    const double dt = next->second[1] - now[1];
    const Eigen::Vector3d mean = (at(now, 13) + at(next->second, 13)) / 2;
    EXPECT_LT((at(next->second, 6) - at(now, 6) - mean * dt).norm(), 0.01) << key.first;
    ++steps;
  }
  EXPECT_GT(steps, 0U);
}

INSTANTIATE_TEST_SUITE_P(Worlds, Sequence, testing::Values("street", "block", "hall"));

std::map<std::string, std::string> contents(const fs::path& folder) {
  std::map<std::string, std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file()) {
      files[fs::relative(entry.path(), folder).string()] = read_all(entry.path());
    }
  }
  return files;
}

void write_small(const std::string& name, std::uint64_t seed, int jobs, const fs::path& output) {
  WriteOptions options;
  options.output = output;
  options.command = "test";
  options.quiet = true;
  options.jobs = jobs;
  write_sequence(make_world({name, seed, 4, 310, 94}), options);
}

TEST(Writing, SameSeedSameBytesWhateverTheThreads) {
  const ScratchFolder scratch("bytes");
  for (const std::string name : {"street", "hall"}) {
    write_small(name, 7, 1, scratch / (name + "1"));
    write_small(name, 7, 3, scratch / (name + "3"));
    write_small(name, 8, 2, scratch / (name + "other"));
    const auto one = contents(scratch / (name + "1"));
    EXPECT_EQ(one, contents(scratch / (name + "3")));
    const auto other = contents(scratch / (name + "other"));
    EXPECT_NE(one, other);
  }
}

TEST(Writing, HallCanLoseFramesOfOneCamera) {
  const ScratchFolder scratch("drop");
  WriteOptions options;
  options.output = scratch / "hall";
  options.command = "test";
  options.quiet = true;
  options.drop_camera = 1;
  options.drop_share = 0.5;
  write_sequence(make_world({"hall", 3, 12, 188, 120}), options);
  const auto count = [&](const std::string& camera) {
    const std::string list = read_all(scratch / "hall" / "mav0" / camera / "data.csv");
    const auto lines = std::count(list.begin(), list.end(), '\n') - 1;
    std::ptrdiff_t files = 0;
    for (const auto& e : fs::directory_iterator(scratch / "hall" / "mav0" / camera / "data")) {
      files += e.is_regular_file() ? 1 : 0;
    }
    EXPECT_EQ(lines, files);
    return files;
  };
  EXPECT_EQ(count("cam0"), 12);
  EXPECT_GE(count("cam1"), 3);
  EXPECT_LE(count("cam1"), 10);
}

TEST(Writing, BadInputIsRefusedInOneLineAndLeavesNothing) {
  const ScratchFolder scratch("refuse");
  const std::string program = std::string(KYS_BIN_DIR) + "/simulate_sequence ";
  const auto expect_refused = [&](const std::string& arguments, const std::string& mention) {
    const ProgramResult r = run_program(program + arguments, scratch);
    EXPECT_EQ(r.status, 2) << arguments;
    EXPECT_NE(r.error.find(mention), std::string::npos) << r.error;
    return r;
  };
  const std::string out = (scratch / "out").string();
  const std::string small = " --size 124x48 --frames 2 --quiet";
  EXPECT_TRUE(is_one_line(expect_refused("stret --output " + out, "'street'").error));
  EXPECT_TRUE(
      is_one_line(expect_refused("street --output " + out + " --size 9x9", "--size").error));
  EXPECT_TRUE(is_one_line(expect_refused("street --size 12 --output " + out, "--size 12").error));
  EXPECT_TRUE(is_one_line(expect_refused("street --frames 0 --output " + out, "--frames 0").error));
  EXPECT_TRUE(
      is_one_line(expect_refused("street --output /proc/kys/out" + small, "/proc/kys").error));
  std::ofstream(scratch / "file") << "in the way";
  EXPECT_TRUE(is_one_line(
      expect_refused("street --output " + (scratch / "file").string() + small, "not a folder")
          .error));
  fs::create_directories(scratch / "full" / "old");
  EXPECT_TRUE(is_one_line(
      expect_refused("street --output " + (scratch / "full").string() + small, "not empty").error));
  for (const std::string bad : {"--frames many", "--frames 99999999", "--size 100000x100000",
                                "--size 99999999999999999999x9", "--size 4294967420x48",
                                "--seed -1", "--seed 1e99", "--jobs 0", "--bogus"}) {
    const std::string option = bad.substr(0, bad.find(' '));
    EXPECT_TRUE(is_one_line(expect_refused("street " + bad + " --output " + out, option).error));
  }
  EXPECT_TRUE(is_one_line(expect_refused("street", "--output").error));
  EXPECT_TRUE(is_one_line(expect_refused("--output " + out, "world").error));
  EXPECT_TRUE(is_one_line(
      expect_refused("hall --drop-camera 1 --drop-share nan --output " + out, "--drop-share")
          .error));
  EXPECT_FALSE(fs::exists(out));
}

TEST(Writing, ReadmeNamesTheCommand) {
  const ScratchFolder scratch("readme");
  const auto readme = [&](const std::string& name, const std::string& frames) {
    const std::string out = (scratch / name).string();
    const ProgramResult r =
        run_program(std::string(KYS_BIN_DIR) + "/simulate_sequence street" + frames +
                        " --size 64x48 --images-only --quiet --output " + out,
                    scratch);
    EXPECT_EQ(r.status, 0) << r.error;
    std::ifstream file(out + "/README");
    return std::string(std::istreambuf_iterator<char>(file), {});
  };
  EXPECT_NE(readme("cut", " --frames 2").find(" --seed 1 --frames 2 --size 64x48 --images-only\n"),
            std::string::npos);
  EXPECT_NE(readme("whole", "").find(" --seed 1 --size 64x48 --images-only\n"), std::string::npos);
}

TEST(Writing, FullDiskLeavesNothing) {
  const ScratchFolder scratch("disk");
  const fs::path out = scratch / "out";
  // Files may not grow beyond a few kilobytes, as on a full disk.
  const ProgramResult r =
      run_program("bash -c \"trap '' XFSZ; ulimit -f 8; " + std::string(KYS_BIN_DIR) +
                      "/simulate_sequence street --size 310x94 --frames 2 "
                      "--quiet --output " +
                      out.string() + "\"",
                  scratch);
  EXPECT_EQ(r.status, 2);
  EXPECT_TRUE(is_one_line(r.error)) << r.error;
  EXPECT_NE(r.error.find("cannot write"), std::string::npos) << r.error;
  EXPECT_FALSE(fs::exists(out));
  EXPECT_FALSE(fs::exists(out.string() + ".partial"));
}

TEST(Writing, AFolderThatCannotBeReplacedIsNoticedFirst) {
  const ScratchFolder scratch("here");
  fs::create_directories(scratch / "out");
  const ProgramResult r =
      run_program("bash -c \"cd " + (scratch / "out").string() + " && " + std::string(KYS_BIN_DIR) +
                      "/simulate_sequence street --size 310x94 --frames 1 "
                      "--quiet --output .\"",
                  scratch);
  EXPECT_EQ(r.status, 2);
  EXPECT_TRUE(is_one_line(r.error)) << r.error;
  EXPECT_NE(r.error.find("cannot write ."), std::string::npos) << r.error;
  EXPECT_TRUE(fs::is_empty(scratch / "out")) << "rendered first";
}

TEST(Writing, AnInterruptedRunIsSweptAwayByTheNext) {
  const ScratchFolder scratch("killed");
  const fs::path partial = scratch / "out.partial";
  fs::create_directories(partial / "image_0");
  std::ofstream(partial / ".simulate_sequence") << "incomplete\n";
  std::ofstream(partial / "image_0" / "999999.png") << "rest";
  write_small("street", 1, 1, scratch / "out");
  EXPECT_FALSE(fs::exists(partial));
  EXPECT_TRUE(fs::exists(scratch / "out" / "image_0" / "000000.png"));
  EXPECT_FALSE(fs::exists(scratch / "out" / "image_0" / "999999.png"));
}

}  // namespace
}  // namespace kys_slam::simulator
