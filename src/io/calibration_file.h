// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/stereo_rectifier.h>
#include <yaml-cpp/yaml.h>

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

namespace kys_slam {

/// A calibration in YAML whose numbers are read by key, of every format. All functions throw
/// InputError naming the file and the key.
class CalibrationFile {
 public:
  explicit CalibrationFile(const std::filesystem::path& path);

  [[nodiscard]] std::string name() const { return path_.string(); }
  [[nodiscard]] const YAML::Node& root() const { return root_; }
  [[nodiscard]] bool has(const char* key) const { return static_cast<bool>(root_[key]); }
  [[noreturn]] void fail(const std::string& what) const;

  /// Numbers of a list, of a list of lists, or of a matrix with `data`.
  [[nodiscard]] std::vector<double> numbers(const YAML::Node& node, const std::string& key) const;
  [[nodiscard]] std::vector<double> numbers(const YAML::Node& parent, const std::string& key,
                                            std::size_t count) const;
  [[nodiscard]] double number(const YAML::Node& parent, const std::string& key) const;
  /// Sets width and height, px.
  void set_size(const std::vector<double>& size, const std::string& key, RawCamera& camera) const;
  [[nodiscard]] int side(double value, const std::string& key) const;
  /// \param unit metres per unit of length
  [[nodiscard]] Rigid3 rigid(const std::vector<double>& values, const std::string& key,
                             double unit) const;
  /// Sets fx, fy, cx, cy, the image size, lens and distortion of a camera in the keys that Kalibr's
  /// camchain and the ASL format's sensor.yaml share.
  void read_pinhole(const YAML::Node& node, const std::string& prefix, RawCamera& camera) const;

 private:
  void append(const YAML::Node& node, const std::string& key, std::vector<double>& values) const;

  std::filesystem::path path_;
  YAML::Node root_;
};

/// The lens of a distortion model, by any of the names that calibration tools give it. Names are
/// compared without regard to case; '-' is '_'. "": the model that has as many coefficients.
/// \param key  that names the model in this kind of file
/// \throws InputError "NAME: ...": the model is not known, or four coefficients have none, which
/// may be those of either lens
LensModel lens_of(const std::string& model, const std::vector<double>& distortion,
                  const std::string& key, const std::string& name);

/// Tools write coefficients that they do not estimate as zeros, up to 14 of them.
void drop_padding(std::vector<double>& distortion, LensModel lens);

/// A scalar as text; "" for anything else.
std::string word(const YAML::Node& node);

}  // namespace kys_slam
