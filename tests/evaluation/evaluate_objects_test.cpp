// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/error.h>
#include <kys_slam/trajectory_file.h>

#include <cmath>
#include <numbers>
#include <sstream>

#include "object_evaluation.h"
#include "object_files.h"
#include "support/option_walk.h"
#include "temporary_folder.h"

namespace kys_slam {
namespace {

constexpr double kStep = 0.1;  // s

/// Ground truth: z forward from the first camera, as in KITTI. The camera drives at 5 m/s and
/// turns.
Rigid3 camera_at(int frame) {
  const double t = kStep * frame;
  return {so3_exp({0, 0.1 * t, 0}), Eigen::Vector3d(0, 0, 5 * t)};
}

/// The estimated trajectory: as the true one, but in a frame of its own, and drifting sideways.
Rigid3 estimated_camera_at(int frame) {
  static const Rigid3 T_w_g(so3_exp({0.1, 0.7, -0.2}), Eigen::Vector3d(3, -1, 2));
  const Rigid3 drift(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0.05 * frame, 0, 0));
  return T_w_g * drift * camera_at(frame);
}

std::map<int, FramePoses> frame_poses(int count) {
  std::map<int, FramePoses> frames;
  for (int k = 0; k < count; ++k) {
    frames[k] = {100 + kStep * k, estimated_camera_at(k), camera_at(k)};
  }
  return frames;
}

/// A car, 4 x 2 x 1.5 m, that drives along an arc of `radius` m at `speed` m/s; x forward, z up.
struct Car {
  int object = 7;
  double speed = 8;
  double radius = 60;
  Eigen::Vector3d start{2, 1, 12};

  [[nodiscard]] Rigid3 at(double t) const {
    const double angle = speed * t / radius;  // from straight ahead (+z) to the right (+x)
    const Eigen::Vector3d p =
        start + radius * Eigen::Vector3d(1 - std::cos(angle), 0, std::sin(angle));
    Eigen::Matrix3d R;
    R.col(0) = Eigen::Vector3d(std::sin(angle), 0, std::cos(angle));
    R.col(2) = Eigen::Vector3d(0, -1, 0);
    R.col(1) = R.col(2).cross(R.col(0));
    return {R, p};
  }
  [[nodiscard]] TrueObject truth(int frame) const {
    TrueObject o;
    o.frame = frame;
    o.object = object;
    o.kind = "car";
    o.moving = speed > 0;
    o.pixels = 5000;
    o.T_g_o = at(kStep * frame);
    o.half = {2, 1, 0.75};
    return o;
  }
  /// What a perfect system says of a point of the car.
  [[nodiscard]] EstimatedObject estimate(int frame, int instance,
                                         const Eigen::Vector3d& p_o) const {
    const double t = kStep * frame;
    const Rigid3 T_w_g = estimated_camera_at(frame) * camera_at(frame).inverse();
    EstimatedObject e;
    e.frame = frame;
    e.instance = instance;
    e.keypoints = 50;
    e.sigma_v = 0.1;
    e.position = T_w_g * (at(t) * p_o);
    constexpr double h = 1e-4;
    e.velocity = T_w_g.rotation * ((at(t + h) * p_o - at(t - h) * p_o) / (2 * h));
    return e;
  }
};

ObjectEvaluationOptions near_and_far() {
  ObjectEvaluationOptions options;
  options.max_range = 1000;
  return options;
}

TEST(EvaluateObjects, EveryNumberOfTheOptionsIsChecked) {
  test::expect_every_number_checked<ObjectEvaluationOptions>(1);  // relative_to
}

TEST(EvaluateObjects, APerfectEstimateOfAnyPointHasNoError) {
  const Car car;
  for (const Eigen::Vector3d& p_o :
       {Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(-2, 0.4, 0.3), Eigen::Vector3d(1, -1, -0.7)}) {
    std::vector<EstimatedObject> estimates;
    std::vector<TrueObject> truth;
    for (int k = 0; k < 30; ++k) {
      truth.push_back(car.truth(k));
      estimates.push_back(car.estimate(k, 3, p_o));
    }
    const auto e = evaluate_objects(estimates, truth, frame_poses(30), near_and_far());
    ASSERT_EQ(e.errors.size(), 30u);
    for (const ObjectError& error : e.errors) {
      EXPECT_TRUE(error.counts);
      EXPECT_LT(error.position, 1e-9);
      EXPECT_LT(error.outside, 1e-9);
      if (error.frame == 0 || error.frame == 29) continue;  // one-sided: half a step off
      EXPECT_LT(error.velocity, 0.01);                      // chord and arc
      EXPECT_LT(std::abs(error.speed), 0.01);
      EXPECT_LT(error.heading, 0.1);
    }
    ASSERT_EQ(e.lives.size(), 1u);
    EXPECT_EQ(e.lives[0].frames, 30);
    EXPECT_EQ(e.lives[0].followed, 30);
    EXPECT_EQ(e.lives[0].identities, 1);
  }
}

TEST(EvaluateObjects, ErrorsAreThoseThatWerePutIn) {
  Car car;
  car.radius = 1e8;  // straight ahead
  std::vector<EstimatedObject> estimates;
  std::vector<TrueObject> truth;
  for (int k = 0; k < 31; ++k) {
    truth.push_back(car.truth(k));
    EstimatedObject e = car.estimate(k, 3, {0, 0, 0});
    // Every other estimate is 0.4 m off, every velocity 10 degrees and 2 m/s.
    const Rigid3 T_w_g = estimated_camera_at(k) * camera_at(k).inverse();
    if (k % 2 == 1) e.position += T_w_g.rotation * Eigen::Vector3d(0.4, 0, 0);
    e.velocity =
        T_w_g.rotation * so3_exp({0, std::numbers::pi / 18, 0}) * Eigen::Vector3d(0, 0, 10);
    estimates.push_back(e);
  }
  const auto e = evaluate_objects(estimates, truth, frame_poses(31), near_and_far());
  ASSERT_EQ(e.errors.size(), 31u);
  for (const ObjectError& error : e.errors) {
    EXPECT_NEAR(error.position, error.frame % 2 == 1 ? 0.4 : 0.0, 1e-4);
    EXPECT_NEAR(error.speed, 2, 1e-4);
    EXPECT_NEAR(error.heading, 10, 0.01);
    // Law of cosines.
    EXPECT_NEAR(error.velocity, std::sqrt(64 + 100 - 160 * std::cos(std::numbers::pi / 18)), 1e-4);
    EXPECT_NEAR(error.deviations, error.velocity / 0.1, 1e-9);
  }
}

TEST(EvaluateObjects, APointOutsideOfTheBoxIsAnError) {
  const Car car;
  std::vector<EstimatedObject> estimates;
  std::vector<TrueObject> truth;
  for (int k = 0; k < 10; ++k) {
    truth.push_back(car.truth(k));
    estimates.push_back(car.estimate(k, 3, {-2.5, 0, 0}));  // half a metre behind
  }
  const auto e = evaluate_objects(estimates, truth, frame_poses(10), near_and_far());
  for (const ObjectError& error : e.errors) {
    EXPECT_NEAR(error.outside, 0.5, 1e-9);
    EXPECT_NEAR(error.position, 0.5, 1e-9);
  }
}

TEST(EvaluateObjects, RelativeToTheStartTheCamerasErrorCounts) {
  Car car;
  car.radius = 1e8;
  std::vector<EstimatedObject> estimates;
  std::vector<TrueObject> truth;
  for (int k = 0; k < 21; ++k) {
    truth.push_back(car.truth(k));
    estimates.push_back(car.estimate(k, 3, {0, 0, 0}));
  }
  ObjectEvaluationOptions options = near_and_far();
  options.relative_to = RelativeTo::kStart;
  const auto e = evaluate_objects(estimates, truth, frame_poses(21), options);
  ASSERT_EQ(e.errors.size(), 21u);
  // The camera drifts by 0.05 m in every frame; the middle frame is the median.
  for (const ObjectError& error : e.errors) {
    EXPECT_NEAR(error.position, 0.05 * std::abs(error.frame - 10), 1e-4);
  }
}

TEST(EvaluateObjects, LivesAreOfOneIdentity) {
  Car car, parked, far;
  parked.object = 8;
  parked.speed = 0;
  parked.start = {-4, 1, 14};
  far.object = 9;
  far.start = {0, 1, 300};
  std::vector<EstimatedObject> estimates;
  std::vector<TrueObject> truth;
  for (int k = 0; k < 20; ++k) {
    truth.push_back(car.truth(k));
    truth.push_back(parked.truth(k));
    truth.push_back(far.truth(k));
    if (k == 19) truth[truth.size() - 3].pixels = 10;  // leaves the view
    if (k >= 2 && k < 14) estimates.push_back(car.estimate(k, 3, {0, 0, 0}));
    if (k >= 14 && k < 18) estimates.push_back(car.estimate(k, 4, {0, 0, 0}));
    if (k < 3) estimates.push_back(parked.estimate(k, 5, {0, 0, 0}));
    if (k == 0) {  // where nothing is
      EstimatedObject nothing = car.estimate(k, 6, {0, 0, 0});
      nothing.position += Eigen::Vector3d(0, -30, 0);
      estimates.push_back(nothing);
    }
  }
  ObjectEvaluationOptions options;
  options.max_range = 60;
  const auto e = evaluate_objects(estimates, truth, frame_poses(20), options);
  EXPECT_EQ(e.estimates, 20);
  EXPECT_EQ(e.unassigned, 1);
  EXPECT_EQ(e.standing, 3);
  ASSERT_EQ(e.lives.size(), 1u);  // neither the one that stands nor the far one
  EXPECT_EQ(e.lives[0].object, 7);
  EXPECT_EQ(e.lives[0].frames, 19);
  EXPECT_EQ(e.lives[0].followed, 12);
  EXPECT_EQ(e.lives[0].reported, 16);
  EXPECT_EQ(e.lives[0].identities, 2);
  ASSERT_EQ(e.life_frames.size(), 19u);
  EXPECT_EQ(e.life_frames[1].identity, std::nullopt);
  EXPECT_EQ(e.life_frames[13].identity, 3);
  EXPECT_EQ(e.life_frames[17].identity, 4);
  EXPECT_EQ(e.life_frames[18].frame, 18);

  options.first_frame = 10;
  options.last_frame = 17;
  const auto part = evaluate_objects(estimates, truth, frame_poses(20), options);
  EXPECT_EQ(part.estimates, 8);
  EXPECT_EQ(part.unassigned, 0);
  EXPECT_EQ(part.standing, 0);
  EXPECT_EQ(part.errors.size(), 8u);
  ASSERT_EQ(part.lives.size(), 1u);
  EXPECT_EQ(part.lives[0].frames, 8);
  EXPECT_EQ(part.lives[0].followed, 4);
  EXPECT_EQ(part.lives[0].reported, 8);
}

// Two cars pass each other: each estimate stays with its own while it is near enough.
TEST(EvaluateObjects, EstimatesStayWithTheirObject) {
  Car a, b;
  a.radius = b.radius = 1e8;
  b.object = 8;
  b.speed = 12;
  b.start = {4.2, 1, 8};
  std::vector<EstimatedObject> estimates;
  std::vector<TrueObject> truth;
  for (int k = 0; k < 25; ++k) {
    for (const Car* car : {&a, &b}) {
      truth.push_back(car->truth(k));
      estimates.push_back(car->estimate(k, car->object, {0, 0, 0}));
    }
  }
  const auto e = evaluate_objects(estimates, truth, frame_poses(25), near_and_far());
  ASSERT_EQ(e.errors.size(), 50u);
  for (const ObjectError& error : e.errors) EXPECT_EQ(error.instance, error.object);
}

TEST(EvaluateObjects, DistanceToABox) {
  const Eigen::Vector3d half(2, 1, 0.5);
  EXPECT_EQ(distance_to_box({1, -1, 0.2}, half), 0);
  EXPECT_NEAR(distance_to_box({5, -5, 0.2}, half), 5, 1e-12);
  EXPECT_NEAR(distance_to_box({0, 0, -2}, half), 1.5, 1e-12);
}

/// A run of three frames, indices 4 to 6, in a folder.
class ObjectFiles : public testing::Test {
 protected:
  void SetUp() override {
    std::string frames = "index,name,timestamp,status,submap,reason\n";
    std::vector<Rigid3> poses;
    std::vector<TimedPose> truth;
    for (int k = 0; k < 3; ++k) {
      frames += std::to_string(k + 4) + ",00000" + std::to_string(k + 4) + "," +
                std::to_string(0.1 * k) + ",tracked,0,\"motion model; local map\"\n";
      poses.push_back(Rigid3());
      truth.push_back({0.1 * k, camera_at(k)});
    }
    write_text(folder_ / "frames.csv", frames);
    write_kitti_poses(folder_ / "trajectory.kitti", poses);
    write_tum_poses(folder_ / "ground_truth.tum", truth);
    write_text(folder_ / "objects.csv",
               "frame,name,timestamp,instance,class,p_moving,keypoints,x,y,z,vx,vy,vz,sigma_v\n"
               "4,000004,0.0,65540,traffic light,0.9,33,1,2,3,4,5,6,0.25\n"
               "5,000005,0.1,65540,car,1,34,1.5,2,3,4,5,6,0.25\n");
  }
  TemporaryFolder folder_;
};

TEST_F(ObjectFiles, RunsAreRead) {
  const ObjectRun run = read_object_run(folder_.path());
  ASSERT_EQ(run.objects.size(), 2u);
  EXPECT_EQ(run.objects[0].frame, 4);
  EXPECT_EQ(run.objects[0].instance, 65540);
  EXPECT_EQ(run.objects[0].kind, "traffic light");
  EXPECT_EQ(run.objects[0].p_moving, 0.9);
  EXPECT_EQ(run.objects[0].keypoints, 33);
  EXPECT_EQ(run.objects[0].position, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(run.objects[0].velocity, Eigen::Vector3d(4, 5, 6));
  EXPECT_EQ(run.objects[0].sigma_v, 0.25);
  ASSERT_EQ(run.frames.size(), 3u);
  EXPECT_TRUE(run.has_ground_truth);
  EXPECT_LT((run.frames.at(6).T_g_c.t() - camera_at(2).t()).norm(), 1e-6);
}

TEST_F(ObjectFiles, NamesMayHaveBlanksCommasAndQuotes) {
  write_text(folder_ / "objects.csv",
             "frame,name,timestamp,instance,class,p_moving,keypoints,x,y,z,vx,vy,vz,sigma_v\n"
             "4,left 4,0.0,7,\"van, or \"\"bus\"\"\",0.9,33,1,2,3,4,5,6,0.25\n"
             "5,\"left, 5\",0.1,8,traffic light,1,34,1.5,2,3,4,5,6,0.25\n");
  write_text(
      folder_ / "frames.csv",
      "index,name,timestamp,status,submap\n4,left 4,0,tracked,0\n5,\"left, 5\",0.1,tracked,0\n"
      "6,left 6,0.2,tracked,0\n");
  const ObjectRun run = read_object_run(folder_.path());
  ASSERT_EQ(run.objects.size(), 2u);
  EXPECT_EQ(run.objects[0].instance, 7);
  EXPECT_EQ(run.objects[0].kind, "van, or \"bus\"");
  EXPECT_EQ(run.objects[1].instance, 8);
  EXPECT_EQ(run.objects[1].kind, "traffic light");
  EXPECT_EQ(run.frames.at(5).timestamp, 0.1);
}

TEST_F(ObjectFiles, DamagedRunsAreRefused) {
  const std::string row = "4,000004,0.0,65540,car,0.9,33,1,2,3,4,5,6,0.25\n";
  write_text(folder_ / "objects.csv",
             "frame,name,timestamp,instance,class,p_moving,keypoints,x,y,z,vx,vy,vz,sigma_v\n" +
                 row + row);
  expect_input_error([&] { read_object_run(folder_.path()); },
                     {"objects.csv:3", "instance 65540 twice in frame 4"});
  write_text(folder_ / "objects.csv", "frame,name\n4,000004\n");
  expect_input_error([&] { read_object_run(folder_.path()); }, {"objects.csv", "columns"});
  write_text(folder_ / "objects.csv", "");
  expect_input_error([&] { read_object_run(folder_.path()); }, {"objects.csv"});
  write_text(folder_ / "objects.csv",
             "frame,name,timestamp,instance,class,p_moving,keypoints,x,y,z,vx,vy,vz,sigma_v\n"
             "4,000004,0.0,65540,car,0.9,33,nan,2,3,4,5,6,0.25\n");
  expect_input_error([&] { read_object_run(folder_.path()); }, {"objects.csv"});
  expect_input_error([&] { read_object_run(folder_ / "missing"); }, {"missing"});
}

TEST_F(ObjectFiles, SimulatorsTruth) {
  write_text(folder_ / "truth.csv",
             "frame,timestamp,object,class,category_id,moving,x,y,z,qx,qy,qz,qw,vx,vy,vz,"
             "box_x,box_y,box_z,length,width,height,left_id,left_pixels,right_id,right_pixels\n"
             // Turned by -90 degrees about y: x forward is the ground truth's z.
             "4,0,12,car,3,1,5,1.6,20,0,-0.7071067811865476,0,0.7071067811865476,0,0,8,"
             "0.5,0,0.75,4,2,1.5,99,1234,98,1200\n");
  EXPECT_EQ(read_true_objects(folder_ / "truth.csv", {{4, {0.0005, {}, {}}}}).size(), 1u);
  expect_input_error(
      [&] {
        read_true_objects(folder_ / "truth.csv", {{4, {0.4, {}, {}}}});
      },
      {"truth.csv:2", "frame 4 at another time"});
  const auto truth = read_true_objects(folder_ / "truth.csv", {});
  ASSERT_EQ(truth.size(), 1u);
  EXPECT_EQ(truth[0].frame, 4);
  EXPECT_EQ(truth[0].object, 12);
  EXPECT_EQ(truth[0].kind, "car");
  EXPECT_TRUE(truth[0].moving);
  EXPECT_EQ(truth[0].pixels, 1234);
  EXPECT_EQ(truth[0].half, Eigen::Vector3d(2, 1, 0.75));
  // A turn by -90 degrees about y takes x to z: the box's middle is half a metre further on in z,
  // 0.75 m along the object's z, which becomes -x.
  EXPECT_LT((truth[0].T_g_o.t() - Eigen::Vector3d(5 - 0.75, 1.6, 20.5)).norm(), 1e-9);
}

TEST_F(ObjectFiles, KittiTrackingLabels) {
  // A car 20 m ahead that drives away (rotation_y -90 degrees: along +z), one that stands across.
  std::string text = "4 -1 DontCare -1 -1 -10 1 2 3 4 -1 -1 -1 -1000 -1000 -1000 -10\n";
  for (int k = 0; k < 3; ++k) {
    const Eigen::Vector3d ahead(1.5, 1.7, 20 + 0.9 * k);
    const Eigen::Vector3d across =
        camera_at(k).inverse() * (camera_at(0) * Eigen::Vector3d(-6, 1.7, 15));
    std::ostringstream lines;
    lines << k + 4 << " 2 Car 0 0 -1.6 600 170 650 200 1.5 1.8 4.2 " << ahead.transpose()
          << " -1.5707963267948966\n"
          << k + 4 << " 3 Van 0 0 0 100 170 150 200 2.0 1.9 5.0 " << across.transpose() << " 0\n";
    text += lines.str();
  }
  write_text(folder_ / "0001.txt", text);
  std::map<int, FramePoses> frames;
  for (int k = 0; k < 3; ++k) frames[k + 4] = {0.1 * k, Rigid3(), camera_at(k)};
  const auto truth = read_true_objects(folder_ / "0001.txt", frames);
  ASSERT_EQ(truth.size(), 6u);
  const TrueObject& car = truth[0];
  EXPECT_EQ(car.object, 2);
  EXPECT_EQ(car.kind, "Car");
  EXPECT_TRUE(car.moving);
  EXPECT_EQ(car.half, Eigen::Vector3d(2.1, 0.9, 0.75));
  const Rigid3 T_c_o = camera_at(0).inverse() * car.T_g_o;
  EXPECT_LT((T_c_o.t() - Eigen::Vector3d(1.5, 1.7 - 0.75, 20)).norm(), 1e-9);
  EXPECT_LT((T_c_o.R().col(0) - Eigen::Vector3d(0, 0, 1)).norm(), 1e-9);   // forward
  EXPECT_LT((T_c_o.R().col(1) - Eigen::Vector3d(-1, 0, 0)).norm(), 1e-9);  // left
  EXPECT_LT((T_c_o.R().col(2) - Eigen::Vector3d(0, -1, 0)).norm(), 1e-9);  // up
  EXPECT_FALSE(truth[1].moving) << "stands in the world, moves in the camera's frame";
  EXPECT_EQ(truth[1].pixels, -1);

  // With the calibration of the data set beside them: camera 2 is 6 cm left of camera 0.
  namespace fs = std::filesystem;
  fs::create_directories(folder_ / "calib");
  fs::create_directories(folder_ / "label_02");
  fs::rename(folder_ / "0001.txt", folder_ / "label_02" / "0001.txt");
  const auto read = [&] { return read_true_objects(folder_ / "label_02" / "0001.txt", frames); };
  write_text(folder_ / "calib" / "0001.txt", "P2: 721.5 0 609.5 43.29 0 721.5 172.8 0.2 0 0 1 0\n");
  const Eigen::Vector3d seen = (camera_at(0).inverse() * read()[0].T_g_o).t();
  EXPECT_LT((seen - Eigen::Vector3d(1.56, 1.7 - 0.75, 20)).norm(), 1e-9);
  for (const char* wrong : {"P2: 721.5 0 609.5\n", "P3: 1 0 0 0 0 1 0 0 0 0 1 0\n",
                            "P2: 0 0 609.5 43.29 0 721.5 172.8 0.2 0 0 1 0\n"}) {
    write_text(folder_ / "calib" / "0001.txt", wrong);
    expect_input_error([&] { read(); }, {"calib/0001.txt"});
  }
}

TEST_F(ObjectFiles, VirtualKittiPoses) {
  std::string poses =
      "frame cameraID trackID alpha width height length world_space_X world_space_Y world_space_Z "
      "rotation_world_space_y rotation_world_space_x rotation_world_space_z camera_space_X "
      "camera_space_Y camera_space_Z rotation_camera_space_y rotation_camera_space_x "
      "rotation_camera_space_z\n";
  std::string boxes =
      "frame cameraID trackID left right top bottom number_pixels truncation_ratio "
      "occupancy_ratio isMoving\n";
  for (const int camera : {0, 1}) {
    poses += "5 " + std::to_string(camera) + " 0 0.1 1.9 1.4 4.4 9 9 9 0 0 0 " +
             (camera == 0 ? "2" : "1.5") + " 1.6 12 0 0 0\n";
    boxes += "5 " + std::to_string(camera) + " 0 10 60 20 40 777 0 0.9 True\n";
  }
  poses += "5 0 1 0.1 1.9 1.4 4.4 9 9 9 0 0 0 8 1.6 30 0 0 0\n";   // without a box: not visible
  poses += "90 0 0 0.1 1.9 1.4 4.4 9 9 9 0 0 0 8 1.6 30 0 0 0\n";  // not a frame of the run
  write_text(folder_ / "pose.txt", poses);
  std::map<int, FramePoses> frames;
  for (int k = 0; k < 3; ++k) frames[k + 4] = {0.1 * k, Rigid3(), camera_at(k)};
  EXPECT_EQ(read_true_objects(folder_ / "pose.txt", frames).size(), 2u);
  write_text(folder_ / "bbox.txt", boxes);
  const auto truth = read_true_objects(folder_ / "pose.txt", frames);
  ASSERT_EQ(truth.size(), 1u);
  EXPECT_EQ(truth[0].pixels, 777);
  EXPECT_TRUE(truth[0].moving);
  EXPECT_EQ(truth[0].half, Eigen::Vector3d(2.2, 0.95, 0.7));
  const Rigid3 T_c_o = camera_at(1).inverse() * truth[0].T_g_o;
  EXPECT_LT((T_c_o.t() - Eigen::Vector3d(2, 0.9, 12)).norm(), 1e-9);
  EXPECT_LT((T_c_o.R().col(0) - Eigen::Vector3d(1, 0, 0)).norm(), 1e-9);
}

TEST_F(ObjectFiles, DamagedTruthIsRefused) {
  const std::map<int, FramePoses> frames = {{4, {}}};
  write_text(folder_ / "a.txt", "");
  expect_input_error([&] { read_true_objects(folder_ / "a.txt", frames); }, {"a.txt"});
  write_text(folder_ / "a.txt", "1 2 3\n");
  expect_input_error([&] { read_true_objects(folder_ / "a.txt", frames); }, {"a.txt", "neither"});
  write_text(folder_ / "a.txt",
             "4 2 Car 0 0 -1.6 600 170 650 200 0 1.8 4.2 1 2 3 0\n");  // no height
  expect_input_error([&] { read_true_objects(folder_ / "a.txt", frames); }, {"a.txt", "size"});
  write_text(folder_ / "a.txt", "4 2 Car 0 0 -1.6 600 170 650 200 1.5 1.8 inf 1 2 3 0\n");
  expect_input_error([&] { read_true_objects(folder_ / "a.txt", frames); }, {"a.txt"});
  write_text(folder_ / "a.txt", "4 2 Car 0 0 -1.6 600 170 650 200 1.5 1.8 4.2 1 2 3 0\n5 2 Car\n");
  expect_input_error([&] { read_true_objects(folder_ / "a.txt", frames); }, {"a.txt", "17"});
}

TEST_F(ObjectFiles, FramesOutsideTheLargestSubMapHaveNoPose) {
  write_text(folder_ / "frames.csv",
             "index,name,timestamp,status,submap\n4,4,0,started,0\n5,5,0.1,started,9\n"
             "6,6,0.2,tracked,9\n");
  EXPECT_EQ(read_object_run(folder_.path()).frames.count(4), 0u);
  EXPECT_EQ(read_object_run(folder_.path()).frames.size(), 2u);
  write_text(folder_ / "frames.csv",
             "index,name,timestamp,status,submap\n4,4,0,started,0\n5,5,0.1,lost,-1\n"
             "6,6,0.2,lost,-1\n");
  const ObjectRun run = read_object_run(folder_.path());
  ASSERT_EQ(run.frames.size(), 1u);
  EXPECT_EQ(run.frames.begin()->first, 4);
}

TEST_F(ObjectFiles, WhatIsThereTwiceIsRefused) {
  const std::map<int, FramePoses> frames = {{4, {}}};
  const std::string car = "4 2 Car 0 0 -1.6 600 170 650 200 1.5 1.8 4.2 1 2 ";
  write_text(folder_ / "a.txt", car + "3 0\n" + car + "30 0\n");
  expect_input_error([&] { read_true_objects(folder_ / "a.txt", frames); },
                     {"a.txt", "object 2 twice in frame 4"});
  write_text(folder_ / "frames.csv",
             "index,name,timestamp,status,submap\n4,000004,0,tracked,0\n4,000004,0.1,tracked,0\n"
             "6,000006,0.2,tracked,0\n");
  expect_input_error([&] { read_object_run(folder_.path()); }, {"frames.csv:3", "second time"});
  write_text(folder_ / "frames.csv",
             "index,name,timestamp,status,submap\n4,000004,0,tracked,0\n5,000005,0.2,tracked,0\n"
             "6,000006,0.1,tracked,0\n");
  expect_input_error([&] { read_object_run(folder_.path()); },
                     {"frames.csv:4", "time stamps do not increase"});
}

}  // namespace
}  // namespace kys_slam
