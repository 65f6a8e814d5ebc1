// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/feature_extractor.h>

#include <array>
#include <memory>
#include <string>

#include "features/orb_extractor.h"
#include "features/pyramid.h"

namespace kys_slam {

/// \throws InputError for features that tables and grids of the matchers cannot take: more than
/// `most`, outside the image, of an octave that is not there, without a valid angle.
/// \param levels_said_by for the message: who says how many octaves there are
void check_feature_set(const FeatureSet& set, int width, int height, std::size_t levels,
                       std::size_t most, const std::string& where,
                       const std::string& levels_said_by);

/// ORB as an extractor of pairs.
std::unique_ptr<FeatureExtractor> make_orb_extractor(const OrbOptions& options);

/// An extractor, its features checked, and the reduced images that patches are compared in: those
/// of the extractor, or made here.
class PairExtractor {
 public:
  explicit PairExtractor(std::unique_ptr<FeatureExtractor> extractor);

  [[nodiscard]] const ExtractorTraits& traits() const { return extractor_->traits(); }
  /// \param frame name, for messages
  void extract(const GrayImage& left, const GrayImage& right, const std::string& frame,
               std::array<FeatureSet, 2>& features);
  /// Of the last pair; valid until the next call. \param side 0 left, 1 right
  [[nodiscard]] const ImagePyramid& pyramid(std::size_t side) const {
    const ImagePyramid* own = extractor_->pyramid(side);
    return own != nullptr ? *own : pyramids_[side];
  }

 private:
  std::unique_ptr<FeatureExtractor> extractor_;
  std::array<PyramidBuilder, 2> builders_;
  std::array<ImagePyramid, 2> pyramids_;
};

}  // namespace kys_slam
