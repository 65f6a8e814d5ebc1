// SPDX-License-Identifier: BSD-3-Clause
#include "priors/builder/prior_output.h"

#include <kys_slam/error.h>
#include <kys_slam/prior_file.h>
#include <kys_slam/prior_format.h>
#include <kys_slam/run_main.h>
#include <kys_slam/util/atomic_file.h>

#include <fstream>
#include <system_error>

namespace kys_slam {

void PriorOutput::make_folders() const {
  make_output_folder(folder_);
  make_output_folder(folder_ / ".rows");
  if (pictures_) make_output_folder(folder_ / "debug");
}

std::optional<InstanceEvidence> PriorOutput::kept_evidence(std::size_t t, std::uint64_t key) const {
  namespace fs = std::filesystem;
  std::error_code error;
  if (!fs::exists(file_of(t), error) || !fs::exists(rows_of(t), error)) return {};
  if (pictures_ && !fs::exists(picture_of(t, 0), error)) return {};
  try {
    if (PriorFile::open(file_of(t)).content_key() != key) return {};
    const std::optional<std::string> rows = unpack_rows(rows_of(t), key);
    return rows ? evidence_of(*rows) : std::nullopt;
  } catch (const InputError&) {
    return {};
  }
}

void PriorOutput::count_segments(double pixels, BuildSummary& summary) const {
  double labelled = 0, flagged = 0;
  for (std::size_t t = 0; t < names_.size(); ++t) {
    const PriorFile file = PriorFile::open(file_of(t));
    summary.bytes += file.file_size();
    for (std::size_t c = 0; c < file.camera_count(); ++c) {
      for (const PriorSegment& s : file.segments(static_cast<CameraSide>(c))) {
        const bool dynamic = (s.flags & prior_format::kDynamic) != 0;
        labelled += s.area;
        flagged += dynamic ? s.area : 0;
        summary.thing_segments += (s.flags & prior_format::kThing) != 0;
        summary.dynamic_segments += dynamic;
        summary.radial_only_segments += (s.flags & prior_format::kRadialOnly) != 0;
      }
    }
  }
  summary.labelled_pixels = pixels > 0 ? labelled / pixels : 0;
  summary.flagged_pixels = pixels > 0 ? flagged / pixels : 0;
}

void PriorOutput::write_tables(const BuilderOptions& options, BuildSummary& summary) const {
  std::string segments = kSegmentsHeader, background = kBackgroundHeader;
  for (std::size_t t = 0; t < names_.size(); ++t) {
    std::ifstream rows(rows_of(t));
    const std::string left = "B" + csv_field(names_[t]) + ",left,";
    bool motion = false;
    for (std::string line; std::getline(rows, line);) {
      motion = motion || line.starts_with(left);
      if (line.starts_with('S')) segments += line.substr(1) + "\n";
      if (line.starts_with('B')) background += line.substr(1) + "\n";
    }
    summary.frames_without_motion += motion ? 0 : 1;
  }
  write_file_atomic(folder_ / "segments.csv", segments);
  write_file_atomic(folder_ / "background.csv", background);
  write_file_atomic(folder_ / "settings.txt", to_text(options));
}

}  // namespace kys_slam
