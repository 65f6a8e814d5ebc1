"""Masks of moving or unwanted things, as plain 8-bit PNG files.

DIR/left/NAME.png and DIR/right/NAME.png, NAME being the stem of the left image; or DIR/NAME.png for
both cameras' masks when there is a right one as NAME_right.png, for the left camera alone when not.
0 means use; anything else (1, 255, instance numbers) means do not use.
"""

import os
from pathlib import Path
from typing import Optional, Tuple, Union

import numpy as np

from ._core import InputError, read_indexed


class MaskFolder:
    """The masks of a sequence, one or two files per frame."""

    def __init__(self, folder: Union[str, os.PathLike]) -> None:
        self.folder = Path(folder)
        self.missing = 0  #: frames without a mask so far
        if not self.folder.is_dir():
            raise InputError(f"{folder}: no such folder")
        if any(self.folder.glob("*.kysp")):
            raise InputError(f"{folder}: holds prior files; give it to --priors")
        if not any(self.folder.glob("*.png")) and not any(self.folder.glob("left/*.png")):
            raise InputError(f"{folder}: holds no masks (NAME.png, or left/NAME.png)")

    def __call__(self, name: str) -> Optional[Tuple[Optional[np.ndarray], Optional[np.ndarray]]]:
        """(left, right) masks of a frame, (H, W) uint8 or None; None: it has none."""
        choices = ((self.folder / "left" / f"{name}.png", self.folder / "right" / f"{name}.png"),
                   (self.folder / f"{name}.png", self.folder / f"{name}_right.png"))
        for left, right in choices:
            masks = tuple(read_indexed(p) if p.exists() else None for p in (left, right))
            if any(mask is not None for mask in masks):
                return masks
        self.missing += 1
        return None
