#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>

#include "priors/format/prior_file.h"

namespace kys_slam {

/// The prior files of one sequence, by frame name. One reader; no threads.
class PriorSource {
 public:
  /// Told once, when the first file is missing.
  using Warning = std::function<void(const std::string& message)>;

  /// \throws InputError when `folder` is not a folder with at least one prior file in it.
  PriorSource(std::filesystem::path folder, ExpectedPriors expected, bool strict = false,
              Warning warn = {});

  /// The priors of a frame (`name` is the stem of the left image: "000123"), or nothing when there
  /// is no file for it; that is an error when `strict`.
  /// \throws InputError naming the file when it is corrupt or made for something else.
  std::optional<PriorFile> load(const std::string& name);

  /// Asks the operating system to have a frame's file in memory soon; returns at once.
  void prefetch(const std::string& name) const;

  [[nodiscard]] std::size_t loaded() const { return loaded_; }
  [[nodiscard]] std::size_t missing() const { return missing_; }

 private:
  [[nodiscard]] std::filesystem::path path_of(const std::string& name) const;

  std::filesystem::path folder_;
  ExpectedPriors expected_;
  bool strict_ = false;
  Warning warn_;
  std::size_t loaded_ = 0;
  std::size_t missing_ = 0;
};

}  // namespace kys_slam
