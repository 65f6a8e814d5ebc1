# SPDX-License-Identifier: BSD-3-Clause
"""Paths and files as the modules of the package take them."""

import os
from pathlib import Path
from typing import Union

from ._core import InputError

PathLike = Union[str, os.PathLike]


def read_bytes(path: PathLike) -> bytes:
    """The content of a file. Raises InputError when it cannot be read."""
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None
