# SPDX-License-Identifier: BSD-3-Clause
"""The programs that a plan runs (plan.py)."""
import re
import subprocess

from runs import InputError, digest, find_program


class Programs:
    """The programs, what they are (a digest), and what the run programs know."""

    def __init__(self, folder):
        self.folder = folder
        self._digests = {}
        run = self.path("run_stereo_kitti")
        listed = subprocess.run([run, "--list-settings"], capture_output=True, text=True, check=True)
        self.settings = self._keys(listed.stdout)
        match = re.search(r"^  mode: \w+ +# (.*)$", listed.stdout, re.MULTILINE)
        if match is None:
            raise InputError(f"{run}: --list-settings names no modes")
        self.modes = set(re.split(", | or ", match[1]))

    @staticmethod
    def _keys(text):
        keys, group = set(), ""
        for line in text.splitlines():
            key = line.split("#")[0].partition(":")[0]
            if key and not key.startswith(" "):
                group = key.strip()
            elif key.strip():
                keys.add(f"{group}.{key.strip()}")
        return keys

    def path(self, name):
        return find_program(self.folder, name)

    def key(self, name):
        if name not in self._digests:
            self._digests[name] = digest(self.path(name))
        return self._digests[name]
