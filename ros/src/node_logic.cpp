// SPDX-License-Identifier: BSD-3-Clause
#include "node_logic.h"

#include <kys/error.h>
#include <kys_slam/error.h>

#include <algorithm>
#include <cstdio>
#include <utility>

#include "node_run.h"

namespace kys_slam::ros {

namespace {

constexpr std::size_t kMostImages = 256;

}  // namespace

NodeLogic::NodeLogic(const NodeOptions& options, const Settings& settings, NodeOutput& output,
                     TransformLookup look_up)
    : options_(options),
      settings_(settings),
      label_space_(kys::load_label_space(settings.get("control.label_space"))),
      output_(&output),
      look_up_(std::move(look_up)),
      queue_(options.tolerance, static_cast<std::size_t>(options.queue), options.time_jump) {
  if (options.segments && settings.get("kys.mode") == "stock") {
    throw InputError("parameter segments needs a mode with priors, kys.mode is stock");
  }
  if (options.camera_pose == CameraPose::kTf && !look_up_) {
    throw InputError("parameter camera_pose is tf, and there is no TF");
  }
}

NodeLogic::~NodeLogic() {
  stop();
}

void NodeLogic::add_image(Side side, ImageMessage message) {
  const Stamp stamp = message.stamp;
  const std::lock_guard lock(mutex_);
  if (queue_.add(side, std::move(message)) == PairQueue::Arrival::kTimeJump) {
    std::array<char, 32> text{};
    std::snprintf(text.data(), text.size(), "%d.%09u", stamp.sec, stamp.nanosec);
    jump_ = std::string("time went back to ") + text.data() + " s";
    early_.clear();
  }
  changed_.notify_one();
}

void NodeLogic::add_camera_info(Side side, const CameraInfo& info) {
  std::string refused;
  {
    const std::lock_guard lock(mutex_);
    if (infos_.add(side, info) == CameraInfos::Arrival::kChanged && !log_.info_changed) {
      log_.info_changed = true;
      refused = std::string("camera_info of the ") + to_string(side) +
                " camera has changed, which is refused; call reset where the camera is another";
    }
  }
  if (!refused.empty()) output_->log(NodeOutput::Level::kError, refused);
}

bool NodeLogic::track_next() {
  const std::lock_guard run_lock(run_mutex_);
  std::optional<std::string> jump;
  std::optional<PairQueue::Pair> pair;
  {
    const std::lock_guard lock(mutex_);
    jump = std::exchange(jump_, std::nullopt);
    pair = queue_.take();
    if (jump && (!run_ || run_->fed == 0)) jump.reset();
  }
  if (jump) begin(nullptr, *jump + ": the run starts again");
  if (!pair) return false;
  try {
    track(*pair);
  } catch (const InputError& error) {
    complain(error.what());
  } catch (const kys::Error& error) {
    complain(error.what());
  }
  return true;
}

void NodeLogic::run() {
  while (true) {
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [this] { return stopped_ || !queue_.empty(); });
      if (stopped_) return;
    }
    try {
      track_next();
    } catch (const std::exception& error) {  // of no input: memory, a mistake of ours
      complain(std::string("tracking has ended: ") + error.what());
      return;
    }
  }
}

void NodeLogic::stop() {
  const std::lock_guard lock(mutex_);
  stopped_ = true;
  changed_.notify_all();
}

void NodeLogic::complain(const std::string& error) {
  bool is_new = false;
  {
    const std::lock_guard lock(mutex_);
    log_.error = error;
    is_new = std::exchange(last_complaint_, error) != error;
  }
  if (is_new) output_->log(NodeOutput::Level::kError, error);
}

/// The next run; what belongs to the one before is forgotten.
/// \param run null: the next pair starts it
void NodeLogic::begin(std::shared_ptr<Run> run, const std::string& why) {
  warning_.clear();
  {
    const std::lock_guard lock(mutex_);
    run_.swap(run);
    log_.restart();
    last_complaint_.clear();
    path_.clear();
    fed_images_.clear();
  }
  if (!why.empty()) output_->log(NodeOutput::Level::kWarn, why);
}

/// T_base_camera of the left camera of the messages.
Rigid3 NodeLogic::base_from_camera_of(const ImageKind& images) const {
  if (options_.camera_pose == CameraPose::kParameters) return options_.T_base_camera();
  const bool is_given = !options_.camera_frame.empty();
  const std::string& camera = is_given ? options_.camera_frame : images.frame_id;
  if (camera.empty()) {
    throw InputError(
        "the left images have no frame_id; camera_pose tf needs it, or the parameter camera_frame");
  }
  return look_up_(options_.base_frame, camera);
}

std::shared_ptr<NodeLogic::Run> NodeLogic::make_run(const ImageKind& images) const {
  CameraInfos infos;
  {
    const std::lock_guard lock(mutex_);
    infos = infos_;
  }
  const bool is_rectified = options_.images == Images::kRectified;
  return std::make_shared<Run>(images, calibrate(infos, is_rectified, images.width, images.height),
                               base_from_camera_of(images), options_.schedule, settings_);
}

void NodeLogic::start(const PairQueue::Pair& pair) {
  const ImageView left = view_of(pair.left), right = view_of(pair.right);
  const int bits = std::max(used_bits(left), used_bits(right));
  auto run = make_run({left.width, left.height, bits, pair.left.frame_id});
  if (!options_.load_map.empty()) {
    run->system.load_map(options_.load_map, options_.localize_only);
  }
  begin(std::move(run), note_of_bits(bits));
}

void NodeLogic::track(const PairQueue::Pair& pair) {
  std::shared_ptr<Run> run;
  {
    const std::lock_guard lock(mutex_);
    log_.missing_info = infos_.missing();
    if (!infos_.complete()) return;
    run = run_;
  }
  if (!run) {
    start(pair);
    const std::lock_guard lock(mutex_);
    run = run_;
  }
  feed(*run, pair);
}

void NodeLogic::feed(Run& run, const PairQueue::Pair& pair) {
  StereoFrame frame;
  frame.index = run.fed;
  frame.timestamp = pair.left.stamp.seconds();
  frame.left = run.prepared(Side::kLeft, view_of(pair.left));
  frame.right = run.prepared(Side::kRight, view_of(pair.right));
  take_masks(run);
  expect(run, pair.left.stamp);
  const FrameReport report = run.system.feed(frame, run.masks);
  ++run.fed;
  std::optional<PoseOutput> pose;
  if (const auto poses = run.frames.add(report)) pose = {pair.left.stamp, *poses};
  note(report, pose);
  if (pose) output_->publish(*pose);
}

/// The frame that is fed next has this stamp: its label image may have come.
void NodeLogic::expect(Run& run, const Stamp& stamp) {
  std::optional<ImageMessage> labels;
  {
    const std::lock_guard lock(mutex_);
    if (!fed_images_.empty() && fed_images_.back().frame == run.fed)
      fed_images_.pop_back();  // it failed
    fed_images_.push_back({stamp, run.fed});
    if (fed_images_.size() > kMostImages) fed_images_.pop_front();
    if (const auto early = early_.find(stamp.nanoseconds()); early != early_.end()) {
      labels = std::move(early->second);
    }
    early_.erase(early_.begin(), early_.upper_bound(stamp.nanoseconds()));
  }
  if (labels) give_segments(run, run.fed, *labels);
}

void NodeLogic::note(const FrameReport& report, const std::optional<PoseOutput>& pose) {
  {
    const std::lock_guard lock(mutex_);
    log_.add(report);
    if (pose) path_.push_back(*pose);
    while (path_.size() > static_cast<std::size_t>(options_.path_length)) path_.pop_front();
  }
  std::string warning = report.warning;
  if (report.status == FrameStatus::kLost) warning = "lost: " + report.reason;
  if (warning != warning_ && !warning.empty()) output_->log(NodeOutput::Level::kWarn, warning);
  warning_ = std::move(warning);
}

}  // namespace kys_slam::ros
