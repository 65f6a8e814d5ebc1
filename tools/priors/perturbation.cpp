// SPDX-License-Identifier: BSD-3-Clause
#include "perturbation.h"

#include <kys_slam/error.h>
#include <kys_slam/image_file.h>
#include <kys_slam/util/atomic_file.h>
#include <kys_slam/util/hash.h>
#include <kys_slam/util/paths.h>
#include <kys_slam/util/read_bytes.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "priors/input/coco_categories.h"
#include "priors/input/json_input.h"
#include "seeded_random.h"

namespace kys_slam {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;
constexpr const char* kSource = "images.txt";

double gaussian(std::uint64_t seed, std::uint64_t a, std::uint64_t b) {
  const double u = std::max(seeded_uniform(seed, a, 2 * b), 1e-300),
               v = seeded_uniform(seed, a, 2 * b + 1);
  return std::sqrt(-2 * std::log(u)) * std::cos(2 * 3.14159265358979323846 * v);
}

std::uint64_t hash_of(const std::string& text) {
  Fnv1a hash;
  hash.add(text);
  return hash.value();
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

/// images.txt says of which cameras' images perception was made; build_priors reads it.
void copy_source(const fs::path& folder, const fs::path& output) {
  constexpr std::size_t kMostBytes = 4096;
  if (!path_exists(folder / kSource)) return;
  write_file_atomic(output / kSource, read_text(folder / kSource, kMostBytes));
}

void check_apart(const std::string& folder, const std::string& output) {
  if (is_same_path(folder, output)) throw InputError("--output " + output + ": is the input");
}

}  // namespace

Relabelling relabel_segments(const std::string& folder, const std::string& output, double share,
                             std::uint64_t seed, const kys::LabelSpace& labels) {
  check_apart(folder, output);
  const std::string json_in = folder + ".json", json_out = output + ".json";
  const std::string text = read_text(json_in);
  try {
    Json document = parse_json(text, json_in);
    const std::map<std::int64_t, std::uint16_t> label_of =
        coco_categories(document, labels, json_in);
    std::set<std::int64_t> observed;
    for (const Json& a : document.at("annotations")) {
      for (const Json& s : a.at("segments_info")) {
        observed.insert(integer_at<std::int64_t>(s, "category_id", json_in));
      }
    }
    const std::vector<std::int64_t> classes(observed.begin(), observed.end());
    std::size_t hit = 0, things = 0;
    for (Json& a : document.at("annotations")) {
      const std::uint64_t frame = hash_of(a.at("file_name").get<std::string>());
      for (Json& s : a.at("segments_info")) {
        const auto category = integer_at<std::int64_t>(s, "category_id", json_in);
        const auto label = label_of.find(category);
        if (label == label_of.end()) throw unknown_category(category, labels, json_in);
        if (!labels.at(label->second).thing) continue;
        ++things;
        const auto id = integer_at<std::uint64_t>(s, "id", json_in);
        if (seeded_uniform(seed, frame, id) >= share || classes.size() < 2) continue;
        std::vector<std::int64_t> others;
        for (const std::int64_t c : classes) {
          if (c != category) others.push_back(c);
        }
        const double pick =
            seeded_uniform(seed + 1, frame, id) * static_cast<double>(others.size());
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
    copy_source(folder, output);
    write_file_atomic(json_out, document.dump());
    return {hit, things};
  } catch (const Json::exception& error) {
    throw InputError(json_in + ": is not a COCO panoptic file: " + error.what());
  } catch (const fs::filesystem_error& error) {
    throw InputError(error.path1().string() + ": " + error.code().message());
  }
}

double disturb_flow(const std::string& folder, const std::string& output, double relative,
                    double correlation, std::uint64_t seed, FieldEncoding encoding) {
  check_apart(folder, output);
  std::vector<fs::path> files = list_folder(folder);
  std::erase_if(files, [](const fs::path& file) { return file.filename() == kSource; });
  if (files.empty()) throw InputError(folder + ": has no flow");
  make_output_folder(output);
  copy_source(folder, output);
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
  return count > 0 ? sum / count : 0.0;
}

}  // namespace kys_slam
