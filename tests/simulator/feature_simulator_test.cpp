// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/error.h>
#include <kys_slam/trajectory_file.h>

#include <bit>
#include <cmath>
#include <cstdlib>
#include <map>
#include <set>

#include "scratch_folder.h"
#include "simulator/features/feature_world.h"
#include "support/option_walk.h"

namespace kys_slam::simulator {
namespace {

int hamming(const kys::Descriptor& a, const kys::Descriptor& b) {
  int n = 0;
  for (std::size_t i = 0; i < 4; ++i) n += std::popcount(a.words[i] ^ b.words[i]);
  return n;
}

// A drive on a circle of 20 m radius, once around and a bit: 0.5 m per frame.
FeaturePath circle(int frames) {
  FeaturePath path;
  path.camera = {1241, 376, 718.856, 718.856, 607.1928, 185.2157, 0.53716};
  path.ground = 1.65;
  for (int i = 0; i < frames; ++i) {
    const double a = 0.025 * i;
    const Rigid3 T(Eigen::Quaterniond(Eigen::AngleAxisd(a, Eigen::Vector3d::UnitY())),
                   Eigen::Vector3d(20 * (1 - std::cos(a)), 0, 20 * std::sin(a)));
    path.poses.push_back({0.1 * i, T});
  }
  return path;
}

// Few features, nearly all of landmarks.
FeatureOptions few() {
  FeatureOptions o;
  o.features = 600;
  o.outliers = 0.05;
  o.dropout = 0.05;
  return o;
}

// Mean square distance of the features from their landmarks' images, in units of the noise.
double mean_square_error(const FeaturePath& path, const FeatureOptions& options) {
  const FeatureWorld world(path, options);
  double sum = 0;
  int count = 0;
  for (std::size_t i = 0; i < path.poses.size(); i += 5) {
    const FeatureFrame f = world.frame(i);
    for (const bool left : {true, false}) {
      const FeatureSet& set = left ? f.left : f.right;
      const auto& ids = left ? f.left_landmarks : f.right_landmarks;
      EXPECT_EQ(ids.size(), set.size());
      for (std::size_t k = 0; k < set.size(); ++k) {
        if (ids[k] < 0) continue;
        const Eigen::Vector3d uvr = path.camera.project_stereo(path.poses[i].T_w_c.inverse() *
                                                               world.landmark_position(ids[k]));
        const double sigma = options.pixel_noise * std::pow(1.2, set.keypoints[k].octave);
        const double du = (set.keypoints[k].x - (left ? uvr.x() : uvr.z())) / sigma;
        const double dv = (set.keypoints[k].y - uvr.y()) / sigma;
        EXPECT_LT(std::hypot(du, dv), 8);
        sum += du * du + dv * dv;
        count += 2;
      }
    }
  }
  return sum / count;
}

TEST(FeatureWorld, FeaturesLieWhereTheirLandmarksAre) {
  const FeaturePath path = circle(40);
  FeatureOptions options = few();
  EXPECT_NEAR(static_cast<double>(FeatureWorld(path, options).frame(3).left.size()), 600, 90);
  options.wander = 0;
  options.lens = 0;
  EXPECT_NEAR(mean_square_error(path, options), 1, 0.05);
  // A sine of amplitude a has a mean square of a^2 / 2, in the noise's units; at the right image's
  // columns 0.045 a^2 more. The octave of a feature is not always that of its landmark.
  options.wander = 2 * options.pixel_noise;
  EXPECT_NEAR(mean_square_error(path, options), 1 + 2 + 0.045, 0.3);
}

TEST(FeatureWorld, ErrorsOfALensStayTheSame) {
  // The mean error of a region of the image is the same in two frames far apart, and not zero.
  const FeaturePath path = circle(60);
  FeatureOptions options = few();
  options.features = 2000;
  options.lens = 1.5;
  options.pixel_noise = 0.1;
  options.wander = 0;
  const FeatureWorld world(path, options);
  const auto mean_error = [&](std::size_t frame) {
    const FeatureFrame f = world.frame(frame);
    Eigen::Vector2d sum(0, 0);
    int count = 0;
    for (std::size_t k = 0; k < f.left.size(); ++k) {
      const Keypoint& p = f.left.keypoints[k];
      if (f.left_landmarks[k] < 0 || p.x > 400) continue;
      sum += Eigen::Vector2d(p.x, p.y) -
             path.camera.project(path.poses[frame].T_w_c.inverse() *
                                 world.landmark_position(f.left_landmarks[k]));
      ++count;
    }
    return Eigen::Vector2d(sum / count);
  };
  const Eigen::Vector2d first = mean_error(5);
  EXPECT_GT(first.norm(), 0.3);
  EXPECT_LT((mean_error(50) - first).norm(), 0.25 * first.norm());
}

FeatureOptions exact() {
  FeatureOptions options = few();
  options.pixel_noise = options.wander = options.lens = 0;
  return options;
}

TEST(FeatureWorld, KeypointsAreWhereTheTrueCamerasSeeTheirLandmarks) {
  const FeaturePath path = circle(12);
  FeatureOptions options = exact();
  for (const char* name : {"kitti", "random:3"}) {
    options.rig_error = make_rig_error(name, path.camera);
    const TruePair pair(path.camera, *options.rig_error);
    const FeatureWorld world(path, options);
    const FeatureFrame f = world.frame(10);
    const Rigid3 T_c_w = path.poses[10].T_w_c.inverse();
    const RigError& e = *options.rig_error;
    // How far the true right camera is from the given one, at most, in baselines.
    const double apart =
        std::abs(1 / e.focal - 1) + std::abs(e.baseline_y) + std::abs(e.baseline_z);
    int checked = 0;
    double moved = 0;
    for (const int camera : {0, 1}) {
      const FeatureSet& set = camera == 0 ? f.left : f.right;
      const auto& ids = camera == 0 ? f.left_landmarks : f.right_landmarks;
      for (std::size_t i = 0; i < set.size(); ++i) {
        if (ids[i] < 0) continue;
        const Eigen::Vector3d p_c = T_c_w * world.landmark_position(ids[i]);
        const Eigen::Vector2d seen = pair.observe(p_c).segment<2>(2 * camera);
        const Eigen::Vector3d uvr = path.camera.project_stereo(p_c);
        const Eigen::Vector2d given(camera == 0 ? uvr.x() : uvr.z(), uvr.y());
        const Eigen::Vector2d k(set.keypoints[i].x, set.keypoints[i].y);
        EXPECT_LT((k - seen).norm(), 2e-4);
        EXPECT_LT((world.ideal_pixel(camera, k.x(), k.y()) - given).norm(),
                  camera * (uvr.x() - uvr.z()) * 1.02 * apart + 2e-3);
        moved = std::max(moved, (k - given).norm());
        ++checked;
      }
    }
    EXPECT_GT(checked, 500);
    EXPECT_GT(moved, 2.0) << "px";
  }
}

TEST(FeatureWorld, AnErrorOfZeroChangesNothing) {
  FeatureOptions options = few();
  const FeatureFrame plain = FeatureWorld(circle(6), options).frame(5);
  options.rig_error = RigError{};
  const FeatureFrame zero = FeatureWorld(circle(6), options).frame(5);
  ASSERT_EQ(plain.right.size(), zero.right.size());
  for (std::size_t i = 0; i < plain.right.size(); ++i) {
    EXPECT_EQ(plain.right.keypoints[i].x, zero.right.keypoints[i].x);
    EXPECT_EQ(plain.right.keypoints[i].y, zero.right.keypoints[i].y);
  }
}

// Perception looks there, so that it has to be in the image.
TEST(FeatureWorld, IdealPixelsAreInTheImage) {
  const FeaturePath path = circle(2);
  FeatureOptions options = few();
  RigError error;
  error.cx = 200;
  error.cy = -200;
  options.rig_error = error;
  const FeatureWorld world(path, options);
  EXPECT_EQ(world.ideal_pixel(1, 20, 359), Eigen::Vector2d(0, 375));
  EXPECT_EQ(world.ideal_pixel(0, 20, 359).x(), 20);
}

TEST(FeatureWorld, SameLandmarkLooksAlikeAndOthersDoNot) {
  FeatureOptions options = few();
  options.repeats = 0;
  const FeatureWorld world(circle(30), options);
  const FeatureFrame a = world.frame(10);
  const FeatureFrame b = world.frame(11);
  std::map<std::int32_t, std::size_t> at;
  for (std::size_t k = 0; k < b.left.size(); ++k) {
    if (b.left_landmarks[k] >= 0) at[b.left_landmarks[k]] = k;
  }
  int pairs = 0;
  int far = 0;
  double same = 0;
  for (std::size_t k = 0; k < a.left.size(); ++k) {
    const auto found = at.find(a.left_landmarks[k]);
    if (found == at.end()) continue;
    ++pairs;
    const int d = hamming(a.left.descriptors[k], b.left.descriptors[found->second]);
    same += d;
    if (d > 75) ++far;
    EXPECT_LT(std::abs(a.left.keypoints[k].octave - b.left.keypoints[found->second].octave), 3);
    EXPECT_GT(
        hamming(a.left.descriptors[k], b.left.descriptors[(found->second + 7) % b.left.size()]),
        70);
  }
  EXPECT_GT(pairs, 200);
  EXPECT_NEAR(same / pairs, 2 * 0.05 * 256, 14);
  EXPECT_LT(far, pairs / 50);
}

TEST(FeatureWorld, OctaveFollowsDistance) {
  // ORB-SLAM's prediction from one sighting, ceil(log(max / d) / log 1.2) with max = d0 1.2^o0,
  // must name the octave of another sighting or the one above it.
  const FeaturePath path = circle(60);
  const FeatureWorld world(path, few());
  std::map<std::int32_t, std::pair<int, double>> first;
  int good = 0;
  int all = 0;
  for (std::size_t i = 0; i < 60; i += 3) {
    const FeatureFrame f = world.frame(i);
    for (std::size_t k = 0; k < f.left.size(); ++k) {
      const std::int32_t id = f.left_landmarks[k];
      if (id < 0) continue;
      const double d = (world.landmark_position(id) - path.poses[i].T_w_c.t()).norm();
      const int octave = f.left.keypoints[k].octave;
      const auto [at, is_new] = first.try_emplace(id, octave, d);
      if (is_new) continue;
      const double max = at->second.second * std::pow(1.2, at->second.first);
      const int predicted = static_cast<int>(std::ceil(std::log(max / d) / std::log(1.2)));
      ++all;
      if (octave == predicted || octave == predicted - 1) ++good;
    }
  }
  EXPECT_GT(all, 2000);
  EXPECT_GT(good, all * 85 / 100);
}

TEST(FeatureWorld, RevisitsSeeTheSameLandmarks) {
  const int round = static_cast<int>(2 * std::acos(-1.0) / 0.025);
  FeatureOptions options = few();
  options.features = 300;
  const FeatureWorld world(circle(round + 20), options);
  const FeatureFrame a = world.frame(10);
  const FeatureFrame b = world.frame(static_cast<std::size_t>(round) + 10);
  std::set<std::int32_t> seen(a.left_landmarks.begin(), a.left_landmarks.end());
  seen.erase(-1);
  int again = 0;
  for (const std::int32_t id : b.left_landmarks) again += seen.contains(id) ? 1 : 0;
  EXPECT_GT(again, 150) << "of 300 features, 5 % outliers, 2 x 20 % missed";
  // Across the circle there is nothing in common.
  const FeatureFrame c = world.frame(static_cast<std::size_t>(round) / 2);
  int wrong = 0;
  for (const std::int32_t id : c.left_landmarks) wrong += seen.contains(id) ? 1 : 0;
  EXPECT_LT(wrong, 5);
}

class FeatureFile : public testing::Test {
 protected:
  FeatureFile() : scratch_("features"), path_(scratch_ / "a.features") {
    FeatureOptions options = few();
    options.features = 100;
    world_ = std::make_unique<FeatureWorld>(circle(12), options);
    write(path_);
  }
  void write(const std::filesystem::path& path) const {
    FeatureSequenceWriter writer(path, world_->info());
    for (std::size_t i = 0; i < 12; ++i) writer.write(world_->frame(i));
    writer.finish();
  }
  void expect_refused(const std::string& bytes) const {
    std::ofstream(scratch_ / "bad", std::ios::binary) << bytes;
    try {
      FeatureSequence sequence(scratch_ / "bad");
      while (sequence.next()) {
      }
      FAIL() << "accepted";
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find("bad"), std::string::npos);
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
    }
  }
  ScratchFolder scratch_;
  std::filesystem::path path_;
  std::unique_ptr<FeatureWorld> world_;
};

TEST(FeatureOptions, EveryNumberIsChecked) {
  // The seed, the traffic, its objects and labels have no range; the error of the rig has its own.
  kys_slam::test::expect_every_number_checked<FeatureOptions>(5);
  FeatureOptions options;
  options.near = 5;
  options.far = 4;
  EXPECT_EQ(kys_slam::test::complaint(options), "--near must be less than --far");
  EXPECT_THROW(FeatureWorld(circle(12), options), InputError);
}

TEST_F(FeatureFile, ReadsBackWhatWasWritten) {
  FeatureSequence sequence(path_);
  EXPECT_TRUE(is_feature_file(path_));
  EXPECT_EQ(sequence.camera(), circle(1).camera);
  EXPECT_EQ(sequence.size(), 12);
  ASSERT_EQ(sequence.ground_truth().size(), 12U);
  for (std::size_t i = 0; i < 12; ++i) {
    const FeatureFrame expected = world_->frame(i);
    const auto frame = sequence.next();
    ASSERT_TRUE(frame.has_value());
    EXPECT_EQ(frame->index, static_cast<std::int64_t>(i));
    EXPECT_NEAR(frame->timestamp, 0.1 * static_cast<double>(i), 1e-12);
    EXPECT_LT(minus(sequence.ground_truth()[i].T_w_c, circle(12).poses[i].T_w_c).norm(), 1e-12);
    ASSERT_EQ(frame->left_features->size(), expected.left.size());
    EXPECT_EQ(frame->left_features->descriptors, expected.left.descriptors);
    EXPECT_EQ(frame->right_features->descriptors, expected.right.descriptors);
    EXPECT_EQ(sequence.left_landmarks(), expected.left_landmarks);
    EXPECT_EQ(sequence.right_landmarks(), expected.right_landmarks);
    for (std::size_t k = 0; k < expected.left.size(); ++k) {
      const Keypoint& a = frame->left_features->keypoints[k];
      const Keypoint& b = expected.left.keypoints[k];
      EXPECT_NEAR(a.x, b.x, 1.01 / 64);
      EXPECT_NEAR(a.y, b.y, 1.01 / 64);
      EXPECT_NEAR(std::cos(a.angle - b.angle), 1, 1e-6);
      EXPECT_EQ(a.octave, b.octave);
    }
  }
  EXPECT_FALSE(sequence.next().has_value());
}

TEST_F(FeatureFile, PartOfASequence) {
  FeatureSequence sequence(path_, 5, 3);
  EXPECT_EQ(sequence.size(), 3);
  const auto frame = sequence.next();
  EXPECT_EQ(frame->index, 5);
  EXPECT_EQ(frame->name, "000005");
  EXPECT_EQ(frame->left_features->descriptors, world_->frame(5).left.descriptors);
  EXPECT_THROW(FeatureSequence(path_, 12), InputError);
}

TEST_F(FeatureFile, SameBytesAgain) {
  write(scratch_ / "b.features");
  EXPECT_EQ(read_all(path_), read_all(scratch_ / "b.features"));
}

TEST_F(FeatureFile, DamageIsNoticed) {
  const std::string bytes = read_all(path_);
  expect_refused("");
  expect_refused("hello");
  for (const std::size_t cut : {50UL, 96UL, 300UL, 900UL, bytes.size() / 2, bytes.size() - 1}) {
    expect_refused(bytes.substr(0, cut));
  }
  // A flipped bit anywhere: sampled.
  for (std::size_t at = 0; at < bytes.size(); at += 1 + bytes.size() / 97) {
    std::string bad = bytes;
    bad[at] = static_cast<char>(bad[at] ^ 0x10);
    expect_refused(bad);
  }
}

TEST_F(FeatureFile, MoreFeaturesThanAMapNumbersAreRefused) {
  for (const int version : {1, 2}) {
    FeatureFileInfo info = world_->info();
    info.poses.resize(1);
    info.version = version;
    for (const std::size_t count : {65535UL, 65536UL}) {
      FeatureFrame frame;
      frame.left.keypoints.resize(count);
      frame.left.descriptors.resize(count);
      frame.left_landmarks.assign(count, -1);
      FeatureSequenceWriter writer(scratch_ / "many.features", info);
      writer.write(frame);
      writer.finish();
      FeatureSequence sequence(scratch_ / "many.features");
      if (count == 65535) {
        EXPECT_EQ(sequence.next()->left_features->size(), count);
      } else {
        EXPECT_THROW((void)sequence.next(), InputError) << version;
      }
    }
  }
}

TEST_F(FeatureFile, AFolderInPlaceOfTheFileIsNoticedFirst) {
  std::filesystem::create_directory(scratch_ / "there");
  EXPECT_THROW(FeatureSequenceWriter(scratch_ / "there", world_->info()), InputError);
}

TEST_F(FeatureFile, AWholeFileThatCannotBeRenamedIsKept) {
  const std::filesystem::path place = scratch_ / "late";
  FeatureSequenceWriter writer(place, world_->info());
  for (std::size_t i = 0; i < 12; ++i) writer.write(world_->frame(i));
  std::filesystem::create_directory(place);
  try {
    writer.finish();
    FAIL() << "renamed";
  } catch (const InputError& error) {
    const std::string text = error.what();
    const std::size_t at = text.find("the whole file is ");
    ASSERT_NE(at, std::string::npos) << text;
    EXPECT_EQ(read_all(text.substr(at + 18)), read_all(path_));
  }
}

TEST_F(FeatureFile, AnUnfinishedFileDoesNotAppear) {
  {
    FeatureSequenceWriter writer(scratch_ / "half.features", world_->info());
    writer.write(world_->frame(0));
  }
  EXPECT_FALSE(std::filesystem::exists(scratch_ / "half.features"));
  FeatureSequenceWriter short_of_frames(scratch_ / "short.features", world_->info());
  EXPECT_THROW(short_of_frames.finish(), std::logic_error);
  EXPECT_THROW(FeatureSequenceWriter("/proc/kys/no", world_->info()), InputError);
}

TEST(SimulateFeatures, BadTrajectoriesAreRefused) {
  const ScratchFolder scratch("badtrajectory");
  const std::string out = (scratch / "out").string();
  const auto expect_refused = [&](const std::string& text, const std::string& options) {
    std::ofstream(scratch / "t.txt") << text;
    const ProgramResult r =
        run_program(std::string(KYS_BIN_DIR) + "/simulate_features " +
                        (scratch / "t.txt").string() + " --output " + out + options,
                    scratch);
    EXPECT_EQ(r.status, 2) << text;
    EXPECT_TRUE(is_one_line(r.error)) << r.error;
    EXPECT_FALSE(std::filesystem::exists(out));
  };
  const std::string good = "1 0 0 0 0 1 0 0 0 0 1 0\n";
  expect_refused("", "");
  expect_refused("1 2 3\n", "");
  expect_refused(good + "1 0 0 nan 0 1 0 0 0 0 1 0\n", "");
  expect_refused(good + "1 0 0 0 0 5 0 0 0 0 1 0\n", "");
  expect_refused("0.0 0 0 0 0 0 0 1\n0.2 0 0 0 0 0 0 1\n0.1 0 0 0 0 0 0 1\n", "");
  expect_refused(good, " --features 3");
  expect_refused(good, " --start 7");
  expect_refused(good, " --camera pinhole");
  expect_refused(good, " --near 10 --far 5");
  expect_refused(good, " --near 1e-300");
  expect_refused(good, " --rate 1e-300");
  expect_refused(good, " --rate -20");
  expect_refused(good, " --rate 0");
  expect_refused(good, " --frame-rate 0");
  expect_refused(good, " --seed -1");
  expect_refused(good, " --features many");
  expect_refused(good, " --bogus");
  expect_refused("1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 1e15 0 1 0 0 0 0 1 0\n", "");
  expect_refused(good, " --every 0");
  expect_refused(good, " --wander nan");
  expect_refused(good, " --lens -1");
  expect_refused(good, " --rig-error random:x");
  expect_refused(good, " --rig-error " + (scratch / "none.yaml").string());
}

TEST(SimulateFeatures, TheErrorOfTheRigIsWrittenBesideTheFile) {
  const ScratchFolder scratch("featurerig");
  std::ofstream(scratch / "t.txt") << "1 0 0 0 0 1 0 0 0 0 1 0\n";
  const std::string out = (scratch / "out").string();
  const ProgramResult r =
      run_program(std::string(KYS_BIN_DIR) + "/simulate_features " + (scratch / "t.txt").string() +
                      " --rig-error random:4" + " --output " + out,
                  scratch);
  EXPECT_EQ(r.status, 0) << r.error;
  const StereoCamera kitti = circle(1).camera;
  const RigError error = make_rig_error(out + ".rig_error.yaml", kitti);
  EXPECT_NEAR(error.yaw, make_rig_error("random:4", kitti).yaw, 1e-12);
}

// Poses along a straight line, of a TUM file with `file_hz` and stamps that are off by 0.1 ms.
std::vector<TimedPose> poses_at(double file_hz, double frame_rate, int every = 1) {
  const ScratchFolder folder("rates");
  const std::filesystem::path file = folder / "path.tum.txt";
  std::ofstream text(file);
  for (int i = 0; i < 401; ++i) {
    text << std::fixed << i / file_hz + (i % 2 != 0 ? 1e-4 : 0) << " 0 0 " << i << " 0 0 0 1\n";
  }
  text.close();
  FeatureOptions options;
  options.frame_rate = frame_rate;
  options.every = every;
  return read_feature_path(file, options).poses;
}

TEST(FeaturePath, FrameRateLeavesPosesOut) {
  EXPECT_EQ(poses_at(40, FeatureOptions().frame_rate).size(), 401U) << "all by default";
  const std::vector<TimedPose> poses = poses_at(200, 20);
  ASSERT_EQ(poses.size(), 41U);
  EXPECT_NEAR(poses[1].timestamp - poses[0].timestamp, 0.05, 1e-9);
  EXPECT_EQ(poses_at(40, 20).size(), 201U);
  EXPECT_EQ(poses_at(40, 20, 3).size(), 67U);
  EXPECT_EQ(poses_at(4, 20).size(), 401U) << "slower files are used whole";
  EXPECT_EQ(poses_at(31, 20).size(), 201U) << "every second: 15.5 Hz";
  EXPECT_EQ(poses_at(40, 1e-3).size(), 1U) << "never an empty path";
}

TEST(FeaturePath, FrameRateOfFilesWithoutTimeStamps) {
  const ScratchFolder folder("kittirate");
  const std::filesystem::path file = folder / "path.txt";
  std::ofstream text(file);
  for (int i = 0; i < 21; ++i) text << "1 0 0 0 0 1 0 0 0 0 1 " << i << "\n";
  text.close();
  FeatureOptions options;
  options.frame_rate = 20;
  EXPECT_EQ(read_feature_path(file, options).poses.size(), 21U) << "10 Hz by default";
  options.rate = 40;
  EXPECT_EQ(read_feature_path(file, options).poses.size(), 11U);
}

TEST(SimulateFeatures, OutputThatCannotBeWrittenLeavesNothing) {
  const ScratchFolder scratch("unwritable");
  std::string rows;
  for (int i = 0; i < 20; ++i) rows += "1 0 0 0 0 1 0 0 0 0 1 " + std::to_string(0.5 * i) + "\n";
  std::ofstream(scratch / "t.txt") << rows;
  std::filesystem::create_directory(scratch / "folder");
  const std::string command = std::string(KYS_BIN_DIR) + "/simulate_features " +
                              (scratch / "t.txt").string() + " --quiet --output ";
  const auto expect_refused = [&](const std::string& whole) {
    const ProgramResult r = run_program(whole, scratch);
    EXPECT_EQ(r.status, 2) << whole;
    EXPECT_TRUE(is_one_line(r.error)) << r.error;
    EXPECT_NE(r.error.find("cannot write"), std::string::npos) << r.error;
  };
  expect_refused(command + "/proc/kys/no");
  expect_refused(command + (scratch / "missing" / "out").string());
  expect_refused(command + (scratch / "folder").string());
  // Files may not grow beyond a few kilobytes, as on a full disk.
  expect_refused("bash -c \"trap '' XFSZ; ulimit -f 64; " + command +
                 (scratch / "folder" / "out").string() + "\"");
  EXPECT_TRUE(std::filesystem::is_empty(scratch / "folder")) << "no half-written file";
}

TEST(SimulateFeatures, RealTrajectoriesCanBeDriven) {
  const char* chosen = std::getenv("KYS_SHARED_DATA_DIR");
  const std::filesystem::path folder =
      std::filesystem::path(chosen != nullptr ? chosen : KYS_SHARED_DATA_DIR) / "ground_truth";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "real ground truth is not here";
  FeatureOptions options;
  options.frames = 40;
  options.features = 400;
  for (const char* name : {"kitti/07.txt", "euroc/V1_02_medium.tum.txt"}) {
    const FeaturePath path = read_feature_path(folder / name, options);
    const FeatureWorld world(path, options);
    EXPECT_NEAR(static_cast<double>(world.frame(20).left.size()), 400, 80) << name;
  }
}

}  // namespace
}  // namespace kys_slam::simulator
