// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/feature_extractor.h>
#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "loop_closing/place_verification.h"
#include "map/map.h"
#include "retrieval/place_index.h"

namespace kys_slam {

struct PlaceRunOptions {
  std::int64_t every = 1;   ///< frames, only each so many becomes a keyframe
  std::int64_t frames = 0;  ///< keyframes at most; 0: all
  int features = 1200;      ///< per image
  std::string stored;       ///< file of another extractor's features, in place of ORB's
  double gap = 10;          ///< s: a query searches keyframes that are older than this
  int candidates = 10;      ///< of each query, verified
  PlaceOptions places;
  PlaceVerificationOptions verification;
};

/// A frame with its true pose.
struct Place {
  std::int64_t position = 0;  ///< in the sequence
  std::string name;
  double timestamp = 0;  ///< s
  Rigid3 T_w_c;
  std::shared_ptr<const FrameFeatures> features;
};

/// What the geometric check made of a pair.
struct PairCheck {
  bool accepted = false;   ///< with the options given
  int inliers = 0;         ///< with the thresholds on number and share lowered; 0: rejected
  int in_view = 0;         ///< landmarks that should be in view
  double translation = 0;  ///< m, error of the measured motion
  double rotation = 0;     ///< degrees
  VerifiedPlace place;     ///< as measured
};

/// A query and an older keyframe.
struct PlacePair {
  std::size_t query = 0;
  std::size_t keyframe = 0;
  double distance = 0;  ///< m, between the cameras
  double angle = 0;     ///< degrees, between the cameras
  double overlap = 0;   ///< share of the query's stereo points inside the keyframe's image
  double score = 0;     ///< of the index; 0: no candidate
  int votes = 0;
  int rank = -1;  ///< among the candidates, from 0; -1: none of them
  std::optional<PairCheck> check;
};

/// Time of a query with that many landmarks in the index.
struct QueryTime {
  std::size_t landmarks = 0;
  double milliseconds = 0;  ///< of processor time
  std::uint64_t comparisons = 0;
};

/// Place recognition on recorded frames with true poses. Every frame becomes a keyframe, each of
/// its stereo features a landmark at its true place seen by nobody else; a query searches the index
/// when it holds the keyframes older than the gap.
class PlaceRun {
 public:
  /// Reads an EuRoC sequence and extracts features. \throws InputError
  PlaceRun(const std::filesystem::path& sequence, const PlaceRunOptions& options);

  void run();

  [[nodiscard]] const std::vector<Place>& places() const { return places_; }
  [[nodiscard]] const std::vector<PlacePair>& pairs() const { return pairs_; }
  [[nodiscard]] const std::vector<QueryTime>& query_times() const { return query_times_; }
  [[nodiscard]] double mean_check_ms() const;
  [[nodiscard]] std::size_t index_bytes() const { return index_.bytes(); }
  /// The features of query and keyframe that the check took for the same.
  [[nodiscard]] std::vector<std::pair<Keypoint, Keypoint>> matches(const PairCheck& check,
                                                                   std::size_t query) const;

 private:
  PlaceRun(const std::filesystem::path& sequence, const PlaceRunOptions& options,
           std::unique_ptr<FeatureExtractor> extractor);
  void add_keyframe(std::size_t place);
  void ask(std::size_t query, std::size_t indexed);
  [[nodiscard]] double overlap(const FrameFeatures& features, const Rigid3& T_k_q) const;
  [[nodiscard]] PairCheck check(std::size_t query, std::size_t keyframe);

  PlaceRunOptions options_;  ///< distances are those of the extractor
  kys::DistanceModel model_;
  StereoCamera camera_;
  std::vector<Place> places_;
  std::unique_ptr<Map> map_;
  PlaceIndex index_;
  std::uint32_t next_landmark_ = 0;
  std::vector<PlacePair> pairs_;
  std::vector<QueryTime> query_times_;
  double check_ms_ = 0;
  int checks_ = 0;
};

}  // namespace kys_slam
