// Preloaded into a program: makes its n-th call of one kind fail. Counting begins when the program
// ignores SIGPIPE, which run_main does first, so that what the loader does is left alone.
//   KYS_FAULT=KIND:N   open, read, write, rename, thread, memory; N from 1, 0: none
//   KYS_FAULT_COUNT=FILE   where to write how many calls there were
#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <sys/types.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>

extern "C" void* __libc_malloc(size_t size);
extern "C" void* __libc_calloc(size_t count, size_t size);
extern "C" void* __libc_memalign(size_t alignment, size_t size);

namespace {

enum Kind { kOpen, kRead, kWrite, kRename, kThread, kMemory, kKinds };
constexpr const char* kNames[kKinds] = {"open", "read", "write", "rename", "thread", "memory"};

std::atomic<bool> armed{false};
std::atomic<long> calls[kKinds];
int fault_kind = -1;
long fault_number = 0;

bool fails(Kind kind) {
  if (!armed.load(std::memory_order_relaxed)) return false;
  return ++calls[kind] == fault_number && kind == fault_kind;
}

template <typename Function>
Function* next(const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

void arm() {
  if (const char* text = getenv("KYS_FAULT")) {
    for (int kind = 0; kind < kKinds; ++kind) {
      const size_t length = strlen(kNames[kind]);
      if (strncmp(text, kNames[kind], length) != 0 || text[length] != ':') continue;
      fault_kind = kind;
      fault_number = atol(text + length + 1);
    }
  }
  armed = true;
}

__attribute__((destructor)) void tell() {
  armed = false;
  const char* path = getenv("KYS_FAULT_COUNT");
  FILE* file = path != nullptr ? fopen(path, "w") : nullptr;
  if (file == nullptr) return;
  for (int kind = 0; kind < kKinds; ++kind)
    fprintf(file, "%s %ld\n", kNames[kind], calls[kind].load());
  fclose(file);
}

}  // namespace

extern "C" {

__sighandler_t signal(int number, __sighandler_t handler) noexcept {
  static auto* const real = next<__sighandler_t(int, __sighandler_t)>("signal");
  if (number == SIGPIPE && handler == SIG_IGN && !armed) arm();
  return real(number, handler);
}

int open(const char* path, int flags, ...) {
  static auto* const real = next<int(const char*, int, mode_t)>("open");
  va_list rest;
  va_start(rest, flags);
  const mode_t mode = (flags & O_CREAT) != 0 ? va_arg(rest, mode_t) : 0;
  va_end(rest);
  if (fails(kOpen)) {
    errno = EMFILE;
    return -1;
  }
  return real(path, flags, mode);
}
int open64(const char* path, int flags, ...) {
  va_list rest;
  va_start(rest, flags);
  const mode_t mode = (flags & O_CREAT) != 0 ? va_arg(rest, mode_t) : 0;
  va_end(rest);
  return open(path, flags, mode);
}

ssize_t read(int fd, void* buffer, size_t size) {
  static auto* const real = next<ssize_t(int, void*, size_t)>("read");
  if (fails(kRead)) {
    errno = EIO;
    return -1;
  }
  return real(fd, buffer, size);
}

ssize_t write(int fd, const void* buffer, size_t size) {
  static auto* const real = next<ssize_t(int, const void*, size_t)>("write");
  if (fd > 2 && fails(kWrite)) {
    errno = ENOSPC;
    return -1;
  }
  return real(fd, buffer, size);
}

int rename(const char* from, const char* to) noexcept {
  static auto* const real = next<int(const char*, const char*)>("rename");
  if (fails(kRename)) {
    errno = EIO;
    return -1;
  }
  return real(from, to);
}

int pthread_create(pthread_t* thread, const pthread_attr_t* attributes, void* (*start)(void*),
                   void* argument) noexcept {
  static auto* const real =
      next<int(pthread_t*, const pthread_attr_t*, void* (*)(void*), void*)>("pthread_create");
  if (fails(kThread)) return EAGAIN;
  return real(thread, attributes, start, argument);
}

void* malloc(size_t size) noexcept {
  if (fails(kMemory)) {
    errno = ENOMEM;
    return nullptr;
  }
  return __libc_malloc(size);
}
void* calloc(size_t count, size_t size) noexcept {
  if (fails(kMemory)) {
    errno = ENOMEM;
    return nullptr;
  }
  return __libc_calloc(count, size);
}
void* aligned_alloc(size_t alignment, size_t size) noexcept {
  if (fails(kMemory)) {
    errno = ENOMEM;
    return nullptr;
  }
  return __libc_memalign(alignment, size);
}
int posix_memalign(void** result, size_t alignment, size_t size) noexcept {
  if (fails(kMemory)) return ENOMEM;
  *result = __libc_memalign(alignment, size);
  return *result != nullptr ? 0 : ENOMEM;
}

}  // extern "C"
