// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image.h>
#include <kys_slam/prior_file.h>
#include <kys_slam/segment_runs.h>

#include <cstdint>
#include <string>
#include <vector>

namespace kys_slam {

/// The priors of one camera before they are encoded.
struct CameraPriors {
  std::vector<PriorSegment> segments;  ///< `area` is filled in by the encoder
  ImageOf<std::uint16_t> segment_map;  ///< (height, width); 0 void, k = segments[k-1]
  SegmentRuns runs;                    ///< of the map; found by the encoder when empty
  ImageOf<float> motion;  ///< (height, width); mu, 0..100, read in dynamic segments only; empty if
                          ///< there are none
};

/// The priors of one stereo frame before they are encoded.
struct FramePriors {
  std::string label_space;
  std::uint64_t calibration_hash = 0;
  std::uint64_t content_key = 0;
  bool has_motion = false;
  bool shares_instances = false;      ///< see PriorFile
  std::vector<CameraPriors> cameras;  ///< left, or left and right
};

/// How motion is coded.
struct MotionCoding {
  /// A run continues while ln(1 + mu) is within this many steps of 0.0181 of the run's value.
  int tolerance_steps = 2;
  /// mu and its coded value are on the same side of each of these gates (Sec. 3.4), so that coding
  /// never changes the result of a gate.
  std::vector<float> keep_sides = {8.0F, 20.0F};
};

/// Encodes a prior file. The same priors give the same bytes. \throws InputError, starting with
/// `name`, for sizes that differ, segment numbers that are not in the table, values that are out of
/// range or not finite.
std::vector<std::uint8_t> encode_priors(const FramePriors& priors, const std::string& name,
                                        const MotionCoding& coding = {});

/// Decodes a whole file to images. For tools, not for tracking.
FramePriors decode_priors(const PriorFile& file);

/// The code whose value is nearest to mu among those on its side of the `keep_sides`.
std::uint8_t motion_code(float mu, const MotionCoding& coding);

}  // namespace kys_slam
