// SPDX-License-Identifier: BSD-3-Clause
#include <kys/portable_math.h>
#include <kys_slam/error.h>
#include <kys_slam/saved_map.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <string>

#include "map/take_snapshot.h"
#include "map_file/map_file.h"
#include "mapping/observations_of_map.h"
#include "saved_map/adjust_map.h"
#include "saved_map/associate_map.h"
#include "saved_map/merge_map.h"

namespace kys_slam {

struct SavedMap::Impl {
  StoredMap stored;
  std::string name;
};

SavedMap::SavedMap(const std::filesystem::path& file)
    : impl_(std::make_unique<Impl>(Impl{load_stored_map(file), file.string()})) {}
SavedMap::SavedMap(SavedMap&&) noexcept = default;
SavedMap& SavedMap::operator=(SavedMap&&) noexcept = default;
SavedMap::~SavedMap() = default;

MapInfo SavedMap::info() const {
  const Map& map = impl_->stored.map;
  MapInfo info;
  info.version = impl_->stored.version;
  info.label_space = impl_->stored.label_space;
  info.camera = map.camera();
  info.rig = map.rig_estimate();
  info.extractor = map.scales().extractor;
  info.levels = map.scales().levels();
  info.scale_factor = kys::portable::exp(static_cast<double>(map.scales().log_factor));
  info.culled = map.contents().culled.size();
  info.beliefs = map.keeps_beliefs();
  map.keyframes().for_each([&](KeyFrameId, const KeyFrame& keyframe) {
    const FrameFeatures& features = *keyframe.features;
    info.features += features.size();
    info.rows = info.rows || features.measures_rows();
    for (std::size_t i = 0; i < features.size(); ++i) {
      info.stereo += features.has_stereo(i) ? 1 : 0;
      info.aligned += features.is_aligned(i) ? 1 : 0;
      info.labelled += features.prior(i).label != kys::kVoidLabel ? 1 : 0;
    }
  });
  map.landmarks().for_each([&](LandmarkId, const Landmark& landmark) {
    info.observations += landmark.observations.size();
  });
  return info;
}

MapSnapshot SavedMap::snapshot() const {
  const Map& map = impl_->stored.map;
  MapSnapshot snapshot = take_snapshot(map);
  std::map<std::uint32_t, std::size_t> keyframes;
  std::size_t most = 0;
  for (const MapSnapshot::KeyFrame& k : snapshot.keyframes) {
    if (++keyframes[k.submap] <= most) continue;
    most = keyframes[k.submap];
    snapshot.main_submap = k.submap;
  }
  map.keyframes().for_each([&](KeyFrameId, const KeyFrame& k) {
    snapshot.frames = std::max(snapshot.frames, k.frame_index + 1);
  });
  return snapshot;
}

MapObservations SavedMap::observations(const MapSelection& selection) const {
  return observations_of_map(impl_->stored.map, selection, impl_->name);
}

void SavedMap::update(const MapObservations& adjusted) {
  adjust_map(impl_->stored.map, adjusted);
}

AssociationReport SavedMap::associate() {
  return associate_map(impl_->stored.map);
}

MergeReport SavedMap::merge(const SavedMap& other, const std::atomic<bool>* stop) {
  StoredMap& ours = impl_->stored;
  const StoredMap& theirs = other.impl_->stored;
  const bool both_labelled = ours.map.contents().has_priors() && theirs.map.contents().has_priors();
  if (both_labelled && ours.label_space != theirs.label_space) {
    throw InputError(other.impl_->name + ": has classes of '" + theirs.label_space + "', " +
                     impl_->name + " of '" + ours.label_space + "'");
  }
  const MergeReport report = merge_map(ours.map, theirs.map, other.impl_->name, stop);
  if (ours.label_space.empty()) ours.label_space = theirs.label_space;
  return report;
}

void SavedMap::write(const std::filesystem::path& file) const {
  save_map(impl_->stored.map, file, impl_->stored.label_space);
}

}  // namespace kys_slam
