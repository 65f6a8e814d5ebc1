// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance_model.h>
#include <kys/option_list.h>

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "map/frame_features.h"

namespace kys_slam {

/// Search for a landmark, or a feature of another frame, around a predicted pixel.
struct SearchQuery {
  float u = 0;        ///< px, predicted in the left image
  float v = 0;        ///< px
  float u_right = 0;  ///< px, predicted in the right image; NaN: not compared
  float radius = 0;   ///< px, half side of the search square
  int min_octave = 0;
  int max_octave = 0;
  float angle = 0;  ///< rad, orientation of the searched feature
  const kys::Descriptor* descriptor = nullptr;
  const kys::Prior* prior = nullptr;
};

/// A query for feature `i` of another frame at its predicted position: in its octave and the two
/// neighbouring ones, with its orientation, descriptor and prior. The caller sets the radius.
/// \param pixel u, v, u_right, px
SearchQuery query_for_feature(const FrameFeatures& features, std::size_t i,
                              const Eigen::Vector3d& pixel, const ScaleLevels& scales);

struct SearchOptions {
  float max_distance = 100;     ///< bits, largest modulated distance accepted
  float ratio = 1.0f;           ///< best / second best of the same octave; 1: not tested
  bool check_rotation = false;  ///< keep matches in the three fullest bins of relative orientation
  bool check_error = false;     ///< candidates must reproject within the 95 % chi-square bound
  kys::Context context = kys::Context::kTemporal;
  std::span<const std::uint8_t> taken;  ///< features that are excluded, one flag each; empty: none
};
/// For check_options().
void describe(kys::OptionList& list, SearchOptions& options);

struct SearchMatch {
  std::int32_t feature = -1;  ///< -1: none
  float distance = 0;
};

/// For every query the best feature around its predicted pixel. A feature chosen by several queries
/// is assigned to the one with the least distance (ties: the first). Every distance comes from
/// `model`.
std::vector<SearchMatch> search_features(const FrameFeatures& features, const ScaleLevels& scales,
                                         std::span<const SearchQuery> queries,
                                         const SearchOptions& options,
                                         const kys::DistanceModel& model,
                                         kys::Statistics& statistics);

/// Rotation consistency: of 30 bins of relative orientation `turns` (rad) the three fullest are
/// kept, if they have at least a tenth of the matches of the fullest. \return one flag per match,
/// 1: kept
std::vector<std::uint8_t> consistent_rotations(std::span<const float> turns);

}  // namespace kys_slam
