// SPDX-License-Identifier: BSD-3-Clause
// evaluate_stereo: disparities of stereo matching against exact ones, by what may bias them.
#include <fmt/format.h>
#include <kys_slam/error.h>
#include <kys_slam/image_file.h>
#include <kys_slam/sequence.h>
#include <kys_slam/util/atomic_file.h>
#include <kys_slam/util/progress.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "common/command_line.h"
#include "features/orb_extractor.h"
#include "matching/stereo_matcher.h"

namespace kys_slam {
namespace {

constexpr double kJump = 1;     // px of disparity between neighbours: a depth edge
constexpr int kEdgeReach = 24;  // px, how far an edge is looked for

struct Arguments {
  std::string sequence;
  std::string csv;
  int every = 5;
  OrbOptions orb;
  StereoOptions stereo;
};

/// One accepted match and what is true where it lies.
struct Match {
  std::int64_t frame = 0;
  Keypoint keypoint;
  double disparity = 0;  // px, measured
  double truth = 0;      // px, of the surface at the keypoint
  double nearest = 0;    // px, of the surface within 3 px of its octave closest to what is measured
  double slant_u = 0, slant_v = 0;  // px of disparity per px
  double edge = kEdgeReach;         // px to the nearest depth edge
  double step = 0;      // px of disparity by which the surface at the keypoint is nearer than
                        // the mean of what lies around
  double contrast = 0;  // grey levels, standard deviation within 5 px of its octave
  double phase = 0;     // px of the octave, of the disparity, -0.5..0.5
};

class Truth {
 public:
  explicit Truth(Image16 image) : image_(std::move(image)) {}

  /// px; 0 where there is none.
  [[nodiscard]] double at(int x, int y) const {
    return image_.contains(x, y) ? image_.at(x, y) / 256.0 : 0;
  }
  /// Fills in what is true at the match; false where nothing is known.
  bool judge(Match& m, double scale) const {
    const int x = static_cast<int>(std::lround(m.keypoint.x));
    const int y = static_cast<int>(std::lround(m.keypoint.y));
    const double here = at(x, y);
    if (here <= 0) return false;
    m.slant_u = slope(at(x - 1, y), here, at(x + 1, y));
    m.slant_v = slope(at(x, y - 1), here, at(x, y + 1));
    m.truth = here + m.slant_u * (m.keypoint.x - x) + m.slant_v * (m.keypoint.y - y);
    m.nearest = m.truth;
    const int reach = static_cast<int>(std::lround(3 * scale));
    double sum = 0;
    int count = 0;
    for (int dy = -reach; dy <= reach; ++dy) {
      for (int dx = -reach; dx <= reach; ++dx) {
        const double d = at(x + dx, y + dy);
        if (d <= 0) continue;
        sum += d - m.slant_u * dx - m.slant_v * dy;
        ++count;
        // On another surface: as far off as that surface is at its pixel.
        const bool other = std::abs(d - here - m.slant_u * dx - m.slant_v * dy) > kJump;
        if (other && std::abs(d - m.disparity) < std::abs(m.nearest - m.disparity)) m.nearest = d;
      }
    }
    m.step = here - sum / count;
    m.edge = edge_distance(x, y);
    return true;
  }

 private:
  static double slope(double before, double here, double after) {
    const double back = before > 0 ? here - before : kJump;
    const double ahead = after > 0 ? after - here : kJump;
    if (std::abs(back) < kJump && std::abs(ahead) < kJump) return (back + ahead) / 2;
    if (std::abs(back) < kJump) return back;
    return std::abs(ahead) < kJump ? ahead : 0;
  }
  [[nodiscard]] double edge_distance(int x, int y) const {
    double best = kEdgeReach * kEdgeReach;
    for (int dy = -kEdgeReach; dy <= kEdgeReach; ++dy) {
      for (int dx = -kEdgeReach; dx <= kEdgeReach; ++dx) {
        const double squared = dx * dx + dy * dy;
        if (squared < best && is_edge(x + dx, y + dy)) best = squared;
      }
    }
    return std::sqrt(best);
  }
  [[nodiscard]] bool is_edge(int x, int y) const {
    if (!image_.contains(x, y) || !image_.contains(x + 1, y + 1)) return false;
    return std::abs(at(x + 1, y) - at(x, y)) > kJump || std::abs(at(x, y + 1) - at(x, y)) > kJump;
  }

  Image16 image_;
};

double contrast_at(const ImagePyramid& pyramid, const Keypoint& k) {
  const GrayImage& image = pyramid.levels[k.octave];
  const Eigen::Vector2f at = pyramid.to_level(k.octave, k.x, k.y);
  const int x = static_cast<int>(std::lround(at.x()));
  const int y = static_cast<int>(std::lround(at.y()));
  double sum = 0, squares = 0;
  int count = 0;
  for (int v = y - 5; v <= y + 5; ++v) {
    for (int u = x - 5; u <= x + 5; ++u) {
      if (!image.contains(u, v)) continue;
      const double grey = image.at(u, v);
      sum += grey;
      squares += grey * grey;
      ++count;
    }
  }
  return std::sqrt(std::max(0.0, squares / count - sum / count * sum / count));
}

std::vector<Match> judge_sequence(const Arguments& a) {
  const auto sequence = open_sequence(a.sequence);
  OrbExtractor left(a.orb), right(a.orb);
  const ScaleLevels scales(a.orb.scale_factor, a.orb.levels);
  const kys::DistanceModel model;
  std::vector<Match> matches;
  Progress progress("frames", sequence->frame_count());
  for (std::int64_t i = 0; i < sequence->frame_count(); i += a.every) {
    const StereoFrame frame = sequence->read(i);
    const Truth truth(read_u16(std::filesystem::path(a.sequence) / "disparity" /
                               (sequence->frame(i).name + ".png")));
    FeatureSet l, r;
    left.extract(frame.left, l);
    right.extract(frame.right, r);
    kys::Statistics statistics;
    const std::vector<float> u_right =
        match_stereo(sequence->camera(), scales, {&l, {}, &left.pyramid()},
                     {&r, {}, &right.pyramid()}, a.stereo, model, statistics)
            .u;
    for (std::size_t k = 0; k < l.size(); ++k) {
      if (std::isnan(u_right[k])) continue;
      Match m;
      m.frame = i;
      m.keypoint = l.keypoints[k];
      m.disparity = m.keypoint.x - u_right[k];
      if (!truth.judge(m, scales.scale[m.keypoint.octave])) continue;
      m.contrast = contrast_at(left.pyramid(), m.keypoint);
      const double shift = m.truth / scales.scale[m.keypoint.octave];
      m.phase = shift - std::round(shift);
      matches.push_back(m);
    }
    progress.update(i);
  }
  return matches;
}

double quantile(std::vector<double>& values, double q) {
  const auto k = static_cast<std::ptrdiff_t>(q * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + k, values.end());
  return values[static_cast<std::size_t>(k)];
}

using Value = std::function<double(const Match&)>;

void print_row(const std::string& name, const std::vector<const Match*>& matches) {
  if (matches.empty()) return;
  std::vector<double> errors, off, octave_px;
  double mean = 0, nearest = 0;
  int small = 0, gross = 0, near_small = 0;
  for (const Match* m : matches) {
    const double e = m->disparity - m->truth;
    const double n = m->disparity - m->nearest;
    errors.push_back(e);
    if (std::abs(e) > 1) ++gross;
    if (std::abs(e) <= 0.5) mean += e, ++small;
    if (std::abs(n) <= 0.5) nearest += n, ++near_small;
  }
  const double middle = quantile(errors, 0.5);
  for (const Match* m : matches) {
    off.push_back(std::abs(m->disparity - m->truth - middle));
    octave_px.push_back(off.back() / std::pow(1.2, m->keypoint.octave));
  }
  std::printf("%-26s %8zu %8.4f %8.4f %8.4f %8.3f %8.3f %7.1f%%\n", name.c_str(), matches.size(),
              middle, mean / std::max(small, 1), nearest / std::max(near_small, 1),
              1.4826 * quantile(off, 0.5), 1.4826 * quantile(octave_px, 0.5),
              100.0 * gross / static_cast<double>(matches.size()));
}

void print_table(const std::vector<Match>& matches, const std::string& what, const Value& value,
                 const std::vector<double>& bounds) {
  std::printf("\n%s\n", what.c_str());
  for (std::size_t b = 0; b + 1 < bounds.size(); ++b) {
    std::vector<const Match*> group;
    for (const Match& m : matches) {
      if (value(m) >= bounds[b] && value(m) < bounds[b + 1]) group.push_back(&m);
    }
    print_row(fmt::format("  [{:g}, {:g})", bounds[b], bounds[b + 1]), group);
  }
}

void print(const std::vector<Match>& matches) {
  std::printf("%-26s %8s %8s %8s %8s %8s %8s %8s\n", "disparity error, px", "matches", "median",
              "mean", "surface", "sigma", "per oct.", "above 1");
  std::vector<const Match*> all, away, close;
  for (const Match& m : matches) {
    all.push_back(&m);
    (m.edge < 8 ? close : away).push_back(&m);
  }
  print_row("all", all);
  print_row("within 8 px of an edge", close);
  print_row("elsewhere", away);
  constexpr double kMany = 1e9;
  print_table(matches, "distance to a depth edge, px", [](const Match& m) { return m.edge; },
              {0, 1, 2, 3, 4, 6, 8, 12, 16, kEdgeReach, kMany});
  print_table(matches, "nearer than its surroundings by, px", [](const Match& m) { return m.step; },
              {-kMany, -2, -0.5, -0.05, 0.05, 0.5, 2, kMany});
  print_table(matches, "octave", [](const Match& m) { return m.keypoint.octave; },
              {0, 1, 2, 3, 4, 5, 6, 7, 8});
  std::vector<Match> apart;
  std::copy_if(matches.begin(), matches.end(), std::back_inserter(apart),
               [](const Match& m) { return m.edge >= 8; });
  std::printf("\nelsewhere only:\n");
  print_table(apart, "octave", [](const Match& m) { return m.keypoint.octave; },
              {0, 1, 2, 3, 4, 5, 6, 7, 8});
  print_table(apart, "slant along the row", [](const Match& m) { return m.slant_u; },
              {-kMany, -0.2, -0.1, -0.05, -0.01, 0.01, 0.05, 0.1, 0.2, kMany});
  print_table(apart, "slant along the column", [](const Match& m) { return m.slant_v; },
              {-kMany, -0.05, -0.01, 0.01, 0.05, 0.1, 0.2, 0.3, kMany});
  print_table(apart, "disparity, px", [](const Match& m) { return m.truth; },
              {0, 1, 2, 4, 8, 16, 32, kMany});
  print_table(apart, "fraction of the disparity, px of the octave",
              [](const Match& m) { return m.phase; },
              {-0.5, -0.4, -0.3, -0.2, -0.1, 0, 0.1, 0.2, 0.3, 0.4, 0.51});
  print_table(apart, "corner response", [](const Match& m) { return m.keypoint.response; },
              {0, 10, 15, 20, 30, 50, kMany});
  print_table(apart, "contrast, grey levels", [](const Match& m) { return m.contrast; },
              {0, 5, 10, 15, 20, 30, 45, kMany});
}

void write_csv(const std::vector<Match>& matches, const std::string& path) {
  std::string text =
      "frame,u,v,octave,response,disparity,truth,nearest,slant_u,slant_v,edge,step,contrast,"
      "phase\n";
  for (const Match& m : matches) {
    text += fmt::format(
        "{},{:.4f},{:.4f},{},{},{:.4f},{:.4f},{:.4f},{:.4f},{:.4f},{:.2f},{:.3f},"
        "{:.2f},{:.3f}\n",
        m.frame, m.keypoint.x, m.keypoint.y, m.keypoint.octave, m.keypoint.response, m.disparity,
        m.truth, m.nearest, m.slant_u, m.slant_v, m.edge, m.step, m.contrast, m.phase);
  }
  write_file_atomic(path, text);
}

int run(int argc, char** argv) {
  CLI::App app(
      "Disparities of stereo matching against those of a simulated world (disparity/). Errors are\n"
      "measured minus true, of the surface at the keypoint; `surface`: against the surface within\n"
      "3 px of the octave that is closest to what is measured. Means leave out errors above 0.5\n"
      "px; sigma is 1.48 times the median deviation; `per oct.` in pixels of the octave.");
  Arguments a;
  app.add_option("SEQUENCE", a.sequence, "folder of a simulated sequence")->required();
  app.add_option("--every", a.every, "use every N-th frame")
      ->check(whole_number(1))
      ->capture_default_str();
  app.add_option("--features", a.orb.features, "per image")
      ->check(CLI::Range(1, 60000))
      ->capture_default_str();
  app.add_option("--csv", a.csv, "write all matches to this file");
  if (const auto status = parse_command_line(app, argc, argv)) return *status;
  const std::vector<Match> matches = judge_sequence(a);
  if (matches.empty()) throw InputError(a.sequence + ": no match with a true disparity");
  print(matches);
  if (!a.csv.empty()) write_csv(matches, a.csv);
  return 0;
}

}  // namespace
}  // namespace kys_slam

int main(int argc, char** argv) {
  return kys_slam::run_main("evaluate_stereo", [&] { return kys_slam::run(argc, argv); });
}
