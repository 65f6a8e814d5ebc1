// SPDX-License-Identifier: BSD-3-Clause
#include "priors/builder/sequence_fields.h"

#include <kys_slam/error.h>

#include <string>
#include <system_error>

#include "priors/builder/estimators.h"
#include "priors/builder/seeded_flow.h"
#include "priors/input/field_input.h"

namespace kys_slam {
namespace {

/// One folder for two fields is fine only where the names of the files tell them apart.
void check_differ(const std::filesystem::path& first, const std::filesystem::path& second,
                  const char* what) {
  std::error_code error;
  if (!std::filesystem::equivalent(first, second, error)) return;
  throw InputError(second.string() + ": is given " + what);
}

}  // namespace

void SequenceFields::check_size(const std::filesystem::path& path,
                                const ImageOf<float>& field) const {
  if (field.width() == sequence_.camera.width && field.height() == sequence_.camera.height) {
    return;
  }
  throw InputError(path.string() + ": is " + std::to_string(field.width()) + "x" +
                   std::to_string(field.height()) + ", the sequence has " +
                   std::to_string(sequence_.camera.width) + "x" +
                   std::to_string(sequence_.camera.height));
}

DisparityPair SequenceFields::disparities(std::size_t t, const ImagePair& now) const {
  DisparityPair d;
  if (inputs_.disparity.empty()) return d;
  if (inputs_.disparity == "sgbm") {
    return {estimate_disparity(now.first, now.second, false),
            estimate_disparity(now.first, now.second, true)};
  }
  const auto read = [&](const std::filesystem::path& path) {
    ImageOf<float> field = read_disparity(path, inputs_.disparity_encoding, sequence_.camera.bf());
    check_size(path, field);
    return field;
  };
  const std::filesystem::path left = find_disparity(inputs_.disparity, sequence_.names[t]);
  d[0] = read(left);
  if (!inputs_.disparity_right.empty()) {
    const std::filesystem::path right =
        find_right_disparity(inputs_.disparity_right, sequence_.names[t]);
    check_differ(left, right, "as left and as right disparity");
    d[1] = read(right);
  }
  return d;
}

ImageOf<float> SequenceFields::warp(const ImageOf<float>& left, const FramePerception& in) const {
  if (!options_.depth.match_labels) return warp_disparity_to_right(left);
  const ClassImage left_classes = class_image(in[0].panoptic);
  const ClassImage right_classes = class_image(in[1].panoptic);
  return warp_disparity_to_right(left, &left_classes, &right_classes);
}

void SequenceFields::complete(DisparityPair& d, const FramePerception& in) const {
  if (d[0].empty()) return;
  const double tolerance = options_.depth.left_right_tolerance;
  if (!d[1].empty()) {
    const ImageOf<float> left = d[0];
    check_left_right(d[0], d[1], -1, tolerance);
    check_left_right(d[1], left, +1, tolerance);
  } else if (in.size() == 2) {
    d[1] = warp(d[0], in);
  }
}

std::optional<FlowField> SequenceFields::flow(std::size_t c, std::size_t t,
                                              const CameraPerception& in, const GrayImage& now,
                                              const GrayImage& next) const {
  if (inputs_.flow[c].empty() || t + 1 == sequence_.names.size()) return std::nullopt;
  const BuilderOptions::FlowCheck& check = options_.flow_check;
  if (inputs_.flow[c] == "dis") {
    return estimate_checked_flow(options_, sequence_.camera, now, next, in.disparity,
                                 in.panoptic.map, stuff_mask(in.panoptic));
  }
  const auto read = [&](const std::filesystem::path& path) {
    FlowField field = read_flow(path, inputs_.flow_encoding);
    check_size(path, field.u);
    return field;
  };
  const std::filesystem::path path = find_flow(inputs_.flow[c], sequence_.names[t]);
  FlowField forward = read(path);
  if (check.enabled && !inputs_.flow_back[c].empty()) {
    const std::filesystem::path back =
        find_back_flow(inputs_.flow_back[c], sequence_.names[t], sequence_.names[t + 1]);
    check_differ(path, back, "as forward and as backward flow");
    check_forward_backward(forward, read(back), check.tolerance, check.relative_tolerance);
  }
  return forward;
}

}  // namespace kys_slam
