#include "prior_folder.h"

#include <kys_slam/error.h>

#include "util/paths.h"

namespace kys_slam {

namespace fs = std::filesystem;

std::vector<fs::path> prior_files(const fs::path& input) {
  if (!is_folder(input)) return {input};
  std::vector<fs::path> files;
  for (const fs::path& path : list_folder(input)) {
    if (path.extension() == ".kysp") files.push_back(path);
  }
  if (files.empty()) throw InputError(input.string() + ": has no prior files (*.kysp)");
  return files;
}

}  // namespace kys_slam
