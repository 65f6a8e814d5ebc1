// SPDX-License-Identifier: BSD-3-Clause
// index_benchmark MAP [QUERIES]: the hash tables of place recognition and FLANN's LSH index on the
// landmarks of a map (run_stereo_kitti --save-map), asked with features of its keyframes. Found:
// the share of queries whose nearest landmark, at most 50 bits away, is the answer. Processor time.
#include <kys_slam/error.h>
#include <kys_slam/run_main.h>
#include <kys_slam/util/parse_number.h>
#include <kys_slam/util/process_figures.h>

#include <algorithm>
#include <bit>
#include <cstdio>
#include <cstring>
#include <flann/flann.hpp>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "map_file/map_file.h"
#include "retrieval/descriptor_tables.h"
#include "retrieval/place_index.h"

namespace kys_slam {
namespace {

constexpr int kFarthest = 50;  // bits
constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

int distance(const kys::Descriptor& a, const kys::Descriptor& b) {
  int bits = 0;
  for (std::size_t i = 0; i < a.words.size(); ++i) bits += std::popcount(a.words[i] ^ b.words[i]);
  return bits;
}

struct Answer {
  std::uint32_t landmark = kNone;
  int bits = kFarthest + 1;
};

struct Data {
  std::vector<kys::Descriptor> landmarks;
  std::vector<kys::Descriptor> queries;
  std::vector<Answer> nearest;  // by looking at all
};

Data take_data(const Map& map, std::size_t queries) {
  Data data;
  map.landmarks().for_each(
      [&](LandmarkId, const Landmark& l) { data.landmarks.push_back(l.descriptor); });
  std::vector<kys::Descriptor> all;
  map.keyframes().for_each([&](KeyFrameId, const KeyFrame& k) {
    for (std::size_t i = 0; i < k.features->size(); ++i) all.push_back(k.features->descriptor(i));
  });
  const std::size_t step = std::max<std::size_t>(1, all.size() / queries);
  for (std::size_t i = 0; i < all.size(); i += step) data.queries.push_back(all[i]);
  for (const kys::Descriptor& query : data.queries) {
    Answer best;
    for (std::uint32_t n = 0; n < data.landmarks.size(); ++n) {
      if (const int bits = distance(query, data.landmarks[n]); bits < best.bits) best = {n, bits};
    }
    data.nearest.push_back(best);
  }
  return data;
}

void report(const std::string& name, const Data& data, double add_s, double megabytes,
            const std::function<Answer(const kys::Descriptor&)>& ask) {
  std::size_t findable = 0, found = 0, answered = 0;
  std::vector<Answer> answers;
  const double begin = process_figures().cpu_seconds();
  for (const kys::Descriptor& query : data.queries) answers.push_back(ask(query));
  const double seconds = process_figures().cpu_seconds() - begin;
  for (std::size_t q = 0; q < answers.size(); ++q) {
    const bool there = data.nearest[q].bits <= kFarthest;
    findable += there ? 1 : 0;
    answered += answers[q].bits <= kFarthest ? 1 : 0;
    found += there && answers[q].bits == data.nearest[q].bits ? 1 : 0;
  }
  const auto share = [](std::size_t a, std::size_t b) {
    return static_cast<double>(a) / static_cast<double>(std::max<std::size_t>(1, b));
  };
  std::printf("%-44s %8.3f %9.3f %8.1f %10.2f %9.1f\n", name.c_str(), share(found, findable),
              share(found, answered), 1e6 * seconds / static_cast<double>(data.queries.size()),
              1e6 * add_s / static_cast<double>(data.landmarks.size()), megabytes);
  std::fflush(stdout);
}

void try_tables(const Data& data, int count, std::size_t max_bucket) {
  const double before = process_figures().cpu_seconds();
  DescriptorTables tables(count, 0);
  for (std::uint32_t n = 0; n < data.landmarks.size(); ++n) tables.insert(data.landmarks[n], n);
  const double add_s = process_figures().cpu_seconds() - before;
  std::vector<std::uint32_t> met(data.landmarks.size(), kNone);
  std::uint32_t turn = 0;
  report(std::to_string(count) + " tables of 16 bits, buckets up to " + std::to_string(max_bucket),
         data, add_s, 1e-6 * static_cast<double>(tables.bytes()),
         [&](const kys::Descriptor& query) {
           Answer best;
           for (int t = 0; t < tables.tables(); ++t) {
             const auto bucket = tables.bucket(tables.key(query, t));
             if (bucket.size() > max_bucket) continue;
             for (const std::uint32_t n : bucket) {
               if (met[n] == turn) continue;
               met[n] = turn;
               const int bits = distance(query, data.landmarks[n]);
               if (bits < best.bits || (bits == best.bits && n < best.landmark)) best = {n, bits};
             }
           }
           ++turn;
           return best;
         });
}

void try_flann(const Data& data, unsigned tables, unsigned key_bits, unsigned probes) {
  using Index = flann::LshIndex<flann::Hamming<unsigned char>>;
  constexpr std::size_t kBytes = sizeof(kys::Descriptor);
  // FLANN keeps pointers to the rows, the tables above do not hold descriptors either.
  std::vector<unsigned char> rows(data.landmarks.size() * kBytes);
  for (std::size_t n = 0; n < data.landmarks.size(); ++n) {
    std::memcpy(&rows[n * kBytes], data.landmarks[n].words.data(), kBytes);
  }
  flann::seed_random(1);
  const double before = process_figures().cpu_seconds();
  const double resident = process_figures().resident_mb;
  Index index(flann::Matrix<unsigned char>(rows.data(), data.landmarks.size(), kBytes),
              flann::LshIndexParams(tables, key_bits, probes));
  index.buildIndex();
  const double add_s = process_figures().cpu_seconds() - before;
  const double megabytes = process_figures().resident_mb - resident;
  report("FLANN LSH, " + std::to_string(tables) + " tables of " + std::to_string(key_bits) +
             " bits, probes " + std::to_string(probes),
         data, add_s, megabytes, [&](const kys::Descriptor& query) {
           unsigned char bytes[kBytes];
           std::memcpy(bytes, query.words.data(), kBytes);
           std::size_t n = kNone;
           unsigned bits = kFarthest + 1;
           flann::Matrix<unsigned char> row(bytes, 1, kBytes);
           flann::Matrix<std::size_t> indices(&n, 1, 1);
           flann::Matrix<unsigned> distances(&bits, 1, 1);
           flann::SearchParams params;
           params.cores = 1;
           if (index.knnSearch(row, indices, distances, 1, params) == 0) return Answer{};
           return Answer{static_cast<std::uint32_t>(n), static_cast<int>(bits)};
         });
}

int run(int argc, char** argv) {
  if (argc < 2) {
    std::fprintf(stderr, "usage: index_benchmark MAP [QUERIES]\n");
    return kBadInput;
  }
  const auto queries = argc > 2 ? parse_int(argv[2]) : 20000;
  if (!queries || *queries < 1) {
    throw InputError(std::string("QUERIES ") + argv[2] + ": must be a whole number, at least 1");
  }
  const Map map = load_map(argv[1]);
  const Data data = take_data(map, static_cast<std::size_t>(*queries));
  if (data.landmarks.empty() || data.queries.empty()) {
    throw InputError(std::string(argv[1]) + ": holds no landmarks or no keyframes");
  }
  std::printf("%zu landmarks, %zu queries\n%-44s %8s %9s %8s %10s %9s\n", data.landmarks.size(),
              data.queries.size(), "", "found", "precision", "us/query", "us to add", "MB");
  const PlaceOptions place;
  try_tables(data, place.tables, place.max_bucket);
  try_tables(data, place.tables, kNone);
  try_tables(data, 16, kNone);
  try_flann(data, 8, 16, 0);
  try_flann(data, 16, 16, 0);
  try_flann(data, 8, 16, 1);
  try_flann(data, 4, 16, 2);
  try_flann(data, 6, 12, 1);
  return 0;
}

}  // namespace
}  // namespace kys_slam

int main(int argc, char** argv) {
  return kys_slam::run_main("index_benchmark", [&] { return kys_slam::run(argc, argv); });
}
