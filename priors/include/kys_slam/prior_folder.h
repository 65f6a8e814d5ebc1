// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/prior_file.h>
#include <kys_slam/prior_provider.h>

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace kys_slam {

/// Requirements for the prior files of a run.
/// \param label_space built-in name, or path prefix of a user's two files
/// \throws InputError when there is no such label space
ExpectedPriors expected_priors(const StereoCamera& camera, const std::string& label_space);

/// The label space of the prior files in a folder as control.label_space takes it: its name, or the
/// path of its two files in the folder or beside it; "" when no file can be read.
/// \param folder as for PriorFolder
/// \throws InputError when it has no prior files
std::string label_space_of_priors(const std::filesystem::path& folder);

/// The prior files of one sequence, one per frame, found by the frame's name. For one thread.
class PriorFolder : public PriorProvider {
 public:
  /// Reported once, when the first file is missing.
  using Warning = std::function<void(const std::string& message)>;

  /// \param folder of the files, or one that has them in a folder `priors`
  /// \param strict true: a missing file is an error
  /// \throws InputError when `folder` is not a folder with at least one prior file in it.
  PriorFolder(const std::filesystem::path& folder, ExpectedPriors expected, bool strict = false,
              Warning warn = {});

  /// The priors of a frame (`name` is the stem of the left image: "000123"), or nothing when it has
  /// no file. \throws InputError naming the file when it is corrupt, does not meet the
  /// requirements, or is missing and `strict` is set.
  std::optional<PriorFile> load(const std::string& name);

  /// \throws InputError as `load`.
  bool look_up(const StereoFrame& frame, std::span<const Keypoint> left,
               std::span<const Keypoint> right, std::vector<kys::Prior>& left_priors,
               std::vector<kys::Prior>& right_priors) override;
  [[nodiscard]] std::span<const kys::Prior> segments() const override;

  /// Requests that the operating system loads the file of a frame into memory; returns at once.
  void prefetch(const std::string& name) const;

  [[nodiscard]] std::size_t loaded() const { return loaded_; }    ///< files
  [[nodiscard]] std::size_t missing() const { return missing_; }  ///< frames without a file

 private:
  [[nodiscard]] std::filesystem::path path_of(const std::string& name) const;

  std::filesystem::path folder_;
  ExpectedPriors expected_;
  bool strict_ = false;
  Warning warn_;
  std::optional<PriorFile> last_;  // of the frame looked up last
  std::size_t loaded_ = 0;
  std::size_t missing_ = 0;
};

/// The prior files of a folder in the order of frames (sort_frames), or `input` itself when it is
/// a file. \throws InputError when there are none.
std::vector<std::filesystem::path> list_prior_files(const std::filesystem::path& input);

}  // namespace kys_slam
