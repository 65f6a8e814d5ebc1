// SPDX-License-Identifier: BSD-3-Clause
#include "motion/object_tracks.h"

#include <gtest/gtest.h>
#include <kys_slam/error.h>

#include <cmath>
#include <map>
#include <random>
#include <set>

namespace kys_slam {
namespace {

constexpr double kStep = 0.1;  // s

/// A camera that drives along z at 8 m/s and turns slowly.
Rigid3 camera_at(int frame) {
  const double t = kStep * frame;
  return {so3_exp({0, 0.05 * t, 0}), Eigen::Vector3d(0.1 * t, 0, 8 * t)};
}

/// An object that goes at a velocity, seen with noise of `sigma` on its velocity.
struct SimulatedObject {
  std::int32_t instance = 70000;
  std::uint16_t label = 2;
  Eigen::Vector3d start{2, 1, 15};
  Eigen::Vector3d velocity{0.5, 0, 9};
  double sigma = 0.3;

  [[nodiscard]] Eigen::Vector3d at(int frame) const { return start + kStep * frame * velocity; }
};

ObjectObservation seen(const SimulatedObject& object, int frame, std::mt19937& random,
                       const Eigen::Vector3d& velocity) {
  std::normal_distribution<double> noise(0, 1);
  const Eigen::Matrix3d R_c_w = camera_at(frame).R().transpose();
  const auto draw = [&](double sigma) {
    return Eigen::Vector3d(sigma * noise(random), sigma * noise(random), sigma * noise(random));
  };
  ObjectObservation o;
  o.instance = object.instance;
  o.label = object.label;
  o.p_moving = 0.9;
  o.keypoints = 40;
  o.place = {camera_at(frame).inverse() * object.at(frame) + draw(0.2),
             Eigen::Matrix3d::Identity() * 0.04};
  ObservedVelocity v;
  v.velocity_c = R_c_w * velocity + draw(object.sigma);
  v.covariance = Eigen::Matrix3d::Identity() * object.sigma * object.sigma;
  v.span = kStep;
  o.velocity = v;
  return o;
}

std::vector<ObjectFrame> empty_frames(int count) {
  std::vector<ObjectFrame> frames(static_cast<std::size_t>(count));
  for (int k = 0; k < count; ++k) {
    frames[static_cast<std::size_t>(k)].taken = kStep * k;
    frames[static_cast<std::size_t>(k)].T_w_c = camera_at(k);
  }
  return frames;
}

/// What a frame shows of its first object has no place and no velocity.
void doubt(ObjectFrame& frame) {
  ObjectObservation& seen = frame.observations[0];
  seen.doubtful = true;
  seen.place.reset();
  seen.velocity.reset();
}

std::vector<ObjectFrame> film(const std::vector<SimulatedObject>& objects, int count,
                              unsigned seed = 1) {
  std::mt19937 random(seed);
  std::vector<ObjectFrame> frames = empty_frames(count);
  for (int k = 0; k < count; ++k) {
    for (const SimulatedObject& object : objects) {
      frames[static_cast<std::size_t>(k)].observations.push_back(
          seen(object, k, random, object.velocity));
    }
  }
  return frames;
}

TEST(ObjectTracks, VelocityAndPositionAreThoseOfTheObject) {
  const SimulatedObject object;
  const auto estimates = track_objects(film({object}, 40));
  ASSERT_EQ(estimates.size(), 40u);
  for (const ObjectEstimate& e : estimates) {
    EXPECT_EQ(e.instance, object.instance);
    EXPECT_EQ(e.keypoints, 40);
    // One velocity is known to 0.3 m/s; forty of them of an object that hardly accelerates to less.
    EXPECT_LT((e.velocity - object.velocity).norm(), 0.6);
    EXPECT_LT((e.position - object.at(static_cast<int>(e.frame))).norm(), 0.6);
    EXPECT_GT(e.velocity_covariance.trace(), 0);
  }
}

TEST(ObjectTracks, CovarianceOfTheVelocityIsHonest) {
  double sum = 0;
  int count = 0;
  for (unsigned seed = 1; seed <= 60; ++seed) {
    const SimulatedObject object;
    // Constant velocity is less than the model allows: the covariance may be too large, not small.
    for (const ObjectEstimate& e : track_objects(film({object}, 20, seed))) {
      const Eigen::Vector3d error = e.velocity - object.velocity;
      sum += error.dot(e.velocity_covariance.inverse() * error) / 3;
      ++count;
    }
  }
  EXPECT_GT(sum / count, 0.2);
  EXPECT_LT(sum / count, 1.1);
}

TEST(ObjectTracks, FollowsAThingThatBrakes) {
  std::mt19937 random(3);
  SimulatedObject object;
  object.sigma = 0.1;
  std::vector<ObjectFrame> frames = empty_frames(40);
  const auto speed = [](double t) { return std::max(0.0, 9.0 - 3.0 * std::max(0.0, t - 1)); };
  double z = 15;
  std::vector<double> places;
  for (int k = 0; k < 40; ++k) {
    places.push_back(z);
    SimulatedObject now = object;
    now.start = {2, 1, z};
    now.velocity.setZero();
    ObjectObservation o = seen(now, k, random, {0, 0, speed(kStep * (k - 0.5))});
    frames[static_cast<std::size_t>(k)].observations.push_back(o);
    z += kStep * speed(kStep * (k + 0.5));
  }
  const auto estimates = track_objects(frames);
  ASSERT_EQ(estimates.size(), 40u);
  for (const ObjectEstimate& e : estimates) {
    const double t = kStep * static_cast<double>(e.frame);
    EXPECT_NEAR(e.velocity.z(), speed(t), 0.45) << t;
    EXPECT_NEAR(e.position.z(), places[static_cast<std::size_t>(e.frame)], 0.6) << t;
  }
}

// The velocity over a long span is that of its middle: half a second late it would lag by 1 m/s
// where the speed changes by 4 m/s in every second.
TEST(ObjectTracks, VelocityOverASpanBelongsToItsMiddle) {
  std::vector<ObjectFrame> frames = empty_frames(40);
  for (int k = 5; k < 40; ++k) {
    const double t = kStep * k;
    const auto place = [](double s) { return 15 + 2.0 * s * s; };  // 4 m/s^2
    ObjectObservation o;
    o.instance = 70001;
    o.label = 2;
    o.p_moving = 1;
    o.keypoints = 40;
    o.place = {camera_at(k).inverse() * Eigen::Vector3d(2, 1, place(t)),
               Eigen::Matrix3d::Identity() * 0.01};
    ObservedVelocity v;
    v.span = 0.5;
    v.velocity_c =
        camera_at(k).R().transpose() * Eigen::Vector3d(0, 0, (place(t) - place(t - 0.5)) / 0.5);
    v.covariance = Eigen::Matrix3d::Identity() * 0.01;
    o.velocity = v;
    frames[static_cast<std::size_t>(k)].observations.push_back(o);
  }
  for (const ObjectEstimate& e : track_objects(frames)) {
    const double t = kStep * static_cast<double>(e.frame);
    if (t < 1.0 || t > 3.3) continue;  // at the ends there is less to go by
    EXPECT_NEAR(e.velocity.z(), 4 * t, 0.25) << t;
  }
}

TEST(ObjectTracks, IdentityOutlivesNewNamesAndGaps) {
  const SimulatedObject object;
  std::vector<ObjectFrame> frames = film({object}, 40);
  for (std::size_t k = 10; k < 40; ++k) frames[k].observations[0].instance = 70055;
  for (std::size_t k = 20; k < 26; ++k) frames[k].observations.clear();
  frames[30].T_w_c.reset();
  const auto estimates = track_objects(frames);
  EXPECT_EQ(estimates.size(), 33u);
  for (const ObjectEstimate& e : estimates) {
    EXPECT_EQ(e.instance, object.instance);
    EXPECT_NE(e.frame, 30);
  }
}

TEST(ObjectTracks, AfterALongGapItIsANewThingUnlessNamedTheSame) {
  const SimulatedObject object;
  std::vector<ObjectFrame> frames = film({object}, 60);
  for (std::size_t k = 20; k < 40; ++k) frames[k].observations.clear();
  for (std::size_t k = 40; k < 60; ++k) frames[k].observations[0].instance = 70055;
  std::set<std::int32_t> names;
  for (const ObjectEstimate& e : track_objects(frames)) names.insert(e.instance);
  EXPECT_EQ(names, (std::set<std::int32_t>{70000, 70055}));
}

// The names of two objects are exchanged: places say who is who.
TEST(ObjectTracks, ExchangedNamesDoNotExchangeThings) {
  SimulatedObject left, right;
  left.start = {-6, 1, 20};
  right.start = {6, 1, 20};
  right.instance = 70001;
  std::vector<ObjectFrame> frames = film({left, right}, 30);
  for (std::size_t k = 15; k < 30; ++k) {
    std::swap(frames[k].observations[0].instance, frames[k].observations[1].instance);
  }
  for (const ObjectEstimate& e : track_objects(frames)) {
    EXPECT_EQ(e.position.x() > e.frame * kStep * 0.5, e.instance == right.instance) << e.frame;
  }
}

TEST(ObjectTracks, NoTwoThingsShareAnIdentityInAFrame) {
  SimulatedObject a, b;
  b.start = {-8, 1, 25};  // the same name as the other
  const auto estimates = track_objects(film({a, b}, 20));
  ASSERT_EQ(estimates.size(), 40u);
  std::set<std::pair<std::int64_t, std::int32_t>> keys;
  std::set<std::int32_t> names;
  for (const ObjectEstimate& e : estimates) {
    EXPECT_TRUE(keys.insert({e.frame, e.instance}).second);
    names.insert(e.instance);
  }
  EXPECT_EQ(names.size(), 2u);
}

// X is named beside Y, without a place, then stands where Y was, and jumps a frame later.
TEST(ObjectTracks, ANameThatWaitedTakesNoFramesOfTheTrackItContinues) {
  const SimulatedObject y;
  SimulatedObject x = y;
  x.instance = y.instance + 1;
  std::mt19937 random(1);
  std::vector<ObjectFrame> frames = empty_frames(20);
  for (int k = 0; k < 20; ++k) {
    auto& observations = frames[static_cast<std::size_t>(k)].observations;
    if (k < 4) observations.push_back(seen(y, k, random, y.velocity));
    if (k == 5) x.start.x() += 5;
    if (k == 0) continue;
    observations.push_back(seen(x, k, random, x.velocity));
    if (k >= 4) continue;
    observations.back().place.reset();
    observations.back().velocity.reset();
  }
  std::set<std::pair<std::int64_t, std::int32_t>> keys;
  for (const ObjectEstimate& e : track_objects(frames)) {
    EXPECT_TRUE(keys.insert({e.frame, e.instance}).second) << e.frame << " " << e.instance;
  }
  EXPECT_GE(keys.size(), 20u);
}

// Frames that only name an object are filled in, those before it is first seen well too.
TEST(ObjectTracks, NamesAloneKeepATrack) {
  const SimulatedObject object;
  std::vector<ObjectFrame> frames = film({object}, 30);
  for (const std::size_t k : {0, 1, 12, 13, 29}) {
    frames[k].observations[0].place.reset();
    frames[k].observations[0].velocity.reset();
  }
  const auto estimates = track_objects(frames);
  ASSERT_EQ(estimates.size(), 30u);
  for (const ObjectEstimate& e : estimates) {
    EXPECT_EQ(e.instance, object.instance);
    EXPECT_LT((e.velocity - object.velocity).norm(), 0.8) << e.frame;
    EXPECT_LT((e.position - object.at(static_cast<int>(e.frame))).norm(), 0.8) << e.frame;
  }
  for (ObjectFrame& frame : frames) {
    frame.observations[0].place.reset();
    frame.observations[0].velocity.reset();
  }
  EXPECT_TRUE(track_objects(frames).empty());
}

const SimulatedObject kComing{.start = {-3, 0, 40}, .velocity = {0, 0, -7}};

/// `kComing` comes into view at frame `first`. Before frame 18 the edge of what hides it is taken
/// for it, at 22.4 m at last, where the object is at 27.4 m; with `keypoints` where the object
/// has 40.
std::vector<ObjectFrame> film_behind_an_edge(std::size_t first, int keypoints) {
  const SimulatedObject edge{.start = {-1, 0, 8}, .velocity = {0, 0, 8}};
  std::vector<ObjectFrame> frames = film({kComing}, 30);
  const std::vector<ObjectFrame> before = film({edge}, 18);
  for (std::size_t k = 0; k < first; ++k) frames[k].observations.clear();
  for (std::size_t k = first; k < 18; ++k) {
    frames[k] = before[k];
    frames[k].observations[0].keypoints = keypoints;
  }
  return frames;
}

TEST(ObjectTracks, AThingThatJumpsKeepsItsIdentityAndForgetsItsMotion) {
  const auto estimates = track_objects(film_behind_an_edge(12, 40));
  ASSERT_EQ(estimates.size(), 18u);
  for (const ObjectEstimate& e : estimates) {
    EXPECT_EQ(e.instance, kComing.instance);
    EXPECT_NEAR(e.velocity.z(), e.frame < 18 ? 8 : -7, 0.8) << e.frame;
  }
}

TEST(ObjectTracks, AShortPoorPartTakesTheMotionOfTheRest) {
  const auto estimates = track_objects(film_behind_an_edge(14, 15));  // for 0.3 s
  ASSERT_EQ(estimates.size(), 16u);
  for (const ObjectEstimate& e : estimates) {
    EXPECT_EQ(e.instance, kComing.instance);
    EXPECT_NEAR(e.velocity.z(), -7, 0.8) << e.frame;
    EXPECT_LT((e.position - kComing.at(static_cast<int>(e.frame))).norm(), 0.8) << e.frame;
  }
  // As many keypoints, or for too long: both parts are believed.
  EXPECT_NEAR(track_objects(film_behind_an_edge(14, 40)).front().velocity.z(), 8, 0.8);
  EXPECT_NEAR(track_objects(film_behind_an_edge(10, 15)).front().velocity.z(), 8, 0.8);
}

// One or two observations elsewhere are passed over, whether near or far; three are a restart.
TEST(ObjectTracks, AMomentElsewhereIsPassedOver) {
  const SimulatedObject object;
  for (const double away : {5.0, 20.0}) {
    std::vector<ObjectFrame> frames = film({object}, 30);
    const auto move = [&](std::size_t k) {
      const Eigen::Matrix3d R_c_w = frames[k].T_w_c->R().transpose();
      frames[k].observations[0].place->centre_c += R_c_w * Eigen::Vector3d(0, 0, away);
    };
    move(10);
    move(11);
    const auto estimates = track_objects(frames);
    ASSERT_EQ(estimates.size(), 30u) << away;
    for (const ObjectEstimate& e : estimates) {
      EXPECT_EQ(e.instance, object.instance);
      EXPECT_LT((e.velocity - object.velocity).norm(), 0.8) << e.frame;
      EXPECT_LT((e.position - object.at(static_cast<int>(e.frame))).norm(), 0.8) << e.frame;
    }
    for (std::size_t k = 12; k < 30; ++k) move(k);
    const auto moved = track_objects(frames);
    ASSERT_EQ(moved.size(), 30u) << away;
    EXPECT_EQ(moved.back().instance == object.instance, away < ObjectTrackOptions{}.restart_gate);
    EXPECT_NEAR(moved.back().position.z(), object.at(29).z() + away, 0.8);
    EXPECT_NEAR(moved[10].position.z(), object.at(10).z() + away, 0.8) << "from the first one on";
  }
}

TEST(ObjectTracks, WrongObservationsAtItsStartDoNotBendATrack) {
  // The edge of what hides the object gives way to it: four observations go over from one motion to
  // the other, near enough to each other that nothing restarts.
  std::vector<ObjectFrame> frames = film({kComing}, 30);
  for (std::size_t k = 0; k < 16; ++k) frames[k].observations.clear();
  for (std::size_t k = 16; k < 20; ++k) {
    const double wrong = (20 - static_cast<double>(k)) / 4;
    ObjectObservation& seen = frames[k].observations[0];
    const Eigen::Matrix3d R_c_w = camera_at(static_cast<int>(k)).R().transpose();
    seen.place->centre_c += R_c_w * Eigen::Vector3d(0, 0, -4 * wrong);
    seen.velocity->velocity_c += R_c_w * Eigen::Vector3d(0, 0, 12 * wrong);
  }
  const auto estimates = track_objects(frames);
  ASSERT_EQ(estimates.size(), 14u);
  for (const ObjectEstimate& e : estimates) {
    EXPECT_NEAR(e.velocity.z(), -7, 1.5) << e.frame;
    EXPECT_LT((e.position - kComing.at(static_cast<int>(e.frame))).norm(), 1) << e.frame;
  }
}

TEST(ObjectTracks, APoorPartFarFromTheRestKeepsTheName) {
  std::vector<ObjectFrame> frames = film_behind_an_edge(14, 15);
  const auto move_away = [&] {  // too far for a restart
    for (std::size_t k = 14; k < 18; ++k) frames[k].observations[0].place->centre_c.z() -= 10;
  };
  move_away();
  for (const ObjectEstimate& e : track_objects(frames)) {
    EXPECT_EQ(e.instance, kComing.instance) << e.frame;
    EXPECT_NEAR(e.velocity.z(), -7, 0.8) << e.frame;
  }
  // With as many keypoints both parts are believed: two objects.
  frames = film_behind_an_edge(14, 40);
  move_away();
  EXPECT_NE(track_objects(frames).back().instance, kComing.instance);
}

TEST(ObjectTracks, WhatIsUnlikelyCountsBetweenWhatIsLikelyOnly) {
  const SimulatedObject object;
  std::vector<ObjectFrame> frames = film({object}, 20);
  for (const std::size_t k : {0u, 1u, 2u, 9u, 10u, 18u, 19u}) {
    doubt(frames[k]);
    frames[k].observations[0].unlikely = true;
  }
  const auto estimates = track_objects(frames);
  ASSERT_EQ(estimates.size(), 15u);
  EXPECT_EQ(estimates.front().frame, 3);
  EXPECT_EQ(estimates.back().frame, 17);
}

TEST(ObjectTracks, WhatIsUnlikelyAtARestartIsNoGap) {
  std::vector<ObjectFrame> frames = film_behind_an_edge(8, 40);
  for (const std::size_t k : {16u, 17u}) {
    doubt(frames[k]);
    frames[k].observations[0].unlikely = true;
  }
  const auto estimates = track_objects(frames);
  ASSERT_EQ(estimates.size(), 22u);
  for (std::size_t i = 0; i < estimates.size(); ++i) {
    EXPECT_EQ(estimates[i].frame, static_cast<std::int64_t>(8 + i));
    EXPECT_EQ(estimates[i].instance, kComing.instance);
  }
}

TEST(ObjectTracks, DoubtfulObservationsContinueATrackOnly) {
  const SimulatedObject object;
  std::vector<ObjectFrame> frames = film({object}, 30);
  const auto doubt_from = [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) doubt(frames[k]);
  };
  doubt_from(0, 9);
  doubt_from(22, 30);
  const auto estimates = track_objects(frames);
  // Frames 9 to 21, and 0.5 s before and after.
  ASSERT_EQ(estimates.size(), 23u);
  EXPECT_EQ(estimates.front().frame, 4);
  EXPECT_EQ(estimates.back().frame, 26);
  for (const ObjectEstimate& e : estimates) {
    EXPECT_LT((e.position - object.at(static_cast<int>(e.frame))).norm(), 0.8) << e.frame;
  }
  doubt_from(11, 22);  // two are left
  EXPECT_TRUE(track_objects(frames).empty());
}

TEST(ObjectTracks, ShortTracksAreDropped) {
  EXPECT_TRUE(track_objects(film({SimulatedObject{}}, 2)).empty());
  EXPECT_TRUE(track_objects({}).empty());
  ObjectTrackOptions options;
  options.gate = 0;
  EXPECT_THROW(track_objects({}, options), InputError);
}

TEST(ObjectTracks, EverythingMovesWithTheWorld) {
  const std::vector<ObjectFrame> frames = film({SimulatedObject{}}, 20);
  const Rigid3 T_v_w(so3_exp({0.3, -1.1, 0.4}), Eigen::Vector3d(100, -20, 7));
  std::vector<ObjectFrame> moved = frames;
  for (ObjectFrame& frame : moved) frame.T_w_c = T_v_w * *frame.T_w_c;
  const auto before = track_objects(frames), after = track_objects(moved);
  ASSERT_EQ(before.size(), after.size());
  for (std::size_t i = 0; i < before.size(); ++i) {
    EXPECT_LT((after[i].position - T_v_w * before[i].position).norm(), 1e-5);
    EXPECT_LT((after[i].velocity - T_v_w.rotation * before[i].velocity).norm(), 1e-5);
  }
}

}  // namespace
}  // namespace kys_slam
