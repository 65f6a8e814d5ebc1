// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <kys/label_space.h>
#include <kys_slam/run_main.h>

#include <array>
#include <bit>
#include <cstdint>
#include <set>

#include "system/run_tables.h"

namespace kys_slam {

namespace {

/// The bytes of a number, little endian.
template <typename T>
void append_bytes(std::string& out, T value) {
  static_assert(std::endian::native == std::endian::little);
  out.append(reinterpret_cast<const char*>(&value), sizeof value);
}

/// A colour that a class keeps in every run; grey without one. Neighbours in the label space
/// differ.
std::array<std::uint8_t, 3> class_colour(std::uint16_t label) {
  if (label == kys::kVoidLabel) return {150, 150, 150};
  std::uint32_t h = label + 1U;
  h = (h ^ (h >> 16U)) * 0x45d9f3bU;
  h = (h ^ (h >> 16U)) * 0x45d9f3bU;
  h ^= h >> 16U;
  const auto channel = [&](unsigned shift) {
    return static_cast<std::uint8_t>(64U + ((h >> shift) & 0x7fU) + ((h >> (shift + 7U)) & 0x3fU));
  };
  return {channel(0), channel(8), channel(16)};
}

}  // namespace

std::string map_ply(const MapSnapshot& map, const std::string& label_space) {
  std::vector<const MapSnapshot::Landmark*> landmarks;
  std::set<std::uint16_t> labels;
  for (const MapSnapshot::Landmark& l : map.landmarks) {
    if (l.submap != map.main_submap) continue;
    landmarks.push_back(&l);
    if (l.label != kys::kVoidLabel) labels.insert(l.label);
  }
  std::string text =
      "ply\nformat binary_little_endian 1.0\n"
      "comment landmarks, m, frame of the trajectory; class and instance -1: none\n";
  if (!labels.empty()) {
    const kys::LabelSpace space = kys::load_label_space(label_space);
    text += fmt::format("comment label_space {}\n", printable(space.name()));
    for (const std::uint16_t label : labels) {
      text += fmt::format("comment class {} {}\n", label, printable(space.at(label).name));
    }
  }
  text += fmt::format("element vertex {}\n", landmarks.size());
  text +=
      "property float x\nproperty float y\nproperty float z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\n"
      "property int class\nproperty int instance\n"
      "property float belief\nproperty int observations\nend_header\n";
  for (const MapSnapshot::Landmark* l : landmarks) {
    for (int i = 0; i < 3; ++i) append_bytes(text, static_cast<float>(l->p_w[i]));
    for (const std::uint8_t c : class_colour(l->label)) append_bytes(text, c);
    append_bytes<std::int32_t>(text, l->label == kys::kVoidLabel ? -1 : l->label);
    append_bytes(text, l->instance);
    append_bytes(text, l->belief);
    append_bytes(text, static_cast<std::int32_t>(l->observations));
  }
  return text;
}

}  // namespace kys_slam
