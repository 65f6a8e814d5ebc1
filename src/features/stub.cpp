#include "features/orb_extractor.h"
namespace kys_slam { struct OrbExtractor::Impl { ImagePyramid p; };
OrbExtractor::OrbExtractor(const OrbOptions&) : impl_(new Impl) {}
OrbExtractor::~OrbExtractor()=default; OrbExtractor::OrbExtractor(OrbExtractor&&) noexcept=default; OrbExtractor& OrbExtractor::operator=(OrbExtractor&&) noexcept=default;
void OrbExtractor::extract(const GrayImage&, FeatureSet& f){f.clear();} const ImagePyramid& OrbExtractor::pyramid() const {return impl_->p;} void OrbOptions::check() const {} }
