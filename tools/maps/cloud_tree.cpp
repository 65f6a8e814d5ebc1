// SPDX-License-Identifier: BSD-3-Clause
#include "cloud_tree.h"

#include <array>
#include <cstdint>
#include <nanoflann.hpp>

namespace kys_slam {
namespace {

/// What nanoflann asks a set of points for.
struct CloudPoints {
  [[nodiscard]] std::size_t kdtree_get_point_count() const { return values.size(); }
  [[nodiscard]] float kdtree_get_pt(std::size_t i, std::size_t axis) const {
    return values[i][static_cast<Eigen::Index>(axis)];
  }
  template <typename Box>
  bool kdtree_get_bbox(Box& /*box*/) const {
    return false;  // it computes it
  }

  std::vector<Eigen::Vector3f> values;
};

std::vector<Eigen::Vector3f> relative_to(const Eigen::Vector3d& origin,
                                         const std::vector<Eigen::Vector3d>& points) {
  std::vector<Eigen::Vector3f> values;
  values.reserve(points.size());
  for (const Eigen::Vector3d& p : points) values.push_back((p - origin).cast<float>());
  return values;
}

}  // namespace

struct CloudTree::Impl {
  using Metric = nanoflann::L2_Simple_Adaptor<float, CloudPoints>;
  using Tree = nanoflann::KDTreeSingleIndexAdaptor<Metric, CloudPoints, 3, std::uint32_t>;

  explicit Impl(const std::vector<Eigen::Vector3d>& given)
      : origin(given.front()), points{relative_to(origin, given)}, tree(3, points) {}

  template <int kCount>
  [[nodiscard]] std::size_t find(const Eigen::Vector3d& p) const {
    const Eigen::Vector3f at = (p - origin).cast<float>();
    std::array<std::uint32_t, kCount> indices{};
    std::array<float, kCount> distances{};
    tree.knnSearch(at.data(), kCount, indices.data(), distances.data());
    return indices.back();
  }

  Eigen::Vector3d origin;
  CloudPoints points;
  Tree tree;
};

CloudTree::CloudTree(const std::vector<Eigen::Vector3d>& points)
    : impl_(std::make_unique<Impl>(points)) {}
CloudTree::~CloudTree() = default;

std::size_t CloudTree::nearest(const Eigen::Vector3d& p) const {
  return impl_->find<1>(p);
}
std::size_t CloudTree::second(const Eigen::Vector3d& p) const {
  return impl_->points.values.size() < 2 ? 0 : impl_->find<2>(p);
}

}  // namespace kys_slam
