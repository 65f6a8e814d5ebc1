// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

// Every descriptor distance of the system is computed by the library in kys/. Its source is the one
// place where bits of descriptors may be counted; this reads the rest of the tree and looks for
// another one. The single exception is named below.

namespace {

namespace fs = std::filesystem;

struct Place {
  std::string file;  // relative to the tree
  std::string text;  // the line, without comments
};

bool is_source(const fs::path& path) {
  const std::string extension = path.extension().string();
  return extension == ".h" || extension == ".cpp" || extension == ".in" || extension == ".inc";
}

/// Lines of all sources below `folder` that contain one of `words`, whatever their case.
std::vector<Place> find_words(const fs::path& root, const std::string& folder,
                              const std::vector<std::string>& words) {
  std::vector<Place> places;
  for (const auto& entry : fs::recursive_directory_iterator(root / folder)) {
    if (!entry.is_regular_file() || !is_source(entry.path())) continue;
    std::ifstream file(entry.path());
    std::string line;
    while (std::getline(file, line)) {
      line = line.substr(0, line.find("//"));
      std::string lower = line;
      std::transform(lower.begin(), lower.end(), lower.begin(),
                     [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
      const bool found = std::any_of(words.begin(), words.end(), [&](const std::string& word) {
        return lower.find(word) != std::string::npos;
      });
      if (found) places.push_back({fs::relative(entry.path(), root).string(), line});
    }
  }
  return places;
}

const std::vector<std::string> kBitCounting{
    "popcount",    "popcnt",    "bitset<",   "norm_hamming", "hamming(",   "hamming_many",
    "hammingdist", "bfmatcher", "bit_count", "0x55555555",   "0x33333333", "0x0f0f0f0f"};

TEST(OneDistance, NothingOutsideTheLibraryCountsBitsOfDescriptors) {
  const fs::path root = KYS_SOURCE_DIR;
  ASSERT_TRUE(fs::is_directory(root / "src"));
  int exceptions = 0;
  for (const char* folder : {"src", "include", "priors", "tools"}) {
    for (const Place& place : find_words(root, folder, kBitCounting)) {
      // Map::refresh_landmark picks the most central of a landmark's own descriptors. Nothing is
      // matched there, all observations are of one and the same point, and no prior is asked.
      const bool representative =
          place.file == "src/map/map_landmarks.cpp" &&
          place.text.find("kys::hamming(*descriptors[i], *descriptors[j])") != std::string::npos;
      // Spreading the bits of a coordinate (the quadtree's keys) uses the masks, but adds nothing
      // up.
      const bool spreading = place.file == "src/features/quadtree.cpp" &&
                             place.text.find("(v | v <<") != std::string::npos;
      if (spreading) continue;
      if (representative) {
        ++exceptions;
      } else {
        ADD_FAILURE() << place.file << ": " << place.text;
      }
    }
  }
  EXPECT_EQ(exceptions, 1);
}

TEST(OneDistance, TheSearchFindsWhatItLooksFor) {
  // The library itself is full of it: a search that found nothing there would prove nothing.
  const fs::path root = KYS_SOURCE_DIR;
  EXPECT_GT(find_words(root, "kys/include", kBitCounting).size(), 5u);
  EXPECT_GT(find_words(root, "kys/src", kBitCounting).size(), 5u);
}

TEST(OneDistance, DescriptorWordsAreTakenApartNowhereElse) {
  // Without looking at the words of a descriptor no distance can be had. Extraction writes them and
  // place recognition and input read them as keys; the folders that match must not touch them.
  const fs::path root = KYS_SOURCE_DIR;
  for (const char* room : {"src/matching", "src/tracking", "src/mapping", "src/map", "src/motion",
                           "src/loop_closing", "src/system"}) {
    for (const Place& place : find_words(root, room, {".words", "->words"})) {
      ADD_FAILURE() << place.file << ": " << place.text;
    }
  }
}

}  // namespace
