#include <fmt/format.h>
#include <kys_slam/error.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "evaluation/association.h"
#include "geometry/stereo_alignment.h"
#include "io/sequence.h"
#include "matching/descriptor_matcher.h"
#include "recall.h"
#include "retrieval/place_index.h"
#include "tracking/front_end.h"
#include "util/atomic_file.h"
#include "util/progress.h"
#include "util/stopwatch.h"

namespace kys_slam {
namespace {

constexpr int kBadInput = 2;

struct Arguments {
  std::string sequence;
  std::string csv;
  std::int64_t frames = 0;
  std::int64_t every = 1;
  int features = 1200;
  double gap = 10;           // s
  double pair_distance = 1;  // m
  double pair_angle = 30;    // degrees
  int candidates = 10;
  int min_inliers = 10;
  DescriptorMatchOptions matching;
  RansacOptions ransac;
  PlaceOptions places;
};

/// A frame with its true pose, as a keyframe.
struct Place {
  std::string name;
  double timestamp = 0;
  Rigid3 T_w_c;
  std::shared_ptr<const FrameFeatures> features;
};

/// Two keyframes more than the gap apart in time, and what recognition made of them.
struct Pair {
  std::size_t query = 0;
  std::size_t keyframe = 0;  // the older one
  double distance = 0;       // m, between the cameras
  double angle = 0;          // degrees, between the cameras
  double score = 0;          // of the index; 0: not returned
  int votes = 0;
  int rank = -1;  // among the candidates, from 0
  int matches = -1;
  int inliers = -1;
  double error_distance = 0;  // m, of the measured motion, when there are inliers
  double error_angle = 0;     // degrees
};

double degrees(double radians) {
  return radians * 180 / std::numbers::pi;
}

class Evaluation {
 public:
  explicit Evaluation(const Arguments& arguments) : arguments_(arguments), scales_(1.2, 8) {}

  void load() {
    const auto sequence = open_euroc_sequence(arguments_.sequence);
    camera_ = sequence->camera();
    std::vector<TimedPose> stamps;
    for (std::int64_t i = 0; i < sequence->frame_count(); ++i) {
      stamps.push_back({sequence->frame(i).timestamp, {}});
    }
    const TrajectoryPair truth = associate_by_time(sequence->ground_truth(), stamps);
    OrbOptions orb;
    orb.features = arguments_.features;
    scales_ = ScaleLevels(orb.scale_factor, orb.levels);
    FrontEnd front_end(camera_, orb, StereoOptions{}, model_, nullptr);
    Progress progress("features", static_cast<std::int64_t>(truth.size()));
    std::size_t next = 0;
    for (std::int64_t i = 0; i < sequence->frame_count(); ++i) {
      const double stamp = sequence->frame(i).timestamp;
      if (next >= truth.size() || truth.estimate[next].timestamp != stamp) continue;
      const Rigid3 T_w_c = truth.reference[next++].T_w_c;
      if (i % arguments_.every != 0) continue;
      const StereoFrame frame = sequence->read(i);
      places_.push_back({frame.name, stamp, T_w_c, front_end.process(frame).features});
      progress.update(static_cast<std::int64_t>(next));
      if (static_cast<std::int64_t>(places_.size()) == arguments_.frames) break;
    }
    if (places_.empty()) {
      throw InputError(arguments_.sequence + ": no frame has a ground-truth pose");
    }
  }

  void run() {
    PlaceIndex index(arguments_.places);
    std::size_t indexed = 0;
    Progress progress("queries", static_cast<std::int64_t>(places_.size()));
    for (std::size_t q = 0; q < places_.size(); ++q) {
      while (places_[q].timestamp - places_[indexed].timestamp > arguments_.gap) {
        index.apply(as_changes(indexed++));
      }
      ask(index, q, indexed);
      progress.update(static_cast<std::int64_t>(q + 1));
    }
    landmarks_ = index.landmarks();
  }

  void report() const;
  void write_csv() const;

 private:
  /// A keyframe whose landmarks are its stereo features, seen by nobody else.
  ChangeSet as_changes(std::size_t place) {
    const FrameFeatures& features = *places_[place].features;
    const KeyFrameId id{static_cast<std::uint32_t>(place)};
    ChangeSet changes;
    KeyFrameView keyframe;
    keyframe.features = places_[place].features;
    for (std::size_t i = 0; i < features.size(); ++i) {
      if (!features.has_stereo(i)) continue;
      LandmarkView landmark;
      landmark.descriptor = features.descriptor(i);
      landmark.prior = features.prior(i);
      landmark.observers = {id};
      changes.landmarks.emplace_back(LandmarkId{next_landmark_++}, landmark);
    }
    changes.keyframes.emplace_back(id, std::move(keyframe));
    return changes;
  }

  void ask(const PlaceIndex& index, std::size_t q, std::size_t indexed) {
    Stopwatch watch;
    kys::Statistics statistics;
    const std::vector<PlaceCandidate> candidates =
        index.query(*places_[q].features, model_, statistics, {}, indexed);
    query_ms_.push_back(watch.lap_ms());
    compared_.push_back(static_cast<double>(statistics.total()));
    const std::size_t first = pairs_.size();
    for (std::size_t k = 0; k < indexed; ++k) {
      const Rigid3 T_q_k = places_[q].T_w_c.inverse() * places_[k].T_w_c;
      Pair pair;
      pair.query = q;
      pair.keyframe = k;
      pair.distance = T_q_k.translation.norm();
      pair.angle = degrees(rotation_angle(T_q_k));
      pairs_.push_back(pair);
    }
    for (std::size_t r = 0; r < candidates.size(); ++r) {
      Pair& pair = pairs_[first + candidates[r].keyframe.value];
      pair.score = candidates[r].score;
      pair.votes = candidates[r].votes;
      pair.rank = static_cast<int>(r);
      if (pair.rank < arguments_.candidates) verify(pair);
    }
  }

  [[nodiscard]] PointMatch point_match(const FrameFeatures& a, std::size_t i,
                                       const FrameFeatures& b, std::size_t j) const {
    const auto pixel = [&](const FrameFeatures& f, std::size_t n) {
      return StereoPixel{f.keypoint(n).x, f.keypoint(n).y, f.u_right(n),
                         scales_.inv_sigma(f.keypoint(n).octave)};
    };
    const auto point = [&](const FrameFeatures& f, std::size_t n) {
      return camera_.back_project(f.keypoint(n).x, f.keypoint(n).y, f.depth(n));
    };
    return {point(a, i), point(b, j), pixel(a, i), pixel(b, j)};
  }

  /// Every descriptor against every other, then the motion that most matches agree with.
  void verify(Pair& pair) {
    Stopwatch watch;
    const FrameFeatures& a = *places_[pair.query].features;
    const FrameFeatures& b = *places_[pair.keyframe].features;
    std::vector<DescriptorQuery> queries;
    std::vector<std::size_t> feature;
    for (std::size_t i = 0; i < a.size(); ++i) {
      if (!a.has_stereo(i)) continue;
      queries.push_back({&a.descriptor(i), &a.prior(i), a.keypoint(i).angle});
      feature.push_back(i);
    }
    kys::Statistics statistics;
    const std::vector<std::int32_t> matches =
        match_descriptors(queries, b, arguments_.matching, model_, statistics);
    std::vector<PointMatch> points;
    for (std::size_t m = 0; m < matches.size(); ++m) {
      if (matches[m] < 0 || !b.has_stereo(static_cast<std::size_t>(matches[m]))) continue;
      points.push_back(point_match(a, feature[m], b, static_cast<std::size_t>(matches[m])));
    }
    const RansacResult result = align_se3_ransac(camera_, points, arguments_.ransac);
    pair.matches = static_cast<int>(points.size());
    pair.inliers = result.inliers;
    if (result.success) {
      const Rigid3 truth = places_[pair.query].T_w_c.inverse() * places_[pair.keyframe].T_w_c;
      const Rigid3 error = truth.inverse() * result.T;
      pair.error_distance = error.translation.norm();
      pair.error_angle = degrees(rotation_angle(error));
    }
    verify_ms_.push_back(watch.lap_ms());
  }

  [[nodiscard]] bool is_near(const Pair& pair) const {
    return pair.distance < arguments_.pair_distance && pair.angle < arguments_.pair_angle;
  }

  Arguments arguments_;
  kys::DistanceModel model_;
  StereoCamera camera_;
  ScaleLevels scales_;
  std::vector<Place> places_;
  std::vector<Pair> pairs_;
  std::vector<double> query_ms_, verify_ms_, compared_;
  std::uint32_t next_landmark_ = 0;
  std::size_t landmarks_ = 0;
};

double mean(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v;
  return values.empty() ? 0 : sum / static_cast<double>(values.size());
}

void Evaluation::report() const {
  std::size_t near = 0;
  std::vector<Proposal> by_score, by_inliers;
  for (const Pair& pair : pairs_) {
    near += is_near(pair) ? 1 : 0;
    if (pair.score > 0) by_score.push_back({pair.score, is_near(pair)});
    if (pair.inliers > 0) by_inliers.push_back({static_cast<double>(pair.inliers), is_near(pair)});
  }
  std::printf("places %zu, pairs %zu, near %zu, landmarks %zu\n", places_.size(), pairs_.size(),
              near, landmarks_);
  const auto row = [&](const char* name, const std::vector<Proposal>& proposals) {
    const RecallPoint point = best_recall(recall_curve(proposals, near), 1.0);
    std::printf("%-20s recall %.3f at %.3f\n", name, point.recall, point.threshold);
  };
  row("score", by_score);
  row("inliers", by_inliers);
  std::printf("query %.2f ms, %.0f comparisons, verify %.2f ms\n", mean(query_ms_), mean(compared_),
              mean(verify_ms_));
}

void Evaluation::write_csv() const {
  if (arguments_.csv.empty()) return;
  std::string text =
      "query,keyframe,distance_m,angle_deg,score,votes,rank,matches,inliers,error_m,error_deg\n";
  for (const Pair& p : pairs_) {
    text += fmt::format("{},{},{:.4f},{:.3f},{:.6g},{},{},{},{},{:.4f},{:.3f}\n", p.query,
                        p.keyframe, p.distance, p.angle, p.score, p.votes, p.rank, p.matches,
                        p.inliers, p.error_distance, p.error_angle);
  }
  write_file_atomic(arguments_.csv, text);
}

int run(int argc, char** argv) {
  CLI::App app("Precision and recall of place recognition on a stereo sequence with ground truth");
  Arguments a;
  app.add_option("SEQUENCE", a.sequence, "folder of an EuRoC sequence")->required();
  app.add_option("--csv", a.csv, "all pairs as a table");
  app.add_option("--frames", a.frames, "");
  app.add_option("--every", a.every, "");
  app.add_option("--features", a.features, "");
  app.add_option("--gap", a.gap, "");
  app.add_option("--candidates", a.candidates, "");
  app.add_option("--tables", a.places.tables, "");
  app.add_option("--seed", a.places.seed, "");
  app.add_option("--max-bucket", a.places.max_bucket, "");
  app.add_option("--max-features", a.places.max_features, "");
  app.add_option("--max-distance", a.places.max_distance, "");
  app.add_option("--margin", a.places.margin, "");
  app.add_option("--match-distance", a.matching.max_distance, "");
  app.add_option("--match-ratio", a.matching.ratio, "");
  app.add_option("--check-rotation", a.matching.check_rotation, "");
  app.add_option("--iterations", a.ransac.iterations, "");
  CLI11_PARSE(app, argc, argv);
  a.ransac.min_inliers = 3;
  Evaluation evaluation(a);
  evaluation.load();
  evaluation.run();
  evaluation.report();
  evaluation.write_csv();
  return 0;
}

}  // namespace
}  // namespace kys_slam

int main(int argc, char** argv) {
  try {
    return kys_slam::run(argc, argv);
  } catch (const kys_slam::InputError& error) {
    std::fprintf(stderr, "evaluate_places: %s\n", error.what());
    return kys_slam::kBadInput;
  }
}
