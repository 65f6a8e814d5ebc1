// SPDX-License-Identifier: BSD-3-Clause
// Another extractor in the whole system: grey values around corners, as floats, without levels or
// orientations.
#include <gtest/gtest.h>
#include <kys_slam/binariser.h>
#include <kys_slam/error.h>
#include <kys_slam/feature_extractor.h>
#include <kys_slam/system.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "io/temporary_folder.h"
#include "support/rendered_corridor.h"

namespace kys_slam {
namespace {

constexpr int kPatchSamples = 4;  // samples to either side
constexpr int kPatchStep = 2;     // px

StereoCamera corridor_camera() {
  StereoCamera camera;
  camera.width = 480;
  camera.height = 240;
  camera.fx = camera.fy = 300;
  camera.cx = 239.5;
  camera.cy = 119.5;
  camera.baseline = 0.5;
  return camera;
}

class GreyPatches final : public FeatureExtractor {
 public:
  explicit GreyPatches(std::string name = "grey-patches")
      : corners_(make_orb_extractor()), binariser_(2 * kPatchSamples * 2 * kPatchSamples) {
    traits_.name = std::move(name);
    traits_.levels = 1;
    traits_.reach = 1.5;
    traits_.oriented = false;
    traits_.pixel_sigma = 0.5;
  }
  [[nodiscard]] const ExtractorTraits& traits() const override { return traits_; }
  void extract(const GrayImage& left, const GrayImage& right, FeatureSet& of_left,
               FeatureSet& of_right) override {
    corners_->extract(left, right, of_left, of_right);
    describe(left, of_left);
    describe(right, of_right);
  }

 private:
  void describe(const GrayImage& image, FeatureSet& features) const {
    std::vector<Keypoint> kept;
    std::vector<float> values;
    for (Keypoint k : features.keypoints) {
      const auto x = static_cast<int>(std::lround(k.x)), y = static_cast<int>(std::lround(k.y));
      const int reach = kPatchStep * kPatchSamples;
      if (k.octave > 1 || x < reach || y < reach || x + reach >= image.width() ||
          y + reach >= image.height()) {
        continue;
      }
      k.octave = 0;
      k.angle = 0;
      kept.push_back(k);
      const std::size_t first = values.size();
      for (int v = -kPatchSamples; v < kPatchSamples; ++v) {
        for (int u = -kPatchSamples; u < kPatchSamples; ++u) {
          values.push_back(image.at(x + kPatchStep * u + 1, y + kPatchStep * v + 1));
        }
      }
      float mean = 0;
      for (std::size_t i = first; i < values.size(); ++i) mean += values[i];
      mean /= static_cast<float>(values.size() - first);
      for (std::size_t i = first; i < values.size(); ++i) values[i] -= mean;
    }
    features.keypoints = std::move(kept);
    binariser_.apply(values, features.descriptors);
  }

  ExtractorTraits traits_;
  std::unique_ptr<FeatureExtractor> corners_;
  Binariser binariser_;
};

Rigid3 pose(int i) {
  return {Eigen::Quaterniond::Identity(), Eigen::Vector3d(0.02 * i, 0, 0.35 * i)};
}

/// Rendered once.
const StereoFrame& look(int i) {
  static const testing::RenderedCorridor corridor(corridor_camera(), 5);
  static std::map<int, StereoFrame> rendered;
  const auto at = rendered.find(i);
  return at != rendered.end() ? at->second
                              : rendered.emplace(i, corridor.look(i, pose(i))).first->second;
}

class ExtractorTest : public ::testing::Test {
 protected:
  static constexpr int kFrames = 15;

  [[nodiscard]] std::unique_ptr<System> run(std::unique_ptr<FeatureExtractor> extractor) const {
    auto system = std::make_unique<System>(corridor_camera(), Settings(), Schedule::kSequential,
                                           nullptr, std::move(extractor));
    for (int i = 0; i < kFrames; ++i) system->feed(look(i));
    system->finish();
    return system;
  }
  static void expect_true_path(const System& system) {
    const std::vector<FrameEstimate> path = system.trajectory();
    ASSERT_EQ(path.size(), static_cast<std::size_t>(kFrames));
    for (int i = 0; i < kFrames; ++i) {
      const FrameEstimate& e = path[static_cast<std::size_t>(i)];
      EXPECT_TRUE(e.connected) << "frame " << i;
      // A hundredth of the way, as of stereo odometry in general.
      const Eigen::Vector3d truth = (pose(0).inverse() * pose(i)).t();
      EXPECT_LT((e.T_w_c.t() - truth).norm(), 0.02 + 0.01 * truth.norm()) << "frame " << i;
    }
  }
  std::filesystem::path file() { return folder_.path() / "a.map"; }

  TemporaryFolder folder_;
};

TEST_F(ExtractorTest, TracksAndRelocalisesWithFeaturesOfItsOwn) {
  const auto system = run(std::make_unique<GreyPatches>());
  expect_true_path(*system);
  system->save_map(file());

  System later(corridor_camera(), Settings(), Schedule::kSequential, nullptr,
               std::make_unique<GreyPatches>());
  later.load_map(file(), true);
  const FrameReport report = later.feed(look(6));
  EXPECT_NE(report.status, FrameStatus::kLost) << report.reason;
  EXPECT_TRUE(report.relocalised);
  EXPECT_LT((report.T_w_c.t() - (pose(0).inverse() * pose(6)).t()).norm(), 0.05);
}

TEST_F(ExtractorTest, MapsAreRefusedByAnotherExtractor) {
  run(std::make_unique<GreyPatches>())->save_map(file());
  const auto refusal = [&](std::unique_ptr<FeatureExtractor> extractor) -> std::string {
    System system(corridor_camera(), Settings(), Schedule::kSequential, nullptr,
                  std::move(extractor));
    try {
      system.load_map(file());
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(refusal(std::make_unique<GreyPatches>()), "");
  for (const std::string& text :
       {refusal(nullptr), refusal(std::make_unique<GreyPatches>("other"))}) {
    EXPECT_NE(text.find("a.map"), std::string::npos);
    EXPECT_NE(text.find("'grey-patches'"), std::string::npos) << text;
  }
  run(nullptr)->save_map(file());
  EXPECT_NE(refusal(std::make_unique<GreyPatches>()).find("'orb'"), std::string::npos);
  EXPECT_EQ(refusal(nullptr), "");
}

TEST_F(ExtractorTest, OrbGivenIsOrbByDefault) {
  const auto given = run(make_orb_extractor()), implied = run(nullptr);
  const std::vector<FrameEstimate> a = given->trajectory(), b = implied->trajectory();
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].T_w_c.matrix(), b[i].T_w_c.matrix()) << "frame " << i;
  }
  expect_true_path(*given);
}

TEST_F(ExtractorTest, FramesWithFeaturesOfTheirOwnAreRefused) {
  System system(corridor_camera(), Settings(), Schedule::kSequential, nullptr,
                std::make_unique<GreyPatches>());
  StereoFrame frame = look(0);
  frame.left_features.emplace();
  frame.right_features.emplace();
  EXPECT_THROW(system.feed(frame), InputError);
}

}  // namespace
}  // namespace kys_slam
