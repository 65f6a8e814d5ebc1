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
  std::uint64_t seed = 0;          ///< chooses the bits the hash tables look at
  int tables = 8;                  ///< 1 to 16; more find more and take longer
  std::size_t max_bucket = 64;     ///< landmarks; fuller buckets say nothing and are skipped
  std::size_t max_features = 800;  ///< of a query: those of the strongest response
  float max_distance = 50;         ///< bits, modulated: only nearer landmarks vote
  float margin = 4;  ///< bits, behind a feature's nearest landmark, of others it takes
};
/// For check_options().
void describe(kys::OptionList& list, PlaceOptions& options);

/// Which keyframes show the place a frame shows? Place recognition without a vocabulary: hash
/// tables over the descriptors of all landmarks, grown with the map; the features of a query vote
/// for the keyframes that observe the landmarks they resemble. A consumer of change sets, like the
/// replica. Answers depend on the present content and the options, not on the order in which it
/// came in. Queries do not change the index: any number of threads may ask at the same time.
class PlaceIndex {
 public:
  /// \throws InputError when an option makes no sense.
  explicit PlaceIndex(const PlaceOptions& options = {});

  /// Brings the index up to date. Landmarks whose descriptors did not change cost next to nothing.
  void apply(const ChangeSet& changes);

  /// Keyframes by how well they match, best first (ties: lower id), one for each group of covisible
  /// keyframes.
  ///
  /// Every feature finds its nearest landmark (modulated distance, temporal context) and those
  /// nearly as near, among the landmarks that some allowed keyframe observes; a landmark found by
  /// several features belongs to the nearest one. Then every feature votes, once, for each allowed
  /// keyframe that observes a landmark of its own: the more the nearer that landmark is, the less
  /// the more keyframes there are to vote for. The score of a keyframe is that of the best group (a
  /// keyframe and its covisible neighbours) that it is the best member of: votes over the number of
  /// landmarks that the members observe, which are taken to be a typical keyframe's number more
  /// than they are, so that few votes for a small group are no high share.
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
  std::vector<kys::Prior> priors_;  // as far as anyone has a label
  std::vector<ListPool::List> observers_;
  ListPool observer_pool_;

  IdTable<KeyFrameId, std::vector<KeyFrameId>> keyframes_;  // alive; their covisible neighbours
  std::vector<std::uint32_t> landmark_count_;               // by keyframe id
};

}  // namespace kys_slam
