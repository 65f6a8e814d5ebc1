// SPDX-License-Identifier: BSD-3-Clause
#include "map/change_set.h"

#include <gtest/gtest.h>

#include <map>

#include "map/map.h"
#include "map/replica.h"
#include "support/map_builder.h"

namespace kys_slam {
namespace {

using testing::make_keyframe;
using testing::make_landmark;
using testing::random_features;

/// A long random life of a map: every kind of edit the back end knows, in any order.
class RandomEditor {
 public:
  explicit RandomEditor(unsigned seed)
      : random_(seed), map_(testing::kitti_camera(), ScaleLevels(1.2, 8)) {
    for (int i = 0; i < 4; ++i) add_keyframe();
    for (int i = 0; i < 60; ++i) add_landmark();
  }

  Map& map() { return map_; }
  [[nodiscard]] std::uint32_t keyframes_made() const { return next_keyframe_; }
  [[nodiscard]] std::uint32_t landmarks_made() const { return next_landmark_; }

  void edit() {
    switch (random_() % 17) {
      case 0:
        if (map_.keyframes().size() < 25) add_keyframe();
        break;
      case 1:
        if (map_.keyframes().size() > 6) map_.cull_keyframe(any_keyframe());
        break;
      case 2:
      case 3:
      case 4:
        add_landmark();
        break;
      case 5:
      case 6:
      case 7:
      case 8:
        observe(any_landmark());
        break;
      case 9:
        unobserve();
        break;
      case 10:
        map_.erase_landmark(any_landmark());
        break;
      case 11:
        map_.replace_landmark(any_landmark(), any_landmark());
        break;
      case 12:
        map_.set_pose(any_keyframe(), random_pose());
        break;
      case 13:
        map_.set_position(any_landmark(), random_point());
        break;
      case 14:
        map_.refresh_landmark(any_landmark());
        break;
      case 15:
        if (random_() % 10 == 0) {
          const double offset = 0.05 * static_cast<double>(random_() % 10);
          map_.set_rig(RigCorrection::of_offset(map_.camera(), offset));
        } else if (random_() % 3 == 0) {
          const KeyFrameId a = any_keyframe();
          const KeyFrameId b = any_keyframe();
          if (a != b) map_.add_loop_edge(a, b);
        } else {
          map_.refresh_geometry(any_landmark());
        }
        break;
      case 16:
        if (random_() % 10 == 0) map_.thin_keyframe(any_keyframe());
        break;
    }
    while (map_.landmarks().size() < 10) add_landmark();
  }

 private:
  template <typename Ids>
  auto any_of(const Ids& ids) {
    return ids[random_() % ids.size()];
  }
  KeyFrameId any_keyframe() { return any_of(map_.keyframes().ids()); }
  LandmarkId any_landmark() { return any_of(map_.landmarks().ids()); }
  double unit() { return std::uniform_real_distribution<double>(-1, 1)(random_); }
  Rigid3 random_pose() {
    return {so3_exp({unit(), unit(), unit()}), Eigen::Vector3d(unit(), unit(), unit())};
  }
  Eigen::Vector3d random_point() { return 20 * Eigen::Vector3d(unit(), unit(), unit()); }

  void add_keyframe() {
    const std::uint32_t id = next_keyframe_++;
    const auto all = map_.keyframes().ids();
    map_.add_keyframe(make_keyframe(id, random_features(map_.camera(), 40, id), random_pose()));
    if (all.empty()) return;
    const auto landmarks = map_.landmarks().ids();
    for (int i = 0; i < 15 && !landmarks.empty(); ++i) {
      see(any_of(landmarks), {id}, static_cast<std::uint32_t>(random_() % 40));
    }
    map_.connect_to_spanning_tree({id}, any_of(all));
  }
  void add_landmark() {
    const LandmarkId id{next_landmark_++};
    map_.add_landmark(make_landmark(id.value, random_point()));
    // A landmark always has an observation; its features may be taken, so every one is tried.
    for (std::uint32_t feature = 0; feature < 40; ++feature) {
      if (see(id, any_keyframe(), feature)) break;
    }
    if (map_.landmark(id).observations.empty()) {
      map_.erase_landmark(id);
      return;
    }
    observe(id);
    observe(id);
    map_.refresh_landmark(id);
  }
  void observe(LandmarkId id) {
    see(id, any_keyframe(), static_cast<std::uint32_t>(random_() % 40));
  }
  /// Thin keyframes have fewer features.
  bool see(LandmarkId id, KeyFrameId keyframe, std::uint32_t feature) {
    return feature < map_.keyframe(keyframe).landmarks.size() &&
           map_.add_observation(id, keyframe, feature);
  }
  void unobserve() {
    const Landmark& landmark = map_.landmark(any_landmark());
    map_.remove_observation(landmark.id, any_of(landmark.observations).keyframe);
  }

  std::mt19937_64 random_;
  Map map_;
  std::uint32_t next_keyframe_ = 0;
  std::uint32_t next_landmark_ = 0;
};

void expect_same_keyframe(const KeyFrameView& a, const KeyFrameView& b, std::uint32_t id) {
  EXPECT_EQ(a.T_c_w.rotation.coeffs(), b.T_c_w.rotation.coeffs()) << "keyframe " << id;
  EXPECT_EQ(a.T_c_w.translation, b.T_c_w.translation) << "keyframe " << id;
  EXPECT_EQ(a.features, b.features) << "keyframe " << id;
  EXPECT_EQ(a.landmarks, b.landmarks) << "keyframe " << id;
  EXPECT_EQ(a.neighbours, b.neighbours) << "keyframe " << id;
  EXPECT_EQ(a.parent, b.parent) << "keyframe " << id;
  EXPECT_EQ(a.children, b.children) << "keyframe " << id;
}

/// The replica holds the same objects as the map, each as Map::view shows it, and ids that are gone
/// lead to the same place.
void expect_equal(const Replica& replica, const Map& map, const RandomEditor& editor) {
  ASSERT_EQ(replica.landmarks().ids(), map.landmarks().ids());
  ASSERT_EQ(replica.keyframes().ids(), map.keyframes().ids());
  for (const LandmarkId id : map.landmarks().ids()) {
    EXPECT_EQ(replica.landmarks().at(id), map.view(id)) << "landmark " << id.value;
  }
  for (const KeyFrameId id : map.keyframes().ids()) {
    expect_same_keyframe(replica.keyframes().at(id), map.view(id), id.value);
  }
  for (std::uint32_t i = 0; i < editor.landmarks_made(); ++i) {
    EXPECT_EQ(replica.resolve(LandmarkId{i}), map.resolve(LandmarkId{i})) << "landmark " << i;
  }
  for (std::uint32_t i = 0; i < editor.keyframes_made(); ++i) {
    const Replica::Anchor anchor = replica.resolve(KeyFrameId{i});
    ASSERT_TRUE(map.has(anchor.keyframe));
    const Rigid3 pose = anchor.T_c_k * replica.keyframes().at(anchor.keyframe).T_c_w;
    EXPECT_LT(minus(pose, *map.pose(KeyFrameId{i})).norm(), 1e-9) << "keyframe " << i;
  }
}

TEST(ChangeSet, ReplicaEqualsTheMapAfterEveryChangeSetOfManyRandomChanges) {
  for (unsigned seed = 1; seed <= 3; ++seed) {
    RandomEditor editor(seed);
    Replica replica;
    std::mt19937 random(seed + 100);
    for (int step = 0; step < 60; ++step) {
      const int edits = static_cast<int>(random() % 60);
      for (int i = 0; i < edits; ++i) editor.edit();
      ASSERT_NO_THROW(editor.map().check_consistency()) << "seed " << seed << " step " << step;
      replica.apply(editor.map().take_changes());
      expect_equal(replica, editor.map(), editor);
      if (HasFailure()) FAIL() << "seed " << seed << " step " << step;
    }
  }
}

TEST(ChangeSet, OneLargeChangeSetEqualsManySmallOnes) {
  RandomEditor editor(11);
  Replica often;
  ChangeSet all;
  for (int step = 0; step < 1500; ++step) {
    editor.edit();
    if (step % 7 == 0) often.apply(editor.map().take_changes());
  }
  often.apply(editor.map().take_changes());
  expect_equal(often, editor.map(), editor);

  // The same life again, taken in at its end alone.
  RandomEditor again(11);
  for (int step = 0; step < 1500; ++step) again.edit();
  Replica once;
  once.apply(again.map().take_changes());
  expect_equal(once, again.map(), again);
  for (const LandmarkId id : once.landmarks().ids()) {
    EXPECT_EQ(once.landmarks().at(id), often.landmarks().at(id));
  }
}

TEST(ChangeSet, KeyframesUnderWayFollowWhenTheMapMoves) {
  const auto at = [](double x) { return Rigid3(Eigen::Quaterniond::Identity(), {-x, 0, 0}); };
  const auto landmark = [](double x, std::uint32_t observer) {
    LandmarkView view;
    view.p_w = {x, 0, 5};
    view.normal = {0, 0, 1};
    view.observers = {KeyFrameId{observer}};
    return view;
  };
  for (const bool moved : {false, true}) {
    Replica replica;
    ChangeSet known;
    known.keyframes.emplace_back(KeyFrameId{1}, KeyFrameView{at(1), {}, {}, {}, {}, {}, {}});
    replica.apply(known);
    // Two of the tracker's own, one on the other, each with a landmark of its own.
    for (const std::uint32_t id : {2u, 3u}) {
      replica.put(LandmarkId{id}, landmark(id, id));
      std::vector<LandmarkId> seen{{1}, {2}};
      if (id == 3) seen.push_back({3});
      replica.put_pending(KeyFrameId{id}, {at(id), {}, seen, {}, {id - 1}, {}, {}});
    }
    ChangeSet closed;
    closed.moved = moved;
    // The world turns by a quarter about y, and keyframe 1 comes to (0, 0, 10).
    Rigid3 T_new_old(so3_exp({0, M_PI / 2, 0}), {0, 0, 0});
    T_new_old.translation = Eigen::Vector3d(0, 0, 10) - T_new_old * Eigen::Vector3d(1, 0, 0);
    KeyFrameView corrected{at(1) * T_new_old.inverse(), {}, {}, {}, {}, {}, KeyFrameId{7}};
    closed.keyframes.emplace_back(KeyFrameId{1}, corrected);
    replica.apply(closed);
    for (const std::uint32_t id : {2u, 3u}) {
      const Rigid3 T = moved ? T_new_old : Rigid3();
      const Eigen::Vector3d x(id, 0, 0);
      const KeyFrameView& view = replica.keyframes().at(KeyFrameId{id});
      EXPECT_LT((view.T_c_w.inverse_t() - T * x).norm(), 1e-9) << id;
      const LandmarkView& seen = replica.landmarks().at(LandmarkId{id});
      EXPECT_LT((seen.p_w - T * Eigen::Vector3d(id, 0, 5)).norm(), 1e-9) << id;
      EXPECT_LT((seen.normal - (T.R() * Eigen::Vector3d::UnitZ()).cast<float>()).norm(), 1e-6f);
      EXPECT_EQ(view.submap, moved ? KeyFrameId{7} : KeyFrameId{}) << id;
    }
    // Once it has come, a keyframe is where the map has it.
    ChangeSet came;
    came.moved = true;
    came.keyframes.emplace_back(KeyFrameId{2}, KeyFrameView{at(20), {}, {}, {}, {1}, {}, {}});
    replica.apply(came);
    EXPECT_NEAR(replica.keyframes().at(KeyFrameId{2}).T_c_w.inverse_t().x(), 20, 1e-9);
    const Rigid3 T_3_2 = replica.keyframes().at(KeyFrameId{3}).T_c_w * at(20).inverse();
    EXPECT_NEAR(T_3_2.inverse_t().x(), 1, 1e-9);
  }
}

TEST(ChangeSet, KeyframesUnderWayTakeTheNewScale) {
  const auto at = [](double x) { return Rigid3(Eigen::Quaterniond::Identity(), {-x, 0, 0}); };
  Replica replica;
  ChangeSet known;
  known.keyframes.emplace_back(KeyFrameId{1}, KeyFrameView{at(10), {}, {}, {}, {}, {}, {}});
  replica.apply(known);
  replica.put_pending(KeyFrameId{2}, {at(12), {}, {}, {}, {1}, {}, {}});
  ChangeSet larger;
  larger.moved = true;
  larger.scale = 1.1;
  larger.keyframes.emplace_back(KeyFrameId{1}, KeyFrameView{at(11), {}, {}, {}, {}, {}, {}});
  replica.apply(larger);
  EXPECT_NEAR(replica.keyframes().at(KeyFrameId{2}).T_c_w.inverse_t().x(), 13.2, 1e-9);
  EXPECT_EQ(replica.scale(), 1.1);
}

TEST(ChangeSet, NothingChangedMeansAnEmptyOne) {
  RandomEditor editor(4);
  (void)editor.map().take_changes();
  const ChangeSet changes = editor.map().take_changes();
  EXPECT_TRUE(changes.landmarks.empty());
  EXPECT_TRUE(changes.moved_landmarks.empty());
  EXPECT_TRUE(changes.erased_landmarks.empty());
  EXPECT_TRUE(changes.replaced.empty());
  EXPECT_TRUE(changes.keyframes.empty());
  EXPECT_TRUE(changes.culled_keyframes.empty());
}

TEST(ChangeSet, OfLandmarksThatOnlyMovedItHasTheGeometryAlone) {
  RandomEditor editor(4);
  Map& map = editor.map();
  Replica replica;
  replica.apply(map.take_changes());
  const std::vector<LandmarkId> ids = map.landmarks().ids();
  map.set_position(ids[3], {1, 2, 30});
  map.refresh_geometry(ids[3]);
  map.set_position(ids[5], {1, 3, 20});
  map.refresh_landmark(ids[5]);
  const ChangeSet changes = map.take_changes();
  ASSERT_EQ(changes.moved_landmarks.size(), 1u);
  EXPECT_EQ(changes.moved_landmarks[0].first, ids[3]);
  ASSERT_EQ(changes.landmarks.size(), 1u);
  EXPECT_EQ(changes.landmarks[0].first, ids[5]);
  replica.apply(changes);
  expect_equal(replica, map, editor);
}

TEST(Map, CovisibilityEqualsARecountAfterManyRandomChanges) {
  RandomEditor editor(21);
  for (int step = 0; step < 3000; ++step) editor.edit();
  const Map& map = editor.map();
  std::map<std::pair<KeyFrameId, KeyFrameId>, int> shared;
  map.landmarks().for_each([&](LandmarkId, const Landmark& landmark) {
    for (const Observation& a : landmark.observations) {
      for (const Observation& b : landmark.observations) {
        if (a.keyframe != b.keyframe) ++shared[{a.keyframe, b.keyframe}];
      }
    }
  });
  std::map<std::pair<KeyFrameId, KeyFrameId>, int> counted;
  map.keyframes().for_each([&](KeyFrameId id, const KeyFrame& keyframe) {
    for (const Covisible& c : keyframe.covisible) counted[{id, c.keyframe}] = c.weight;
  });
  EXPECT_EQ(counted, shared);
  EXPECT_GT(shared.size(), 20u);
  // One tree: every keyframe reaches the root.
  std::size_t roots = 0;
  map.keyframes().for_each(
      [&](KeyFrameId, const KeyFrame& k) { roots += k.parent.valid() ? 0 : 1; });
  EXPECT_EQ(roots, 1u);
}

}  // namespace
}  // namespace kys_slam
