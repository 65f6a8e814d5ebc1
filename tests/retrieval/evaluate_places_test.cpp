// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "io/temporary_folder.h"
#include "measure/recall.h"
#include "support/run_command.h"

namespace kys_slam {
namespace {

using testing::Command;
using testing::read_text;

TEST(Recall, AHandWorkedCurve) {
  // Best first: right, right, wrong and right (equal scores), wrong. Five could be found.
  const std::vector<Proposal> proposals{
      {0.5, true}, {0.9, true}, {0.3, false}, {0.5, false}, {0.8, true}};
  const std::vector<RecallPoint> curve = recall_curve(proposals, 5);
  ASSERT_EQ(curve.size(), 4u);
  EXPECT_DOUBLE_EQ(curve[0].threshold, 0.9);
  EXPECT_DOUBLE_EQ(curve[1].recall, 0.4);
  EXPECT_DOUBLE_EQ(curve[1].precision, 1);
  EXPECT_DOUBLE_EQ(curve[2].threshold, 0.5);
  EXPECT_DOUBLE_EQ(curve[2].recall, 0.6);
  EXPECT_DOUBLE_EQ(curve[2].precision, 0.75);
  EXPECT_DOUBLE_EQ(curve[3].precision, 0.6);
  EXPECT_DOUBLE_EQ(best_recall(curve, 1.0).recall, 0.4);
  EXPECT_DOUBLE_EQ(best_recall(curve, 1.0).threshold, 0.8);
  EXPECT_DOUBLE_EQ(best_recall(curve, 0.7).recall, 0.6);
}

TEST(Recall, NothingProposedAndNothingToFind) {
  EXPECT_TRUE(recall_curve({}, 3).empty());
  EXPECT_EQ(best_recall({}, 1.0).recall, 0);
  EXPECT_EQ(best_recall(recall_curve({{1, false}}, 0), 1.0).recall, 0);
}

/// A row of the program's table.
struct Row {
  std::string query;
  double distance, angle, overlap;
  int rank;
  bool accepted;
  double translation, rotation;
  [[nodiscard]] bool is_near() const { return distance < 1 && angle < 30; }
};

std::vector<Row> read_rows(const std::filesystem::path& file) {
  std::istringstream text(read_text(file));
  std::string line;
  std::getline(text, line);
  std::vector<Row> rows;
  while (std::getline(text, line)) {
    std::vector<std::string> fields;
    std::istringstream cells(line);
    for (std::string cell; std::getline(cells, cell, ',');) fields.push_back(cell);
    rows.push_back({fields.at(0), std::stod(fields.at(2)), std::stod(fields.at(3)),
                    std::stod(fields.at(4)), std::stoi(fields.at(7)), fields.at(8) == "1",
                    std::stod(fields.at(11)), std::stod(fields.at(12))});
  }
  return rows;
}

TEST(EvaluatePlaces, RealKeyframesOfARoomSeenAgainAndAgain) {
  const auto sequence = shared_data() / "euroc_v101_keyframes";
  if (!std::filesystem::exists(sequence)) GTEST_SKIP() << sequence << " is not there";
  const TemporaryFolder folder;
  const auto table = folder / "pairs.csv";
  // Every second of a hundred keyframes: 20 near pairs.
  Command command("evaluate_places", {sequence.string(), "--every", "2", "--candidates", "5",
                                      "--csv", table.string()});
  ASSERT_EQ(command.wait(), 0) << command.err();
  EXPECT_NE(command.out().find("50 keyframes"), std::string::npos) << command.out();

  const std::vector<Row> rows = read_rows(table);
  std::set<std::string> queries, found;
  int near = 0, near_accepted = 0, accepted = 0;
  for (const Row& row : rows) {
    if (row.is_near()) queries.insert(row.query);
    if (row.is_near() && row.rank >= 0 && row.rank < 5) found.insert(row.query);
    near += row.is_near() ? 1 : 0;
    near_accepted += row.is_near() && row.accepted ? 1 : 0;
    if (!row.accepted) continue;
    ++accepted;
    EXPECT_LT(row.translation, 0.3);
    EXPECT_LT(row.rotation, 5);
    EXPECT_GT(row.overlap, 0.1);
  }
  RecordProperty("near_pairs", near);
  RecordProperty("near_pairs_accepted", near_accepted);
  EXPECT_GE(near, 15);
  EXPECT_GE(static_cast<double>(found.size()), 0.85 * static_cast<double>(queries.size()));
  EXPECT_GE(near_accepted, 0.4 * near);
  EXPECT_GT(accepted, near_accepted);  // places a little farther off are recognised, too
}

TEST(EvaluatePlaces, WhatItCannotReadItNames) {
  Command command("evaluate_places", {"/nowhere"});
  EXPECT_EQ(command.wait(), 2);
  EXPECT_NE(command.err().find("/nowhere"), std::string::npos);
  EXPECT_EQ(Command("evaluate_places", {}).wait(), 2);
  EXPECT_EQ(Command("evaluate_places", {"--help"}).wait(), 0);
}

}  // namespace
}  // namespace kys_slam
