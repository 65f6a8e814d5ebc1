// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <memory>
#include <vector>

namespace kys_slam {

/// Nearest neighbours in a point cloud, exact to 1e-6 of its size (FLANN's kd-tree).
class CloudTree {
 public:
  /// \param points at least one; must outlive the tree
  explicit CloudTree(const std::vector<Eigen::Vector3d>& points);
  ~CloudTree();
  /// Index of the nearest point; of the nearest but one, for points of the cloud itself.
  [[nodiscard]] std::size_t nearest(const Eigen::Vector3d& p) const;
  [[nodiscard]] std::size_t second(const Eigen::Vector3d& p) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace kys_slam
