# SPDX-License-Identifier: BSD-3-Clause
"""Masks of moving or unwanted objects, as plain 8-bit PNG files.

DIR/left/NAME.png and DIR/right/NAME.png, NAME being the stem of the left image; or DIR/NAME.png for
both cameras' masks when there is a right one as NAME_right.png, for the left camera alone when not.
0 means use; anything else (1, 255, instance numbers) means do not use.

With a list of classes, DIR/classes.txt, the images are priors: a line per value or range of values,

    1-50   car moving      # instances 1 to 50; "moving": these move, others stand
    51-99  person
    200    road            # stuff

Classes are those of the label space; values that are not listed mean do not use, as above. Without
"moving" in any line, whether anything moves is not known.
"""

from pathlib import Path
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np

from ._core import InputError, LabelSpace, read_indexed
from .files import PathLike
from .priors import PriorFrame, priors_from_labels

Masks = Tuple[Optional[np.ndarray], Optional[np.ndarray]]  #: left, right; None: use all pixels


class FixedMasks:
    """One mask for all frames of a camera: what it always sees of its own vehicle."""

    def __init__(self, files: Sequence[PathLike], size: Tuple[int, int]) -> None:
        """files: of the left camera, or of both. size: (width, height) of the images, px."""
        self.masks: List[Optional[np.ndarray]] = [None, None]
        for side, file in enumerate(files):
            mask = read_indexed(file)
            if mask.shape != size[::-1]:
                raise InputError(f"{file}: a mask of {mask.shape[1]}x{mask.shape[0]} px; images are "
                                 f"{size[0]}x{size[1]}")
            self.masks[side] = mask

    def add_to(self, masks: Optional[Masks]) -> Masks:
        """Those of a frame, or of none, and these."""
        pairs = zip(masks or (None, None), self.masks)
        left, right = (b if a is None else a if b is None else np.maximum(a, b) for a, b in pairs)
        return left, right


class MaskFolder:
    """The masks of a sequence, one or two files per frame."""

    def __init__(self, folder: PathLike,
                 label_space: str = "coco_panoptic_133") -> None:
        self.folder = Path(folder)
        self.classes: Dict[int, int] = {}  #: values that are priors: class id; empty: all are masks
        self.moving: Tuple[int, ...] = ()  #: values of what moves; empty: not known
        self.missing = 0  #: frames without a mask so far
        self.warning = ""  #: the first of these
        if not self.folder.is_dir():
            raise InputError(f"{folder}: no such folder")
        if any(self.folder.glob("*.kysp")):
            raise InputError(f"{folder}: holds prior files; give it to --priors")
        if not any(self.folder.glob("*.png")) and not any(self.folder.glob("left/*.png")):
            raise InputError(f"{folder}: holds no masks (NAME.png, or left/NAME.png)")
        if (self.folder / "classes.txt").exists():
            self._space = LabelSpace(label_space)
            self._read_classes(self.folder / "classes.txt")

    def _read_classes(self, file: Path) -> None:
        ids = dict(zip(self._space.names, self._space.ids))
        moving = []
        for number, line in enumerate(file.read_text(errors="replace").splitlines(), 1):
            words = line.partition("#")[0].split()
            if not words:
                continue
            first, _, last = words[0].partition("-")
            moves = words[-1] == "moving"
            name = " ".join(words[1:len(words) - moves])
            if not (first.isdecimal() and (last or first).isdecimal() and
                    0 < int(first) <= int(last or first) <= 255):
                raise InputError(f"{file}:{number}: '{words[0]}' is no value of 1 to 255, no range")
            if name not in ids:
                raise InputError(f"{file}:{number}: '{name}' is no class of {self._space.name}")
            for value in range(int(first), int(last or first) + 1):
                if value in self.classes:
                    raise InputError(f"{file}:{number}: value {value} is there twice")
                self.classes[value] = ids[name]
                if moves:
                    moving.append(value)
        self.moving = tuple(moving)

    def priors(self, masks: Tuple[np.ndarray, np.ndarray]) -> PriorFrame:
        """Priors of the values that the list of classes has."""
        if any(mask is None for mask in masks):
            raise InputError(f"{self.folder}: priors need images of both cameras")
        table = np.full(256, -1)
        table[list(self.classes)] = list(self.classes.values())
        return priors_from_labels(self._space, *(table[m] for m in masks),
                                  *(np.where(table[m] < 0, 0, m) for m in masks),
                                  moving=self.moving or None)

    def without_classes(self, masks: Tuple[np.ndarray, np.ndarray]) -> Tuple:
        """Masks of the values that the list of classes does not have."""
        listed = np.zeros(256, bool)
        listed[list(self.classes)] = True
        return tuple(None if m is None else np.where(listed[m], 0, m).astype(np.uint8) for m in masks)

    def __call__(self, name: str) -> Optional[Tuple[Optional[np.ndarray], Optional[np.ndarray]]]:
        """(left, right) masks of a frame, (H, W) uint8 or None; None: it has none."""
        choices = ((self.folder / "left" / f"{name}.png", self.folder / "right" / f"{name}.png"),
                   (self.folder / f"{name}.png", self.folder / f"{name}_right.png"))
        for left, right in choices:
            masks = tuple(read_indexed(p) if p.exists() else None for p in (left, right))
            if any(mask is not None for mask in masks):
                return masks
        self.missing += 1
        self.warning = self.warning or (f"{self.folder}: no mask for frame {name} (left/{name}.png or "
                                        f"{name}.png); without one all of a frame is used")
        return None
