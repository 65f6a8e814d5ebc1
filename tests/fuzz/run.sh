#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Fuzzes every reader with libFuzzer: run.sh [SECONDS_PER_READER [READER ...]]
# Seconds are of processor time: 135 s for each of the 27 readers are an hour (the default). Needs clang
# and its libFuzzer (Debian 12: clang, libclang-rt-14-dev). Corpora grow in build/fuzz/corpus, findings are
# kept in build/fuzz/findings.
set -euo pipefail
cd "$(dirname "$0")/../.."
seconds=${1:-135}
shift || true
build=build/fuzz
mkdir -p $build/findings
cmake -B $build -G Ninja -DCMAKE_CXX_COMPILER="${CXX:-clang++}" -DCMAKE_BUILD_TYPE=RelWithDebInfo \
  -DKYS_SANITIZE=fuzzer-no-link,address,undefined -DKYS_BUILD_FUZZERS=ON -DKYS_BUILD_SIMULATOR=OFF \
  -DKYS_BUILD_PYTHON=OFF -DKYS_BUILD_BENCHMARKS=OFF > $build/configure.log 2>&1 ||
  { cat $build/configure.log; exit 1; }
cmake --build $build --target fuzz_readers

# One round of at most half a minute by the clock. Adds to `executions` and `spent` (ms of processor
# time: libFuzzer's own limit is by the clock, which on a machine that others use says little).
one_round() {
  local log=$build/findings/$1.log passed=true time=$build/findings/$1.time TIMEFORMAT='%U %S'
  # Memory is asked for at once by far less than this: see mutate_readers.cpp.
  { time "$build/bin/fuzz_readers" --reader="$1" -max_total_time=30 -max_len=40000 \
      -malloc_limit_mb=1024 -rss_limit_mb=4096 -timeout=10 -print_final_stats=1 \
      -artifact_prefix="$build/findings/$1-" "$build/corpus/$1" "tests/fuzz/seeds/$1" \
      > "$log" 2>&1; } 2> "$time" || passed=false
  spent=$((spent + $(awk '{printf "%d", 1000 * ($1 + $2)}' "$time")))
  executions=$((executions + $(grep -a number_of_executed_units "$log" | grep -oE "[0-9]+" || echo 0)))
  $passed
}

[ $# -gt 0 ] || set -- $(ls tests/fuzz/seeds)
status=0
for reader in "$@"; do
  mkdir -p "$build/corpus/$reader"
  executions=0 spent=0
  while [ "$spent" -lt $((1000 * seconds)) ]; do
    if ! one_round "$reader"; then
      status=1
      cp "$build/findings/$reader.log" "$build/findings/$reader-$spent.log"
      echo "$reader: FINDING, see $build/findings/$reader-$spent.log"
      break
    fi
  done
  echo "$reader: $executions executions, $((spent / 1000)) s of processor time," \
    "$(ls "$build/corpus/$reader" | wc -l) inputs in the corpus"
done
exit $status
