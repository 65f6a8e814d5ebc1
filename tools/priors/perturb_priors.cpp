// perturb_priors: perception with errors put in, to build priors from (the paper's robustness
// study). Segmentation: nested relabelling of thing segments. Flow: noise scaled by the flow's
// length, or spatially correlated failure.
#include <kys/label_space.h>
#include <kys_slam/error.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>

#include "io/image_io.h"
#include "priors/builder/field_input.h"
#include "util/atomic_file.h"

namespace {

using namespace kys_slam;
namespace fs = std::filesystem;
using Json = nlohmann::json;

/// A number in 0..1 that depends on nothing but its arguments (splitmix64).
double uniform(std::uint64_t seed, std::uint64_t a, std::uint64_t b = 0) {
  std::uint64_t z = seed * 0x9E3779B97F4A7C15ull + a * 0xBF58476D1CE4E5B9ull +
                    b * 0x94D049BB133111EBull + 0x2545F4914F6CDD1Dull;
  for (int i = 0; i < 2; ++i) {
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ull;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBull;
    z ^= z >> 31;
  }
  return static_cast<double>(z >> 11) * 0x1.0p-53;
}

double gaussian(std::uint64_t seed, std::uint64_t a, std::uint64_t b) {
  const double u = std::max(uniform(seed, a, 2 * b), 1e-300), v = uniform(seed, a, 2 * b + 1);
  return std::sqrt(-2 * std::log(u)) * std::cos(2 * 3.14159265358979323846 * v);
}

std::uint64_t hash_of(const std::string& text) {
  std::uint64_t value = 0xCBF29CE484222325ull;
  for (const char c : text) value = (value ^ static_cast<std::uint8_t>(c)) * 0x100000001B3ull;
  return value;
}

/// Relabels a share of the thing segments with another class observed in the sequence. A segment is
/// hit when its own random number is below the share: those hit at 10 % are hit at 30 % and 60 %.
void relabel(const std::string& folder, const std::string& output, double share, std::uint64_t seed,
             const kys::LabelSpace& labels) {
  const std::string json_in = folder + ".json", json_out = output + ".json";
  std::ifstream stream(json_in);
  if (!stream) throw InputError(json_in + ": cannot open");
  try {
    Json document = Json::parse(stream);
    std::set<std::int64_t> observed;
    for (const Json& a : document.at("annotations")) {
      for (const Json& s : a.at("segments_info")) {
        observed.insert(s.at("category_id").get<std::int64_t>());
      }
    }
    const std::vector<std::int64_t> classes(observed.begin(), observed.end());
    std::size_t hit = 0, things = 0;
    for (Json& a : document.at("annotations")) {
      const std::uint64_t frame = hash_of(a.at("file_name").get<std::string>());
      for (Json& s : a.at("segments_info")) {
        const auto category = s.at("category_id").get<std::int64_t>();
        if (!labels.at(labels.index_of(static_cast<std::int32_t>(category))).thing) continue;
        ++things;
        const auto id = s.at("id").get<std::uint64_t>();
        if (uniform(seed, frame, id) >= share || classes.size() < 2) continue;
        std::vector<std::int64_t> others;
        for (const std::int64_t c : classes) {
          if (c != category) others.push_back(c);
        }
        const double pick = uniform(seed + 1, frame, id) * static_cast<double>(others.size());
        s["category_id"] = others[std::min(others.size() - 1, static_cast<std::size_t>(pick))];
        ++hit;
      }
    }
    make_output_folder(output);
    for (const Json& a : document.at("annotations")) {
      const fs::path name = fs::path(a.at("file_name").get<std::string>()).filename();
      fs::copy_file(fs::path(folder) / name, fs::path(output) / name,
                    fs::copy_options::overwrite_existing);
    }
    write_file_atomic(json_out, document.dump());
    std::printf("relabelled %zu of %zu thing segments\n", hit, things);
  } catch (const Json::exception& error) {
    throw InputError(json_in + ": is not a COCO panoptic file: " + error.what());
  } catch (const fs::filesystem_error& error) {
    throw InputError(error.what());
  }
}

/// Smooth noise of unit variance: Gaussian numbers on a coarse grid, interpolated bilinearly.
double smooth_noise(std::uint64_t seed, std::uint64_t frame, double x, double y) {
  const double fx = std::floor(x), fy = std::floor(y), a = x - fx, b = y - fy;
  const auto node = [&](double dx, double dy) {
    return gaussian(seed, frame, static_cast<std::uint64_t>((fy + dy) * 4096 + fx + dx));
  };
  const double value = (1 - b) * ((1 - a) * node(0, 0) + a * node(1, 0)) +
                       b * ((1 - a) * node(0, 1) + a * node(1, 1));
  const double norm = std::sqrt(((1 - a) * (1 - a) + a * a) * ((1 - b) * (1 - b) + b * b));
  return value / norm;
}

Rgb16Image to_kitti(const FlowField& flow) {
  Rgb16Image out(flow.u.width(), flow.u.height());
  for (std::size_t i = 0; i < out.size(); ++i) {
    const float u = flow.u.data()[i], v = flow.v.data()[i];
    if (!std::isfinite(u) || std::abs(u) > 511 || std::abs(v) > 511) continue;
    out.data()[i] = {static_cast<std::uint16_t>(std::lround(64 * u + 32768)),
                     static_cast<std::uint16_t>(std::lround(64 * v + 32768)), 1};
  }
  return out;
}

/// Adds to each component `relative` times the flow's length times noise: independent per pixel, or
/// correlated over `correlation` px.
void disturb_flow(const std::string& folder, const std::string& output, double relative,
                  double correlation, std::uint64_t seed, FieldEncoding encoding) {
  make_output_folder(output);
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(folder)) files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  double sum = 0, count = 0;
  std::size_t done = 0;
  for (const fs::path& file : files) {
    FlowField flow = read_flow(file, encoding);
    const std::uint64_t frame = hash_of(file.stem().string());
    for (int y = 0; y < flow.u.height(); ++y) {
      for (int x = 0; x < flow.u.width(); ++x) {
        float& u = flow.u.at(x, y);
        float& v = flow.v.at(x, y);
        if (!std::isfinite(u)) continue;
        const auto pixel = static_cast<std::uint64_t>(y) * 65536 + static_cast<std::uint64_t>(x);
        const double scale = relative * std::hypot(u, v);
        const double nu = correlation > 0
                              ? smooth_noise(seed, frame, x / correlation, y / correlation)
                              : gaussian(seed, frame, pixel);
        const double nv = correlation > 0
                              ? smooth_noise(seed + 1, frame, x / correlation, y / correlation)
                              : gaussian(seed + 1, frame, pixel);
        u += static_cast<float>(scale * nu);
        v += static_cast<float>(scale * nv);
        sum += scale * std::hypot(nu, nv);
        ++count;
      }
    }
    write_png(fs::path(output) / (file.stem().string() + ".png"), to_kitti(flow));
    if (++done % 20 == 0 || done == files.size()) {
      std::fprintf(stderr, "flow %zu/%zu\n", done, files.size());
    }
  }
  std::printf("mean error %.2f px\n", count > 0 ? sum / count : 0.0);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Puts errors into perception outputs; build priors from the result.");
  app.require_subcommand(1);
  std::string input, output, label_space = "coco_panoptic_133";
  double share = 0.1, relative = 0.06, correlation = 0;
  std::uint64_t seed = 1;
  FieldEncoding encoding = FieldEncoding::kKitti;
  const std::map<std::string, FieldEncoding> encodings = {{"kitti", FieldEncoding::kKitti},
                                                          {"vkitti", FieldEncoding::kVkitti}};
  auto* segments = app.add_subcommand("segments", "Relabel thing segments (COCO panoptic folder)");
  auto* flow = app.add_subcommand("flow", "Noise in proportion to the flow; writes KITTI PNG");
  for (auto* command : {segments, flow}) {
    command->add_option("input", input, "Folder")->required();
    command->add_option("--output", output, "Folder to write to")->required();
    command->add_option("--seed", seed, "Seed")->capture_default_str();
  }
  segments->add_option("--share", share, "Of thing segments, 0..1; smaller ones are subsets")
      ->check(CLI::Range(0.0, 1.0));
  segments->add_option("--label-space", label_space, "Label space");
  flow->add_option("--relative", relative, "Noise per component, of the flow's length")
      ->check(CLI::Range(0.0, 10.0));
  flow->add_option("--correlation", correlation,
                   "px over which errors are alike (0: independent pixels, as in the paper)")
      ->check(CLI::Range(0.0, 1000.0));
  flow->add_option("--encoding", encoding, "Of PNGs: kitti, vkitti")
      ->transform(CLI::CheckedTransformer(encodings));
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  try {
    while (input.size() > 1 && input.back() == '/') input.pop_back();
    while (output.size() > 1 && output.back() == '/') output.pop_back();
    if (!fs::is_directory(input)) throw InputError(input + ": is not a folder");
    if (segments->parsed()) {
      relabel(input, output, share, seed, kys::load_label_space(label_space));
    } else {
      disturb_flow(input, output, relative, correlation, seed, encoding);
    }
  } catch (const std::exception& error) {
    std::cerr << "perturb_priors: " << error.what() << "\n";
    return 2;
  }
  return 0;
}
