#include "priors/format/prior_source.h"

#include <fcntl.h>
#include <kys_slam/error.h>
#include <unistd.h>

#include <algorithm>
#include <vector>

#include "util/paths.h"

namespace kys_slam {

namespace fs = std::filesystem;

PriorSource::PriorSource(fs::path folder, ExpectedPriors expected, bool strict, Warning warn)
    : folder_(std::move(folder)),
      expected_(std::move(expected)),
      strict_(strict),
      warn_(std::move(warn)) {
  const std::vector<fs::path> entries = list_folder(folder_);
  const bool any = std::any_of(entries.begin(), entries.end(),
                               [](const fs::path& p) { return p.extension() == ".kysp"; });
  if (!any) throw InputError(folder_.string() + ": has no prior files (*.kysp)");
}

fs::path PriorSource::path_of(const std::string& name) const {
  return folder_ / (name + ".kysp");
}

std::optional<PriorFile> PriorSource::load(const std::string& name) {
  const fs::path path = path_of(name);
  if (!path_exists(path)) {
    const std::string message = path.string() + ": no prior file for this frame";
    if (strict_) throw InputError(message);
    if (missing_++ == 0 && warn_) warn_(message + "; it has no priors (told once)");
    return std::nullopt;
  }
  std::optional<PriorFile> file = PriorFile::open(path, expected_);
  ++loaded_;
  return file;
}

void PriorSource::prefetch(const std::string& name) const {
#ifdef POSIX_FADV_WILLNEED
  const int fd = ::open(path_of(name).c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (fd < 0) return;
  ::posix_fadvise(fd, 0, 0, POSIX_FADV_WILLNEED);
  ::close(fd);
#else
  (void)name;
#endif
}

}  // namespace kys_slam
