// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/label_space.h>
#include <kys_slam/stereo_camera.h>

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "priors/fusion/fusion_times.h"
#include "priors/fusion/options.h"
#include "priors/input/field_input.h"
#include "priors/input/panoptic_input.h"

namespace kys_slam {

/// The sequence that priors are made for. `read` returns the rectified pair at a position; it is
/// called from several threads.
struct BuildSequence {
  StereoCamera camera;
  std::vector<std::string> names;     ///< stems of the left images
  std::vector<double> timestamps;     ///< s, of the frames; needed for keypoints
  std::array<std::string, 2> images;  ///< names of the folders of left and right images
  /// Left and right image of the frames. Priors made from images are built again when these change.
  std::vector<std::array<std::filesystem::path, 2>> files;
  std::function<std::pair<GrayImage, GrayImage>(std::size_t)> read;

  /// s, of a frame; without time stamps, frames are at 10 Hz.
  [[nodiscard]] double time_of(std::size_t t) const {
    return t < timestamps.size() ? timestamps[t] : 0.1 * static_cast<double>(t);
  }
};

/// Sources of perception outputs. A source is a folder, "" (none), or the name of an estimator.
struct BuildInputs {
  std::array<std::filesystem::path, 2> panoptic;  ///< left, right; right may be empty
  PanopticEncoding panoptic_encoding = PanopticEncoding::kAuto;
  std::string disparity;            ///< folder, "sgbm" or ""
  std::string disparity_right;      ///< folder or "" (the left one is warped)
  std::array<std::string, 2> flow;  ///< folder, "dis" or ""
  bool keypoints = false;           ///< also judge by stereo keypoints (detection.method: robust)
  /// Flow from t+1 to t for the consistency check: folder or "". File names: find_back_flow().
  std::array<std::string, 2> flow_back;
  FieldEncoding disparity_encoding = FieldEncoding::kUnspecified;
  FieldEncoding flow_encoding = FieldEncoding::kUnspecified;
};

struct BuildSettings {
  BuilderOptions options;
  std::filesystem::path output;
  int jobs = 1;
  bool debug_images = false;
  bool rebuild = false;  ///< build also files that are complete and current
  std::function<void(const std::string& stage, std::size_t done, std::size_t total)> progress;
};

/// Time of the stages, ms, both cameras, without reading and perception.
struct BuildTimes {
  double association = 0, depth = 0;
  FusionTimes fusion;
  double encoding = 0;
  /// Estimates from the images: disparity, optical flow, keypoints. Not part of total().
  double stereo = 0, flow = 0, keypoints = 0;

  [[nodiscard]] double total() const { return association + depth + fusion.total() + encoding; }
  BuildTimes& operator+=(const BuildTimes& other) {
    association += other.association;
    depth += other.depth;
    fusion += other.fusion;
    encoding += other.encoding;
    stereo += other.stereo;
    flow += other.flow;
    keypoints += other.keypoints;
    return *this;
  }
};

struct BuildSummary {
  std::size_t frames = 0, built = 0, kept = 0;
  std::array<std::int64_t, 2> tracks{};  ///< identities given, left and right
  std::size_t thing_segments = 0;        ///< over all frames and cameras
  std::size_t dynamic_segments = 0, radial_only_segments = 0;
  double flagged_pixels = 0;  ///< share of all pixels of built frames
  double labelled_pixels = 0;
  std::size_t frames_without_motion = 0;  ///< no flow, or no fit, left camera
  std::uint64_t bytes = 0;                ///< of all prior files
  BuildTimes times;                       ///< sums over built frames (association: all frames)
};

/// What build_sequence_priors() checks before it reads any file. \throws InputError.
void check_build(const BuildSequence& sequence, const BuildInputs& inputs,
                 const BuildSettings& settings);

/// Makes the prior files of a sequence: <output>/<name>.kysp, segments.csv, background.csv. Files
/// that are complete and current are kept. The bytes do not depend on `jobs`. \throws InputError
/// naming the file and what is wrong with it; files already written stay.
BuildSummary build_sequence_priors(const BuildSequence& sequence, const kys::LabelSpace& labels,
                                   const BuildInputs& inputs, const BuildSettings& settings);

}  // namespace kys_slam
