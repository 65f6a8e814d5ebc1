// SPDX-License-Identifier: BSD-3-Clause
#include "motion/instance_tracker.h"

#include <gtest/gtest.h>
#include <kys/kys.h>

#include <limits>
#include <memory>
#include <random>
#include <utility>
#include <vector>

namespace kys_slam {
namespace {

const StereoCamera kCarCamera{1241, 376, 720, 720, 610, 185, 0.54};
constexpr double kDt = 0.1;               // s
constexpr std::int32_t kDriving = 70000;  // instances
constexpr std::int32_t kParked = 70001;

kys::Descriptor random_descriptor(std::mt19937_64& random) {
  kys::Descriptor d;
  for (std::uint64_t& word : d.words) word = random();
  return d;
}

/// A road with a car that drives 7 m/s ahead and one that is parked, filmed at 8 m/s.
class Street {
 public:
  explicit Street(const kys::BeliefOptions& start = {})
      : space_(kys::load_label_space("coco_panoptic_133")),
        model_(verified(), space_),
        tracker_(kCarCamera, scales_, {}, kys::InitialBelief(start, space_), model_) {
    std::mt19937_64 random(11);
    std::uniform_real_distribution<double> side(-1, 1);
    const auto road = space_.index_of("road");
    const auto car = space_.index_of("car");
    for (int i = 0; i < 300; ++i) {
      points_.push_back({{15 * side(random), 1.5, 30 + 20 * side(random)},
                         kys::make_prior(road, road, 1, 0, false),
                         random_descriptor(random)});
    }
    for (int i = 0; i < 60; ++i) {
      points_.push_back({{side(random), 0.5 + side(random), 12 + side(random)},
                         kys::make_prior(car, kDriving, 1, 0, false),
                         random_descriptor(random)});
      points_.push_back({{4 + side(random), 0.5 + side(random), 20 + 2 * side(random)},
                         kys::make_prior(car, kParked, 1, 0, false),
                         random_descriptor(random)});
    }
  }

  /// Keypoints on it lose their disparity, as on an object that leaves the view of one camera.
  void lose_disparity(std::int32_t instance) { without_disparity_ = instance; }
  /// It is in the image still, but shows no keypoint.
  void lose_keypoints(std::int32_t instance) { without_keypoints_ = instance; }
  void show_segment(std::int32_t instance) {
    const auto car = space_.index_of("car");
    segments_.push_back(kys::make_prior(car, instance, 1, 0, false));
  }
  /// The file calls the wrong one moving.
  void spoil_flags() {
    for (Point& p : points_) p.prior.dynamic = p.prior.instance == kParked ? 1 : 0;
  }
  void judge_by_file(std::int32_t instance, bool moving, bool judged = true) {
    for (Point& p : points_) {
      if (p.prior.instance != instance) continue;
      p.prior.dynamic = moving ? 1 : 0;
      p.prior.unjudged = judged ? 0 : 1;
    }
  }
  /// Nothing can be followed any more: each frame shows other descriptors.
  void scramble() {
    std::mt19937_64 random(static_cast<unsigned>(frames_) + 100);
    for (Point& p : points_) p.descriptor = random_descriptor(random);
  }
  void rename(std::int32_t from, std::int32_t to, const char* to_class = "car") {
    for (Point& p : points_) {
      if (p.prior.instance != from) continue;
      p.prior.instance = to;
      p.prior.label = space_.index_of(to_class);
    }
  }

  /// \param with_file false: there is none for this frame. Returns its priors as believed.
  std::vector<kys::Prior> frame(bool with_file = true) {
    std::vector<kys::Prior> believed = film(with_file);
    ++frames_;
    return believed;
  }
  /// The camera gives its last image again.
  void repeat() {
    --frames_;
    past_.erase(past_.begin());  // the image is there once
    film(true);
    ++frames_;
  }

 private:
  std::vector<kys::Prior> film(bool with_file) {
    const Rigid3 T_c_w = Rigid3(Eigen::Quaterniond::Identity(), {0, 0, -0.8 * frames_}) *
                         Rigid3(turn_, {0, 0, 0}).inverse();
    FeatureSet set;
    std::vector<float> u_right;
    std::vector<kys::Prior> priors;
    std::vector<PoseTerm> terms;
    seen_.clear();
    for (const Point& p : points_) {
      Eigen::Vector3d p_w = p.p_w;
      if (p.prior.instance == kDriving) p_w.z() += 0.7 * frames_;
      p_w = turn_ * p_w;
      const Eigen::Vector3d p_c = T_c_w * p_w;
      if (p_c.z() < 2 || p.prior.instance == without_keypoints_) continue;
      const Eigen::Vector3d pixel = kCarCamera.project_stereo(p_c);
      if (!kCarCamera.in_image(pixel.x(), pixel.y())) continue;
      set.keypoints.push_back({static_cast<float>(pixel.x()), static_cast<float>(pixel.y())});
      set.descriptors.push_back(p.descriptor);
      const bool mono = p.prior.instance == without_disparity_;
      u_right.push_back(mono ? std::numeric_limits<float>::quiet_NaN()
                             : static_cast<float>(pixel.z()));
      priors.push_back(p.prior);
      seen_.push_back(p.prior);
      const StereoPixel stereo{set.keypoints.back().x, set.keypoints.back().y, u_right.back(),
                               1 / kPixelSigma};
      if (p.prior.instance != kDriving && p.prior.instance != kParked) {
        terms.push_back({p_w, stereo, 1, -1});
      }
    }
    if (!with_file) priors.clear();
    const FrameFeatures raw(kCarCamera, std::move(set), std::move(u_right), std::move(priors));
    const Rigid3 last = past_.empty() ? Rigid3{} : past_.front();
    const double time = kDt * frames_;
    std::vector<kys::Prior> believed = tracker_.assign_priors(time, raw, T_c_w, last);
    kys::Statistics statistics;
    states_ = tracker_.judge(time, std::make_shared<const FrameFeatures>(raw.with_priors(believed)),
                             segments_, T_c_w, frames_ == 0 ? std::vector<PoseTerm>{} : terms,
                             past_, statistics);
    past_.insert(past_.begin(), T_c_w);
    past_.resize(std::min(past_.size(), tracker_.frames_kept()));
    return believed;
  }

 public:
  /// The world turns, as after a loop.
  void turn_world(const Eigen::Quaterniond& R_new_old) {
    turn_ = R_new_old * turn_;
    for (Rigid3& T_c_w : past_) T_c_w = T_c_w * Rigid3(R_new_old, {0, 0, 0}).inverse();
    tracker_.turn_world(R_new_old);
  }

  const std::vector<kys::Prior>& seen() const { return seen_; }
  InstanceTracker& tracker() { return tracker_; }
  const InstanceState* state(std::int32_t instance) const {
    for (const InstanceState& s : states_) {
      if (s.instance == instance) return &s;
    }
    return nullptr;
  }

 private:
  struct Point {
    Eigen::Vector3d p_w;
    kys::Prior prior;
    kys::Descriptor descriptor;
  };
  static kys::ModeOptions verified() {
    kys::ModeOptions options;
    options.mode = kys::Mode::kVerified;
    return options;
  }

  ScaleLevels scales_{1.2, 8};
  kys::LabelSpace space_;
  kys::DistanceModel model_;
  InstanceTracker tracker_;
  std::vector<Point> points_;
  std::vector<Rigid3> past_;
  std::vector<kys::Prior> seen_;
  std::vector<InstanceState> states_;
  int frames_ = 0;
  Eigen::Quaterniond turn_ = Eigen::Quaterniond::Identity();
  std::vector<kys::Prior> segments_;
  std::int32_t without_disparity_ = -1;
  std::int32_t without_keypoints_ = -1;
};

TEST(InstanceTracker, TellsTheDrivingCarFromTheParkedOneWhateverTheFileSays) {
  Street street;
  street.spoil_flags();
  street.frame();
  EXPECT_GT(street.tracker().p_static(kDriving), 0.5);  // as the file has it
  EXPECT_LT(street.tracker().p_static(kParked), 0.5);
  for (int i = 0; i < 6; ++i) street.frame();
  EXPECT_LT(street.tracker().p_static(kDriving), 0.1);
  EXPECT_GT(street.tracker().p_static(kParked), 0.8);
  const InstanceState* car = street.state(kDriving);
  ASSERT_NE(car, nullptr);
  ASSERT_GT(car->span, 0);
  EXPECT_GT(car->matches, 30);
  EXPECT_NEAR(car->motion.motion[5] / car->span, 7.0, 0.2);
  EXPECT_NEAR(car->motion.centre.z(), 12 - 0.1 * 6, 1.0);
}

TEST(InstanceTracker, AnImageThatIsRepeatedDoesNotStopWhatMoves) {
  Street once, often;
  for (int i = 0; i < 8; ++i) {
    once.frame();
    often.frame();
    if (i % 2 == 0) continue;
    for (int k = 0; k < 2; ++k) {
      often.repeat();
      const InstanceState* car = often.state(kDriving);
      ASSERT_NE(car, nullptr);
      EXPECT_GT(car->keypoints, 30);
      EXPECT_EQ(car->span, 0);
      EXPECT_EQ(car->p_static, once.tracker().p_static(kDriving));
    }
  }
  for (const std::int32_t instance : {kDriving, kParked}) {
    EXPECT_EQ(often.tracker().log_odds(instance), once.tracker().log_odds(instance));
  }
  once.frame();
  often.frame();
  const InstanceState* car = often.state(kDriving);
  ASSERT_NE(car, nullptr);
  EXPECT_EQ(car->span, once.state(kDriving)->span);
  EXPECT_NEAR(car->motion.motion[5] / car->span, 7.0, 0.2);
}

TEST(InstanceTracker, AFileThatChangesItsMindIsHeardAtOnce) {
  Street street;
  street.judge_by_file(kDriving, false, false);
  street.frame();
  const kys::BeliefOptions options;
  EXPECT_NEAR(street.tracker().log_odds(kDriving), options.mobile, 1e-9);  // class alone
  street.scramble();
  street.judge_by_file(kDriving, true);
  street.frame();
  EXPECT_NEAR(street.tracker().log_odds(kDriving), options.mobile + options.flagged, 1e-9);
  // A frame in which nothing could be judged does not make it stand.
  street.scramble();
  street.judge_by_file(kDriving, false, false);
  street.frame();
  EXPECT_NEAR(street.tracker().log_odds(kDriving), options.mobile + options.flagged, 1e-9);
}

TEST(InstanceTracker, AFileDoesNotOutweighWhatWasSeen) {
  Street street;
  for (int i = 0; i < 6; ++i) street.frame();
  street.judge_by_file(kParked, true);
  street.frame();
  EXPECT_GT(street.tracker().p_static(kParked), 0.9);
}

TEST(InstanceTracker, BeliefOutlivesMissingFiles) {
  Street street;
  for (int i = 0; i < 5; ++i) street.frame();
  for (int i = 0; i < 5; ++i) {
    const std::vector<kys::Prior> believed = street.frame(false);
    ASSERT_EQ(believed.size(), street.seen().size());
    int right = 0;
    int things = 0;
    for (std::size_t k = 0; k < believed.size(); ++k) {
      if (street.seen()[k].instance != kDriving) continue;
      ++things;
      right += believed[k].instance == kDriving && believed[k].motion > 80 ? 1 : 0;
    }
    EXPECT_GT(right, 0.9 * things) << i;
  }
}

TEST(InstanceTracker, ANewNameTakesOverBelief) {
  Street street;
  for (int i = 0; i < 6; ++i) street.frame();
  const double before = street.tracker().p_static(kParked);
  EXPECT_GT(before, 0.9);
  street.rename(kParked, 70010);
  street.frame();
  EXPECT_GT(street.tracker().p_static(70010), 0.9);
  street.rename(70010, 70011, "bus");
  street.frame();
  EXPECT_GT(street.tracker().p_static(70011), 0.9) << "both move by themselves";
  const double moving = street.tracker().log_odds(kDriving);
  street.rename(kDriving, 70012, "chair");
  street.frame();
  // Another kind of thing begins anew: its class, and what this frame says.
  EXPECT_GT(street.tracker().log_odds(70012), moving + 3);
}

TEST(InstanceTracker, WhatIsFlaggedAtFirstSightMovesSinceThen) {
  kys::BeliefOptions start;
  start.flagged = -5;
  Street street(start);
  street.judge_by_file(kDriving, true);
  for (int i = 0; i < 3; ++i) street.frame(i > 0);
  street.frame();
  bool found = false;
  for (const InstanceBelief& belief : street.tracker().take_changed_beliefs()) {
    if (belief.instance != kDriving) continue;
    found = true;
    EXPECT_LT(belief.p_static, 0.05);
    EXPECT_NEAR(belief.moving_for, 2 * kDt, 1e-6) << "seen for the first time in frame 1";
  }
  EXPECT_TRUE(found);
}

/// It is there, but nothing was measured of it.
void expect_unmeasured(const InstanceState* state) {
  ASSERT_NE(state, nullptr);
  EXPECT_EQ(state->keypoints, 0);
  EXPECT_EQ(state->span, 0);
}

TEST(InstanceTracker, AnInstanceWithoutDisparitiesKeepsItsBelief) {
  Street street;
  for (int k = 0; k < 8; ++k) street.frame();
  const double before = street.tracker().p_static(kDriving);
  ASSERT_LT(before, 0.1);
  street.lose_disparity(kDriving);
  street.frame();
  const InstanceState* state = street.state(kDriving);
  ASSERT_NO_FATAL_FAILURE(expect_unmeasured(state));
  EXPECT_NEAR(state->p_static, before, 0.05);
  street.frame();  // nothing of the frame before can be tracked
  EXPECT_LT(street.tracker().p_static(kDriving), 0.15);
}

TEST(InstanceTracker, AnInstanceWithoutKeypointsIsReportedWhileItsSegmentIsSeen) {
  constexpr std::int32_t kNeverSeen = 77;
  Street street;
  for (int i = 0; i < 6; ++i) street.frame();
  street.lose_keypoints(kDriving);
  street.show_segment(kDriving);
  street.show_segment(kNeverSeen);
  street.frame();
  const InstanceState* car = street.state(kDriving);
  ASSERT_NO_FATAL_FAILURE(expect_unmeasured(car));
  EXPECT_LT(car->p_static, 0.1);
  EXPECT_EQ(street.state(kNeverSeen), nullptr);
}

TEST(InstanceTracker, AVelocityTurnsWithTheWorld) {
  Street street;
  for (int i = 0; i < 6; ++i) street.frame();
  ASSERT_GT(street.state(kDriving)->matches, 30);
  street.turn_world(so3_exp({0, 2.5, 0}));
  street.frame();
  EXPECT_GT(street.state(kDriving)->matches, 30);
}

TEST(InstanceTracker, StuffIsNotDoubted) {
  Street street;
  for (int i = 0; i < 4; ++i) {
    for (const kys::Prior& prior : street.frame()) {
      if (prior.instance == kDriving || prior.instance == kParked) continue;
      EXPECT_EQ(prior.motion, 0);
    }
  }
  EXPECT_EQ(street.tracker().p_static(3), 1.0);
}

TEST(InstanceTracker, ChangesAreToldOnce) {
  Street street;
  street.frame();
  const std::vector<InstanceBelief> first = street.tracker().take_changed_beliefs();
  ASSERT_EQ(first.size(), 2u);
  EXPECT_EQ(first[0].instance, kDriving);
  EXPECT_TRUE(street.tracker().take_changed_beliefs().empty());
  for (int i = 0; i < 3; ++i) street.frame();
  const std::vector<InstanceBelief> again = street.tracker().take_changed_beliefs();
  ASSERT_EQ(again.size(), 2u) << "each once, whatever number of frames changed it";
  EXPECT_LT(again[0].instance, again[1].instance);
}

}  // namespace
}  // namespace kys_slam
