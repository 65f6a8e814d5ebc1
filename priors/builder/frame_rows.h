// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "priors/fusion/fuse.h"

namespace kys_slam {

/// First lines of segments.csv and background.csv.
extern const char* const kSegmentsHeader;
extern const char* const kBackgroundHeader;

/// The rows of one camera and frame: those that begin with S are of segments.csv, those with B of
/// background.csv, without this letter.
std::string table_rows(const std::string& name, std::size_t camera, const CameraFusion& fusion);

/// The rows of a frame in the folder .rows, from which a later run goes on without its images: a
/// line with the content key of the prior file and the checksum of the rows, then the rows.
std::string pack_rows(std::uint64_t key, const std::string& rows);

/// The rows of such a file; nothing when they are not those of the key, or damaged.
std::optional<std::string> unpack_rows(const std::filesystem::path& path, std::uint64_t key);

/// Evidence of moving (nats) by instance.
using InstanceEvidence = std::vector<std::pair<std::int32_t, double>>;

/// Instances and evidence in the rows of a frame. Nothing when a row is not as it is written.
std::optional<InstanceEvidence> evidence_of(const std::string& rows);

}  // namespace kys_slam
