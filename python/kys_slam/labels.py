# SPDX-License-Identifier: BSD-3-Clause
"""Names of files as text. Standard library only: the tools outside the package use it too."""

import os
from typing import Union


def readable(text: str) -> str:
    """Text that can be drawn and written on one line: bytes that are not UTF-8 and control characters
    become U+FFFD."""
    text = text.encode("utf-8", "surrogatepass").decode("utf-8", "replace")
    return "".join(c if c.isprintable() else "\ufffd" for c in text)


def label_of(path: Union[str, os.PathLike]) -> str:
    """The last part of a path, readable."""
    return readable(os.path.basename(os.path.abspath(path)))
