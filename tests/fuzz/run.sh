#!/usr/bin/env bash
# Fuzzes every reader with libFuzzer: run.sh [SECONDS_PER_READER [READER ...]]
# 135 s for each of the 27 readers are an hour (the default). Needs clang and its libFuzzer (Debian 12:
# clang, libclang-rt-14-dev). Corpora grow in build/fuzz/corpus, findings are kept in build/fuzz/findings.
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
[ $# -gt 0 ] || set -- $(ls tests/fuzz/seeds)
status=0
for reader in "$@"; do
  mkdir -p "$build/corpus/$reader"
  log=$build/findings/$reader.log
  # Memory is asked for at once by far less than this: see mutate_readers.cpp.
  if ! "$build/bin/fuzz_readers" --reader="$reader" -max_total_time="$seconds" -max_len=40000 \
       -malloc_limit_mb=1024 -rss_limit_mb=4096 -timeout=10 -print_final_stats=1 \
       -artifact_prefix="$build/findings/$reader-" "$build/corpus/$reader" "tests/fuzz/seeds/$reader" \
       > "$log" 2>&1; then
    status=1
    echo "$reader: FINDING, see $log"
  fi
  executions=$(grep -a "number_of_executed_units" "$log" | grep -oE "[0-9]+" || echo 0)
  echo "$reader: $executions executions, $(ls "$build/corpus/$reader" | wc -l) inputs in the corpus"
done
exit $status
