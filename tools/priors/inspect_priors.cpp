// inspect_priors: what is in prior files, as text or pictures.
#include <kys_slam/error.h>
#include <kys_slam/image_file.h>
#include <kys_slam/prior_folder.h>
#include <kys_slam/prior_format.h>
#include <kys_slam/prior_writer.h>

#include <algorithm>
#include <cstdio>

#include "common/command_line.h"
#include "util/atomic_file.h"

namespace {

using namespace kys_slam;
namespace fs = std::filesystem;

void print(const fs::path& path, const PriorFile& file) {
  std::printf("%s: %dx%d, %s, calibration %016llx, %zu bytes%s\n", path.string().c_str(),
              file.width(), file.height(), file.label_space().c_str(),
              static_cast<unsigned long long>(file.calibration_hash()), file.file_size(),
              file.has_motion() ? "" : ", no motion");
  for (std::size_t c = 0; c < file.camera_count(); ++c) {
    std::printf("  %s\n  %8s %11s %6s %9s %12s %6s %s\n", c == 0 ? "left" : "right", "segment",
                "instance", "label", "area", "scale", "score", "flags");
    const auto& segments = file.segments(static_cast<CameraSide>(c));
    for (std::size_t k = 0; k < segments.size(); ++k) {
      const PriorSegment& s = segments[k];
      std::printf("  %8zu %11d %6u %9u %12.0f %6.1f %s%s%s\n", k + 1, s.instance, s.label, s.area,
                  s.scale, s.score, s.flags & prior_format::kThing ? "thing " : "stuff ",
                  s.flags & prior_format::kDynamic ? "moving " : "",
                  s.flags & prior_format::kRadialOnly ? "radial-only" : "");
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
  CLI::App app("Shows what is in prior files.");
  std::string input, png;
  app.add_option("input", input, "A prior file, or a folder of them")->required();
  app.add_option("--png", png, "Folder for pictures: one per camera and file");
  if (const auto status = parse_command_line(app, argc, argv)) return *status;
  if (!png.empty()) make_output_folder(png);
  for (const fs::path& path : list_prior_files(input)) {
    const PriorFile file = PriorFile::open(path);
    print(path, file);
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
