// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/error.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "scratch_folder.h"
#include "simulator/common/euroc_rig.h"
#include "simulator/images/renderer.h"
#include "simulator/images/segments.h"
#include "simulator/images/sequence_writer.h"

// Images of pairs with an error of the rig.
namespace kys_slam::simulator {
namespace {

namespace fs = std::filesystem;

cv::Mat matrix_of(const GrayImage& image) {
  cv::Mat out;
  cv::Mat(image.height(), image.width(), CV_8UC1, const_cast<std::uint8_t*>(image.data()))
      .copyTo(out);
  return out;
}

/// A rendered pair, rectified by the calibration, with the truth of the left image.
struct RenderedPair {
  RenderedPair(const World& world, int frame) {
    const RenderAssets assets(world);
    FrameRenderer renderer(assets);
    GrayImage l = renderer.image(frame, 0), r = renderer.image(frame, 1);
    if (world.layout == Layout::kEuroc) {
      const StereoRectifier rectifier = euroc_rectifier(l.width(), l.height());
      l = rectifier.rectify_left(l);
      r = rectifier.rectify_right(r);
    }
    left = matrix_of(l);
    right = matrix_of(r);
    truth = renderer.truth(frame, 0);
    right_truth = renderer.truth(frame, 1);
  }
  cv::Mat left, right;
  ViewTruth truth, right_truth;
};

constexpr int kHalf = 8;   // px, of a template
constexpr int kFiner = 4;  // a parabola through scores at whole pixels is wrong by 0.1 px

cv::Mat finer(const cv::Mat& image, const cv::Rect& area) {
  cv::Mat out;
  cv::resize(image(area), out, {}, kFiner, kFiner, cv::INTER_CUBIC);
  return out;
}

/// Where the surroundings of a corner are found in the right image, near `expected`; empty when it
/// is not found well, or at the border of the search.
std::optional<Eigen::Vector2d> find_in_right(const RenderedPair& pair, const cv::Point& corner,
                                             const Eigen::Vector2d& expected) {
  constexpr int kSearch = 4;
  const cv::Point around(static_cast<int>(std::lround(expected.x())),
                         static_cast<int>(std::lround(expected.y())));
  const cv::Rect area(around.x - kHalf - kSearch, around.y - kHalf - kSearch,
                      2 * (kHalf + kSearch) + 1, 2 * (kHalf + kSearch) + 1);
  if ((area & cv::Rect(0, 0, pair.right.cols, pair.right.rows)) != area) return {};
  cv::Mat score;
  const cv::Rect patch(corner.x - kHalf, corner.y - kHalf, 2 * kHalf + 1, 2 * kHalf + 1);
  cv::matchTemplate(finer(pair.right, area), finer(pair.left, patch), score, cv::TM_CCOEFF_NORMED);
  double best = 0;
  cv::Point at;
  cv::minMaxLoc(score, nullptr, &best, nullptr, &at);
  if (best < 0.9 || at.x == 0 || at.y == 0 || at.x + 1 == score.cols || at.y + 1 == score.rows)
    return {};
  const auto peak = [](double a, double b, double c) { return 0.5 * (a - c) / (a - 2 * b + c); };
  const auto s = [&](int dx, int dy) {
    return static_cast<double>(score.at<float>(at.y + dy, at.x + dx));
  };
  const double x = at.x + peak(s(-1, 0), s(0, 0), s(1, 0));
  const double y = at.y + peak(s(0, -1), s(0, 0), s(0, 1));
  return Eigen::Vector2d(around.x - kSearch + x / kFiner, around.y - kSearch + y / kFiner);
}

/// Whether the disparity changes little around a pixel, so that a template fits in both images.
bool is_flat(const ViewTruth& truth, const cv::Point& p) {
  float least = 1e9F, most = -1e9F;
  for (int y = p.y - kHalf; y <= p.y + kHalf; y += 2) {
    for (int x = p.x - kHalf; x <= p.x + kHalf; x += 2) {
      if (truth.depth.at(x, y) <= 0) return false;  // sky
      least = std::min(least, truth.disparity.at(x, y));
      most = std::max(most, truth.disparity.at(x, y));
    }
  }
  return most - least < 0.6F;
}

double median(std::vector<double> v) {
  std::nth_element(v.begin(), v.begin() + static_cast<long>(v.size() / 2), v.end());
  return v[v.size() / 2];
}

struct Case {
  const char* world;
  const char* error;
  int frame, width, height;
};

class BentPair : public testing::TestWithParam<Case> {};

// In each cell of the image, the median over its corners of what is measured in the images - what
// the model says is zero.
TEST_P(BentPair, CornersAreWhereTheModelSays) {
  const auto [name, error_text, frame, width, height] = GetParam();
  World world = make_world({name, 3, frame + 2, width, height});
  const StereoCamera given = world.rectified;
  const RigError error = make_rig_error(error_text, given);
  apply_rig_error(world, error);
  EXPECT_EQ(world.rectified, given);
  const TruePair model(given, error);
  const RenderedPair pair(world, frame);
  std::vector<cv::Point2f> corners;
  cv::goodFeaturesToTrack(pair.left, corners, 4000, 0.01, 4);
  std::map<std::pair<int, int>, std::vector<double>> rows, columns, rows_apart;
  for (const cv::Point p : corners) {
    if (p.x < kHalf || p.y < kHalf || p.x >= width - kHalf || p.y >= height - kHalf) continue;
    if (!is_flat(pair.truth, p)) continue;
    const Eigen::Vector2d ideal = model.left_ideal(p.x, p.y);
    const Eigen::Vector4d seen =
        model.observe(given.back_project(ideal.x(), ideal.y(), pair.truth.depth.at(p.x, p.y)));
    EXPECT_NEAR(pair.truth.disparity.at(p.x, p.y), seen[0] - seen[2], 1e-3);
    const auto found = find_in_right(pair, p, {seen[2], seen[3]});
    if (!found) continue;
    const std::pair<int, int> cell(p.x * 4 / width, p.y * 2 / height);
    columns[cell].push_back(found->x() - seen[2]);
    rows[cell].push_back(found->y() - seen[3]);
    rows_apart[cell].push_back(found->y() - p.y);
  }
  int cells = 0;
  double most_apart = 0;
  for (const auto& [cell, differences] : rows) {
    if (differences.size() < 20) continue;
    ++cells;
    most_apart = std::max(most_apart, std::abs(median(rows_apart[cell])));
    EXPECT_LT(std::abs(median(differences)), 0.1) << "cell " << cell.first << " " << cell.second;
    EXPECT_LT(std::abs(median(columns[cell])), 0.1) << "cell " << cell.first << " " << cell.second;
  }
  EXPECT_GE(cells, 4);
  EXPECT_GT(most_apart, 0.5) << "px between rows that the calibration says are the same";
}

INSTANTIATE_TEST_SUITE_P(Worlds, BentPair,
                         testing::Values(Case{"street", "kitti", 10, 1241, 376},
                                         Case{"block", "random:3", 5, 1241, 376},
                                         Case{"hall", "random:4", 60, 752, 480}));

// What a pixel of the left image shows is shown by the right image where the disparity says.
TEST(BentTruth, LeftAndRightDisparityAgree) {
  World world = make_world({"street", 3, 12, 620, 188});
  apply_rig_error(world, make_rig_error("kitti", world.rectified));
  const RenderedPair pair(world, 10);
  int checked = 0, equal = 0;
  for (int v = 20; v < 168; ++v) {
    for (int u = 0; u < 620; ++u) {
      const float d = pair.truth.disparity.at(u, v);
      if (!std::isfinite(d) || pair.truth.depth.at(u, v) <= 0) continue;
      const int x = static_cast<int>(std::lround(static_cast<float>(u) - d));
      if (x < 0 || x >= 620) continue;
      ++checked;
      equal += std::abs(pair.right_truth.disparity.at(x, v) - d) < 0.5F ? 1 : 0;
    }
  }
  EXPECT_GT(checked, 50000);
  EXPECT_GT(equal, checked * 3 / 4) << "the rest is hidden, or at an edge";
}

TEST(BentTruth, DisparityThatIsNotPositiveIsNone) {
  ViewTruth truth;
  truth.depth = ImageOf<float>(4, 1, 1000.0F);
  truth.disparity = ImageOf<float>(4, 1);
  truth.disparity.at(0, 0) = -0.4F;
  truth.disparity.at(1, 0) = 0.0F;
  truth.disparity.at(2, 0) = std::nanf("");
  truth.disparity.at(3, 0) = 1.5F;
  const Image16 code = encode_disparity(truth, 386);
  EXPECT_EQ(code.at(0, 0), 0);
  EXPECT_EQ(code.at(1, 0), 0);
  EXPECT_EQ(code.at(2, 0), 0);
  EXPECT_EQ(code.at(3, 0), 384);
}

TEST(Sensor, BlurIsAGaussianThatKeepsLight) {
  ImageOf<float> image(61, 41, 0.0F);
  image.at(30, 20) = 100;
  Sensor::blur(image, 1.5);
  double sum = 0, x2 = 0, y2 = 0;
  for (int v = 0; v < 41; ++v) {
    for (int u = 0; u < 61; ++u) {
      sum += image.at(u, v);
      x2 += image.at(u, v) * (u - 30) * (u - 30);
      y2 += image.at(u, v) * (v - 20) * (v - 20);
    }
  }
  EXPECT_NEAR(sum, 100, 1e-3);
  EXPECT_NEAR(x2 / sum, 1.5 * 1.5, 0.02);
  EXPECT_NEAR(y2 / sum, 1.5 * 1.5, 0.02);
  ImageOf<float> flat(9, 5, 80.0F);
  Sensor::blur(flat, 3);
  EXPECT_NEAR(flat.at(0, 0), 80, 1e-3);
  EXPECT_NEAR(flat.at(8, 4), 80, 1e-3);
}

double sharpness(const GrayImage& image) {
  cv::Mat edges;
  cv::Laplacian(matrix_of(image), edges, CV_64F);
  cv::Scalar mean, deviation;
  cv::meanStdDev(edges, mean, deviation);
  return deviation[0];
}

TEST(Sensor, CamerasDifferAsAsked) {
  WorldOptions options{"street", 1, 2, 620, 188};
  const World plain = make_world(options);
  options.blur = {0, 1.5};
  options.exposure_difference = 0.3;
  const World differs = make_world(options);
  const RenderAssets plain_assets(plain), assets(differs);
  FrameRenderer a(plain_assets), b(assets);
  const GrayImage left = a.image(0, 0), right = a.image(0, 1), darker = b.image(0, 1);
  EXPECT_EQ(left, b.image(0, 0)) << "the left camera has neither";
  EXPECT_LT(sharpness(darker), 0.5 * 0.7 * sharpness(right));
  EXPECT_NEAR(cv::mean(matrix_of(darker))[0] / cv::mean(matrix_of(right))[0], 0.7 / 0.99, 0.01);
}

std::map<std::string, std::string> files_of(const World& world, const fs::path& folder) {
  WriteOptions options;
  options.output = folder;
  options.command = "test";
  options.quiet = true;
  write_sequence(world, options);
  std::map<std::string, std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (!entry.is_regular_file()) continue;
    files[fs::relative(entry.path(), folder).string()] = read_all(entry.path());
  }
  return files;
}

TEST(BentSequence, OnlyImagesAndTheirTruthDiffer) {
  const ScratchFolder scratch("bent");
  for (const std::string name : {"street", "hall"}) {
    SCOPED_TRACE(name);
    const auto write = [&](const std::string& error) {
      World world = make_world({name, 7, 2, 310, 188});
      if (error == "zero") {
        apply_rig_error(world, RigError{});
      } else if (!error.empty()) {
        apply_rig_error(world, make_rig_error(error, world.rectified));
      }
      return files_of(world, scratch / (name + error));
    };
    const auto plain = write("");
    auto zero = write("zero");
    EXPECT_EQ(zero.erase("rig_error.yaml"), 1U);
    zero["README"] = plain.at("README");
    EXPECT_TRUE(zero == plain) << "an error of zero changes nothing";
    const auto bent = write("random:2");
    for (const auto& [file, content] : plain) {
      const bool image = file.ends_with(".png");
      const bool calibration = file.ends_with("calib.txt") || file.ends_with("sensor.yaml");
      const bool pose = file == "poses.txt" || file.ends_with("estimate0/data.csv");
      if (image && file.find("panoptic") == std::string::npos) {
        EXPECT_NE(bent.at(file), content) << file;
      } else if (calibration || pose) {
        EXPECT_EQ(bent.at(file), content) << file;
      }
    }
    const World world = make_world({name, 7, 2, 310, 188});
    EXPECT_EQ(make_rig_error((scratch / (name + "random:2") / "rig_error.yaml").string(),
                             world.rectified),
              make_rig_error("random:2", world.rectified));
  }
}

// The raw cameras of hall are made of two mappings, which undo each other when there is no error.
TEST(BentSequence, RawCamerasWithATinyErrorAreTheCalibratedOnes) {
  const World plain = make_world({"hall", 1, 2, 376, 240});
  World bent = plain;
  RigError error;
  error.roll = 1e-12;
  apply_rig_error(bent, error);
  for (int v = 0; v < 240; v += 13) {
    for (int u = 0; u < 376; u += 17) {
      EXPECT_LT((plain.rig.left.ray(u, v) - bent.rig.left.ray(u, v)).norm(), 1e-9);
      const Eigen::Vector3d a =
          plain.rig.T_left_right.rotation * plain.rig.right.ray(u, v).homogeneous();
      const Eigen::Vector3d b =
          bent.rig.T_left_right.rotation * bent.rig.right.ray(u, v).homogeneous();
      EXPECT_LT((a.normalized() - b.normalized()).norm(), 1e-9);
    }
  }
  EXPECT_LT((plain.rig.T_left_right.t() - bent.rig.T_left_right.t()).norm(), 1e-9);
}

TEST(BentSequence, TheProgramTakesTheErrorAndRefusesABadOne) {
  const ScratchFolder scratch("bent_program");
  const std::string out = (scratch / "out").string();
  const std::string program = std::string(KYS_BIN_DIR) +
                              "/simulate_sequence street --size 124x48 --frames 1 --images-only "
                              "--quiet --output " +
                              out + " --rig-error ";
  std::ofstream(scratch / "bad.yaml") << "right: {yaw: 3}\n";
  for (const std::string& bad : {(scratch / "bad.yaml").string(), (scratch / "none.yaml").string(),
                                 std::string("random:x")}) {
    const ProgramResult r = run_program(program + bad, scratch);
    EXPECT_EQ(r.status, 2) << bad;
    EXPECT_TRUE(is_one_line(r.error)) << r.error;
    EXPECT_NE(r.error.find(bad), std::string::npos) << r.error;
    EXPECT_FALSE(fs::exists(out));
  }
  const ProgramResult empty = run_program(program + "''", scratch);
  EXPECT_EQ(empty.status, 2);
  EXPECT_TRUE(is_one_line(empty.error)) << empty.error;
  EXPECT_EQ(run_program(program + "random:3 --blur 0.5 --exposure-difference -0.1", scratch).status,
            0);
  EXPECT_NE(
      read_all(scratch / "out" / "README").find(" --blur 0.5,0.5 --exposure-difference -0.1 "),
      std::string::npos);
  for (const char* bad : {"--blur -1", "--blur x", "--blur 1,2,3", "--exposure-difference 1"}) {
    const ProgramResult r = run_program(program + "kitti " + bad, scratch);
    EXPECT_EQ(r.status, 2) << bad;
    EXPECT_TRUE(is_one_line(r.error)) << r.error;
  }
  EXPECT_NE(read_all(scratch / "out" / "README").find(" --rig-error random:3 "), std::string::npos);
  EXPECT_TRUE(fs::exists(scratch / "out" / "rig_error.yaml"));
}

}  // namespace
}  // namespace kys_slam::simulator
