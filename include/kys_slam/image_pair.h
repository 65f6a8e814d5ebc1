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
  /// Frame rate (Hz) of images without time stamps; a gap in their numbers is a gap in time. Not
  /// needed when file names are time stamps (13 digits or more), an error when `times` is given.
  /// Stamps are in the unit (ms, us, ns) in which images are 1 ms to 10 s apart (median), in Unix
  /// time or less than a year after some start; an error when several units are possible.
  std::optional<double> rate;
  /// Text, one time stamp per left image, or per image of the whole recording from number 0 on; "":
  /// none. First column, or the second one behind a counter; s, or a unit as above.
  std::filesystem::path times;
};
/// For check_options().
void describe(kys::OptionList& list, ImagePairOptions& options);

/// Opens the PNG or JPEG images of two folders, grey or colour, 8 or 16 bits. Names that are time
/// stamps are paired by time (part.pairing_tolerance), others by the number they end in; those
/// without a partner are left out and counted. Images are rectified unless the rig is a rectified
/// pair (StereoRig::rectified()). \throws InputError naming the file and what is wrong.
std::unique_ptr<Sequence> open_image_pair(const std::filesystem::path& left,
                                          const std::filesystem::path& right, StereoRig rig,
                                          const ImagePairOptions& options = {});

}  // namespace kys_slam
