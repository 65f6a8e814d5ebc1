// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance_model.h>
#include <kys/option_list.h>

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "map/change_set.h"
#include "map/id_table.h"
#include "retrieval/descriptor_tables.h"
#include "retrieval/place_candidate.h"

namespace kys_slam {

struct PlaceOptions {
  std::uint64_t seed = 0;          ///< selects the bits of the hash tables
  int tables = 8;                  ///< 1 to 16; more find more and take longer
  std::size_t max_bucket = 64;     ///< landmarks; larger buckets are skipped as not distinctive
  std::size_t max_features = 800;  ///< of a query, those with the largest response
  float max_distance = 50;         ///< bits, modulated: farther landmarks do not vote
  float margin = 4;  ///< bits, largest excess over a feature's nearest landmark for other landmarks
};
/// For check_options().
void describe(kys::OptionList& list, PlaceOptions& options);

/// Finds the keyframes that show the same place as a frame. Place recognition without a vocabulary:
/// hash tables over the descriptors of all landmarks grow with the map. The features of a query
/// vote for the keyframes that observe matching landmarks. Updated by change sets, like the
/// replica. Results depend on the present content and the options, not on the order of updates.
/// Queries do not change the index: any number of threads may query at the same time.
class PlaceIndex {
 public:
  /// \throws InputError when an option is invalid.
  explicit PlaceIndex(const PlaceOptions& options = {});

  /// Applies a change set. Landmarks with unchanged descriptors take little time.
  void apply(const ChangeSet& changes);

  /// Candidates by score, best first (ties: lower id), one per group of covisible keyframes.
  ///
  /// Every feature finds its nearest landmark (modulated distance, temporal context), and those
  /// within `margin` of it, among the landmarks that allowed keyframes observe. A landmark found by
  /// several features is assigned to the nearest one. Then every feature votes once for each
  /// allowed keyframe that observes one of its landmarks. The weight of a vote falls with the
  /// distance of the landmark and with the number of these keyframes. A group is a keyframe and its
  /// covisible neighbours; its score is the sum of votes over the number of landmarks its members
  /// observe. A typical keyframe's number is added to that number, so that few votes for a small
  /// group do not give a high score. The score of a candidate is that of the best group of which it
  /// is the best member.
  /// \param excluded keyframes that get no votes, in any order
  [[nodiscard]] std::vector<PlaceCandidate> query(const FrameFeatures& features,
                                                  const kys::DistanceModel& model,
                                                  kys::Statistics& statistics,
                                                  std::span<const KeyFrameId> excluded,
                                                  std::size_t max_candidates) const;

  [[nodiscard]] std::size_t landmarks() const { return slot_of_.size() - absent_; }
  [[nodiscard]] std::size_t keyframes() const { return keyframes_.size(); }
  /// Approximate size in memory.
  [[nodiscard]] std::size_t bytes() const;

 private:
  class Search;

  void put(LandmarkId id, const LandmarkView& view);
  void erase(LandmarkId id);
  std::uint32_t new_slot(LandmarkId id);
  void set_prior(std::uint32_t slot, const kys::Prior& prior);
  void set_observers(std::uint32_t slot, std::span<const KeyFrameId> observers);
  [[nodiscard]] const kys::Prior& prior(std::uint32_t slot) const {
    return slot < priors_.size() ? priors_[slot] : kNoPrior;
  }

  static inline const kys::Prior kNoPrior{};
  static constexpr std::uint32_t kNoSlot = 0xFFFFFFFFu;

  PlaceOptions options_;
  DescriptorTables tables_;
  std::vector<std::uint32_t> slot_of_;  // by landmark id
  std::size_t absent_ = 0;              // of these, without slot
  std::vector<std::uint32_t> free_slots_;
  // By slot.
  std::vector<kys::Descriptor> descriptors_;
  std::vector<LandmarkId> ids_;
  std::vector<kys::Prior> priors_;  // empty while no landmark has a label
  std::vector<ListPool::List> observers_;
  ListPool observer_pool_;

  IdTable<KeyFrameId, std::vector<KeyFrameId>>
      keyframes_;                              // present ones; their covisible neighbours
  std::vector<std::uint32_t> landmark_count_;  // by keyframe id
};

}  // namespace kys_slam
