# SPDX-License-Identifier: BSD-3-Clause
"""Makes the modules of tools/experiments importable, for the tests of this folder."""
import pathlib
import sys

SOURCE = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(SOURCE / "tools" / "experiments"))


def touch(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("")
