// SPDX-License-Identifier: BSD-3-Clause
// Fuzzing in every build and every test run, without libFuzzer: the seeds of a reader as they are,
// cut off everywhere, and with random changes; the same inputs in every run.
//   mutate_readers SEEDS_DIR [INPUTS_PER_READER [READER ...]]
// Ends with status 1 when an input made a reader throw anything but its errors, or ask for more
// memory at once than its input explains; the input is kept as finding-NAME in the working folder.
#include <kys/error.h>
#include <kys_slam/error.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <new>
#include <random>
#include <string>
#include <vector>

#include "readers.h"

namespace {

std::atomic<std::size_t> largest_request{0};

void* allocate(std::size_t size, std::size_t alignment) {
  std::size_t before = largest_request.load(std::memory_order_relaxed);
  while (before < size && !largest_request.compare_exchange_weak(before, size)) {
  }
  const std::size_t rounded = (size + alignment - 1) / alignment * alignment;
  void* memory = alignment <= alignof(std::max_align_t) ? std::malloc(size > 0 ? size : 1)
                                                        : std::aligned_alloc(alignment, rounded);
  if (memory == nullptr) throw std::bad_alloc();
  return memory;
}

}  // namespace

void* operator new(std::size_t size) {
  return allocate(size, alignof(std::max_align_t));
}
void* operator new(std::size_t size, std::align_val_t alignment) {
  return allocate(size, static_cast<std::size_t>(alignment));
}
void operator delete(void* memory) noexcept {
  std::free(memory);
}
void operator delete(void* memory, std::size_t) noexcept {
  std::free(memory);
}
void operator delete(void* memory, std::align_val_t) noexcept {
  std::free(memory);
}
void operator delete(void* memory, std::size_t, std::align_val_t) noexcept {
  std::free(memory);
}

namespace {

using namespace kys_slam::fuzz;
using Input = std::vector<std::uint8_t>;

std::vector<Input> load_seeds(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> paths;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    paths.push_back(entry.path());
  }
  std::sort(paths.begin(), paths.end());
  std::vector<Input> seeds;
  for (const auto& path : paths) {
    std::ifstream file(path, std::ios::binary);
    seeds.emplace_back(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>());
  }
  return seeds;
}

/// Changes that find what length fields, separators and signs are good for.
class Mutator {
 public:
  Mutator(std::vector<Input> seeds, unsigned seed) : seeds_(std::move(seeds)), random_(seed) {}

  Input next() {
    Input input = seeds_[below(seeds_.size())];
    for (std::size_t i = 0, changes = 1 + below(4); i < changes; ++i) change(input);
    return input;
  }

 private:
  std::size_t below(std::size_t n) { return n == 0 ? 0 : random_() % n; }

  void change(Input& input) {
    static constexpr std::uint8_t kBytes[] = {0,   1,   0x7F, 0x80, 0xFF, '\n',
                                              ' ', '-', '9',  '{',  '"'};
    static const std::string kTexts[] = {"nan", "inf", "-1", "1e308", "99999999999999999999",
                                         "[[[["};
    const std::size_t at = below(input.size());
    if (input.empty()) {
      input.push_back(0);
      return;
    }
    switch (below(7)) {
      case 0:
        input[at] ^= static_cast<std::uint8_t>(1U << below(8));
        break;
      case 1:
        input[at] = kBytes[below(std::size(kBytes))];
        break;
      case 2:  // a number of four bytes
        for (std::size_t i = at; i < std::min(at + 4, input.size()); ++i) {
          input[i] = static_cast<std::uint8_t>(below(2) == 0 ? 0xFF : 0x7F);
        }
        break;
      case 3:
        input.resize(at);
        break;
      case 4:  // a piece goes, or comes twice
      case 5: {
        const auto begin = input.begin() + static_cast<std::ptrdiff_t>(at);
        const auto length =
            static_cast<std::ptrdiff_t>(1 + below(std::min<std::size_t>(40, input.size() - at)));
        if (below(2) == 0) {
          input.erase(begin, begin + length);
        } else {
          const Input piece(begin, begin + length);
          input.insert(begin, piece.begin(), piece.end());
        }
        break;
      }
      default: {
        const std::string& text = kTexts[below(std::size(kTexts))];
        input.insert(input.begin() + static_cast<std::ptrdiff_t>(at), text.begin(), text.end());
      }
    }
  }

  std::vector<Input> seeds_;
  std::mt19937 random_;
};

struct Tally {
  int runs = 0;
  int refused = 0;
  int findings = 0;
  double most = 0;  // MB asked for at once
};

/// What is wrong, or "".
std::string run(const Reader& reader, const Input& input, Tally& tally) {
  ++tally.runs;
  largest_request = 0;
  std::string wrong;
  try {
    reader.read(input);
  } catch (const kys_slam::InputError&) {
    ++tally.refused;
  } catch (const kys::Error&) {
    ++tally.refused;
  } catch (const std::exception& error) {
    wrong = error.what();
  }
  const auto largest = static_cast<double>(largest_request.load());
  tally.most = std::max(tally.most, largest / 1e6);
  if (largest > kFreeBytes + reader.bytes_per_byte * static_cast<double>(input.size())) {
    wrong = "asks for " + std::to_string(largest / 1e6) + " MB";
  }
  return wrong;
}

void check(const Reader& reader, const Input& input, Tally& tally) {
  const std::string wrong = run(reader, input, tally);
  if (wrong.empty()) return;
  const std::string name =
      "finding-" + std::string(reader.name) + "-" + std::to_string(++tally.findings);
  std::ofstream(name, std::ios::binary)
      .write(reinterpret_cast<const char*>(input.data()),
             static_cast<std::streamsize>(input.size()));
  std::printf("%s: %s (%zu bytes)\n", name.c_str(), wrong.c_str(), input.size());
}

Tally fuzz(const Reader& reader, const std::filesystem::path& folder, int runs) {
  const std::vector<Input> seeds = load_seeds(folder);
  Tally tally;
  int sound = 0;
  for (const Input& seed : seeds) {
    const int refused = tally.refused;
    check(reader, seed, tally);
    sound += tally.refused == refused ? 1 : 0;
    const std::size_t step = std::max<std::size_t>(1, seed.size() / 50);
    for (std::size_t size = 0; size < seed.size(); size += step) {
      check(reader, Input(seed.begin(), seed.begin() + static_cast<std::ptrdiff_t>(size)), tally);
    }
  }
  Mutator mutator(seeds, 1);
  while (tally.runs < runs) check(reader, mutator.next(), tally);
  if (sound == 0) {
    std::printf("%s: no seed is sound\n", std::string(reader.name).c_str());
    ++tally.findings;
  }
  return tally;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) return 2;
  const int runs = argc > 2 ? std::atoi(argv[2]) : 1000;
  const std::vector<std::string> wanted(argv + std::min(argc, 3), argv + argc);
  int findings = 0;
  for (const Reader& reader : readers()) {
    const std::string name(reader.name);
    if (!wanted.empty() && std::find(wanted.begin(), wanted.end(), name) == wanted.end()) continue;
    const auto begin = std::chrono::steady_clock::now();
    const Tally t = fuzz(reader, std::filesystem::path(argv[1]) / name, runs);
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
    std::printf("%-16s %6d inputs, %6d refused, %d findings, at most %.1f MB at once, %.1f s\n",
                name.c_str(), t.runs, t.refused, t.findings, t.most, seconds.count());
    std::fflush(stdout);
    findings += t.findings;
  }
  return findings == 0 ? 0 : 1;
}
