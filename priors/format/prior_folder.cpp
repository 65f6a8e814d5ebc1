// SPDX-License-Identifier: BSD-3-Clause
#include <fcntl.h>
#include <kys/error.h>
#include <kys/label_space.h>
#include <kys_slam/calibration_hash.h>
#include <kys_slam/error.h>
#include <kys_slam/prior_folder.h>
#include <kys_slam/util/paths.h>
#include <unistd.h>

#include <algorithm>
#include <optional>
#include <vector>

namespace kys_slam {

namespace fs = std::filesystem;

namespace {

bool holds_priors(const fs::path& folder) {
  const std::vector<fs::path> entries = list_folder(folder);
  return std::any_of(entries.begin(), entries.end(),
                     [](const fs::path& p) { return p.extension() == ".kysp"; });
}

/// The folder itself, or the folder `priors` in it, which make_priors.py fills.
fs::path folder_of_priors(const fs::path& folder) {
  if (holds_priors(folder)) return folder;
  const fs::path inside = folder / "priors";
  if (is_folder(inside) && holds_priors(inside)) return inside;
  throw InputError(folder.string() + ": has no prior files (*.kysp)");
}

bool can_load(const std::string& label_space) {
  try {
    (void)kys::load_label_space(label_space);
    return true;
  } catch (const kys::Error&) {
    return false;
  }
}

/// Nothing for a damaged file: it may be of no frame that is fed, else it is refused then.
std::optional<std::string> label_space_of(const fs::path& file) {
  try {
    return PriorFile::open(file).label_space();
  } catch (const InputError&) {
    return std::nullopt;
  }
}

}  // namespace

std::string label_space_of_priors(const fs::path& folder) {
  for (const fs::path& file : list_prior_files(folder)) {
    const std::optional<std::string> name = label_space_of(file);
    if (!name) continue;
    if (can_load(*name)) return *name;
    const fs::path place = file.parent_path();
    for (const fs::path& beside : {place / *name, place.parent_path() / *name}) {
      if (can_load(beside.string())) return beside.string();
    }
    return *name;
  }
  return "";
}

ExpectedPriors expected_priors(const StereoCamera& camera, const std::string& label_space) {
  ExpectedPriors e;
  e.width = camera.width;
  e.height = camera.height;
  e.calibration_hash = calibration_hash(camera);
  try {
    const kys::LabelSpace space = kys::load_label_space(label_space);
    e.label_space = space.name();  // the setting may be a path
    e.label_count = space.size();
  } catch (const kys::Error& error) {
    throw InputError(error.what());
  }
  return e;
}

PriorFolder::PriorFolder(const fs::path& folder, ExpectedPriors expected, bool strict, Warning warn)
    : folder_(folder_of_priors(folder)),
      expected_(std::move(expected)),
      strict_(strict),
      warn_(std::move(warn)) {}

fs::path PriorFolder::path_of(const std::string& name) const {
  return folder_ / (name + ".kysp");
}

std::optional<PriorFile> PriorFolder::load(const std::string& name) {
  const fs::path path = path_of(name);
  if (!path_exists(path)) {
    const std::string message = path.string() + ": no prior file for this frame";
    if (strict_) throw InputError(message);
    if (missing_++ == 0 && warn_) warn_(message + "; it has no priors (reported once)");
    return std::nullopt;
  }
  std::optional<PriorFile> file = PriorFile::open(path, expected_);
  ++loaded_;
  return file;
}

bool PriorFolder::look_up(const StereoFrame& frame, std::span<const Keypoint> left,
                          std::span<const Keypoint> right, std::vector<kys::Prior>& left_priors,
                          std::vector<kys::Prior>& right_priors) {
  last_.reset();  // load() may throw
  last_ = load(frame.name);
  if (!last_) return false;
  left_priors.resize(left.size());
  right_priors.resize(right.size());
  last_->lookup(CameraSide::kLeft, left, left_priors);
  last_->lookup(CameraSide::kRight, right, right_priors);
  return true;
}

std::span<const kys::Prior> PriorFolder::segments() const {
  return last_ ? last_->segment_priors(CameraSide::kLeft) : std::span<const kys::Prior>();
}

void PriorFolder::prefetch(const std::string& name) const {
#ifdef POSIX_FADV_WILLNEED
  const int fd = ::open(path_of(name).c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (fd < 0) return;
  ::posix_fadvise(fd, 0, 0, POSIX_FADV_WILLNEED);
  ::close(fd);
#else
  (void)name;
#endif
}

std::vector<fs::path> list_prior_files(const fs::path& input) {
  if (!is_folder(input)) return {input};
  std::vector<fs::path> files;
  for (const fs::path& path : list_folder(folder_of_priors(input))) {
    if (path.extension() == ".kysp") files.push_back(path);
  }
  sort_frames(files);
  return files;
}

}  // namespace kys_slam
