#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# The licence line (SPDX) of source files, below a #! line. Status 1, and their names, when some have none.
#   tools/spdx.sh          checks
#   tools/spdx.sh --add    adds it where it is missing
set -euo pipefail
cd "$(dirname "$0")/.."
case "${1:-}" in
  '' | --add) ;;
  *) sed -n '2,/^set/{/^# SPDX/d;/^#/s/^# \{0,1\}//p}' "$0" >&2; exit 2 ;;
esac

# Numbers of OpenCV, under its licence: third_party/README.md.
mapfile -t files < <(git ls-files '*.h' '*.cpp' '*.inc' '*.py' '*.sh' '*.cmake' '*CMakeLists.txt' \
  ':!src/features/orb_pattern.h')
missing=()
for file in "${files[@]}"; do
  case "$file" in
    *.h | *.cpp | *.inc) line='// SPDX-License-Identifier: BSD-3-Clause' ;;
    *) line='# SPDX-License-Identifier: BSD-3-Clause' ;;
  esac
  { read -r first; read -r second; } <"$file" || true
  if [ "$first" = "$line" ] || { [[ "$first" == '#!'* ]] && [ "$second" = "$line" ]; }; then continue; fi
  if [ "${1:-}" != --add ]; then
    missing+=("$file")
  elif [[ "$first" == '#!'* ]]; then
    sed -i "1a$line" "$file"
  else
    { echo "$line"; cat "$file"; } >"$file.spdx" && cat "$file.spdx" >"$file" && rm "$file.spdx"
  fi
done
if [ "${#missing[@]}" -gt 0 ]; then
  printf '%s: no SPDX line; tools/spdx.sh --add adds it\n' "${missing[@]}" >&2
  exit 1
fi
