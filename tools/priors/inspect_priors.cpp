// SPDX-License-Identifier: BSD-3-Clause
// inspect_priors: what is in prior files, as text or pictures.
#include <kys/error.h>
#include <kys/label_space.h>
#include <kys_slam/error.h>
#include <kys_slam/image_file.h>
#include <kys_slam/prior_folder.h>
#include <kys_slam/prior_format.h>
#include <kys_slam/prior_writer.h>
#include <kys_slam/run_main.h>
#include <kys_slam/util/atomic_file.h>
#include <kys_slam/util/paths.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "common/command_line.h"

namespace {

using namespace kys_slam;
namespace fs = std::filesystem;

/// By frame, camera and instance: why a thing was decided as it was, from the segments.csv of the
/// folder. Empty without that table.
using Reasons = std::map<std::string, std::string>;

std::string reason_key(const std::string& frame, const std::string& camera, std::int32_t instance) {
  return frame + "," + camera + "," + std::to_string(instance);
}

std::vector<std::string> split(const std::string& line) {
  std::vector<std::string> fields;
  std::istringstream in(line);
  for (std::string field; std::getline(in, field, ',');) fields.push_back(field);
  return fields;
}

Reasons read_reasons(const fs::path& folder) {
  Reasons reasons;
  if (!is_file(folder / "segments.csv")) return reasons;
  std::ifstream in(folder / "segments.csv");
  std::string line;
  std::getline(in, line);
  const std::vector<std::string> header = split(line);
  while (std::getline(in, line)) {
    const std::vector<std::string> fields = split(line);
    if (fields.size() != header.size()) continue;
    std::map<std::string, std::string> row;
    for (std::size_t i = 0; i < header.size(); ++i) row[header[i]] = fields[i];
    const auto number = [&](const char* name) { return std::strtod(row[name].c_str(), nullptr); };
    char text[160];
    std::snprintf(text, sizeof text, "%s %.2f px, valid %.0f %%",
                  number("median_px") > 0 ? "median" : "residual",
                  number("median_px") > 0 ? number("median_px") : number("residual_px"),
                  100 * number("valid"));
    std::string reason = text;
    if (row["magnitude_test"] == "1") reason += ", magnitude";
    if (row["radial_test"] == "1") reason += ", radial";
    if (number("log_odds") != 0) {
      std::snprintf(text, sizeof text,
                    ", flow %+.1f appearance %+.1f keypoints %+.1f space %+.1f nats, belief %+.1f",
                    number("evidence_flow"), number("evidence_appearance"),
                    number("evidence_keypoints"), number("evidence_space"), number("log_odds"));
      reason += text;
    }
    reasons[reason_key(row["frame"], row["camera"],
                       static_cast<std::int32_t>(number("identity")))] = reason;
  }
  return reasons;
}

/// Names of a label space by dense label.
std::vector<std::string> names_of(const std::string& label_space) {
  std::vector<std::string> names;
  const kys::LabelSpace space = kys::load_label_space(label_space);
  for (const kys::LabelClass& c : space.classes()) names.push_back(printable(c.name));
  return names;
}

/// Names of the label space of a file; empty when there is no such space.
std::vector<std::string> names_of(const PriorFile& file) {
  try {
    return names_of(file.label_space());
  } catch (const kys::Error&) {
    return {};
  }
}

void print(const fs::path& path, const PriorFile& file, const Reasons& reasons,
           const std::vector<std::string>& names) {
  std::printf("%s: %dx%d, %s, calibration %016llx, %zu bytes%s\n", printable(path.string()).c_str(),
              file.width(), file.height(), file.label_space().c_str(),
              static_cast<unsigned long long>(file.calibration_hash()), file.file_size(),
              file.has_motion() ? "" : ", no motion");
  for (std::size_t c = 0; c < file.camera_count(); ++c) {
    std::printf("  %s\n  %8s %11s %-16s %9s %12s %6s %s\n", c == 0 ? "left" : "right", "segment",
                "instance", "label", "area", "scale", "score", "flags");
    const auto& segments = file.segments(static_cast<CameraSide>(c));
    for (std::size_t k = 0; k < segments.size(); ++k) {
      const PriorSegment& s = segments[k];
      const std::string label = s.label < names.size() ? names[s.label] : std::to_string(s.label);
      const auto reason =
          reasons.find(reason_key(path.stem().string(), c == 0 ? "left" : "right", s.instance));
      std::printf("  %8zu %11d %-16s %9u %12.0f %6.1f %s%s%s%s%s\n", k + 1, s.instance,
                  label.c_str(), s.area, s.scale, s.score,
                  s.flags & prior_format::kThing ? "thing " : "stuff ",
                  s.flags & prior_format::kDynamic ? "moving " : "",
                  s.flags & prior_format::kRadialOnly ? "radial-only " : "",
                  s.flags & prior_format::kNotJudged ? "not-judged " : "",
                  reason != reasons.end() ? ("(" + reason->second + ")").c_str() : "");
    }
  }
}

/// Hue by instance, red where it moves.
RgbImage draw(const CameraPriors& camera) {
  RgbImage out(camera.segment_map.width(), camera.segment_map.height());
  for (std::size_t i = 0; i < out.size(); ++i) {
    const std::uint16_t k = camera.segment_map.data()[i];
    if (k == 0) continue;
    const PriorSegment& s = camera.segments[k - 1u];
    const std::uint32_t h = static_cast<std::uint32_t>(s.instance) * 2654435761u;
    RgbPixel p = {static_cast<std::uint8_t>(h >> 25),
                  static_cast<std::uint8_t>(64 + (h >> 16) % 128),
                  static_cast<std::uint8_t>(64 + (h >> 8) % 128)};
    if (s.flags & prior_format::kDynamic) {
      p[0] = static_cast<std::uint8_t>(155.0F + camera.motion.data()[i]);
    }
    out.data()[i] = p;
  }
  return out;
}

int run(int argc, char** argv) {
  CLI::App app("Shows the content of prior files.");
  std::string input, png, label_space;
  app.add_option("input", input, "A prior file, or a folder of them")->required();
  app.add_option("--label-space", label_space,
                 "Label space for class names, by name or path (default: that of the files)");
  app.add_option("--png", png, "Folder for images: one per camera and file");
  if (const auto status = parse_command_line(app, argc, argv)) return *status;
  if (!png.empty()) make_output_folder(png);
  std::vector<std::string> names;
  if (!label_space.empty()) names = names_of(label_space);
  const Reasons reasons =
      read_reasons(fs::is_directory(input) ? fs::path(input) : fs::path(input).parent_path());
  for (const fs::path& path : list_prior_files(input)) {
    const PriorFile file = PriorFile::open(path);
    print(path, file, reasons, names.empty() ? names_of(file) : names);
    if (png.empty()) continue;
    const FramePriors priors = decode_priors(file);
    for (std::size_t c = 0; c < priors.cameras.size(); ++c) {
      write_png(fs::path(png) / (path.stem().string() + (c == 0 ? "_left.png" : "_right.png")),
                draw(priors.cameras[c]));
    }
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  return kys_slam::run_main("inspect_priors", [&] { return run(argc, argv); });
}
