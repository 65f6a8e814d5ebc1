// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/feature_file.h>
#include <kys_slam/image_pair.h>
#include <kys_slam/image_view.h>
#include <kys_slam/sequence.h>

#include <cmath>

#include "sequence_fixtures.h"

// Input as others record it: other units, sizes, depths of pixels, missing files.
namespace kys_slam {
namespace {

namespace fs = std::filesystem;

std::string calibration(double baseline, double cx = 30, double cy = 20) {
  char text[200];
  std::snprintf(text, sizeof text,
                "P0: 700 0 %g 0 0 700 %g 0 0 0 1 0\nP1: 700 0 %g %g 0 700 %g 0 0 0 1 0\n", cx, cy,
                cx, -700 * baseline, cy);
  return text;
}

std::string rig_yaml(int width, int height, double baseline) {
  char text[400];
  std::snprintf(text, sizeof text,
                "left: {width: %d, height: %d, fx: 50, fy: 50, cx: 30, cy: 20}\n"
                "right: {width: %d, height: %d, fx: 50, fy: 50, cx: 30, cy: 20}\n"
                "T_left_right: [1, 0, 0, %g,  0, 1, 0, 0,  0, 0, 1, 0,  0, 0, 0, 1]\n",
                width, height, width, height, baseline);
  return text;
}

StereoRig write_rig(const TemporaryFolder& folder, const std::string& text) {
  write_text(folder / "rig.yaml", text);
  return read_stereo_rig(std::vector<fs::path>{folder / "rig.yaml"});
}

void write_pair(const TemporaryFolder& folder, const char* format, int count) {
  write_images(folder / "left", format, count, 10);
  write_images(folder / "right", format, count, 100);
}

TEST(UnitOfTheBaseline, EveryLayoutNamesTheBaselineInBothUnits) {
  const TemporaryFolder folder;
  write_kitti_odometry(folder / "07");
  write_text(folder / "07/calib.txt", calibration(500));
  expect_input_error([&] { open_sequence(folder / "07"); },
                     {"calib.txt", "500 m", "500 mm are 0.5 m", "-fx * baseline"});
  write_text(folder / "07/calib.txt", calibration(0.0005));
  expect_input_error([&] { open_sequence(folder / "07"); }, {"calib.txt", "0.0005 m"});
  write_text(folder / "07/calib.txt", calibration(4.9));
  EXPECT_NEAR(open_sequence(folder / "07")->camera().baseline, 4.9, 1e-9);

  write_images(folder / "training/image_02/0001", "%06d.png", 3, 10);
  write_images(folder / "training/image_03/0001", "%06d.png", 3, 100);
  write_text(folder / "training/calib/0001.txt",
             "P2: 700 0 30 0 0 700 20 0 0 0 1 0\nP3: 700 0 30 -378000 0 700 20 0 0 0 1 0\n");
  expect_input_error([&] { open_sequence(folder / "training/image_02/0001"); },
                     {"calib/0001.txt", "540 mm are 0.54 m"});

  write_euroc(folder / "V1");
  write_text(folder / "V1/mav0/cam1/sensor.yaml", sensor_yaml("110.0", "50.0, 50.0, 29.5, 19.5"));
  expect_input_error([&] { open_sequence(folder / "V1"); },
                     {"cam1/sensor.yaml", "110 mm are 0.11 m", "T_BS"});

  write_pair(folder, "%04d.png", 2);
  const StereoRig rig = write_rig(folder, rig_yaml(60, 40, 120));
  ImagePairOptions options;
  options.rate = 10;
  expect_input_error([&] { open_image_pair(folder / "left", folder / "right", rig, options); },
                     {"rig.yaml", "120 mm are 0.12 m", "--calibration-unit"});
}

TEST(UnitOfTheBaseline, OfVirtualKitti) {
  const TemporaryFolder folder;
  const fs::path root = folder / "Scene01/clone";
  std::string intrinsic, extrinsic;
  for (int c = 0; c < 2; ++c) {
    write_images(root / "frames/rgb" / numbered("Camera_%d", c), "rgb_%05d.png", 2, 10);
    for (int i = 0; i < 2; ++i) {
      intrinsic += numbered("%d ", i) + numbered("%d 725 725 29.5 19.5\n", c);
      extrinsic += numbered("%d ", i) + numbered("%d 1 0 0 ", c) + (c == 0 ? "0" : "-532.725") +
                   " 0 1 0 0 0 0 1 0 0 0 0 1\n";
    }
  }
  write_text(root / "intrinsic.txt", intrinsic);
  write_text(root / "extrinsic.txt", extrinsic);
  expect_input_error([&] { open_sequence(root); }, {"extrinsic.txt", "mm are 0.532725 m"});
}

TEST(SizeOfImages, ACalibrationOfOtherImagesNamesBothSizesAndTheFactor) {
  const TemporaryFolder folder;
  write_pair(folder, "%04d.png", 2);
  ImagePairOptions options;
  options.rate = 10;
  StereoRig rig = write_rig(folder, rig_yaml(120, 80, 0.1));
  expect_input_error([&] { open_image_pair(folder / "left", folder / "right", rig, options); },
                     {"rig.yaml", "120x80", "60x40", "by 0.5"});
  write_euroc(folder / "V1");
  for (const char* camera : {"cam0", "cam1"}) {
    const fs::path file = folder / "V1/mav0" / camera / "sensor.yaml";
    std::string text = sensor_yaml(camera[3] == '0' ? "0.0" : "0.1", "100, 100, 59.5, 39.5");
    text.replace(text.find("[60, 40]"), 8, "[120, 80]");
    write_text(file, text);
  }
  expect_input_error([&] { open_sequence(folder / "V1"); },
                     {"sensor.yaml", "120x80", "60x40", "0.5"});
  // OpenCV's file has no size: the principal points tell.
  const auto opencv = [](double cx, double cy, const char* more) {
    char K[200], text[800];
    std::snprintf(K, sizeof K, "{rows: 3, cols: 3, data: [50, 0, %g, 0, 50, %g, 0, 0, 1]}", cx, cy);
    std::snprintf(text, sizeof text,
                  "M1: %s\nD1: [0, 0, 0, 0, 0]\nM2: %s\nD2: [0, 0, 0, 0, 0]\n"
                  "R: [1, 0, 0, 0, 1, 0, 0, 0, 1]\nT: [-0.1, 0, 0]\n%s",
                  K, K, more);
    return std::string(text);
  };
  rig = write_rig(folder, opencv(59.5, 39.5, ""));
  expect_input_error([&] { open_image_pair(folder / "left", folder / "right", rig, options); },
                     {"rig.yaml", "120x80", "60x40", "by 0.5", "image_width"});
  rig = write_rig(folder, opencv(31, 18, ""));
  EXPECT_EQ(open_image_pair(folder / "left", folder / "right", rig, options)->camera().cx, 31);
  rig = write_rig(folder, opencv(59.5, 39.5, "image_width: 60\nimage_height: 40\n"));  // a crop
  EXPECT_EQ(open_image_pair(folder / "left", folder / "right", rig, options)->camera().cx, 59.5);
}

/// Samples of `bits` bits, the upper 8 of which are (x + y) % 256.
Image16 deep_image(int bits) {
  Image16 image(60, 40);
  for (int y = 0; y < 40; ++y) {
    for (int x = 0; x < 60; ++x) {
      const int upper = x == 0 && y == 0 ? 255 : (4 * x + y) % 256;
      image.at(x, y) = static_cast<std::uint16_t>((upper << (bits - 8)) | ((1 << (bits - 8)) - 1));
    }
  }
  return image;
}

TEST(DeepImages, TheUpperEightOfTheBitsInUseCount) {
  for (const int bits : {8, 10, 12, 14, 16}) {
    const TemporaryFolder folder;
    write_kitti_odometry(folder / "07");
    for (int i = 0; i < 5; ++i) {
      // The first pair is of a dark scene.
      const Image16 image = i == 0 ? Image16(60, 40, 3) : deep_image(bits);
      write_png(folder / "07/image_0" / numbered("%06d.png", i), image);
      write_png(folder / "07/image_1" / numbered("%06d.png", i),
                i == 0 ? image : Image16(60, 40, 200));
    }
    const auto sequence = open_sequence(folder / "07");
    for (int i = 1; i < 5; ++i) {
      const StereoFrame frame = sequence->read(i);
      EXPECT_EQ(frame.left.at(0, 0), 255) << bits;
      EXPECT_EQ(frame.left.at(10, 7), 47) << bits;
      EXPECT_EQ(frame.right.at(10, 7), std::min(255, 200 >> (bits - 8))) << bits;
    }
    ASSERT_EQ(sequence->notes().size(), bits == 16 ? 0u : 1u);
    if (bits == 16) continue;
    EXPECT_NE(sequence->notes()[0].find(std::to_string(bits) + " bits"), std::string::npos);
    // A part of the sequence is read in the same way.
    const auto part = open_sequence(folder / "07", {.start = 0, .frames = 1});
    EXPECT_EQ(part->read(0).left.at(5, 5), std::min(255, 3 >> (bits - 8)));
  }
}

TEST(DeepImages, ColourAndViews) {
  const TemporaryFolder folder;
  Rgb16Image colour(8, 4, Rgb16Pixel{4000, 4000, 4000});
  write_png(folder / "c.png", colour);
  EXPECT_EQ(read_gray(folder / "c.png").at(3, 2), 4000 >> 8);
  EXPECT_EQ(read_gray(folder / "c.png", 12).at(3, 2), 4000 >> 4);
  const Image16 deep = deep_image(12);
  ImageView view{deep.data(), 60, 40, PixelFormat::kGray16};
  EXPECT_EQ(used_bits(view), 12);
  EXPECT_EQ(to_gray(view).at(10, 7), 47 >> 4);
  view.bits = 12;
  EXPECT_EQ(to_gray(view).at(10, 7), 47);
  view.bits = 10;
  EXPECT_EQ(to_gray(view).at(0, 0), 255);
}

class TimesOfFrames : public ::testing::Test {
 protected:
  TimesOfFrames() { write_kitti_odometry(folder_ / "07"); }
  std::unique_ptr<Sequence> open(const std::string& rows) {
    write_text(folder_ / "07/times.txt", rows);
    return open_sequence(folder_ / "07");
  }
  const TemporaryFolder folder_;
};

TEST_F(TimesOfFrames, ColumnsAndUnits) {
  struct Row {
    const char* text;
    double last;  // s
  };
  for (const Row& row :
       {Row{"0\n0.1\n0.2\n0.3\n0.4\n", 0.4}, Row{"0\n1\n2\n3\n4\n", 4},
        Row{"0 10.05 0.004\n1 10.10 0.004\n2 10.15 0.003\n3 10.20 0.01\n4 10.25 0.01\n", 10.25},
        Row{"7,1403715273.25,a\n8,1403715273.30,b\n9,1403715273.35,c\n10,1403715273.40,d\n"
            "11,1403715273.45,e\n",
            1403715273.45},
        Row{"0 a.png\n0.05 b.png\n0.10 c.png\n0.15 d.png\n0.20 e.png\n", 0.2},
        Row{"0\n33.3\n66.7\n100\n133.3\n", 0.1333},
        Row{"0\n33300\n66700\n100000\n133300\n", 0.1333},
        Row{"0\n33300000\n66700000\n100000000\n133300000\n", 0.1333},
        Row{"1403715273262142976\n1403715273312142976\n1403715273362142976\n1403715273412142976\n"
            "1403715273462142976\n",
            1403715273.462142976},
        Row{"1403715273262\n1403715273267\n1403715273272\n1403715273277\n1403715273282\n",
            1403715273.282}}) {
    EXPECT_NEAR(open(row.text)->frame(4).timestamp, row.last, 1e-6) << row.text;
  }
}

TEST_F(TimesOfFrames, WhatCannotBeToldIsRefused) {
  // 5 s in us, or 5 ms in ns; ids with names; nothing of a camera.
  expect_input_error([&] { open("0\n5000000\n10000000\n15000000\n20000000\n"); },
                     {"times.txt", "us or ns", "in s"});
  expect_input_error([&] { open("0 a\n1 b\n2 c\n3 d\n4 e\n"); },
                     {"times.txt", "counts the images"});
  expect_input_error([&] { open("0\n1e12\n2e12\n3e12\n4e12\n"); }, {"times.txt", "no unit"});
}

TEST_F(TimesOfFrames, RowsOfTheWholeRecordingGoByNumber) {
  for (const char* camera : {"image_0", "image_1"})
    fs::remove(folder_ / "07" / camera / "000001.png");
  fs::remove(folder_ / "07/image_0/000003.png");
  fs::remove(folder_ / "07/poses.txt");
  const auto sequence = open("0\n0.1\n0.2\n0.3\n0.4\n");
  ASSERT_EQ(sequence->frame_count(), 3);  // 0 2 4
  EXPECT_DOUBLE_EQ(sequence->frame(1).timestamp, 0.2);
  EXPECT_DOUBLE_EQ(sequence->frame(2).timestamp, 0.4);
  EXPECT_EQ(sequence->dropped(), 1);
}

TEST_F(TimesOfFrames, NumbersMayCountFromOne) {
  for (const char* camera : {"image_0", "image_1"}) {
    for (int i = 4; i >= 0; --i) {
      fs::rename(folder_ / "07" / camera / numbered("%06d.png", i),
                 folder_ / "07" / camera / numbered("%06d.png", i + 1));
    }
  }
  fs::remove(folder_ / "07/poses.txt");
  fs::remove(folder_ / "07/image_0/000003.png");
  const char* rows = "0\n0.1\n0.2\n0.3\n0.4\n";
  EXPECT_DOUBLE_EQ(open(rows)->frame(3).timestamp, 0.4);
  fs::remove(folder_ / "07/image_0/000005.png");  // then the rows may begin with number 0 or 1
  expect_input_error([&] { open(rows); }, {"times.txt", "5 time stamps", "3 images"});
}

TEST(RateOfImages, GapsInTheNumbersAreGapsInTime) {
  const TemporaryFolder folder;
  write_pair(folder, "frame_%04d.png", 12);
  const StereoRig rig = write_rig(folder, rig_yaml(60, 40, 0.1));
  for (const char* side : {"left", "right"}) {
    for (const int i : {3, 4, 5, 6}) fs::remove(folder / side / numbered("frame_%04d.png", i));
  }
  ImagePairOptions options;
  options.rate = 20;
  auto sequence = open_image_pair(folder / "left", folder / "right", rig, options);
  ASSERT_EQ(sequence->frame_count(), 8);
  EXPECT_DOUBLE_EQ(sequence->frame(2).timestamp, 0.1);
  EXPECT_DOUBLE_EQ(sequence->frame(3).timestamp, 0.35);
  // Every tenth image of a recording: the rate is that of the images there are.
  fs::remove_all(folder / "left");
  fs::remove_all(folder / "right");
  for (const int i : {0, 10, 20, 40, 50}) {
    for (const char* side : {"left", "right"}) {
      fs::create_directories(folder / side);
      write_png(folder / side / numbered("%d.png", i), GrayImage(60, 40, std::uint8_t(i)));
    }
  }
  sequence = open_image_pair(folder / "left", folder / "right", rig, options);
  EXPECT_DOUBLE_EQ(sequence->frame(2).timestamp, 0.1);
  EXPECT_DOUBLE_EQ(sequence->frame(3).timestamp, 0.2);
}

TEST(NumbersOfImages, FromZeroAndFromOneAreTold) {
  const TemporaryFolder folder;
  write_pair(folder, "%04d.png", 6);
  const StereoRig rig = write_rig(folder, rig_yaml(60, 40, 0.1));
  ImagePairOptions options;
  options.rate = 20;
  const auto open = [&] {
    return open_image_pair(folder / "left", folder / "right", rig, options);
  };
  for (int i = 5; i >= 0; --i) {
    fs::rename(folder / "right" / numbered("%04d.png", i),
               folder / "right" / numbered("%04d.png", i + 1));
  }
  expect_input_error(open, {"right", "from 0", "from 1"});
  // A frame that only one camera lacks shows that the numbers are those of moments.
  fs::remove(folder / "right/0006.png");
  EXPECT_EQ(open()->frame_count(), 5);
}

TEST(MissingImages, ListedButAbsentOnesAreLeftOut) {
  const TemporaryFolder folder;
  write_euroc(folder / "V1");
  const std::string stamp = std::to_string(1403715273262142976 + 150000000LL);
  fs::remove(folder / "V1/mav0/cam0/data" / (stamp + ".png"));
  const auto sequence = open_sequence(folder / "V1");
  ASSERT_EQ(sequence->frame_count(), 3);  // 0 1 5
  EXPECT_EQ(sequence->missing(), 1);
  EXPECT_EQ(sequence->dropped(), 3);
  EXPECT_EQ(sequence->read(2).left.at(30, 20), sequence->read(2).right.at(30, 20));
}

TEST(SensorYaml, ReadsTheLensesAndNamesOfTheOtherCalibrations) {
  const TemporaryFolder folder;
  const auto read = [&](const char* model, const char* key, const char* coefficients) {
    std::string text = sensor_yaml("0.0", "50.0, 50.0, 29.5, 19.5");
    text.replace(text.find("radial-tangential"), 17, model);
    text.erase(text.find("distortion_coefficients"));
    write_text(folder / "sensor.yaml", text + key + ": " + coefficients + "\n");
    return read_sensor_yaml(folder / "sensor.yaml");
  };
  EXPECT_EQ(read("radtan", "distortion_coeffs", "[-0.1, 0.01, 0, 0]").lens,
            LensModel::kRadialTangential);
  EXPECT_EQ(read("equidistant", "distortion_coefficients", "[-0.1, 0.01, 0, 0]").lens,
            LensModel::kEquidistant);
  EXPECT_EQ(read("rational_polynomial", "distortion_coefficients",
                 "[-0.1, 0.01, 0, 0, 0.2, 0.1, 0.1, 0.1, 0, 0, 0, 0, 0, 0]")
                .distortion.size(),
            8u);
  EXPECT_TRUE(read("none", "distortion_coefficients", "[]").distortion.empty());
  expect_input_error([&] { read("fov", "distortion_coefficients", "[0.9]"); },
                     {"sensor.yaml", "'fov'", "radtan or equidistant"});
}

TEST(OpenCvFile, FourCoefficientsNeedTheNameOfTheLens) {
  const TemporaryFolder folder;
  const auto read = [&](const std::string& more) {
    const std::string K = "[50, 0, 29.5, 0, 50, 19.5, 0, 0, 1]";
    return write_rig(folder, "K1: " + K + "\nD1: [0.1, 0.02, 0.001, 0.002]\nK2: " + K +
                                 "\nD2: [0.1, 0.02, 0.001, 0.002]\nR: [1, 0, 0, 0, 1, 0, 0, 0, 1]\n"
                                 "T: [-0.1, 0, 0]\n" +
                                 more);
  };
  expect_input_error([&] { read(""); },
                     {"rig.yaml", "distortion_model: radtan", "distortion_model: fisheye"});
  EXPECT_EQ(read("distortion_model: fisheye\n").right.lens, LensModel::kEquidistant);
  EXPECT_EQ(read("distortion_model: plumb_bob\n").left.lens, LensModel::kRadialTangential);
  EXPECT_EQ(read("fisheye_model: 1\n").left.lens, LensModel::kEquidistant);
  std::string own = rig_yaml(60, 40, 0.1);
  for (std::size_t at = 0; (at = own.find("cy: 20", at)) != std::string::npos; ++at) {
    own.insert(at, "distortion: [0.1, 0.02, 0.001, 0.002], ");
    at += 40;
  }
  expect_input_error([&] { write_rig(folder, own); },
                     {"rig.yaml", "model: radtan", "model: fisheye"});
}

}  // namespace
}  // namespace kys_slam
