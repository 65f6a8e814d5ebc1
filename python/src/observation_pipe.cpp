// SPDX-License-Identifier: BSD-3-Clause
#include "observation_pipe.h"

#include <kys_slam/error.h>
#include <kys_slam/image_file.h>
#include <kys_slam/report.h>
#include <sys/resource.h>
#include <unistd.h>
#ifdef __linux__
#include <sys/syscall.h>
#endif

#include <cerrno>
#include <cstring>
#include <exception>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>

namespace kys_slam {

namespace {

/// Writes values one after the other into memory that is large enough.
class Cursor {
 public:
  explicit Cursor(std::uint8_t* at) : at_(at) {}
  template <typename T>
  void put(const T& value) {
    std::memcpy(at_, &value, sizeof value);
    at_ += sizeof value;
  }

 private:
  std::uint8_t* at_;
};

/// null: there is none.
nlohmann::json to_json(const std::optional<RelativePose>& relative) {
  if (!relative) return nullptr;
  const Eigen::Matrix<double, 3, 4> M = relative->T_other_c.matrix();
  nlohmann::json pose = nlohmann::json::array();
  for (int i = 0; i < 12; ++i) pose.push_back(M(i / 4, i % 4));
  nlohmann::json covariance = nlohmann::json::array();
  for (int i = 0; i < 36; ++i) covariance.push_back(relative->covariance(i / 6, i % 6));
  return {
      {"other", relative->other}, {"pose", std::move(pose)}, {"covariance", std::move(covariance)}};
}

nlohmann::json to_json(const FrameReport& r) {
  const Eigen::Matrix<double, 3, 4> M = r.T_w_c.matrix();
  nlohmann::json pose = nlohmann::json::array();
  for (int i = 0; i < 12; ++i) pose.push_back(M(i / 4, i % 4));
  const StageTimes& t = r.times;
  return {{"index", r.index},
          {"name", r.name},
          {"timestamp", r.timestamp},
          {"status", to_string(r.status)},
          {"lost", r.status == FrameStatus::kLost},
          {"pose", std::move(pose)},
          {"local", to_json(r.local)},
          {"motion", to_json(r.motion)},
          {"keyframe", r.keyframe},
          {"counts",
           {{"keypoints", r.keypoints},
            {"stereo_matches", r.stereo_matches},
            {"matches", r.matches},
            {"inliers", r.inliers},
            {"masked", r.masked}}},
          {"ms",
           {{"total", t.total},
            {"extract", t.extract},
            {"priors", t.priors},
            {"stereo", t.stereo},
            {"track", t.track},
            {"predict", t.predict},
            {"local_map", t.local_map}}}};
}

nlohmann::json to_json(std::span<const ObservedInstance> instances) {
  nlohmann::json list = nlohmann::json::array();
  for (const ObservedInstance& i : instances) {
    list.push_back({i.instance, i.label, i.p_moving, i.keypoints});
  }
  return list;
}

/// Of the calling thread, where threads have one of their own.
void lower_priority() {
#ifdef __linux__
  constexpr int kNice = 10;  // as the process that draws (record_process.py)
  ::setpriority(PRIO_PROCESS, static_cast<id_t>(::syscall(SYS_gettid)), kNice);
#endif
}

}  // namespace

void ObservationPipe::copy(const FrameObservation& seen, std::span<const std::uint8_t> segments,
                           Item& item) {
  item.report = *seen.report;
  item.instances.assign(seen.instances.begin(), seen.instances.end());
  item.keypoints = seen.keypoints.size();
  item.priors = seen.priors.size();
  item.segments.assign(segments.begin(), segments.end());
  const std::size_t per_keypoint = 3 * sizeof(float) + 1;
  const std::size_t per_prior = sizeof(std::int32_t) + sizeof(float) + sizeof(std::uint16_t);
  item.arrays.resize(per_keypoint * item.keypoints + per_prior * item.priors);
  Cursor out(item.arrays.data());
  for (const Keypoint& k : seen.keypoints) {
    out.put(k.x);
    out.put(k.y);
  }
  for (const float z : seen.depths) out.put(z);
  for (const kys::Prior& p : seen.priors) out.put(static_cast<std::int32_t>(p.instance));
  for (const kys::Prior& p : seen.priors) out.put(static_cast<float>(p.motion));
  for (const kys::Prior& p : seen.priors) out.put(static_cast<std::uint16_t>(p.label));
  for (const kys::Tier t : seen.tiers) out.put(static_cast<std::uint8_t>(t));
}

/// What stands before the arrays.
std::string ObservationPipe::head_of(const Item& item, std::size_t jpeg_size) {
  nlohmann::json header = to_json(item.report);
  header["instances"] = to_json(item.instances);
  header["n"] = item.keypoints;
  header["priors"] = item.priors;
  header["jpeg"] = jpeg_size;
  header["segments"] = item.segments.size();
  std::string text = header.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  text.resize((text.size() + 3) / 4 * 4, ' ');  // so that the arrays are aligned
  const auto size = static_cast<std::uint32_t>(text.size());
  const std::uint64_t length =
      sizeof size + text.size() + item.arrays.size() + jpeg_size + item.segments.size();
  std::string head(1 + sizeof length + sizeof size, 'F');
  std::memcpy(head.data() + 1, &length, sizeof length);
  std::memcpy(head.data() + 1 + sizeof length, &size, sizeof size);
  return head + text;
}

ObservationPipe::ObservationPipe(int descriptor, bool wait, int jpeg_quality)
    : descriptor_(::dup(descriptor)), wait_(wait), jpeg_quality_(jpeg_quality) {
  if (descriptor_ < 0) throw InputError("no file descriptor is left for a recording");
  spare_.reserve(kCapacity + 2);  // all there are: the thread allocates nothing for them
  thread_ = std::thread([this] { run(); });
}

ObservationPipe::~ObservationPipe() {
  stop();
  ::close(descriptor_);
}

void ObservationPipe::stop() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
  queue_.clear();
}

void ObservationPipe::put(const FrameObservation& seen, std::shared_ptr<const GrayImage> left,
                          std::span<const std::uint8_t> segments) {
  Item item;
  {
    std::unique_lock lock(mutex_);
    if (wait_) changed_.wait(lock, [&] { return broken_ || queue_.size() < kCapacity; });
    if (broken_) return;
    if (queue_.size() >= kCapacity) {
      ++skipped_;
      return;
    }
    if (!spare_.empty()) {
      item = std::move(spare_.back());
      spare_.pop_back();
    }
  }
  copy(seen, segments, item);
  item.left = std::move(left);
  {
    const std::lock_guard lock(mutex_);
    queue_.push_back(std::move(item));
  }
  changed_.notify_all();
}

void ObservationPipe::finish() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return broken_ || (queue_.empty() && !writing_); });
}

bool ObservationPipe::broken() const {
  const std::lock_guard lock(mutex_);
  return broken_;
}

std::string ObservationPipe::error() const {
  const std::lock_guard lock(mutex_);
  return error_;
}

std::int64_t ObservationPipe::skipped() const {
  const std::lock_guard lock(mutex_);
  return skipped_;
}

void ObservationPipe::run() {
  if (wait_) lower_priority();
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [&] { return stop_ || !queue_.empty(); });
    if (stop_) return;  // whoever wants all of it written calls finish() first
    Item item = std::move(queue_.front());
    queue_.pop_front();
    writing_ = true;
    lock.unlock();
    changed_.notify_all();
    const bool written = write_item(item);
    item.left.reset();
    lock.lock();
    writing_ = false;
    if (written) {
      spare_.push_back(std::move(item));
    } else {
      broken_ = true;
      queue_.clear();
    }
    changed_.notify_all();
  }
}

/// Exceptions come before the first byte: what the reader has is complete.
bool ObservationPipe::write_item(const Item& item) {
  std::vector<std::uint8_t> jpeg;
  std::string head;
  try {
    if (jpeg_quality_ > 0 && !item.left->empty()) jpeg = encode_jpeg(*item.left, jpeg_quality_);
    head = head_of(item, jpeg.size());
  } catch (const std::exception& error) {
    const std::lock_guard lock(mutex_);
    error_ = error.what();
    return false;
  }
  return write_all(head.data(), head.size()) && write_all(item.arrays.data(), item.arrays.size()) &&
         write_all(jpeg.data(), jpeg.size()) &&
         write_all(item.segments.data(), item.segments.size());
}

bool ObservationPipe::write_all(const void* data, std::size_t size) const {
  const auto* at = static_cast<const char*>(data);
  while (size > 0) {
    const ssize_t n = ::write(descriptor_, at, size);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;  // Python ignores SIGPIPE: EPIPE comes here
    at += n;
    size -= static_cast<std::size_t>(n);
  }
  return true;
}

}  // namespace kys_slam
