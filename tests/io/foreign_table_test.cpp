// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/image_file.h>
#include <kys_slam/sequence.h>
#include <kys_slam/trajectory_file.h>
#include <kys_slam/util/read_bytes.h>
#include <kys_slam/util/text_table.h>

#include <fstream>

#include "sequence_fixtures.h"

// Tables and images as other programs write them.
namespace kys_slam {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> fields_of(const TextTable& table, std::size_t row) {
  return {table.rows().at(row).fields.begin(), table.rows().at(row).fields.end()};
}

TEST(SpreadsheetTable, HeaderQuotesSemicolonsAndByteOrderMark) {
  const TemporaryFolder folder;
  using Fields = std::vector<std::string>;
  write_text(folder / "t.csv",
             "\xEF\xBB\xBF"
             "time [ns],name\r\n\"12\",\"a.png\"\r\n13,b.png\r\n");
  const TextTable commas(folder / "t.csv", TableStyle::kSpreadsheet);
  ASSERT_EQ(commas.rows().size(), 2U);
  EXPECT_EQ(fields_of(commas, 0), (Fields{"12", "a.png"}));
  EXPECT_EQ(commas.rows()[0].line, 2U);
  write_text(folder / "t.csv", "time;x\n0.5;1\n0,6;2\n");
  const TextTable semicolons(folder / "t.csv", TableStyle::kSpreadsheet);
  EXPECT_EQ(fields_of(semicolons, 1), (Fields{"0,6", "2"}));
  expect_input_error([&] { static_cast<void>(semicolons.number(semicolons.rows()[1], 0)); },
                     {"t.csv:3", "'0,6'"});
  // Rows of words alone are no header, and plain tables keep theirs.
  write_text(folder / "t.csv", "a b\nc d\n");
  EXPECT_EQ(TextTable(folder / "t.csv", TableStyle::kSpreadsheet).rows().size(), 2U);
  write_text(folder / "t.csv", "a b\n1 2\n");
  EXPECT_EQ(TextTable(folder / "t.csv").rows().size(), 2U);
}

TEST(SpreadsheetTable, TrajectoriesWithTheNamesOfTheirColumns) {
  const TemporaryFolder folder;
  write_text(folder / "t.csv",
             "timestamp,tx,ty,tz,qx,qy,qz,qw\n1,2,3,4,0,0,0,1\n2,2,3,5,0,0,0,1\n");
  const auto poses = read_tum_poses(folder / "t.csv");
  ASSERT_EQ(poses.size(), 2U);
  EXPECT_DOUBLE_EQ(poses[1].T_w_c.t().z(), 5);
}

class EurocTable : public testing::Test {
 protected:
  EurocTable() {
    write_euroc(folder_ / "V");
    for (const char* camera : {"cam0", "cam1"}) {
      for (int i = 0; i < 3; ++i) {
        write_png(folder_ / "V/mav0" / camera / "data" / (std::to_string(i) + ".png"),
                  GrayImage(60, 40, 50));
      }
    }
  }
  std::unique_ptr<Sequence> open(const std::string& csv) {
    for (const char* camera : {"cam0", "cam1"}) {
      write_text(folder_ / "V/mav0" / camera / "data.csv", csv);
    }
    return open_sequence(folder_ / "V");
  }
  void expect_times(const std::string& csv, double first) {
    const auto sequence = open(csv);
    ASSERT_EQ(sequence->frame_count(), 3) << csv;
    EXPECT_NEAR(sequence->frame(0).timestamp, first, 1e-6) << csv;
    EXPECT_NEAR(sequence->frame(2).timestamp, first + 0.1, 1e-6) << csv;
  }
  TemporaryFolder folder_;
};

TEST_F(EurocTable, TimeStampsInOtherUnits) {
  expect_times(
      "#\n1700000000000000000,0.png\n1700000000050000000,1.png\n1700000000100000000,2.png\n",
      1.7e9);
  expect_times("t,f\n1700000000000000,0.png\n1700000000050000,1.png\n1700000000100000,2.png\n",
               1.7e9);
  expect_times("1700000000.00,0.png\n1700000000.05,1.png\n1700000000.10,2.png\n", 1.7e9);
  expect_times("0,0.png\n50000000,1.png\n100000000,2.png\n", 0);
  expect_times("0.00,0.png\n0.05,1.png\n0.10,2.png\n", 0);
  expect_input_error([&] { open("1e15,0.png\n2e15,1.png\n3e15,2.png\n"); },
                     {"data.csv:1", "no unit"});
}

TEST_F(EurocTable, NamesMayHaveTheFolderOfTheImages) {
  expect_times(
      "1700000000000000000,data/0.png\n1700000000050000000,data/1.png\n"
      "1700000000100000000,data/2.png\n",
      1.7e9);
  expect_input_error([&] { open("0,../0.png\n50000000,1.png\n"); }, {"data.csv:1", "folder"});
}

TEST_F(EurocTable, IntrinsicsInTheOrderOfAMatrixAreRefused) {
  for (const char* camera : {"cam0", "cam1"}) {
    write_text(
        folder_ / "V/mav0" / camera / "sensor.yaml",
        sensor_yaml(camera == std::string("cam0") ? "0.0" : "0.1", "50.0, 29.5, 50.5, 19.5"));
  }
  expect_input_error([&] { open_sequence(folder_ / "V"); }, {"fx, cx, fy, cy", "29.5"});
}

TEST(TimeFile, SaysWhatHelps) {
  const TemporaryFolder folder;
  write_kitti_odometry(folder / "07");
  const auto times = [&](const std::string& text) {
    write_text(folder / "07/times.txt", text);
    return open_sequence(folder / "07");
  };
  EXPECT_DOUBLE_EQ(times("index,time\n0,0\n1,0.1\n2,0.2\n3,0.3\n4,0.4\n")->frame(3).timestamp, 0.3);
  EXPECT_DOUBLE_EQ(times("\xEF\xBB\xBF"
                         "0\n0.1\n0.2\n0.3\n0.4\n")
                       ->frame(0)
                       .timestamp,
                   0);
  expect_input_error([&] { times("0\n0.1\n0.1\n0.3\n0.4\n"); }, {"times.txt:3", "--rate"});
  expect_input_error([&] { times("0,000\n0,100\n0,200\n0,300\n0,400\n"); }, {"decimal point"});
}

void write_bytes(const fs::path& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

TEST(PnmImages, GreyAndColourOf8And16Bits) {
  const TemporaryFolder folder;
  const fs::path file = folder / "a.pgm";
  write_bytes(file, std::string("P5\n# of a robot\n2 1\n255\n") + '\x07' + '\xFE');
  GrayImage gray = read_gray(file);
  ASSERT_EQ(gray.width(), 2);
  EXPECT_EQ(gray.data()[0], 7);
  EXPECT_EQ(gray.data()[1], 254);
  // 12 of 16 bits, the upper byte first: 0x0ABC is 0xAB of 8 bits.
  write_bytes(file, std::string("P5 2 1 4095\n") + '\x0A' + '\xBC' + '\x01' + '\x00');
  EXPECT_EQ(used_bits(read_bytes(file), "a"), 12);
  gray = read_gray(file, 12);
  EXPECT_EQ(gray.data()[0], 0xAB);
  EXPECT_EQ(gray.data()[1], 0x10);
  // Grey from colour as for PNG: 0.587 of full green.
  write_bytes(file, std::string("P6 1 1 255\n") + '\x00' + '\xFF' + '\x00');
  EXPECT_EQ(read_gray(file).data()[0], 150);
  EXPECT_EQ(read_rgb(file).data()[0], (RgbPixel{0, 255, 0}));
}

TEST(PnmImages, DamagedOnesAreRefused) {
  const TemporaryFolder folder;
  const fs::path file = folder / "a.pgm";
  const auto refused = [&](const std::string& bytes, const char* why) {
    write_bytes(file, bytes);
    expect_input_error([&] { read_gray(file); }, {"a.pgm", why});
  };
  refused("P5 2 2 255\nabc", "truncated");
  refused("P5 2 1 65535\nabc", "truncated");
  refused("P5 99999999999999 1 255\nabc", "header");
  refused("P5 2 1 0\nabc", "header");
  refused("P5 2 1 70000\nabcd", "header");
  refused("P5 -2 1 255\nabc", "header");
  refused("P5 2 #", "header");
  refused("P5\n", "header");
  refused("P2 1 1 255\n7", "neither");
  write_bytes(file, "P5 1 1 255\na");
  expect_input_error([&] { read_u16(file); }, {"a.pgm", "16-bit grey PNG"});
  expect_input_error([&] { read_indexed(file); }, {"a.pgm", "PNG"});
}

TEST(ImageFolders, OfAnotherFormatAreNamed) {
  const TemporaryFolder folder;
  write_kitti_odometry(folder / "07");
  for (int i = 0; i < 5; ++i) {
    fs::rename(folder / "07/image_1" / numbered("%06d.png", i),
               folder / "07/image_1" / numbered("%06d.bmp", i));
  }
  expect_input_error([&] { open_sequence(folder / "07"); }, {"image_1", ".bmp", "PNG"});
}

TEST(Masks, MayBeSavedWithColourChannels) {
  const TemporaryFolder folder;
  RgbImage rgb(2, 1);
  rgb.data()[0] = {255, 255, 255};
  write_png(folder / "m.png", rgb);
  const auto mask = read_indexed(folder / "m.png");
  EXPECT_EQ(mask.data()[0], 255);
  EXPECT_EQ(mask.data()[1], 0);
  rgb.data()[1] = {255, 0, 0};
  write_png(folder / "m.png", rgb);
  expect_input_error([&] { read_indexed(folder / "m.png"); }, {"m.png", "grey"});
}

}  // namespace
}  // namespace kys_slam
