# SPDX-License-Identifier: BSD-3-Clause
"""Do calls of POSIX and Linux stay in the files that packaging/README.md names? Exit status 1 if not.

A file counts that includes a header of POSIX or of the GNU C library, or imports a module of Python that
Windows lacks. Tests and benchmarks are left out.
"""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = ("include", "kys", "priors", "python", "src", "tools")
HEADERS = re.compile(r"^\s*#\s*include <(sys/\w+|linux/\w+|unistd|fcntl|poll|dirent|malloc|pthread|sched|dlfcn|spawn|"
                     r"termios|execinfo|glob|netdb|arpa/\w+)\.h>", re.M)
MODULES = re.compile(r"^\s*(?:import|from) (fcntl|resource|termios|pwd|grp|pty|tty)\b", re.M)


def found() -> set:
    files = set()
    for folder in FOLDERS:
        for path in (ROOT / folder).rglob("*"):
            pattern = MODULES if path.suffix == ".py" else HEADERS
            name = path.relative_to(ROOT).as_posix()
            if path.suffix in (".h", ".cpp", ".inc", ".py") and "/tests/" not in name:
                if pattern.search(path.read_text(encoding="utf-8")):
                    files.add(name)
    return files


def named() -> set:
    text = (ROOT / "packaging" / "README.md").read_text(encoding="utf-8")
    table = text.split("<!-- platform calls -->")[1]
    return set(re.findall(r"`([\w/]+\.(?:h|cpp|inc|py))`", table))


def main() -> int:
    calls, listed = found(), named()
    for name in sorted(calls - listed):
        print(f"{name}: calls the operating system, and packaging/README.md does not name it")
    for name in sorted(listed - calls):
        print(f"{name}: is named in packaging/README.md, and has no such call")
    return 0 if calls == listed and calls else 1


if __name__ == "__main__":
    sys.exit(main())
