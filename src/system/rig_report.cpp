// SPDX-License-Identifier: BSD-3-Clause
#include "system/rig_report.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <kys_slam/row_field.h>

#include <cmath>
#include <vector>

namespace kys_slam {

const char* RigReport::corrected() const {
  if (applied.correction.bends()) return "all";
  return applied.correction.none() ? "none" : "offset";
}

const RigEstimate& RigReport::known() const {
  const bool of_rows =
      applied.covariance.isZero(0) && rows && rows->rig.correction == applied.correction;
  return of_rows ? rows->rig : applied;
}

nlohmann::ordered_json rig_json(const RigReport& report) {
  nlohmann::ordered_json json = nlohmann::ordered_json::object();
  const auto rows = [&](double RowFit::*value) -> nlohmann::ordered_json {
    if (!report.rows) return nullptr;
    return (*report.rows).*value;
  };
  json["rows_sigma_before_px"] = rows(&RowFit::sigma_before);
  json["rows_sigma_after_px"] = rows(&RowFit::sigma_after);
  json["rows_field_px"] = rows(&RowFit::field);
  json["corrected"] = report.corrected();
  const RigEstimate& known = report.known();
  const auto sigma = [&](int k) -> nlohmann::ordered_json {
    if (!(known.covariance(k, k) > 0)) return nullptr;  // not estimated
    return std::sqrt(known.covariance(k, k));
  };
  json["offset_px"] = known.correction.offset();
  json["offset_sigma_px"] = sigma(static_cast<int>(RigParameter::kOffset));
  json["offset_estimate"] = nullptr;
  if (report.offset) {
    json["offset_estimate"] = {{"value_px", report.offset->value},
                               {"sigma_px", report.offset->sigma},
                               {"applied", report.offset->applied}};
  }
  json["parameters"] = nlohmann::ordered_json::object();
  for (int k = 0; k < RigCorrection::kSize; ++k) {
    const double value = known.correction.parameters()[k];
    if (value == 0 && sigma(k).is_null()) continue;
    const RigParameterName& name = rig_parameter_names()[static_cast<std::size_t>(k)];
    json["parameters"][std::string(name.name)] = {
        {"value", value}, {"sigma", sigma(k)}, {"unit", name.unit}};
  }
  return json;
}

std::string describe_rig(const RigReport& report) {
  const RigCorrection& applied = report.applied.correction;
  std::vector<std::string> parts;
  if (report.rows && report.rows->field > RowField::kMinField) {
    parts.push_back(fmt::format("rows differed by {:.2f} px (rms)", report.rows->field));
    parts.push_back(applied.bends()
                        ? fmt::format("corrected, standard deviation {:.2f} to {:.2f} px",
                                      report.rows->sigma_before, report.rows->sigma_after)
                        : "not corrected");
  } else if (applied.bends()) {
    parts.emplace_back("corrected from the start");
  }
  constexpr int kAt = static_cast<int>(RigParameter::kOffset);
  const double sigma = std::sqrt(report.applied.covariance(kAt, kAt));
  const std::string known = sigma > 0 ? fmt::format(" +- {:.2f}", sigma) : "";
  if (applied.offset() != 0) {
    parts.push_back(fmt::format("disparity offset {:.2f}{} px", applied.offset(), known));
  }
  if (report.offset && !report.offset->applied) {
    parts.push_back(fmt::format("disparity offset {:.3f} +- {:.3f} px {}, not applied",
                                report.offset->value, report.offset->sigma,
                                applied.offset() != 0 ? "found last" : "found"));
  }
  return fmt::format("{}", fmt::join(parts, "; "));
}

}  // namespace kys_slam
