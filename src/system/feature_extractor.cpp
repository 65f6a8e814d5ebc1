// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/check_options.h>
#include <kys_slam/feature_extractor.h>

#include "features/orb_extractor.h"
#include "system/private_access.h"
#include "system/settings_data.h"

namespace kys_slam {

namespace {

const OrbOptions& checked(const OrbOptions& options) {
  check_options(options);
  return options;
}

}  // namespace

struct FeatureExtractor::Impl {
  OrbExtractor orb;
};

FeatureExtractor::FeatureExtractor(const Settings& settings)
    : impl_(new Impl{OrbExtractor(checked(PrivateAccess::data(settings).orb))}) {}
FeatureExtractor::FeatureExtractor(FeatureExtractor&&) noexcept = default;
FeatureExtractor& FeatureExtractor::operator=(FeatureExtractor&&) noexcept = default;
FeatureExtractor::~FeatureExtractor() = default;

void FeatureExtractor::extract(const GrayImage& image, FeatureSet& features) {
  impl_->orb.extract(image, features);
}

}  // namespace kys_slam
