#include <kys/distance_model.h>
#include <kys/error.h>

#include <algorithm>
#include <cmath>

namespace kys {

namespace {

constexpr std::size_t index_of(Tier tier) {
  return static_cast<std::size_t>(tier);
}

/// Eq. 4, in [0, 1]; 0 when neither keypoint has a scale.
inline float scale_discrepancy(float a, float b) {
  const float larger = std::max(a, b);
  return larger > 0.0f ? std::fabs(a - b) / larger : 0.0f;
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
    }
  }
  native_ = options.mode == Mode::kStock || options.mode == Mode::kMask;
  drops_dynamic_ = options.mode == Mode::kMask;
  uses_priors_ = options.mode != Mode::kStock;
  set_factors();
  // Pairs without a valid label have factor 1. Rounding keeps the order: a factor made of a base
  // and terms that are not negative is no smaller than the base in floating point either.
  floor_ = 1.0f;
  for (const TierFactors& tier : tiers_) {
    floor_ = std::min(floor_, tier.base);
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
      break;
    case Mode::kHardMismatch:
      filter_from_ = 0.0f;
      break;
    case Mode::kSoftFilter:
      filter_from_ = static_cast<float>(o.tau);
      break;
    case Mode::kSemantic:
      set_bases(o.alpha);
      offset_ = static_cast<float>(1.0 - o.alpha);
      break;
    case Mode::kPanoptic:
      set_structure();
      break;
    case Mode::kKys:
      if (o.gates) {
        gates_ = {static_cast<float>(o.gate_stereo), static_cast<float>(o.gate_temporal)};
      }
      if (o.continuous) {
        set_structure();
        tiers_[index_of(Tier::kCrossClass)].lambda = static_cast<float>(o.lambda[0]);
        tiers_[index_of(Tier::kCrossInstance)].lambda = static_cast<float>(o.lambda[1]);
        tiers_[index_of(Tier::kSameInstance)].lambda = static_cast<float>(o.lambda[2]);
      }
      break;
  }
}

void DistanceModel::set_bases(double base) {
  for (TierFactors& tier : tiers_) {
    tier.base = static_cast<float>(base);
  }
}

// Eq. 5. Normalised, a same-instance pair without motion keeps exactly d.
void DistanceModel::set_structure() {
  const ModeOptions& o = options_;
  const double unit = o.normalize ? o.gamma : 1.0;
  const auto gamma = static_cast<float>(o.gamma / unit);
  const auto scale = static_cast<float>(o.eta[2] / unit);
  tiers_[index_of(Tier::kSameInstance)] = {gamma, 0.0f, 0.0f, 0.0f};
  tiers_[index_of(Tier::kCrossInstance)] = {gamma, 0.0f, scale, 0.0f};
  tiers_[index_of(Tier::kCrossClass)] = {static_cast<float>(o.eta[0] / unit),
                                         static_cast<float>(o.eta[1] / (o.s_max * unit)), scale,
                                         0.0f};
}

Distance DistanceModel::modulate(int d, const Prior& pa, const Prior& pb, Context context) const {
  const auto native = static_cast<float>(d);
  if (kPriorsOff || native_ || pa.label >= label_limit_ || pb.label >= label_limit_) {
    return {native, Tier::kBypassed};
  }
  if (std::max(pa.motion, pb.motion) > gates_[static_cast<std::size_t>(context)]) {
    return {kRejected, Tier::kGated};
  }
  const bool cross_class = pa.label != pb.label;
  const Tier tier = cross_class                  ? Tier::kCrossClass
                    : pa.instance != pb.instance ? Tier::kCrossInstance
                                                 : Tier::kSameInstance;
  const float s = table_.empty() ? 0.0f : table_[pa.label * label_limit_ + pb.label];
  if (cross_class && s >= filter_from_) {
    return {kRejected, Tier::kFiltered};
  }
  const TierFactors& t = tiers_[index_of(tier)];
  const float structure = t.base + t.semantic * s + t.scale * scale_discrepancy(pa.scale, pb.scale);
  const float motion = 1.0f + t.lambda * std::max(pa.log_motion, pb.log_motion);
  return {structure * motion * native + offset_ * s, tier};
}

namespace {

/// The running best and second best of a search.
struct Race {
  BestTwo result;

  /// Whether the candidate now is one of the two.
  bool enter(std::uint32_t index, Distance distance) {
    if (!(distance.value < result.second.value)) {
      return false;
    }
    if (distance.value < result.best.value) {
      result.second = result.best;
      result.second_index = result.index;
      result.best = distance;
      result.index = index;
    } else {
      result.second = distance;
      result.second_index = index;
    }
    return true;
  }
};

/// Calls body with the fastest popcount this machine has, so that it is chosen once per search.
template <typename Body>
auto with_popcount(Body&& body) {
#if KYS_POPCNT_AT_RUN_TIME
  if (!kPriorsOff && detail::has_popcnt) [[likely]] {
    return body([](const Descriptor& a, const Descriptor& b) {
      return detail::popcount_instruction(a, b);
    });
  }
#endif
  return body(
      [](const Descriptor& a, const Descriptor& b) { return detail::popcount_portable(a, b); });
}

}  // namespace

int DistanceModel::bound_in_bits(float bound) const {
  int bits = 257;
  if (bound < 257.0f * floor_) {
    bits = static_cast<int>(bound / floor_);
    while (bits > 0 && floor_ * static_cast<float>(bits - 1) >= bound) --bits;
    while (floor_ * static_cast<float>(bits) < bound) ++bits;
  }
  return bits;
}

BestTwo DistanceModel::best_two(const Descriptor& query, const Prior& query_prior,
                                std::span<const Descriptor> descriptors,
                                std::span<const Prior> priors,
                                std::span<const std::uint32_t> candidates, Context context,
                                Statistics& statistics) const {
  Race race;
  if (kPriorsOff || native_ || priors.empty() || query_prior.label >= label_limit_) {
    with_popcount([&](auto popcount) {
      for (const std::uint32_t index : candidates) {
        const int d = popcount(query, descriptors[index]);
        race.enter(index, {static_cast<float>(d), Tier::kBypassed});
      }
    });
    statistics.pairs[index_of(Tier::kBypassed)] += candidates.size();
    return race.result;
  }
  std::array<std::uint32_t, kTierCount> pairs{};
  with_popcount([&](auto popcount) {
    int limit = 257;  // Hamming distance from which a pair can no longer be second
    for (const std::uint32_t index : candidates) {
      const int d = popcount(query, descriptors[index]);
      if (d >= limit) {
        ++pairs[index_of(Tier::kSkipped)];
        continue;
      }
      const Distance distance = modulate(d, query_prior, priors[index], context);
      ++pairs[index_of(distance.tier)];
      if (race.enter(index, distance)) {
        limit = bound_in_bits(race.result.second.value);
      }
    }
  });
  for (std::size_t i = 0; i < kTierCount; ++i) {
    statistics.pairs[i] += pairs[i];
  }
  return race.result;
}

}  // namespace kys
