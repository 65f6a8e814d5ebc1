// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <nanobind/nanobind.h>

namespace kys_slam {

void bind_camera(nanobind::module_& m);      ///< cameras, rigs, rectification, pair check
void bind_evaluation(nanobind::module_& m);  ///< errors of trajectories, trajectory files
void bind_features(nanobind::module_& m);    ///< features of images, binary descriptors
void bind_matching(nanobind::module_& m);    ///< label spaces, the distance model
void bind_sequence(nanobind::module_& m);    ///< sequences and frames
void bind_system(nanobind::module_& m);      ///< settings and the system

}  // namespace kys_slam
