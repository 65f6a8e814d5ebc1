// SPDX-License-Identifier: BSD-3-Clause
// An ORB SLAM of an older C++ standard: only kys/matcher.h, descriptors as bytes. Exits with 0 when
// the distances are those of README.md's formulas.
#include <kys/matcher.h>

#include <cmath>
#include <cstdio>
#include <cstring>
#include <stdexcept>

static_assert(__cplusplus / 100 % 100 == EXPECTED_STANDARD, "kys raised the standard");

static bool expect(bool good, const char* what) {
  if (!good) std::fprintf(stderr, "old_consumer: wrong: %s\n", what);
  return good;
}

int main() {
  using kys::matcher::Context;
  using kys::matcher::Matcher;
  using kys::matcher::Prior;
  const Matcher matcher("kys", "coco_panoptic_133",
                        "# Eq. 9\nkys.lambda_same_instance = 0.03  # not 0.02\n kys.gates=true");
  const Matcher mask("mask", "coco_panoptic_133");
  unsigned char bytes[66] = {};
  unsigned char* a = bytes + 1;  // no alignment is asked for
  unsigned char* b = bytes + 33;
  b[0] = 0xFF;
  b[31] = 0x03;                     // 10 bits
  const int kCar = 3, kPerson = 1;  // COCO's ids
  const Prior still = matcher.make_prior(kCar, 5, 100, 0, false);
  const Prior slow = matcher.make_prior(kCar, 5, 100, 6, true);
  const Prior fast = matcher.make_prior(kCar, 5, 100, 60, true);
  bool good = true;
  good &= expect(matcher.distance(a, Prior(), b, Prior(), Context::kTemporal) == 10, "no priors");
  good &= expect(matcher.distance(a, still, b, still, Context::kTemporal) == 10, "same instance");
  const float expected = 10 * (1 + 0.03f * std::log(7.0f));
  good &=
      expect(std::fabs(matcher.distance(a, still, b, slow, Context::kTemporal) - expected) < 1e-5,
             "Eq. 9");
  good &= expect(std::isinf(matcher.distance(a, still, b, fast, Context::kTemporal)), "gate");
  good &= expect(matcher.distance(a, matcher.make_prior(kPerson, 1, 0, 0, false), b, still,
                                  Context::kStereo) > 10,
                 "cross class");
  good &= expect(kys::matcher::landmark_prior(fast, still).motion == 0, "map point");
  good &= expect(!mask.keeps_keypoint(fast) && mask.keeps_keypoint(still), "mask");
  const char* const wrong[][3] = {{"kyss", "coco_panoptic_133", ""},
                                  {"kys", "coco_panoptic_133", "kys.alpha"},
                                  {"kys", "coco_panoptic_133", "kys.alhpa = 1"},
                                  {"kys", "nowhere", ""}};
  for (const auto& arguments : wrong) {
    try {
      Matcher(arguments[0], arguments[1], arguments[2]);
      good &= expect(false, arguments[0]);
    } catch (const std::runtime_error& error) {
      good &= expect(std::strchr(error.what(), '\n') == nullptr, "one line");
    }
  }
  return good ? 0 : 1;
}
