// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <nanobind/nanobind.h>

namespace kys_slam {

void bind_camera(nanobind::module_& m);      ///< cameras, rigs, rectification, pair check
void bind_evaluation(nanobind::module_& m);  ///< errors of trajectories, trajectory files
void bind_features(nanobind::module_& m);    ///< features of images, binary descriptors
void bind_matching(nanobind::module_& m);    ///< label spaces, the distance model
void bind_sequence(nanobind::module_& m);    ///< sequences and frames
void bind_settings(nanobind::module_& m);    ///< settings
void bind_report(nanobind::module_& m);      ///< what comes of a frame
void bind_guard(nanobind::module_& m);       ///< signals while the library computes
void bind_system(nanobind::module_& m);      ///< the system, with the three above

}  // namespace kys_slam
