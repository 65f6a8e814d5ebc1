// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image.h>

#include <array>
#include <filesystem>
#include <optional>
#include <utility>
#include <vector>

#include "priors/builder/build_sequence.h"
#include "priors/fusion/depth.h"
#include "priors/fusion/fuse.h"

namespace kys_slam {

using ImagePair = std::pair<GrayImage, GrayImage>;      // left, right
using DisparityPair = std::array<ImageOf<float>, 2>;    // px, left, right; empty: not known
using FramePerception = std::vector<CameraPerception>;  // by camera

/// Disparity and flow of the frames of a sequence, from files or estimated from the images.
class SequenceFields {
 public:
  /// Keeps references to all arguments.
  SequenceFields(const BuildSequence& sequence, const BuildInputs& inputs,
                 const BuilderOptions& options)
      : sequence_(sequence), inputs_(inputs), options_(options) {}

  /// Disparity (px) of both views; of the right one only where it is read or estimated.
  [[nodiscard]] DisparityPair disparities(std::size_t t, const ImagePair& now) const;
  /// Disparities that agree, of both views: the right one's from the left one where there is none.
  void complete(DisparityPair& disparity, const FramePerception& perception) const;
  /// Flow (px) of camera `c` to the next frame, after the consistency check of the options.
  [[nodiscard]] std::optional<FlowField> flow(std::size_t c, std::size_t t,
                                              const CameraPerception& in, const GrayImage& now,
                                              const GrayImage& next) const;

 private:
  void check_size(const std::filesystem::path& path, const ImageOf<float>& field) const;
  [[nodiscard]] ImageOf<float> warp(const ImageOf<float>& left, const FramePerception& in) const;

  const BuildSequence& sequence_;
  const BuildInputs& inputs_;
  const BuilderOptions& options_;
};

}  // namespace kys_slam
