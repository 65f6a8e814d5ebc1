#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# clang-format and clang-tidy (14, as in Debian 12) over the source; status 1 when they find something.
#   tools/lint.sh              files that differ from the branch main
#   tools/lint.sh FILE...      these files
#   tools/lint.sh --format     clang-format and licence lines alone, all files (seconds)
#   tools/lint.sh --all        src, kys, priors and tools (10 minutes of one core)
set -euo pipefail
cd "$(dirname "$0")/.."

tools=(clang-format)
if [ "${1:-}" != --format ]; then tools+=(clang-tidy cmake); fi
for tool in "${tools[@]}"; do
  command -v "$tool" >/dev/null || { echo "tools/lint.sh: needs $tool" >&2; exit 2; }
done

all=false
case "${1:-}" in
  --all | --format)
    all=true
    tools/spdx.sh
    mapfile -t files < <(git ls-files '*.h' '*.cpp')
    ;;
  "")
    base=$(git merge-base HEAD main)  # by itself: in the list below its failure would go unseen
    mapfile -t files < <(
    { git diff --name-only --diff-filter=d "$base" -- '*.h' '*.cpp'
      git ls-files --others --exclude-standard -- '*.h' '*.cpp'; } | sort -u) ;;
  *) files=("$@") ;;
esac
if [ "${#files[@]}" -eq 0 ]; then
  echo "nothing to check"
  exit 0
fi

echo "clang-format: ${#files[@]} files"
clang-format --dry-run -Werror "${files[@]}"
if [ "${1:-}" = --format ]; then exit 0; fi

# A compile database is all clang-tidy needs; nothing is built.
configure() { cmake --preset release -B "$1" "${@:2}" >/dev/null; }
failed=0
tidy() { nice -n 10 clang-tidy -quiet "$@" 2>/dev/null || failed=1; }

if $all; then
  # One translation unit per library: the headers of Eigen are read 30 times instead of 130.
  configure build/lint-all -DCMAKE_UNITY_BUILD=ON -DCMAKE_UNITY_BUILD_BATCH_SIZE=0 \
    -DKYS_BUILD_TESTS=OFF -DKYS_BUILD_BENCHMARKS=OFF
  mapfile -t units < <(sed -n 's/^ *"file": "\(.*\)".*/\1/p' build/lint-all/compile_commands.json)
  for i in "${!units[@]}"; do
    echo "clang-tidy $((i + 1))/${#units[@]}: ${units[i]#"$PWD"/}"
    tidy -p build/lint-all --checks=-bugprone-suspicious-include \
      --header-filter="^$PWD/(include/kys_slam|src|kys|priors|tools)/.*\.(h|cpp)$" "${units[i]}"
  done
else
  configure build/lint
  for file in "${files[@]}"; do
    path=$(realpath "$file")
    grep -q "\"file\": \"$path\"" build/lint/compile_commands.json || continue
    echo "clang-tidy: $file"
    tidy -p build/lint "$path"
  done
fi
exit "$failed"
