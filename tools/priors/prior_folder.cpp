#include "prior_folder.h"

#include <kys_slam/error.h>

#include <algorithm>

namespace kys_slam {

namespace fs = std::filesystem;

std::vector<fs::path> prior_files(const fs::path& input) {
  if (!fs::is_directory(input)) return {input};
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(input)) {
    if (entry.path().extension() == ".kysp") files.push_back(entry.path());
  }
  if (files.empty()) throw InputError(input.string() + ": has no prior files (*.kysp)");
  std::sort(files.begin(), files.end());
  return files;
}

}  // namespace kys_slam
