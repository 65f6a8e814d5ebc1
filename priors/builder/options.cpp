#include "priors/builder/options.h"

#include <kys_slam/error.h>

#include <charconv>
#include <cmath>
#include <functional>
#include <map>
#include <sstream>
#include <variant>
#include <vector>

namespace kys_slam {
namespace {

using Target = std::variant<double*, int*, bool*, EgoMotionModel*, References*, DetectionMethod*,
                            AssociationMethod*>;

/// Name and place of every option, in the order of the documentation.
std::vector<std::pair<std::string, Target>> fields(BuilderOptions& o) {
  return {
      {"association.method", &o.association.method},
      {"association.max_distance", &o.association.max_distance},
      {"association.max_missed_frames", &o.association.max_missed_frames},
      {"association.class_agnostic", &o.association.class_agnostic},
      {"depth.max_depth", &o.depth.max_depth},
      {"depth.left_right_tolerance", &o.depth.left_right_tolerance},
      {"depth.match_labels", &o.depth.match_labels},
      {"flow_check.enabled", &o.flow_check.enabled},
      {"flow_check.tolerance", &o.flow_check.tolerance},
      {"flow_check.relative_tolerance", &o.flow_check.relative_tolerance},
      {"flow_estimate.seeded", &o.flow_estimate.seeded},
      {"flow_estimate.finest_level", &o.flow_estimate.finest_level},
      {"ego_motion.model", &o.ego_motion.model},
      {"ego_motion.border", &o.ego_motion.border},
      {"ego_motion.huber_delta", &o.ego_motion.huber_delta},
      {"ego_motion.iterations", &o.ego_motion.iterations},
      {"ego_motion.grid_samples", &o.ego_motion.grid_samples},
      {"ego_motion.min_samples", &o.ego_motion.min_samples},
      {"drift.enabled", &o.drift.enabled},
      {"drift.sigma", &o.drift.sigma},
      {"drift.cell", &o.drift.cell},
      {"detection.method", &o.detection.method},
      {"detection.references", &o.detection.references},
      {"detection.reference_floor", &o.detection.reference_floor},
      {"detection.robust_factor", &o.detection.robust_factor},
      {"detection.start_log_odds", &o.detection.start_log_odds},
      {"detection.max_log_odds", &o.detection.max_log_odds},
      {"detection.lag", &o.detection.lag},
      {"detection.min_coverage", &o.detection.min_coverage},
      {"detection.uncovered_factor", &o.detection.uncovered_factor},
      {"detection.min_radial_coverage", &o.detection.min_radial_coverage},
      {"detection.magnitude_factor", &o.detection.magnitude_factor},
      {"detection.radial_factor", &o.detection.radial_factor},
      {"detection.max_omega", &o.detection.max_omega},
      {"detection.max_psi", &o.detection.max_psi},
      {"detection.min_radial_area", &o.detection.min_radial_area},
      {"detection.min_valid_fraction", &o.detection.min_valid_fraction},
      {"detection.standard_error_factor", &o.detection.standard_error_factor},
      {"keypoints.features", &o.keypoints.features},
      {"keypoints.max_speed", &o.keypoints.max_speed},
      {"keypoints.max_frames", &o.keypoints.max_frames},
      {"keypoints.common_error", &o.keypoints.common_error},
      {"keypoints.common_disparity_error", &o.keypoints.common_disparity_error},
      {"score.factor", &o.score.factor},
      {"score.maximum", &o.score.maximum},
      {"export.motion_tolerance_steps", &o.exported.motion_tolerance_steps},
  };
}

const std::vector<std::pair<std::string, EgoMotionModel>> kModels = {
    {"se3", EgoMotionModel::kSe3},
    {"rigid", EgoMotionModel::kRigid},
    {"as_printed", EgoMotionModel::kAsPrinted}};
const std::vector<std::pair<std::string, References>> kReferences = {
    {"moments", References::kMoments}, {"robust", References::kRobust}};
const std::vector<std::pair<std::string, DetectionMethod>> kMethods = {
    {"paper", DetectionMethod::kPaper}, {"robust", DetectionMethod::kRobust}};
const std::vector<std::pair<std::string, AssociationMethod>> kAssociations = {
    {"centroid", AssociationMethod::kCentroid}, {"overlap", AssociationMethod::kOverlap}};

[[noreturn]] void bad_value(const std::string& name, const std::string& value) {
  throw InputError("setting " + name + ": cannot be \"" + value + "\"");
}

template <typename T>
void parse(const std::string& name, const std::string& text, T& out) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), out);
  if (error != std::errc() || end != text.data() + text.size()) bad_value(name, text);
  if (!std::isfinite(static_cast<double>(out))) bad_value(name, text);
}

void parse(const std::string& name, const std::string& text, bool& out) {
  if (text != "true" && text != "false") bad_value(name, text);
  out = text == "true";
}

template <typename Enum>
void parse_enum(const std::vector<std::pair<std::string, Enum>>& names, const std::string& name,
                const std::string& text, Enum& out) {
  for (const auto& [word, value] : names) {
    if (word == text) {
      out = value;
      return;
    }
  }
  bad_value(name, text);
}
void parse(const std::string& n, const std::string& t, EgoMotionModel& out) {
  parse_enum(kModels, n, t, out);
}
void parse(const std::string& n, const std::string& t, References& out) {
  parse_enum(kReferences, n, t, out);
}
void parse(const std::string& n, const std::string& t, DetectionMethod& out) {
  parse_enum(kMethods, n, t, out);
}
void parse(const std::string& n, const std::string& t, AssociationMethod& out) {
  parse_enum(kAssociations, n, t, out);
}

std::string print(double value) {
  std::ostringstream out;
  out.precision(17);
  out << value;
  return out.str();
}
std::string print(int value) {
  return std::to_string(value);
}
std::string print(bool value) {
  return value ? "true" : "false";
}
std::string print(EgoMotionModel value) {
  return kModels[static_cast<std::size_t>(value)].first;
}
std::string print(References value) {
  return kReferences[static_cast<std::size_t>(value)].first;
}
std::string print(DetectionMethod value) {
  return kMethods[static_cast<std::size_t>(value)].first;
}
std::string print(AssociationMethod value) {
  return kAssociations[static_cast<std::size_t>(value)].first;
}

}  // namespace

void set_option(BuilderOptions& options, const std::string& name, const std::string& value) {
  for (const auto& [field, target] : fields(options)) {
    if (field != name) continue;
    std::visit([&](auto* place) { parse(name, value, *place); }, target);
    return;
  }
  throw InputError("setting " + name + ": there is no such setting");
}

std::string to_text(const BuilderOptions& options) {
  BuilderOptions copy = options;
  std::string text;
  for (const auto& [field, target] : fields(copy)) {
    text += field + ": " + std::visit([](auto* place) { return print(*place); }, target) + "\n";
  }
  return text;
}

void BuilderOptions::check() const {
  const auto require = [](bool good, const char* what) {
    if (!good) throw InputError(std::string("setting ") + what);
  };
  BuilderOptions copy = *this;
  for (const auto& [name, target] : fields(copy)) {
    const double* const* number = std::get_if<double*>(&target);
    const int* const* whole = std::get_if<int*>(&target);
    const double value = number != nullptr ? **number : whole != nullptr ? **whole : 0;
    if (!(std::abs(value) <= 1e9)) throw InputError("setting " + name + ": must be at most 1e9");
  }
  require(association.max_distance >= 0, "association.max_distance: must not be negative");
  require(association.max_missed_frames >= 0,
          "association.max_missed_frames: must not be negative");
  require(depth.max_depth > 0, "depth.max_depth: must be positive");
  require(flow_estimate.finest_level >= -1 && flow_estimate.finest_level <= 4,
          "flow_estimate.finest_level: must be -1 to 4");
  require(ego_motion.border >= 0, "ego_motion.border: must not be negative");
  require(ego_motion.huber_delta > 0, "ego_motion.huber_delta: must be positive");
  require(ego_motion.iterations >= 1 && ego_motion.iterations <= 1000,
          "ego_motion.iterations: must be 1 to 1000");
  require(ego_motion.min_samples >= 8, "ego_motion.min_samples: must be 8 or more");
  require(drift.sigma > 0 && drift.sigma <= 16384, "drift.sigma: must be above 0, at most 16384");
  require(drift.cell >= 1 && drift.cell <= 64, "drift.cell: must be 1 to 64");
  require(detection.reference_floor > 0, "detection.reference_floor: must be positive");
  require(detection.robust_factor > 0, "detection.robust_factor: must be positive");
  require(detection.max_log_odds > 0 && detection.max_log_odds <= 20,
          "detection.max_log_odds: must be above 0, at most 20");
  require(std::abs(detection.start_log_odds) <= detection.max_log_odds,
          "detection.start_log_odds: must not be beyond detection.max_log_odds");
  require(detection.lag >= 0 && detection.lag <= 100, "detection.lag: must be 0 to 100");
  require(detection.uncovered_factor >= 0, "detection.uncovered_factor: must not be negative");
  require(detection.max_omega >= 1, "detection.max_omega: must be 1 or more");
  require(detection.max_psi >= 1, "detection.max_psi: must be 1 or more");
  require(keypoints.features >= 100 && keypoints.features <= 50000,
          "keypoints.features: must be 100 to 50000");
  require(keypoints.max_speed > 0, "keypoints.max_speed: must be positive");
  require(keypoints.max_frames >= 1 && keypoints.max_frames <= 15,
          "keypoints.max_frames: must be 1 to 15");
  require(score.factor >= 0, "score.factor: must not be negative");
  require(score.maximum >= 0 && score.maximum <= 100, "score.maximum: must be 0 to 100");
  require(exported.motion_tolerance_steps >= 0 && exported.motion_tolerance_steps <= 64,
          "export.motion_tolerance_steps: must be 0 to 64");
}

BuilderOptions paper_options() {
  BuilderOptions options;
  options.association.class_agnostic = true;
  options.flow_check.enabled = false;
  options.ego_motion.model = EgoMotionModel::kAsPrinted;
  options.detection.reference_floor = 1e-9;
  options.detection.uncovered_factor = 0;
  options.exported.motion_tolerance_steps = 0;
  return options;
}

}  // namespace kys_slam
