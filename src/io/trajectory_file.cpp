// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/trajectory_file.h>
#include <kys_slam/util/atomic_file.h>
#include <kys_slam/util/text_table.h>

#include <cstdio>

namespace kys_slam {
namespace fs = std::filesystem;
namespace {

/// Nine decimals; what rounds to zero has no sign, so that -1e-17 and 1e-17 give the same bytes.
void append_number(std::string& text, double value, char separator) {
  if (std::abs(value) < 0.5e-9) value = 0.0;
  char buffer[400];
  const int length = std::snprintf(buffer, sizeof buffer, "%.9f", value);
  text.append(buffer, static_cast<std::size_t>(length));
  text += separator;
}

/// Squares of positions, and sums of them, have to be numbers.
void check_position(const TextTable& table, const TextRow& row, const Eigen::Vector3d& t) {
  constexpr double kFar = 1e9;  // m
  if (!(t.cwiseAbs().maxCoeff() < kFar)) table.fail(row, "a position 1e9 m away or farther");
}

Rigid3 pose_from_row(const TextTable& table, const TextRow& row, std::size_t qw, std::size_t qx) {
  const Eigen::Vector3d t(table.number(row, 1), table.number(row, 2), table.number(row, 3));
  check_position(table, row, t);
  const Eigen::Quaterniond q(table.number(row, qw), table.number(row, qx),
                             table.number(row, qx + 1), table.number(row, qx + 2));
  if (std::abs(q.norm() - 1.0) > 1e-2) table.fail(row, "quaternion is not of unit length");
  return {q, t};
}

void push_pose(const TextTable& table, const TextRow& row, const TimedPose& pose, Stamps stamps,
               std::vector<TimedPose>& poses) {
  if (!poses.empty()) {
    const double before = poses.back().timestamp;
    if (pose.timestamp < before || (stamps == Stamps::kIncrease && pose.timestamp == before)) {
      table.fail(row, "time stamps do not increase");
    }
  }
  poses.push_back(pose);
}

void require_columns(const TextTable& table, const TextRow& row, std::size_t least,
                     std::size_t most) {
  if (row.fields.size() < least || row.fields.size() > most) {
    table.fail(row,
               std::to_string(row.fields.size()) + " columns instead of " + std::to_string(least));
  }
}

}  // namespace

std::optional<Rigid3> rigid_from_row_major(const double* values) {
  const Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>> M(values);
  if (!M.allFinite()) return std::nullopt;
  const Eigen::Matrix3d R = M.leftCols<3>();
  if ((R.transpose() * R - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() > 1e-3 ||
      R.determinant() < 0) {
    return std::nullopt;
  }
  return Rigid3(R, Eigen::Vector3d(M.col(3)));
}

std::vector<Rigid3> read_kitti_poses(const fs::path& path) {
  const TextTable table(path);
  std::vector<Rigid3> poses;
  for (const TextRow& row : table.rows()) {
    require_columns(table, row, 12, 12);
    const auto pose = rigid_from_row_major(table.numbers(row).data());
    if (!pose) table.fail(row, "not a rotation matrix");
    check_position(table, row, pose->t());
    poses.push_back(*pose);
  }
  return poses;
}

std::vector<TimedPose> read_tum_poses(const fs::path& path, Stamps stamps) {
  const TextTable table(path, TableStyle::kSpreadsheet);
  std::vector<TimedPose> poses;
  for (const TextRow& row : table.rows()) {
    require_columns(table, row, 8, 8);
    push_pose(table, row, {table.number(row, 0), pose_from_row(table, row, 7, 4)}, stamps, poses);
  }
  return poses;
}

std::vector<TimedPose> read_euroc_poses(const fs::path& path) {
  const TextTable table(path, TableStyle::kSpreadsheet);
  std::vector<TimedPose> poses;
  for (const TextRow& row : table.rows()) {
    require_columns(table, row, 8, 17);
    const double seconds = static_cast<double>(table.integer(row, 0)) * 1e-9;
    push_pose(table, row, {seconds, pose_from_row(table, row, 4, 5)}, Stamps::kIncrease, poses);
  }
  return poses;
}

std::string format_tum(std::span<const TimedPose> poses) {
  std::string text;
  for (const TimedPose& pose : poses) {
    const Eigen::Vector3d& t = pose.T_w_c.t();
    Eigen::Vector4d q = pose.T_w_c.rotation.coeffs();  // x y z w
    if (q.w() < 0) q = -q;
    for (const double v : {pose.timestamp, t.x(), t.y(), t.z(), q.x(), q.y(), q.z()}) {
      append_number(text, v, ' ');
    }
    append_number(text, q.w(), '\n');
  }
  return text;
}

std::string format_kitti(std::span<const Rigid3> poses) {
  std::string text;
  for (const Rigid3& pose : poses) {
    const Eigen::Matrix<double, 3, 4> M = pose.matrix();
    for (int i = 0; i < 12; ++i) append_number(text, M(i / 4, i % 4), i == 11 ? '\n' : ' ');
  }
  return text;
}

void write_tum_poses(const fs::path& path, std::span<const TimedPose> poses) {
  write_file_atomic(path, format_tum(poses));
}

void write_kitti_poses(const fs::path& path, std::span<const Rigid3> poses) {
  write_file_atomic(path, format_kitti(poses));
}

}  // namespace kys_slam
