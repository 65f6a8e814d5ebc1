// SPDX-License-Identifier: BSD-3-Clause
#include <fcntl.h>
#include <kys_slam/error.h>
#include <kys_slam/util/memory_limit.h>
#include <kys_slam/util/read_bytes.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace kys_slam {
namespace {

class Descriptor {
 public:
  explicit Descriptor(const char* path) : fd_(::open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK)) {}
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  ~Descriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  [[nodiscard]] int get() const { return fd_; }

 private:
  int fd_;
};

template <typename Buffer>
Buffer read_all(const std::filesystem::path& path, std::size_t max_bytes) {
  const Descriptor file(path.c_str());
  if (file.get() < 0) {
    throw InputError("cannot read " + path.string() + ": " + std::strerror(errno));
  }
  struct stat status {};
  if (::fstat(file.get(), &status) != 0 || !S_ISREG(status.st_mode)) {
    throw InputError("cannot read " + path.string() + ": not a regular file");
  }
  const auto size = static_cast<std::size_t>(status.st_size);
  if (size > max_bytes) {
    throw InputError("cannot read " + path.string() + ": " + std::to_string(size) +
                     " bytes are more than the " + std::to_string(max_bytes) + " allowed");
  }
  check_memory(path.string(), size);
  Buffer buffer(size, typename Buffer::value_type{});
  std::size_t done = 0;
  while (done < size) {
    const ssize_t n = ::read(file.get(), buffer.data() + done, size - done);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) throw InputError("cannot read " + path.string() + ": " + std::strerror(errno));
    if (n == 0) break;  // the file shrank while we read it; its reader will see it is truncated
    done += static_cast<std::size_t>(n);
  }
  buffer.resize(done);
  return buffer;
}

}  // namespace

std::vector<std::uint8_t> read_bytes(const std::filesystem::path& path, std::size_t max_bytes) {
  return read_all<std::vector<std::uint8_t>>(path, max_bytes);
}

std::string read_text(const std::filesystem::path& path, std::size_t max_bytes) {
  return read_all<std::string>(path, max_bytes);
}

}  // namespace kys_slam
