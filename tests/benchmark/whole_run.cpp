// SPDX-License-Identifier: BSD-3-Clause
// whole_run LAYOUT SOLVER ARGUMENTS...: a run of run_stereo_LAYOUT (kitti, euroc) in which SOLVER
// (own, ceres) solves pose graphs and full bundle adjustments; local windows stay with our solver.
// At the end one line of JSON: calls and processor time of both, and what the whole process took.
//
// The linker puts two functions of this file in the place of the product's (--wrap, see
// CMakeLists.txt), so that the product needs no way to be told.
#include <kys_slam/run_main.h>
#include <sys/resource.h>
#include <time.h>

#include <cstdio>
#include <string>
#include <utility>
#include <vector>

#include "ceres_reference/ceres_reference.h"
#include "loop_closing/full_bundle.h"
#include "optimization/bundle_solver.h"
#include "optimization/pose_graph.h"
#include "run_program.h"

namespace kys_slam {
namespace {

struct Account {
  int calls = 0;
  double seconds = 0;  // processor time of the calling thread
};

bool use_ceres = false;
Account graph_account;   // written by the mapping thread alone
Account bundle_account;  // written by the thread of full bundle adjustment alone

double thread_seconds() {
  timespec now{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

class Stopwatch {
 public:
  explicit Stopwatch(Account& account) : account_(account), begin_(thread_seconds()) {}
  Stopwatch(const Stopwatch&) = delete;
  Stopwatch& operator=(const Stopwatch&) = delete;
  ~Stopwatch() {
    ++account_.calls;
    account_.seconds += thread_seconds() - begin_;
  }

 private:
  Account& account_;
  double begin_;
};

BundleRoundSummary solve_full_bundle(BundleProblem& problem, const BundleOptions& options,
                                     const BundleRound& round) {
  const Stopwatch stopwatch(bundle_account);
  return use_ceres ? solve_bundle_ceres(problem, options, round)
                   : solve_bundle_schur(problem, options, round);
}

int run(int argc, char** argv) {
  const std::string layout = argc > 2 ? argv[1] : "";
  const std::string solver = argc > 2 ? argv[2] : "";
  if ((layout != "kitti" && layout != "euroc") || (solver != "own" && solver != "ceres")) {
    std::fprintf(stderr, "usage: whole_run kitti|euroc own|ceres ARGUMENTS...\n");
    return kBadInput;
  }
  use_ceres = solver == "ceres";
  RunProgram program;
  program.name = "whole_run";
  program.description = "A run with a choice of solvers.";
  program.open = open_kitti_sequence;
  if (layout == "euroc") {
    program.settings = Settings::indoor();
    program.open = open_euroc_sequence;
  }
  std::vector<char*> arguments{argv[0]};
  arguments.insert(arguments.end(), argv + 3, argv + argc);
  const int status =
      run_program(std::move(program), static_cast<int>(arguments.size()), arguments.data());
  rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  std::printf(
      "{\"solver\": \"%s\", \"graphs\": %d, \"graph_s\": %.4f, \"bundle_rounds\": %d, "
      "\"bundle_s\": %.4f, \"cpu_s\": %.3f, \"peak_mb\": %.1f}\n",
      solver.c_str(), graph_account.calls, graph_account.seconds, bundle_account.calls,
      bundle_account.seconds, seconds(usage.ru_utime) + seconds(usage.ru_stime),
      1.024e-3 * static_cast<double>(usage.ru_maxrss));
  return status;
}

}  // namespace
}  // namespace kys_slam

// What the linker calls in the place of kys_slam::optimize_pose_graph and of the constructor of
// kys_slam::FullBundle (`real`: the product's).
extern "C" {
using kys_slam::FullBundle;
using kys_slam::FullBundleOptions;
using kys_slam::PoseGraphEdge;
using kys_slam::PoseGraphOptions;
using kys_slam::Rigid3;

void real_optimize_pose_graph(std::vector<Rigid3>& T_w_c, const std::vector<std::uint8_t>& fixed,
                              const std::vector<PoseGraphEdge>& edges,
                              const PoseGraphOptions& options) asm("__real_" KYS_GRAPH_SYMBOL);
void wrapped_optimize_pose_graph(std::vector<Rigid3>& T_w_c, const std::vector<std::uint8_t>& fixed,
                                 const std::vector<PoseGraphEdge>& edges,
                                 const PoseGraphOptions& options) asm("__wrap_" KYS_GRAPH_SYMBOL);
void wrapped_optimize_pose_graph(std::vector<Rigid3>& T_w_c, const std::vector<std::uint8_t>& fixed,
                                 const std::vector<PoseGraphEdge>& edges,
                                 const PoseGraphOptions& options) {
  const kys_slam::Stopwatch stopwatch(kys_slam::graph_account);
  if (kys_slam::use_ceres) {
    kys_slam::solve_pose_graph_ceres(T_w_c, fixed, edges, options.iterations);
  } else {
    real_optimize_pose_graph(T_w_c, fixed, edges, options);
  }
}

void real_full_bundle(FullBundle* self, const FullBundleOptions& options,
                      bool threaded) asm("__real_" KYS_BUNDLE_SYMBOL);
void wrapped_full_bundle(FullBundle* self, const FullBundleOptions& options,
                         bool threaded) asm("__wrap_" KYS_BUNDLE_SYMBOL);
void wrapped_full_bundle(FullBundle* self, const FullBundleOptions& options, bool threaded) {
  FullBundleOptions with_solver = options;
  with_solver.bundle.round_solver = kys_slam::solve_full_bundle;
  real_full_bundle(self, with_solver, threaded);
}
}

int main(int argc, char** argv) {
  return kys_slam::run_main("whole_run", [&] { return kys_slam::run(argc, argv); });
}
