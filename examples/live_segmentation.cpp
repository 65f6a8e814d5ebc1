// SPDX-License-Identifier: BSD-3-Clause
// A network in a thread beside the tracker: live_segmentation SEQUENCE [NETWORK.onnx]
// The ONNX file gives class logits of the label space (live_network.h, with OpenCV).
#include <kys/label_space.h>
#include <kys_slam/sequence.h>
#include <kys_slam/system.h>

#include <algorithm>
#include <cstdio>
#include <future>

#include "live_network.h"

namespace {

/// In the place of a network: sky above, road below. Pixels hold 0 (void) or k, for segments[k -
/// 1]: its label, and where it is an object a number of its own in `instance`.
SegmentPointer road_below(const kys_slam::GrayImage& image) {
  static const kys::LabelSpace space = kys::load_label_space("coco_panoptic_133");
  auto found = std::make_shared<kys_slam::SegmentImage>();
  found->map = kys_slam::ImageOf<std::uint16_t>(image.width(), image.height(), 1);
  std::fill(found->map.row(image.height() / 2), found->map.row(image.height()), std::uint16_t{2});
  for (const char* name : {"sky-other-merged", "road"}) {
    kys::Prior& segment = found->segments.emplace_back();
    segment.instance = segment.label = space.index_of(name);
  }
  return found;
}

}  // namespace

int main(int argc, char** argv) try {
  const auto sequence = kys_slam::open_sequence(argc > 1 ? argv[1] : "sequence");
  const Segment segment = argc > 2 ? open_network(argv[2]) : Segment(road_below);
  kys_slam::Settings settings;
  settings.set("kys.mode", "verified");
  settings.set("control.segment_every", "3");  // frames 0, 3, 6, ... are segmented,
  settings.set("control.segment_lag", "3");    // and have to be ready three frames later
  kys_slam::System slam(sequence->camera(), settings, kys_slam::Schedule::kPipelined);
  std::future<void> busy;
  int tracked = 0;
  for (std::int64_t i = 0; auto frame = sequence->next(); ++i) {
    if (i % 3 == 0) {
      if (busy.valid()) busy.get();  // throws what the network threw
      busy = std::async(std::launch::async, [&slam, &segment, i, image = frame->left] {
        slam.add_segments(i, segment(image));
      });
    }
    const std::int64_t of = slam.feed(*frame).segments_of;
    if (of >= 0) std::printf("frame %d: segments of frame %d\n", int(i), int(of));
  }
  slam.finish();
  for (const auto& frame : slam.trajectory()) tracked += frame.connected ? 1 : 0;
  std::printf("%d frames tracked\n", tracked);
} catch (const std::exception& error) {
  std::fprintf(stderr, "live_segmentation: %s\n", error.what());
  return 2;
}
