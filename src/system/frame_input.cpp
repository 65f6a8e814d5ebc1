#include <fmt/format.h>
#include <kys_slam/error.h>
#include <kys_slam/feature_file.h>
#include <kys_slam/frame_input.h>
#include <kys_slam/settings.h>
#include <kys_slam/util/paths.h>

#include <cmath>
#include <fstream>
#include <utility>

#include "system/private_access.h"
#include "system/settings_data.h"
#include "system/system_options.h"

namespace kys_slam {

namespace {

FrameInput open_feature_file(const std::filesystem::path& path, const SequenceOptions& options) {
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
  std::unique_ptr<Sequence> sequence = open_folder(path, options);
  FrameInput input;
  input.name = sequence->name();
  input.layout = sequence->layout();
  input.ground_truth = sequence->ground_truth();
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
