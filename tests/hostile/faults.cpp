// SPDX-License-Identifier: BSD-3-Clause
// Preloaded into a program: makes its n-th call of one kind fail. Counting begins when the program
// ignores SIGPIPE, which run_main does first, so that what the loader does is left alone.
//   KYS_FAULT=KIND:N   open, read, write, rename, thread, memory; N from 1, 0: none
//   KYS_FAULT=stack:HASH:N   the N-th allocation that this stack of calls asks for
//   KYS_FAULT_COUNT=FILE   where to write how many calls there were
//   KYS_FAULT_STACKS=FILE  where to write the stacks that asked for memory: "HASH COUNT" each
#include <dlfcn.h>
#include <execinfo.h>
#include <fcntl.h>
#include <link.h>
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
#include <iterator>

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

// Stacks of calls that ask for memory, in a table with open addressing: without memory of its own.
struct Stack {
  std::atomic<unsigned long> hash{0};
  std::atomic<long> count{0};
};
constexpr std::size_t kStacks = 1 << 16;
Stack stacks[kStacks];
bool count_stacks = false;
unsigned long fault_stack = 0;
thread_local bool counting = false;

/// A loaded part of a module, as known when counting begins.
struct Part {
  unsigned long begin, end, base, name;
};
Part parts[512];
std::size_t part_count = 0;

void mix(unsigned long& hash, unsigned long value) {
  hash = (hash ^ value) * 0x9E3779B97F4A7C15UL;
  hash ^= hash >> 29;
}

int note_module(dl_phdr_info* module, size_t, void*) {
  unsigned long name = 1;
  for (const char* c = module->dlpi_name; *c != 0; ++c) mix(name, static_cast<unsigned char>(*c));
  for (int i = 0; i < module->dlpi_phnum && part_count < std::size(parts); ++i) {
    const auto& header = module->dlpi_phdr[i];
    if (header.p_type != PT_LOAD || (header.p_flags & PF_X) == 0) continue;
    const unsigned long begin = module->dlpi_addr + header.p_vaddr;
    parts[part_count++] = {begin, begin + header.p_memsz, module->dlpi_addr, name};
  }
  return 0;
}

/// The return addresses, relative to where their modules are loaded.
unsigned long hash_of_stack() {
  void* frames[40];
  const int depth = backtrace(frames, 40);
  unsigned long hash = 1;
  for (int i = 2; i < depth; ++i) {
    const auto address = reinterpret_cast<unsigned long>(frames[i]);
    for (std::size_t k = 0; k < part_count; ++k) {
      if (address < parts[k].begin || address >= parts[k].end) continue;
      mix(hash, parts[k].name);
      mix(hash, address - parts[k].base);
      break;
    }
  }
  return hash == 0 ? 1 : hash;
}

/// Counts the allocation at its stack. \returns whether it is the one to fail
bool stack_fails() {
  if (counting) return false;
  counting = true;
  const unsigned long hash = hash_of_stack();
  counting = false;
  for (std::size_t at = hash % kStacks, tried = 0; tried < kStacks; ++tried) {
    unsigned long empty = 0;
    Stack& stack = stacks[(at + tried) % kStacks];
    if (!stack.hash.compare_exchange_strong(empty, hash) && empty != hash) continue;
    return ++stack.count == fault_number && hash == fault_stack;
  }
  return false;
}

bool fails(Kind kind) {
  if (!armed.load(std::memory_order_relaxed)) return false;
  if (kind == kMemory && count_stacks && stack_fails()) return true;
  return ++calls[kind] == fault_number && kind == fault_kind;
}

template <typename Function>
Function* next(const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

void arm() {
  if (const char* text = getenv("KYS_FAULT")) {
    if (strncmp(text, "stack:", 6) == 0) {
      char* end = nullptr;
      fault_stack = strtoul(text + 6, &end, 16);
      fault_number = atol(end + 1);
    }
    for (int kind = 0; kind < kKinds; ++kind) {
      const size_t length = strlen(kNames[kind]);
      if (strncmp(text, kNames[kind], length) != 0 || text[length] != ':') continue;
      fault_kind = kind;
      fault_number = atol(text + length + 1);
    }
  }
  count_stacks = fault_stack != 0 || getenv("KYS_FAULT_STACKS") != nullptr;
  void* frame[1];
  backtrace(frame, 1);  // loads what it needs
  dl_iterate_phdr(note_module, nullptr);
  armed = true;
}

void write_stacks() {
  const char* path = getenv("KYS_FAULT_STACKS");
  FILE* file = path != nullptr ? fopen(path, "w") : nullptr;
  if (file == nullptr) return;
  for (const Stack& stack : stacks) {
    if (stack.hash != 0) fprintf(file, "%lx %ld\n", stack.hash.load(), stack.count.load());
  }
  fclose(file);
}

__attribute__((destructor)) void tell() {
  armed = false;
  write_stacks();
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
