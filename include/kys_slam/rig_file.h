// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rig_correction.h>
#include <kys_slam/stereo_rig.h>

#include <filesystem>
#include <optional>
#include <string>

namespace kys_slam {

/// A calibration file of our own (read_stereo_rig) can contain a correction of the rectified pair
/// that follows from it, as calibrate_rig writes it:
///
///     correction:
///       given: {width: 1241, height: 376, fx: 707, fy: 707, cx: 601, cy: 183, baseline: 0.537}
///       parameters: {left_k1: 0.011, ..., focal: -0.009}    # all of rig_parameter_names()
///       covariance:                                        # lower triangle by rows
///         [...]
struct CorrectionFile {
  StereoCamera given;  ///< the calibration that it corrects
  RigEstimate estimate;
};

/// The correction in a file; nothing when there is no key `correction`.
/// \throws InputError naming the file: unreadable, not YAML, or numbers that are missing, not
/// finite, or cannot be: no covariance, or displacements beyond a tenth of the image
std::optional<CorrectionFile> read_correction_file(const std::filesystem::path& file);

/// The correction in a file for this calibration. \throws InputError also when there is none, or
/// that of another calibration
RigEstimate read_rig_correction(const std::filesystem::path& file, const StereoCamera& given);

/// The key `correction` for a file.
std::string to_yaml(const CorrectionFile& correction);

/// A rectified pair as a rig of two cameras.
StereoRig rig_of(const StereoCamera& camera, const std::string& name);

}  // namespace kys_slam
