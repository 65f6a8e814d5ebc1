// SPDX-License-Identifier: BSD-3-Clause
#include "decision_errors.h"

#include <kys/error.h>
#include <kys_slam/error.h>
#include <kys_slam/prior_folder.h>
#include <kys_slam/prior_format.h>
#include <kys_slam/util/atomic_file.h>
#include <kys_slam/util/nearest_name.h>
#include <kys_slam/util/progress.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <optional>

#include "seeded_random.h"

namespace kys_slam {
namespace {

namespace fs = std::filesystem;
namespace pf = prior_format;

constexpr double kDropShare = 0.3;
constexpr std::size_t kLongestDrop = 8;     // frames
constexpr double kFlipProbability = 0.3;    // per instance and stretch
constexpr std::uint64_t kFlipStretch = 10;  // frames
constexpr int kBleedRadius = 8;             // px
constexpr float kSure = 100.0F;             // score and mu of what is wrongly called moving

/// Motion that was read from a file is written as it was.
const MotionCoding kExact = {.tolerance_steps = 0};

/// Numbers of one purpose do not depend on those of another.
enum Stream : std::uint64_t { kLengths = 1, kPlaces = 2, kFlips = 1'000'000 };

std::vector<bool> vehicle_labels(const kys::LabelSpace& labels) {
  static const std::array<std::string, 13> names = {
      "bicycle", "car",  "motorcycle", "minibike", "bus", "train", "truck",
      "van",     "boat", "ship",       "Truck",    "Car", "Van"};
  std::vector<bool> out(labels.size());
  for (std::size_t i = 0; i < out.size(); ++i) {
    out[i] = std::find(names.begin(), names.end(), labels.classes()[i].name) != names.end();
  }
  return out;
}

/// Changes the decisions of one file. `frame` counts the files of the folder.
class Disturbance {
 public:
  /// \param labels  of all files; without, the label space that a file names
  Disturbance(DecisionError error, std::uint64_t seed, const std::optional<kys::LabelSpace>& labels)
      : error_(error), seed_(seed) {
    if (!labels) return;
    label_space_ = labels->name();
    vehicle_ = vehicle_labels(*labels);
  }

  void apply(FramePriors& priors, std::uint64_t frame) {
    priors.content_key = 0;  // no longer what its inputs would give
    if (error_ == DecisionError::kSegmentsOnly) priors.has_motion = false;
    for (CameraPriors& camera : priors.cameras) {
      if (error_ == DecisionError::kBleed) {
        grow_moving_segments(camera, kBleedRadius);
        continue;
      }
      for (std::size_t k = 0; k < camera.segments.size(); ++k) {
        const PriorSegment& segment = camera.segments[k];
        if (!(segment.flags & pf::kThing)) continue;
        const bool was = (segment.flags & pf::kDynamic) != 0;
        const bool is = decide(segment, was, priors.label_space, frame);
        if (is != was) set_moving(camera, k, is);
      }
    }
  }

 private:
  bool decide(const PriorSegment& segment, bool was, const std::string& label_space,
              std::uint64_t frame) {
    switch (error_) {
      case DecisionError::kParked:
        if (label_space != label_space_) {
          vehicle_ = vehicle_labels(kys::load_label_space(label_space));
          label_space_ = label_space;
        }
        return was || (segment.label < vehicle_.size() && vehicle_[segment.label]);
      case DecisionError::kBlind:
      case DecisionError::kSegmentsOnly:
        return false;
      case DecisionError::kFlip:
        return was !=
               (seeded_uniform(seed_, kFlips + frame / kFlipStretch,
                               static_cast<std::uint64_t>(segment.instance)) < kFlipProbability);
      default:
        return was;
    }
  }

  DecisionError error_;
  std::uint64_t seed_;
  std::string label_space_;
  std::vector<bool> vehicle_;
};

void count_things(const FramePriors& priors, std::size_t* things, std::size_t& moving) {
  for (const CameraPriors& camera : priors.cameras) {
    for (const PriorSegment& s : camera.segments) {
      if (things != nullptr && (s.flags & pf::kThing)) ++*things;
      if ((s.flags & pf::kThing) && (s.flags & pf::kDynamic)) ++moving;
    }
  }
}

void check_output(const fs::path& output) {
  make_output_folder(output);
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(output, error)) {
    if (entry.path().extension() == ".kysp") {
      throw InputError(output.string() + ": has prior files in it already");
    }
  }
}

}  // namespace

const std::vector<std::string>& decision_error_names() {
  static const std::vector<std::string> names = {"parked", "blind", "drop",         "flip",
                                                 "late",   "bleed", "segments-only"};
  return names;
}

DecisionError parse_decision_error(const std::string& word) {
  const auto& names = decision_error_names();
  const auto found = std::find(names.begin(), names.end(), word);
  if (found == names.end()) {
    throw InputError("unknown case '" + word + "'" + did_you_mean(word, names));
  }
  return static_cast<DecisionError>(found - names.begin());
}

std::vector<bool> kept_frames(std::size_t frames, std::uint64_t seed) {
  const auto dropped =
      static_cast<std::size_t>(std::lround(kDropShare * static_cast<double>(frames)));
  std::vector<std::size_t> stretches;
  for (std::size_t sum = 0; sum < dropped; sum += stretches.back()) {
    const double draw = seeded_uniform(seed, kLengths, stretches.size());
    const auto length = 1 + static_cast<std::size_t>(draw * static_cast<double>(kLongestDrop));
    stretches.push_back(std::min(length, dropped - sum));
  }
  // At most one stretch before each kept frame and after the last: stretches do not touch.
  std::vector<std::size_t> places(frames - dropped + 1);
  std::iota(places.begin(), places.end(), std::size_t{0});
  std::vector<std::size_t> length_at(places.size(), 0);
  for (std::size_t i = 0; i < stretches.size(); ++i) {
    const double draw = seeded_uniform(seed, kPlaces, i);
    const auto j = i + static_cast<std::size_t>(draw * static_cast<double>(places.size() - i));
    std::swap(places[i], places[j]);
    length_at[places[i]] = stretches[i];
  }
  std::vector<bool> kept;
  for (std::size_t i = 0; i < length_at.size(); ++i) {
    kept.insert(kept.end(), length_at[i], false);
    if (i + 1 < length_at.size()) kept.push_back(true);
  }
  return kept;
}

void set_moving(CameraPriors& camera, std::size_t segment, bool moving) {
  PriorSegment& s = camera.segments[segment];
  s.flags = static_cast<std::uint16_t>(s.flags & ~(pf::kDynamic | pf::kRadialOnly));
  s.score = 0;
  if (!moving) return;
  s.flags = static_cast<std::uint16_t>((s.flags & ~pf::kNotJudged) | pf::kDynamic);
  s.score = kSure;
  const ImageOf<std::uint16_t>& map = camera.segment_map;
  if (camera.motion.empty()) camera.motion = ImageOf<float>(map.width(), map.height());
  for (std::size_t i = 0; i < map.size(); ++i) {
    if (map.data()[i] == segment + 1) camera.motion.data()[i] = kSure;
  }
}

void grow_moving_segments(CameraPriors& camera, int radius) {
  const ImageOf<std::uint16_t> map = camera.segment_map;
  const ImageOf<float> motion = camera.motion;
  const auto moving_at = [&](int x, int y) {
    if (x < 0 || y < 0 || x >= map.width() || y >= map.height()) return false;
    const std::uint16_t s = map.at(x, y);
    return s > 0 && (camera.segments[s - 1u].flags & pf::kDynamic);
  };
  ImageOf<int> nearest(map.width(), map.height(), radius * radius + 1);  // squared distance, px^2
  const auto stamp = [&](int x0, int y0) {
    for (int y = std::max(0, y0 - radius); y <= std::min(map.height() - 1, y0 + radius); ++y) {
      for (int x = std::max(0, x0 - radius); x <= std::min(map.width() - 1, x0 + radius); ++x) {
        const int square = (x - x0) * (x - x0) + (y - y0) * (y - y0);
        if (square >= nearest.at(x, y) || moving_at(x, y)) continue;
        nearest.at(x, y) = square;
        camera.segment_map.at(x, y) = map.at(x0, y0);
        camera.motion.at(x, y) = motion.at(x0, y0);
      }
    }
  };
  for (int y = 0; y < map.height(); ++y) {
    for (int x = 0; x < map.width(); ++x) {
      if (!moving_at(x, y)) continue;
      const bool inside =
          moving_at(x - 1, y) && moving_at(x + 1, y) && moving_at(x, y - 1) && moving_at(x, y + 1);
      if (!inside) stamp(x, y);
    }
  }
  std::vector<double> before(camera.segments.size() + 1), after(before.size());
  for (std::size_t i = 0; i < map.size(); ++i) {
    ++before[map.data()[i]];
    ++after[camera.segment_map.data()[i]];
  }
  for (std::size_t k = 0; k < camera.segments.size(); ++k) {
    if (before[k + 1] > 0) {
      camera.segments[k].scale *= static_cast<float>(after[k + 1] / before[k + 1]);
    }
  }
  camera.runs = {};
}

DecisionErrorCounts disturb_decisions(const fs::path& folder, const fs::path& output,
                                      DecisionError error, std::uint64_t seed,
                                      const std::string& label_space) {
  std::optional<kys::LabelSpace> labels;
  ExpectedPriors expected;
  if (!label_space.empty()) {
    labels = kys::load_label_space(label_space);
    expected.label_space = labels->name();
    expected.label_count = labels->size();
  }
  const std::vector<fs::path> files = list_prior_files(folder);
  check_output(output);
  std::vector<bool> kept(files.size(), true);
  if (error == DecisionError::kDrop) kept = kept_frames(files.size(), seed);
  Disturbance disturbance(error, seed, labels);
  DecisionErrorCounts counts;
  Progress progress("prior files", static_cast<std::int64_t>(files.size()));
  FramePriors last;
  for (std::size_t i = 0; i < files.size(); ++i) {
    FramePriors priors = decode_priors(PriorFile::open(files[i], expected));
    ++counts.files;
    count_things(priors, &counts.things, counts.moving_before);
    try {
      disturbance.apply(priors, i);
    } catch (const kys::Error& unknown) {
      throw InputError(files[i].string() + ": " + unknown.what() + " (--label-space)");
    }
    if (error == DecisionError::kLate) {
      std::swap(priors, last);
      if (i == 0) kept[i] = false;
    }
    if (kept[i]) {
      const fs::path path = output / files[i].filename();
      write_file_atomic(path, encode_priors(priors, path.string(), kExact), Durable::kNo);
      ++counts.written;
      count_things(priors, nullptr, counts.moving_after);
    }
    progress.update(static_cast<std::int64_t>(i + 1));
  }
  return counts;
}

}  // namespace kys_slam
