// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image.h>

#include <filesystem>
#include <string>

#include "priors/fusion/depth.h"

namespace kys_slam {

/// PNG encodings that a file does not identify itself.
enum class FieldEncoding {
  kKitti,        ///< disparity u16/256; flow u = (R - 32768)/64, B valid
  kVkitti,       ///< depth u16 in cm, 65535 sky; flow u = (2 R/65535 - 1)(w - 1), B 0 invalid
  kUnspecified,  ///< as kKitti; InputError for PNGs with names of Virtual KITTI 2
};

/// The disparity of a frame in a folder: <name>_disp.pfm or, of the right image,
/// <name>_disp_right.pfm (UniMatch); <name>.png, .npy or .pfm; of rgb_<number> also
/// depth_<number>.png (Virtual KITTI 2). \throws InputError when there is none.
std::filesystem::path find_disparity(const std::filesystem::path& folder, const std::string& name);
std::filesystem::path find_right_disparity(const std::filesystem::path& folder,
                                           const std::string& name);
/// The flow to the next frame: <name>_pred.flo (UniMatch); <name>.png, .npy or .flo; of
/// rgb_<number> also flow_<number>.png (Virtual KITTI 2). \throws InputError when there is none.
std::filesystem::path find_flow(const std::filesystem::path& folder, const std::string& name);

/// The file with the flow from frame `next` back to frame `name`: <name>_pred_bwd.flo (UniMatch);
/// <name>.png, .npy or .flo. Virtual KITTI 2 names it by `next` (backwardFlow_<number>.png).
/// \throws InputError when there is none.
std::filesystem::path find_back_flow(const std::filesystem::path& folder, const std::string& name,
                                     const std::string& next);

/// Left disparity (px, NaN where there is none) from KITTI PNG, PFM or NPY; with kVkitti, from a
/// depth PNG and `bf` (focal length times baseline, px m).
ImageOf<float> read_disparity(const std::filesystem::path& path, FieldEncoding encoding, double bf);

/// Flow (px, NaN where there is none) from KITTI or VKITTI PNG, .flo or NPY (h x w x 2 or
/// 2 x h x w).
FlowField read_flow(const std::filesystem::path& path, FieldEncoding encoding);

}  // namespace kys_slam
