// SPDX-License-Identifier: BSD-3-Clause
#include <kys/belief.h>
#include <kys/error.h>
#include <kys/portable_math.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <string>

namespace kys {

namespace {

/// Words of class names (COCO, ADE20K, Virtual KITTI 2, Cityscapes) that stand for what moves by
/// itself.
constexpr std::array<std::string_view, 45> kMobileWords = {
    "person",  "people",     "rider",     "pedestrian", "child",     "man",     "woman",
    "bicycle", "bike",       "minibike",  "motorcycle", "motorbike", "car",     "van",
    "bus",     "truck",      "lorry",     "train",      "tram",      "trailer", "caravan",
    "vehicle", "airplane",   "boat",      "ship",       "cat",       "dog",     "horse",
    "sheep",   "cow",        "elephant",  "bear",       "zebra",     "giraffe", "bird",
    "animal",  "wheelchair", "scooter",   "tractor",    "cart",      "plane",   "cyclist",
    "tuk-tuk", "excavator",  "helicopter"};

std::string lower(std::string_view text) {
  std::string out(text);
  std::transform(out.begin(), out.end(), out.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return out;
}

}  // namespace

Mobility mobility(const LabelClass& label_class) {
  if (!label_class.thing) return Mobility::kFixed;
  const std::string name = lower(label_class.name);
  // Synonyms are listed behind commas; the first says what it is.
  const std::string first = name.substr(0, name.find(','));
  const bool mobile =
      std::find(kMobileWords.begin(), kMobileWords.end(), first) != kMobileWords.end();
  return mobile ? Mobility::kMobile : Mobility::kCarried;
}

void describe(OptionList& list, BeliefOptions& o) {
  list.add("belief.carried", o.carried, {-20, 20}, "nats",
           "initial log-odds of being static, objects that people move (chairs, bags)");
  list.add("belief.mobile", o.mobile, {-20, 20}, "nats", "the same, people, animals, vehicles");
  list.add("belief.flagged", o.flagged, {-20, 20}, "nats",
           "added when the prior file flags the instance as moving");
  list.add("belief.unflagged", o.unflagged, {-20, 20}, "nats",
           "added when the prior file does not flag it");
}

void BeliefOptions::check() const {
  const std::string complaint = complaint_about(*this);
  if (!complaint.empty()) throw Error(complaint);
}

InitialBelief::InitialBelief(const BeliefOptions& options, const LabelSpace& space)
    : options_(options) {
  options.check();
  mobility_.reserve(space.size());
  for (const LabelClass& label_class : space.classes()) {
    mobility_.push_back(kys::mobility(label_class));
  }
}

double InitialBelief::log_odds(const Prior& prior) const {
  const double by_class =
      mobility(prior.label) == Mobility::kMobile ? options_.mobile : options_.carried;
  if (prior.dynamic != 0) return by_class + options_.flagged;
  return prior.unjudged != 0 ? by_class : by_class + options_.unflagged;
}

Prior with_belief(const Prior& prior, double p_static) {
  Prior out = prior;
  out.motion = static_cast<float>(100.0 * std::clamp(1.0 - p_static, 0.0, 1.0));
  out.log_motion = static_cast<float>(portable::log1p(static_cast<double>(out.motion)));
  out.dynamic = p_static < 0.5 ? 1 : 0;
  out.unjudged = 0;
  return out;
}

}  // namespace kys
