// SPDX-License-Identifier: BSD-3-Clause
// libFuzzer's entry: fuzz_readers --reader=NAME [libFuzzer's options] CORPUS ...
#include <kys/error.h>
#include <kys_slam/error.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "readers.h"

namespace {
const kys_slam::fuzz::Reader* reader = nullptr;
}

extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv) {
  constexpr const char* kOption = "--reader=";
  for (int i = 1; i < *argc; ++i) {
    if (std::strncmp((*argv)[i], kOption, std::strlen(kOption)) == 0) {
      reader = kys_slam::fuzz::find_reader((*argv)[i] + std::strlen(kOption));
    }
  }
  if (reader == nullptr) {
    std::fprintf(stderr, "--reader=NAME; readers:\n");
    for (const auto& r : kys_slam::fuzz::readers()) {
      std::fprintf(stderr, "%.*s\n", static_cast<int>(r.name.size()), r.name.data());
    }
    std::exit(2);
  }
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    reader->read({data, size});
  } catch (const kys_slam::InputError&) {
  } catch (const kys::Error&) {
  }
  return 0;
}
