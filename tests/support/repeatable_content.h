// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <string>

#include "support/run_command.h"

namespace kys_slam::testing {

/// frames.csv without its columns of times and memory.
inline std::string without_timings(const std::string& csv) {
  std::istringstream lines(csv);
  std::string line;
  std::set<std::size_t> dropped;
  std::string kept;
  for (bool header = true; std::getline(lines, line); header = false) {
    std::istringstream cells(line);
    std::string cell;
    for (std::size_t i = 0; std::getline(cells, cell, ','); ++i) {
      if (header && (cell.rfind("ms_", 0) == 0 || cell == "resident_mb")) dropped.insert(i);
      if (dropped.count(i) == 0) kept += cell + ",";
    }
    kept += "\n";
  }
  EXPECT_GE(dropped.size(), 8u);
  return kept;
}

/// Every file of a run's folder as far as it has to be the same every time.
inline std::map<std::string, std::string> repeatable_content(const std::filesystem::path& folder) {
  std::map<std::string, std::string> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    std::string text = read_text(entry.path());
    if (name == "frames.csv") {
      text = without_timings(text);
    } else if (name == "summary.json") {
      auto json = nlohmann::ordered_json::parse(text);
      for (const char* key : {"timing_ms", "process", "peak_memory_mb"}) {
        EXPECT_EQ(json.erase(key), 1u) << key;
      }
      text = json.dump();
    }
    files[name] = text;
  }
  return files;
}

}  // namespace kys_slam::testing
