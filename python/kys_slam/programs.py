# SPDX-License-Identifier: BSD-3-Clause
"""C++ programs that commands of kys-slam call."""

import os
import shutil
import signal
import subprocess
import sys
from typing import List

from kys_slam import InputError


def find_program(name: str) -> str:
    """Its path: beside this command, where the build puts it (KYS_BIN_DIR), or on the path. Raises
    InputError when it is not installed."""
    beside = [str(os.path.dirname(os.path.realpath(sys.argv[0]))), os.environ.get("KYS_BIN_DIR", "")]
    found = shutil.which(name, path=os.pathsep.join(filter(None, beside))) or shutil.which(name)
    if not found:
        raise InputError(f"the program {name} is not installed: it is a part of the C++ programs, not of "
                         "the Python package (tools/maps/README.md)")
    return found


def run_program(call: List[str]) -> int:
    """Runs a program and returns its exit status. Ctrl-C is for it: it ends early, and writes what it
    has."""
    process = subprocess.Popen(call)
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        status = process.wait()
    finally:
        signal.signal(signal.SIGINT, before)
    return status if status >= 0 else 128 - status
