// SPDX-License-Identifier: BSD-3-Clause
#include "priors/input/field_input.h"

#include <kys_slam/error.h>
#include <kys_slam/image_file.h>
#include <kys_slam/util/paths.h>
#include <kys_slam/util/read_bytes.h>

#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <initializer_list>
#include <sstream>
#include <vector>

#include "priors/format/byte_io.h"
#include "priors/input/vkitti_names.h"

namespace kys_slam {
namespace {

namespace fs = std::filesystem;
constexpr std::size_t kMaxBytes = std::size_t{1} << 32;
constexpr float kTooLarge = 1e5F;  ///< px; no disparity or flow is; networks mark "unknown" so

[[noreturn]] void fail(const fs::path& path, const std::string& what) {
  throw InputError(path.string() + ": " + what);
}

void check_size(const fs::path& path, std::int64_t width, std::int64_t height) {
  if (width < 1 || height < 1 || width > kMaxImageSide || height > kMaxImageSide) {
    fail(path, "image size is not within 1.." + std::to_string(kMaxImageSide));
  }
}

/// Planes of floats: 1 for disparity, 2 for flow.
struct Planes {
  std::vector<ImageOf<float>> plane;
};

Planes read_pfm(const fs::path& path) {
  const std::vector<std::uint8_t> bytes = read_bytes(path, kMaxBytes);
  // Three lines of text, then rows from bottom to top.
  std::size_t at = 0;
  const auto line = [&] {
    std::string text;
    while (at < bytes.size() && bytes[at] != '\n' && text.size() < 100) {
      text += static_cast<char>(bytes[at++]);
    }
    ++at;
    return text;
  };
  const std::string kind = line();
  std::istringstream size(line());
  std::istringstream scale_text(line());
  std::int64_t width = 0, height = 0;
  double scale = 0;
  if (kind.substr(0, 2) != "Pf" || !(size >> width >> height) || !(scale_text >> scale) ||
      scale == 0) {
    fail(path, "is not a grey PFM file");
  }
  check_size(path, width, height);
  if (bytes.size() < at || bytes.size() - at < 4ull * static_cast<std::uint64_t>(width * height)) {
    fail(path, "is truncated");
  }
  Planes out{{ImageOf<float>(static_cast<int>(width), static_cast<int>(height))}};
  for (int y = 0; y < height; ++y) {
    float* row = out.plane[0].row(static_cast<int>(height) - 1 - y);
    for (int x = 0; x < width; ++x, at += 4) {
      std::uint8_t b[4];
      std::memcpy(b, bytes.data() + at, 4);
      if (scale > 0) {
        std::swap(b[0], b[3]);
        std::swap(b[1], b[2]);
      }
      row[x] = prior_format::load_f32(b);
    }
  }
  return out;
}

/// The header's dictionary is plain enough to be searched: keys are quoted and never repeat.
std::string npy_value(const std::string& header, const std::string& key) {
  const std::size_t at = header.find("'" + key + "'");
  if (at == std::string::npos) return "";
  const std::size_t colon = header.find(':', at);
  return colon == std::string::npos ? "" : header.substr(colon + 1);
}

Planes read_npy(const fs::path& path, std::size_t planes) {
  const std::vector<std::uint8_t> bytes = read_bytes(path, kMaxBytes);
  if (bytes.size() < 12 || std::memcmp(bytes.data(), "\x93NUMPY", 6) != 0) {
    fail(path, "is not an NPY file");
  }
  const bool first_version = bytes[6] == 1;
  const std::size_t start = first_version ? 10 : 12;
  const std::size_t length = first_version ? prior_format::load_u16(bytes.data() + 8)
                                           : prior_format::load_u32(bytes.data() + 8);
  if (length > bytes.size() - start) fail(path, "is truncated");
  const std::string header(reinterpret_cast<const char*>(bytes.data()) + start, length);
  const std::string descr = npy_value(header, "descr"), order = npy_value(header, "fortran_order"),
                    shape_text = npy_value(header, "shape");
  const bool single = descr.find("<f4") < 5, twice = descr.find("<f8") < 5;
  if ((!single && !twice) || order.find("False") > 3) {
    fail(path, "must hold little-endian float32 or float64 in C order");
  }
  std::vector<std::int64_t> shape;
  for (const char* p = shape_text.c_str(); *p != '\0' && *p != ')'; ++p) {
    if (*p < '0' || *p > '9') continue;
    char* end = nullptr;
    shape.push_back(std::strtoll(p, &end, 10));
    p = end - 1;
    if (shape.size() > 4) break;
  }
  while (shape.size() > 2 && shape[0] == 1) shape.erase(shape.begin());
  const auto n = static_cast<std::int64_t>(planes);
  const bool flat = planes == 1 && shape.size() == 2;
  const bool last = shape.size() == 3 && shape[2] == n, first = shape.size() == 3 && shape[0] == n;
  if (!flat && !last && !first) fail(path, "does not have the shape of an image");
  const std::int64_t height = first && !last ? shape[1] : shape[0];
  const std::int64_t width = first && !last ? shape[2] : shape[1];
  check_size(path, width, height);
  const std::size_t item = single ? 4 : 8, area = static_cast<std::size_t>(width * height);
  if (bytes.size() - start - length < item * area * planes) fail(path, "is truncated");
  const std::uint8_t* data = bytes.data() + start + length;
  Planes out;
  for (std::size_t k = 0; k < planes; ++k) {
    ImageOf<float> plane(static_cast<int>(width), static_cast<int>(height));
    for (std::size_t i = 0; i < area; ++i) {
      const std::size_t at = item * (flat ? i : last ? i * planes + k : k * area + i);
      plane.data()[i] =
          single ? prior_format::load_f32(data + at)
                 : static_cast<float>(std::bit_cast<double>(prior_format::load_u64(data + at)));
    }
    out.plane.push_back(std::move(plane));
  }
  return out;
}

Planes read_flo(const fs::path& path) {
  const std::vector<std::uint8_t> bytes = read_bytes(path, kMaxBytes);
  if (bytes.size() < 12 || prior_format::load_f32(bytes.data()) != 202021.25F) {
    fail(path, "is not a .flo file");
  }
  const auto width = static_cast<std::int32_t>(prior_format::load_u32(bytes.data() + 4));
  const auto height = static_cast<std::int32_t>(prior_format::load_u32(bytes.data() + 8));
  check_size(path, width, height);
  const std::size_t area = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  if (bytes.size() - 12 < 8 * area) fail(path, "is truncated");
  Planes out{{ImageOf<float>(width, height), ImageOf<float>(width, height)}};
  for (std::size_t i = 0; i < area; ++i) {
    out.plane[0].data()[i] = prior_format::load_f32(bytes.data() + 12 + 8 * i);
    out.plane[1].data()[i] = prior_format::load_f32(bytes.data() + 16 + 8 * i);
  }
  return out;
}

/// Read as KITTI's, Virtual KITTI's images would be nonsense, but of the right kind and size.
void check_specified(const fs::path& path, FieldEncoding encoding) {
  if (encoding != FieldEncoding::kUnspecified || !is_vkitti_field(path)) return;
  fail(path, "has a name of Virtual KITTI 2's; give the encoding, kitti or vkitti");
}

FlowField read_flow_png(const fs::path& path, FieldEncoding encoding) {
  check_specified(path, encoding);
  const Rgb16Image in = read_rgb16(path);
  FlowField flow{ImageOf<float>::for_overwrite(in.width(), in.height()),
                 ImageOf<float>::for_overwrite(in.width(), in.height())};
  const bool kitti = encoding != FieldEncoding::kVkitti;
  const double sx = kitti ? 1.0 / 64 : 2.0 * (in.width() - 1) / 65535;
  const double sy = kitti ? 1.0 / 64 : 2.0 * (in.height() - 1) / 65535;
  const double zero = kitti ? 32768 : 65535.0 / 2;
  for (std::size_t i = 0; i < in.size(); ++i) {
    const Rgb16Pixel& p = in.data()[i];
    flow.u.data()[i] = p[2] == 0 ? kNoValue : static_cast<float>((p[0] - zero) * sx);
    flow.v.data()[i] = p[2] == 0 ? kNoValue : static_cast<float>((p[1] - zero) * sy);
  }
  return flow;
}

ImageOf<float> read_disparity_png(const fs::path& path, FieldEncoding encoding, double bf) {
  check_specified(path, encoding);
  const Image16 in = read_u16(path);
  auto out = ImageOf<float>::for_overwrite(in.width(), in.height());
  const bool vkitti = encoding == FieldEncoding::kVkitti;  // depth in cm, 65535 is the sky
  for (std::size_t i = 0; i < in.size(); ++i) {
    const double value = in.data()[i];
    const bool known = value > 0 && !(vkitti && value == 65535);
    const double disparity = vkitti ? 100 * bf / value : value / 256;
    out.data()[i] = known ? static_cast<float>(disparity) : kNoValue;
  }
  return out;
}

/// The first of the `endings` that there is counts. `vkitti_file` is what Virtual KITTI 2 calls the
/// file.
fs::path find_field(const fs::path& folder, const std::string& name,
                    std::initializer_list<const char*> endings, const std::string& vkitti_file) {
  std::string wanted;
  for (const char* ending : endings) {
    fs::path path = folder / (name + ending);
    if (path_exists(path)) return path;
    wanted += (wanted.empty() ? "" : ", ") + std::string(ending);
  }
  const bool vkitti = is_vkitti_frame(name);
  if (vkitti && path_exists(folder / vkitti_file)) return folder / vkitti_file;
  fail(folder / name, "no file of this frame (" + wanted + ")" +
                          (vkitti ? ", nor " + vkitti_file : std::string()));
}

}  // namespace

// UniMatch leaves several fields of a frame in one folder: its endings say which, and come first.

fs::path find_disparity(const fs::path& folder, const std::string& name) {
  return find_field(folder, name, {"_disp.pfm", ".png", ".pfm", ".npy"},
                    vkitti_name("depth_", name));
}

fs::path find_right_disparity(const fs::path& folder, const std::string& name) {
  return find_field(folder, name, {"_disp_right.pfm", ".png", ".pfm", ".npy"},
                    vkitti_name("depth_", name));
}

fs::path find_flow(const fs::path& folder, const std::string& name) {
  return find_field(folder, name, {"_pred.flo", ".png", ".npy", ".flo"},
                    vkitti_name("flow_", name));
}

fs::path find_back_flow(const fs::path& folder, const std::string& name, const std::string& next) {
  return find_field(folder, name, {"_pred_bwd.flo", ".png", ".npy", ".flo"},
                    vkitti_name("backwardFlow_", next));
}

ImageOf<float> read_disparity(const fs::path& path, FieldEncoding encoding, double bf) {
  const std::string ending = path.extension().string();
  if (ending == ".png") return read_disparity_png(path, encoding, bf);
  if (ending != ".pfm" && ending != ".npy") fail(path, "is no disparity (.png, .pfm, .npy)");
  ImageOf<float> out = std::move((ending == ".pfm" ? read_pfm(path) : read_npy(path, 1)).plane[0]);
  for (std::size_t i = 0; i < out.size(); ++i) {
    float& d = out.data()[i];
    if (!(d > 0 && d < kTooLarge)) d = kNoValue;
  }
  return out;
}

FlowField read_flow(const fs::path& path, FieldEncoding encoding) {
  const std::string ending = path.extension().string();
  if (ending == ".png") return read_flow_png(path, encoding);
  if (ending != ".flo" && ending != ".npy") fail(path, "is no flow (.png, .flo, .npy)");
  Planes in = ending == ".flo" ? read_flo(path) : read_npy(path, 2);
  FlowField flow{std::move(in.plane[0]), std::move(in.plane[1])};
  for (std::size_t i = 0; i < flow.u.size(); ++i) {
    float& u = flow.u.data()[i];
    float& v = flow.v.data()[i];
    if (!(std::abs(u) < kTooLarge && std::abs(v) < kTooLarge)) u = v = kNoValue;
  }
  return flow;
}

}  // namespace kys_slam
