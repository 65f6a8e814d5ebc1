#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>

#include "optimization/bundle_adjustment.h"
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
void bundle(benchmark::State& state, BundleSolver solver) {
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
  bundle_options.solver = solver;
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
BENCHMARK_CAPTURE(bundle, schur, BundleSolver::kSchur)
    ->Args({16, 6, 1800, 3})
    ->Args({25, 10, 2600, 3})
    ->Args({25, 10, 2600, 4})
    ->Args({25, 10, 2600, 5})
    ->Args({25, 10, 2600, 6})
    ->Args({35, 15, 3800, 3})
    ->Args({120, 1, 12000, 4})
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(bundle, ceres, BundleSolver::kCeres)
    ->Args({16, 6, 1800, 3})
    ->Args({25, 10, 2600, 3})
    ->Args({35, 15, 3800, 3})
    ->Args({120, 1, 12000, 4})
    ->Args({500, 1, 50000, 4})
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace kys_slam::test

BENCHMARK_MAIN();
