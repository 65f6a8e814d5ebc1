#include "util/atomic_file.h"

#include <fcntl.h>
#include <kys_slam/error.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <string>

namespace kys_slam {
namespace fs = std::filesystem;
namespace {

[[noreturn]] void fail(const fs::path& path, int error) {
  throw InputError("cannot write " + path.string() + ": " + std::strerror(error));
}

/// A temporary file beside its target; removed unless committed.
class TemporaryFile {
 public:
  explicit TemporaryFile(const fs::path& target) : target_(target) {
    const fs::path folder = target.has_parent_path() ? target.parent_path() : fs::path(".");
    name_ = (folder / ".").string().append(target.filename().string()).append(".XXXXXX");
    fd_ = ::mkostemp(name_.data(), O_CLOEXEC);
    if (fd_ < 0) fail(target_, errno);
  }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;
  ~TemporaryFile() {
    if (fd_ >= 0) ::close(fd_);
    if (!name_.empty()) ::unlink(name_.c_str());
  }

  void write(const std::uint8_t* data, std::size_t size) {
    while (size > 0) {
      const ssize_t n = ::write(fd_, data, size);
      if (n < 0 && errno == EINTR) continue;
      if (n <= 0) fail(target_, n < 0 ? errno : ENOSPC);
      data += n;
      size -= static_cast<std::size_t>(n);
    }
  }

  void commit(Durable durable) {
    // mkstemp makes files only their owner can read; give them what open() would have.
    const mode_t mask = ::umask(0);
    ::umask(mask);
    ::fchmod(fd_, static_cast<mode_t>(0666) & ~mask);
    if (durable == Durable::kYes && ::fsync(fd_) != 0 && errno != EINVAL && errno != EROFS) {
      fail(target_, errno);
    }
    const int fd = fd_;
    fd_ = -1;
    if (::close(fd) != 0) fail(target_, errno);  // some file systems report a full disk only here
    if (::rename(name_.c_str(), target_.c_str()) != 0) fail(target_, errno);
    name_.clear();
  }

 private:
  fs::path target_;
  std::string name_;
  int fd_ = -1;
};

}  // namespace

void write_file_atomic(const fs::path& path, std::span<const std::uint8_t> bytes, Durable durable) {
  if (!path.has_filename()) fail(path, EISDIR);
  TemporaryFile file(path);
  file.write(bytes.data(), bytes.size());
  file.commit(durable);
}

void write_file_atomic(const fs::path& path, std::string_view text, Durable durable) {
  write_file_atomic(
      path, std::span(reinterpret_cast<const std::uint8_t*>(text.data()), text.size()), durable);
}

void make_output_folder(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error || !fs::is_directory(folder, error)) {
    fail(folder, error ? error.value() : ENOTDIR);
  }
  if (::access(folder.c_str(), W_OK | X_OK) != 0) fail(folder, errno);
}

}  // namespace kys_slam
