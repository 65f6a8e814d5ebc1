// SPDX-License-Identifier: BSD-3-Clause
#include "priors/builder/build_sequence.h"

#include <gtest/gtest.h>
#include <kys_slam/error.h>
#include <kys_slam/image_file.h>
#include <kys_slam/prior_format.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <sstream>

#include "synthetic_scene.h"

namespace kys_slam {
namespace {

namespace fs = std::filesystem;
using synthetic::Box;

void put_float(std::ofstream& out, float value) {
  out.write(reinterpret_cast<const char*>(&value), 4);
}

/// Perception of five frames on disk: COCO panoptic, .flo, .pfm. A crossing car and a parked one.
class BuildSequenceTest : public testing::Test {
 protected:
  void SetUp() override {
    root_ = fs::temp_directory_path() / ("kys_build_sequence_test_" + std::to_string(::getpid()));
    fs::remove_all(root_);
    for (const char* folder : {"pan", "flow", "disp"}) fs::create_directories(root_ / folder);
    sequence_.camera = synthetic::kitti_camera(310, 94);
    std::string annotations;
    for (int t = 0; t < 5; ++t) {
      const std::string name = "00000" + std::to_string(t);
      sequence_.names.push_back(name);
      write_frame(name, t);
      annotations += (t > 0 ? "," : "") + std::string(R"({"file_name":")") + name +
                     R"(.png","segments_info":[{"id":1,"category_id":149},)" +
                     R"({"id":2,"category_id":197},{"id":300,"category_id":3},)" +
                     R"({"id":70000,"category_id":3}]})";
    }
    std::ofstream(root_ / "pan.json") << R"({"annotations":[)" << annotations << "]}";
    sequence_.read = [](std::size_t) { return std::pair<GrayImage, GrayImage>(); };
    inputs_.panoptic = {root_ / "pan", root_ / "pan"};
    inputs_.disparity = (root_ / "disp").string();
    inputs_.flow = {(root_ / "flow").string(), ""};
  }
  void TearDown() override { fs::remove_all(root_); }

  void write_frame(const std::string& name, int t) {
    const StereoCamera& k = sequence_.camera;
    const CameraPerception p =
        synthetic::street(k, synthetic::motion(0, 0.003, 0, 0, 0, -0.8),
                          {Box{60 + 8 * t, 50, 100 + 8 * t, 75, 12, {0.8, 0, 0}},
                           Box{200, 48, 240, 72, 15, {0, 0, 0}}});
    const std::uint32_t ids[] = {0, 1, 2, 300, 70000};
    RgbImage rgb(k.width, k.height);
    for (std::size_t i = 0; i < rgb.size(); ++i) {
      const std::uint32_t id = ids[p.panoptic.map.data()[i]];
      rgb.data()[i] = {static_cast<std::uint8_t>(id), static_cast<std::uint8_t>(id >> 8),
                       static_cast<std::uint8_t>(id >> 16)};
    }
    write_png(root_ / "pan" / (name + ".png"), rgb);
    std::ofstream flo(root_ / "flow" / (name + ".flo"), std::ios::binary);
    put_float(flo, 202021.25F);
    const std::int32_t size[] = {k.width, k.height};
    flo.write(reinterpret_cast<const char*>(size), 8);
    std::ofstream pfm(root_ / "disp" / (name + ".pfm"), std::ios::binary);
    pfm << "Pf\n" << k.width << " " << k.height << "\n-1.0\n";
    for (int y = 0; y < k.height; ++y) {
      for (int x = 0; x < k.width; ++x) {
        put_float(flo, p.flow->u.at(x, y));
        put_float(flo, p.flow->v.at(x, y));
        put_float(pfm, p.disparity.at(x, k.height - 1 - y));
      }
    }
  }

  /// Backward flow that fits the forward one, which then gets an error of 5 px in every other
  /// pixel.
  void spoil_forward_flow() {
    fs::create_directories(root_ / "back");
    for (const std::string& name : sequence_.names) {
      std::string forward = bytes("flow/" + name + ".flo");
      std::string back = forward;
      for (std::size_t i = 0; i + 12 < forward.size(); i += 4) {
        float value = 0;
        std::memcpy(&value, forward.data() + 12 + i, 4);
        const float opposite = -value;
        std::memcpy(back.data() + 12 + i, &opposite, 4);
        value += i / 8 % 2 == 0 ? 3.54F : 0.0F;
        std::memcpy(forward.data() + 12 + i, &value, 4);
      }
      std::ofstream(root_ / "back" / (name + ".flo"), std::ios::binary) << back;
      std::ofstream(root_ / "flow" / (name + ".flo"), std::ios::binary) << forward;
    }
    inputs_.flow_back = {(root_ / "back").string(), ""};
  }

  /// m_bg of the first frame, px.
  [[nodiscard]] double background(const std::string& output) const {
    std::istringstream file(bytes(output + "/background.csv"));
    std::string row;
    std::getline(file, row);
    std::getline(file, row);
    std::istringstream cells(row);
    for (int i = 0; i < 6; ++i) std::getline(cells, row, ',');
    return std::stod(row);
  }

  BuildSummary build(const std::string& output, int jobs, bool flow_check = true) {
    BuildSettings settings;
    settings.options.flow_check.enabled = flow_check;
    settings.output = root_ / output;
    settings.jobs = jobs;
    return build_sequence_priors(sequence_, labels_, inputs_, settings);
  }

  BuildSummary build_robust(const std::string& output, int jobs, int lag) {
    BuildSettings settings;
    settings.options.detection.method = DetectionMethod::kRobust;
    settings.options.detection.lag = lag;
    settings.output = root_ / output;
    settings.jobs = jobs;
    return build_sequence_priors(sequence_, labels_, inputs_, settings);
  }

  /// Grey ones, which method robust looks at.
  void have_images() {
    sequence_.read = [this](std::size_t) {
      const StereoCamera& k = sequence_.camera;
      return std::pair(GrayImage(k.width, k.height), GrayImage(k.width, k.height));
    };
  }

  [[nodiscard]] std::string bytes(const fs::path& path) const {
    std::ifstream stream(root_ / path, std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), {}};
  }

  fs::path root_;
  BuildSequence sequence_;
  BuildInputs inputs_;
  kys::LabelSpace labels_ = kys::load_label_space("coco_panoptic_133");
};

TEST_F(BuildSequenceTest, FindsTheMoverKeepsIdentitiesAndResumes) {
  const BuildSummary summary = build("a", 1);
  EXPECT_EQ(summary.built, 5u);
  EXPECT_EQ(summary.tracks[0], 2);
  EXPECT_EQ(summary.frames_without_motion, 1u);  // the last one
  std::int32_t mover = -1;
  for (const std::string& name : sequence_.names) {
    const PriorFile file = PriorFile::open(root_ / "a" / (name + ".kysp"));
    ASSERT_EQ(file.camera_count(), 2u);
    const auto& segments = file.segments(CameraSide::kLeft);
    ASSERT_EQ(segments.size(), 4u);
    // In order of label: car (two), then road and building.
    EXPECT_EQ(segments[0].label, labels_.index_of("car"));
    const bool last = name == sequence_.names.back();
    EXPECT_EQ((segments[0].flags & prior_format::kDynamic) != 0, !last) << name;
    EXPECT_EQ(segments[1].flags & prior_format::kDynamic, 0) << name;
    if (mover >= 0) {
      EXPECT_EQ(segments[0].instance, mover);
    }
    mover = segments[0].instance;
    EXPECT_GE(file.segments(CameraSide::kRight)[0].instance, prior_format::kRightInstances);
  }
  const BuildSummary resumed = build("a", 1);
  EXPECT_EQ(resumed.kept, 5u);
  EXPECT_EQ(resumed.frames_without_motion, 1u);
  write_frame("000002", 2);  // newer input: that frame again
  fs::last_write_time(root_ / "flow" / "000002.flo",
                      fs::file_time_type::clock::now() + std::chrono::seconds(5));
  const BuildSummary again = build("a", 1);
  EXPECT_GE(again.built, 1u);
  EXPECT_LE(again.built, 2u);
}

TEST_F(BuildSequenceTest, ErrorsOfTheFlowReachTheMotionModuleWhenTheCheckIsOff) {
  build("clean", 1);
  spoil_forward_flow();
  build("checked", 1);
  build("unchecked", 1, false);
  EXPECT_LT(background("checked"), background("clean") + 0.5) << "what does not fit is left out";
  EXPECT_GT(background("unchecked"), background("clean") + 1.5);
}

TEST_F(BuildSequenceTest, UniMatchLeavesAllFieldsOfAFrameInOneFolder) {
  spoil_forward_flow();
  build("apart", 1);
  build("unchecked", 1, false);
  ASSERT_GT(background("unchecked"), background("apart") + 1) << "the backward flow matters";
  const fs::path folder = root_ / "unimatch";
  fs::create_directories(folder);
  for (const std::string& name : sequence_.names) {
    fs::copy(root_ / "flow" / (name + ".flo"), folder / (name + "_pred.flo"));
    fs::copy(root_ / "back" / (name + ".flo"), folder / (name + "_pred_bwd.flo"));
    fs::copy(root_ / "disp" / (name + ".pfm"), folder / (name + "_disp.pfm"));
  }
  inputs_.disparity = folder.string();
  inputs_.flow[0] = inputs_.flow_back[0] = folder.string();
  build("together", 1);
  EXPECT_EQ(bytes("apart/background.csv"), bytes("together/background.csv"));
  EXPECT_EQ(bytes("apart/segments.csv"), bytes("together/segments.csv"));

  const std::string name = sequence_.names[1];
  EXPECT_THROW(find_right_disparity(folder, name), InputError) << "the left one is none";
  std::ofstream(folder / (name + "_disp_right.pfm")) << "right";
  EXPECT_EQ(find_right_disparity(folder, name), folder / (name + "_disp_right.pfm"));
  EXPECT_EQ(find_disparity(folder, name), folder / (name + "_disp.pfm"));
  fs::remove(folder / (name + "_pred.flo"));
  EXPECT_THROW(find_flow(folder, name), InputError) << "disparity and backward flow are none";
}

TEST_F(BuildSequenceTest, OneFileIsNotTwoFields) {
  const auto complaint = [&] {
    try {
      build("out", 1);
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  inputs_.flow_back[0] = (root_ / "flow" / ".").string();
  EXPECT_NE(complaint().find("000000.flo: is given as forward and as backward flow"),
            std::string::npos)
      << complaint();
  inputs_.flow_back[0].clear();
  inputs_.disparity_right = inputs_.disparity;
  EXPECT_NE(complaint().find("000000.pfm: is given as left and as right disparity"),
            std::string::npos)
      << complaint();
}

TEST_F(BuildSequenceTest, BytesDoNotDependOnTheNumberOfThreads) {
  build("one", 1);
  build("three", 3);
  for (const std::string& name : sequence_.names) {
    EXPECT_EQ(bytes("one/" + name + ".kysp"), bytes("three/" + name + ".kysp"));
  }
  EXPECT_EQ(bytes("one/segments.csv"), bytes("three/segments.csv"));
  EXPECT_EQ(bytes("one/background.csv"), bytes("three/background.csv"));
}

TEST_F(BuildSequenceTest, DecisionsThatLookAheadAreTheSameWhenResumed) {
  have_images();
  for (const int lag : {0, 2, 50}) {
    const std::string one = "one" + std::to_string(lag), two = "two" + std::to_string(lag);
    build_robust(one, 1, lag);
    build_robust(two, 2, lag);
    EXPECT_EQ(bytes(one + "/segments.csv"), bytes(two + "/segments.csv"));
    fs::remove(root_ / two / (sequence_.names[1] + ".kysp"));
    fs::remove(root_ / two / (sequence_.names[3] + ".kysp"));
    EXPECT_EQ(build_robust(two, 1, lag).built, 2u);
    EXPECT_EQ(bytes(one + "/segments.csv"), bytes(two + "/segments.csv"));
    for (const std::string& name : sequence_.names) {
      EXPECT_EQ(bytes(one + "/" + name + ".kysp"), bytes(two + "/" + name + ".kysp")) << name;
    }
  }
  EXPECT_NE(bytes("one0/segments.csv"), bytes("one2/segments.csv"));
}

TEST_F(BuildSequenceTest, OtherClassesOfTheSegmentsAreBuiltAgain) {
  build("a", 1);
  std::string annotations = bytes("pan.json");
  const std::size_t last = annotations.rfind("\"category_id\":3}");
  annotations.replace(last, 16, "\"category_id\":8}");
  std::ofstream(root_ / "pan.json") << annotations;
  EXPECT_EQ(build("a", 1).built, 1u);  // one segment of the last frame
  const PriorFile file = PriorFile::open(root_ / "a" / "000004.kysp");
  EXPECT_EQ(file.segments(CameraSide::kLeft)[1].label, labels_.index_of("truck"));
  std::vector<kys::LabelClass> classes = labels_.classes();
  for (kys::LabelClass& c : classes) c.name = c.name == "car" ? "motor" : c.name;
  labels_ = kys::LabelSpace(labels_.name(), classes, std::vector<float>(133 * 133), "other");
  EXPECT_EQ(build("a", 1).built, 5u) << "another label space of the same name";
}

TEST_F(BuildSequenceTest, OtherImagesAreBuiltAgainWhereTheyAreUsed) {
  have_images();
  for (const std::string& name : sequence_.names) {
    sequence_.files.push_back({root_ / (name + "l.png"), root_ / (name + "r.png")});
    for (const fs::path& image : sequence_.files.back()) std::ofstream(image) << "image";
  }
  build("folders", 1);
  build_robust("robust", 1, 0);
  EXPECT_EQ(build_robust("robust", 1, 0).kept, 5u);
  std::ofstream(sequence_.files[3][1]) << "another one";
  EXPECT_EQ(build("folders", 1).kept, 5u) << "nothing is made from images there";
  EXPECT_EQ(build_robust("robust", 1, 0).built, 3u) << "it, the one before, and what comes after";
  inputs_.disparity = "sgbm";
  build("sgbm", 1);
  std::ofstream(sequence_.files[3][0]) << "a third one";
  EXPECT_EQ(build("sgbm", 1).built, 2u);
}

TEST_F(BuildSequenceTest, OtherTimeStampsAreBuiltAgainWhereTheyAreUsed) {
  have_images();
  sequence_.timestamps = {0, 0.1, 0.2, 0.3, 0.4};
  build("folders", 1);
  build_robust("robust", 1, 0);
  sequence_.timestamps[4] = 0.4000001;
  EXPECT_EQ(build("folders", 1).kept, 5u);
  EXPECT_EQ(build_robust("robust", 1, 0).built, 2u) << "it and the one before";
}

TEST_F(BuildSequenceTest, RowsThatAreNotThoseOfTheFileAreBuiltAgain) {
  have_images();
  build_robust("whole", 1, 2);
  const fs::path rows = root_ / "whole" / ".rows" / "000001.csv";
  const std::string sound = bytes(rows), priors = bytes("whole/000003.kysp");
  std::string changed = sound;
  const std::size_t digit = sound.rfind(",static,") - 1;
  changed[digit] = changed[digit] == '1' ? '2' : '1';
  for (const std::string& bad : {changed, bytes("whole/.rows/000000.csv"), std::string(),
                                 sound.substr(0, sound.size() / 2)}) {
    std::ofstream(rows) << bad;
    EXPECT_EQ(build_robust("whole", 1, 2).built, 1u);
    EXPECT_EQ(bytes(rows), sound);
    EXPECT_EQ(bytes("whole/000003.kysp"), priors);
  }
  EXPECT_EQ(build_robust("whole", 1, 2).kept, 5u);
}

TEST_F(BuildSequenceTest, NamesWithCommasAreResumed) {
  have_images();
  for (std::string& name : sequence_.names) {
    for (const auto& [folder, ending] :
         {std::pair{"pan", ".png"}, {"flow", ".flo"}, {"disp", ".pfm"}}) {
      fs::rename(root_ / folder / (name + ending), root_ / folder / ("a,7," + name + ending));
    }
    name = "a,7," + name;
  }
  std::string annotations = bytes("pan.json");
  for (std::size_t at = 0; (at = annotations.find("00000", at)) != std::string::npos; at += 9) {
    annotations.insert(at, "a,7,");
  }
  std::ofstream(root_ / "pan.json") << annotations;
  build_robust("one", 1, 2);
  build_robust("two", 1, 2);
  fs::remove(root_ / "two" / (sequence_.names[3] + ".kysp"));
  EXPECT_EQ(build_robust("two", 1, 2).built, 1u);
  EXPECT_EQ(bytes("one/segments.csv"), bytes("two/segments.csv"));
  EXPECT_NE(bytes("one/segments.csv").find("\n\"a,7,000000\",left,"), std::string::npos);
}

/// Networks call a thing a car in one view and a truck in the other: it has depth in both.
TEST_F(BuildSequenceTest, AnEstimatedPairHasDepthWhereTheViewsDisagreeAboutClasses) {
  constexpr int kDisparity = 8;
  const int width = sequence_.camera.width, height = sequence_.camera.height;
  sequence_.read = [=](std::size_t) {
    GrayImage left(width, height), right(width, height);
    std::uint32_t seed = 5;
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        seed = seed * 1664525u + 1013904223u;
        left.at(x, y) = static_cast<std::uint8_t>(seed >> 24);
        if (x >= kDisparity) right.at(x - kDisparity, y) = left.at(x, y);
      }
    }
    return std::pair(std::move(left), std::move(right));
  };
  fs::create_directories(root_ / "right");
  fs::copy(root_ / "pan", root_ / "right", fs::copy_options::recursive);
  std::string annotations = bytes("pan.json");
  for (std::size_t at = 0;
       (at = annotations.find("\"category_id\":3}", at)) != std::string::npos;) {
    annotations.replace(at, 16, "\"category_id\":8}");
  }
  std::ofstream(root_ / "right.json") << annotations;
  inputs_.panoptic[1] = root_ / "right";
  inputs_.disparity = "sgbm";
  inputs_.flow = {"", ""};
  build("sgbm", 1);
  std::istringstream table(bytes("sgbm/segments.csv"));
  std::string row;
  std::getline(table, row);
  const double expected = sequence_.camera.bf() / kDisparity;
  int right_rows = 0;
  while (std::getline(table, row)) {
    std::istringstream cells(row);
    std::vector<std::string> cell;
    for (std::string value; std::getline(cells, value, ',');) cell.push_back(value);
    if (cell[1] != "right") continue;
    ++right_rows;
    EXPECT_NEAR(std::stod(cell[7]), expected, 0.05 * expected) << row;
  }
  EXPECT_EQ(right_rows, 10);
}

TEST_F(BuildSequenceTest, BadInputsAreNamed) {
  const auto message = [&] {
    try {
      build("bad", 2);
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  fs::resize_file(root_ / "flow" / "000001.flo", 1000);
  EXPECT_NE(message().find("000001.flo: is truncated"), std::string::npos) << message();
  fs::resize_file(root_ / "disp" / "000000.pfm", 500);
  EXPECT_NE(message().find("000000.pfm: is truncated"), std::string::npos) << message();
  std::ofstream(root_ / "pan.json") << R"({"annotations":[{"file_name":"000000.png",)"
                                    << R"("segments_info":[{"id":1,"category_id":149}]}]})";
  EXPECT_NE(message().find("000000.png: segment"), std::string::npos) << message();
  std::ofstream(root_ / "pan.json") << "{";
  EXPECT_NE(message().find("pan.json: is not a COCO panoptic file"), std::string::npos);
}

TEST_F(BuildSequenceTest, TheListOfSegmentsIsFoundBesideTheFolderAndMissed) {
  for (const char* way : {"pan", "pan/", "pan/.", "flow/../pan"}) {
    EXPECT_NO_THROW((void)PanopticReader(root_ / way, labels_).read("000000", 310, 94)) << way;
  }
  fs::remove(root_ / "pan.json");
  try {
    const PanopticReader reader(root_ / "pan", labels_);
    ADD_FAILURE() << "taken for two channels";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("pan.json: missing; the colours"), std::string::npos)
        << error.what();
  }
}

TEST_F(BuildSequenceTest, NumbersThatAreNoIdsAreRefused) {
  for (const auto& [id, category] : {std::pair{"1.5", "3"},
                                     {"4294967297", "3"},
                                     {"-1", "3"},
                                     {"1e60", "3"},
                                     {"1", "1e60"},
                                     {"1", "18446744073709551615"}}) {
    std::ofstream(root_ / "pan.json")
        << R"({"annotations":[{"file_name":"000000.png","segments_info":[{"id":)" << id
        << R"(,"category_id":)" << category << "}]}]}";
    try {
      const PanopticReader reader(root_ / "pan", labels_, PanopticEncoding::kCoco);
      FAIL() << id << " " << category;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find("pan.json: "), std::string::npos) << error.what();
      EXPECT_NE(std::string(error.what()).find("no whole number"), std::string::npos)
          << error.what();
    }
  }
}

TEST_F(BuildSequenceTest, ACategoryWithTwoNamesIsRefused) {
  const auto open = [&](const std::string& second) {
    std::ofstream(root_ / "pan.json")
        << R"({"annotations":[],"categories":[{"id":3,"name":"car"},{"id":3,"name":")" << second
        << R"("}]})";
    const PanopticReader reader(root_ / "pan", labels_, PanopticEncoding::kCoco);
  };
  EXPECT_NO_THROW(open("car"));
  EXPECT_THROW(open("person"), InputError);
}

TEST_F(BuildSequenceTest, DeeplyNestedJsonIsRefused) {
  std::ofstream(root_ / "pan.json")
      << R"({"annotations":[{"file_name":"000000.png","segments_info":[{"id":1,"category_id":)"
      << std::string(200000, '[') << std::string(200000, ']') << "}]}]}";
  try {
    const PanopticReader reader(root_ / "pan", labels_, PanopticEncoding::kCoco);
    FAIL() << "accepted";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("pan.json: is nested deeper"), std::string::npos)
        << error.what();
  }
}

TEST_F(BuildSequenceTest, MoreSegmentsThanCanBeToldApartAreRefused) {
  // 70 000 cars of a pixel each: numbers of segments have 16 bits.
  RgbImage rgb(280, 250);
  std::string segments;
  for (std::uint32_t i = 0; i < rgb.size(); ++i) {
    const std::uint32_t id = i + 1;
    rgb.data()[i] = {static_cast<std::uint8_t>(id), static_cast<std::uint8_t>(id >> 8),
                     static_cast<std::uint8_t>(id >> 16)};
    segments +=
        (i > 0 ? "," : "") + std::string(R"({"id":)") + std::to_string(id) + R"(,"category_id":3})";
  }
  write_png(root_ / "pan" / "many.png", rgb);
  std::ofstream(root_ / "pan.json") << R"({"annotations":[{"file_name":"many.png",)"
                                    << R"("segments_info":[)" << segments << "]}]}";
  const PanopticReader reader(root_ / "pan", labels_, PanopticEncoding::kCoco);
  try {
    (void)reader.read("many", rgb.width(), rgb.height());
    FAIL() << "70000 segments were accepted";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("many.png: has more than 65535 segments"),
              std::string::npos)
        << error.what();
  }
}

TEST_F(BuildSequenceTest, ZeroIsAClassWhereTheLabelSpaceHasOneAndVoidElsewhere) {
  GrayImage classes(3, 1);
  classes.at(0, 0) = 0;
  classes.at(1, 0) = 1;
  classes.at(2, 0) = 255;
  write_png(root_ / "pan" / "classes.png", classes);
  const auto space = [](std::int32_t first) {
    return kys::LabelSpace("two", {{first, "road", "road"}, {1 + first, "car", "car", true}},
                           {0, 100, 100, 0});
  };
  const kys::LabelSpace from_zero = space(0), from_one = space(1);
  const PanopticMap with =
      PanopticReader(root_ / "pan", from_zero, PanopticEncoding::kClassMap).read("classes", 3, 1);
  ASSERT_EQ(with.segments.size(), 2u);
  EXPECT_EQ(with.map.at(0, 0), 1) << "road";
  EXPECT_EQ(with.map.at(2, 0), 0) << "void";
  const PanopticMap without =
      PanopticReader(root_ / "pan", from_one, PanopticEncoding::kClassMap).read("classes", 3, 1);
  ASSERT_EQ(without.segments.size(), 1u);
  EXPECT_EQ(without.map.at(0, 0), 0) << "void";
  EXPECT_EQ(without.map.at(1, 0), 1);
}

}  // namespace
}  // namespace kys_slam
