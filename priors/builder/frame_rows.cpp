// SPDX-License-Identifier: BSD-3-Clause
#include "priors/builder/frame_rows.h"

#include <kys_slam/prior_format.h>
#include <kys_slam/run_main.h>
#include <kys_slam/util/parse_number.h>
#include <kys_slam/util/read_bytes.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstring>
#include <limits>
#include <sstream>

namespace kys_slam {

const char* const kSegmentsHeader =
    "frame,camera,input_id,part,identity,label,area_px,mean_depth_m,residual_px,radial_px,coverage,"
    "omega,magnitude_test,radial_test,rho,m,valid,median_px,coherent_px,scatter_px,parallax_px,"
    "disparity_px,keypoints,keypoint_inliers,keypoint_log_ratio,keypoint_span_s,"
    "keypoint_shift_m,keypoint_shift_px,patches,flow_patches,still_alike,flow_alike,"
    "place_occupied,place_free,place_hidden,place_span_s,"
    "evidence_flow,evidence_appearance,evidence_keypoints,evidence_space,evidence,state,log_odds\n";
const char* const kBackgroundHeader =
    "frame,camera,model,samples,fit_residual_px,m_bg_px,mu_par_px,sigma_par_px,stuff_px,"
    "p1,p2,p3,p4,p5,p6,p7,p8\n";

std::string table_rows(const std::string& name, std::size_t c, const CameraFusion& f) {
  const std::string frame = csv_field(name);
  const char* camera = c == 0 ? "left" : "right";
  std::string rows;
  char line[1024];
  for (std::size_t k = 0; k < f.segments.size(); ++k) {
    const InputSegment& s = f.segments[k];
    if (!s.thing) continue;
    const SegmentStatistics& m = f.statistics[k];
    const MotionDecision& d = f.decisions[k];
    std::snprintf(
        line, sizeof line,
        ",%s,%u,%u,%d,%u,%u,%.4f,%.4f,%.4f,%.4f,%.4f,%d,%d,%.4f,%.4f,%.4f,%.4f,%.4f,%.4f,"
        "%.4f,%.4f,%d,%d,%.4f,%.4f,%.4f,%.4f,%d,%d,%.4f,%.4f,%d,%d,%d,%.4f,%.3f,%.3f,%.3f,%.3f,"
        "%.17g,%s,%.17g\n",
        camera, s.input_id, s.part, f.priors.segments[k].instance, s.label, m.area, m.mean_depth,
        m.residual, m.radial, m.coverage, d.omega, d.magnitude_test, d.radial_test, d.rho, d.score,
        m.area > 0 ? static_cast<double>(m.flow_count) / m.area : 0.0, m.median.length,
        m.median.coherent, m.median.scatter, m.median.parallax, m.median.disparity,
        m.keypoints.matches, m.keypoints.inliers, m.keypoints.log_ratio, m.keypoints.span,
        m.keypoints.shift, m.keypoints.pixels, m.appearance.patches, m.appearance.flow_patches,
        m.appearance.still, m.appearance.flow, m.space.occupied, m.space.free, m.space.hidden,
        m.space.span, d.evidence_flow, d.evidence_appearance, d.evidence_keypoints,
        d.evidence_space, d.evidence,
        d.dynamic  ? "moving"
        : d.judged ? "static"
                   : "not_judged",
        d.log_odds);
    rows += "S" + frame + line;
  }
  if (!f.ego_motion) return rows;
  const EgoMotion& e = *f.ego_motion;
  std::array<double, 8> p = e.c;
  if (e.model == EgoMotionModel::kSe3) {
    const Eigen::Vector3d w = so3_log(e.T_next_now.rotation), v = e.T_next_now.t();
    p = {w.x(), w.y(), w.z(), v.x(), v.y(), v.z(), 0, 0};
  }
  static constexpr const char* kNames[] = {"se3", "rigid", "as_printed"};
  std::snprintf(line, sizeof line,
                ",%s,%s,%d,%.4f,%.4f,%.4f,%.4f,%.0f,%.8g,%.8g,%.8g,%.8g,%.8g,%.8g,%.8g,%.8g\n",
                camera, kNames[static_cast<std::size_t>(e.model)], e.samples, e.mean_residual,
                f.background.m_bg, f.background.mu_par, f.background.sigma_par, f.background.pixels,
                p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7]);
  return rows + "B" + frame + line;
}

std::string pack_rows(std::uint64_t key, const std::string& rows) {
  char line[64];
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(rows.data());
  std::snprintf(line, sizeof line, "%016llx %08x\n", static_cast<unsigned long long>(key),
                static_cast<unsigned>(prior_format::crc32(bytes, rows.size())));
  return line + rows;
}

std::optional<std::string> unpack_rows(const std::filesystem::path& path, std::uint64_t key) {
  const std::string text = read_text(path);
  const std::size_t end = text.find('\n');
  if (end == std::string::npos) return std::nullopt;
  std::string rows = text.substr(end + 1);
  if (pack_rows(key, rows) != text) return std::nullopt;
  return rows;
}

std::optional<InstanceEvidence> evidence_of(const std::string& rows) {
  // Fields are counted from the end: a name may have commas in it.
  static const auto kFields = static_cast<std::size_t>(
      std::count(kSegmentsHeader, kSegmentsHeader + std::strlen(kSegmentsHeader), ',') + 1);
  InstanceEvidence evidence;
  std::istringstream lines(rows);
  for (std::string row; std::getline(lines, row);) {
    if (row.empty() || row[0] != 'S') continue;
    std::vector<std::string> fields;
    std::istringstream in(row);
    for (std::string field; std::getline(in, field, ',');) fields.push_back(field);
    if (fields.size() < kFields) return std::nullopt;
    const auto instance = parse_int(fields[fields.size() - kFields + 4]);
    const auto nats = parse_double(fields[fields.size() - 3]);
    constexpr std::int64_t kMost = std::numeric_limits<std::int32_t>::max();
    if (!instance || *instance < 0 || *instance > kMost || !nats) return std::nullopt;
    evidence.emplace_back(static_cast<std::int32_t>(*instance), *nats);
  }
  return evidence;
}

}  // namespace kys_slam
