// SPDX-License-Identifier: BSD-3-Clause
#include "system/run_tables.h"

#include <fmt/format.h>
#include <kys/label_space.h>
#include <kys_slam/run_main.h>

#include <cmath>
#include <cstdint>
#include <map>

#include "system/private_access.h"

namespace kys_slam {

std::string frames_csv(const System& system, const std::vector<FrameEstimate>& estimates) {
  constexpr std::array<const char*, kys::kTierCount> kTiers{
      "same_instance", "cross_instance", "cross_class", "bypassed", "gated", "filtered", "skipped"};
  std::string text =
      "index,name,timestamp,status,submap,reason,keyframe,loop,loop_frame,loop_distance_m,"
      "loop_gap_m,keypoints,stereo_matches,matches,inliers,prior_coverage,masked,"
      "integrity,integrity_reason";
  for (const char* tier : kTiers) text += fmt::format(",pairs_{0},accepted_{0}", tier);
  for (const Stage& stage : kStages) text += fmt::format(",ms_{}", stage.name);
  text += ",resident_mb\n";
  const FrameReports& reports = reports_of(system);
  for (std::size_t k = 0; k < estimates.size(); ++k) {
    const FrameReport& r = reports[k];
    text +=
        fmt::format("{},{},{:.9f},{},{},\"{}\",{},{},{},{:.4f},{:.4f}", r.index, csv_field(r.name),
                    r.timestamp, to_string(r.status), estimates[k].submap,
                    r.warning.empty() ? r.reason : r.reason + "; " + r.warning, r.keyframe ? 1 : 0,
                    to_string(r.loop), r.loop_frame, r.loop_distance_m, r.loop_gap_m);
    text += fmt::format(",{},{},{},{},{:.4f},{}", r.keypoints, r.stereo_matches, r.matches,
                        r.inliers, r.prior_coverage, r.masked);
    const bool has_pose = r.status != FrameStatus::kLost;
    text += fmt::format(",{},\"{}\"", has_pose ? to_string(r.integrity) : "",
                        to_string(r.integrity_reason));
    for (std::size_t t = 0; t < kys::kTierCount; ++t) {
      text += fmt::format(",{},{}", r.statistics.pairs[t], r.statistics.accepted[t]);
    }
    for (const Stage& stage : kStages) text += fmt::format(",{:.3f}", r.times.*stage.value);
    text += fmt::format(",{:.1f}\n", r.resident_mb);
  }
  return text;
}

std::string covariance_csv(const System& system) {
  constexpr std::array<const char*, 6> kNames{"rx", "ry", "rz", "tx", "ty", "tz"};
  std::string text = "index,timestamp,kind,other,x,y,z,qx,qy,qz,qw";
  for (std::size_t i = 0; i < 6; ++i) {
    for (std::size_t j = i; j < 6; ++j) text += fmt::format(",{}_{}", kNames[i], kNames[j]);
  }
  text += "\n";
  const auto add = [&](const FrameReport& r, const char* kind, const RelativePose& pose) {
    const Eigen::Vector3d& t = pose.T_other_c.translation;
    const Eigen::Quaterniond& q = pose.T_other_c.rotation;
    text +=
        fmt::format("{},{:.9f},{},{},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g}", r.index,
                    r.timestamp, kind, pose.other, t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w());
    for (int i = 0; i < 6; ++i) {
      for (int j = i; j < 6; ++j) text += fmt::format(",{:.6e}", pose.covariance(i, j));
    }
    text += "\n";
  };
  for (const FrameReport& r : reports_of(system)) {
    if (r.local) add(r, "local", *r.local);
    if (r.motion) add(r, "motion", *r.motion);
  }
  return text;
}

std::string graph_csv(const MapSnapshot& map) {
  std::map<std::uint32_t, double> timestamps;
  for (const MapSnapshot::KeyFrame& k : map.keyframes) timestamps[k.id] = k.timestamp;
  std::string text = "timestamp,other,shared_landmarks,spanning_tree,loop\n";
  for (const MapSnapshot::Edge& e : map.edges) {
    text += fmt::format("{:.9f},{:.9f},{},{:d},{:d}\n", timestamps[e.keyframe], timestamps[e.other],
                        e.shared_landmarks, e.spanning_tree, e.loop);
  }
  return text;
}

std::string objects_csv(const System& system, const std::string& label_space) {
  std::string text =
      "frame,name,timestamp,instance,class,p_moving,keypoints,x,y,z,vx,vy,vz,sigma_v\n";
  const std::vector<ObjectEstimate> objects = system.objects();
  if (objects.empty()) return text;
  const kys::LabelSpace labels = kys::load_label_space(label_space);
  const FrameReports& reports = reports_of(system);
  for (const ObjectEstimate& o : objects) {
    const FrameReport& report = reports.at(static_cast<std::size_t>(o.frame));
    text += fmt::format("{},{},{:.9f},{},{},{:.4f},{}", report.index, csv_field(report.name),
                        report.timestamp, o.instance, csv_field(labels.at(o.label).name),
                        o.p_moving, o.keypoints);
    text += fmt::format(",{:.4f},{:.4f},{:.4f},{:.4f},{:.4f},{:.4f},{:.4f}\n", o.position.x(),
                        o.position.y(), o.position.z(), o.velocity.x(), o.velocity.y(),
                        o.velocity.z(), std::sqrt(o.velocity_covariance.trace()));
  }
  return text;
}

}  // namespace kys_slam
