// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/stereo_camera.h>

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "priors/builder/build_sequence.h"
#include "priors/builder/frame_rows.h"

namespace kys_slam {

/// The output folder: prior files, rows of their tables (.rows), tables, pictures (debug).
class PriorOutput {
 public:
  /// Keeps a reference to `names`, those of the frames.
  PriorOutput(std::filesystem::path folder, const std::vector<std::string>& names, bool pictures)
      : folder_(std::move(folder)), names_(names), pictures_(pictures) {}

  void make_folders() const;
  [[nodiscard]] std::filesystem::path file_of(std::size_t t) const {
    return folder_ / (names_[t] + ".kysp");
  }
  [[nodiscard]] std::filesystem::path rows_of(std::size_t t) const {
    return folder_ / ".rows" / (names_[t] + ".csv");
  }
  [[nodiscard]] std::filesystem::path picture_of(std::size_t t, std::size_t camera) const {
    return folder_ / "debug" / (names_[t] + (camera == 0 ? "_left.png" : "_right.png"));
  }

  /// The evidence of a frame whose files are there and made from the same; else nothing.
  [[nodiscard]] std::optional<InstanceEvidence> kept_evidence(std::size_t t,
                                                              std::uint64_t key) const;
  /// Counts what is in the files of all frames. \param pixels  of all images
  void count_segments(double pixels, BuildSummary& summary) const;
  /// Joins the rows of all frames, and counts those without motion.
  void write_tables(const BuilderOptions& options, BuildSummary& summary) const;

 private:
  std::filesystem::path folder_;
  const std::vector<std::string>& names_;
  bool pictures_;
};

}  // namespace kys_slam
