#include "priors/format/prior_source.h"

#include <fcntl.h>
#include <kys_slam/error.h>
#include <unistd.h>

#include <algorithm>
#include <system_error>

namespace kys_slam {

namespace fs = std::filesystem;

PriorSource::PriorSource(fs::path folder, ExpectedPriors expected, bool strict, Warning warn)
    : folder_(std::move(folder)),
      expected_(std::move(expected)),
      strict_(strict),
      warn_(std::move(warn)) {
  std::error_code error;
  fs::directory_iterator entries(folder_, error);
  if (error) throw InputError(folder_.string() + ": cannot read prior folder: " + error.message());
  const bool any = std::any_of(begin(entries), end(entries), [](const fs::directory_entry& e) {
    return e.path().extension() == ".kysp";
  });
  if (!any) throw InputError(folder_.string() + ": has no prior files (*.kysp)");
}

fs::path PriorSource::path_of(const std::string& name) const {
  return folder_ / (name + ".kysp");
}

std::optional<PriorFile> PriorSource::load(const std::string& name) {
  const fs::path path = path_of(name);
  std::error_code error;
  if (!fs::exists(path, error)) {
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
  const int fd = ::open(path_of(name).c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) return;
  ::posix_fadvise(fd, 0, 0, POSIX_FADV_WILLNEED);
  ::close(fd);
#else
  (void)name;
#endif
}

}  // namespace kys_slam
