#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""What can be said of packages without building them. The packages themselves: packaging/check_*.sh."""

import csv
import json
import re
import subprocess
import sys
import tempfile
import unittest
import zipfile
from pathlib import Path
from unittest import mock

sys.dont_write_bytecode = True
ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "packaging"))

import platform_calls  # noqa: E402
import sbom  # noqa: E402

ORIGIN = sbom.Origin("1.0", "pkg:deb/debian/libfmt9@1.0", b"its licence\n")
LIBRARY = "kys_slam.libs/libfmt-0123abcd.so.9.1.0"


def make_wheel(folder: Path, library: str = LIBRARY) -> Path:
    path = folder / "kys_slam-0.1.0-cp312-abi3-manylinux_2_35_x86_64.whl"
    with zipfile.ZipFile(path, "w") as wheel:
        wheel.writestr("kys_slam/__init__.py", "")
        wheel.writestr(library, "code")
        wheel.writestr("kys_slam-0.1.0.dist-info/WHEEL", "Wheel-Version: 1.0\n")
        wheel.writestr("kys_slam-0.1.0.dist-info/RECORD", "")
        wheel.writestr("kys_slam-0.1.0.dist-info/sboms/auditwheel.cdx.json", "{}")
    return path


class Contents(unittest.TestCase):
    def setUp(self):
        self.temporary = tempfile.TemporaryDirectory()
        self.addCleanup(self.temporary.cleanup)
        self.folder = Path(self.temporary.name)
        for name in ("deb_origin", "origin_of"):
            patch = mock.patch.object(sbom, name, return_value=ORIGIN)
            patch.start()
            self.addCleanup(patch.stop)
        patch = mock.patch.object(sbom, "owner_of", return_value="libfmt9")
        self.owner = patch.start()
        self.addCleanup(patch.stop)

    def test_a_wheel_lists_what_it_carries(self):
        try:
            from wheel.wheelfile import WheelFile
        except ImportError:
            self.skipTest("needs the package wheel")
        path = make_wheel(self.folder)
        sbom.complete_wheel(path)
        self.owner.assert_called_once_with("libfmt.so.9.1.0")
        with WheelFile(path) as wheel:  # checks the sums in RECORD at every read
            names = [n for n in wheel.namelist() if not n.endswith("RECORD")]
            for name in names:
                wheel.read(name)
            listed = json.loads(wheel.read("kys_slam-0.1.0.dist-info/sboms/kys-slam.cdx.json"))
            text = wheel.read("kys_slam-0.1.0.dist-info/licenses/bundled/fmt.txt")
        self.assertNotIn("kys_slam-0.1.0.dist-info/sboms/auditwheel.cdx.json", names)
        self.assertEqual(text, ORIGIN.text)
        fmt = [c for c in listed["components"] if c["name"] == "fmt"]
        self.assertEqual(len(fmt), 1)
        self.assertEqual(fmt[0]["hashes"][0]["content"],
                         "5694d08a2e53ffcae0c3103e5ad6f6076abd960eb1f8a56577040bc1028f702b")  # of "code"
        self.assertEqual(listed["metadata"]["component"]["version"], "0.1.0")
        self.assertIn("Eigen", [c["name"] for c in listed["components"]])

    def test_a_library_that_the_table_does_not_know_is_an_error(self):
        for library in ("kys_slam.libs/libgdal-0123abcd.so.32", "kys_slam.libs/libfmt.so.9"):
            with self.assertRaisesRegex(sbom.InputError, re.escape(library)):
                sbom.complete_wheel(make_wheel(self.folder, library))

    def test_nothing_under_the_gpl_goes_into_a_wheel(self):
        for licence in ("GPL-2.0-or-later", "LGPL-2.1-or-later", "MIT AND GPL-3.0-only"):
            table = [sbom.Component("fmt", licence, "libfmt", "libfmt-dev", [])]
            with mock.patch.object(sbom, "read_components", return_value=table):
                with self.assertRaisesRegex(sbom.InputError, "fmt is under"):
                    sbom.complete_wheel(make_wheel(self.folder))

    def test_a_package_lists_what_is_compiled_in(self):
        names = [c["name"] for c in json.loads(sbom.package_list("kys-slam-maps"))["components"]]
        self.assertIn("Ceres Solver", names)
        self.assertNotIn("dlib", names)
        with self.assertRaises(sbom.InputError):
            sbom.package_list("kys-slam-nothing")


class Tables(unittest.TestCase):
    def test_components_are_complete(self):
        with open(ROOT / "packaging" / "components.csv", encoding="ascii", newline="") as file:
            rows = list(csv.DictReader(file))
        self.assertEqual(len(rows), len({r["name"] for r in rows}))
        for row in rows:
            self.assertTrue(row["licence"] and row["source"], row)
            self.assertTrue(row["library"] or row["packages"], row)

    def test_what_one_architecture_needs_is_listed_there_alone(self):
        names = [{c.name for c in sbom.read_components(m)} for m in ("x86_64", "aarch64")]
        self.assertEqual(names[1] - names[0], {"SIMDe"})
        self.assertEqual(names[0] - names[1], set())

    def test_the_gpl_is_in_the_package_that_says_so_alone(self):
        under = [c for c in sbom.read_components() if "GPL" in c.licence]
        self.assertEqual([c.name for c in under], ["SuiteSparse"])
        self.assertEqual(under[0].packages, ["kys-slam-maps"])
        text = (ROOT / "third_party" / "debian" / "copyright.maps").read_text(encoding="utf-8")
        self.assertIn("GPL-3+", text)

    def test_every_debian_package_has_a_list(self):
        cmake = "".join((ROOT / "third_party" / "cmake" / f).read_text(encoding="utf-8")
                        for f in ("KysPackage.cmake", "KysPythonPackage.cmake"))
        packages = set(re.findall(r"^\s*kys_debian_package\((\S+)", cmake, re.M))
        self.assertGreater(len(packages), 1)
        listed = {p for c in sbom.read_components() for p in c.packages} - {"wheel"}
        self.assertEqual(packages, listed)

    def test_calls_of_the_operating_system_are_where_the_readme_says(self):
        self.assertEqual(platform_calls.found(), platform_calls.named())


class Release(unittest.TestCase):
    def run_step(self, *arguments: str, dist: str = ""):
        return subprocess.run([str(ROOT / "packaging" / "make_release.sh"), *arguments], check=False, text=True,
                              capture_output=True, env={"PATH": "/usr/bin:/bin", "DIST": dist})

    def test_every_file_says_the_same_version(self):
        done = self.run_step("version")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertRegex(done.stdout, r"^version \d+\.\d+\.\d+\n$")

    def test_a_tag_of_another_version_is_refused(self):
        done = self.run_step("version", "v99.0.0")
        self.assertEqual(done.returncode, 2)
        self.assertIn("the tag is v99.0.0", done.stderr)

    def test_the_notes_are_those_of_this_version(self):
        with tempfile.TemporaryDirectory() as folder:
            done = self.run_step("notes", dist=folder)
            self.assertEqual(done.returncode, 0, done.stderr)
            notes = (Path(folder) / "notes.md").read_text(encoding="utf-8")
        self.assertIn("### Added", notes)
        self.assertIn(notes.strip(), (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"))
        self.assertNotRegex(notes, r"(?m)^## ")


if __name__ == "__main__":
    unittest.main()
