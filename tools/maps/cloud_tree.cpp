// SPDX-License-Identifier: BSD-3-Clause
#include "cloud_tree.h"

#include <array>
#include <opencv2/flann.hpp>

namespace kys_slam {

struct CloudTree::Impl {
  using Metric = cvflann::L2_Simple<float>;
  using Vector = Eigen::Vector3f;

  explicit Impl(const std::vector<Eigen::Vector3d>& points) : origin(points.front()) {
    values.reserve(points.size());
    for (const Eigen::Vector3d& p : points) values.push_back((p - origin).cast<float>());
    tree = std::make_unique<cvflann::KDTreeSingleIndex<Metric>>(
        cvflann::Matrix<float>(values.front().data(), values.size(), 3));
    tree->buildIndex();
  }

  template <int kCount>
  [[nodiscard]] std::size_t find(const Eigen::Vector3d& p) const {
    const Vector at = (p - origin).cast<float>();
    std::array<int, kCount> indices{};
    std::array<float, kCount> distances{};
    cvflann::KNNResultSet<float> found(kCount);
    found.init(indices.data(), distances.data());
    tree->findNeighbors(found, at.data(), cvflann::SearchParams(-1));
    return static_cast<std::size_t>(indices.back());
  }

  Eigen::Vector3d origin;
  std::vector<Vector> values;
  std::unique_ptr<cvflann::KDTreeSingleIndex<Metric>> tree;
};

CloudTree::CloudTree(const std::vector<Eigen::Vector3d>& points)
    : impl_(std::make_unique<Impl>(points)) {}
CloudTree::~CloudTree() = default;

std::size_t CloudTree::nearest(const Eigen::Vector3d& p) const {
  return impl_->find<1>(p);
}
std::size_t CloudTree::second(const Eigen::Vector3d& p) const {
  return impl_->values.size() < 2 ? 0 : impl_->find<2>(p);
}

}  // namespace kys_slam
