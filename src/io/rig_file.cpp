// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/error.h>
#include <kys_slam/rig_file.h>
#include <kys_slam/util/parse_number.h>
#include <kys_slam/util/read_bytes.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>
#include <utility>
#include <vector>

#include "camera/plausible.h"
#include "io/yaml_file.h"

namespace kys_slam {

namespace fs = std::filesystem;

namespace {

constexpr int kSize = RigCorrection::kSize;
constexpr double kLargest = 0.1;      // displacement over the width of the image
constexpr double kSameCamera = 1e-6;  // relative; rectification differs by that between machines

struct CameraKey {
  const char* name;
  double StereoCamera::*value;
};
constexpr std::array kCameraKeys = {
    CameraKey{"fx", &StereoCamera::fx}, CameraKey{"fy", &StereoCamera::fy},
    CameraKey{"cx", &StereoCamera::cx}, CameraKey{"cy", &StereoCamera::cy},
    CameraKey{"baseline", &StereoCamera::baseline}};

/// What is under `correction` in a file, with messages that name the file.
class Reader {
 public:
  Reader(std::string name, YAML::Node node) : name_(std::move(name)), node_(std::move(node)) {
    if (!node_.IsMap()) fail("is not a map");
  }

  CorrectionFile read() {
    CorrectionFile result;
    result.given = camera();
    result.estimate.correction = RigCorrection(result.given, parameters());
    result.estimate.covariance = covariance();
    check_size(result);
    return result;
  }

 private:
  [[noreturn]] void fail(const std::string& what) const {
    throw InputError(name_ + ": correction: " + what);
  }

  [[nodiscard]] double number(const YAML::Node& node, const std::string& key) const {
    const auto value = node && node.IsScalar() ? parse_double(node.Scalar()) : std::nullopt;
    if (!value) fail("'" + key + "' is missing or not a finite number");
    return *value;
  }

  [[nodiscard]] YAML::Node part(const char* key) const {
    const YAML::Node found = node_[key];
    if (!found || !found.IsMap()) fail(std::string("'") + key + "' is missing or not a map");
    return found;
  }

  [[nodiscard]] StereoCamera camera() const {
    const YAML::Node given = part("given");
    StereoCamera camera;
    const auto side = [&](const char* key) {
      const double value = number(given[key], key);
      if (!(value >= 2 && value <= 16384 && value == std::floor(value))) {
        fail(std::string("'") + key + "' is no image size");
      }
      return static_cast<int>(value);
    };
    camera.width = side("width");
    camera.height = side("height");
    for (const auto& [key, value] : kCameraKeys) camera.*value = number(given[key], key);
    if (!camera.is_valid()) fail("'given' is no camera");
    require_plausible(camera, name_ + ": correction");
    return camera;
  }

  [[nodiscard]] RigCorrection::Parameters parameters() const {
    const YAML::Node node = part("parameters");
    RigCorrection::Parameters values;
    for (int k = 0; k < kSize; ++k) {
      const std::string key(rig_parameter_names().at(static_cast<std::size_t>(k)).name);
      values[k] = number(node[key], key);
    }
    if (node.size() != static_cast<std::size_t>(kSize)) fail("'parameters' has unknown names");
    return values;
  }

  [[nodiscard]] RigCorrection::Covariance covariance() const {
    const YAML::Node node = node_["covariance"];
    constexpr std::size_t kCount = kSize * (kSize + 1) / 2;
    if (!node || !node.IsSequence() || node.size() != kCount) {
      fail("'covariance' is not a list of " + std::to_string(kCount) + " numbers");
    }
    RigCorrection::Covariance C;
    std::size_t i = 0;
    for (int r = 0; r < kSize; ++r) {
      for (int c = 0; c <= r; ++c) C(r, c) = C(c, r) = number(node[i++], "covariance");
    }
    check_covariance(C);
    return C;
  }

  void check_covariance(const RigCorrection::Covariance& C) const {
    if ((C.diagonal().array() < 0).any()) fail("'covariance' has a negative variance");
    // Units differ: correlations have one size.
    const RigCorrection::Parameters sigma = C.diagonal().cwiseSqrt();
    RigCorrection::Covariance correlation = RigCorrection::Covariance::Identity();
    for (int r = 0; r < kSize; ++r) {
      for (int c = 0; c < kSize; ++c) {
        const double product = sigma[r] * sigma[c];
        if (r == c) continue;
        if (product == 0 && C(r, c) != 0) fail("'covariance' is no covariance");
        correlation(r, c) = product == 0 ? 0 : C(r, c) / product;
      }
    }
    constexpr double kRounding = 1e-6;
    const bool finite = correlation.allFinite() && sigma.allFinite();
    if (!finite || Eigen::SelfAdjointEigenSolver<RigCorrection::Covariance>(correlation,
                                                                            Eigen::EigenvaluesOnly)
                           .eigenvalues()
                           .minCoeff() < -kRounding) {
      fail("'covariance' is no covariance");
    }
  }

  /// Displacements are of first order, and mild.
  void check_size(const CorrectionFile& file) const {
    constexpr int kSteps = 8;
    const StereoCamera& camera = file.given;
    const double most = kLargest * camera.width;
    for (int i = 0; i <= kSteps; ++i) {
      for (int j = 0; j <= kSteps; ++j) {
        const Eigen::Vector2d p(i * (camera.width - 1.0) / kSteps,
                                j * (camera.height - 1.0) / kSteps);
        const double left = (file.estimate.correction.left(p.x(), p.y()) - p).norm();
        const double right = (file.estimate.correction.right(p.x(), p.y()) - p).norm();
        if (left <= most && right <= most) continue;
        fail("moves points by more than a tenth of the image's width");
      }
    }
    constexpr double kMostTilt = 0.2;
    for (const RigParameter p : {RigParameter::kBaselineY, RigParameter::kBaselineZ}) {
      if (std::abs(file.estimate.correction[p]) > kMostTilt) fail("a baseline that is not along x");
    }
  }

  std::string name_;
  YAML::Node node_;
};

}  // namespace

std::optional<CorrectionFile> read_correction_file(const fs::path& file) {
  constexpr std::size_t kMostBytes = std::size_t{1} << 20;
  std::string text = read_text(file, kMostBytes);
  // Calibrations of other makers are no plain trees.
  if (text.find("correction") == std::string::npos) return std::nullopt;
  const YAML::Node root = parse_yaml(std::move(text), file.string());
  if (!root.IsMap()) throw InputError(file.string() + ": not a calibration in YAML");
  if (!root["correction"]) return std::nullopt;
  return Reader(file.string(), root["correction"]).read();
}

RigEstimate read_rig_correction(const fs::path& file, const StereoCamera& given) {
  const std::optional<CorrectionFile> read = read_correction_file(file);
  if (!read) throw InputError(file.string() + ": holds no correction (calibrate_rig writes one)");
  const StereoCamera& theirs = read->given;
  bool same = theirs.width == given.width && theirs.height == given.height;
  for (const CameraKey& key : kCameraKeys) {
    const double a = theirs.*key.value, b = given.*key.value;
    same = same && std::abs(a - b) <= kSameCamera * std::max(std::abs(a), std::abs(b));
  }
  if (!same) {
    const auto text = [](const StereoCamera& c) {
      return std::to_string(c.width) + "x" + std::to_string(c.height) + " px, fx " +
             yaml_number(c.fx) + ", cx " + yaml_number(c.cx) + ", cy " + yaml_number(c.cy) +
             ", baseline " + yaml_number(c.baseline) + " m";
    };
    throw InputError(file.string() + ": corrects another calibration (" + text(theirs) +
                     ") than this one (" + text(given) + ")");
  }
  return read->estimate;
}

std::string to_yaml(const CorrectionFile& correction) {
  const StereoCamera& c = correction.given;
  std::string text =
      "# How the true pair differs from this one: kys_slam/rig_correction.h.\n"
      "correction:\n  given: {width: " +
      std::to_string(c.width) + ", height: " + std::to_string(c.height);
  for (const auto& [key, value] : kCameraKeys) {
    text += std::string(", ") + key + ": " + yaml_number(c.*value);
  }
  text += "}\n  parameters:\n";
  for (int k = 0; k < kSize; ++k) {
    text += "    " + std::string(rig_parameter_names().at(static_cast<std::size_t>(k)).name) +
            ": " + yaml_number(correction.estimate.correction.parameters()[k]) + "\n";
  }
  text += "  covariance:\n";
  for (int r = 0; r < kSize; ++r) {
    text += r == 0 ? "    [" : ",\n     ";
    for (int k = 0; k <= r; ++k) {
      text += (k == 0 ? "" : ", ") + yaml_number(correction.estimate.covariance(r, k));
    }
  }
  return text + "]\n";
}

StereoRig rig_of(const StereoCamera& camera, const std::string& name) {
  RawCamera one;
  one.width = camera.width, one.height = camera.height;
  one.fx = camera.fx, one.fy = camera.fy, one.cx = camera.cx, one.cy = camera.cy;
  StereoRig rig{one, one, name};
  rig.right.T_b_s.translation.x() = camera.baseline;
  return rig;
}

}  // namespace kys_slam
