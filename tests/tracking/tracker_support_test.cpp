// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys/kys.h>

#include <memory>
#include <string>
#include <vector>

#include "support/map_builder.h"
#include "tracking/tracker.h"

// Mode verified: poses that only things support, and sub-maps without priors.

namespace kys_slam {
namespace {

using testing::FeatureWorld;
using testing::see;
using testing::weaving_pose;

/// Features of several frames in one.
class Mixture {
 public:
  void add(const FrameFeatures& features, std::size_t k, const kys::Prior& prior) {
    add(features.keypoint(k), features.descriptor(k), features.u_right(k), prior);
  }
  void add(const FrameFeatures& features, const kys::Prior& prior) {
    for (std::size_t k = 0; k < features.size(); ++k) add(features, k, prior);
  }
  /// Another feature, `dx` px to the right of one, with the opposite descriptor.
  void add_beside(const FrameFeatures& features, std::size_t k, float dx, const kys::Prior& prior) {
    Keypoint keypoint = features.keypoint(k);
    keypoint.x += dx;
    kys::Descriptor opposite = features.descriptor(k);
    for (auto& word : opposite.words) word = ~word;
    add(keypoint, opposite, features.u_right(k) + dx, prior);
  }
  [[nodiscard]] std::shared_ptr<const FrameFeatures> features() const {
    return std::make_shared<const FrameFeatures>(testing::kitti_camera(), set_, u_right_, priors_);
  }

 private:
  void add(const Keypoint& keypoint, const kys::Descriptor& descriptor, float u_right,
           const kys::Prior& prior) {
    set_.keypoints.push_back(keypoint);
    set_.descriptors.push_back(descriptor);
    u_right_.push_back(u_right);
    priors_.push_back(prior);
  }

  FeatureSet set_;
  std::vector<float> u_right_;
  std::vector<kys::Prior> priors_;
};

class TrackerWithBeliefs : public ::testing::Test {
 protected:
  [[nodiscard]] Tracker make_tracker() const {
    return {testing::kitti_camera(), ScaleLevels(1.2, 8), TrackerOptions(), verified_,
            kys::InitialBelief({}, space_)};
  }
  [[nodiscard]] std::shared_ptr<const FrameFeatures> seen(int i, double metres) {
    return see(world_, i, weaving_pose(metres)).features;
  }
  /// What fits no other frame.
  [[nodiscard]] static std::shared_ptr<const FrameFeatures> unknown(int i, int count) {
    return testing::random_features(testing::kitti_camera(), count, static_cast<unsigned>(50 + i),
                                    1.0);
  }

  FeatureWorld world_{testing::kitti_camera(), [] {
                        FeatureWorld::Options options;
                        options.seed = 1;
                        return options;
                      }()};
  const kys::LabelSpace space_ = kys::load_label_space("coco_panoptic_133");
  const kys::DistanceModel verified_ = [this] {
    kys::ModeOptions options;
    options.mode = kys::Mode::kVerified;
    return kys::DistanceModel(options, space_);
  }();
  const kys::Prior thing_ = kys::make_prior(space_.index_of("suitcase"), 70000, 1, 0, false);
  const kys::Prior road_ = kys::make_prior(space_.index_of("road"), 1, 1, 0, false);
};

/// A thing is tracked alone, but not beside a road whose features fit no landmark: then the thing
/// may move and take the camera with it.
TEST_F(TrackerWithBeliefs, APoseThatOnlyThingsSupportIsNotUsedBesideAFixedScene) {
  for (const int others : {20, 100}) {
    Tracker tracker = make_tracker();
    TrackResult result;
    for (int i = 0; i < 2; ++i) {
      Mixture mixture;
      mixture.add(*seen(i, 0.3 * i), thing_);
      mixture.add(*unknown(i, others), road_);
      result = tracker.track({i, 0.1 * i, mixture.features()}, 0);
    }
    EXPECT_EQ(result.status == TrackingStatus::kLost, others == 100) << others << result.reason;
    EXPECT_EQ(result.reason.find("only objects") != std::string::npos, others == 100);
  }
}

/// Features of the road 2 px from those of a thing may be on the thing's edge.
TEST_F(TrackerWithBeliefs, FeaturesAtTheEdgeOfThingsDoNotSupportAPose) {
  for (const float away : {2.0f, 60.0f}) {
    Tracker tracker = make_tracker();
    TrackResult result;
    for (int i = 0; i < 2; ++i) {
      const auto world = seen(i, 0.3 * i);
      Mixture mixture;
      int count = 0;
      for (std::size_t k = 0; k < world->size() && count < 200; ++k) {
        const Keypoint& at = world->keypoint(k);
        if (at.x >= 900 || at.octave >= 2 || !world->has_stereo(k)) continue;
        mixture.add(*world, k, thing_);
        mixture.add_beside(*world, k, away, road_);
        ++count;
      }
      mixture.add(*unknown(i, 100), road_);
      result = tracker.track({i, 0.1 * i, mixture.features()}, 0);
    }
    EXPECT_EQ(result.status == TrackingStatus::kLost, away == 2) << away << result.reason;
  }
}

/// After the road has supported the pose, a thing alone holds it for half a second.
TEST_F(TrackerWithBeliefs, ThingsHoldThePoseForAShortTimeAfterTheFixedScene) {
  Tracker tracker = make_tracker();
  const auto status = [&](int i, bool road_is_known) {
    const auto world = seen(i, 0.1 * i);
    Mixture mixture;
    for (std::size_t k = 0; k < world->size(); ++k) {
      mixture.add(*world, k, road_is_known && k % 2 == 0 ? road_ : thing_);
    }
    if (!road_is_known) mixture.add(*unknown(i, 100), road_);
    return tracker.track({i, 0.1 * i, mixture.features()}, 0).status;
  };
  for (int i = 0; i < 4; ++i) ASSERT_NE(status(i, true), TrackingStatus::kLost) << i;
  for (int i = 4; i < 8; ++i) EXPECT_EQ(status(i, false), TrackingStatus::kTracked) << i;
  EXPECT_EQ(status(9, false), TrackingStatus::kLost);
}

/// A map from a frame whose priors are missing may follow a vehicle; the next frames have some.
TEST_F(TrackerWithBeliefs, AFrameWithoutPriorsStartsNoSubmapBetweenOthers) {
  Tracker tracker = make_tracker();
  const auto can_start = [&](int i, double time, const kys::Prior& prior) {
    Mixture mixture;
    mixture.add(*unknown(i, 1000), prior);
    const TrackResult result = tracker.track({i, time, mixture.features()}, 0);
    return result.status == TrackingStatus::kLost && tracker.can_start(*mixture.features());
  };
  EXPECT_FALSE(can_start(0, 0, road_));  // it starts the first map
  EXPECT_FALSE(can_start(1, 0.1, kys::Prior{}));
  EXPECT_TRUE(can_start(2, 0.2, road_));
  EXPECT_FALSE(can_start(3, 0.3, kys::Prior{}));
  EXPECT_TRUE(can_start(4, 1.4, kys::Prior{}));  // no more priors, it seems
}

}  // namespace
}  // namespace kys_slam
