// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>

namespace kys_slam {

/// When segmentations given by System::add_segments take effect.
struct SegmentOptions {
  int lag = 0;          ///< frames after its own; not in the schedule realtime
  int every = 0;        ///< every n-th frame has one, which is waited for; 0: none is
  double timeout = 10;  ///< s, of a wait
  double memory = 3;    ///< s, for which a segmentation is carried to later frames
};
/// For check_options().
void describe(kys::OptionList& list, SegmentOptions& options);

}  // namespace kys_slam
