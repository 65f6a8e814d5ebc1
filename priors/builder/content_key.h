// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/label_space.h>

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "priors/builder/build_sequence.h"
#include "priors/fusion/fuse.h"
#include "priors/input/panoptic_input.h"

namespace kys_slam {

/// Whether priors are also made from the images of the sequence, and when these were taken.
bool reads_images(const BuildInputs& inputs, const BuilderOptions& options);

/// Keys of prior files: hashes of all that a file is made from. A file is current when it holds the
/// key of its frame.
class ContentKeys {
 public:
  /// Keeps references to all arguments. \param readers  by camera
  ContentKeys(const BuildSequence& sequence, const kys::LabelSpace& labels,
              const BuildInputs& inputs, const BuilderOptions& options,
              const std::vector<PanopticReader>& readers);

  /// Key of frame `t`, without frames after the next one.
  /// \param perception  by camera, with instances
  /// \param before  key of the frame before, if the decisions depend on it; else 0
  [[nodiscard]] std::uint64_t of_frame(std::size_t t, std::span<const CameraPerception> perception,
                                       std::uint64_t before) const;

 private:
  const BuildSequence& sequence_;
  const kys::LabelSpace& labels_;
  const BuildInputs& inputs_;
  const BuilderOptions& options_;
  const std::vector<PanopticReader>& readers_;
  std::uint64_t classes_;  ///< hash of the label space's classes
};

/// Key of a frame whose decision depends on later ones: the key of the last of them covers all that
/// come before it.
std::uint64_t key_with_later(const std::string& name, std::uint64_t last);

}  // namespace kys_slam
