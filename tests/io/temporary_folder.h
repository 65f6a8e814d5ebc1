// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gtest/gtest.h>
#include <kys_slam/error.h>
#include <stdlib.h>

#include <filesystem>
#include <fstream>
#include <string>

namespace kys_slam {

/// A fresh folder that is removed with its content.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "kys_test_XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) throw std::runtime_error("mkdtemp failed");
    path_ = name;
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  [[nodiscard]] std::filesystem::path operator/(const std::string& name) const {
    return path_ / name;
  }

 private:
  std::filesystem::path path_;
};

inline void write_text(const std::filesystem::path& path, const std::string& text) {
  std::filesystem::create_directories(path.parent_path());
  std::ofstream(path, std::ios::binary) << text;
}

/// Folder of the real excerpts; the environment variable of the macro's name comes first. It may
/// not exist: tests that need it skip then.
inline std::filesystem::path shared_data() {
  const char* chosen = std::getenv("KYS_SHARED_DATA_DIR");
  return chosen != nullptr ? chosen : KYS_SHARED_DATA_DIR;
}

/// Expects `function` to throw InputError with a one-line message that contains every string.
template <typename Function>
void expect_input_error(Function&& function, std::initializer_list<std::string> parts) {
  try {
    function();
    ADD_FAILURE() << "no InputError";
  } catch (const InputError& error) {
    const std::string message = error.what();
    EXPECT_EQ(message.find('\n'), std::string::npos) << message;
    for (const std::string& part : parts) {
      EXPECT_NE(message.find(part), std::string::npos) << message << " lacks " << part;
    }
  }
}

}  // namespace kys_slam
