#include "open_sequence.h"

#include <kys_slam/error.h>

#include <algorithm>
#include <fstream>
#include <map>
#include <sstream>

#include "io/image_io.h"

namespace kys_slam {
namespace {

namespace fs = std::filesystem;

std::map<std::string, std::vector<double>> read_calibration(const fs::path& path) {
  std::ifstream stream(path);
  if (!stream) throw InputError(path.string() + ": cannot open");
  std::map<std::string, std::vector<double>> rows;
  for (std::string line; std::getline(stream, line);) {
    std::istringstream words(line);
    std::string key;
    if (!(words >> key)) continue;
    double value = 0;
    while (words >> value) rows[key].push_back(value);
  }
  return rows;
}

}  // namespace

BuildSequence open_build_sequence(const fs::path& folder) {
  // KITTI odometry layout: image_0/1, else image_2/3, and calib.txt.
  const bool grey = fs::is_directory(folder / "image_0");
  const fs::path left = folder / (grey ? "image_0" : "image_2");
  const fs::path right = folder / (grey ? "image_1" : "image_3");
  if (!fs::is_directory(left)) {
    throw InputError(folder.string() + ": is no KITTI sequence (no image_0 or image_2)");
  }
  BuildSequence sequence;
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(left)) files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  if (files.empty()) throw InputError(left.string() + ": has no images");
  std::vector<std::string> endings;
  for (const fs::path& file : files) {
    sequence.names.push_back(file.stem().string());
    endings.push_back(file.filename().string());
  }
  const fs::path calib = folder / "calib.txt";
  auto rows = read_calibration(calib);
  const auto& p0 = rows[grey ? "P0:" : "P2:"];
  const auto& p1 = rows[grey ? "P1:" : "P3:"];
  if (p0.size() != 12 || p1.size() != 12) {
    throw InputError(calib.string() + ": has no complete projection matrices");
  }
  const ImageInfo info = read_image_info(files[0]);
  StereoCamera& k = sequence.camera;
  k.width = info.width;
  k.height = info.height;
  k.fx = p0[0];
  k.fy = p0[5];
  k.cx = p0[2];
  k.cy = p0[6];
  k.baseline = (p0[3] - p1[3]) / p0[0];
  if (!k.is_valid()) throw InputError(calib.string() + ": makes no sense as a stereo calibration");
  sequence.read = [left, right, endings](std::size_t t) {
    return std::pair(read_gray(left / endings[t]), read_gray(right / endings[t]));
  };
  return sequence;
}

}  // namespace kys_slam
