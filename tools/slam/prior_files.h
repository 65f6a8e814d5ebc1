#pragma once

#include <kys/label_space.h>
#include <kys_slam/prior_provider.h>

#include <string>

#include "priors/format/prior_source.h"

namespace kys_slam {

/// Priors from the prior files of a sequence, one file per frame.
class PriorFiles : public PriorProvider {
 public:
  /// \param strict a missing file is an error
  /// \throws InputError when the folder holds no prior files
  PriorFiles(const std::filesystem::path& folder, const StereoCamera& camera,
             const std::string& label_space, bool strict);

  bool look_up(const StereoFrame& frame, std::span<const Keypoint> left,
               std::span<const Keypoint> right, std::vector<kys::Prior>& left_priors,
               std::vector<kys::Prior>& right_priors) override;

  [[nodiscard]] std::int64_t missing() const {
    return static_cast<std::int64_t>(source_.missing());
  }

 private:
  PriorSource source_;
};

}  // namespace kys_slam
