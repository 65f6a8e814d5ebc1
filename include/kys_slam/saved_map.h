// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/map_observations.h>
#include <kys_slam/map_snapshot.h>

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

namespace kys_slam {

/// What a map file says beside keyframes and landmarks.
struct MapInfo {
  int version = 0;  ///< of the file's format
  std::string label_space;
  StereoCamera camera;    ///< the given calibration
  RigEstimate rig;        ///< the correction of what was measured
  std::string extractor;  ///< of the features: "orb", or another name
  int levels = 0;         ///< of the pyramid in which features were found
  double scale_factor = 1;
  std::size_t culled = 0;        ///< keyframes of which a pose alone is left
  std::size_t features = 0;      ///< of all keyframes
  std::size_t stereo = 0;        ///< of these with a disparity
  std::size_t aligned = 0;       ///< of these aligned with the patch of their landmark
  std::size_t labelled = 0;      ///< of these with a class
  std::size_t observations = 0;  ///< of landmarks
  bool rows = false;             ///< rows in the right images were measured
  bool beliefs = false;          ///< landmarks have a probability of being static
};

/// How observations changed.
struct AssociationReport {
  int dropped = 0;  ///< observations that do not agree with the map
  int found = 0;  ///< observations of landmarks in keyframes that had not matched them, and merges
};

/// How two maps were joined.
struct MergeReport {
  bool merged = false;        ///< there is a common place
  std::size_t keyframes = 0;  ///< of the other map that were compared
  int candidates = 0;         ///< places that were verified
  int fused = 0;              ///< landmarks that became one
  struct Place {
    std::uint32_t keyframe = 0;  ///< id in the merged map, of the other map
    std::uint32_t place = 0;     ///< id of the keyframe that it was found at
    bool joined = false;         ///< two sub-maps became one; else drift was corrected
    double gap = 0;              ///< m, of this drift
  };
  std::vector<Place> places;
};

/// A map that a run has saved (System::save_map), to be read, adjusted and written again. A
/// value that can be moved. Not thread-safe.
class SavedMap {
 public:
  /// \throws InputError naming the file: no map, damaged, of a newer format
  explicit SavedMap(const std::filesystem::path& file);
  SavedMap(SavedMap&&) noexcept;
  SavedMap& operator=(SavedMap&&) noexcept;
  ~SavedMap();

  [[nodiscard]] MapInfo info() const;
  /// `frames` is one past the last keyframe's, `main_submap` the one with most keyframes.
  [[nodiscard]] MapSnapshot snapshot() const;
  /// \throws InputError when no landmark is observed often enough
  [[nodiscard]] MapObservations observations(
      const MapSelection& selection = MapSelection::all()) const;

  /// Takes over poses, landmarks and correction of what `observations` returned and was adjusted.
  /// Other landmarks, and those that are not finite or beyond 1000 km, keep their place as seen
  /// from their reference keyframe, by its disparity where the correction has changed. Keyframes
  /// that are not among these do not move. \throws std::invalid_argument when it is of another map,
  /// or a pose or the correction is not finite
  void update(const MapObservations& adjusted);

  /// Finds observations anew by poses, landmarks and correction as they are now: drops those beyond
  /// the 95 % bound of the noise, and looks for landmarks in covisible keyframes by projection and
  /// descriptor. A map that was made with a wrong
  /// calibration has what agreed with that one.
  AssociationReport associate();

  /// Adds another map of the same rig. Places are found, verified and joined as a run closes loops
  /// (LoopCloser). Ids of the other map are moved behind those of this one. Without a common place
  /// this map does not change.
  /// \throws InputError when the rigs differ, or the label spaces
  MergeReport merge(const SavedMap& other, const std::atomic<bool>* stop = nullptr);

  /// The file of a map that runs continue. \throws InputError when it cannot be written
  void write(const std::filesystem::path& file) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace kys_slam
