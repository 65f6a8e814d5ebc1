// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <vector>

#include "simulator/common/feature_path.h"
#include "simulator/features/landmarks.h"

namespace kys_slam::simulator {

/// Makes the landmarks of a world: a pass over the path for the static ones, and with traffic a
/// second one for those of the objects.
/// \param progress  called with the share of frames of a pass that are done; may be empty
LandmarkMap make_landmarks(const FeaturePath& path, const FeatureOptions& options,
                           const std::vector<FeatureObject>& objects,
                           const std::function<void(double)>& progress);

}  // namespace kys_slam::simulator
