# SPDX-License-Identifier: BSD-3-Clause
"""Output of kys-slam: the folder of a run, files that are not overwritten, recorders."""

import os
from pathlib import Path

from kys_slam import InputError

RUN_FILES = ("summary.json", "trajectory.tum", "frames.csv")


def must_be_new(file: str, option: str, args) -> None:
    """Raises InputError for a file that exists, unless --overwrite is given."""
    if Path(file).exists() and not args.overwrite:
        raise InputError(f"{file}: is there already; --overwrite, or another {option}")


def output_folder(args, name: str, mode: str) -> Path:
    """The folder of the results, made if it does not exist. Raises InputError when it holds another run or
    cannot be written."""
    if args.output:
        folder = Path(args.output)
        if not args.overwrite and any((folder / f).exists() for f in RUN_FILES):
            raise InputError(f"{folder}: holds another run; --overwrite, or another --output")
    else:
        folder = Path("runs") / f"{name}-{mode}"
        number = 2
        while not args.overwrite and folder.exists() and any(folder.iterdir()):
            folder = Path("runs") / f"{name}-{mode}-{number}"
            number += 1
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot write {folder}: {error.strerror}") from None
    if not os.access(folder, os.W_OK):
        raise InputError(f"cannot write {folder}")
    return folder


def open_recorders(args, slam) -> list:
    """Recorders of --record and --view. When one cannot be opened, the others remove their files."""
    if not args.view and not args.record:
        return []
    from kys_slam.record import VIEWER, open_recorder
    recorders: list = []
    try:
        for target in args.record + ([VIEWER] if args.view else []):
            recorders.append(open_recorder(target, slam))
    except BaseException:
        for recorder in recorders:
            recorder.discard()
        raise
    return recorders
