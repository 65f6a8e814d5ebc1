// SPDX-License-Identifier: BSD-3-Clause
// Figures of evo 1.x, the evaluator the field uses, made with (-a for SE(3), -as for Sim(3)):
//   evo_ape {kitti|euroc|tum} REFERENCE ESTIMATE [-a|-as]
//   evo_rpe {kitti|euroc|tum} REFERENCE ESTIMATE [-a|-as] -r trans_part -d DELTA -u f [--all_pairs]
//   evo_rpe ...                                           -r angle_deg  -d DELTA -u f
#include <gtest/gtest.h>
#include <kys_slam/evaluation.h>
#include <kys_slam/trajectory_file.h>

#include "temporary_folder.h"

namespace kys_slam {
namespace {

constexpr double kTolerance = 1e-6;  // m, degrees

void expect_equal(const Statistics& ours, const Statistics& evo) {
  EXPECT_EQ(ours.count, evo.count);
  EXPECT_NEAR(ours.rmse, evo.rmse, kTolerance);
  EXPECT_NEAR(ours.mean, evo.mean, kTolerance);
  EXPECT_NEAR(ours.median, evo.median, kTolerance);
  EXPECT_NEAR(ours.std, evo.std, kTolerance);
  EXPECT_NEAR(ours.min, evo.min, kTolerance);
  EXPECT_NEAR(ours.max, evo.max, kTolerance);
}

struct Figures {
  Alignment alignment;
  Statistics ate, rpe_translation;
};

std::vector<TimedPose> read_kitti(const std::filesystem::path& path) {
  std::vector<TimedPose> poses;
  for (const Rigid3& pose : read_kitti_poses(path)) {
    poses.push_back({static_cast<double>(poses.size()), pose});
  }
  return poses;
}

void check(const std::vector<TimedPose>& reference, const std::vector<TimedPose>& estimate,
           const std::vector<Figures>& figures, const Statistics& rotation) {
  for (const Figures& evo : figures) {
    SCOPED_TRACE(static_cast<int>(evo.alignment));
    const Evaluation ours = evaluate(reference, estimate, {.alignment = evo.alignment});
    expect_equal(ours.ate, evo.ate);
    expect_equal(ours.rpe_translation, evo.rpe_translation);
    expect_equal(ours.rpe_rotation, rotation);
  }
}

TEST(EvoFigures, Kitti00OrbSlam2) {
  const auto data = shared_data() / "trajectories";
  if (!std::filesystem::exists(data)) GTEST_SKIP() << "no " << data;
  const Statistics relative{4540,
                            0.0281203770174,
                            0.0193013109814,
                            0.0147090434386,
                            0.0204503055723,
                            0.000312400263098,
                            0.302712490595};
  check(
      read_kitti(data / "KITTI_00_gt.txt"), read_kitti(data / "KITTI_00_ORB.txt"),
      {{Alignment::kNone,
        {4541, 7.79028888266, 7.01175040167, 6.80163167456, 3.39469544731, 4.0e-09, 13.4585088074},
        relative},
       {Alignment::kSe3,
        {4541, 1.30344971457, 1.15699712854, 1.06562476956, 0.600282269397, 0.0693132202148,
         3.58794912068},
        relative},
       {Alignment::kSim3,
        {4541, 0.937709073611, 0.872692631969, 0.844691013486, 0.343082900827, 0.17951466688,
         2.69349986361},
        {4540, 0.0278224533436, 0.0189529739853, 0.0143756955169, 0.0203684483249,
         0.000235753891923, 0.304399846612}}},
      {4540, 0.11497352126, 0.0595834549231, 0.0410744052753, 0.0983296623115, 0.00224355377588,
       2.19661540694});
}

TEST(EvoFigures, Kitti00Sptam) {
  const auto data = shared_data() / "trajectories";
  if (!std::filesystem::exists(data)) GTEST_SKIP() << "no " << data;
  const Statistics relative{4540,
                            0.0349193675732,
                            0.0234064506249,
                            0.0191599367727,
                            0.0259133228449,
                            0.000969761330517,
                            1.13607358952};
  check(read_kitti(data / "KITTI_00_gt.txt"), read_kitti(data / "KITTI_00_SPTAM.txt"),
        {{Alignment::kNone,
          {4541, 9.22454173724, 8.62370355519, 8.28232140963, 3.27473773824, 0, 14.9118232277},
          relative},
         {Alignment::kSe3,
          {4541, 3.73848790758, 3.49097663308, 3.64258464174, 1.3376748418, 0.694787347406,
           7.76897740657},
          relative},
         {Alignment::kSim3,
          {4541, 3.63529356434, 3.35730577862, 3.4798637553, 1.39422279703, 0.226992813948,
           7.29183102798},
          {4540, 0.0350172529758, 0.0235201770229, 0.0192395075002, 0.0259424223768, 0.001021163033,
           1.13607358952}}},
        {4540, 0.296389843246, 0.241716405113, 0.201018442208, 0.171522939218, 0.00405292071177,
         2.50355519188});
}

TEST(EvoFigures, StepsOfTenFramesOnKitti00) {
  const auto data = shared_data() / "trajectories";
  if (!std::filesystem::exists(data)) GTEST_SKIP() << "no " << data;
  const auto reference = read_kitti(data / "KITTI_00_gt.txt");
  const auto estimate = read_kitti(data / "KITTI_00_ORB.txt");
  expect_equal(evaluate(reference, estimate, {.rpe_delta = 10}).rpe_translation,
               {454, 0.19400775758, 0.141510494874, 0.111259274244, 0.132716953859, 0.0166574118226,
                1.18853491275});
  expect_equal(
      evaluate(reference, estimate, {.rpe_delta = 10, .rpe_all_steps = true}).rpe_translation,
      {4531, 0.189348230386, 0.139782268495, 0.113219491692, 0.127724977058, 0.00460055788721,
       1.51538327055});
}

TEST(EvoFigures, EurocV102) {
  const auto data = shared_data() / "trajectories";
  if (!std::filesystem::exists(data)) GTEST_SKIP() << "no " << data;
  const Statistics relative{797,
                            0.0150767101596,
                            0.00610692246538,
                            0.00418393933606,
                            0.013784508959,
                            0.000114695026533,
                            0.217408924427};
  check(read_euroc_poses(data / "V102_groundtruth.csv"),
        read_tum_poses(data / "V102.txt", Stamps::kMayRepeat),
        {{Alignment::kNone,
          {798, 2.55417404622, 2.50728788846, 2.37786067816, 0.487147311123, 1.75210542617,
           3.65515203181},
          relative},
         {Alignment::kSe3,
          {798, 0.0917271152069, 0.0815216219462, 0.0779119490195, 0.0420486482474,
           0.00261998709738, 0.255816733814},
          relative},
         {Alignment::kSim3,
          {798, 0.083841388043, 0.0748410847826, 0.0719451786662, 0.0377914061332, 0.00700029057942,
           0.226651792383},
          {797, 0.0147106546425, 0.00602270151797, 0.00435835091841, 0.0134212676911,
           0.000109160190085, 0.213029091382}}},
        {797, 0.357615594886, 0.0898756007484, 0.0330300325121, 0.34613767506, 0.00306774663294,
         4.93915496025});
}

/// Made-up trajectories that are always there: another rate, missing poses, jitter of the stamps, a
/// pose too far from any stamp, a scale of 1.03 and noise.
TEST(EvoFigures, MadeUpTrajectories) {
  const std::filesystem::path data =
      std::filesystem::path(KYS_SOURCE_DIR) / "tests/evaluation/data";
  const auto reference = read_tum_poses(data / "reference.tum");
  const auto estimate = read_tum_poses(data / "estimate.tum");
  const Statistics relative{125,
                            0.125532030424,
                            0.117202632021,
                            0.114405652062,
                            0.044964805233,
                            0.0371019566193,
                            0.251287337404};
  check(reference, estimate,
        {{Alignment::kNone,
          {126, 24.463308591, 23.6738489472, 26.3579020847, 6.16460406225, 8.30176534768,
           29.6573143476},
          relative},
         {Alignment::kSe3,
          {126, 0.813614686438, 0.793373832136, 0.746348285987, 0.180351935034, 0.497410139371,
           1.14516782433},
          relative},
         {Alignment::kSim3,
          {126, 0.0853112628609, 0.0792934348891, 0.0783789260796, 0.0314732069294, 0.0172068066257,
           0.153574215292},
          {125, 0.117337555505, 0.108825522927, 0.101211401913, 0.043876046901, 0.0160388957962,
           0.248719742636}}},
        {125, 0.566801954019, 0.527452800658, 0.533135596465, 0.207504212386, 0.10307495743,
         1.13619978048});
  const Evaluation five = evaluate(reference, estimate, {.rpe_delta = 5});
  expect_equal(five.rpe_translation, {25, 0.190931500641, 0.18170529233, 0.184202514795,
                                      0.0586346712823, 0.06519920256, 0.305179333974});
  expect_equal(five.rpe_rotation, {25, 0.559074108392, 0.507040220875, 0.4978008093, 0.235529346556,
                                   0.161180084529, 1.00825741447});
  expect_equal(evaluate(reference, estimate,
                        {.alignment = Alignment::kNone, .rpe_delta = 5, .rpe_all_steps = true})
                   .rpe_translation,
               {121, 0.197895952114, 0.186516224818, 0.189002736494, 0.0661400464375,
                0.0448260485686, 0.35158130628});
}

}  // namespace
}  // namespace kys_slam
