// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/label_space.h>
#include <kys_slam/masks.h>

#include <array>
#include <condition_variable>
#include <deque>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "calibration.h"
#include "diagnostics.h"
#include "frames.h"
#include "messages.h"
#include "node_options.h"
#include "pair_queue.h"

namespace kys_slam::ros {

/// One pose to publish.
struct PoseOutput {
  Stamp stamp;  ///< of the left image
  FramePoses poses;
};

/// What the node publishes; called by the thread that tracks and by those that add messages.
class NodeOutput {
 public:
  enum class Level : std::uint8_t { kInfo, kWarn, kError };
  NodeOutput() = default;
  NodeOutput(const NodeOutput&) = delete;
  NodeOutput& operator=(const NodeOutput&) = delete;
  virtual ~NodeOutput() = default;
  virtual void publish(const PoseOutput& pose) = 0;
  virtual void log(Level level, const std::string& text) = 0;
};

/// T_a_b of two frames of TF, as it is now.
/// \throws InputError naming them, with the reason, while it is not known
using TransformLookup = std::function<Rigid3(const std::string& a, const std::string& b)>;

/// All that the node does: pairs, calibration, frames, services, diagnostics. Images come from any
/// thread; one thread calls track_next() or run().
class NodeLogic {
 public:
  struct Answer {
    bool success = false;
    std::string message;
  };

  /// \param output must outlive this object \param look_up for camera_pose tf: called at the start
  ///        of each run, by the thread that tracks or calls a service
  /// \throws InputError for options that cannot be
  NodeLogic(const NodeOptions& options, const Settings& settings, NodeOutput& output,
            TransformLookup look_up = {});
  NodeLogic(const NodeLogic&) = delete;
  NodeLogic& operator=(const NodeLogic&) = delete;
  ~NodeLogic();

  void add_image(Side side, ImageMessage message);
  void add_camera_info(Side side, const CameraInfo& info);
  /// The label image of the left image of the same stamp; it may come before that one is tracked.
  void add_segments(const ImageMessage& message);
  /// Pixels that are not used from the next frame on: all but 0, in the image as it comes.
  void set_mask(Side side, const ImageMessage& message);

  /// Tracks the oldest pair. False: there is none.
  bool track_next();
  /// Tracks pairs until stop(); what is not the fault of an input ends it with a message.
  void run();
  void stop();

  Answer save_map(const std::string& file);
  /// Starts again in a saved map. When it cannot be loaded, the run goes on.
  Answer load_map(const std::string& file, bool localize_only);
  Answer reset();
  /// The state since the last call.
  Diagnostics diagnostics();
  /// The last poses, map to base_link, as they were when tracked.
  [[nodiscard]] std::vector<PoseOutput> path() const;
  /// Ends the run, and writes the folder of the parameter `output`. Call stop() first.
  /// \throws InputError when it cannot be written
  void finish();

 private:
  struct Run;  // one system with its camera, from a start to a reset
  struct ImageKind {
    int width = 0, height = 0;  // px, of the messages
    int bits = 0;               // of 16-bit images, 0: not known
    std::string frame_id;       // of the left images
  };
  struct FedImage {
    Stamp stamp;
    std::int64_t frame = 0;
  };

  void begin(std::shared_ptr<Run> run, const std::string& why);
  [[nodiscard]] std::shared_ptr<Run> make_run(const ImageKind& images) const;
  [[nodiscard]] Rigid3 base_from_camera_of(const ImageKind& images) const;
  void load(Run& run, const std::string& file, bool localize_only) const;
  void start(const PairQueue::Pair& pair);
  void track(const PairQueue::Pair& pair);
  void feed(Run& run, const PairQueue::Pair& pair);
  void take_masks(Run& run);
  void expect(Run& run, const Stamp& stamp);
  void give_segments(Run& run, std::int64_t frame, const ImageMessage& message);
  void note(const FrameReport& report, const std::optional<PoseOutput>& pose);
  void complain(const std::string& error);

  NodeOptions options_;
  Settings settings_;
  kys::LabelSpace label_space_;
  NodeOutput* output_;
  TransformLookup look_up_;

  std::mutex run_mutex_;  // held while a frame is tracked, and by services
  std::string warning_;   // of the last frame

  mutable std::mutex mutex_;  // of all below; never held while a frame is tracked
  std::shared_ptr<Run> run_;  // null: before the first pair with a calibration
  std::condition_variable changed_;
  bool stopped_ = false;
  PairQueue queue_;
  CameraInfos infos_;
  std::optional<std::string> jump_;  // why the run has to start again
  std::array<GrayImage, 2> masks_;   // as they come
  bool masks_changed_ = false;
  DiagnosticsLog log_;
  std::string last_complaint_;  // logged once while it repeats
  std::deque<PoseOutput> path_;
  std::deque<FedImage> fed_images_;             // the last frames of run_
  std::map<std::int64_t, ImageMessage> early_;  // label images by stamp, ns
};

}  // namespace kys_slam::ros
