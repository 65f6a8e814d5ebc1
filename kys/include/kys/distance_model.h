// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance.h>
#include <kys/hamming.h>
#include <kys/label_space.h>
#include <kys/mode_options.h>
#include <kys/statistics.h>

#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

namespace kys {

/// True in a build with the CMake option KYS_PLAIN_POPCOUNT: every distance is the plain popcount,
/// in every mode. It proves that mode `stock` changes nothing.
#ifdef KYS_PLAIN_POPCOUNT
inline constexpr bool kPriorsOff = true;
#else
inline constexpr bool kPriorsOff = false;
#endif

/// Result of a search through candidates. Equal distances: the candidate listed first wins.
struct BestTwo {
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

  std::uint32_t index = kNone;         ///< of the best candidate; kNone: all are rejected
  std::uint32_t second_index = kNone;  ///< of the second best
  Distance best;                       ///< value kRejected where there is none
  Distance second;

  friend bool operator==(const BestTwo&, const BestTwo&) = default;
};

/// The distance of two descriptors under a mode. Immutable; any number of threads may share one.
///
/// All modes are one formula with different numbers. With S the semantic and da the scale
/// discrepancy (Eq. 4) of the pair, and the other numbers by its tier,
///
///     value = (base + semantic S + scale da) (1 + lambda max(ln(1 + mu))) d + offset S
///
/// rejected when max(mu) is above the gate of the context, or when the labels differ and S is not
/// below the threshold of the filter. A pair in which a keypoint has no valid label has value d and
/// is never rejected, in every mode but `scaled`, which scales every pair. A label outside the
/// label space is not valid.
class DistanceModel {
 public:
  /// Mode stock.
  DistanceModel() : DistanceModel(ModeOptions{}) {}
  /// Throws Error when the options do not pass check() or need a label space.
  explicit DistanceModel(const ModeOptions& options);
  DistanceModel(const ModeOptions& options, const LabelSpace& space);

  /// The distance of a pair, in bits. When the lower bound of the pair is not below `bound` (bits),
  /// the result is that lower bound with tier kSkipped, and no prior is read.
  [[nodiscard]] Distance evaluate(const Descriptor& a, const Prior& pa, const Descriptor& b,
                                  const Prior& pb, Context context, float bound = kRejected) const {
    if constexpr (kPriorsOff) {
      return {static_cast<float>(detail::popcount_portable(a, b)), Tier::kBypassed};
    }
    const int d = hamming(a, b);
    const float native = static_cast<float>(d);
    if (native_) {
      return {native, Tier::kBypassed};
    }
    const float lower = floor_ * native;
    if (lower >= bound) {
      return {lower, Tier::kSkipped};
    }
    return modulate(d, pa, pb, context);
  }

  /// The same, and counts the pair.
  [[nodiscard]] Distance evaluate(const Descriptor& a, const Prior& pa, const Descriptor& b,
                                  const Prior& pb, Context context, float bound,
                                  Statistics& statistics) const {
    const Distance distance = evaluate(a, pa, b, pb, context, bound);
    statistics.count(distance.tier);
    return distance;
  }

  /// The distance of a pair with Hamming distance d (0..256), in bits.
  [[nodiscard]] Distance modulate(int d, const Prior& pa, const Prior& pb, Context context) const;

  /// Best and second best of `candidates` (indices into `descriptors` and `priors`), the same as
  /// evaluate() on each without a bound. Pairs that cannot be among the two are counted as skipped.
  /// `priors` has the length of `descriptors` or is empty (no keypoint has a valid label). Indices
  /// are not checked: an index outside `descriptors` is undefined behaviour.
  [[nodiscard]] BestTwo best_two(const Descriptor& query, const Prior& query_prior,
                                 std::span<const Descriptor> descriptors,
                                 std::span<const Prior> priors,
                                 std::span<const std::uint32_t> candidates, Context context,
                                 Statistics& statistics) const;

  /// Mode `verified`, which keeps keypoints on moving instances: whether the keypoint is on a
  /// segment of a thing class. Statistics of the static scene exclude it. False in all other modes.
  [[nodiscard]] bool is_on_thing(const Prior& prior) const {
    return prior.label < things_.size() && things_[prior.label] != 0;
  }

  /// Whether the motion of this keypoint passes the gate of the context.
  [[nodiscard]] bool admits(const Prior& prior, Context context) const {
    return kPriorsOff || prior.label >= label_limit_ ||
           !(prior.motion > gates_[static_cast<std::size_t>(context)]);
  }

  /// False: drop this keypoint at extraction (mode `mask`, segment flagged as moving).
  [[nodiscard]] bool keeps_keypoint(const Prior& prior) const {
    return kPriorsOff || !drops_dynamic_ || prior.dynamic == 0 || prior.label >= label_limit_;
  }

  /// Whether the mode uses belief in place of motion (belief.h) outside the stereo context.
  [[nodiscard]] bool uses_belief() const { return !kPriorsOff && options_.mode == Mode::kVerified; }

  /// Whether the mode reads priors. If not, the caller need not provide any.
  [[nodiscard]] bool uses_priors() const { return !kPriorsOff && uses_priors_; }

  [[nodiscard]] const ModeOptions& options() const { return options_; }

  /// Every value is at least this factor times d.
  [[nodiscard]] float lower_bound_factor() const { return native_ ? 1.0f : floor_; }

 private:
  /// The numbers of the formula above.
  struct Factors {
    float base = 1;
    float semantic = 0;  ///< per bit of S
    float scale = 0;     ///< per unit of scale discrepancy
    float lambda = 0;    ///< per ln(1 + mu)
    float offset = 0;    ///< per bit of S
  };

  DistanceModel(const ModeOptions& options, const LabelSpace* space);
  void set_factors();
  void set_bases(double base);
  void set_structure();
  void set_lambdas();
  [[nodiscard]] Distance weigh(float d, const Prior& pa, const Prior& pb, float gate) const;
  [[nodiscard]] int first_skipped(float value) const;

  ModeOptions options_;
  std::array<Factors, 3> factors_;                                           ///< by Tier
  std::array<float, kContextCount> gates_{kRejected, kRejected, kRejected};  ///< mu, by Context
  float filter_from_ = kRejected;  ///< S from which differing labels reject
  float unlabelled_ = 1;           ///< factor of pairs with an end that has no valid label
  float floor_ = 1;
  std::uint32_t label_limit_ = kVoidLabel;  ///< labels from here on are not valid
  std::uint32_t table_mask_ = 0;            ///< 0: S does not matter, the table is one zero
  bool native_ = true;                      ///< every value is d
  bool drops_dynamic_ = false;
  bool uses_priors_ = false;
  std::vector<std::uint8_t> things_;                        ///< by label, mode verified only
  std::vector<float> table_ = std::vector<float>(1, 0.0f);  ///< S, label_limit_ squared
};

}  // namespace kys
