// SPDX-License-Identifier: BSD-3-Clause
#include <kys/distance_model.h>
#include <kys/error.h>
#include <kys/matcher.h>
#include <kys/prior.h>

#include <bit>
#include <cstddef>
#include <cstring>
#include <string_view>

namespace kys::matcher {
namespace {

static_assert(sizeof(Prior) == sizeof(kys::Prior) &&
              offsetof(Prior, log_motion) == offsetof(kys::Prior, log_motion));
static_assert(Prior{}.label == kVoidLabel);
static_assert(static_cast<int>(Context::kInstance) == static_cast<int>(kys::Context::kInstance));

kys::Prior inner(const Prior& prior) {
  return std::bit_cast<kys::Prior>(prior);
}
Prior outer(const kys::Prior& prior) {
  return std::bit_cast<Prior>(prior);
}

std::string_view trimmed(std::string_view text) {
  constexpr std::string_view kBlank = " \t\r";
  const std::size_t begin = text.find_first_not_of(kBlank);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(kBlank) - begin + 1);
}

ModeOptions options_of(const std::string& mode, std::string_view text) {
  ModeOptions options;
  options.mode = parse_mode(mode);
  while (!text.empty()) {
    const std::size_t end = text.find('\n');
    std::string_view line = text.substr(0, end);
    line = trimmed(line.substr(0, line.find('#')));
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
    if (line.empty()) continue;
    const std::size_t equals = line.find('=');
    if (equals == std::string_view::npos) {
      throw Error("option \"" + std::string(line) + "\" is not KEY = VALUE");
    }
    set_option(options, trimmed(line.substr(0, equals)), trimmed(line.substr(equals + 1)));
  }
  return options;
}

Descriptor descriptor(const unsigned char* bytes) {
  Descriptor result;
  std::memcpy(result.words.data(), bytes, sizeof result.words);
  return result;
}

}  // namespace

struct Matcher::Parts {
  Parts(const ModeOptions& options, const std::string& label_space)
      : space(load_label_space(label_space)), model(options, space) {}
  LabelSpace space;
  DistanceModel model;
};

Matcher::Matcher(const std::string& mode, const std::string& label_space)
    : Matcher(mode, label_space, {}) {}

Matcher::Matcher(const std::string& mode, const std::string& label_space,
                 const std::string& options)
    : parts_(std::make_shared<const Parts>(options_of(mode, options), label_space)) {}

Prior Matcher::make_prior(std::int32_t class_id, std::int32_t instance, float scale, float motion,
                          bool moving) const {
  return outer(kys::make_prior(parts_->space.index_of(class_id), instance, scale, motion, moving));
}

bool Matcher::keeps_keypoint(const Prior& prior) const {
  return parts_->model.keeps_keypoint(inner(prior));
}

float Matcher::distance(const unsigned char* a, const Prior& prior_a, const unsigned char* b,
                        const Prior& prior_b, Context context, float bound) const {
  return parts_->model
      .evaluate(descriptor(a), inner(prior_a), descriptor(b), inner(prior_b),
                static_cast<kys::Context>(context), bound)
      .value;
}

Prior landmark_prior(const Prior& representative, const Prior& most_recent) {
  return outer(kys::landmark_prior(inner(representative), inner(most_recent)));
}

}  // namespace kys::matcher
