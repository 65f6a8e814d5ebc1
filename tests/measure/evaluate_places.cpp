// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <kys_slam/error.h>
#include <kys_slam/sequence.h>
#include <kys_slam/util/atomic_file.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "common/command_line.h"
#include "measure/draw_matches.h"
#include "measure/place_run.h"
#include "measure/recall.h"

namespace kys_slam {
namespace {

struct Arguments {
  std::string sequence;
  std::string csv;
  std::string drawings;
  PlaceRunOptions run;
  double near_distance = 1;        // m
  double near_angle = 30;          // degrees
  double min_overlap = 0.1;        // less: not the same view
  double translation_error = 0.3;  // m, a measured motion this wrong is a false loop
  double rotation_error = 5;       // degrees
};

/// The judgements of a run by the definitions that the help text gives.
class Report {
 public:
  Report(const PlaceRun& run, const Arguments& arguments) : run_(run), arguments_(arguments) {
    for (const PlacePair& pair : run.pairs()) near_ += is_near(pair) ? 1 : 0;
  }

  void print() const {
    std::printf("%zu keyframes, %zu pairs more than %g s apart, %zu of them near (%g m, %g deg)\n",
                run_.places().size(), run_.pairs().size(), arguments_.run.gap, near_,
                arguments_.near_distance, arguments_.near_angle);
    print_ranks();
    print_curves();
    print_check();
    print_times();
  }

 private:
  [[nodiscard]] bool is_near(const PlacePair& p) const {
    return p.distance < arguments_.near_distance && p.angle < arguments_.near_angle;
  }
  [[nodiscard]] bool is_same_view(const PlacePair& p) const {
    return p.overlap >= arguments_.min_overlap;
  }
  [[nodiscard]] bool is_right_motion(const PlacePair& p) const {
    return p.check && p.check->translation < arguments_.translation_error &&
           p.check->rotation < arguments_.rotation_error;
  }

  void print_ranks() const {
    std::printf("\nqueries with a near keyframe that have one among the best:\n ");
    for (const int n : {1, 2, 3, 5, 10, 20}) {
      std::set<std::size_t> all, found;
      for (const PlacePair& p : run_.pairs()) {
        if (!is_near(p)) continue;
        all.insert(p.query);
        if (p.rank >= 0 && p.rank < n) found.insert(p.query);
      }
      std::printf("  %d: %.3f", n,
                  static_cast<double>(found.size()) /
                      static_cast<double>(std::max<std::size_t>(all.size(), 1)));
    }
    std::printf("\n");
  }

  /// Recall of near pairs when everything else that `allows` does not excuse is false.
  template <typename Score, typename Allows>
  void print_curve(const char* name, Score score, Allows allows) const {
    std::vector<Proposal> proposals;
    for (const PlacePair& p : run_.pairs()) {
      const double s = score(p);
      if (s > 0 && (is_near(p) || !allows(p))) proposals.push_back({s, is_near(p) && allows(p)});
    }
    const std::vector<RecallPoint> curve = recall_curve(proposals, near_);
    const RecallPoint strict = best_recall(curve, 1.0);
    std::printf("%-58s %8.3f %10.4g %8.3f %8.3f\n", name, strict.recall, strict.threshold,
                best_recall(curve, 0.99).recall, best_recall(curve, 0.95).recall);
  }

  void print_curves() const {
    std::printf("\n%-58s %8s %10s %8s %8s\n", "recall of near pairs at precision", "1", "threshold",
                "0.99", "0.95");
    const auto score = [](const PlacePair& p) { return p.score; };
    const auto inliers = [](const PlacePair& p) {
      return p.check ? static_cast<double>(p.check->inliers) : 0.0;
    };
    const auto near = [&](const PlacePair& p) { return is_near(p); };
    const auto same = [&](const PlacePair& p) { return is_near(p) || is_same_view(p); };
    const auto right = [&](const PlacePair& p) { return is_right_motion(p); };
    print_curve("score; false: any pair that is not near", score, near);
    print_curve("score; false: views that do not overlap", score, same);
    print_curve("inliers; false: any pair that is not near", inliers, near);
    print_curve("inliers; false: views that do not overlap", inliers, same);
    print_curve("inliers; false: the measured motion is wrong", inliers, right);
  }

  void print_check() const {
    std::size_t checked = 0, accepted = 0, wrong = 0, apart = 0, near = 0;
    std::set<std::size_t> queries, closed;
    for (const PlacePair& p : run_.pairs()) {
      if (is_near(p)) queries.insert(p.query);
      if (!p.check) continue;
      ++checked;
      if (!p.check->accepted) continue;
      ++accepted;
      wrong += is_right_motion(p) ? 0 : 1;
      apart += is_same_view(p) ? 0 : 1;
      near += is_near(p) ? 1 : 0;
      if (is_right_motion(p)) closed.insert(p.query);
    }
    std::size_t closed_near = 0;
    for (const std::size_t q : queries) closed_near += closed.contains(q) ? 1 : 0;
    std::printf(
        "\nloop closing's own check of the best %d: %zu of %zu accepted, %zu with a wrong motion, "
        "%zu of views that do not overlap\n  near pairs accepted: %.3f; queries with a near "
        "keyframe that get a right motion: %.3f; all queries that get one: %zu\n",
        arguments_.run.candidates, accepted, checked, wrong, apart,
        static_cast<double>(near) / static_cast<double>(std::max<std::size_t>(near_, 1)),
        static_cast<double>(closed_near) /
            static_cast<double>(std::max<std::size_t>(queries.size(), 1)),
        closed.size());
  }

  void print_times() const {
    const std::vector<QueryTime>& times = run_.query_times();
    std::printf("\n%12s %12s %12s\n", "landmarks", "ms/query", "compared");
    constexpr std::size_t kRows = 5;
    for (std::size_t row = 0; row < kRows; ++row) {
      const std::size_t first = row * times.size() / kRows;
      const std::size_t last = (row + 1) * times.size() / kRows;
      if (first == last) continue;
      double ms = 0, landmarks = 0, compared = 0;
      for (std::size_t i = first; i < last; ++i) {
        ms += times[i].milliseconds;
        landmarks += static_cast<double>(times[i].landmarks);
        compared += static_cast<double>(times[i].comparisons);
      }
      const auto n = static_cast<double>(last - first);
      std::printf("%12.0f %12.2f %12.0f\n", landmarks / n, ms / n, compared / n);
    }
    if (!times.empty() && times.back().landmarks > 0) {
      std::printf(
          "index: %.0f bytes per landmark; check of a candidate: %.2f ms\n",
          static_cast<double>(run_.index_bytes()) / static_cast<double>(times.back().landmarks),
          run_.mean_check_ms());
    }
  }

  const PlaceRun& run_;
  const Arguments& arguments_;
  std::size_t near_ = 0;
};

void write_csv(const PlaceRun& run, const std::string& path) {
  std::string text =
      "query,keyframe,distance_m,angle_deg,overlap,score,votes,rank,accepted,inliers,in_view,"
      "error_m,error_deg\n";
  for (const PlacePair& p : run.pairs()) {
    const PairCheck none;
    const PairCheck& c = p.check ? *p.check : none;
    text += fmt::format("{},{},{:.4f},{:.3f},{:.3f},{:.6g},{},{},{},{},{},{:.4f},{:.3f}\n",
                        run.places()[p.query].name, run.places()[p.keyframe].name, p.distance,
                        p.angle, p.overlap, p.score, p.votes, p.rank, c.accepted ? 1 : 0, c.inliers,
                        c.in_view, c.translation, c.rotation);
  }
  write_file_atomic(path, text);
}

void declare(CLI::App& app, Arguments& a) {
  app.add_option("SEQUENCE", a.sequence, "folder of an EuRoC sequence with ground truth")
      ->required();
  app.add_option("--every", a.run.every, "make every N-th frame a keyframe")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  app.add_option("--frames", a.run.frames, "number of keyframes (0: all)")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  app.add_option("--features", a.run.features, "per image")
      ->check(CLI::Range(1, 60000))
      ->capture_default_str();
  app.add_option("--stored-features", a.run.stored,
                 "file of store_features.py: another extractor's features in place of ORB's");
  app.add_option("--gap", a.run.gap, "s, a query searches keyframes older than this")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  app.add_option("--candidates", a.run.candidates, "of each query that are checked geometrically")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  app.add_option("--near-distance", a.near_distance, "m, between the cameras of a near pair")
      ->capture_default_str();
  app.add_option("--near-angle", a.near_angle, "degrees, between the cameras of a near pair")
      ->capture_default_str();
  app.add_option("--min-overlap", a.min_overlap,
                 "views overlap if this share of the query's stereo points lies in the keyframe's "
                 "image (occlusion is not modelled)")
      ->capture_default_str();
  app.add_option("--translation-error", a.translation_error, "m, from here a motion is wrong")
      ->capture_default_str();
  app.add_option("--rotation-error", a.rotation_error, "degrees, from here a motion is wrong")
      ->capture_default_str();
  app.add_option("--csv", a.csv, "write all pairs to this file");
  app.add_option("--draw", a.drawings,
                 "folder for images of near pairs that the check refuses and of pairs that it "
                 "wrongly accepts");
  PlaceOptions& p = a.run.places;
  app.add_option("--tables", p.tables, "hash tables")->capture_default_str();
  app.add_option("--seed", p.seed, "of the hash tables' bits")->capture_default_str();
  app.add_option("--max-bucket", p.max_bucket, "landmarks")->capture_default_str();
  app.add_option("--max-features", p.max_features, "of a query")->capture_default_str();
  app.add_option("--max-distance", p.max_distance, "bits")->capture_default_str();
  app.add_option("--margin", p.margin, "bits")->capture_default_str();
}

/// The matches of every near pair that the check refuses, and of every pair it wrongly accepts.
void draw(const PlaceRun& run, const Arguments& a) {
  make_output_folder(a.drawings);
  const auto sequence = open_euroc_sequence(a.sequence);
  for (const PlacePair& p : run.pairs()) {
    const bool near = p.distance < a.near_distance && p.angle < a.near_angle;
    const bool accepted = p.check && p.check->accepted;
    const bool wrong = accepted && (p.check->translation >= a.translation_error ||
                                    p.check->rotation >= a.rotation_error);
    if (!wrong && (!near || accepted)) continue;
    const Place& query = run.places()[p.query];
    const Place& keyframe = run.places()[p.keyframe];
    std::vector<std::pair<Keypoint, Keypoint>> matches;
    if (p.check) matches = run.matches(*p.check, p.query);
    const std::string name =
        fmt::format("{}-{}-{}.png", wrong ? "wrong" : "missed", query.name, keyframe.name);
    write_png(std::filesystem::path(a.drawings) / name,
              draw_matches(sequence->read(query.position).left,
                           sequence->read(keyframe.position).left, matches));
  }
}

int run(int argc, char** argv) {
  CLI::App app(
      "Precision and recall of place recognition. Every frame of a sequence with ground truth is\n"
      "a keyframe and a query for keyframes older than the gap. The index holds these only; each\n"
      "stereo feature is a landmark. A pair is a query and an older keyframe. It is near when\n"
      "distance and angle of the cameras are within the limits. Recall counts near pairs: by the\n"
      "score of the index, and by the inliers of geometric verification of the best candidates.\n"
      "False pairs are counted in three ways: pairs that are not near (too strict, because pairs\n"
      "just beyond the limits appear similar), pairs without overlap of the views, and pairs with "
      "a\n"
      "wrong measured motion.");
  Arguments arguments;
  declare(app, arguments);
  if (const auto status = parse_command_line(app, argc, argv)) return *status;
  PlaceRun places(arguments.sequence, arguments.run);
  places.run();
  Report(places, arguments).print();
  if (!arguments.csv.empty()) write_csv(places, arguments.csv);
  if (!arguments.drawings.empty()) draw(places, arguments);
  return 0;
}

}  // namespace
}  // namespace kys_slam

int main(int argc, char** argv) {
  return kys_slam::run_main("evaluate_places", [&] { return kys_slam::run(argc, argv); });
}
