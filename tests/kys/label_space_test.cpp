// SPDX-License-Identifier: BSD-3-Clause
// Label spaces: the built-in ones, and an error for whatever can be wrong with a user's.

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>

#include "test_support.h"

namespace kys::test {
namespace {

namespace fs = std::filesystem;

constexpr const char* kClasses =
    "# a comment\n"
    "kys-classes,1,tiny,3\n"
    "id,thing,vector,text,name\n"
    "10,0,fasttext,road,road, route\n"
    "20,1,fasttext,car,car\n"
    "30,0,surrogate,sky,sky\n";
constexpr const char* kTable = "kys-table,1,tiny,3\n0,99,128\n99,0,120.5\n128,120.5,0\n";

class LabelSpaceFiles : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ =
        fs::temp_directory_path() /
        ("kys_label_space_" + std::to_string(::testing::UnitTest::GetInstance()->random_seed()) +
         ::testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  [[nodiscard]] std::string prefix() const { return (folder_ / "tiny").string(); }

  void write(const std::string& classes, const std::string& table) const {
    std::ofstream(prefix() + ".classes.csv", std::ios::binary) << classes;
    std::ofstream(prefix() + ".table.csv", std::ios::binary) << table;
  }

  /// What loading these contents complains about, without the folder.
  std::string complaint(const std::string& classes, const std::string& table) const {
    write(classes, table);
    try {
      (void)load_label_space(prefix());
    } catch (const Error& error) {
      std::string text = error.what();
      EXPECT_EQ(text.find('\n'), std::string::npos);
      const std::size_t at = text.find("tiny.");
      EXPECT_NE(at, std::string::npos) << text;
      return text.substr(at == std::string::npos ? 0 : at);
    }
    return "nothing";
  }

  static std::string edited(std::string text, const std::string& from, const std::string& to) {
    text.replace(text.find(from), from.size(), to);
    return text;
  }

  fs::path folder_;
};

TEST_F(LabelSpaceFiles, AGoodOneIsRead) {
  write(kClasses, kTable);
  const LabelSpace space = load_label_space(prefix());
  EXPECT_EQ(space.name(), "tiny");
  ASSERT_EQ(space.size(), 3u);
  EXPECT_EQ(space.index_of(20), 1);
  EXPECT_EQ(space.index_of("road, route"), 0);
  EXPECT_TRUE(space.at(1).thing);
  EXPECT_FALSE(space.at(0).thing);
  EXPECT_TRUE(space.at(2).surrogate);
  EXPECT_EQ(space.distance(0, 1), 99.0f);
  EXPECT_EQ(space.distance(2, 1), 120.5f);
}

TEST_F(LabelSpaceFiles, WindowsLineEndsAndNoFinalNewlineAreFine) {
  std::string classes = kClasses;
  for (std::size_t i = 0; (i = classes.find('\n', i)) != std::string::npos; i += 2) {
    classes.replace(i, 1, "\r\n");
  }
  std::string table = kTable;
  table.pop_back();
  write(classes, table);
  EXPECT_EQ(load_label_space(prefix()).at(2).name, "sky");
}

TEST_F(LabelSpaceFiles, UnknownIdsAreNamed) {
  write(kClasses, kTable);
  const LabelSpace space = load_label_space(prefix());
  for (const std::int32_t id : {0, 11, -1, 65535}) {
    EXPECT_THROW((void)space.index_of(id), Error);
  }
  EXPECT_THROW((void)space.index_of("train"), Error);
  EXPECT_THROW((void)space.at(3), Error);
  EXPECT_THROW((void)space.distance(0, 3), Error);
  try {
    (void)space.index_of(77);
  } catch (const Error& error) {
    EXPECT_STREQ(error.what(), "label space tiny has no class with id 77");
  }
}

TEST_F(LabelSpaceFiles, BadTables) {
  EXPECT_EQ(complaint(kClasses, edited(kTable, "99,0,120.5", "98,0,120.5")),
            "tiny.table.csv: table is not symmetric for 'road, route' and 'car'");
  EXPECT_EQ(complaint(kClasses, edited(kTable, "99,0,120.5", "99,1,120.5")),
            "tiny.table.csv: distance of 'car' to itself is not 0");
  for (const std::string bad : {"nan", "inf", "-1", "10001", "1e30"}) {
    const std::string what = complaint(kClasses, edited(kTable, "0,99,128", "0,99," + bad));
    EXPECT_EQ(what.find("tiny.table.csv: distance of 'road, route' and 'sky' must be from 0"), 0u)
        << what;
  }
  EXPECT_EQ(complaint(kClasses, edited(kTable, "0,99,128", "0,99,x")),
            "tiny.table.csv:2: 'x' is not a number that fits here");
  EXPECT_EQ(complaint(kClasses, edited(kTable, "0,99,128", "0,,128")),
            "tiny.table.csv:2: '' is not a number that fits here");
  EXPECT_EQ(complaint(kClasses, edited(kTable, "0,99,128", "0,99")),
            "tiny.table.csv:2: row has 2 entries, the first line says 3");
  EXPECT_EQ(complaint(kClasses, edited(kTable, "0,99,128", "0,99,128,1")),
            "tiny.table.csv:2: row has 4 entries, the first line says 3");
  EXPECT_EQ(complaint(kClasses, edited(kTable, "128,120.5,0\n", "")),
            "tiny.table.csv:3: has 2 rows, the first line says 3");
  EXPECT_EQ(complaint(kClasses, ""), "tiny.table.csv: cannot be read, or is empty");
}

TEST_F(LabelSpaceFiles, BadNames) {
  for (const std::string& bad : {std::string("ti ny"), std::string("t\xc3\xbc"),
                                 std::string("t\x1b"), std::string(33, 'a')}) {
    EXPECT_EQ(
        complaint(edited(kClasses, "tiny", bad), edited(kTable, "tiny", bad)),
        "tiny.classes.csv:2: the name of the label space needs 1 to 32 characters from ! to ~");
  }
  const std::string longest(32, 'a');
  EXPECT_EQ(complaint(edited(kClasses, "tiny", longest), edited(kTable, "tiny", longest)),
            "nothing");
}

TEST_F(LabelSpaceFiles, BadHeaders) {
  EXPECT_NE(complaint(kClasses, edited(kTable, "tiny,3", "tiny,2")).find("is the table of tiny"),
            std::string::npos);
  EXPECT_NE(complaint(kClasses, edited(kTable, "tiny,3", "huge,3")).find("is the table of huge"),
            std::string::npos);
  EXPECT_EQ(complaint(kClasses, edited(kTable, "kys-table,1", "kys-table,2")),
            "tiny.table.csv:1: format version is not 1");
  EXPECT_EQ(complaint(kClasses, edited(kTable, "kys-table", "table")),
            "tiny.table.csv:1: does not begin with 'kys-table,1,NAME,COUNT'");
  for (const std::string bad : {"0", "-3", "70000", "3x", ""}) {
    EXPECT_EQ(
        complaint(edited(kClasses, "tiny,3", "tiny," + bad), kTable).find("tiny.classes.csv:2:"),
        0u);
  }
}

TEST_F(LabelSpaceFiles, BadClasses) {
  EXPECT_EQ(complaint(edited(kClasses, "20,1", "10,1"), kTable),
            "tiny.table.csv: class id 10 is there twice");
  EXPECT_EQ(complaint(edited(kClasses, "car,car", "car,sky"), kTable),
            "tiny.table.csv: class name 'sky' is empty or there twice");
  EXPECT_EQ(complaint(edited(kClasses, "20,1,", "20,yes,"), kTable),
            "tiny.classes.csv:5: thing must be 0 or 1, is 'yes'");
  EXPECT_EQ(complaint(edited(kClasses, "20,1,fasttext", "20,1,glove"), kTable),
            "tiny.classes.csv:5: vector must be fasttext or surrogate, is 'glove'");
  EXPECT_EQ(complaint(edited(kClasses, "car,car", "car"), kTable),
            "tiny.classes.csv:5: class without a name");
  EXPECT_EQ(complaint(edited(kClasses, "20,1,", "twenty,1,"), kTable),
            "tiny.classes.csv:5: 'twenty' is not a number that fits here");
  EXPECT_EQ(complaint(edited(kClasses, "30,0,surrogate,sky,sky\n", ""), kTable),
            "tiny.classes.csv:5: has 2 classes, the first line says 3");
  EXPECT_EQ(complaint(edited(kClasses, "id,thing", "thing,id"), kTable),
            "tiny.classes.csv:3: the second line must be 'id,thing,vector,text,name'");
}

TEST_F(LabelSpaceFiles, EveryTruncationIsAnError) {
  const std::string classes = kClasses;
  for (std::size_t n = 0; n + 3 < classes.size(); ++n) {  // up to the last name
    EXPECT_NE(complaint(classes.substr(0, n), kTable), "nothing") << n;
  }
  const std::string table = kTable;
  for (std::size_t n = 0; n + 1 < table.size(); ++n) {  // the last newline may be missing
    EXPECT_NE(complaint(kClasses, table.substr(0, n)), "nothing") << n;
  }
}

TEST_F(LabelSpaceFiles, MissingFilesAndUnknownNames) {
  EXPECT_THROW((void)load_label_space("no_such_space"), Error);
  EXPECT_THROW((void)load_label_space(folder_ / "a", folder_ / "b"), Error);
  EXPECT_THROW((void)load_label_space(folder_, folder_), Error);
  try {
    (void)load_label_space("no_such_space");
  } catch (const Error& error) {
    EXPECT_STREQ(error.what(),
                 "label space 'no_such_space' is not built in (ade20k_150, cityscapes_19, "
                 "coco_panoptic_133, vkitti2) and there is no no_such_space.classes.csv");
  }
}

TEST(LabelSpace, SizesAreChecked) {
  const std::vector<LabelClass> two = {{1, "a", "a", false, false}, {2, "b", "b", false, false}};
  EXPECT_THROW(LabelSpace("x", {}, {}), Error);
  EXPECT_THROW(LabelSpace("x", two, {0, 1, 1}), Error);
  EXPECT_NO_THROW(LabelSpace("x", two, {0, 1, 1, 0}));
}

float off_diagonal(const LabelSpace& space, bool smallest) {
  float best = smallest ? 1e9f : 0.0f;
  for (std::uint16_t i = 0; i < space.size(); ++i) {
    for (std::uint16_t j = 0; j < i; ++j) {
      const float s = space.distance(i, j);
      best = smallest ? std::min(best, s) : std::max(best, s);
    }
  }
  return best;
}

TEST(BuiltinLabelSpace, CocoPanoptic) {
  const LabelSpace coco = load_label_space("coco_panoptic_133");
  ASSERT_EQ(coco.size(), 133u);
  EXPECT_EQ(std::count_if(coco.classes().begin(), coco.classes().end(),
                          [](const LabelClass& c) { return c.thing; }),
            80);
  const auto s = [&](const char* a, const char* b) {
    return coco.distance(coco.index_of(a), coco.index_of(b));
  };
  EXPECT_EQ(s("car", "truck"), 86.0f);
  EXPECT_EQ(s("car", "bus"), 110.0f);
  EXPECT_EQ(s("bicycle", "motorcycle"), 74.0f);
  EXPECT_EQ(s("road", "pavement-merged"), 103.0f);
  EXPECT_EQ(s("car", "sky-other-merged"), 155.0f);
  EXPECT_EQ(off_diagonal(coco, true), 50.0f);
  EXPECT_EQ(off_diagonal(coco, false), 174.0f);
  EXPECT_EQ(coco.at(coco.index_of(200)).name, "rug-merged");
  EXPECT_EQ(coco.at(coco.index_of(13)).name, "stop sign");
  EXPECT_THROW((void)coco.index_of(12), Error);  // a gap in COCO's ids
}

TEST(BuiltinLabelSpace, Ade20k) {
  const LabelSpace ade = load_label_space("ade20k_150");
  ASSERT_EQ(ade.size(), 150u);
  EXPECT_EQ(std::count_if(ade.classes().begin(), ade.classes().end(),
                          [](const LabelClass& c) { return c.surrogate; }),
            80);
  const auto s = [&](const char* a, const char* b) {
    return ade.distance(ade.index_of(a), ade.index_of(b));
  };
  EXPECT_EQ(ade.index_of("wall"), 0);
  EXPECT_EQ(s("road", "sky"), 128.0f);
  EXPECT_EQ(s("road", "sidewalk"), 103.0f);
  EXPECT_EQ(s("armchair", "chair"), 102.0f);  // surrogates: near, related, unrelated
  EXPECT_EQ(s("armchair", "bed"), 119.0f);
  EXPECT_EQ(s("armchair", "sky"), 135.0f);
}

TEST(BuiltinLabelSpace, VirtualKitti2) {
  const LabelSpace space = load_label_space("vkitti2");
  ASSERT_EQ(space.size(), 14u);
  const auto s = [&](const char* a, const char* b) {
    return space.distance(space.index_of(a), space.index_of(b));
  };
  EXPECT_EQ(s("Car", "Truck"), 86.0f);
  EXPECT_EQ(s("Road", "Sky"), 128.0f);
  EXPECT_EQ(s("Van", "Car"), 102.0f);
  EXPECT_TRUE(space.at(space.index_of("Van")).surrogate);
  EXPECT_TRUE(space.at(space.index_of("Van")).thing);
  EXPECT_FALSE(space.at(space.index_of("Car")).surrogate);
}

TEST(BuiltinLabelSpace, AreTheFilesOfTheTree) {
  const fs::path data = fs::path(KYS_SOURCE_DIR) / "kys" / "data";
  for (const std::string& name : builtin_label_spaces()) {
    const LabelSpace built_in = load_label_space(name);
    const LabelSpace file = load_label_space((data / name).string());
    EXPECT_EQ(built_in.name(), name);
    EXPECT_EQ(built_in.name(), file.name());
    EXPECT_EQ(built_in.table(), file.table());
  }
}

}  // namespace
}  // namespace kys::test
