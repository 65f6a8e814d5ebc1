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

bool is_same_path(const fs::path& a, const fs::path& b) {
  std::error_code error;
  return fs::equivalent(a, b, error) && !error;
}

}  // namespace kys_slam
