// SPDX-License-Identifier: BSD-3-Clause
#include "calibration.h"

#include <ceres/iteration_callback.h>
#include <ceres/loss_function.h>
#include <ceres/normal_prior.h>
#include <ceres/problem.h>
#include <ceres/solver.h>
#include <kys_slam/rig_rows.h>
#include <kys_slam/util/median.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
#include <utility>

#include "marginals.h"

namespace kys_slam {

namespace {

constexpr double kHuber = 0.7;  // delta: errors are about half of what the deviations allow
constexpr double kFarOff = 25;  // chi2 beyond which an observation is left out of a round
constexpr double kGaussian = 1.4826;
// The first round has all: with the given calibration what is far off need not be wrong.
constexpr double kAll = 1e30;
constexpr int kIterationsGiven = 10;              // with the given calibration
constexpr std::array kIterations = {60, 20, 20};  // of rounds with the rig free
constexpr int kMostIterations = kIterationsGiven + 60 + 20 + 20;
constexpr int kLeastObservers = 2;  // of a landmark, without those held out

/// A recording in the form that Ceres works on.
struct Work {
  MapObservations* map = nullptr;
  std::vector<PoseBlock> poses;
  Own own = Own::Zero();
  std::vector<std::uint8_t> held_out;  // per observation
  std::vector<std::uint8_t> active;    // per observation: used in this round
};

class Iterations final : public ceres::IterationCallback {
 public:
  Iterations(const CalibrationOptions& options, std::string what, int done)
      : options_(options), what_(std::move(what)), done_(done) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& summary) override {
    if (options_.progress) options_.progress(done_ + summary.iteration, kMostIterations, what_);
    const bool stop = options_.stop != nullptr && options_.stop->load(std::memory_order_relaxed);
    return stop ? ceres::SOLVER_TERMINATE_SUCCESSFULLY : ceres::SOLVER_CONTINUE;
  }

 private:
  const CalibrationOptions& options_;
  std::string what_;
  int done_;
};

template <typename Cost>
void for_each_observation(const MapObservations& map, Cost&& f) {
  for (std::size_t k = 0; k < map.landmarks.size(); ++k) {
    for (auto i = static_cast<std::size_t>(map.first[k]);
         i < static_cast<std::size_t>(map.first[k + 1]); ++i) {
      f(k, i);
    }
  }
}

/// Deterministic: the same seed and maps give the same choice.
void choose_held_out(Work& work, double share, std::mt19937_64& random) {
  const MapObservations& map = *work.map;
  work.held_out.assign(map.observations.size(), 0);
  const double most = share * 1e6;
  for (std::size_t k = 0; k < map.landmarks.size(); ++k) {
    int left = map.first[k + 1] - map.first[k];
    for (auto i = static_cast<std::size_t>(map.first[k]);
         i < static_cast<std::size_t>(map.first[k + 1]); ++i) {
      const bool chosen = static_cast<double>(random() % 1000000) < most;
      if (!chosen || left <= kLeastObservers) continue;
      work.held_out[i] = 1;
      --left;
    }
  }
}

template <int kBlock>
ceres::CostFunction* prior_cost(const RigCorrection::Covariance& covariance,
                                const RigCorrection::Parameters& mean,
                                const std::array<int, kBlock>& places) {
  Eigen::Matrix<double, kBlock, kBlock> block;
  ceres::Vector centre(kBlock);
  for (int a = 0; a < kBlock; ++a) {
    const int from = places.at(static_cast<std::size_t>(a));
    centre[a] = mean[from];
    for (int b = 0; b < kBlock; ++b) {
      block(a, b) = covariance(from, places.at(static_cast<std::size_t>(b)));
    }
  }
  const Eigen::Matrix<double, kBlock, kBlock> L = block.llt().matrixL();
  return new ceres::NormalPrior(ceres::Matrix(L.inverse()), centre);
}

class Calibration {
 public:
  Calibration(std::vector<Recording>& recordings, const CalibrationOptions& options)
      : options_(options) {
    std::mt19937_64 random(options.seed);
    for (Recording& recording : recordings) {
      Work work;
      work.map = &recording.map;
      for (const Rigid3& T : recording.map.T_c_w) work.poses.push_back(to_block(T));
      choose_held_out(work, options.hold_out, random);
      works_.push_back(std::move(work));
    }
  }

  CalibrationResult run() {
    CalibrationResult result;
    result.recordings.resize(works_.size());
    solve("given calibration", false, kAll, kIterationsGiven, result);
    for (std::size_t m = 0; m < works_.size(); ++m) {
      result.recordings[m].before = held_out(works_[m]);
    }
    start_rig();
    for (std::size_t round = 0; round < kIterations.size() && !result.stopped; ++round) {
      solve("calibration", true, round == 0 ? kAll : kFarOff, kIterations.at(round), result);
    }
    finish(result);
    return result;
  }

 private:
  void start_rig() {
    for (int k = 0; k < kShapeSize; ++k) {
      shape_[k] = options_.start[shape_places().at(static_cast<std::size_t>(k))];
    }
    for (Work& work : works_) {
      for (int k = 0; k < kOwnSize; ++k) {
        work.own[k] = options_.start[own_places().at(static_cast<std::size_t>(k))];
      }
    }
  }

  [[nodiscard]] RigCorrection rig(const Work& work) const {
    return {work.map->camera, join(shape_.data(), work.own.data())};
  }

  /// Predicted less measured (u, v, disparity, row), px; NaN where nothing is measured.
  [[nodiscard]] Eigen::Vector4d residual(const Work& work, const RigCorrection& rig,
                                         std::size_t landmark, std::size_t i) const {
    const MapObservations::Observation& o = work.map->observations[i];
    const Eigen::Vector3d p_c =
        to_pose(work.poses[o.keyframe].data()) * work.map->landmarks[landmark];
    if (p_c.z() < kNearest) return Eigen::Vector4d::Constant(std::nan(""));
    return predict(work.map->camera, rig, p_c, false).value - measured_values(o.measured);
  }

  /// Leaves out what is far off, behind the camera, or of a landmark that few views remain of.
  void choose(Work& work, double far_off) const {
    const RigCorrection rig = this->rig(work);
    const MapObservations& map = *work.map;
    work.active.assign(map.observations.size(), 0);
    for_each_observation(map, [&](std::size_t k, std::size_t i) {
      if (work.held_out[i] != 0) return;
      Eigen::Vector4d e = residual(work, rig, k, i);
      e = e.cwiseProduct(inverse_deviations(map, map.observations[i]));
      if (!std::isfinite(e[0])) return;
      const double disparity = std::isfinite(e[2]) ? e[2] * e[2] : 0;
      work.active[i] = e.head<2>().squaredNorm() + disparity < far_off ? 1 : 0;
    });
    for (std::size_t k = 0; k < map.landmarks.size(); ++k) {
      const auto begin = work.active.begin() + map.first[k];
      const auto end = work.active.begin() + map.first[k + 1];
      if (std::count(begin, end, 1) < kLeastObservers) std::fill(begin, end, std::uint8_t{0});
    }
  }

  void add(Work& work, ceres::Problem& problem, std::vector<ceres::ResidualBlockId>& ids) {
    MapObservations& map = *work.map;
    for_each_observation(map, [&](std::size_t k, std::size_t i) {
      if (work.active[i] == 0) return;
      const MapObservations::Observation& o = map.observations[i];
      const Eigen::Vector4d inv_sigma = inverse_deviations(map, o);
      ceres::CostFunction* cost = nullptr;
      if (std::isnan(o.measured.u_right)) {
        cost = new MeasuredCost<2>(&map.camera, o.measured, inv_sigma);
      } else if (std::isnan(o.measured.v_right)) {
        cost = new MeasuredCost<3>(&map.camera, o.measured, inv_sigma);
      } else {
        cost = new MeasuredCost<4>(&map.camera, o.measured, inv_sigma);
      }
      ids.push_back(problem.AddResidualBlock(cost, &loss_, work.poses[o.keyframe].data(),
                                             map.landmarks[k].data(), shape_.data(),
                                             work.own.data()));
    });
    for (std::size_t k = 0; k < work.poses.size(); ++k) {
      double* pose = work.poses[k].data();
      if (!problem.HasParameterBlock(pose)) continue;
      problem.SetManifold(pose, &manifold_);
      if (map.held[k] != 0) problem.SetParameterBlockConstant(pose);
    }
  }

  /// Builds the problem of this round.
  void build(bool rig_free, double far_off) {
    ceres::Problem::Options ours;
    ours.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    ours.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    problem_ = std::make_unique<ceres::Problem>(ours);
    ids_.assign(works_.size(), {});
    problem_->AddParameterBlock(shape_.data(), kShapeSize);
    for (std::size_t m = 0; m < works_.size(); ++m) {
      Work& work = works_[m];
      choose(work, far_off);
      problem_->AddParameterBlock(work.own.data(), kOwnSize);
      add(work, *problem_, ids_[m]);
      if (!rig_free) problem_->SetParameterBlockConstant(work.own.data());
      problem_->AddResidualBlock(prior_cost<kOwnSize>(options_.prior, options_.start, own_places()),
                                 nullptr, work.own.data());
    }
    if (!rig_free || options_.keep_shape) problem_->SetParameterBlockConstant(shape_.data());
    problem_->AddResidualBlock(
        prior_cost<kShapeSize>(options_.prior, options_.start, shape_places()), nullptr,
        shape_.data());
  }

  std::shared_ptr<ceres::ParameterBlockOrdering> points_first() {
    auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    for (Work& work : works_) {
      for (Eigen::Vector3d& p : work.map->landmarks) {
        if (problem_->HasParameterBlock(p.data())) ordering->AddElementToGroup(p.data(), 0);
      }
      for (PoseBlock& pose : work.poses) {
        if (problem_->HasParameterBlock(pose.data())) ordering->AddElementToGroup(pose.data(), 1);
      }
      ordering->AddElementToGroup(work.own.data(), 1);
    }
    ordering->AddElementToGroup(shape_.data(), 1);
    return ordering;
  }

  void solve(const std::string& what, bool rig_free, double far_off, int iterations,
             CalibrationResult& result) {
    build(rig_free, far_off);
    Iterations callback(options_, what, result.iterations);
    ceres::Solver::Options solver;
    solver.logging_type = ceres::SILENT;
    solver.num_threads = 1;
    solver.linear_solver_type = ceres::SPARSE_SCHUR;
    solver.sparse_linear_algebra_library_type = ceres::SUITE_SPARSE;
    solver.linear_solver_ordering = points_first();
    solver.max_num_iterations = iterations;
    solver.max_solver_time_in_seconds = 1e9;
    solver.function_tolerance = rig_free ? 1e-6 : 1e-4;
    solver.parameter_tolerance = 1e-13;  // of the norm of all points: the default ends too early
    solver.callbacks.push_back(&callback);
    ceres::Solver::Summary summary;
    ceres::Solve(solver, problem_.get(), &summary);
    result.iterations += std::max(0, static_cast<int>(summary.iterations.size()) - 1);
    result.stopped = summary.termination_type == ceres::USER_SUCCESS;
  }

  [[nodiscard]] HeldOut held_out(const Work& work) const {
    std::array<std::vector<double>, 4> magnitudes;
    const RigCorrection rig = this->rig(work);
    for_each_observation(*work.map, [&](std::size_t k, std::size_t i) {
      if (work.held_out[i] == 0) return;
      const Eigen::Vector4d e = residual(work, rig, k, i) / work.map->observations[i].scale;
      for (std::size_t c = 0; c < 4; ++c) {
        if (const double value = e[static_cast<Eigen::Index>(c)]; std::isfinite(value)) {
          magnitudes.at(c).push_back(std::abs(value));
        }
      }
    });
    HeldOut result;
    for (std::size_t c = 0; c < 4; ++c) {
      std::vector<double>& values = magnitudes.at(c);
      result.count.at(c) = values.size();
      if (!values.empty()) result.sigma[static_cast<Eigen::Index>(c)] = kGaussian * median(values);
    }
    return result;
  }

  /// Information of the rig's parameters from all recordings, and what follows from it.
  void finish(CalibrationResult& result) {
    std::vector<RigInformation> information;
    double chi2 = 0;
    std::int64_t freedom = 0;
    for (std::size_t m = 0; m < works_.size(); ++m) {
      Work& work = works_[m];
      information.push_back(rig_information(*problem_, ids_[m], work.map->landmarks, work.poses,
                                            shape_.data(), work.own.data()));
      chi2 += information.back().chi2;
      freedom += information.back().freedom;
      RecordingResult& r = result.recordings[m];
      r.rig.correction = rig(work);
      r.after = held_out(work);
      r.keyframes = work.poses.size();
      r.landmarks = work.map->landmarks.size();
      r.observations = ids_[m].size();
      for (std::size_t k = 0; k < work.poses.size(); ++k) {
        work.map->T_c_w[k] = to_pose(work.poses[k].data());
      }
    }
    result.unit = std::sqrt(chi2 / static_cast<double>(std::max<std::int64_t>(1, freedom)));
    const auto size = static_cast<Eigen::Index>(kShapeSize + kOwnSize * works_.size());
    Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(size, size);
    add_prior(sum);
    // The prior is as it is; what was measured is as good as its residuals.
    const double variance = result.unit * result.unit;
    for (std::size_t m = 0; m < works_.size(); ++m) {
      const auto own = static_cast<Eigen::Index>(kShapeSize + kOwnSize * m);
      const RigCorrection::Covariance H = information[m].H / variance;
      sum.topLeftCorner<kShapeSize, kShapeSize>() += H.topLeftCorner<kShapeSize, kShapeSize>();
      sum.block<kShapeSize, kOwnSize>(0, own) += H.topRightCorner<kShapeSize, kOwnSize>();
      sum.block<kOwnSize, kShapeSize>(own, 0) += H.bottomLeftCorner<kOwnSize, kShapeSize>();
      sum.block<kOwnSize, kOwnSize>(own, own) += H.bottomRightCorner<kOwnSize, kOwnSize>();
    }
    if (options_.keep_shape) sum.topLeftCorner<kShapeSize, kShapeSize>().diagonal().array() += 1e18;
    const Eigen::MatrixXd covariance = sum.llt().solve(Eigen::MatrixXd::Identity(size, size));
    for (std::size_t m = 0; m < works_.size(); ++m) {
      result.recordings[m].rig.covariance = of_recording(covariance, m);
    }
  }

  /// The covariance of all parameters in one recording.
  [[nodiscard]] static RigCorrection::Covariance of_recording(const Eigen::MatrixXd& covariance,
                                                              std::size_t recording) {
    std::array<Eigen::Index, RigCorrection::kSize> from{};  // by place
    for (int k = 0; k < kShapeSize; ++k) {
      from.at(static_cast<std::size_t>(shape_places().at(static_cast<std::size_t>(k)))) = k;
    }
    for (std::size_t k = 0; k < own_places().size(); ++k) {
      from.at(static_cast<std::size_t>(own_places().at(k))) =
          static_cast<Eigen::Index>(kShapeSize + kOwnSize * recording + k);
    }
    RigCorrection::Covariance result;
    for (int a = 0; a < RigCorrection::kSize; ++a) {
      for (int b = 0; b < RigCorrection::kSize; ++b) {
        result(a, b) =
            covariance(from.at(static_cast<std::size_t>(a)), from.at(static_cast<std::size_t>(b)));
      }
    }
    return result;
  }

  void add_prior(Eigen::MatrixXd& sum) const {
    const RigCorrection::Covariance inverse = options_.prior.inverse();
    const auto put = [&](const auto& places, Eigen::Index from) {
      for (std::size_t a = 0; a < places.size(); ++a) {
        for (std::size_t b = 0; b < places.size(); ++b) {
          sum(from + static_cast<Eigen::Index>(a), from + static_cast<Eigen::Index>(b)) +=
              inverse(places[a], places[b]);
        }
      }
    };
    put(shape_places(), 0);
    for (std::size_t m = 0; m < works_.size(); ++m) {
      put(own_places(), static_cast<Eigen::Index>(kShapeSize + kOwnSize * m));
    }
  }

  const CalibrationOptions& options_;
  std::vector<Work> works_;
  Shape shape_ = Shape::Zero();
  ceres::HuberLoss loss_{kHuber};
  PoseManifold manifold_;
  std::unique_ptr<ceres::Problem> problem_;               // uses the three above
  std::vector<std::vector<ceres::ResidualBlockId>> ids_;  // per recording
};

}  // namespace

RigEstimate CalibrationResult::estimate(const StereoCamera& given,
                                        const RigCorrection::Covariance& prior) const {
  const RigEstimate& one = recordings.front().rig;
  RigCorrection::Parameters parameters = one.correction.parameters();
  RigEstimate result;
  result.covariance = one.covariance;
  for (const int place : own_places()) {
    parameters[place] = 0;
    for (const RecordingResult& r : recordings) {
      parameters[place] += r.rig.correction.parameters()[place];
    }
    parameters[place] /= static_cast<double>(recordings.size());
    result.covariance.row(place).setZero();
    result.covariance.col(place).setZero();
    result.covariance(place, place) = prior(place, place);
  }
  result.correction = RigCorrection(given, parameters);
  return result;
}

CalibrationResult calibrate(std::vector<Recording>& recordings, const CalibrationOptions& options) {
  return Calibration(recordings, options).run();
}

}  // namespace kys_slam
