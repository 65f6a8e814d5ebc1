// SPDX-License-Identifier: BSD-3-Clause
#include <benchmark/benchmark.h>
#include <kys_slam/util/process_figures.h>
#include <kys_slam/util/stopwatch.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <thread>

#include "ceres_reference/ceres_reference.h"
#include "optimization/bundle_adjustment.h"
#include "optimization/pose_graph.h"
#include "optimization/pose_optimization.h"
#include "synthetic_scene.h"

namespace kys_slam::test {
namespace {

void pose(benchmark::State& state) {
  const Rigid3 truth(so3_exp({0.01, 0.2, -0.02}), {3, 0.1, 20});
  auto frame = make_frame(truth, static_cast<int>(state.range(0)), 1.0, 0.3, 3);
  Random random(5);
  for (std::size_t i = 0; i < frame.size(); i += 10) frame[i].u += 40;  // a tenth is wrong
  const Rigid3 start = plus(truth, random.increment(0.005, 0.05));
  int inliers = 0;
  for (auto _ : state) {
    const PoseResult result = optimize_pose(kitti_camera(), start, frame);
    inliers = result.inliers;
    benchmark::DoNotOptimize(result.T_c_w);
  }
  state.counters["inliers"] = inliers;
}
BENCHMARK(pose)->Arg(300)->Arg(1000)->Unit(benchmark::kMicrosecond);

/// A window of range(0) keyframes, range(1) of them fixed, range(2) points; stops when the cost
/// falls by less than 10^-range(3). Reports how far the poses are from the minimum.
void bundle(benchmark::State& state, BundleRoundSolver solver) {
  SceneOptions options;
  options.poses = static_cast<int>(state.range(0));
  options.fixed = static_cast<int>(state.range(1));
  options.points = static_cast<int>(state.range(2));
  options.noise = 0.7;
  Scene scene = make_scene(options);
  perturb(scene, 0.001, 0.02, 0.05);
  for (std::size_t i = 0; i < scene.problem.observations.size(); i += 40) {
    scene.problem.observations[i].u += 15;
  }
  BundleOptions bundle_options;
  bundle_options.round_solver = solver;
  bundle_options.function_tolerance = std::pow(10.0, -static_cast<double>(state.range(3)));
  BundleProblem problem;
  BundleSummary summary;
  for (auto _ : state) {
    state.PauseTiming();
    problem = scene.problem;
    state.ResumeTiming();
    summary = adjust_bundle(problem, bundle_options);
    benchmark::DoNotOptimize(problem.T_c_w);
  }
  BundleProblem exact = scene.problem;
  bundle_options.iterations = bundle_options.refine_iterations = 50;
  bundle_options.function_tolerance = 1e-12;
  if (state.range(0) < 100) adjust_bundle(exact, bundle_options);
  double worst = 0;
  for (std::size_t i = 0; i < exact.T_c_w.size(); ++i) {
    worst = std::max(worst, (exact.T_c_w[i].t() - problem.T_c_w[i].t()).norm());
  }
  state.counters["observations"] = static_cast<double>(scene.problem.observations.size());
  state.counters["iterations"] = summary.iterations;
  state.counters["cost"] = summary.final_cost;
  state.counters["off_mm"] = 1e3 * worst;
}
BENCHMARK_CAPTURE(bundle, schur, nullptr)
    ->Args({16, 6, 1800, 3})
    ->Args({25, 10, 2600, 3})
    ->Args({25, 10, 2600, 4})
    ->Args({25, 10, 2600, 5})
    ->Args({25, 10, 2600, 6})
    ->Args({35, 15, 3800, 3})
    ->Args({120, 1, 12000, 4})
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(bundle, ceres, solve_bundle_ceres)
    ->Args({16, 6, 1800, 3})
    ->Args({25, 10, 2600, 3})
    ->Args({35, 15, 3800, 3})
    ->Args({120, 1, 12000, 4})
    ->Args({500, 1, 50000, 4})
    ->Unit(benchmark::kMillisecond);

/// A whole map, one robust round: CPU time of an iteration and of the preparations, memory.
void full(benchmark::State& state, BundleRoundSolver solver, bool hall) {
  const auto poses = static_cast<int>(state.range(0));
  const auto points = static_cast<int>(state.range(1));
  Scene scene = hall ? make_hall_scene(poses, points, 0.7) : make_loop_scene(poses, points, 0.7);
  perturb(scene, 0.001, 0.05, 0.05);
  BundleOptions options;
  options.round_solver = solver;
  options.refine_iterations = 0;
  options.function_tolerance = 1e-9;
  BundleProblem problem;
  BundleSummary summary;
  double seconds[2] = {0, 0};
  const double before = resident_memory_mb();
  for (auto _ : state) {
    for (const int iterations : {0, 5}) {
      options.iterations = iterations;
      problem = scene.problem;
      const double begin = process_figures().cpu_seconds();
      summary = adjust_bundle(problem, options);
      seconds[iterations > 0 ? 1 : 0] += process_figures().cpu_seconds() - begin;
    }
  }
  const auto runs = static_cast<double>(state.iterations());
  state.counters["observations"] = static_cast<double>(scene.problem.observations.size());
  state.counters["iterations"] = summary.iterations;
  state.counters["prepare_s"] = seconds[0] / runs;
  state.counters["iteration_s"] =
      (seconds[1] - seconds[0]) / runs / std::max(1, summary.iterations);
  state.counters["peak_MB"] = process_figures().peak_resident_mb - before;
  state.counters["cost"] = summary.final_cost;
}
BENCHMARK_CAPTURE(full, street_schur, nullptr, false)
    ->Args({300, 30000})
    ->Args({1500, 150000})
    ->Unit(benchmark::kSecond)
    ->Iterations(1);
BENCHMARK_CAPTURE(full, street_ceres, solve_bundle_ceres, false)
    ->Args({300, 30000})
    ->Args({1500, 150000})
    ->Unit(benchmark::kSecond)
    ->Iterations(1);
BENCHMARK_CAPTURE(full, hall_schur, nullptr, true)
    ->Args({300, 6000})
    ->Unit(benchmark::kSecond)
    ->Iterations(1);
BENCHMARK_CAPTURE(full, hall_ceres, solve_bundle_ceres, true)
    ->Args({300, 6000})
    ->Unit(benchmark::kSecond)
    ->Iterations(1);

/// Longest time from the stop flag to the return, a 1500 keyframe map being adjusted.
void stop_delay(benchmark::State& state) {
  Scene scene = make_loop_scene(1500, 150000, 0.7);
  perturb(scene, 0.001, 0.05, 0.05);
  double worst = 0;
  for (auto _ : state) {
    for (const int ms : {50, 150, 300, 370, 440, 510, 580, 650, 720, 790}) {
      BundleProblem problem = scene.problem;
      std::atomic<bool> stop{false};
      BundleOptions options;
      options.stop = &stop;
      options.iterations = 1000;
      options.function_tolerance = 0;
      Stopwatch watch;
      std::thread other([&] {
        std::this_thread::sleep_for(std::chrono::milliseconds(ms));
        watch.lap_ms();
        stop = true;
      });
      adjust_bundle(problem, options);
      const double delay = watch.elapsed_ms();
      other.join();
      worst = std::max(worst, delay);
    }
  }
  state.counters["worst_ms"] = worst;
}
BENCHMARK(stop_delay)->Iterations(1)->Unit(benchmark::kSecond);

/// Poses on two laps with edges to the ten before them and those of the other lap.
void graph(benchmark::State& state) {
  const auto count = static_cast<int>(state.range(0));
  const Scene scene = make_loop_scene(count, 1, 0);
  Random random(3);
  std::vector<Rigid3> truth;
  for (const Rigid3& T : scene.T_c_w) truth.push_back(T.inverse());
  std::vector<PoseGraphEdge> edges;
  const auto add = [&](int a, int b) {
    const Rigid3 T_a_b =
        truth[static_cast<std::size_t>(a)].inverse() * truth[static_cast<std::size_t>(b)];
    edges.push_back({a, b, plus(T_a_b, random.increment(0.001, 0.01)), 1});
  };
  for (int i = 0; i < count; ++i) {
    for (int k = 1; k <= 9 && i - k >= 0; ++k) add(i, i - k);
    if (i >= count / 2 && i < 3 * count / 4) {
      for (int k = -2; k <= 2; ++k) add(i, std::max(0, i - count / 2 + k));
    }
  }
  std::vector<Rigid3> start = truth;  // drift that grows along the way
  const Rigid3 bias(so3_exp({0, 0.0002, 0}), {0, 0, 0.01});
  for (std::size_t i = 1; i < start.size(); ++i) {
    start[i] = start[i - 1] * truth[i - 1].inverse() * truth[i] * bias;
  }
  std::vector<std::uint8_t> fixed(truth.size(), 0);
  fixed[0] = 1;
  std::vector<Rigid3> poses;
  for (auto _ : state) {
    poses = start;
    optimize_pose_graph(poses, fixed, edges);
  }
  double worst = 0;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    worst = std::max(worst, (poses[i].t() - truth[i].t()).norm());
  }
  state.counters["edges"] = static_cast<double>(edges.size());
  state.counters["off_m"] = worst;
  state.counters["was_off_m"] = (start.back().t() - truth.back().t()).norm();
}
BENCHMARK(graph)->Arg(1500)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace kys_slam::test

BENCHMARK_MAIN();
