// SPDX-License-Identifier: BSD-3-Clause
#include "io/pnm_codec.h"

#include <kys_slam/error.h>

#include <algorithm>
#include <optional>

#include "io/luma.h"

namespace kys_slam {
namespace {

using Bytes = std::span<const std::uint8_t>;

struct Pnm {
  ImageInfo info;
  unsigned largest = 0;  // value of white
  Bytes samples;

  [[nodiscard]] std::size_t count() const {
    return static_cast<std::size_t>(info.width) * static_cast<std::size_t>(info.height) *
           static_cast<std::size_t>(info.channels);
  }
  [[nodiscard]] std::uint16_t wide(std::size_t i) const {  // the format has the upper byte first
    return static_cast<std::uint16_t>(samples[2 * i] << 8 | samples[2 * i + 1]);
  }
  [[nodiscard]] std::uint8_t narrow(std::size_t i, int bits) const {
    if (info.bits == 16) return upper_byte(wide(i), bits);
    return static_cast<std::uint8_t>(std::min(255U, samples[i] * 255U / largest));
  }
};

bool is_space(std::uint8_t c) {
  return c == ' ' || (c >= '\t' && c <= '\r');
}

/// Takes the next number of a header from the front of `file`.
std::optional<unsigned> take_number(Bytes& file) {
  while (!file.empty() && (is_space(file.front()) || file.front() == '#')) {
    if (file.front() == '#') {  // a comment ends with its line
      const auto end = std::find(file.begin(), file.end(), '\n');
      file = file.subspan(static_cast<std::size_t>(end - file.begin()));
      if (file.empty()) break;
    }
    file = file.subspan(1);
  }
  std::optional<unsigned> number;
  while (!file.empty() && file.front() >= '0' && file.front() <= '9') {
    number = std::min(10 * number.value_or(0) + (file.front() - '0'), 1000000U);
    file = file.subspan(1);
  }
  return number;
}

Pnm parse(Bytes file, const std::string& name) {
  Pnm pnm;
  pnm.info.channels = file[1] == '6' ? 3 : 1;
  file = file.subspan(2);
  const auto width = take_number(file), height = take_number(file), largest = take_number(file);
  const auto side_fits = [](std::optional<unsigned> side) {
    return side && *side > 0 && *side <= kMaxImageSide;
  };
  if (!side_fits(width) || !side_fits(height) || !largest || *largest == 0 || *largest > 65535 ||
      file.empty() || !is_space(file.front())) {
    throw InputError(name + ": damaged PGM or PPM header");
  }
  pnm.info.width = static_cast<int>(*width);
  pnm.info.height = static_cast<int>(*height);
  pnm.info.bits = *largest > 255 ? 16 : 8;
  pnm.largest = *largest;
  pnm.samples = file.subspan(1);
  if (pnm.samples.size() < pnm.count() * static_cast<std::size_t>(pnm.info.bits / 8)) {
    throw InputError(name + ": the file is truncated");
  }
  return pnm;
}

}  // namespace

bool is_pnm(Bytes file) {
  return file.size() > 2 && file[0] == 'P' && (file[1] == '5' || file[1] == '6') &&
         (is_space(file[2]) || file[2] == '#');
}

ImageInfo pnm_info(Bytes file, const std::string& name) {
  return parse(file, name).info;
}

GrayImage decode_pnm_gray(Bytes file, const std::string& name, int bits) {
  const Pnm pnm = parse(file, name);
  GrayImage gray(pnm.info.width, pnm.info.height);
  for (std::size_t i = 0; i < gray.size(); ++i) {
    gray.data()[i] = pnm.info.channels == 1
                         ? pnm.narrow(i, bits)
                         : luma(pnm.narrow(3 * i, bits), pnm.narrow(3 * i + 1, bits),
                                pnm.narrow(3 * i + 2, bits));
  }
  return gray;
}

RgbImage decode_pnm_rgb(Bytes file, const std::string& name) {
  const Pnm pnm = parse(file, name);
  constexpr int kAllBits = 16;
  RgbImage rgb(pnm.info.width, pnm.info.height);
  const bool colour = pnm.info.channels == 3;
  for (std::size_t i = 0; i < rgb.size(); ++i) {
    for (std::size_t c = 0; c < 3; ++c) {
      rgb.data()[i][c] = pnm.narrow(colour ? 3 * i + c : i, kAllBits);
    }
  }
  return rgb;
}

std::uint16_t largest_pnm_sample(Bytes file, const std::string& name) {
  const Pnm pnm = parse(file, name);
  std::uint16_t largest = 0;
  for (std::size_t i = 0; i < pnm.count(); ++i) largest = std::max(largest, pnm.wide(i));
  return largest;
}

}  // namespace kys_slam
