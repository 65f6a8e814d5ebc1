// SPDX-License-Identifier: BSD-3-Clause
// solver_benchmark MAP [ROUNDS [PART]]: our solvers and those of Ceres, SuiteSparse and Eigen on
// the map of a run (run_stereo_kitti --save-map); PART `reduced`: only the reduced camera
// system; `supernodal`: of that only ours and CHOLMOD's supernodal factorisation. Every
// measurement is a process of its own, in turns, so that a busy machine meets all alike; processor
// time, and memory beyond what the problem itself takes.
#include <kys_slam/error.h>
#include <kys_slam/run_main.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <Eigen/CholmodSupport>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <map>
#include <random>
#include <string>
#include <vector>

#include "ceres_reference/ceres_reference.h"
#include "geometry/reprojection.h"
#include "geometry/so3.h"
#include "map_file/map_file.h"
#include "mapping/local_bundle.h"
#include "optimization/block_cholesky.h"
#include "optimization/bundle_adjustment.h"
#include "optimization/pose_graph.h"

namespace kys_slam {
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;

/// What a child process is asked for; plain numbers, as they go through a pipe.
struct Outcome {
  double cost = 0;
  double iterations = 0;
};
struct Measured {
  double seconds = 0;
  double megabytes = 0;
  Outcome outcome;
};

Measured measure(const std::function<Outcome()>& work) {
  int ends[2];
  if (::pipe(ends) != 0) std::abort();
  const pid_t child = ::fork();
  if (child == 0) {
    const Outcome outcome = work();
    const bool written = ::write(ends[1], &outcome, sizeof outcome) == sizeof outcome;
    ::_exit(written ? 0 : 1);
  }
  ::close(ends[1]);
  Measured result;
  const bool read = ::read(ends[0], &result.outcome, sizeof result.outcome) == sizeof(Outcome);
  ::close(ends[0]);
  int status = 0;
  rusage usage{};
  ::wait4(child, &status, 0, &usage);
  if (!read || status != 0) throw std::runtime_error("a measurement failed");
  result.seconds = static_cast<double>(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
                   1e-6 * static_cast<double>(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
  result.megabytes = 1.024e-3 * static_cast<double>(usage.ru_maxrss);
  return result;
}

struct Contender {
  std::string name;
  std::function<Outcome()> work;
};

/// Runs the contenders in turns and prints medians; the last column is time over that of the first.
void compare(const std::string& title, int rounds, const std::vector<Contender>& contenders) {
  std::fflush(stdout);  // or the children write it as well
  const double idle = measure([] { return Outcome{}; }).megabytes;
  std::vector<std::vector<Measured>> all(contenders.size());
  for (int round = 0; round < rounds; ++round) {
    for (std::size_t c = 0; c < contenders.size(); ++c) {
      all[c].push_back(measure(contenders[c].work));
    }
  }
  std::printf("\n%s\n%-36s %10s %10s %6s %16s %8s\n", title.c_str(), "", "CPU s", "MB", "iter.",
              "cost", "ratio");
  std::vector<double> first;
  for (std::size_t c = 0; c < contenders.size(); ++c) {
    std::vector<double> seconds, ratios;
    for (std::size_t r = 0; r < all[c].size(); ++r) {
      seconds.push_back(all[c][r].seconds);
      ratios.push_back(all[c][r].seconds / all[0][r].seconds);
    }
    std::sort(seconds.begin(), seconds.end());
    std::sort(ratios.begin(), ratios.end());
    const Measured& one = all[c].front();
    std::printf("%-36s %10.3f %10.1f %6.0f %16.6g %8.2f\n", contenders[c].name.c_str(),
                seconds[seconds.size() / 2], one.megabytes - idle, one.outcome.iterations,
                one.outcome.cost, ratios[ratios.size() / 2]);
  }
  std::fflush(stdout);
}

/// The largest sub-map as full bundle adjustment takes it, moved a little from where it was left.
BundleProblem whole_map(const Map& map) {
  std::map<KeyFrameId, std::size_t> sizes;
  map.keyframes().for_each([&](KeyFrameId, const KeyFrame& k) { ++sizes[k.submap]; });
  const KeyFrameId submap =
      std::max_element(sizes.begin(), sizes.end(), [](const auto& a, const auto& b) {
        return a.second < b.second;
      })->first;
  BundleProblem problem;
  problem.camera = map.camera();
  const std::vector<KeyFrameId> ids = map.submap_keyframes(submap);
  std::mt19937_64 random(7);
  std::normal_distribution<double> normal;
  for (const KeyFrameId id : ids) {
    const KeyFrame& keyframe = map.keyframe(id);
    const bool fixed = !keyframe.parent.valid();
    Vector6d by = Vector6d::Zero();
    if (!fixed) {
      for (int k = 0; k < 6; ++k) by[k] = (k < 3 ? 0.001 : 0.05) * normal(random);
    }
    problem.T_c_w.push_back(plus(keyframe.T_c_w, by));
    problem.pose_fixed.push_back(fixed ? 1 : 0);
  }
  std::vector<LandmarkId> landmarks;
  map.landmarks().for_each([&](LandmarkId id, const Landmark& landmark) {
    if (map.keyframe(landmark.reference).submap == submap) landmarks.push_back(id);
  });
  add_landmarks(map, ids, landmarks, problem);
  return problem;
}

/// Spanning tree and covisible keyframes that share many landmarks, and drifted poses to start
/// from.
struct Graph {
  std::vector<Rigid3> T_w_c;
  std::vector<std::uint8_t> fixed;
  std::vector<PoseGraphEdge> edges;
};
Graph essential_graph(const Map& map) {
  constexpr int kStrong = 100;
  Graph graph;
  std::map<KeyFrameId, std::int32_t> index;
  std::mt19937_64 random(8);
  std::normal_distribution<double> normal;
  Rigid3 drift;
  map.keyframes().for_each([&](KeyFrameId id, const KeyFrame& k) {
    index[id] = static_cast<std::int32_t>(graph.T_w_c.size());
    const auto edge_to = [&](KeyFrameId other) {
      if (const auto at = index.find(other); at != index.end() && other < id) {
        graph.edges.push_back(
            {at->second, index[id], map.keyframe(other).T_c_w * k.T_c_w.inverse()});
      }
    };
    if (k.parent.valid()) edge_to(k.parent);
    for (const KeyFrameId other : k.loop_edges) edge_to(other);
    for (const Covisible& c : k.covisible) {
      if (c.weight >= kStrong && c.keyframe != k.parent) edge_to(c.keyframe);
    }
    Vector6d step;
    for (int i = 0; i < 6; ++i) step[i] = (i < 3 ? 0.0005 : 0.02) * normal(random);
    drift = plus(drift, step);
    graph.T_w_c.push_back(drift * k.T_c_w.inverse());
    graph.fixed.push_back(k.parent.valid() ? 0 : 1);
  });
  return graph;
}

double graph_cost(const Graph& graph) {
  double cost = 0;
  for (const PoseGraphEdge& e : graph.edges) {
    const Rigid3 error = e.T_a_b.inverse() * (graph.T_w_c[static_cast<std::size_t>(e.a)].inverse() *
                                              graph.T_w_c[static_cast<std::size_t>(e.b)]);
    cost += so3_log(error.rotation).squaredNorm() + error.translation.squaredNorm();
  }
  return 0.5 * cost;
}

/// The reduced camera system of bundle adjustment at the first linearisation, damped by 1e-4.
struct ReducedSystem {
  BlockPattern pattern;
  BlockCholesky::Blocks blocks;
  Eigen::VectorXd right_side;

  [[nodiscard]] Eigen::SparseMatrix<double> lower() const {
    std::vector<Eigen::Triplet<double>> triplets;
    for (std::int32_t r = 0; r < pattern.rows(); ++r) {
      for (std::int32_t k = pattern.row_begin[r]; k < pattern.row_begin[r + 1]; ++k) {
        const std::int32_t c = pattern.column[k];
        for (int i = 0; i < 6; ++i) {
          for (int j = 0; j < (r == c ? i + 1 : 6); ++j) {
            triplets.emplace_back(6 * r + i, 6 * c + j, blocks[k](i, j));
          }
        }
      }
    }
    Eigen::SparseMatrix<double> matrix(6 * pattern.rows(), 6 * pattern.rows());
    matrix.setFromTriplets(triplets.begin(), triplets.end());
    return matrix;
  }
};

ReducedSystem reduce(const BundleProblem& problem) {
  using Block = BlockCholesky::Block;
  using Matrix63 = Eigen::Matrix<double, 6, 3>;
  std::vector<std::int32_t> free;
  std::int32_t count = 0;
  for (const std::uint8_t fixed : problem.pose_fixed) free.push_back(fixed != 0 ? -1 : count++);
  std::vector<std::map<std::int32_t, Block>> rows(static_cast<std::size_t>(count));
  ReducedSystem system;
  system.right_side = Eigen::VectorXd::Zero(6 * count);
  const auto add = [&](std::int32_t r, std::int32_t c, const Block& block) {
    const auto [at, is_new] = rows[static_cast<std::size_t>(r)].try_emplace(c, Block::Zero());
    at->second += block;
  };
  for (std::size_t point = 0; point < problem.points.size(); ++point) {
    Eigen::Matrix3d V = Eigen::Matrix3d::Zero();
    Eigen::Vector3d b = Eigen::Vector3d::Zero();
    std::vector<std::pair<std::int32_t, Matrix63>> mixed;
    const double weight = problem.weights.empty() ? 1 : problem.weights[point];
    for (auto i = problem.first[point]; i < problem.first[point + 1]; ++i) {
      const auto& o = problem.observations[static_cast<std::size_t>(i)];
      const Rigid3& T = problem.T_c_w[o.pose];
      const Eigen::Vector3d p_c = T * problem.points[point];
      if (p_c.z() < kMinDepth) continue;
      const bool stereo = !std::isnan(o.u_right);
      Eigen::Vector3d e = reprojection_error(problem.camera, p_c, o.u, o.v, o.u_right);
      Eigen::Matrix3d J = reprojection_jacobian(problem.camera, p_c);
      if (!stereo) {
        e.z() = 0;
        J.row(2).setZero();
      }
      const double information = problem.inv_sigma[o.noise] * problem.inv_sigma[o.noise];
      const double chi2 = information * e.squaredNorm();
      const double bound = stereo ? 7.815 : 5.991;
      const double w = weight * information * (chi2 > bound ? std::sqrt(bound / chi2) : 1.0);
      const Eigen::Matrix3d J_point = J * T.R();
      Eigen::Matrix<double, 3, 6> J_pose;
      J_pose << -J * hat(p_c), J;
      V += w * J_point.transpose() * J_point;
      b += w * J_point.transpose() * e;
      if (free[o.pose] < 0) continue;
      add(free[o.pose], free[o.pose], w * J_pose.transpose() * J_pose);
      system.right_side.segment<6>(6 * free[o.pose]) -= w * J_pose.transpose() * e;
      mixed.emplace_back(free[o.pose], w * J_pose.transpose() * J_point);
    }
    V.diagonal() += 1e-4 * V.diagonal().cwiseMax(1e-6);
    const Eigen::Matrix3d inverse = V.inverse();
    for (const auto& [r, W_r] : mixed) {
      system.right_side.segment<6>(6 * r) += W_r * inverse * b;
      for (const auto& [c, W_c] : mixed) {
        if (c <= r) add(r, c, -W_r * inverse * W_c.transpose());
      }
    }
  }
  for (std::int32_t r = 0; r < count; ++r) {
    Block& own = rows[static_cast<std::size_t>(r)][r];
    own.diagonal() += 1e-4 * own.diagonal().cwiseAbs().cwiseMax(1e-6);
    for (const auto& [c, block] : rows[static_cast<std::size_t>(r)]) {
      system.pattern.column.push_back(c);
      system.blocks.push_back(block);
    }
    system.pattern.row_begin.push_back(static_cast<std::int32_t>(system.pattern.column.size()));
  }
  return system;
}

/// Analyses the pattern once, factorises and solves `kSolutions` times; the cost is the residual.
constexpr int kSolutions = 10;

template <typename Solver>
Outcome solve_by_eigen(const ReducedSystem& system) {
  const Eigen::SparseMatrix<double> A = system.lower();
  Solver solver;
  solver.analyzePattern(A);
  Eigen::VectorXd x;
  for (int k = 0; k < kSolutions; ++k) {
    solver.factorize(A);
    x = solver.solve(system.right_side);
  }
  const Eigen::VectorXd residual =
      A.template selfadjointView<Eigen::Lower>() * x - system.right_side;
  return {residual.norm() / system.right_side.norm(), kSolutions};
}

Outcome solve_by_ours(const ReducedSystem& system, const front::Kernels& kernels) {
  BlockCholesky solver(system.pattern, kernels);
  Eigen::VectorXd x;
  for (int k = 0; k < kSolutions; ++k) {
    if (solver.factorise(system.blocks) != BlockCholesky::Result::kDone) return {1, k + 1.0};
    x = system.right_side;
    solver.solve(x);
  }
  const Eigen::VectorXd residual =
      system.lower().selfadjointView<Eigen::Lower>() * x - system.right_side;
  return {residual.norm() / system.right_side.norm(), kSolutions};
}

Outcome adjust(BundleProblem problem, BundleRoundSolver solver) {
  BundleOptions options;
  options.round_solver = solver;
  const BundleSummary summary = adjust_bundle(problem, options);
  return {summary.final_cost, static_cast<double>(summary.iterations)};
}

void compare_solvers(const BundleProblem& problem, const Graph& graph, int rounds) {
  compare("full bundle adjustment, both rounds", rounds,
          {{"ours", [&] { return adjust(problem, nullptr); }},
           {"Ceres, SuiteSparse", [&] { return adjust(problem, solve_bundle_ceres); }}});
  compare("pose graph, 20 iterations", rounds,
          {{"ours",
            [&] {
              Graph g = graph;
              optimize_pose_graph(g.T_w_c, g.fixed, g.edges);
              return Outcome{graph_cost(g), 20};
            }},
           {"Ceres, SuiteSparse", [&] {
              Graph g = graph;
              solve_pose_graph_ceres(g.T_w_c, g.fixed, g.edges, 20);
              return Outcome{graph_cost(g), 20};
            }}});
}

int run(int argc, char** argv) {
  if (argc < 2) {
    std::fprintf(stderr, "usage: solver_benchmark MAP [ROUNDS [reduced|supernodal]]\n");
    return kBadInput;
  }
  const int rounds = argc > 2 ? std::max(1, std::atoi(argv[2])) : 3;
  const std::string part = argc > 3 ? argv[3] : "";
  const Map map = load_map(argv[1]);
  if (map.keyframes().empty()) throw InputError(std::string(argv[1]) + ": holds no keyframes");
  const BundleProblem problem = whole_map(map);
  const Graph graph = essential_graph(map);
  std::printf("%zu keyframes, %zu points, %zu observations; %zu edges; processor time in turns\n",
              problem.T_c_w.size(), problem.points.size(), problem.observations.size(),
              graph.edges.size());
  if (part.empty()) compare_solvers(problem, graph, rounds);
  const ReducedSystem system = reduce(problem);
  using Matrix = Eigen::SparseMatrix<double>;
  std::vector<Contender> contenders = {
      {"block Cholesky (ours)", [&] { return solve_by_ours(system, front::kernels()); }},
      {"(blocks to a sparse matrix, once)",
       [&] {
         return Outcome{0, static_cast<double>(system.lower().nonZeros())};
       }},
      {"CHOLMOD, supernodal",
       [&] { return solve_by_eigen<Eigen::CholmodSupernodalLLT<Matrix, Eigen::Lower>>(system); }}};
  for (const front::Kernels* kernels : front::available_kernels()) {
    if (kernels == &front::kernels()) continue;
    contenders.push_back({std::string("ours, kernels ") + kernels->name,
                          [&system, kernels] { return solve_by_ours(system, *kernels); }});
  }
  if (part != "supernodal") {
    contenders.push_back(
        {"CHOLMOD, simplicial", [&] {
           return solve_by_eigen<Eigen::CholmodSimplicialLLT<Matrix, Eigen::Lower>>(system);
         }});
    contenders.push_back(
        {"Eigen SimplicialLLT", [&] {
           return solve_by_eigen<
               Eigen::SimplicialLLT<Matrix, Eigen::Lower, Eigen::AMDOrdering<int>>>(system);
         }});
  }
  compare("reduced camera system: analysed once, 10 factorisations and solutions", rounds,
          contenders);
  return 0;
}

}  // namespace
}  // namespace kys_slam

int main(int argc, char** argv) {
  return kys_slam::run_main("solver_benchmark", [&] { return kys_slam::run(argc, argv); });
}
