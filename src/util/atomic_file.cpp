// SPDX-License-Identifier: BSD-3-Clause
#include <fcntl.h>
#include <kys_slam/error.h>
#include <kys_slam/util/atomic_file.h>
#include <kys_slam/util/paths.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <string>
#include <string_view>
#include <system_error>

namespace kys_slam {
namespace fs = std::filesystem;
namespace {

[[noreturn]] void fail(const fs::path& path, int error) {
  throw InputError("cannot write " + path.string() + ": " + std::strerror(error));
}

/// What can be replaced: nothing, or a regular file. A device or a pipe would be gone.
void check_target(const fs::path& path) {
  if (!path.has_filename()) fail(path, EISDIR);
  struct stat status {};
  if (::stat(path.c_str(), &status) != 0) return;
  if (S_ISDIR(status.st_mode)) fail(path, EISDIR);
  if (!S_ISREG(status.st_mode)) {
    throw InputError("cannot write " + path.string() + ": not a regular file");
  }
}

constexpr std::string_view kEnding = ".kys-tmp";

/// A temporary file beside its target; removed unless committed. It is locked while it is in use,
/// so that others can tell one that was left behind.
class TemporaryFile {
 public:
  explicit TemporaryFile(const fs::path& target) : target_(target) {
    static std::atomic<unsigned> count{0};
    const fs::path folder = target.has_parent_path() ? target.parent_path() : fs::path(".");
    const std::string begin = (folder / ".").string() + target.filename().string() + "." +
                              std::to_string(::getpid()) + "-";
    do {
      name_ = begin + std::to_string(count++) + std::string(kEnding);
      fd_ = ::open(name_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    } while (fd_ < 0 && errno == EEXIST);
    if (fd_ < 0) {
      name_.clear();
      fail(target_, errno);
    }
    ::flock(fd_, LOCK_EX | LOCK_NB);
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

/// Temporary files that nobody holds open any more. The pause covers the moment between making one
/// and locking it.
void remove_left_files(const fs::path& folder) {
  constexpr std::time_t kPause = 10;  // s
  for (const std::string& name : names_in_folder(folder)) {
    if (!name.starts_with('.') || !name.ends_with(kEnding)) continue;
    const fs::path path = folder / name;
    const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOFOLLOW);
    if (fd < 0) continue;
    struct stat status {};
    const bool left = ::fstat(fd, &status) == 0 && S_ISREG(status.st_mode) &&
                      status.st_mtime + kPause < std::time(nullptr) &&
                      ::flock(fd, LOCK_EX | LOCK_NB) == 0;
    if (left) ::unlink(path.c_str());
    ::close(fd);
  }
}

}  // namespace

void write_file_atomic(const fs::path& path, std::span<const std::uint8_t> bytes, Durable durable) {
  const fs::path target = behind_links(path);
  check_target(target);
  TemporaryFile file(target);
  file.write(bytes.data(), bytes.size());
  file.commit(durable);
}

void write_file_atomic(const fs::path& path, std::string_view text, Durable durable) {
  write_file_atomic(
      path, std::span(reinterpret_cast<const std::uint8_t*>(text.data()), text.size()), durable);
}

void make_output_folder(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(behind_links(folder), error);
  if (error || !fs::is_directory(folder, error)) {
    fail(folder, error ? error.value() : ENOTDIR);
  }
  if (::access(folder.c_str(), W_OK | X_OK) != 0) fail(folder, errno);
  try {
    remove_left_files(folder);
  } catch (const InputError&) {  // a folder one may write to and not read
  }
}

void check_writable(const fs::path& path) {
  const fs::path target = behind_links(path);
  check_target(target);
  const TemporaryFile file(target);
}

}  // namespace kys_slam
