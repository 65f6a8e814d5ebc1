// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <kys_slam/error.h>
#include <kys_slam/feature_file.h>
#include <kys_slam/frame_input.h>
#include <kys_slam/settings.h>
#include <kys_slam/util/hash.h>
#include <kys_slam/util/paths.h>

#include <cmath>
#include <fstream>
#include <utility>

#include "system/private_access.h"
#include "system/settings_data.h"
#include "system/system_options.h"

namespace kys_slam {

namespace {

/// \param file  that the first frame is in, or features of it; its first bytes are enough
std::string recording_of(std::int64_t index, double timestamp, const std::filesystem::path& file) {
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(file, ignored)) return "";
  std::string bytes(std::size_t{64} << 10, '\0');
  std::ifstream in(file, std::ios::binary);
  in.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  bytes.resize(static_cast<std::size_t>(in.gcount()));
  if (bytes.empty()) return "";
  Fnv1a digest;
  digest.add(fmt::format("{:.9f} ", timestamp));
  digest.add(bytes);
  return fmt::format("frame {}: {:016x}", index, digest.value());
}

FrameInput open_feature_file(const std::filesystem::path& path, const SequenceOptions& options) {
  if (options.pair != CameraPair::kFirst) {
    throw InputError(path.string() + ": has no camera pairs; a choice is for KITTI odometry");
  }
  auto features =
      std::make_unique<FeatureSequence>(path, options.start, options.frames.value_or(-1));
  FrameInput input;
  input.name = path.stem().string();
  input.ground_truth = features->ground_truth();
  input.layout = "features";
  input.has_images = false;
  input.scale_factor = features->info().scale_factor;
  input.levels = features->info().levels;
  input.label_space = features->info().label_space;
  input.recording = recording_of(0, 0, path);
  input.frames = std::move(features);
  return input;
}

}  // namespace

FrameInput open_frame_input(const std::filesystem::path& path, const SequenceOptions& options,
                            const OpenSequence& open_folder) {
  if (is_file(path)) {
    if (!std::ifstream(path)) throw InputError("cannot read " + path.string());
    if (!is_feature_file(path)) {
      throw InputError(path.string() + ": neither the folder of a sequence nor a feature file");
    }
    return open_feature_file(path, options);
  }
  return frame_input_of(open_folder(path, options), options.start);
}

FrameInput frame_input_of(std::unique_ptr<Sequence> sequence, std::int64_t start) {
  FrameInput input;
  input.name = sequence->name();
  input.layout = sequence->layout();
  input.ground_truth = sequence->ground_truth();
  const Sequence::Frame& first = sequence->frame(0);
  input.recording = recording_of(start, first.timestamp, first.left);
  input.notes = sequence->notes();
  if (sequence->dropped() > 0) input.left_out["images without a partner"] = sequence->dropped();
  if (sequence->missing() > 0) {
    input.left_out["images that are listed, but not there"] = sequence->missing();
  }
  input.frames = std::move(sequence);
  return input;
}

void check_features(const FrameInput& input, const Settings& settings,
                    const std::filesystem::path& path) {
  if (input.has_images) return;
  const OrbOptions& orb = PrivateAccess::data(settings).orb;
  const std::string wanted = label_space_name(settings.get("control.label_space"));
  if (!input.label_space.empty() && input.label_space != wanted) {
    throw InputError(fmt::format("{}: its priors have labels of {}; control.label_space says {}",
                                 path.string(), input.label_space, wanted));
  }
  if (orb.levels == input.levels && std::abs(orb.scale_factor - input.scale_factor) < 1e-9) return;
  throw InputError(fmt::format(
      "{}: its features have {} octaves at {:g}; orb.levels, orb.scale_factor say {} at {:g}",
      path.string(), input.levels, input.scale_factor, orb.levels, orb.scale_factor));
}

}  // namespace kys_slam
