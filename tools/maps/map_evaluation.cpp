// SPDX-License-Identifier: BSD-3-Clause
#include "map_evaluation.h"

#include <fmt/format.h>
#include <kys_slam/error.h>
#include <kys_slam/util/median.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <map>
#include <span>

#include "cloud_tree.h"

namespace kys_slam {

namespace {

constexpr double kLever = 10;  // m, of the points that a camera takes along when poses are aligned
constexpr std::size_t kLeastPoses = 3;
constexpr double kIcpReach = 0.5;  // m, of pairs that ICP uses
constexpr int kIcpIterations = 50;
constexpr double kIcpStep = 1e-5;  // m, of the centre of the map: ICP has ended
constexpr std::size_t kLeastPairs = 100;
constexpr std::size_t kSpacingSamples = 20000;
constexpr std::array kFrom = {0.0, 10.0, 20.0, 40.0};  // m, of the ranges of distances
constexpr double kRed = 0.2;                           // m

/// Poses that see the same places have the same points around them: a straight path alone does not
/// say how the camera is turned about it.
Similarity align_poses(const EvaluatedMap& map, const EvaluateOptions& options) {
  TrajectoryPair pair = associate_by_time(options.trajectory_truth, map.keyframes);
  if (pair.size() < kLeastPoses) {
    throw InputError(fmt::format(
        "the true trajectory has {} poses at the times of the map's keyframes; {} are needed",
        pair.size(), kLeastPoses));
  }
  const std::size_t count = pair.size();
  for (std::size_t k = 0; k < count; ++k) {
    for (const Eigen::Vector3d& lever :
         {Eigen::Vector3d(kLever, 0, 0), Eigen::Vector3d(-kLever, 0, 0),
          Eigen::Vector3d(0, kLever, 0), Eigen::Vector3d(0, -kLever, 0),
          Eigen::Vector3d(0, 0, kLever)}) {
      for (auto* poses : {&pair.reference, &pair.estimate}) {
        TimedPose moved = (*poses)[k];
        moved.T_w_c.translation = moved.T_w_c * lever;
        poses->push_back(moved);
      }
    }
  }
  return align(pair, options.scale ? Alignment::kSim3 : Alignment::kSe3);
}

std::vector<Eigen::Vector3d> moved_by(const Similarity& similarity,
                                      const std::vector<Eigen::Vector3d>& points) {
  std::vector<Eigen::Vector3d> result;
  result.reserve(points.size());
  for (const Eigen::Vector3d& p : points) {
    result.push_back(similarity.T * Eigen::Vector3d(similarity.scale * p));
  }
  return result;
}

/// Point to point (Besl and McKay, PAMI 1992), of pairs within kIcpReach.
void refine_by_points(const std::vector<Eigen::Vector3d>& points, const PointCloud& truth,
                      const CloudTree& tree, Similarity& alignment) {
  for (int iteration = 0; iteration < kIcpIterations; ++iteration) {
    const std::vector<Eigen::Vector3d> at = moved_by(alignment, points);
    TrajectoryPair pair;
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& p : at) {
      const std::size_t near = tree.nearest(p);
      Eigen::Vector3d q = truth.points[near];
      if ((p - q).norm() > kIcpReach) continue;
      if (!truth.normals.empty()) {  // along the plane anything is as good
        const Eigen::Vector3d& n = truth.normals[near];
        q = p - n * n.dot(p - q);
      }
      pair.estimate.push_back({0, Rigid3(Eigen::Quaterniond::Identity(), p)});
      pair.reference.push_back({0, Rigid3(Eigen::Quaterniond::Identity(), q)});
      centre += p;
    }
    if (pair.size() < kLeastPairs) {
      throw InputError(
          fmt::format("--icp: {} points of the map are within {} m of the truth; {} "
                      "are needed",
                      pair.size(), kIcpReach, kLeastPairs));
    }
    centre /= static_cast<double>(pair.size());
    const Similarity step = align(pair, Alignment::kSe3);
    alignment.T = step.T * alignment.T;
    if ((step.T * centre - centre).norm() < kIcpStep) return;
  }
}

/// Median distance of neighbours, of every n-th point.
double spacing_of(const PointCloud& cloud, const CloudTree& tree) {
  std::vector<double> distances;
  const std::size_t every = 1 + cloud.points.size() / kSpacingSamples;
  for (std::size_t k = 0; k < cloud.points.size(); k += every) {
    const Eigen::Vector3d& p = cloud.points[k];
    distances.push_back((p - cloud.points[tree.second(p)]).norm());
  }
  return median(distances);
}

/// Distance of a point from a surface that is given by points `spacing` apart.
double distance_from(const Eigen::Vector3d& p, const PointCloud& truth, std::size_t near,
                     double spacing) {
  const Eigen::Vector3d off = p - truth.points[near];
  if (truth.normals.empty() || truth.normals[near].isZero()) return off.norm();
  const double across = truth.normals[near].dot(off);
  const double along = std::sqrt(std::max(0.0, off.squaredNorm() - across * across));
  constexpr double kGap = 2;  // neighbours are up to about this many times the median apart
  return std::hypot(across, std::max(0.0, along - kGap * spacing));
}

Distances summary(std::string name, std::vector<double> values) {
  Distances d;
  d.name = std::move(name);
  d.count = values.size();
  if (values.empty()) return d;
  double sum = 0, squares = 0;
  for (const double x : values) {
    sum += x;
    squares += x * x;
    for (std::size_t k = 0; k < kNear.size(); ++k) d.share.at(k) += x < kNear.at(k) ? 1 : 0;
  }
  const auto n = static_cast<double>(values.size());
  for (double& share : d.share) share /= n;
  d.mean = sum / n;
  d.rmse = std::sqrt(squares / n);
  d.median = median(values);
  return d;
}

std::vector<Distances> by_class(const PointCloud& cloud, const std::vector<int>& classes,
                                const std::vector<double>& values) {
  std::map<int, std::vector<double>> sorted;
  for (std::size_t k = 0; k < classes.size(); ++k) sorted[classes[k]].push_back(values[k]);
  std::vector<Distances> list;
  for (auto& [number, of_class] : sorted) {
    list.push_back(summary(cloud.name_of_class(number), std::move(of_class)));
  }
  return list;
}

std::vector<Distances> by_range(const std::vector<double>& distance,
                                const std::vector<double>& values) {
  std::vector<Distances> list;
  if (distance.empty()) return list;
  for (std::size_t r = 0; r < kFrom.size(); ++r) {
    const double low = kFrom.at(r);
    const double high = r + 1 < kFrom.size() ? kFrom.at(r + 1) : 1e30;
    std::vector<double> within;
    for (std::size_t k = 0; k < distance.size(); ++k) {
      if (distance[k] >= low && distance[k] < high) within.push_back(values[k]);
    }
    const bool last = r + 1 == kFrom.size();
    list.push_back(
        summary(last ? fmt::format("from {} m", low) : fmt::format("{} to {} m", low, high),
                std::move(within)));
  }
  return list;
}

template <typename T>
void append_binary(std::string& text, T value) {
  const auto bytes = std::bit_cast<std::array<char, sizeof(T)>>(value);
  text.append(bytes.data(), bytes.size());
}

}  // namespace

MapEvaluation evaluate_map(const EvaluatedMap& map, const PointCloud& truth,
                           const EvaluateOptions& options) {
  MapEvaluation result;
  if (options.T_truth_map) {
    result.alignment.T = *options.T_truth_map;
  } else if (!options.trajectory_truth.empty()) {
    result.alignment = align_poses(map, options);
  }
  const CloudTree truth_tree(truth.points);
  if (options.icp) refine_by_points(map.cloud.points, truth, truth_tree, result.alignment);
  const std::vector<Eigen::Vector3d> points = moved_by(result.alignment, map.cloud.points);
  result.spacing = spacing_of(truth, truth_tree);
  result.planes = !truth.normals.empty();
  std::vector<int> classes;
  for (const Eigen::Vector3d& p : points) {
    const std::size_t near = truth_tree.nearest(p);
    result.accuracy.push_back(distance_from(p, truth, near, result.spacing));
    if (!truth.classes.empty()) classes.push_back(truth.classes[near]);
  }
  const CloudTree map_tree(points);
  std::vector<double> completeness;
  completeness.reserve(truth.points.size());
  for (const Eigen::Vector3d& q : truth.points) {
    completeness.push_back((q - points[map_tree.nearest(q)]).norm());
  }
  result.map_to_truth = summary("map to truth", result.accuracy);
  result.truth_to_map = summary("truth to map", completeness);
  result.by_distance = by_range(map.distance, result.accuracy);
  result.map_by_class = truth.classes.empty()
                            ? by_class(map.cloud, map.cloud.classes, result.accuracy)
                            : by_class(truth, classes, result.accuracy);
  result.truth_by_class = by_class(truth, truth.classes, completeness);
  return result;
}

std::string error_ply(const EvaluatedMap& map, const MapEvaluation& evaluation) {
  const std::vector<Eigen::Vector3d> points = moved_by(evaluation.alignment, map.cloud.points);
  std::string text = fmt::format(
      "ply\nformat binary_little_endian 1.0\ncomment points of a map, m, frame of the truth; "
      "error: "
      "distance from the truth, m\nelement vertex {}\nproperty float x\nproperty float y\n"
      "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
      "property float error\nend_header\n",
      points.size());
  for (std::size_t k = 0; k < points.size(); ++k) {
    const Eigen::Vector3f p = points[k].cast<float>();
    for (int c = 0; c < 3; ++c) append_binary(text, p[c]);
    const double share = std::clamp(evaluation.accuracy[k] / kRed, 0.0, 1.0);
    append_binary(text, static_cast<std::uint8_t>(std::lround(255 * std::min(1.0, 2 * share))));
    append_binary(text, static_cast<std::uint8_t>(std::lround(200 * std::min(1.0, 2 - 2 * share))));
    append_binary(text, std::uint8_t{0});
    append_binary(text, static_cast<float>(evaluation.accuracy[k]));
  }
  return text;
}

}  // namespace kys_slam
