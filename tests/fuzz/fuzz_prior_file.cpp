// Whatever bytes: the reader refuses them with InputError or answers every look-up within bounds,
// and what it accepts can be written again. Size and checksum are made right first, otherwise
// hardly an input would get past them.
#include <kys_slam/error.h>
#include <kys_slam/prior_format.h>
#include <kys_slam/prior_writer.h>

#include <cstdlib>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace kys_slam;
  namespace pf = prior_format;
  std::vector<std::uint8_t> bytes(data, data + size);
  const bool repair = size >= pf::kHeaderSize && (bytes[pf::kAtReserved] & 1) == 0;
  if (repair) {
    const auto put = [&](std::size_t at, std::uint32_t value) {
      for (std::size_t i = 0; i < 4; ++i)
        bytes[at + i] = static_cast<std::uint8_t>(value >> (8 * i));
    };
    std::copy(pf::kMagic.begin(), pf::kMagic.end(), bytes.begin());
    put(pf::kAtFileSize, static_cast<std::uint32_t>(size));
    put(pf::kAtChecksum, pf::crc32(bytes.data() + pf::kAtChecked, size - pf::kAtChecked));
  }
  try {
    const PriorFile file = PriorFile::parse(std::move(bytes), "fuzz");
    std::vector<Keypoint> keypoints(64);
    for (std::size_t i = 0; i < keypoints.size(); ++i) {
      keypoints[i].x = static_cast<float>((i * 7919) % static_cast<std::size_t>(file.width()));
      keypoints[i].y = static_cast<float>((i * 104729) % static_cast<std::size_t>(file.height()));
    }
    std::vector<kys::Prior> priors(keypoints.size());
    file.lookup(CameraSide::kLeft, keypoints, priors);
    file.lookup(CameraSide::kRight, keypoints, priors);
    if (static_cast<std::int64_t>(file.width()) * file.height() < 100000) {
      const FramePriors decoded = decode_priors(file);
      const PriorFile again = PriorFile::parse(encode_priors(decoded, "fuzz"), "again");
      if (again.segments(CameraSide::kLeft) != file.segments(CameraSide::kLeft)) std::abort();
    }
  } catch (const InputError&) {
  }
  return 0;
}
