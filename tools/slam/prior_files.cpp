#include "prior_files.h"

#include <kys/error.h>
#include <kys_slam/error.h>
#include <kys_slam/run_main.h>
#include <spdlog/spdlog.h>

#include "priors/format/calibration_hash.h"

namespace kys_slam {

namespace {

ExpectedPriors expected(const StereoCamera& camera, const std::string& label_space) {
  ExpectedPriors e;
  e.width = camera.width;
  e.height = camera.height;
  e.calibration_hash = calibration_hash(camera);
  e.label_space = label_space;
  try {
    e.label_count = kys::load_label_space(label_space).size();
  } catch (const kys::Error& error) {
    throw InputError(error.what());
  }
  return e;
}

}  // namespace

PriorFiles::PriorFiles(const std::filesystem::path& folder, const StereoCamera& camera,
                       const std::string& label_space, bool strict)
    : source_(folder, expected(camera, label_space), strict,
              [](const std::string& message) { spdlog::warn("{}", printable(message)); }) {}

bool PriorFiles::look_up(const StereoFrame& frame, std::span<const Keypoint> left,
                         std::span<const Keypoint> right, std::vector<kys::Prior>& left_priors,
                         std::vector<kys::Prior>& right_priors) {
  const std::optional<PriorFile> file = source_.load(frame.name);
  if (!file) return false;
  left_priors.resize(left.size());
  right_priors.resize(right.size());
  file->lookup(CameraSide::kLeft, left, left_priors);
  file->lookup(CameraSide::kRight, right, right_priors);
  return true;
}

}  // namespace kys_slam
