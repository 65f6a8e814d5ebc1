#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Whether the messages that troubleshooting.md lists are those of the programs.

    check_messages.py
"""

import re
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
SOURCES = ("src", "priors", "python/kys_slam", "tools")
SHORTEST = 8  # characters of a part that is looked up


def texts() -> str:
    """All sources, with the string literals that follow each other joined."""
    files = [f for folder in SOURCES for f in sorted((HERE.parent / folder).rglob("*"))
             if f.suffix in (".cpp", ".h", ".py")]
    text = "\n".join(f.read_text(encoding="utf-8") for f in files)
    return re.sub(r'"\s*(?:\+\s*)?\n\s*f?"', "", text)


def parts(message: str):
    """What is not a value: between dots, numbers and the N that stands for one."""
    for part in re.split(r"\.\.\.|\.?[a-z]*\b[\d][\w.+-]*|\bN\b|\(\.\w+\)|\w+\.json", message):
        part = part.strip(" :;,%")
        if len(part) >= SHORTEST:
            yield part


def main() -> int:
    rows = re.findall(r"^\| (`.*?) \|", (HERE / "troubleshooting.md").read_text(encoding="utf-8"), re.M)
    messages = [m for row in rows for m in re.findall(r"`([^`]+)`", row)]
    source = texts()
    wrong = [f"{message}: '{part}' is in no source" for message in messages for part in parts(message)
             if part not in source]
    empty = [message for message in messages if not list(parts(message))]
    for line in wrong + [f"{message}: nothing to look up" for message in empty]:
        print(f"troubleshooting.md: {line}", file=sys.stderr)
    print(f"{len(messages)} messages")
    return 1 if wrong or empty or len(messages) < 20 else 0


if __name__ == "__main__":
    sys.exit(main())
