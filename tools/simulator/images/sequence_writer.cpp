// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/images/sequence_writer.h"

#include <fmt/printf.h>
#include <kys_slam/check_options.h>
#include <kys_slam/error.h>
#include <kys_slam/image_file.h>
#include <kys_slam/util/atomic_file.h>
#include <kys_slam/util/paths.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cinttypes>
#include <exception>
#include <mutex>
#include <thread>

#include "simulator/common/coco_classes.h"
#include "simulator/images/layouts.h"
#include "simulator/images/object_truth.h"
#include "simulator/images/renderer.h"
#include "simulator/images/segments.h"
#include "simulator/images/surface_points.h"

namespace kys_slam::simulator {

void describe(kys::OptionList& list, WriteOptions& o) {
  list.add("--jobs", o.jobs, {0, 1024}, "threads");
  list.add("--drop-camera", o.drop_camera, {-1, 1});
  list.add("--drop-share", o.drop_share, {0, 0.9});
  list.add("--surface-points", o.surface_points, {0, 2e7});
}
namespace {

namespace fs = std::filesystem;

// What a frame adds to the files that cover the sequence.
struct FrameRecord {
  std::string table;
  std::string images[2];
  std::string annotations[2];
  std::string objects;
  CoveredShare covered;
};

const char* kSides[2] = {"left", "right"};

void describe_segments(const Panoptic& panoptic, const std::string& stem, int frame, int camera,
                       FrameRecord& record) {
  const RgbImage& ids = panoptic.ids;
  record.images[camera] = fmt::sprintf(R"({"id":%d,"file_name":"%s.png","width":%d,"height":%d})",
                                       frame, stem.c_str(), ids.width(), ids.height());
  std::string& text = record.annotations[camera];
  text =
      fmt::sprintf(R"({"image_id":%d,"file_name":"%s.png","segments_info":[)", frame, stem.c_str());
  bool first = true;
  for (const Segment& s : panoptic.segments) {
    text += fmt::sprintf(
        R"(%s{"id":%u,"category_id":%d,"iscrowd":0,"bbox":[%d,%d,%d,%d],"area":%)" PRId64 "}",
        first ? "" : ",", s.id, s.category, s.x0, s.y0, s.x1 - s.x0 + 1, s.y1 - s.y0 + 1, s.area);
    first = false;
    record.table += fmt::sprintf("%d,%s,%u,%d,%s,%d,%d,%d,%" PRId64 "\n", frame, kSides[camera],
                                 s.id, s.object, coco_name(s.category), s.category,
                                 coco_is_thing(s.category) ? 1 : 0, s.moving ? 1 : 0, s.area);
  }
  text += "]}";
}

std::string panoptic_json(const std::vector<FrameRecord>& records, int camera) {
  std::string text = "{\"images\":[\n";
  for (std::size_t i = 0; i < records.size(); ++i) {
    text += (i == 0 ? "" : ",\n") + records[i].images[camera];
  }
  text += "\n],\"annotations\":[\n";
  for (std::size_t i = 0; i < records.size(); ++i) {
    text += (i == 0 ? "" : ",\n") + records[i].annotations[camera];
  }
  text += "\n],\"categories\":[\n";
  bool first = true;
  for (const int id : coco_categories()) {
    text += fmt::sprintf(R"(%s{"id":%d,"name":"%s","isthing":%d})", first ? "" : ",\n", id,
                         coco_name(id), coco_is_thing(id) ? 1 : 0);
    first = false;
  }
  return text + "\n]}\n";
}

class Writer {
 public:
  Writer(const World& world, const WriteOptions& options, const fs::path& folder)
      : world_(world),
        options_(options),
        folder_(folder),
        truth_(options.truth && options.drop_camera < 0),
        assets_(world),
        objects_(world),
        records_(world.times.size()) {}

  SequenceFigures run() {
    make_folders();
    const int jobs = std::clamp(
        options_.jobs > 0 ? options_.jobs : static_cast<int>(std::thread::hardware_concurrency()),
        1, static_cast<int>(world_.times.size()));
    started_ = std::chrono::steady_clock::now();
    {
      std::vector<std::jthread> threads;
      threads.reserve(static_cast<std::size_t>(jobs));
      try {
        for (int i = 0; i < jobs; ++i) threads.emplace_back([this] { work(); });
      } catch (const std::system_error&) {  // no more threads: with those there are
        if (threads.empty()) throw;
      }
    }
    if (error_) std::rethrow_exception(error_);
    const SequenceFigures figures = covered();
    write_covering_files(figures);
    return figures;
  }

 private:
  void make_folders() {
    for (const fs::path& name : image_folders(world_)) make_output_folder(folder_ / name);
    if (!truth_) return;
    for (const char* name : {"disparity", "disparity_right", "flow_left", "flow_right",
                             "panoptic_left", "panoptic_right"}) {
      make_output_folder(folder_ / name);
    }
  }

  void work() {
    try {
      FrameRenderer renderer(assets_);
      const int count = static_cast<int>(world_.times.size());
      for (int frame = next_++; frame < count && !failed_; frame = next_++) {
        if (options_.stop != nullptr && *options_.stop) throw InputError("interrupted");
        render(renderer, frame);
        report(count);
      }
    } catch (...) {
      const std::scoped_lock lock(mutex_);
      if (!error_) error_ = std::current_exception();
      failed_ = true;
    }
  }

  void render(FrameRenderer& renderer, int frame) {
    const std::vector<bool> moving = moving_objects(world_, frame);
    FrameRecord& record = records_[static_cast<std::size_t>(frame)];
    Panoptic panoptic[2];
    for (int camera = 0; camera < 2; ++camera) {
      if (is_dropped(world_, frame, camera, options_.drop_camera, options_.drop_share)) continue;
      write_png(folder_ / image_path(world_, frame, camera), renderer.image(frame, camera));
      if (!truth_) continue;
      const ViewTruth truth = renderer.truth(frame, camera);
      panoptic[camera] = make_panoptic(world_, truth, frame, camera, moving);
      write_truth(truth, panoptic[camera], frame, camera, record);
    }
    if (!truth_) return;
    record.objects = objects_.csv(frame, moving, panoptic[0], panoptic[1]);
    record.covered = covered_share(world_, panoptic[0]);
  }

  void write_truth(const ViewTruth& truth, const Panoptic& panoptic, int frame, int camera,
                   FrameRecord& record) {
    const fs::path name = image_path(world_, frame, 0).filename();
    write_png(folder_ / (camera == 0 ? "disparity" : "disparity_right") / name,
              encode_disparity(truth, world_.rectified.bf()));
    if (!truth.flow.empty()) {
      write_png(folder_ / (camera == 0 ? "flow_left" : "flow_right") / name, encode_flow(truth));
    }
    write_png(folder_ / (camera == 0 ? "panoptic_left" : "panoptic_right") / name, panoptic.ids);
    describe_segments(panoptic, name.stem().string(), frame, camera, record);
  }

  [[nodiscard]] SequenceFigures covered() const {
    if (!truth_) return {};
    SequenceFigures mean{0, 0};
    for (const FrameRecord& r : records_) {
      mean.moving += r.covered.moving / static_cast<double>(records_.size());
      mean.standing += r.covered.standing / static_cast<double>(records_.size());
    }
    return mean;
  }

  void write_covering_files(const SequenceFigures& figures) {
    write_layout_files(world_, folder_, options_.drop_camera, options_.drop_share);
    if (options_.surface_points > 0) {
      write_file_atomic(folder_ / "surface.ply",
                        surface_ply(world_, options_.surface_points, world_.seed));
    }
    if (world_.rig_error) write_file_atomic(folder_ / "rig_error.yaml", to_yaml(*world_.rig_error));
    if (truth_) {
      std::string table = "frame,camera,segment_id,object,class,category_id,isthing,moving,area\n";
      for (const FrameRecord& r : records_) table += r.table;
      write_file_atomic(folder_ / "ground_truth.csv", table);
      std::string objects = ObjectTruth::csv_header();
      for (const FrameRecord& r : records_) objects += r.objects;
      write_file_atomic(folder_ / "objects.csv", objects);
      for (int camera = 0; camera < 2; ++camera) {
        write_file_atomic(folder_ / fmt::sprintf("panoptic_%s.json", kSides[camera]),
                          panoptic_json(records_, camera));
      }
    }
    std::string readme = readme_text(world_, options_.command, truth_);
    if (truth_) {
      readme += fmt::sprintf(
          "\nMoving objects cover %.1f %% of the left images on average, static objects that can "
          "move %.1f %%.\n",
          100 * figures.moving, 100 * figures.standing);
    }
    write_file_atomic(folder_ / "README", readme);
  }

  void report(int count) {
    const std::scoped_lock lock(mutex_);
    ++done_;
    if (options_.quiet) return;
    const double seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - started_).count();
    if (seconds < last_report_ + 2 && done_ < count) return;
    last_report_ = seconds;
    const bool terminal = isatty(2) != 0;
    std::fprintf(stderr, "%ssimulate_sequence: %s: frame %d of %d, %.2f s per frame, %.0f s left%s",
                 terminal ? "\r" : "", world_.name.c_str(), done_, count, seconds / done_,
                 seconds / done_ * (count - done_), terminal && done_ < count ? "   " : "\n");
  }

  const World& world_;
  const WriteOptions& options_;
  fs::path folder_;
  bool truth_;
  RenderAssets assets_;
  ObjectTruth objects_;
  std::vector<FrameRecord> records_;
  std::atomic<int> next_{0};
  std::atomic<bool> failed_{false};
  std::mutex mutex_;
  std::exception_ptr error_;
  int done_ = 0;
  double last_report_ = 0;
  std::chrono::steady_clock::time_point started_;
};

// A folder we may fill: absent, or empty.
void check_free(const fs::path& output) {
  std::error_code error;
  if (!path_exists(output)) return;
  if (!fs::is_directory(output, error)) {
    throw InputError(output.string() + ": exists and is not a folder");
  }
  const bool empty = fs::is_empty(output, error);
  if (error) throw InputError(output.string() + ": " + error.message());
  if (!empty) throw InputError(output.string() + ": exists and is not empty");
}

/// An empty folder that is there is replaced at the end: better to know before that it can be. A
/// mount point cannot, nor can "." by that name.
void check_replaceable(const fs::path& output) {
  std::error_code error;
  if (!fs::remove(output, error) && !error) return;
  if (!error) fs::create_directory(output, error);
  if (error) throw InputError("cannot write " + output.string() + ": " + error.message());
}

constexpr const char* kMarker = ".simulate_sequence";

}  // namespace

SequenceFigures write_sequence(const World& world, const WriteOptions& options) {
  check_options(options);
  if (world.times.empty()) throw InputError("a sequence needs at least one frame");
  fs::path output = options.output.lexically_normal();
  if (output.filename().empty()) output = output.parent_path();
  output = behind_links(output);
  check_free(output);
  check_replaceable(output);
  fs::path partial = output;
  partial += ".partial";
  std::error_code error;
  if (fs::exists(partial, error)) {  // left by a run that was killed
    if (!fs::exists(partial / kMarker, error)) {
      throw InputError(partial.string() + ": is in the way");
    }
    fs::remove_all(partial, error);
  }
  make_output_folder(partial);
  SequenceFigures figures;
  try {
    write_file_atomic(partial / kMarker, std::string_view("incomplete\n"));
    figures = Writer(world, options, partial).run();
  } catch (...) {
    fs::remove_all(partial, error);
    throw;
  }
  fs::remove(partial / kMarker, error);
  fs::remove(output, error);  // an empty folder, if anything
  fs::rename(partial, output, error);
  if (error) {
    throw InputError("cannot write " + output.string() + ": " + error.message() +
                     "; the whole sequence is in " + partial.string());
  }
  return figures;
}

}  // namespace kys_slam::simulator
