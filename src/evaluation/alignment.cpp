#include <kys_slam/evaluation.h>

#include <Eigen/SVD>

namespace kys_slam {
namespace {

struct Moments {
  Eigen::Vector3d mean_reference = Eigen::Vector3d::Zero();
  Eigen::Vector3d mean_estimate = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  // of reference with estimate
  double variance_estimate = 0;
};

Moments moments(const TrajectoryPair& pair) {
  Moments m;
  const auto n = static_cast<double>(pair.size());
  for (std::size_t i = 0; i < pair.size(); ++i) {
    m.mean_reference += pair.reference[i].T_w_c.t() / n;
    m.mean_estimate += pair.estimate[i].T_w_c.t() / n;
  }
  for (std::size_t i = 0; i < pair.size(); ++i) {
    const Eigen::Vector3d r = pair.reference[i].T_w_c.t() - m.mean_reference;
    const Eigen::Vector3d e = pair.estimate[i].T_w_c.t() - m.mean_estimate;
    m.covariance += r * e.transpose() / n;
    m.variance_estimate += e.squaredNorm() / n;
  }
  return m;
}

}  // namespace

Similarity align(const TrajectoryPair& pair, Alignment alignment) {
  Similarity result;
  if (alignment == Alignment::kNone || pair.size() == 0) return result;
  const Moments m = moments(pair);
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(m.covariance,
                                              Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Eigen::Vector3d& d = svd.singularValues();
  Eigen::Matrix3d R;
  if (pair.size() < 3 || !(d(1) > 1e-12 * d(0)) || !(d(0) > 0)) {
    result.degenerate = true;
    R = (pair.reference[0].T_w_c.rotation * pair.estimate[0].T_w_c.rotation.conjugate())
            .toRotationMatrix();
  } else {
    Eigen::Vector3d sign(1, 1, 1);
    if (svd.matrixU().determinant() * svd.matrixV().determinant() < 0) sign(2) = -1;
    R = svd.matrixU() * sign.asDiagonal() * svd.matrixV().transpose();
    if (alignment == Alignment::kSim3) result.scale = d.dot(sign) / m.variance_estimate;
  }
  result.T = Rigid3(R, Eigen::Vector3d(m.mean_reference - result.scale * R * m.mean_estimate));
  return result;
}

void transform(std::vector<TimedPose>& poses, const Similarity& similarity) {
  for (TimedPose& pose : poses) {
    const Eigen::Vector3d scaled = similarity.scale * pose.T_w_c.t();
    pose.T_w_c = similarity.T * Rigid3(pose.T_w_c.rotation, scaled);
  }
}

}  // namespace kys_slam
