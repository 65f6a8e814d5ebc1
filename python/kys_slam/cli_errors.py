# SPDX-License-Identifier: BSD-3-Clause
"""Exit statuses and messages of kys-slam."""

import contextlib
import logging
import os
import sys
import traceback
from pathlib import Path
from typing import Iterator, List, Tuple

from kys_slam import InputError

BAD_INPUT, TRACKING_FAILED, DEFECT, INTERRUPTED = 2, 3, 70, 130
CANNOT_TELL = 3  #: of `check`: too few matches


def describe(error: BaseException) -> Tuple[int, str]:
    """Exit status and message of what went wrong, as the C++ programs have them."""
    if isinstance(error, OSError):
        where = f"{os.fsdecode(error.filename)}: " if error.filename else ""
        return BAD_INPUT, f"{where}{error.strerror or error}"
    if isinstance(error, MemoryError):
        return BAD_INPUT, "out of memory"
    text = " ".join(str(error).split())
    if isinstance(error, InputError):
        return BAD_INPUT, text
    at = traceback.extract_tb(error.__traceback__)[-1]
    return DEFECT, (f"a defect of the program: {type(error).__name__}: {text} "
                    f"({Path(at.filename).name}:{at.lineno})")


def interrupted() -> int:
    """Says so; there are no results."""
    print("kys-slam: interrupted", file=sys.stderr)
    return INTERRUPTED


def warn(message: str) -> None:
    """One line of stderr; the run goes on."""
    print(f"kys-slam: warning: {message}", file=sys.stderr, flush=True)


class _Warnings(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        warn(record.getMessage())


@contextlib.contextmanager
def library_warns() -> Iterator[None]:
    """What the package logs looks like the other warnings of the command."""
    logger, handler = logging.getLogger("kys_slam"), _Warnings()
    logger.addHandler(handler)
    before, logger.propagate = logger.propagate, False
    try:
        yield
    finally:
        logger.propagate = before
        logger.removeHandler(handler)


class Failures:
    """What goes wrong during a run; the run goes on to save what there is."""

    def __init__(self) -> None:
        self.status = 0
        self.messages: List[str] = []

    @contextlib.contextmanager
    def guard(self) -> Iterator[None]:
        """Notes what one step raises."""
        try:
            yield
        except Exception as error:
            status, message = describe(error)
            self.status = self.status or status
            if message not in self.messages:
                self.messages.append(message)

    def print(self) -> None:
        """Each message on one line of stderr."""
        for message in self.messages:
            print(f"kys-slam: {message}", file=sys.stderr)
