// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/kys.h>

#include <random>
#include <vector>

namespace kys::test {

/// A descriptor with the first `bits` bits set: its Hamming distance to Descriptor{} is `bits`.
inline Descriptor with_bits(int bits) {
  Descriptor d;
  for (int i = 0; i < bits; ++i) {
    d.words[i / 64] |= std::uint64_t{1} << (i % 64);
  }
  return d;
}

/// Three classes, numbers 0 (ids 10, 20, 30): S(0,1) = 100, S(0,2) = 155, S(1,2) = 200.
inline LabelSpace three_classes() {
  const std::vector<LabelClass> classes = {{10, "road", "road", false, false},
                                           {20, "car", "car", true, false},
                                           {30, "sky", "sky", false, true}};
  return LabelSpace("three", classes, {0, 100, 155, 100, 0, 200, 155, 200, 0});
}

inline ModeOptions options_of(Mode mode) {
  ModeOptions options;
  options.mode = mode;
  return options;
}

/// The paper's literal form: without our normalisation.
inline ModeOptions literal(Mode mode) {
  ModeOptions options = options_of(mode);
  options.normalize = false;
  return options;
}

/// Value of a pair with Hamming distance d.
inline float value(const DistanceModel& model, int d, const Prior& a, const Prior& b,
                   Context context = Context::kTemporal) {
  return model.evaluate(Descriptor{}, a, with_bits(d), b, context).value;
}

/// Random descriptors and priors, every kind of pair among them.
class RandomPairs {
 public:
  explicit RandomPairs(std::uint32_t seed) : random_(seed) {}

  Descriptor descriptor() {
    Descriptor d;
    for (auto& word : d.words) {
      word = random_();
      if (random_() % 2 == 0) word &= random_();  // spreads the distances
    }
    return d;
  }

  Prior prior() {
    const std::uint64_t kind = random_() % 16;
    if (kind == 0) return Prior{};
    const auto label = static_cast<std::uint16_t>(random_() % 3);
    const auto instance = static_cast<std::int32_t>(random_() % 3);
    const float scale = random_() % 4 == 0 ? 0.0f : uniform(0.0f, 1e6f);
    const float motion = random_() % 2 == 0 ? 0.0f : uniform(0.0f, 30.0f);
    return make_prior(label, instance, scale, motion, random_() % 5 == 0);
  }

  Context context() { return static_cast<Context>(random_() % kContextCount); }

  float uniform(float low, float high) {
    return low + (high - low) * static_cast<float>(random_() % 1000000) / 1e6f;
  }

 private:
  std::mt19937_64 random_;
};

}  // namespace kys::test
