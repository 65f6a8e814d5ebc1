// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/calibration_hash.h>
#include <kys_slam/error.h>
#include <kys_slam/prior_file.h>
#include <kys_slam/prior_folder.h>
#include <kys_slam/prior_format.h>
#include <kys_slam/prior_writer.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <random>

namespace kys_slam {
namespace {

namespace pf = prior_format;
namespace fs = std::filesystem;

/// A street-like frame: bands of stuff, a few boxes, every second box moving with noisy motion.
FramePriors make_street(int width, int height, unsigned seed) {
  std::mt19937 random(seed);
  FramePriors priors;
  priors.label_space = "coco_panoptic_133";
  priors.calibration_hash = 0x1234567890ABCDEFull;
  priors.content_key = 42;
  priors.has_motion = true;
  for (std::int32_t c = 0; c < 2; ++c) {
    CameraPriors camera;
    camera.segment_map = ImageOf<std::uint16_t>(width, height);
    camera.motion = ImageOf<float>(width, height);
    for (std::uint16_t k = 0; k < 12; ++k) {
      PriorSegment s;
      s.label = static_cast<std::uint16_t>(k * 11);
      s.flags = k < 4 ? 0 : (k % 2 ? pf::kThing : std::uint16_t{pf::kThing | pf::kDynamic});
      if (k == 5) s.flags |= pf::kNotJudged;
      s.instance = c * pf::kRightInstances + k;
      s.scale = 1000.0F * static_cast<float>(k);
      s.score = s.flags & pf::kDynamic ? 60.0F : 0.0F;
      camera.segments.push_back(s);
    }
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const double wave = height * (0.25 + 0.03 * std::sin(x * 0.15) + 0.02 * std::sin(x * 0.7));
        camera.segment_map.at(x, y) = static_cast<std::uint16_t>(
            y < wave ? 0 : std::min(3, static_cast<int>((y - wave) * 4 / height)) + 1);
        camera.motion.at(x, y) = std::clamp(
            30.0F + 0.02F * static_cast<float>(x) + static_cast<float>(random() % 1000) * 1e-3F,
            0.0F, 100.0F);
      }
    }
    for (std::uint16_t k = 4; k < 12; ++k) {
      const int w = width / 12, h = height / 6;
      const int x0 = static_cast<int>(random() % static_cast<unsigned>(width - w));
      const int y0 = height / 2;
      for (int y = y0; y < y0 + h; ++y) {
        for (int x = x0; x < x0 + w; ++x) {
          camera.segment_map.at(x, y) = static_cast<std::uint16_t>(k + 1);
        }
      }
    }
    priors.cameras.push_back(std::move(camera));
  }
  return priors;
}

std::vector<std::uint8_t> with_checksum(std::vector<std::uint8_t> bytes) {
  const std::uint32_t crc = pf::crc32(bytes.data() + pf::kAtChecked, bytes.size() - pf::kAtChecked);
  for (std::size_t i = 0; i < 4; ++i) {
    bytes[pf::kAtChecksum + i] = static_cast<std::uint8_t>(crc >> (8 * i));
  }
  return bytes;
}

std::string error_of(std::vector<std::uint8_t> bytes, const ExpectedPriors& expected = {}) {
  try {
    PriorFile::parse(std::move(bytes), "x.kysp", expected);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

TEST(PriorFormat, ChecksumIsThatOfZlib) {
  const std::string text = "123456789";
  EXPECT_EQ(pf::crc32(reinterpret_cast<const std::uint8_t*>(text.data()), text.size()),
            0xCBF43926u);
}

TEST(PriorFormat, OneObjectHasOneInstanceInBothViewsOnlyWhereTheFileSaysSo) {
  FramePriors in = make_street(317, 101, 1);
  const std::vector<Keypoint> keypoints = {{.x = 150, .y = 100}};
  std::vector<kys::Prior> left(1), right(1);
  for (const bool shared : {false, true}) {
    in.shares_instances = shared;
    const PriorFile file = PriorFile::parse(encode_priors(in, "x"), "x");
    EXPECT_EQ(file.shares_instances(), shared);
    EXPECT_EQ(decode_priors(file).shares_instances, shared);
    file.lookup(CameraSide::kLeft, keypoints, left);
    file.lookup(CameraSide::kRight, keypoints, right);
    ASSERT_EQ(left[0].instance, 3) << "the lowest of the stuff";
    EXPECT_EQ(right[0].instance, shared ? 3 : pf::kRightInstances + 3);
  }
}

TEST(PriorFormat, RoundTripKeepsSegmentsAndBoundsMotion) {
  const FramePriors in = make_street(317, 101, 1);
  const PriorFile file = PriorFile::parse(encode_priors(in, "x"), "x");
  const FramePriors out = decode_priors(file);
  EXPECT_EQ(out.label_space, in.label_space);
  EXPECT_EQ(out.calibration_hash, in.calibration_hash);
  EXPECT_EQ(out.content_key, 42u);
  ASSERT_EQ(out.cameras.size(), 2u);
  for (std::size_t c = 0; c < 2; ++c) {
    EXPECT_EQ(out.cameras[c].segment_map, in.cameras[c].segment_map);
    for (std::size_t k = 0; k < in.cameras[c].segments.size(); ++k) {
      PriorSegment expected = in.cameras[c].segments[k];
      const auto& map = in.cameras[c].segment_map;
      expected.area = static_cast<std::uint32_t>(
          std::count(map.data(), map.data() + map.size(), static_cast<std::uint16_t>(k + 1)));
      EXPECT_EQ(out.cameras[c].segments[k], expected);
    }
    for (std::size_t i = 0; i < in.cameras[c].motion.size(); ++i) {
      const std::uint16_t segment = in.cameras[c].segment_map.data()[i];
      const float mu = out.cameras[c].motion.data()[i];
      if (segment == 0 || !(in.cameras[c].segments[segment - 1u].flags & pf::kDynamic)) {
        EXPECT_EQ(mu, 0.0F);
      } else {
        const float truth = in.cameras[c].motion.data()[i];
        EXPECT_LE(std::abs(std::log1p(mu) - std::log1p(truth)), 2.5 * 0.0181 + 1e-4);
      }
    }
  }
  // Encoding what was decoded gives the same file.
  EXPECT_EQ(encode_priors(out, "x", {.tolerance_steps = 0}),
            encode_priors(decode_priors(PriorFile::parse(
                              encode_priors(out, "x", {.tolerance_steps = 0}), "x")),
                          "x", {.tolerance_steps = 0}));
}

TEST(PriorFormat, NamesOfLabelSpacesThatNoReaderTakesAreNotWritten) {
  FramePriors priors = make_street(64, 32, 1);
  for (const std::string& bad :
       {std::string(), std::string("a b"), std::string("a\x1b"), std::string(33, 'a')}) {
    priors.label_space = bad;
    EXPECT_THROW(encode_priors(priors, "test"), InputError) << bad;
  }
}

TEST(PriorFormat, CodingNeverMovesAValueAcrossAGate) {
  const MotionCoding coding;
  for (const float gate : {8.0F, 20.0F}) {
    for (const float mu : {gate, std::nextafter(gate, 100.0F), gate - 0.01F, gate + 0.01F}) {
      const float decoded = pf::motion_of_code()[motion_code(mu, coding)];
      EXPECT_EQ(decoded > gate, mu > gate) << mu << " -> " << decoded;
    }
  }
  EXPECT_EQ(motion_code(0.0F, coding), 0);
  EXPECT_EQ(motion_code(100.0F, coding), 255);
  EXPECT_EQ(pf::motion_of_code()[255], 100.0F);
}

TEST(PriorFile, LookupAgreesWithTheImage) {
  const FramePriors in = make_street(317, 101, 2);
  const PriorFile file = PriorFile::parse(encode_priors(in, "x"), "x");
  const FramePriors image = decode_priors(file);
  std::mt19937 random(5);
  for (std::size_t c = 0; c < 2; ++c) {
    std::vector<Keypoint> keypoints(3000);
    for (Keypoint& k : keypoints) {
      k.x = static_cast<float>(random() % 33000) * 0.01F - 5.0F;
      k.y = static_cast<float>(random() % 11000) * 0.01F - 5.0F;
    }
    keypoints[7].x = std::numeric_limits<float>::quiet_NaN();
    keypoints[8].y = std::numeric_limits<float>::infinity();
    keypoints[9].x = -1e30F;
    std::vector<kys::Prior> priors(keypoints.size());
    file.lookup(static_cast<CameraSide>(c), keypoints, priors);
    std::size_t moving = 0;
    for (std::size_t i = 0; i < keypoints.size(); ++i) {
      const float x = std::floor(keypoints[i].x + 0.5F), y = std::floor(keypoints[i].y + 0.5F);
      const bool inside = x >= 0 && y >= 0 && x < 317 && y < 101;
      const std::uint16_t segment =
          inside ? image.cameras[c].segment_map.at(static_cast<int>(x), static_cast<int>(y))
                 : std::uint16_t{0};
      if (segment == 0) {
        EXPECT_EQ(priors[i], kys::Prior{});
        continue;
      }
      const PriorSegment& s = image.cameras[c].segments[segment - 1u];
      EXPECT_EQ(priors[i].label, s.label);
      EXPECT_EQ(priors[i].instance, s.instance);
      EXPECT_EQ(priors[i].scale, s.scale);
      EXPECT_EQ(priors[i].dynamic, (s.flags & pf::kDynamic) ? 1 : 0);
      EXPECT_EQ(priors[i].unjudged, (s.flags & pf::kNotJudged) ? 1 : 0);
      const float mu = image.cameras[c].motion.at(static_cast<int>(x), static_cast<int>(y));
      EXPECT_EQ(priors[i].motion, mu);
      EXPECT_NEAR(priors[i].log_motion, std::log1p(mu), 1e-6);
      moving += mu > 0;
    }
    EXPECT_GT(moving, 50u);
  }
}

TEST(PriorFormat, RunsThatAreGivenMustBeThoseOfTheMap) {
  FramePriors in = make_street(64, 32, 3);
  const auto bytes = encode_priors(in, "x");
  in.cameras[0].runs = find_runs(in.cameras[0].segment_map);
  EXPECT_EQ(encode_priors(in, "x"), bytes);
  const SegmentRuns right = in.cameras[0].runs;
  const auto refused = [&] {
    try {
      (void)encode_priors(in, "x");
    } catch (const InputError& error) {
      return std::string(error.what()) == "x: the runs are not those of a map";
    }
    return false;
  };
  in.cameras[0].runs.runs.back().x1 -= 1;  // short of the width
  EXPECT_TRUE(refused());
  in.cameras[0].runs = right;
  in.cameras[0].runs.runs[0].x0 = 1;  // a gap
  EXPECT_TRUE(refused());
  in.cameras[0].runs = right;
  in.cameras[0].runs.runs.back().x1 = 1000;  // behind the width
  EXPECT_TRUE(refused());
  in.cameras[0].runs = right;
  in.cameras[0].runs.row_begin.pop_back();  // a row less
  EXPECT_TRUE(refused());
}

TEST(PriorFile, OneCameraFilesAnswerTheOtherCameraWithNothing) {
  FramePriors in = make_street(64, 32, 3);
  in.cameras.pop_back();
  const PriorFile file = PriorFile::parse(encode_priors(in, "x"), "x");
  std::vector<Keypoint> keypoints(1);
  keypoints[0].y = 31;
  std::vector<kys::Prior> priors(1);
  file.lookup(CameraSide::kRight, keypoints, priors);
  EXPECT_EQ(priors[0], kys::Prior{});
  file.lookup(CameraSide::kLeft, keypoints, priors);
  EXPECT_NE(priors[0].label, kys::kVoidLabel);
}

TEST(PriorFile, MismatchesAreNamed) {
  const auto bytes = encode_priors(make_street(64, 32, 3), "x");
  EXPECT_EQ(error_of(bytes, {.width = 64, .height = 32}), "");
  EXPECT_NE(error_of(bytes, {.width = 65, .height = 32}).find("x.kysp: is for images of 64x32"),
            std::string::npos);
  EXPECT_NE(error_of(bytes, {.calibration_hash = 1}).find("another calibration"),
            std::string::npos);
  EXPECT_NE(error_of(bytes, {.label_space = "ade20k_150"}).find("coco_panoptic_133"),
            std::string::npos);
  EXPECT_NE(error_of(bytes, {.label_count = 20}).find("not in the label space"), std::string::npos);
}

TEST(PriorFile, EveryTruncationAndEveryFlippedByteIsRefused) {
  const auto bytes = encode_priors(make_street(48, 24, 4), "x");
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    EXPECT_NE(error_of({bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(size)}), "");
  }
  for (std::size_t at = 0; at < bytes.size(); ++at) {
    auto bad = bytes;
    bad[at] ^= 0x41;
    EXPECT_NE(error_of(std::move(bad)), "") << at;
  }
}

TEST(PriorFile, HostileContentWithAValidChecksumNeverReadsOutside) {
  const auto bytes = encode_priors(make_street(48, 24, 4), "x");
  std::mt19937 random(9);
  std::vector<Keypoint> keypoints(200);
  for (Keypoint& k : keypoints) {
    k.x = static_cast<float>(random() % 48);
    k.y = static_cast<float>(random() % 24);
  }
  std::vector<kys::Prior> priors(keypoints.size());
  for (int trial = 0; trial < 20000; ++trial) {
    auto bad = bytes;
    for (int n = 0; n < 1 + trial % 3; ++n) {
      bad[pf::kAtChecked + random() % (bad.size() - pf::kAtChecked)] =
          static_cast<std::uint8_t>(random());
    }
    try {
      const PriorFile file = PriorFile::parse(with_checksum(std::move(bad)), "x");
      file.lookup(CameraSide::kLeft, keypoints, priors);
      file.lookup(CameraSide::kRight, keypoints, priors);
    } catch (const InputError&) {
    }
  }
}

TEST(PriorFolder, ALabelSpaceGivenByPathIsExpectedByItsName) {
  const fs::path path = fs::path(KYS_SOURCE_DIR) / "kys" / "data" / "cityscapes_19";
  const ExpectedPriors expected = expected_priors(StereoCamera{}, path.string());
  EXPECT_EQ(expected.label_space, "cityscapes_19") << "that is what prior files hold";
  EXPECT_EQ(expected.label_count, 19u);
}

/// A folder with the prior file of frame 000003.
fs::path folder_of_one(const FramePriors& maps) {
  const fs::path folder =
      fs::temp_directory_path() / ("kys_prior_source_test_" + std::to_string(::getpid()));
  fs::create_directories(folder);
  const auto bytes = encode_priors(maps, "x");
  std::ofstream(folder / "000003.kysp", std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()),
             static_cast<std::streamsize>(bytes.size()));
  return folder;
}

TEST(PriorFolder, ShowsTheSegmentsOfTheFrameLookedUpLast) {
  const fs::path folder = folder_of_one(make_street(48, 24, 4));
  PriorFolder source(folder, {});
  std::vector<kys::Prior> left, right;
  StereoFrame frame;
  frame.name = "000003";
  ASSERT_TRUE(source.look_up(frame, {}, {}, left, right));
  const std::vector<PriorSegment> expected =
      PriorFile::open(folder / "000003.kysp").segments(CameraSide::kLeft);
  ASSERT_GT(expected.size(), 1u);
  ASSERT_EQ(source.segments().size(), expected.size());
  for (std::size_t k = 0; k < expected.size(); ++k) {
    EXPECT_EQ(source.segments()[k].label, expected[k].label);
    EXPECT_EQ(source.segments()[k].instance, expected[k].instance);
  }
  frame.name = "000004";
  EXPECT_FALSE(source.look_up(frame, {}, {}, left, right));
  EXPECT_TRUE(source.segments().empty());
  fs::remove_all(folder);
}

TEST(PriorFolder, MissingFilesAreCountedAndWarnedOnce) {
  const fs::path folder = folder_of_one(make_street(48, 24, 4));
  EXPECT_THROW(PriorFolder(folder / "none", {}), InputError);
  int warnings = 0;
  PriorFolder source(folder, {}, false, [&](const std::string&) { ++warnings; });
  source.prefetch("000003");
  source.prefetch("000004");
  EXPECT_TRUE(source.load("000003").has_value());
  EXPECT_FALSE(source.load("000004").has_value());
  EXPECT_FALSE(source.load("000005").has_value());
  EXPECT_EQ(source.loaded(), 1u);
  EXPECT_EQ(source.missing(), 2u);
  EXPECT_EQ(warnings, 1);
  PriorFolder strict(folder, {}, true);
  EXPECT_THROW(strict.load("000004"), InputError);
  fs::remove_all(folder);
}

TEST(CalibrationHash, ChangesWithEveryParameterButNotWithRoundingNoise) {
  StereoCamera camera;
  camera.width = 1241;
  camera.height = 376;
  camera.fx = camera.fy = 718.856;
  camera.cx = 607.1928;
  camera.cy = 185.2157;
  camera.baseline = 0.537;
  const std::uint64_t hash = calibration_hash(camera);
  StereoCamera other = camera;
  other.fx += 1e-9;
  EXPECT_EQ(calibration_hash(other), hash);
  other.fx += 0.01;
  EXPECT_NE(calibration_hash(other), hash);
  other = camera;
  other.baseline += 1e-5;
  EXPECT_NE(calibration_hash(other), hash);
}

}  // namespace
}  // namespace kys_slam
