// SPDX-License-Identifier: BSD-3-Clause
#include <dirent.h>
#include <kys_slam/error.h>
#include <kys_slam/util/paths.h>

#include <algorithm>
#include <cerrno>
#include <memory>
#include <system_error>

namespace kys_slam {
namespace fs = std::filesystem;
namespace {

[[noreturn]] void fail(const fs::path& path, const std::error_code& error) {
  throw InputError("cannot read " + path.string() + ": " + error.message());
}

fs::file_type type_of(const fs::path& path) {
  std::error_code error;
  const fs::file_type type = fs::status(path, error).type();
  if (type == fs::file_type::none) fail(path, error);
  return type;
}

bool is_digit(char c) {
  return c >= '0' && c <= '9';
}

/// The digits at the front, without zeros before them; takes them off.
std::string_view take_number(std::string_view& text) {
  std::size_t end = 0;
  while (end < text.size() && is_digit(text[end])) ++end;
  std::string_view digits = text.substr(0, end);
  text.remove_prefix(end);
  while (!digits.empty() && digits.front() == '0') digits.remove_prefix(1);
  return digits;
}

}  // namespace

bool path_exists(const fs::path& path) {
  return type_of(path) != fs::file_type::not_found;
}

bool is_folder(const fs::path& path) {
  return type_of(path) == fs::file_type::directory;
}

bool is_file(const fs::path& path) {
  return type_of(path) == fs::file_type::regular;
}

// std::filesystem's iterators end the program when memory runs out (libstdc++ 12).
std::vector<std::string> names_in_folder(const fs::path& folder) {
  struct Closer {
    void operator()(DIR* d) const { ::closedir(d); }
  };
  const std::unique_ptr<DIR, Closer> stream(::opendir(folder.c_str()));
  if (stream == nullptr) fail(folder, {errno, std::generic_category()});
  std::vector<std::string> names;
  while (true) {
    errno = 0;
    const dirent* entry = ::readdir(stream.get());
    if (entry == nullptr) break;
    names.emplace_back(entry->d_name);
  }
  if (errno != 0) fail(folder, {errno, std::generic_category()});
  return names;
}

std::vector<fs::path> list_folder(const fs::path& folder) {
  std::vector<fs::path> entries;
  for (const std::string& name : names_in_folder(folder)) {
    if (!name.starts_with('.')) entries.push_back(folder / name);
  }
  std::sort(entries.begin(), entries.end());
  return entries;
}

fs::path behind_links(const fs::path& path) {
  constexpr int kMostLinks = 40;  // as the kernel
  std::error_code error;
  fs::path target = path;
  for (int i = 0; fs::is_symlink(fs::symlink_status(target, error)); ++i) {
    if (i == kMostLinks) fail(path, {ELOOP, std::generic_category()});
    const fs::path next = fs::read_symlink(target, error);
    if (error) fail(target, error);
    target = target.parent_path() / next;  // `next` alone when it is absolute
  }
  return target;
}

bool is_same_path(const fs::path& a, const fs::path& b) {
  std::error_code error;
  return fs::equivalent(a, b, error) && !error;
}

int compare_names(std::string_view a, std::string_view b) {
  bool fraction = false;
  char last = 0;
  while (!a.empty() && !b.empty()) {
    if (is_digit(a.front()) && is_digit(b.front()) && !fraction) {
      const std::string_view x = take_number(a), y = take_number(b);
      if (x.size() != y.size()) return x.size() < y.size() ? -1 : 1;
      if (const int order = x.compare(y); order != 0) return order;
      last = '0';
      continue;
    }
    if (a.front() != b.front()) return a.compare(b);
    fraction = (a.front() == '.' && is_digit(last)) || (fraction && is_digit(a.front()));
    last = a.front();
    a.remove_prefix(1);
    b.remove_prefix(1);
  }
  return a.empty() && b.empty() ? 0 : a.empty() ? -1 : 1;
}

void sort_frames(std::vector<fs::path>& files) {
  std::stable_sort(files.begin(), files.end(), [](const fs::path& a, const fs::path& b) {
    return compare_names(a.stem().native(), b.stem().native()) < 0;
  });
}

}  // namespace kys_slam
