#!/usr/bin/env bash
# Fuzzes every reader with libFuzzer: run.sh [SECONDS_PER_READER [READER ...]]
# 190 s for each of the 19 readers are an hour (the default). Needs clang and its libFuzzer (Debian 12:
# clang, libclang-rt-14-dev). Corpora grow in build/fuzz/corpus, findings are kept in build/fuzz/findings.
set -euo pipefail
cd "$(dirname "$0")/../.."
seconds=${1:-190}
shift || true
build=build/fuzz
cmake -B $build -G Ninja -DCMAKE_CXX_COMPILER="${CXX:-clang++}" -DCMAKE_BUILD_TYPE=RelWithDebInfo \
  -DKYS_SANITIZE=fuzzer-no-link,address,undefined -DKYS_BUILD_FUZZERS=ON -DKYS_BUILD_SIMULATOR=OFF \
  -DKYS_BUILD_PYTHON=OFF -DKYS_BUILD_BENCHMARKS=OFF > $build.log 2>&1 || { cat $build.log; exit 1; }
cmake --build $build --target fuzz_readers
mkdir -p $build/findings
status=0
for reader in "${@:-$(ls tests/fuzz/seeds)}"; do
  for name in $reader; do
    mkdir -p "$build/corpus/$name"
    log=$build/findings/$name.log
    # Memory is asked for at once by far less than this: see mutate_readers.cpp.
    if ! "$build/bin/fuzz_readers" --reader="$name" -max_total_time="$seconds" -max_len=40000 \
         -malloc_limit_mb=1024 -rss_limit_mb=4096 -timeout=10 -print_final_stats=1 \
         -artifact_prefix="$build/findings/$name-" "$build/corpus/$name" "tests/fuzz/seeds/$name" \
         > "$log" 2>&1; then
      status=1
      echo "$name: FINDING, see $log"
    fi
    echo "$name: $(grep -a "number_of_executed_units" "$log" | grep -oE "[0-9]+" || echo 0) executions," \
         "$(ls "$build/corpus/$name" | wc -l) inputs in the corpus"
  done
done
exit $status
