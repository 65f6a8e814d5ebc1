// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/map_snapshot.h>
#include <kys_slam/system.h>
#include <nanobind/nanobind.h>

namespace kys_slam {

/// Arrays by name: keyframes, landmarks and edges of the covisibility graph.
nanobind::dict to_dict(const MapSnapshot& snapshot);
/// What a run knows of the calibration: parameters as (value, standard deviation or None, unit).
nanobind::dict to_dict(const RigReport& report);

}  // namespace kys_slam
