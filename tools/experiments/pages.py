#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Puts tables of a report (report.py) into pages, so that no figure of them is typed.

    pages.py WORK PAGE.md...

In a page stands, for every table, a line <!-- table NAME -->, what this program put there before,
and a line <!-- end -->. NAME is that of WORK/tables/NAME.md. Tables that the report does not have stay
as they are: their version is beside them. Prints how many tables each page got.
"""
import os
import re
import sys

from runs import InputError, read_plan, write_text

BLOCK = re.compile(r"(<!-- table (\S+) -->\n)(.*?)(<!-- end -->\n)", re.S)


def content(table, version):
    """The table without its heading, and below it the version and its note."""
    title, _, rest = table.partition("\n")
    rows, _, note = rest.strip().partition("\n\n")
    said = f"{title.lstrip('# ')}. Version `{version}`." + (f" {note}" if note else "")
    return f"\n{rows}\n\n{said.strip()}\n\n"


def fill(text, read, version):
    """The text of a page with the tables that `read` has (None: it has no such table), and their number."""
    if text.count("<!-- table ") != len(BLOCK.findall(text)):
        raise InputError("a line <!-- table NAME --> without <!-- end -->")
    count = 0

    def put(match):
        nonlocal count
        table = read(match[2])
        if table is None:
            return match[0]
        count += 1
        return match[1] + content(table, version) + match[4]
    return BLOCK.sub(put, text), count


def main():
    if len(sys.argv) < 3:
        print(__doc__, file=sys.stderr)
        return 2
    work, pages = sys.argv[1], sys.argv[2:]

    def read(name):
        path = os.path.join(work, "tables", name + ".md")
        if not os.path.exists(path):
            return None
        with open(path, encoding="utf-8") as file:
            return file.read()
    try:
        version = read_plan(work, "version")["version"]
        if not version:
            raise InputError("the plan names no version: it was not made in a clone")
        for page in pages:
            with open(page, encoding="utf-8") as file:
                before = file.read()
            try:
                text, count = fill(before, read, version)
            except InputError as error:
                raise InputError(f"{page}: {error}") from None
            if text != before:
                write_text(page, text)
            print(f"{page}: {count} tables")
    except (InputError, OSError) as error:
        print(f"pages.py: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
