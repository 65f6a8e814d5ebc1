// SPDX-License-Identifier: BSD-3-Clause
#include "util/worker.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <stdexcept>
#include <string>
#include <thread>

namespace kys_slam {
namespace {

void rest() {
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
}

std::string message_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const std::exception& error) {
    return error.what();
  }
  return "";
}

TEST(Worker, BothHaveEndedWhenOneFails) {
  Worker worker;
  for (const bool job_fails : {false, true}) {
    std::atomic<bool> ended{false};
    const std::string message = message_of([&] {
      worker.run_beside(
          [&] {
            rest();
            ended = true;
            if (job_fails) throw std::runtime_error("job");
          },
          [] { throw std::runtime_error("own"); });
    });
    EXPECT_EQ(message, "own");
    EXPECT_TRUE(ended) << "the job still runs";
  }
  // Nothing of it is left for the next.
  int runs = 0;
  worker.run_beside([&] { ++runs; }, [] {});
  EXPECT_EQ(runs, 1);
}

TEST(Worker, TellsWhatTheJobThrew) {
  Worker worker;
  bool own_ended = false;
  EXPECT_EQ(message_of([&] {
              worker.run_beside([] { throw std::runtime_error("job"); },
                                [&] {
                                  rest();
                                  own_ended = true;
                                });
            }),
            "job");
  EXPECT_TRUE(own_ended);
}

}  // namespace
}  // namespace kys_slam
