// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/check_options.h>
#include <kys_slam/feature_extractor.h>

#include "features/pair_extractor.h"
#include "system/private_access.h"
#include "system/settings_data.h"

namespace kys_slam {

std::unique_ptr<FeatureExtractor> make_orb_extractor(const Settings& settings) {
  const OrbOptions& options = PrivateAccess::data(settings).orb;
  check_options(options);
  return make_orb_extractor(options);
}

}  // namespace kys_slam
