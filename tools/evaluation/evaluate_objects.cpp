// SPDX-License-Identifier: BSD-3-Clause
// evaluate_objects: moving objects of a run against what is true: position, speed, heading, and how
// long each was followed under one identity.
#include <kys_slam/util/atomic_file.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "common/command_line.h"
#include "object_evaluation.h"
#include "object_files.h"

namespace kys_slam {
namespace {

using Json = nlohmann::ordered_json;

struct Arguments {
  std::string run, truth, rows;
  ObjectEvaluationOptions options;
  bool json = false;
};

/// Order statistics of what one column of the errors says.
struct Column {
  std::size_t count = 0;
  double median = 0, mean = 0, p90 = 0;
};
constexpr int kAllObjects = -1;
Column column(const std::vector<ObjectError>& errors, double (*value)(const ObjectError&),
              int object = kAllObjects) {
  std::vector<double> values;
  for (const ObjectError& e : errors) {
    if (object != kAllObjects && e.object != object) continue;
    if (const double v = value(e); e.counts && std::isfinite(v)) values.push_back(v);
  }
  Column c;
  c.count = values.size();
  if (values.empty()) return c;
  std::sort(values.begin(), values.end());
  c.median = values[values.size() / 2];
  c.p90 = values[std::min(values.size() - 1, values.size() * 9 / 10)];
  for (const double v : values) c.mean += v / static_cast<double>(values.size());
  return c;
}

struct Named {
  const char* key;
  const char* text;
  double (*value)(const ObjectError&);
};
const Named kColumns[] = {
    {"speed_m_s", "speed, |error| [m/s]", [](const ObjectError& e) { return std::abs(e.speed); }},
    {"velocity_m_s", "velocity, error [m/s]", [](const ObjectError& e) { return e.velocity; }},
    {"heading_deg", "heading, error [deg]", [](const ObjectError& e) { return e.heading; }},
    {"position_m", "position, error [m]", [](const ObjectError& e) { return e.position; }},
    {"outside_m", "outside of the box [m]", [](const ObjectError& e) { return e.outside; }},
    {"velocity_over_sigma", "velocity error / sigma_v",
     [](const ObjectError& e) { return e.deviations; }},
};

struct Follow {
  int objects = 0, well = 0;  ///< followed over 90 % of their life
  int frames = 0, followed = 0, reported = 0;
};
Follow sum_lives(const std::vector<ObjectLife>& lives) {
  Follow f;
  for (const ObjectLife& life : lives) {
    ++f.objects;
    f.well += 10 * life.followed >= 9 * life.frames ? 1 : 0;
    f.frames += life.frames;
    f.followed += life.followed;
    f.reported += life.reported;
  }
  return f;
}

double share(int part, int whole) {
  return whole > 0 ? static_cast<double>(part) / whole : 0;
}

void print_json(const ObjectEvaluation& e) {
  Json json = Json::object();
  json["estimates"] = e.estimates;
  json["unassigned"] = e.unassigned;
  json["on_standing_objects"] = e.standing;
  for (const Named& named : kColumns) {
    const Column c = column(e.errors, named.value);
    json[named.key] = {{"count", c.count}, {"median", c.median}, {"mean", c.mean}, {"p90", c.p90}};
  }
  const Follow f = sum_lives(e.lives);
  json["life"] = {{"objects", f.objects},
                  {"objects_followed_90_percent", f.well},
                  {"frames", f.frames},
                  {"share_under_one_identity", share(f.followed, f.frames)},
                  {"share_reported", share(f.reported, f.frames)}};
  json["objects"] = Json::array();
  for (const ObjectLife& life : e.lives) {
    json["objects"].push_back({{"object", life.object},
                               {"class", printable(life.kind)},
                               {"frames", life.frames},
                               {"followed", life.followed},
                               {"reported", life.reported},
                               {"identities", life.identities}});
    for (const Named& named : kColumns) {
      const Column c = column(e.errors, named.value, life.object);
      json["objects"].back()[named.key] = {{"count", c.count}, {"median", c.median}};
    }
  }
  std::printf("%s\n", json.dump(2).c_str());
}

void print_table(const ObjectEvaluation& e, const Arguments& a) {
  std::printf("estimates: %d, of these on no object %d, on objects that stand %d\n", e.estimates,
              e.unassigned, e.standing);
  std::printf("%-26s %8s %8s %8s %8s\n", "", "count", "median", "mean", "p90");
  for (const Named& named : kColumns) {
    const Column c = column(e.errors, named.value);
    std::printf("%-26s %8zu %8.3f %8.3f %8.3f\n", named.text, c.count, c.median, c.mean, c.p90);
  }
  std::printf("(within %g m, at least %d stereo keypoints)\n\n", a.options.max_range,
              a.options.min_keypoints);
  std::printf("%8s  %-12s %8s %10s %10s %12s %10s %8s %8s %8s\n", "object", "class", "frames",
              "followed", "reported", "identities", "estimates", "m/s", "deg", "m");
  for (const ObjectLife& life : e.lives) {
    const auto median = [&](const Named& named) {
      return column(e.errors, named.value, life.object).median;
    };
    std::printf("%8d  %-12s %8d %9.0f%% %9.0f%% %12d %10zu %8.3f %8.3f %8.3f\n", life.object,
                printable(life.kind).c_str(), life.frames, 100 * share(life.followed, life.frames),
                100 * share(life.reported, life.frames), life.identities,
                column(e.errors, kColumns[0].value, life.object).count, median(kColumns[0]),
                median(kColumns[2]), median(kColumns[3]));
  }
  std::printf("(estimates that count, and medians of their errors of speed, heading, position)\n");
  const Follow f = sum_lives(e.lives);
  std::printf(
      "\n%d of %d objects followed under one identity over 90 %% of their life; %.1f %% of all "
      "their "
      "frames, %.1f %% under any\n",
      f.well, f.objects, 100 * share(f.followed, f.frames), 100 * share(f.reported, f.frames));
}

/// Frame by frame under which identity a moving object is followed; empty: under none.
void write_rows(const std::string& path, const std::vector<ObjectLifeFrame>& rows) {
  std::ostringstream text;
  text << "object,frame,range_m,identity\n";
  for (const ObjectLifeFrame& row : rows) {
    text << row.object << ',' << row.frame << ',' << row.range << ',';
    if (row.identity) text << *row.identity;
    text << '\n';
  }
  write_file_atomic(path, text.str());
}

void add_options(CLI::App& app, Arguments& a) {
  static const std::map<std::string, RelativeTo> kRelative = {{"camera", RelativeTo::kCamera},
                                                              {"start", RelativeTo::kStart}};
  ObjectEvaluationOptions& o = a.options;
  app.add_option("run", a.run, "Output folder of a run")->required();
  app.add_option(
         "--truth", a.truth,
         "objects.csv of simulate_sequence, label file of KITTI Tracking (label_02/NAME.txt, "
         "with calib/NAME.txt in the same place), or pose.txt of Virtual KITTI 2")
      ->required();
  app.add_option("--relative-to", o.relative_to,
                 "camera (default): relative to the camera, without its pose error; start: in the "
                 "frame of the first camera, pose error included")
      ->transform(CLI::CheckedTransformer(kRelative).description(""))
      ->option_text("R");
  app.add_option("--max-range", o.max_range, "m, farther objects do not count")
      ->capture_default_str();
  app.add_option("--min-keypoints", o.min_keypoints,
                 "only estimates with at least this many keypoints count")
      ->capture_default_str();
  app.add_option("--min-pixels", o.min_pixels,
                 "px, frames with fewer visible pixels of an object do not count")
      ->capture_default_str();
  app.add_option("--max-distance", o.max_distance,
                 "m, largest distance from an estimate to its box")
      ->capture_default_str();
  app.add_option("--first-frame", o.first_frame, "earlier frames do not count")
      ->capture_default_str();
  app.add_option("--last-frame", o.last_frame, "later frames do not count");
  app.add_option("--rows", a.rows,
                 "CSV file to write: the frames of all lifetimes, each with the identity it has");
  app.add_flag("--json", a.json, "Print JSON");
}

int run(int argc, char** argv) {
  CLI::App app(
      "Compares the moving objects of a run with ground truth. An estimate is that of a point "
      "fixed to the object: the median of an identity's estimates in the object's frame, moved "
      "into "
      "the box. Position and velocity are compared with that point's. The lifetime of an object is "
      "the frames in which it moves, is within --max-range, and has --min-pixels.");
  Arguments arguments;
  add_options(app, arguments);
  if (const auto status = parse_command_line(app, argc, argv)) return *status;
  const ObjectRun objects = read_object_run(arguments.run);
  const auto truth = read_true_objects(arguments.truth, objects.frames);
  if (truth.empty()) throw InputError(arguments.truth + ": no object in the frames of the run");
  if (!objects.has_ground_truth) {
    std::fprintf(stderr,
                 "evaluate_objects: %s has no ground truth of the camera: its estimate stands in\n",
                 printable(arguments.run).c_str());
  }
  const ObjectEvaluation evaluation =
      evaluate_objects(objects.objects, truth, objects.frames, arguments.options);
  if (!arguments.rows.empty()) write_rows(arguments.rows, evaluation.life_frames);
  arguments.json ? print_json(evaluation) : print_table(evaluation, arguments);
  return 0;
}

}  // namespace
}  // namespace kys_slam

int main(int argc, char** argv) {
  return kys_slam::run_main("evaluate_objects", [&] { return kys_slam::run(argc, argv); });
}
