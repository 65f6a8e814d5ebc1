// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/sequence.h>
#include <kys_slam/stereo_rig.h>

#include <filesystem>
#include <memory>
#include <optional>

namespace kys_slam {

/// How the images of two folders are paired and when they were taken.
struct ImagePairOptions {
  SequenceOptions part;
  /// Frame rate (Hz) of images without time stamps. Not needed when file names are time stamps (13
  /// digits or more), an error when `times` is given. Stamps are in ns; where images would be less
  /// than 1 ms apart in ns, 16 digits are us and 13 digits ms. 16 digits are an error where images
  /// are 1 to 10 ms apart in ns: both units are possible.
  std::optional<double> rate;
  std::filesystem::path times;  ///< text, one time stamp (s) per left image; "": none
};
/// For check_options().
void describe(kys::OptionList& list, ImagePairOptions& options);

/// Opens the PNG or JPEG images of two folders, grey or colour, 8 or 16 bits. Names that are time
/// stamps are paired by time (part.pairing_tolerance), others by the number they end in. Images are
/// rectified unless the rig is a rectified pair (StereoRig::rectified()). \throws InputError naming
/// the file and what is wrong.
std::unique_ptr<Sequence> open_image_pair(const std::filesystem::path& left,
                                          const std::filesystem::path& right, StereoRig rig,
                                          const ImagePairOptions& options = {});

}  // namespace kys_slam
