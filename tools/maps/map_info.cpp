// SPDX-License-Identifier: BSD-3-Clause
// map_info: what a saved map holds.
#include <fmt/format.h>
#include <kys/error.h>
#include <kys/label_space.h>
#include <kys/prior.h>
#include <kys_slam/error.h>
#include <kys_slam/run_main.h>
#include <kys_slam/saved_map.h>
#include <kys_slam/trajectory_file.h>
#include <kys_slam/util/paths.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>

#include "common/command_line.h"

namespace {

using namespace kys_slam;
using Json = nlohmann::ordered_json;

constexpr double kSpread = 0.01;  // share of landmarks beyond each side of the stated extent

/// Box of positions without the share `beyond` on each side, m.
struct Box {
  Eigen::Vector3d low = Eigen::Vector3d::Zero(), high = Eigen::Vector3d::Zero();
};
Box box_of(const std::vector<Eigen::Vector3d>& points, double beyond) {
  Box box;
  if (points.empty()) return box;
  const auto skip = static_cast<std::size_t>(beyond * static_cast<double>(points.size()));
  std::vector<double> values(points.size());
  for (int c = 0; c < 3; ++c) {
    std::transform(points.begin(), points.end(), values.begin(),
                   [&](const Eigen::Vector3d& p) { return p[c]; });
    std::sort(values.begin(), values.end());
    box.low[c] = values[skip];
    box.high[c] = values[values.size() - 1 - skip];
  }
  return box;
}
Json to_json(const Box& box) {
  return {{"low_m", {box.low.x(), box.low.y(), box.low.z()}},
          {"high_m", {box.high.x(), box.high.y(), box.high.z()}}};
}

/// Names of classes where the label space is one of the library's.
class ClassNames {
 public:
  explicit ClassNames(const std::string& space) {
    const auto& known = kys::builtin_label_spaces();
    if (std::find(known.begin(), known.end(), space) != known.end()) {
      space_ = kys::load_label_space(space);
    }
  }
  [[nodiscard]] std::string operator()(std::uint16_t label) const {
    if (label == kys::kVoidLabel) return "no class";
    if (space_ && label < space_->size()) return space_->at(label).name;
    return "class " + std::to_string(label);
  }

 private:
  std::optional<kys::LabelSpace> space_;
};

Json submaps(const MapSnapshot& map) {
  std::map<std::uint32_t, std::vector<const MapSnapshot::KeyFrame*>> keyframes;
  std::map<std::uint32_t, std::vector<Eigen::Vector3d>> landmarks;
  for (const auto& k : map.keyframes) keyframes[k.submap].push_back(&k);
  for (const auto& l : map.landmarks) landmarks[l.submap].push_back(l.p_w);
  Json list = Json::array();
  for (const auto& [id, members] : keyframes) {
    std::vector<Eigen::Vector3d> path;
    double length = 0, first = members.front()->timestamp, last = first;
    for (const MapSnapshot::KeyFrame* k : members) {
      if (!path.empty()) length += (k->T_w_c.translation - path.back()).norm();
      path.push_back(k->T_w_c.translation);
      first = std::min(first, k->timestamp);
      last = std::max(last, k->timestamp);
    }
    list.push_back({{"first_keyframe", id},
                    {"keyframes", members.size()},
                    {"landmarks", landmarks[id].size()},
                    {"first_s", first},
                    {"last_s", last},
                    {"path_m", length},
                    {"camera", to_json(box_of(path, 0))},
                    {"extent", to_json(box_of(landmarks[id], kSpread))}});
  }
  return list;
}

Json classes(const MapSnapshot& map, const ClassNames& name) {
  std::map<std::uint16_t, std::size_t> count;
  for (const auto& l : map.landmarks) ++count[l.label];
  std::vector<std::pair<std::uint16_t, std::size_t>> sorted(count.begin(), count.end());
  std::stable_sort(sorted.begin(), sorted.end(),
                   [](const auto& a, const auto& b) { return a.second > b.second; });
  Json list = Json::array();
  for (const auto& [label, n] : sorted) {
    list.push_back({{"class", name(label)},
                    {"label", label == kys::kVoidLabel ? Json(nullptr) : Json(label)},
                    {"landmarks", n}});
  }
  return list;
}

Json rig_of_map(const MapInfo& info) {
  const RigCorrection& rig = info.rig.correction;
  Json json{{"corrected", rig.none()    ? "none"
                          : rig.bends() ? "all"
                                        : "offset"},
            {"parameters", Json::object()}};
  for (int k = 0; k < RigCorrection::kSize; ++k) {
    const double value = rig.parameters()[k];
    const double variance = info.rig.covariance(k, k);
    if (value == 0 && !(variance > 0)) continue;
    const RigParameterName& name = rig_parameter_names().at(static_cast<std::size_t>(k));
    json["parameters"][std::string(name.name)] = {
        {"value", value},
        {"sigma", variance > 0 ? Json(std::sqrt(variance)) : Json(nullptr)},
        {"unit", name.unit}};
  }
  return json;
}

Json describe_map(const SavedMap& map, const std::string& file) {
  const MapInfo info = map.info();
  const MapSnapshot snapshot = map.snapshot();
  const StereoCamera& c = info.camera;
  Json json{{"file", printable(file)},
            {"version", info.version},
            {"keyframes", snapshot.keyframes.size()},
            {"culled_keyframes", info.culled},
            {"landmarks", snapshot.landmarks.size()},
            {"observations", info.observations},
            {"loops", std::count_if(snapshot.edges.begin(), snapshot.edges.end(),
                                    [](const MapSnapshot::Edge& e) { return e.loop; })},
            {"submaps", submaps(snapshot)}};
  const bool labelled = std::any_of(snapshot.landmarks.begin(), snapshot.landmarks.end(),
                                    [](const auto& l) { return l.label != kys::kVoidLabel; });
  json["label_space"] = info.label_space.empty() ? Json(nullptr) : Json(info.label_space);
  json["classes"] = labelled ? classes(snapshot, ClassNames(info.label_space)) : Json::array();
  json["beliefs"] = info.beliefs;
  json["camera"] = {
      {"width", c.width}, {"height", c.height},      {"fx", c.fx}, {"fy", c.fy}, {"cx", c.cx},
      {"cy", c.cy},       {"baseline_m", c.baseline}};
  json["rig"] = rig_of_map(info);
  json["features"] = {{"extractor", info.extractor},
                      {"levels", info.levels},
                      {"scale_factor", info.scale_factor},
                      {"count", info.features},
                      {"stereo", info.stereo},
                      {"aligned", info.aligned},
                      {"labelled", info.labelled},
                      {"rows_measured", info.rows}};
  return json;
}

std::string extent(const Json& box) {
  std::string text;
  for (std::size_t c = 0; c < 3; ++c) {
    text += fmt::format("{}{} {:.1f} to {:.1f}", c == 0 ? "" : ", ", "xyz"[c],
                        box["low_m"][c].get<double>(), box["high_m"][c].get<double>());
  }
  return text + " m";
}

std::string share(const Json& features, const char* key) {
  const double all = std::max(1.0, features["count"].get<double>());
  return fmt::format("{:.0f} %", 100 * features[key].get<double>() / all);
}

std::string text_of(const Json& m) {
  std::string text;
  const auto row = [&](const char* name, const std::string& value) {
    text += fmt::format("  {:<13} {}\n", name, value);
  };
  row("file",
      fmt::format("{}, format version {}", m["file"].get<std::string>(), m["version"].get<int>()));
  row("keyframes",
      fmt::format("{} and {} culled, {} loops", m["keyframes"].get<std::size_t>(),
                  m["culled_keyframes"].get<std::size_t>(), m["loops"].get<std::size_t>()));
  row("landmarks", fmt::format("{}, observed {} times{}", m["landmarks"].get<std::size_t>(),
                               m["observations"].get<std::size_t>(),
                               m["beliefs"].get<bool>() ? ", with beliefs" : ""));
  for (const Json& s : m["submaps"]) {
    row("sub-map",
        fmt::format("from keyframe {}: {} keyframes, {} landmarks, {:.3f} to {:.3f} s, "
                    "path {:.1f} m",
                    s["first_keyframe"].get<std::uint32_t>(), s["keyframes"].get<std::size_t>(),
                    s["landmarks"].get<std::size_t>(), s["first_s"].get<double>(),
                    s["last_s"].get<double>(), s["path_m"].get<double>()));
    row("", "camera    " + extent(s["camera"]));
    row("", "landmarks " + extent(s["extent"]));
  }
  for (const Json& c : m["classes"]) {
    row("class", fmt::format("{:>8} {}", c["landmarks"].get<std::size_t>(),
                             printable(c["class"].get<std::string>())));
  }
  if (!m["label_space"].is_null()) row("label space", m["label_space"].get<std::string>());
  const Json& c = m["camera"];
  row("camera",
      fmt::format("{}x{} px, fx {:.3f}, fy {:.3f}, cx {:.3f}, cy {:.3f}, baseline {:.5f} m",
                  c["width"].get<int>(), c["height"].get<int>(), c["fx"].get<double>(),
                  c["fy"].get<double>(), c["cx"].get<double>(), c["cy"].get<double>(),
                  c["baseline_m"].get<double>()));
  row("correction", m["rig"]["corrected"].get<std::string>());
  for (const auto& [name, p] : m["rig"]["parameters"].items()) {
    row("",
        fmt::format("{:<11} {:>10.5f}{} {}", name, p["value"].get<double>(),
                    p["sigma"].is_null() ? "" : fmt::format(" +- {:.5f}", p["sigma"].get<double>()),
                    p["unit"].get<std::string>()));
  }
  const Json& f = m["features"];
  row("features",
      fmt::format("{} of {} in keyframes, {} levels of {:.3f}; {} with disparity, {} aligned, "
                  "{} with class; rows {}",
                  f["count"].get<std::size_t>(), f["extractor"].get<std::string>(),
                  f["levels"].get<int>(), f["scale_factor"].get<double>(), share(f, "stereo"),
                  share(f, "aligned"), share(f, "labelled"),
                  f["rows_measured"].get<bool>() ? "measured" : "not measured"));
  return text;
}

/// Poses of the largest sub-map's keyframes.
void write_keyframes(const SavedMap& map, const std::filesystem::path& file) {
  const MapSnapshot snapshot = map.snapshot();
  std::vector<TimedPose> poses;
  for (const MapSnapshot::KeyFrame& k : snapshot.keyframes) {
    if (k.submap == snapshot.main_submap) poses.push_back({k.timestamp, k.T_w_c});
  }
  std::stable_sort(poses.begin(), poses.end(), [](const TimedPose& a, const TimedPose& b) {
    return a.timestamp < b.timestamp;
  });
  write_tum_poses(file, poses);
}

}  // namespace

int main(int argc, char** argv) {
  return kys_slam::run_main("map_info", [&] {
    CLI::App app("Shows what a saved map holds.", "map_info");
    std::filesystem::path file, keyframes;
    bool as_json = false;
    app.add_option("MAP", file, "map of a run (--save-map)")->required();
    app.add_flag("--json", as_json, "as JSON");
    one_at_a_time(app.add_option("--keyframes", keyframes,
                                 "file for the poses of the largest sub-map's keyframes (TUM)"));
    if (const auto status = parse_command_line(app, argc, argv)) return *status;
    if (!keyframes.empty() && is_same_path(file, keyframes)) {
      throw InputError(keyframes.string() + ": is the input");
    }
    const SavedMap saved(file);
    const Json map = describe_map(saved, file.string());
    if (!keyframes.empty()) write_keyframes(saved, keyframes);
    print_text(as_json ? map.dump(2) + "\n" : text_of(map));
    return 0;
  });
}
