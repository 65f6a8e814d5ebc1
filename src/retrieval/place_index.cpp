#include "retrieval/place_index.h"

#include <kys_slam/error.h>

#include <algorithm>
#include <cmath>

#include "retrieval/place_voting.h"

namespace kys_slam {

void PlaceOptions::check() const {
  const auto require = [](bool ok, const char* what) {
    if (!ok) throw InputError(std::string("places.") + what);
  };
  require(tables >= 1 && tables <= DescriptorTables::kMaxTables, "tables: from 1 to 16 expected");
  require(max_bucket >= 1, "max_bucket: at least 1 expected");
  require(max_features >= 1, "max_features: at least 1 expected");
  require(std::isfinite(max_distance) && max_distance >= 0,
          "max_distance: a number of bits expected");
  require(std::isfinite(margin) && margin >= 0, "margin: a number of bits expected");
}

namespace {

const PlaceOptions& checked(const PlaceOptions& options) {
  options.check();
  return options;
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

/// Votes of one query. Scratch as large as the map, made anew for each query.
class PlaceIndex::Voting {
 public:
  Voting(const PlaceIndex& index, std::span<const KeyFrameId> excluded)
      : index_(index), seen_(index.descriptors_.size(), 0), votes_(index.landmark_count_) {
    votes_.allow(index.keyframes_.ids(), excluded);
  }

  /// Feature number `turn` (from 1) of the query votes.
  void vote(const kys::Descriptor& descriptor, const kys::Prior& prior, std::uint32_t turn,
            const kys::DistanceModel& model, kys::Statistics& statistics) {
    collect(descriptor, turn);
    compare(descriptor, prior, model, statistics);
    if (matches_.empty()) return;
    // Nearest first: a keyframe's vote is for the nearest of its landmarks.
    std::sort(matches_.begin(), matches_.end(), [&](const Match& a, const Match& b) {
      return a.distance.value != b.distance.value ? a.distance.value < b.distance.value
                                                  : index_.ids_[a.slot] < index_.ids_[b.slot];
    });
    votes_.begin_feature();
    const float limit = matches_.front().distance.value + index_.options_.margin;
    for (const Match& match : matches_) {
      if (match.distance.value > limit) break;
      votes_.add(observers(match.slot));
    }
    votes_.end_feature();
    statistics.accept(matches_.front().distance.tier);
  }

  [[nodiscard]] const PlaceVotes& votes() const { return votes_; }

 private:
  struct Match {
    kys::Distance distance;
    std::uint32_t slot;
  };

  [[nodiscard]] std::span<const std::uint32_t> observers(std::uint32_t slot) const {
    return index_.observer_pool_.view(index_.observers_[slot]);
  }

  /// Landmarks that share a bucket with the descriptor, each once.
  void collect(const kys::Descriptor& descriptor, std::uint32_t turn) {
    slots_.clear();
    for (int t = 0; t < index_.tables_.tables(); ++t) {
      const std::span<const std::uint32_t> bucket = index_.tables_.bucket(descriptor, t);
      if (bucket.size() > index_.options_.max_bucket) continue;
      for (const std::uint32_t slot : bucket) {
        if (seen_[slot] == turn) continue;
        seen_[slot] = static_cast<std::uint16_t>(turn);
        slots_.push_back(slot);
      }
    }
  }

  void compare(const kys::Descriptor& descriptor, const kys::Prior& prior,
               const kys::DistanceModel& model, kys::Statistics& statistics) {
    matches_.clear();
    const float limit = index_.options_.max_distance;
    // A distance equal to the limit is a match, so the bound lies behind it.
    const float bound = std::nextafter(limit, kys::kRejected);
    for (const std::uint32_t slot : slots_) {
      const kys::Distance d =
          model.evaluate(descriptor, prior, index_.descriptors_[slot], index_.prior(slot),
                         kys::Context::kTemporal, bound, statistics);
      if (d.value <= limit && votes_.any_allowed(observers(slot))) matches_.push_back({d, slot});
    }
  }

  const PlaceIndex& index_;
  std::vector<std::uint16_t> seen_;  // by slot: the last feature that met it
  std::vector<std::uint32_t> slots_;
  std::vector<Match> matches_;
  PlaceVotes votes_;
};

namespace {

/// The features of the strongest response, at most `count`, by index.
std::vector<std::uint32_t> strongest(const FrameFeatures& features, std::size_t count) {
  std::vector<std::uint32_t> chosen(features.size());
  for (std::size_t i = 0; i < chosen.size(); ++i) chosen[i] = static_cast<std::uint32_t>(i);
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

std::vector<PlaceCandidate> PlaceIndex::query(const FrameFeatures& features,
                                              const kys::DistanceModel& model,
                                              kys::Statistics& statistics,
                                              std::span<const KeyFrameId> excluded,
                                              std::size_t max_candidates) const {
  Voting voting(*this, excluded);
  std::uint32_t turn = 0;
  for (const std::uint32_t i : strongest(features, options_.max_features)) {
    voting.vote(features.descriptor(i), features.prior(i), ++turn, model, statistics);
  }
  return voting.votes().candidates(keyframes_, max_candidates);
}

}  // namespace kys_slam
