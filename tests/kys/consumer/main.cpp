// SPDX-License-Identifier: BSD-3-Clause
// Another ORB SLAM's matcher, reduced to what touches kys: exits with 0 when all is as expected.

#include <kys/kys.h>

#include <cstdio>
#include <vector>

namespace {

bool expect(bool good, const char* what) {
  if (!good) std::fprintf(stderr, "consumer: wrong: %s\n", what);
  return good;
}

}  // namespace

int main() {
  const kys::LabelSpace space = kys::load_label_space("coco_panoptic_133");
  const kys::LabelSpace own = kys::load_label_space(KYS_LABEL_SPACES "/vkitti2");
  kys::ModeOptions options;
  options.mode = kys::parse_mode("kys");
  const kys::DistanceModel model(options, space);

  kys::Descriptor query;
  std::vector<kys::Descriptor> descriptors(3);
  descriptors[0].words[0] = 0xFF;   // 8 bits away, on a moving car
  descriptors[1].words[0] = 0xFFF;  // 12 bits away, on the road
  descriptors[2].words[0] = 0x3FF;  // 10 bits away, on the sky
  const auto prior = [&](const char* name, int instance, float motion) {
    return kys::make_prior(space.index_of(name), instance, 0, motion, motion > 0);
  };
  const std::vector<kys::Prior> priors = {prior("car", 5, 60), prior("road", 1, 0),
                                          prior("sky-other-merged", 2, 0)};
  const std::vector<std::uint32_t> candidates = {0, 1, 2};
  kys::Statistics statistics;
  const kys::BestTwo best = model.best_two(query, prior("road", 1, 0), descriptors, priors,
                                           candidates, kys::Context::kTemporal, statistics);
  bool good = expect(best.index == 2, "best candidate");
  good &= expect(best.second_index == 1 && best.second.value == 12.0f, "second best candidate");
  good &= expect(statistics.gated() == 1, "gated pairs");
  good &= expect(own.size() == 14, "label space from the installed files");
  return good ? 0 : 1;
}
