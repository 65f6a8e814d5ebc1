#pragma once

#include <kys_slam/prior_file.h>
#include <kys_slam/prior_provider.h>

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace kys_slam {

/// What the prior files of a run have to be made for. \throws InputError when there is no such
/// label space (a name of the built-in ones, or the common beginning of a user's two files).
ExpectedPriors expected_priors(const StereoCamera& camera, const std::string& label_space);

/// The prior files of one sequence, one per frame, found by the frame's name. One reader; no
/// threads.
class PriorFolder : public PriorProvider {
 public:
  /// Reported once, when the first file is missing.
  using Warning = std::function<void(const std::string& message)>;

  /// \param strict  a missing file is an error
  /// \throws InputError when `folder` is not a folder with at least one prior file in it.
  PriorFolder(std::filesystem::path folder, ExpectedPriors expected, bool strict = false,
              Warning warn = {});

  /// The priors of a frame (`name` is the stem of the left image: "000123"), or nothing when there
  /// is no file for it; that is an error when `strict`.
  /// \throws InputError naming the file when it is corrupt or made for something else.
  std::optional<PriorFile> load(const std::string& name);

  /// \throws InputError as `load`.
  bool look_up(const StereoFrame& frame, std::span<const Keypoint> left,
               std::span<const Keypoint> right, std::vector<kys::Prior>& left_priors,
               std::vector<kys::Prior>& right_priors) override;

  /// Asks the operating system to have a frame's file in memory soon; returns at once.
  void prefetch(const std::string& name) const;

  [[nodiscard]] std::size_t loaded() const { return loaded_; }    ///< files
  [[nodiscard]] std::size_t missing() const { return missing_; }  ///< frames without a file

 private:
  [[nodiscard]] std::filesystem::path path_of(const std::string& name) const;

  std::filesystem::path folder_;
  ExpectedPriors expected_;
  bool strict_ = false;
  Warning warn_;
  std::size_t loaded_ = 0;
  std::size_t missing_ = 0;
};

/// The file itself, or the prior files of a folder in order of name.
/// \throws InputError when there are none.
std::vector<std::filesystem::path> list_prior_files(const std::filesystem::path& input);

}  // namespace kys_slam
