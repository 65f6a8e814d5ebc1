// SPDX-License-Identifier: BSD-3-Clause
#include "calibration.h"

#include <ceres/problem.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
#include <utility>

#include "marginals.h"

namespace kys_slam {

namespace {

constexpr int kIterationsGiven = 10;              // with the given calibration
constexpr std::array kIterations = {60, 20, 20};  // of rounds with the rig free
constexpr int kMostIterations = kIterationsGiven + 60 + 20 + 20;

class Calibration {
 public:
  Calibration(std::vector<Recording>& recordings, const CalibrationOptions& options)
      : options_(options), memory_(maps_of(recordings)) {
    std::mt19937_64 random(options.seed);
    for (Recording& recording : recordings) {
      works_.push_back(std::make_unique<MapProblem>(recording.map, memory_));
      works_.back()->hold_out(options.hold_out, random);
    }
  }

  CalibrationResult run() {
    CalibrationResult result;
    result.recordings.resize(works_.size());
    solve("given calibration", false, MapProblem::kAll, kIterationsGiven, result);
    for (std::size_t m = 0; m < works_.size(); ++m) {
      result.recordings[m].before = works_[m]->residuals(true);
    }
    for (const auto& work : works_) work->set_rig(options_.start);
    for (std::size_t round = 0; round < kIterations.size() && !result.stopped; ++round) {
      // The first round has all: with the given calibration what is far off need not be wrong.
      solve("calibration", true, round == 0 ? MapProblem::kAll : MapProblem::kFarOff,
            kIterations.at(round), result);
    }
    finish(result);
    return result;
  }

 private:
  static std::vector<const MapObservations*> maps_of(const std::vector<Recording>& recordings) {
    std::vector<const MapObservations*> maps;
    for (const Recording& recording : recordings) maps.push_back(&recording.map);
    return maps;
  }

  /// Builds the problem of this round.
  void build(bool rig_free, double far_off) {
    problem_ = std::make_unique<ceres::Problem>(MapProblem::problem_options());
    problem_->AddParameterBlock(memory_.shape(), kShapeSize);
    for (const auto& work : works_) {
      work->choose(far_off);
      work->add_to(*problem_);
      if (!rig_free) problem_->SetParameterBlockConstant(work->own());
      problem_->AddResidualBlock(prior_cost<kOwnSize>(options_.prior, options_.start, own_places()),
                                 nullptr, work->own());
    }
    if (!rig_free || options_.keep_shape) problem_->SetParameterBlockConstant(memory_.shape());
    problem_->AddResidualBlock(
        prior_cost<kShapeSize>(options_.prior, options_.start, shape_places()), nullptr,
        memory_.shape());
  }

  void solve(const std::string& what, bool rig_free, double far_off, int iterations,
             CalibrationResult& result) {
    build(rig_free, far_off);
    auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    for (const auto& work : works_) work->order(*problem_, *ordering);
    ordering->AddElementToGroup(memory_.shape(), 1);
    const SolveRound round{what, iterations, kMostIterations, rig_free ? 1e-6 : 1e-4};
    result.stopped = !solve_round(*problem_, ordering, round, options_.watch, result.iterations);
  }

  /// Information of the rig's parameters from all recordings, and what follows from it.
  void finish(CalibrationResult& result) {
    std::vector<RigInformation> information;
    double chi2 = 0;
    std::int64_t freedom = 0;
    for (std::size_t m = 0; m < works_.size(); ++m) {
      MapProblem& work = *works_[m];
      information.push_back(rig_information(*problem_, work, memory_.shape()));
      chi2 += information.back().chi2;
      freedom += information.back().freedom;
      RecordingResult& r = result.recordings[m];
      r.rig.correction = work.rig();
      r.after = work.residuals(true);
      r.keyframes = work.map().T_c_w.size();
      r.landmarks = work.map().landmarks.size();
      r.observations = work.ids().size();
      work.write();
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
  BlockMemory memory_;
  std::vector<std::unique_ptr<MapProblem>> works_;  // use it
  std::unique_ptr<ceres::Problem> problem_;         // uses both
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
