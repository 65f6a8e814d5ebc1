// Whatever bytes as the payloads of a feature file of version 2: the decoders refuse them or give
// frames and truths that can be written again. The first byte chooses what is decoded.
#include <cstdlib>
#include <stdexcept>

#include "io/feature_payload.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace kys_slam;
  if (size < 1) return 0;
  const std::span<const std::uint8_t> bytes(data + 1, size - 1);
  try {
    if (data[0] % 3 == 0) {
      const FeatureFrame frame = decode_frame(bytes, 1);
      const FeatureFrame again = decode_frame(encode_frame(frame, 1), 1);
      if (again.left.descriptors != frame.left.descriptors ||
          again.right_landmarks != frame.right_landmarks) {
        std::abort();
      }
    } else if (data[0] % 3 == 1) {
      const FeatureTruth truth = decode_truth(bytes, 100);
      if (decode_truth(encode_truth(truth), 100).landmarks.size() != truth.landmarks.size()) {
        std::abort();
      }
    } else {
      (void)inflate(bytes, 1 << 16);
    }
  } catch (const std::runtime_error&) {
  }
  return 0;
}
