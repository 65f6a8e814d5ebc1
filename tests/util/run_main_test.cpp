// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys/error.h>
#include <kys_slam/error.h>
#include <kys_slam/run_main.h>

#include <filesystem>
#include <new>
#include <stdexcept>
#include <string>
#include <system_error>

namespace kys_slam {
namespace {

template <typename Exception>
Failure failure_of(const Exception& exception) {
  return describe_failure(std::make_exception_ptr(exception));
}

TEST(DescribeFailure, WhatComesFromOutsideIsBadInput) {
  const Failure input = failure_of(InputError("a.png: corrupt"));
  EXPECT_EQ(input.status, kBadInput);
  EXPECT_EQ(input.message, "a.png: corrupt");
  EXPECT_EQ(failure_of(kys::Error("no such mode")).status, kBadInput);
  EXPECT_EQ(failure_of(std::bad_alloc()).status, kBadInput);
  EXPECT_EQ(failure_of(std::bad_alloc()).message, "out of memory");

  const std::filesystem::filesystem_error file("cannot open", "x/y.txt",
                                               std::make_error_code(std::errc::permission_denied));
  EXPECT_EQ(failure_of(file).status, kBadInput);
  EXPECT_EQ(failure_of(file).message, "x/y.txt: Permission denied");
}

TEST(DescribeFailure, MemoryAndThreadsOfOtherLibrariesAreFromOutsideToo) {
  // std::thread.
  const std::system_error own(std::make_error_code(std::errc::resource_unavailable_try_again));
  EXPECT_EQ(failure_of(own).status, kBadInput);
  EXPECT_EQ(failure_of(own).message.find("cannot start a thread: "), 0u);
  // The pool of threads below OpenCV.
  const std::runtime_error pool("pthread_create has failed: Resource temporarily unavailable");
  EXPECT_EQ(failure_of(pool).status, kBadInput);
  EXPECT_EQ(failure_of(pool).message.find("cannot start a thread: "), 0u);
  // OpenCV's allocator.
  const std::runtime_error memory("error: (-4:Insufficient memory) Failed to allocate 4 bytes");
  EXPECT_EQ(failure_of(memory).status, kBadInput);
  EXPECT_EQ(failure_of(memory).message, "out of memory");
}

TEST(DescribeFailure, EverythingElseIsADefect) {
  const Failure logic = failure_of(std::logic_error("two parents"));
  EXPECT_EQ(logic.status, kDefect);
  EXPECT_EQ(logic.message.find("two parents: a defect of ours"), 0u);
  EXPECT_NE(logic.message.find(version_text()), std::string::npos);
  EXPECT_EQ(failure_of(7).status, kDefect);
}

TEST(Printable, IsOneLineOfUtf8) {
  EXPECT_EQ(printable("plain, with spaces"), "plain, with spaces");
  EXPECT_EQ(printable("a\nb\tc\x1b[31m"), "a\\nb\\tc\\x1b[31m");
  EXPECT_EQ(printable("gr\xc3\xbc\xc3\x9f \xe2\x82\xac \xf0\x9f\x9a\x97"),
            "gr\xc3\xbc\xc3\x9f \xe2\x82\xac \xf0\x9f\x9a\x97");
  EXPECT_EQ(printable("\xc3("), "\\xc3(") << "a lead byte alone";
  EXPECT_EQ(printable("\xe2\x82"), "\\xe2\\x82") << "cut off";
  EXPECT_EQ(printable("\xc0\xaf"), "\\xc0\\xaf") << "a longer form than needed";
  EXPECT_EQ(printable("\xed\xa0\x80"), "\\xed\\xa0\\x80") << "a surrogate";
  EXPECT_EQ(printable("\xc2\x85"), "\\xc2\\x85") << "a control character beyond ASCII";
}

TEST(Printable, ALongTextLosesItsMiddle) {
  const std::string text = std::string(3000, 'a') + std::string(3000, 'b');
  EXPECT_EQ(printable(text, 10), "aaaaa...bbbbb");
  EXPECT_EQ(printable(text).size(), 2003u);
}

TEST(CsvField, StaysOneField) {
  EXPECT_EQ(csv_field("frame 1"), "frame 1");
  EXPECT_EQ(csv_field("a,b"), "\"a,b\"");
  EXPECT_EQ(csv_field("say \"a\""), "\"say \"\"a\"\"\"");
  EXPECT_EQ(csv_field("a\nb"), "a\\nb");
}

}  // namespace
}  // namespace kys_slam
