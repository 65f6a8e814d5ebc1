// SPDX-License-Identifier: BSD-3-Clause
#include "retrieval/place_index.h"

#include <kys_slam/check_options.h>
#include <kys_slam/error.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <string>
#include <utility>

#include "retrieval/place_voting.h"

namespace kys_slam {

void describe(kys::OptionList& list, PlaceOptions& o) {
  const kys::OptionList::Fixed fixed(list);
  list.add("places.tables", o.tables, {1, DescriptorTables::kMaxTables});
  list.add("places.max_bucket", o.max_bucket, {1, 1e9}, "landmarks");
  list.add("places.max_features", o.max_features, {1, 60000});
  list.add("places.max_distance", o.max_distance, {0.1, 1e6}, "bits");
  list.add("places.margin", o.margin, {0, 1e6}, "bits");
}

namespace {

/// The features of the strongest response, at most `count`, by index.
std::vector<std::uint32_t> strongest(const FrameFeatures& features, std::size_t count) {
  std::vector<std::uint32_t> chosen(features.size());
  std::iota(chosen.begin(), chosen.end(), 0u);
  if (count >= chosen.size()) return chosen;
  std::nth_element(chosen.begin(), chosen.begin() + static_cast<std::ptrdiff_t>(count),
                   chosen.end(), [&](std::uint32_t a, std::uint32_t b) {
                     const float response_a = features.keypoint(a).response;
                     const float response_b = features.keypoint(b).response;
                     return response_a != response_b ? response_a > response_b : a < b;
                   });
  chosen.resize(count);
  std::sort(chosen.begin(), chosen.end());
  return chosen;
}

}  // namespace

PlaceIndex::PlaceIndex(const PlaceOptions& options)
    : options_(checked(options)), tables_(options.tables, options.seed) {}

void PlaceIndex::apply(const ChangeSet& changes) {
  for (const LandmarkId id : changes.erased_landmarks) erase(id);
  for (const auto& [id, view] : changes.landmarks) put(id, view);
  for (const auto& [id, view] : changes.keyframes) keyframes_.put(id, view.neighbours);
  for (const CulledKeyFrame& culled : changes.culled_keyframes) keyframes_.erase(culled.id);
}

std::uint32_t PlaceIndex::new_slot(LandmarkId id) {
  std::uint32_t slot;
  if (free_slots_.empty()) {
    slot = static_cast<std::uint32_t>(descriptors_.size());
    descriptors_.emplace_back();
    ids_.emplace_back();
    observers_.emplace_back();
  } else {
    slot = free_slots_.back();
    free_slots_.pop_back();
  }
  if (id.value >= slot_of_.size()) {
    absent_ += id.value + std::size_t{1} - slot_of_.size();
    slot_of_.resize(id.value + std::size_t{1}, kNoSlot);
  }
  slot_of_[id.value] = slot;
  --absent_;
  ids_[slot] = id;
  return slot;
}

void PlaceIndex::put(LandmarkId id, const LandmarkView& view) {
  const bool known = id.value < slot_of_.size() && slot_of_[id.value] != kNoSlot;
  const std::uint32_t slot = known ? slot_of_[id.value] : new_slot(id);
  if (!known || descriptors_[slot] != view.descriptor) {
    if (known) tables_.erase(descriptors_[slot], slot);
    descriptors_[slot] = view.descriptor;
    tables_.insert(view.descriptor, slot);
  }
  set_prior(slot, view.prior);
  set_observers(slot, view.observers);
}

void PlaceIndex::erase(LandmarkId id) {
  if (id.value >= slot_of_.size() || slot_of_[id.value] == kNoSlot) return;
  const std::uint32_t slot = slot_of_[id.value];
  tables_.erase(descriptors_[slot], slot);
  set_observers(slot, {});
  set_prior(slot, kNoPrior);
  slot_of_[id.value] = kNoSlot;
  ++absent_;
  free_slots_.push_back(slot);
}

void PlaceIndex::set_prior(std::uint32_t slot, const kys::Prior& prior) {
  if (slot >= priors_.size()) {
    // Maps without priors store none.
    if (prior == kNoPrior) return;
    priors_.resize(descriptors_.size());
  }
  priors_[slot] = prior;
}

void PlaceIndex::set_observers(std::uint32_t slot, std::span<const KeyFrameId> observers) {
  ListPool::List& list = observers_[slot];
  const std::span<const std::uint32_t> present = observer_pool_.view(list);
  const bool same = std::equal(present.begin(), present.end(), observers.begin(), observers.end(),
                               [](std::uint32_t a, KeyFrameId b) { return a == b.value; });
  if (same) return;
  for (const std::uint32_t keyframe : present) --landmark_count_[keyframe];
  observer_pool_.clear(list);
  for (const KeyFrameId keyframe : observers) {
    observer_pool_.push(list, keyframe.value);
    if (keyframe.value >= landmark_count_.size()) {
      landmark_count_.resize(keyframe.value + std::size_t{1}, 0);
    }
    ++landmark_count_[keyframe.value];
  }
}

std::size_t PlaceIndex::bytes() const {
  return tables_.bytes() + observer_pool_.bytes() + slot_of_.capacity() * sizeof(slot_of_[0]) +
         descriptors_.capacity() *
             (sizeof(descriptors_[0]) + sizeof(ids_[0]) + sizeof(observers_[0])) +
         priors_.capacity() * sizeof(kys::Prior);
}

/// One query at work. Scratch as large as the map, made anew for each query.
class PlaceIndex::Search {
 public:
  Search(const PlaceIndex& index, const FrameFeatures& features, const kys::DistanceModel& model,
         std::span<const KeyFrameId> excluded)
      : index_(index),
        features_(features),
        model_(model),
        chosen_(strongest(features, index.options_.max_features)),
        met_(index.descriptors_.size(), 0),
        votes_(index.landmark_count_) {
    votes_.allow(index.keyframes_.ids(), excluded);
  }

  PlaceVotes run(kys::Statistics& statistics) {
    look_up_keys();
    for (std::size_t n = 0; n < chosen_.size(); ++n) find(n, statistics);
    keep_nearest_feature();
    vote();
    return std::move(votes_);
  }

 private:
  struct Match {
    float distance;
    std::uint32_t slot;
    std::uint32_t feature;  // number among the chosen ones
    kys::Tier tier;
  };

  [[nodiscard]] std::span<const std::uint32_t> observers(std::uint32_t slot) const {
    return index_.observer_pool_.view(index_.observers_[slot]);
  }
  /// Nearer, or as near and of the lower id.
  [[nodiscard]] bool precedes(const Match& a, const Match& b) const {
    return a.distance != b.distance ? a.distance < b.distance
                                    : index_.ids_[a.slot] < index_.ids_[b.slot];
  }

  void look_up_keys() {
    const int tables = index_.tables_.tables();
    keys_.reserve(chosen_.size() * static_cast<std::size_t>(tables));
    for (const std::uint32_t i : chosen_) {
      for (int t = 0; t < tables; ++t) {
        keys_.push_back(static_cast<std::uint32_t>(index_.tables_.key(features_.descriptor(i), t)));
      }
    }
  }

  /// Landmarks that share a bucket with chosen feature number n, each once, and their memory on
  /// its way. Buckets of the features to come are fetched ahead.
  void collect(std::size_t n) {
    constexpr std::size_t kAhead = 2;  // features
    const auto tables = static_cast<std::size_t>(index_.tables_.tables());
    const std::size_t first = n * tables;
    for (std::size_t k = first; k < first + tables; ++k) {
      if (k + 2 * kAhead * tables < keys_.size()) {
        index_.tables_.prefetch_handle(keys_[k + 2 * kAhead * tables]);
      }
      if (k + kAhead * tables < keys_.size()) {
        index_.tables_.prefetch_numbers(keys_[k + kAhead * tables]);
      }
    }
    slots_.clear();
    const auto turn = static_cast<std::uint16_t>(n + 1);
    for (std::size_t k = first; k < first + tables; ++k) {
      const std::span<const std::uint32_t> bucket = index_.tables_.bucket(keys_[k]);
      if (bucket.size() > index_.options_.max_bucket) continue;
      for (const std::uint32_t slot : bucket) {
        if (met_[slot] == turn) continue;
        met_[slot] = turn;
        slots_.push_back(slot);
        __builtin_prefetch(&index_.descriptors_[slot]);
      }
    }
  }

  /// The nearest landmark of chosen feature number n, and those nearly as near: a corner that was
  /// mapped twice, in two visits, is two landmarks, and the feature is of both.
  void find(std::size_t n, kys::Statistics& statistics) {
    collect(n);
    const std::size_t first = matches_.size();
    const std::uint32_t i = chosen_[n];
    for (const std::uint32_t slot : slots_) {
      const kys::Distance d = model_.evaluate(
          features_.descriptor(i), features_.prior(i), index_.descriptors_[slot],
          index_.prior(slot), kys::Context::kTemporal, index_.options_.max_distance, statistics);
      if (d.value < index_.options_.max_distance && votes_.any_allowed(observers(slot))) {
        matches_.push_back({d.value, slot, static_cast<std::uint32_t>(n), d.tier});
      }
    }
    if (first == matches_.size()) return;
    const auto begin = matches_.begin() + static_cast<std::ptrdiff_t>(first);
    std::sort(begin, matches_.end(),
              [&](const Match& a, const Match& b) { return precedes(a, b); });
    statistics.accept(begin->tier);
    const float limit = begin->distance + index_.options_.margin;
    while (matches_.back().distance > limit) matches_.pop_back();
  }

  /// A feature of the frame is one landmark's: without this a repeated pattern in the query gives a
  /// keyframe that shows it once a vote for every repetition.
  void keep_nearest_feature() {
    std::sort(matches_.begin(), matches_.end(), [](const Match& a, const Match& b) {
      if (a.slot != b.slot) return a.slot < b.slot;
      return a.distance != b.distance ? a.distance < b.distance : a.feature < b.feature;
    });
    matches_.erase(std::unique(matches_.begin(), matches_.end(),
                               [](const Match& a, const Match& b) { return a.slot == b.slot; }),
                   matches_.end());
    std::sort(matches_.begin(), matches_.end(), [&](const Match& a, const Match& b) {
      return a.feature != b.feature ? a.feature < b.feature : precedes(a, b);
    });
  }

  void vote() {
    for (std::size_t m = 0; m < matches_.size();) {
      const std::uint32_t feature = matches_[m].feature;
      votes_.begin_feature();
      for (; m < matches_.size() && matches_[m].feature == feature; ++m) {
        const double closeness = 1 - matches_[m].distance / index_.options_.max_distance;
        votes_.add(observers(matches_[m].slot), closeness);
      }
      votes_.end_feature();
    }
  }

  const PlaceIndex& index_;
  const FrameFeatures& features_;
  const kys::DistanceModel& model_;
  std::vector<std::uint32_t> chosen_;  // features that vote
  std::vector<std::uint32_t> keys_;    // by chosen feature, then table
  std::vector<std::uint16_t> met_;     // by slot: the last chosen feature (from 1) that met it
  std::vector<std::uint32_t> slots_;   // candidates of one feature
  std::vector<Match> matches_;         // of all
  PlaceVotes votes_;
};

std::vector<PlaceCandidate> PlaceIndex::query(const FrameFeatures& features,
                                              const kys::DistanceModel& model,
                                              kys::Statistics& statistics,
                                              std::span<const KeyFrameId> excluded,
                                              std::size_t max_candidates) const {
  return Search(*this, features, model, excluded)
      .run(statistics)
      .candidates(keyframes_, max_candidates);
}

}  // namespace kys_slam
