#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# The steps of a release, in this order; .github/workflows/release.yml runs the same.
#   packaging/make_release.sh version [TAG]   do all files say the same version? And the tag, and has the
#                                             changelog a date for it?
#   packaging/make_release.sh test [OPTION...]  the README's test command; with options, ctest on a built tree
#   packaging/make_release.sh wheels    for each of PYTHONS (default: python3, and python3.12 if there is one)
#   packaging/make_release.sh debs
#   packaging/make_release.sh source    the tracked files
#   packaging/make_release.sh check     wheels and packages on new Debian systems; as root, needs mmdebstrap
#   packaging/make_release.sh notes     the changelog of this version
#   packaging/make_release.sh checksums
#   packaging/make_release.sh all [TAG]
# The files are in build/dist (or DIST), the systems in build/roots (or ROOTS). Nothing is published.
set -euo pipefail
cd "$(dirname "$0")/.."
step=${1:-}
dist=${DIST:-build/dist}
roots=${ROOTS:-build/roots}
version=$(sed -n 's/^project(kys_slam VERSION \([0-9.]*\).*/\1/p' CMakeLists.txt)
shopt -s nullglob

fail() { echo "make_release.sh: $*" >&2; exit 2; }

changes_of() { awk -v heading="[$1]" '/^## / {inside = ($2 == heading); next} inside' CHANGELOG.md; }

check_version() {  # [TAG]
  local file found
  while read -r file found; do
    [ "$found" = "$version" ] || fail "$file says ${found:-nothing}, CMakeLists.txt $version"
  done <<FOUND
pyproject.toml $(sed -n 's/^version = "\(.*\)"$/\1/p' pyproject.toml)
CITATION.cff $(sed -n 's/^version: //p' CITATION.cff)
kys/CMakeLists.txt $(sed -n 's/^project(kys VERSION \([0-9.]*\).*/\1/p' kys/CMakeLists.txt)
ros/package.xml $(sed -n 's/.*<version>\(.*\)<\/version>.*/\1/p' ros/package.xml)
CHANGELOG.md $(sed -n 's/^## \[\([0-9][0-9.]*\)\].*/\1/p' CHANGELOG.md | head -1)
FOUND
  if [ $# -gt 0 ]; then
    [ "$1" = "v$version" ] || fail "the tag is $1, the version $version"
    grep -qE "^## \\[${version//./\\.}\\] - [0-9]{4}-[0-9]{2}-[0-9]{2}\$" CHANGELOG.md ||
      fail "CHANGELOG.md has no date for $version"
    [ -z "$(changes_of Unreleased)" ] || fail "CHANGELOG.md has changes under [Unreleased]"
  fi
  echo "version $version"
}

make_wheels() {
  local pythons
  read -r -a pythons <<<"${PYTHONS:-python3 $(command -v python3.12 || true)}"
  rm -f "$dist"/*.whl
  packaging/make_wheel.sh "$dist" "${pythons[@]}"
}

make_source() {
  mkdir -p "$dist"
  git archive --format=tar --prefix="kys-slam-$version/" HEAD | gzip -9n >"$dist/kys-slam-$version.tar.gz"
}

make_notes() {
  mkdir -p "$dist"
  changes_of "$version" >"$dist/notes.md"
  grep -q . "$dist/notes.md" || fail "CHANGELOG.md has nothing for $version"
}

make_checksums() {
  (cd "$dist" && sha256sum -- *.whl *.deb *.tar.gz >SHA256SUMS && cat SHA256SUMS)
}

check() {
  packaging/check_wheel_root.sh "$dist" "$roots"
  packaging/check_debs.sh "$dist" "$roots"
  packaging/check_clean_root.sh "$dist" "$roots"
}

case "$step" in
  version) check_version "${@:2}" ;;
  test) if [ $# -gt 1 ]; then ctest --preset release "${@:2}"; else tools/check.sh test; fi ;;
  wheels) make_wheels ;;
  debs) rm -f "$dist"/*.deb && packaging/make_debs.sh "$dist" ;;
  source) make_source ;;
  check) check ;;
  notes) make_notes ;;
  checksums) make_checksums ;;
  all)
    "$0" version "${@:2}"
    for each in test wheels debs source check notes checksums; do "$0" "$each"; done
    ;;
  *)
    sed -n '2,/^set/{/^# SPDX/d;/^#/s/^# \{0,1\}//p}' "$0" >&2
    exit 2
    ;;
esac
