// SPDX-License-Identifier: BSD-3-Clause
#include <kys/error.h>
#include <kys/portable_math.h>
#include <kys/prior.h>

#include <algorithm>
#include <cmath>
#include <string>

namespace kys {

Prior make_prior(std::uint16_t label, std::int32_t instance, float scale, float motion,
                 bool dynamic) {
  if (!std::isfinite(scale) || scale < 0.0f) {
    throw Error("prior: scale must be finite and not negative, is " + std::to_string(scale));
  }
  if (!std::isfinite(motion)) {
    throw Error("prior: motion must be finite, is " + std::to_string(motion));
  }
  Prior prior;
  prior.label = label;
  prior.dynamic = dynamic ? 1 : 0;
  prior.instance = instance;
  prior.scale = scale;
  prior.motion = std::clamp(motion, 0.0f, 100.0f);
  // In double, so that the rounded result grows with mu on every C library.
  prior.log_motion = static_cast<float>(portable::log1p(static_cast<double>(prior.motion)));
  return prior;
}

Prior landmark_prior(const Prior& representative, const Prior& most_recent) {
  Prior prior = representative;
  const bool known = most_recent.label != kVoidLabel;
  prior.motion = known ? most_recent.motion : 0.0f;
  prior.log_motion = known ? most_recent.log_motion : 0.0f;
  prior.dynamic = known ? most_recent.dynamic : std::uint8_t{0};
  prior.unjudged = known ? most_recent.unjudged : std::uint8_t{0};
  return prior;
}

}  // namespace kys
