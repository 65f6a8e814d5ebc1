// SPDX-License-Identifier: BSD-3-Clause
#include <kys/distance_model.h>
#include <kys/error.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <string>

namespace kys {

namespace {

constexpr std::size_t index_of(Tier tier) {
  return static_cast<std::size_t>(tier);
}
constexpr std::size_t index_of(Context context) {
  return static_cast<std::size_t>(context);
}

constexpr std::array<Tier, 3> kStructuralTiers = {Tier::kSameInstance, Tier::kCrossInstance,
                                                  Tier::kCrossClass};

/// Eq. 4, in [0, 1]; 0 when neither keypoint has a scale.
inline float scale_discrepancy(float a, float b) {
  return std::fabs(a - b) / std::max({a, b, std::numeric_limits<float>::min()});
}

}  // namespace

DistanceModel::DistanceModel(const ModeOptions& options) : DistanceModel(options, nullptr) {}

DistanceModel::DistanceModel(const ModeOptions& options, const LabelSpace& space)
    : DistanceModel(options, &space) {}

DistanceModel::DistanceModel(const ModeOptions& options, const LabelSpace* space)
    : options_(options) {
  options.check();
  if (needs_label_space(options) && space == nullptr) {
    throw Error("mode " + std::string(mode_name(options.mode)) + " needs a label space");
  }
  if (space != nullptr) {
    label_limit_ = static_cast<std::uint32_t>(space->size());
    if (needs_label_space(options)) {
      table_ = space->table();
      table_mask_ = ~0u;
    }
  }
  if (space != nullptr && uses_belief()) {
    for (const LabelClass& c : space->classes()) things_.push_back(c.thing ? 1 : 0);
  }
  native_ = options.mode == Mode::kStock || options.mode == Mode::kMask;
  drops_dynamic_ = options.mode == Mode::kMask;
  uses_priors_ = options.mode != Mode::kStock;
  set_factors();
  // Rounding keeps the order: a factor made of a base
  // and terms that are not negative is no smaller than the base in floating point either.
  floor_ = unlabelled_;
  for (const Tier tier : kStructuralTiers) {
    floor_ = std::min(floor_, factors_[index_of(tier)].base);
  }
}

void DistanceModel::set_factors() {
  const ModeOptions& o = options_;
  switch (o.mode) {
    case Mode::kStock:
    case Mode::kMask:
      break;
    case Mode::kScaled:
      set_bases(o.s);
      unlabelled_ = kPriorsOff ? 1.0f : static_cast<float>(o.s);  // every pair, labelled or not
      break;
    case Mode::kHardMismatch:
      filter_from_ = 0.0f;
      break;
    case Mode::kSoftFilter:
      filter_from_ = static_cast<float>(o.tau);
      break;
    case Mode::kSemantic:
      set_bases(o.alpha);
      for (const Tier tier : kStructuralTiers) {
        factors_[index_of(tier)].offset = static_cast<float>(1.0 - o.alpha);
      }
      break;
    case Mode::kPanoptic:
      set_structure();
      break;
    case Mode::kKys:
      if (o.gates) {
        gates_[index_of(Context::kStereo)] = static_cast<float>(o.gate_stereo);
        gates_[index_of(Context::kTemporal)] = static_cast<float>(o.gate_temporal);
      }
      if (o.continuous) {
        set_structure();
        set_lambdas();
      }
      break;
    case Mode::kVerified:
      // What moves needs its depth to be judged: no gate in stereo. with_belief() gives mu in
      // percent.
      if (o.gates) {
        gates_[index_of(Context::kTemporal)] = static_cast<float>(100.0 * o.gate_belief);
      }
      if (o.continuous) {
        set_structure();
        set_lambdas();
      }
      break;
  }
}

void DistanceModel::set_bases(double base) {
  for (const Tier tier : kStructuralTiers) {
    factors_[index_of(tier)].base = static_cast<float>(base);
  }
}

void DistanceModel::set_lambdas() {
  factors_[index_of(Tier::kCrossClass)].lambda = static_cast<float>(options_.lambda[0]);
  factors_[index_of(Tier::kCrossInstance)].lambda = static_cast<float>(options_.lambda[1]);
  factors_[index_of(Tier::kSameInstance)].lambda = static_cast<float>(options_.lambda[2]);
}

// Eq. 5. Normalised, a same-instance pair without motion keeps exactly d.
void DistanceModel::set_structure() {
  const ModeOptions& o = options_;
  const double unit = o.normalize ? o.gamma : 1.0;
  const auto gamma = static_cast<float>(o.gamma / unit);
  const auto eta1 = static_cast<float>(o.eta[0] / unit);
  const auto eta2 = static_cast<float>(o.eta[1] / (o.s_max * unit));
  const auto eta3 = static_cast<float>(o.eta[2] / unit);
  factors_[index_of(Tier::kSameInstance)] = {.base = gamma};
  factors_[index_of(Tier::kCrossInstance)] = {.base = gamma, .scale = eta3};
  factors_[index_of(Tier::kCrossClass)] = {.base = eta1, .semantic = eta2, .scale = eta3};
}

// Leaves early: neighbours in an image mostly are on the same segment, or have no label at all, so
// these branches are predicted well, and the rest of the formula is the slower part.
inline Distance DistanceModel::weigh(float d, const Prior& pa, const Prior& pb, float gate) const {
  if (std::max(pa.label, pb.label) >= label_limit_) {
    return {unlabelled_ * d, Tier::kBypassed};
  }
  if (std::max(pa.motion, pb.motion) > gate) {
    return {kRejected, Tier::kGated};
  }
  const float log_motion = std::max(pa.log_motion, pb.log_motion);
  if (pa.label == pb.label && pa.instance == pb.instance) {
    const Factors& f = factors_[index_of(Tier::kSameInstance)];
    return {f.base * (1.0f + f.lambda * log_motion) * d, Tier::kSameInstance};
  }
  const Tier tier = pa.label == pb.label ? Tier::kCrossInstance : Tier::kCrossClass;
  const float s = table_[(pa.label * label_limit_ + pb.label) & table_mask_];
  if (s >= filter_from_ && tier == Tier::kCrossClass) {
    return {kRejected, Tier::kFiltered};
  }
  const Factors& f = factors_[index_of(tier)];
  const float structure = f.base + f.semantic * s + f.scale * scale_discrepancy(pa.scale, pb.scale);
  return {structure * (1.0f + f.lambda * log_motion) * d + f.offset * s, tier};
}

Distance DistanceModel::modulate(int d, const Prior& pa, const Prior& pb, Context context) const {
  if (kPriorsOff || native_) {
    return {static_cast<float>(d), Tier::kBypassed};
  }
  return weigh(static_cast<float>(d), pa, pb, gates_[static_cast<std::size_t>(context)]);
}

/// Smallest Hamming distance whose every value is above `value`; 257 when there is none.
int DistanceModel::first_skipped(float value) const {
  if (!(value < 256.0f * floor_)) {
    return 257;
  }
  int bits = static_cast<int>(value / floor_);
  while (bits > 0 && floor_ * static_cast<float>(bits - 1) > value) --bits;
  while (floor_ * static_cast<float>(bits) <= value) ++bits;
  return bits;
}

namespace {

/// Candidates whose Hamming distances are taken at a time.
constexpr std::size_t kChunk = 128;

/// In place of a Hamming distance: this candidate has been looked at.
constexpr std::int16_t kSeen = 1000;

/// The running best and second best of a search. Candidates may come in any order: of equals the
/// one with the smaller position is better.
class BestTwoSearch {
 public:
  /// Returns whether the candidate now is one of the two.
  bool enter(std::size_t position, Distance distance) {
    if (!better(distance, position, second_, second_position_)) {
      return false;
    }
    if (better(distance, position, best_, best_position_)) {
      second_ = best_;
      second_position_ = best_position_;
      best_ = distance;
      best_position_ = position;
    } else {
      second_ = distance;
      second_position_ = position;
    }
    return true;
  }

  [[nodiscard]] float second_value() const { return second_.value; }

  [[nodiscard]] BestTwo result(std::span<const std::uint32_t> candidates) const {
    BestTwo result;
    if (best_position_ != kNobody) {
      result.index = candidates[best_position_];
      result.best = best_;
    }
    if (second_position_ != kNobody) {
      result.second_index = candidates[second_position_];
      result.second = second_;
    }
    return result;
  }

 private:
  static constexpr std::size_t kNobody = std::numeric_limits<std::size_t>::max();

  static bool better(Distance a, std::size_t position_a, Distance b, std::size_t position_b) {
    return a.value < b.value ||
           (a.value == b.value && position_a < position_b && a.value < kRejected);
  }

  Distance best_;
  Distance second_;
  std::size_t best_position_ = kNobody;
  std::size_t second_position_ = kNobody;
};

/// Positions of the two smallest of a few Hamming distances.
struct Nearest {
  int best = 257;
  int second = 257;
  std::size_t best_position = 0;
  std::size_t second_position = 0;

  void enter(int d, std::size_t position) {
    if (d >= second) {
      return;
    }
    if (d < best) {
      second = best;
      second_position = best_position;
      best = d;
      best_position = position;
    } else {
      second = d;
      second_position = position;
    }
  }
};

void measure(const Descriptor& query, std::span<const Descriptor> descriptors,
             std::span<const std::uint32_t> candidates, std::span<std::int16_t> distances) {
  if constexpr (kPriorsOff) {
    for (std::size_t i = 0; i < candidates.size(); ++i) {
      const int d = detail::popcount_portable(query, descriptors[candidates[i]]);
      distances[i] = static_cast<std::int16_t>(d);
    }
  } else {
    hamming_many(query, descriptors, candidates, distances);
  }
}

/// best_two() of native distances times a factor.
BestTwo nearest_two(const Descriptor& query, std::span<const Descriptor> descriptors,
                    std::span<const std::uint32_t> candidates, float factor) {
  std::array<std::int16_t, kChunk> distances;
  Nearest nearest;
  for (std::size_t first = 0; first < candidates.size(); first += kChunk) {
    const auto chunk = candidates.subspan(first, std::min(kChunk, candidates.size() - first));
    measure(query, descriptors, chunk, distances);
    for (std::size_t i = 0; i < chunk.size(); ++i) {
      nearest.enter(distances[i], first + i);
    }
  }
  BestTwo result;
  if (nearest.best <= 256) {
    result.index = candidates[nearest.best_position];
    result.best.value = factor * static_cast<float>(nearest.best);
  }
  if (nearest.second <= 256) {
    result.second_index = candidates[nearest.second_position];
    result.second.value = factor * static_cast<float>(nearest.second);
  }
  return result;
}

}  // namespace

// The two nearest by Hamming distance are looked at first: their values are a bound that most of
// the others cannot beat whatever their priors.
BestTwo DistanceModel::best_two(const Descriptor& query, const Prior& query_prior,
                                std::span<const Descriptor> descriptors,
                                std::span<const Prior> priors,
                                std::span<const std::uint32_t> candidates, Context context,
                                Statistics& statistics) const {
  if (kPriorsOff || native_ || priors.empty() || query_prior.label >= label_limit_) {
    statistics.pairs[index_of(Tier::kBypassed)] += candidates.size();
    return nearest_two(query, descriptors, candidates, unlabelled_);
  }
  const float gate = gates_[static_cast<std::size_t>(context)];
  std::array<std::int16_t, kChunk> distances;
  BestTwoSearch search;
  for (std::size_t first = 0; first < candidates.size(); first += kChunk) {
    const auto chunk = candidates.subspan(first, std::min(kChunk, candidates.size() - first));
    measure(query, descriptors, chunk, distances);
    Nearest nearest;
    for (std::size_t i = 0; i < chunk.size(); ++i) {
      nearest.enter(distances[i], i);
    }
    const auto look_at = [&](std::size_t i) {
      const auto d = static_cast<float>(distances[i]);
      const Distance distance = weigh(d, query_prior, priors[chunk[i]], gate);
      ++statistics.pairs[index_of(distance.tier)];
      distances[i] = kSeen;
      return search.enter(first + i, distance);
    };
    look_at(nearest.best_position);
    if (chunk.size() > 1) {
      look_at(nearest.second_position);
    }
    int hopeless = first_skipped(search.second_value());
    std::size_t skipped = chunk.size();
    for (std::size_t i = 0; i < chunk.size(); ++i) {
      if (distances[i] < hopeless) {
        --skipped;
        if (look_at(i)) {
          hopeless = first_skipped(search.second_value());
        }
      }
    }
    statistics.pairs[index_of(Tier::kSkipped)] += skipped - std::min<std::size_t>(2, chunk.size());
  }
  return search.result(candidates);
}

}  // namespace kys
