#pragma once

#include "evaluation/association.h"

namespace kys_slam {

enum class Alignment { kNone, kSe3, kSim3 };

/// p_reference = scale * R * p_estimate + t.
struct Similarity {
  double scale = 1;
  Rigid3 T;
  /// The positions do not determine the rotation (fewer than three, all in one place, or all on
  /// one line); it was taken from the first poses' orientations instead.
  bool degenerate = false;
};

/// Least-squares alignment of the estimate's positions to the reference's (Umeyama, PAMI 1991).
Similarity align(const TrajectoryPair& pair, Alignment alignment);

/// Applies a similarity: positions are scaled, rotated and moved, orientations rotated.
void transform(std::vector<TimedPose>& poses, const Similarity& similarity);

}  // namespace kys_slam
