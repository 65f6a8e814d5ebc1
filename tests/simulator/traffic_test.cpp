// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>
#include <kys/prior.h>
#include <kys_slam/error.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <map>

#include "io/feature_payload.h"
#include "scratch_folder.h"
#include "simulator/common/coco_classes.h"
#include "simulator/features/feature_world.h"
#include "simulator/perception/perception.h"
#include "simulator/traffic/object_motion.h"
#include "simulator/traffic/replayed_objects.h"

// Drives with traffic. What the generator says about its objects is checked by formulas of this
// file alone: corners of boxes, rays against their faces, projections of moved points.
namespace kys_slam::simulator {
namespace {

using Eigen::Vector3d;

/// Straight ahead at 8 m/s, a wait of three seconds, then on and a turn to the right.
FeaturePath drive() {
  FeaturePath path;
  path.camera = {1241, 376, 718.856, 718.856, 607.1928, 185.2157, 0.53716};
  path.ground = 1.65;
  double z = 0, x = 0, heading = 0;
  for (int i = 0; i < 160; ++i) {
    const double speed = i < 50 ? 0.8 : i < 60 ? 0.08 * (60 - i) : i < 90 ? 0 : 0.6;
    if (i > 120) heading += 0.04;
    x += speed * std::sin(heading);
    z += speed * std::cos(heading);
    const Eigen::Quaterniond q(Eigen::AngleAxisd(heading, Vector3d::UnitY()));
    path.poses.push_back({0.1 * i, Rigid3(q, Vector3d(x, 0, z))});
  }
  return path;
}

FeatureOptions clean(Traffic traffic) {
  FeatureOptions o;
  o.features = 600;
  o.outliers = 0.05;
  o.dropout = 0.05;
  o.wander = 0;
  o.lens = 0;
  o.traffic = traffic;
  return o;
}

const FeatureWorld& jam() {
  static const FeatureWorld world(drive(), clean(Traffic::kJam));
  return world;
}

bool moves(const FeatureObject& object) {
  return object.kind != FeatureObject::Kind::kStatic;
}

/// Whether the straight line from a to b passes through the inside of a box, by clipping it at the
/// six planes one after the other.
bool passes_through(Vector3d a, Vector3d b, const Vector3d& half) {
  for (int axis = 0; axis < 3; ++axis) {
    for (const double side : {-1.0, 1.0}) {
      const double da = side * a[axis] - half[axis];
      const double db = side * b[axis] - half[axis];
      if (da > 0 && db > 0) return false;
      if (da <= 0 && db <= 0) continue;
      const Vector3d cut = a + (b - a) * (da / (da - db));
      (da > 0 ? a : b) = cut;
    }
  }
  return (b - a).norm() > 1e-9;
}

TEST(Traffic, LandmarksOfRigidObjectsMoveAsTheirPosesSay) {
  const FeatureTruth truth = jam().truth();
  const FeaturePath path = drive();
  double sum = 0, against_still = 0;
  int count = 0;
  for (std::size_t i = 0; i < path.poses.size(); i += 7) {
    const FeatureFrame f = jam().frame(i);
    for (std::size_t k = 0; k < f.left.size(); ++k) {
      if (f.left_landmarks[k] < 0) continue;
      const auto& l = truth.landmarks.at(static_cast<std::size_t>(f.left_landmarks[k]));
      if (l.object < 0) continue;
      const FeatureObject& o = truth.objects.at(static_cast<std::size_t>(l.object));
      if (o.kind != FeatureObject::Kind::kRigid) continue;
      const std::int64_t at = static_cast<std::int64_t>(i) - o.first_frame;
      ASSERT_TRUE(at >= 0 && at < static_cast<std::int64_t>(o.poses.size()));
      const Vector3d p_w = o.poses[static_cast<std::size_t>(at)] * l.position.cast<double>();
      const auto pixel = [&](const Vector3d& p) {
        return path.camera.project(path.poses[i].T_w_c.inverse() * p);
      };
      const Keypoint& key = f.left.keypoints[k];
      const double sigma = 0.25 * std::pow(1.2, key.octave);
      const Eigen::Vector2d e(key.x - pixel(p_w).x(), key.y - pixel(p_w).y());
      EXPECT_LT(e.norm(), 6 * sigma) << "frame " << i << " object " << l.object;
      sum += e.squaredNorm() / (2 * sigma * sigma);
      ++count;
      // Where it would be if the object had stayed where it was first seen.
      const Vector3d stayed = o.poses.front() * l.position.cast<double>();
      if ((p_w - stayed).norm() < 2) continue;
      against_still = std::max(against_still, (pixel(stayed) - pixel(p_w)).norm());
    }
  }
  EXPECT_GT(count, 300);
  EXPECT_NEAR(sum / count, 1, 0.15) << "in units of the pixel noise";
  EXPECT_GT(against_still, 20) << "nothing moved: the test says nothing";
}

TEST(Traffic, WhatIsBehindABoxIsNotSeen) {
  const FeatureTruth truth = jam().truth();
  const FeaturePath path = drive();
  int checked = 0, would_be_hidden = 0;
  const FeatureWorld empty(drive(), clean(Traffic::kNone));
  for (std::size_t i = 0; i < path.poses.size(); i += 11) {
    const auto hidden = [&](const FeatureTruth::Landmark& l, const Vector3d& p_w, bool left) {
      const Vector3d c_w = path.poses[i].T_w_c * Vector3d(left ? 0 : path.camera.baseline, 0, 0);
      for (std::size_t n = 0; n < truth.objects.size(); ++n) {
        const FeatureObject& o = truth.objects[n];
        const Rigid3* T_w_o = pose_in_frame(o, i);
        if (T_w_o == nullptr || static_cast<std::int32_t>(n) == l.object) continue;
        const Rigid3 T_o_w = T_w_o->inverse();
        // Two centimetres less on all sides: what lies on a face is not behind it.
        const Vector3d half = o.half_size.cast<double>() - Vector3d::Constant(0.02);
        if ((c_w - T_w_o->t()).norm() > 80) continue;
        if (passes_through(T_o_w * c_w, T_o_w * p_w, half)) return true;
      }
      return false;
    };
    const auto check = [&](const FeatureFrame& f, bool expected_visible) {
      for (const bool left : {true, false}) {
        for (const std::int32_t id : left ? f.left_landmarks : f.right_landmarks) {
          if (id < 0) continue;
          const auto& l = truth.landmarks.at(static_cast<std::size_t>(id));
          Vector3d p_w = l.position.cast<double>();
          if (l.object >= 0) {
            const FeatureObject& o = truth.objects[static_cast<std::size_t>(l.object)];
            p_w = *pose_in_frame(o, i) * sway(o, p_w, path.poses[i].timestamp);
          }
          if (expected_visible) {
            EXPECT_FALSE(hidden(l, p_w, left)) << "frame " << i << ", landmark " << id;
            ++checked;
          } else if (hidden(l, p_w, left)) {
            ++would_be_hidden;
          }
        }
      }
    };
    check(jam().frame(i), true);
    // The same static landmarks without traffic: many of them stand behind something.
    check(empty.frame(i), false);
  }
  EXPECT_GT(checked, 3000);
  EXPECT_GT(would_be_hidden, 300);
}

TEST(Traffic, StaticWorldIsTheOneWithoutTraffic) {
  const FeatureWorld empty(drive(), clean(Traffic::kNone));
  ASSERT_LT(empty.landmark_count(), jam().landmark_count());
  for (std::size_t i = 0; i < empty.landmark_count(); i += 97) {
    const auto id = static_cast<std::int32_t>(i);
    EXPECT_EQ(empty.landmark_position(id), jam().landmark_position(id));
    EXPECT_EQ(jam().object_of(id), -1);
  }
}

TEST(Traffic, VehiclesStartWhileTheCameraWaitsAndNothingTouchesIt) {
  const FeaturePath path = drive();
  bool lead_starts_first = false;
  for (const FeatureObject& o : jam().objects()) {
    if (!moves(o)) continue;
    for (std::size_t i = 0; i < path.poses.size(); ++i) {
      const Rigid3* now = pose_in_frame(o, i);
      if (now == nullptr) continue;
      const Vector3d c_o = now->inverse() * path.poses[i].T_w_c.t();
      EXPECT_GT((c_o.cwiseAbs() - o.half_size.cast<double>()).maxCoeff(), 0.9);
      const Rigid3* next = pose_in_frame(o, i + 1);
      if (next == nullptr) continue;
      EXPECT_LT((next->t() - now->t()).norm(), 3) << "faster than 30 m/s";
      const Vector3d step = path.poses[i].T_w_c.inverse().rotation * (next->t() - now->t());
      const Vector3d ahead = path.poses[i].T_w_c.inverse() * now->t();
      const bool camera_stands = i > 61 && i < 88;
      if (camera_stands && std::abs(ahead.x()) < 0.6 && ahead.z() > 0 && step.z() > 0.1) {
        lead_starts_first = true;
      }
    }
  }
  EXPECT_TRUE(lead_starts_first);
}

TEST(Traffic, MoreTrafficCoversMoreOfTheImage) {
  double last = 0;
  for (const Traffic traffic : {Traffic::kNone, Traffic::kLight, Traffic::kCity, Traffic::kJam}) {
    FeatureOptions options = clean(traffic);
    options.features = 100;
    double share = 0;
    for (const std::uint64_t seed : {1, 2, 3}) {
      options.seed = seed;
      const FeatureWorld world(drive(), options);
      for (std::size_t i = 0; i < 160; i += 4) share += world.frame(i).mover_share / 40 / 3;
    }
    if (traffic == Traffic::kNone) {
      EXPECT_EQ(share, 0);
    } else {
      EXPECT_GT(share, last);
    }
    last = share;
  }
  EXPECT_LT(last, 0.5);
}

TEST(Traffic, ThroughARoomPeopleWalk) {
  FeaturePath path;
  path.camera = {752, 480, 458, 457, 367, 248, 0.11};
  path.near = 0.8;
  path.far = 12;
  Eigen::Matrix3d R;  // camera x right, y down, z ahead, in a world with z up
  R << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  for (int i = 0; i < 300; ++i) {
    path.poses.push_back({0.05 * i, Rigid3(R, Vector3d(0.01 * i, 0, 1.2))});
  }
  FeatureOptions options = clean(Traffic::kJam);
  options.features = 300;
  const FeatureWorld world(path, options);
  int people = 0;
  for (const FeatureObject& o : world.objects()) {
    if (o.kind != FeatureObject::Kind::kArticulated) continue;
    ++people;
    const Vector3d feet = o.poses.front() * Vector3d(0, o.half_size.y(), 0);
    EXPECT_NEAR(feet.z(), 1.1, 1e-6) << "on the floor, 0.1 m below the lowest pose";
    EXPECT_GT((o.poses.front().rotation * Vector3d::UnitY()).dot(-Vector3d::UnitZ()), 0.999);
  }
  EXPECT_GT(people, 2);
  double share = 0;
  for (std::size_t i = 0; i < 300; i += 10) share += world.frame(i).mover_share / 30;
  EXPECT_GT(share, 0.005);
}

TEST(Traffic, ObjectsOfARenderedWorldAreRead) {
  const ScratchFolder scratch("objects");
  const auto write = [&](const std::string& rows) {
    std::ofstream(scratch / "objects.csv")
        << "frame,timestamp,object,class,category_id,moving,x,y,z,qx,qy,qz,qw,vx,vy,vz,box_x,box_y,"
           "box_z,length,width,height,left_id,left_pixels,right_id,right_pixels\n"
        << rows;
    return scratch / "objects.csv";
  };
  // Forward (the file's x) is the camera's z, up (its z) the camera's -y: q turns the one into the
  // other.
  const std::string q = ",0.5,-0.5,0.5,0.5,0,0,0,";
  const std::string size = "0.5,0,0.75,4,1.8,1.5,1,9,1,9\n";
  const auto objects =
      read_objects(write("2,0.2,7,car,3,1,1,1.65,10" + q + size + "4,0.4,7,car,3,0,1,1.65,12" + q +
                         size + "0,0.0,9,car,3,0,-3,1.65,20" + q + size),
                   5);
  ASSERT_EQ(objects.size(), 2U);
  const FeatureObject& car = objects[0];
  EXPECT_EQ(car.kind, FeatureObject::Kind::kRigid);
  EXPECT_EQ(car.first_frame, 2);
  ASSERT_EQ(car.poses.size(), 3U) << "the gap is filled";
  EXPECT_TRUE(car.half_size.isApprox(Eigen::Vector3f(0.9F, 0.75F, 2)));
  EXPECT_LT((car.poses[0].t() - Vector3d(1, 0.9, 10.5)).norm(), 1e-9) << "the box's middle";
  EXPECT_LT((car.poses[0].rotation * Vector3d::UnitZ() - Vector3d::UnitZ()).norm(), 1e-9);
  EXPECT_LT((car.poses[0].rotation * Vector3d::UnitY() - Vector3d::UnitY()).norm(), 1e-9);
  EXPECT_EQ(objects[1].kind, FeatureObject::Kind::kStatic);
  EXPECT_THROW(read_objects(write(""), 5), InputError);
  EXPECT_THROW(read_objects(write("2,0.2,7,car,3,1\n"), 5), InputError);
  EXPECT_THROW(read_objects(write("2,0.2,7,car,3,1,1,nan,10" + q + size), 5), InputError);
  EXPECT_THROW(
      read_objects(write("2,0,7,car,3,1,1,1,10" + q + size + "1,0,7,car,3,1,1,1,10" + q + size), 5),
      InputError);
  EXPECT_THROW(read_objects(scratch / "none.csv", 5), InputError);
  // Beyond the trajectory, where every pose in between would have to be filled in.
  const std::string car_at_4 = write("4,0.4,7,car,3,1,1,1,10" + q + size);
  EXPECT_EQ(read_objects(car_at_4, 5).size(), 1U);
  EXPECT_THROW(read_objects(car_at_4, 4), InputError);
}

TEST(Perception, ExactPerceptionKnowsObjectsAndTheirMotion) {
  FeatureOptions options = clean(Traffic::kCity);
  options.labelled = true;
  const FeatureWorld world(drive(), options);
  Perception detector(world, perception_level("exact"), 1);
  int on_movers = 0, flagged = 0, on_static = 0, named = 0, wrongly = 0;
  for (std::size_t i = 0; i < 159; ++i) {
    FeatureFrame f = world.frame(i);
    detector.add_priors(i, f);
    ASSERT_TRUE(f.has_priors);
    ASSERT_EQ(f.left_priors.size(), f.left.size());
    ASSERT_EQ(f.right_priors.size(), f.right.size());
    for (std::size_t k = 0; k < f.left.size(); ++k) {
      const std::int32_t id = f.left_landmarks[k];
      const kys::Prior& p = f.left_priors[k];
      if (id < 0 || p.label == kys::kVoidLabel) continue;
      const std::int32_t n = world.object_of(id);
      if (n < 0) {
        ++on_static;
        named += p.label == world.label_of(id);
        wrongly += p.dynamic;
        continue;
      }
      const FeatureObject& o = world.objects()[static_cast<std::size_t>(n)];
      const Rigid3* now = pose_in_frame(o, i);
      const Rigid3* next = pose_in_frame(o, i + 1);
      if (next == nullptr || (next->t() - now->t()).norm() < 0.3 ||
          p.label != o.label) {  // the last: too small to be a segment
        continue;
      }
      ++on_movers;
      flagged += p.dynamic;
      EXPECT_EQ(p.motion > 0, p.dynamic != 0);
    }
  }
  EXPECT_GT(on_static, 5000);
  EXPECT_GT(named, on_static * 9 / 10);  // a corner where two segments meet may be on either
  EXPECT_LT(wrongly, on_static / 100);
  EXPECT_GT(on_movers, 200);
  EXPECT_GT(flagged, on_movers * 9 / 10);
}

/// Instance of every object on which a keypoint has the object's class.
std::map<std::int32_t, std::int32_t> instances_of(const FeatureWorld& world,
                                                  const std::vector<std::int32_t>& landmarks,
                                                  const std::vector<kys::Prior>& priors) {
  std::map<std::int32_t, std::int32_t> instances;
  for (std::size_t k = 0; k < priors.size(); ++k) {
    const std::int32_t n = landmarks[k] < 0 ? -1 : world.object_of(landmarks[k]);
    if (n < 0 || priors[k].label != world.objects()[static_cast<std::size_t>(n)].label) continue;
    instances.try_emplace(n, priors[k].instance);
  }
  return instances;
}

/// Masks link an object over time and between the images; centroids, in each image alone.
TEST(Perception, IdentitiesAreThoseOfTheAssociation) {
  FeatureOptions options = clean(Traffic::kCity);
  options.labelled = true;
  const FeatureWorld world(drive(), options);
  for (const char* level : {"exact", "poor"}) {
    const bool by_masks = level == std::string("exact");
    Perception detector(world, perception_level(level), 1);
    int linked = 0, in_both = 0, kept = 0, followed = 0;
    std::map<std::int32_t, std::int32_t> before;
    for (std::size_t i = 0; i < 160; ++i) {
      FeatureFrame f = world.frame(i);
      detector.add_priors(i, f);
      const auto left = instances_of(world, f.left_landmarks, f.left_priors);
      const auto right = instances_of(world, f.right_landmarks, f.right_priors);
      for (const auto& [object, instance] : left) {
        if (const auto at = right.find(object); at != right.end()) {
          ++in_both;
          linked += at->second == instance;
        }
        if (const auto at = before.find(object); at != before.end()) {
          ++followed;
          kept += at->second == instance;
        }
      }
      before = left;
    }
    EXPECT_GT(in_both, 300) << level;
    EXPECT_GT(followed, 300) << level;
    EXPECT_EQ(linked > in_both * 7 / 10, by_masks) << linked << " of " << in_both;
    if (by_masks) {
      EXPECT_GT(kept, followed * 9 / 10) << "corners may be on a neighbour of the same class";
    } else {
      EXPECT_EQ(linked, 0);
      EXPECT_GT(kept, followed / 2);
    }
  }
}

TEST(Perception, ErrorsGrowFromLevelToLevel) {
  FeatureOptions options = clean(Traffic::kJam);
  options.labelled = true;
  options.features = 200;
  const FeatureWorld world(drive(), options);
  double last_recall = 1.01, last_false = -0.01;
  for (const char* name : {"exact", "estimated", "poor"}) {
    Perception detector(world, perception_level(name), 1);
    for (std::size_t i = 0; i < 160; ++i) {
      FeatureFrame f = world.frame(i);
      detector.add_priors(i, f);
    }
    const auto share = [](std::int64_t a, std::int64_t b) {
      return static_cast<double>(a) / static_cast<double>(b);
    };
    const double recall = share(detector.score().moving_flagged, detector.score().moving);
    const double wrong = share(detector.score().still_flagged, detector.score().still);
    EXPECT_LT(recall, last_recall) << name;
    EXPECT_GT(wrong, last_false) << name;
    last_recall = recall;
    last_false = wrong;
  }
  EXPECT_THROW(perception_level("good"), InputError);
}

class TrafficFile : public testing::Test {
 protected:
  TrafficFile() : scratch_("trafficfile"), path_(scratch_ / "a.features") { write(path_); }
  void write(const std::filesystem::path& path) {
    FeatureOptions options = clean(Traffic::kCity);
    options.features = 80;
    options.labelled = true;
    FeaturePath shorter = drive();
    shorter.poses.resize(12);
    world_ = std::make_unique<FeatureWorld>(shorter, options);
    FeatureFileInfo info = world_->info();
    info.label_space = kFeatureLabelSpace;
    FeatureSequenceWriter writer(path, info, world_->truth());
    Perception detector(*world_, perception_level("poor"), 1);
    frames_.clear();
    for (std::size_t i = 0; i < 12; ++i) {
      frames_.push_back(world_->frame(i));
      detector.add_priors(i, frames_.back());
      writer.write(frames_.back());
    }
    writer.finish();
  }
  ScratchFolder scratch_;
  std::filesystem::path path_;
  std::unique_ptr<FeatureWorld> world_;
  std::vector<FeatureFrame> frames_;
};

TEST_F(TrafficFile, ReadsBackWhatWasWritten) {
  FeatureSequence sequence(path_);
  EXPECT_EQ(sequence.info().version, 2);
  EXPECT_EQ(sequence.info().label_space, "coco_panoptic_133");
  for (const FeatureFrame& expected : frames_) {
    const auto frame = sequence.next();
    ASSERT_TRUE(frame.has_value());
    EXPECT_EQ(frame->left_features->descriptors, expected.left.descriptors);
    EXPECT_EQ(frame->right_features->descriptors, expected.right.descriptors);
    EXPECT_EQ(sequence.left_landmarks(), expected.left_landmarks);
    EXPECT_EQ(sequence.mover_share(), expected.mover_share);
    ASSERT_EQ(frame->has_priors, expected.has_priors);
    ASSERT_EQ(frame->left_priors.size(), expected.left_priors.size());
    for (std::size_t k = 0; k < expected.left_priors.size(); ++k) {
      const kys::Prior& a = frame->left_priors[k];
      const kys::Prior& b = expected.left_priors[k];
      EXPECT_EQ(a.label, b.label);
      EXPECT_EQ(a.instance, b.instance);
      EXPECT_EQ(a.scale, b.scale);
      EXPECT_EQ(a.dynamic, b.dynamic);
      EXPECT_NEAR(a.log_motion, b.log_motion, 0.0092) << "half a step of ln(1 + mu)";
    }
    for (std::size_t k = 0; k < expected.right.size(); ++k) {
      EXPECT_NEAR(frame->right_features->keypoints[k].x, expected.right.keypoints[k].x, 1.01 / 64);
    }
  }
  EXPECT_FALSE(sequence.next().has_value());
  const FeatureTruth truth = sequence.truth();
  ASSERT_EQ(truth.objects.size(), world_->objects().size());
  ASSERT_EQ(truth.landmarks.size(), world_->landmark_count());
  EXPECT_EQ(encode_truth(truth), encode_truth(world_->truth()));
}

TEST_F(TrafficFile, PartOfASequence) {
  FeatureSequence sequence(path_, 7, 2);
  const auto frame = sequence.next();
  EXPECT_EQ(frame->index, 7);
  EXPECT_EQ(frame->left_features->descriptors, frames_[7].left.descriptors);
}

TEST_F(TrafficFile, LabelsOutsideOfTheLabelSpaceAreRefused) {
  const auto read = [&](const std::string& space, std::uint16_t label) {
    FeatureFileInfo info = world_->info();
    info.label_space = space;
    FeatureSequenceWriter writer(scratch_ / "labels.features", info, world_->truth());
    std::vector<FeatureFrame> frames = frames_;
    kys::Prior& prior = frames[3].right_priors[0];
    prior = kys::make_prior(label, 70000, prior.scale, 0, false);
    for (const FeatureFrame& frame : frames) writer.write(frame);
    writer.finish();
    FeatureSequence sequence(scratch_ / "labels.features");
    try {
      for (int i = 0; i < 4; ++i) (void)sequence.next();
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_EQ(read(kFeatureLabelSpace, 132), "");
  EXPECT_NE(read(kFeatureLabelSpace, 133).find("labels.features: frame 3: label 133 is not in"),
            std::string::npos);
  EXPECT_NE(read("no_such_space", 2).find("labels.features: "), std::string::npos);
}

TEST_F(TrafficFile, SameBytesAgain) {
  write(scratch_ / "b.features");
  EXPECT_EQ(read_all(path_), read_all(scratch_ / "b.features"));
}

TEST_F(TrafficFile, DamageIsNoticed) {
  const std::string bytes = read_all(path_);
  const auto expect_refused = [&](const std::string& damaged) {
    std::ofstream(scratch_ / "bad", std::ios::binary) << damaged;
    try {
      FeatureSequence sequence(scratch_ / "bad");
      while (sequence.next()) {
      }
      (void)sequence.truth();
      ADD_FAILURE() << "accepted";
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find("bad"), std::string::npos);
    }
  };
  for (const std::size_t cut : {100UL, 143UL, 200UL, 960UL, bytes.size() / 2, bytes.size() - 1}) {
    expect_refused(bytes.substr(0, cut));
  }
  for (std::size_t at = 0; at < bytes.size(); at += 1 + bytes.size() / 97) {
    std::string bad = bytes;
    bad[at] = static_cast<char>(bad[at] ^ 0x10);
    expect_refused(bad);
  }
}

TEST(FeaturePayload, DamagedPayloadsAreRefusedOrRead) {
  // Without the checksum: whatever bytes, never a crash.
  FeatureFrame frame = jam().frame(3);
  frame.left_priors.assign(frame.left.size(), kys::Prior{});
  frame.right_priors.assign(frame.right.size(), kys::Prior{});
  frame.has_priors = true;
  const std::vector<std::uint8_t> good = encode_frame(frame, 1);
  EXPECT_EQ(encode_frame(decode_frame(good, 1), 1), good);
  int refused = 0;
  for (std::size_t at = 0; at < good.size(); at += 1 + good.size() / 400) {
    std::vector<std::uint8_t> bad = good;
    bad[at] ^= 0x81;
    try {
      (void)decode_frame(bad, 1);
    } catch (const std::runtime_error&) {
      ++refused;
    }
    bad.resize(at);
    EXPECT_THROW((void)decode_frame(bad, 1), std::runtime_error);
  }
  EXPECT_GT(refused, 5);
  const std::vector<std::uint8_t> packed = deflate(good);
  EXPECT_EQ(inflate(packed, good.size()), good);
  EXPECT_THROW(inflate(packed, good.size() + 1), std::runtime_error);
  EXPECT_THROW(inflate(packed, std::size_t{1} << 60), std::runtime_error);
}

}  // namespace
}  // namespace kys_slam::simulator
