// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

/// Constants of the prior file format, version 1, which priors/README.md describes byte by byte.
namespace kys_slam::prior_format {

inline constexpr std::array<std::uint8_t, 8> kMagic = {'K', 'Y', 'S', 'P', 0x0D, 0x0A, 0x1A, 0x0A};
inline constexpr std::uint16_t kVersion = 1;
inline constexpr std::size_t kHeaderSize = 96;
inline constexpr std::size_t kCameraEntrySize = 20;
inline constexpr std::size_t kSegmentSize = 20;
inline constexpr std::size_t kLabelSpaceLength = 32;  ///< bytes, zero padded
inline constexpr std::size_t kMaxCameras = 2;
inline constexpr std::size_t kMaxSegments = 65535;
inline constexpr int kMaxSide = 16384;                             ///< px
inline constexpr std::size_t kMaxFileSize = std::size_t{1} << 28;  ///< bytes

// Offsets in the header.
inline constexpr std::size_t kAtVersion = 8;
inline constexpr std::size_t kAtHeaderSize = 10;
inline constexpr std::size_t kAtFileSize = 12;
inline constexpr std::size_t kAtChecksum = 16;
inline constexpr std::size_t kAtChecked = 20;  ///< the checksum covers everything from here on
inline constexpr std::size_t kAtWidth = 20;
inline constexpr std::size_t kAtHeight = 22;
inline constexpr std::size_t kAtCameras = 24;
inline constexpr std::size_t kAtFrameFlags = 26;
inline constexpr std::size_t kAtReserved = 28;
inline constexpr std::size_t kAtCalibration = 32;
inline constexpr std::size_t kAtContentKey = 40;
inline constexpr std::size_t kAtLabelSpace = 48;

/// Frame flag: made with optical flow, so that "not dynamic" means "measured as static". Without
/// the flag it means "not judged".
inline constexpr std::uint16_t kFrameHasMotion = 1;
/// Frame flag: an object has the same instance in both cameras, plus kRightInstances in the right
/// one. Without the flag, instances of the two cameras are not related.
inline constexpr std::uint16_t kFrameSharesInstances = 2;

/// Segment flags.
inline constexpr std::uint16_t kThing = 1;
inline constexpr std::uint16_t kDynamic = 2;     ///< flagged as moving; its pixels carry motion
inline constexpr std::uint16_t kRadialOnly = 4;  ///< only the radial test of Eq. 7 passed
inline constexpr std::uint16_t kNotJudged = 8;   ///< of a thing: its motion was not measured
inline constexpr std::uint16_t kKnownSegmentFlags = kThing | kDynamic | kRadialOnly | kNotJudged;

/// Instances of camera 0 (left) are in [0, kRightInstances), those of camera 1 (right) in
/// [kRightInstances, 2 kRightInstances).
inline constexpr std::int32_t kRightInstances = 1 << 30;

/// Motion code q in 0..255 stands for mu = 101^(q/255) - 1, 0 to 100: equal steps (0.0181) of
/// ln(1 + mu), the quantity Eq. 9 uses.
const std::array<float, 256>& motion_of_code();

/// CRC-32 of zlib, PNG and Ethernet (polynomial 0xEDB88320).
std::uint32_t crc32(const std::uint8_t* bytes, std::size_t size);

}  // namespace kys_slam::prior_format
