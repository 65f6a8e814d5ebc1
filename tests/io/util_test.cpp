// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/error.h>
#include <kys_slam/util/atomic_file.h>
#include <kys_slam/util/interrupt.h>
#include <kys_slam/util/nearest_name.h>
#include <kys_slam/util/parse_number.h>
#include <kys_slam/util/process_figures.h>
#include <kys_slam/util/progress.h>
#include <kys_slam/util/read_bytes.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include <atomic>
#include <chrono>
#include <thread>

#include "temporary_folder.h"

namespace kys_slam {
namespace {

TEST(AtomicFile, ReplacesWholeFilesAndLeavesNothingBehind) {
  const TemporaryFolder folder;
  write_file_atomic(folder / "a.txt", "one");
  write_file_atomic(folder / "a.txt", "two");
  EXPECT_EQ(read_text(folder / "a.txt"), "two");
  std::filesystem::create_directory(folder / "d");
  expect_input_error([&] { write_file_atomic(folder / "d", "x"); }, {"cannot write", "/d"});
  expect_input_error([&] { write_file_atomic(folder / "no/a.txt", "x"); }, {"cannot write"});
  int files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder.path())) {
    files += entry.is_regular_file() ? 1 : 0;
  }
  EXPECT_EQ(files, 1);
}

TEST(AtomicFile, WhatIsNoRegularFileIsNotReplaced) {
  const TemporaryFolder folder;
  const auto pipe = folder / "pipe";
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  expect_input_error([&] { write_file_atomic(pipe, "x"); }, {"pipe", "not a regular file"});
  expect_input_error([&] { check_writable(pipe); }, {"pipe", "not a regular file"});
  EXPECT_TRUE(std::filesystem::is_fifo(pipe));
}

TEST(AtomicFile, FailureHalfWayLeavesTheOldFile) {
  const TemporaryFolder folder;
  write_file_atomic(folder / "a.txt", "old");
  rlimit limit{};
  ::getrlimit(RLIMIT_FSIZE, &limit);
  const rlimit small{1000, limit.rlim_max};
  const auto old_handler = ::signal(SIGXFSZ, SIG_IGN);
  ::setrlimit(RLIMIT_FSIZE, &small);  // as a full disk: the first write is short, the next fails
  try {
    write_file_atomic(folder / "a.txt", std::string(5000, 'x'));
    ADD_FAILURE() << "no InputError";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("cannot write"), std::string::npos) << error.what();
  }
  ::setrlimit(RLIMIT_FSIZE, &limit);
  ::signal(SIGXFSZ, old_handler);
  EXPECT_EQ(read_text(folder / "a.txt"), "old");
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 1);
}

TEST(AtomicFile, OutputFolderOverAFile) {
  const TemporaryFolder folder;
  write_text(folder / "file", "");
  make_output_folder(folder / "a/b");
  EXPECT_TRUE(std::filesystem::is_directory(folder / "a/b"));
  expect_input_error([&] { make_output_folder(folder / "file/x"); }, {"cannot write", "file/x"});
  expect_input_error([&] { make_output_folder(folder / "file"); }, {"cannot write"});
}

TEST(ParseNumber, WholeFiniteNumbersOnly) {
  EXPECT_EQ(parse_double("1.5e-3"), 1.5e-3);
  EXPECT_EQ(parse_double("+2"), 2.0);
  for (const char* bad :
       {"", "nan", "inf", "-inf", "1e999", "1x", " 1", "1 ", "+-1", "0x10", "."}) {
    EXPECT_FALSE(parse_double(bad)) << bad;
  }
  EXPECT_EQ(parse_int("-7"), -7);
  EXPECT_FALSE(parse_int("7.0"));
  EXPECT_FALSE(parse_int("99999999999999999999"));
}

TEST(NearestName, FindsSlipsOfThePen) {
  EXPECT_EQ(edit_distance("kitten", "sitting"), 3u);
  EXPECT_EQ(edit_distance("ab", "ba"), 1u);
  const std::vector<std::string> keys = {"orb.features", "orb.levels", "stereo.close_factor"};
  EXPECT_EQ(nearest_name("orb.fetaures", keys), "orb.features");
  EXPECT_EQ(nearest_name("banana", keys), "");
  EXPECT_EQ(did_you_mean("orb.level", keys), "; did you mean 'orb.levels'?");
}

TEST(Interrupt, SignalIsNotedAndItsActionRunsOnce) {
  std::atomic<int> calls{0};
  {
    const InterruptGuard guard([&] { ++calls; });
    EXPECT_FALSE(guard.requested());
    ::raise(SIGTERM);
    for (int k = 0; k < 2000 && calls == 0; ++k) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    EXPECT_TRUE(guard.requested());
  }
  EXPECT_EQ(calls, 1);
}

TEST(ProcessFigures, GrowWithWhatIsUsed) {
  const ProcessFigures before = process_figures();
  std::vector<char> memory(64 << 20, 1);
  volatile char* const used = memory.data();  // or a compiler may leave the memory out
  used[0] = 2;
  const ProcessFigures after = process_figures();
  EXPECT_GT(after.resident_mb, before.resident_mb + 60);
  EXPECT_GE(after.peak_resident_mb + 1, after.resident_mb);
  EXPECT_GT(after.cpu_seconds(), 0);
  EXPECT_EQ(used[memory.size() - 1], 1);
}

std::string contents(std::FILE* file) {
  std::rewind(file);
  char text[4096] = {};
  return {text, std::fread(text, 1, sizeof text, file)};
}

TEST(Progress, BarRedrawsAndEndsItsLine) {
  std::FILE* out = std::tmpfile();
  {
    Progress progress("frames", 4, Progress::Style::kBar, out);
    for (int i = 1; i <= 4; ++i) progress.update(i);
  }
  const std::string shown = contents(out);
  std::fclose(out);
  EXPECT_NE(shown.find("[######..................] frames 1/4"), std::string::npos) << shown;
  EXPECT_NE(shown.find("[########################] frames 4/4"), std::string::npos) << shown;
  EXPECT_EQ(shown.back(), '\n');
}

TEST(Progress, ShortTasksPrintNoLines) {
  std::FILE* out = std::tmpfile();
  {
    Progress progress("frames", 2, Progress::Style::kAuto, out);
    progress.update(1);
    progress.update(2);
  }
  EXPECT_EQ(std::ftell(out), 0);
  std::fclose(out);
}

TEST(Waiting, TellsAfterTwoSecondsAndNotBefore) {
  std::FILE* out = std::tmpfile();
  { const Waiting waiting("thinking", Progress::Style::kAuto, out); }
  EXPECT_EQ(std::ftell(out), 0);
  {
    const Waiting waiting("thinking", Progress::Style::kAuto, out);
    std::this_thread::sleep_for(std::chrono::milliseconds(2600));
  }
  EXPECT_EQ(contents(out).substr(0, 15), "thinking  0:02\n");
  std::fclose(out);
}

}  // namespace
}  // namespace kys_slam
