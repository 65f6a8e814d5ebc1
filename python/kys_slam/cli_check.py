# SPDX-License-Identifier: BSD-3-Clause
"""The command `kys-slam check`: how well the pairs of a recording are rectified."""

import argparse
import json
from itertools import islice
from typing import Iterator, Optional

import numpy as np

import kys_slam
from kys_slam import InputError
from kys_slam.cli_errors import CANNOT_TELL, library_warns
from kys_slam.cli_input import correction_of, open_recording
from kys_slam.cli_output import must_be_new

_STRIDE = 10  #: frames of a stream between pairs: neighbours show the same


def check(args) -> int:
    """Returns an exit status: 3 when the pairs do not show enough."""
    if args.plot:
        must_be_new(args.plot, "--plot", args)
        kys_slam.check_writable(args.plot)
    with library_warns():
        recording = open_recording(argparse.Namespace(**{**vars(args), "frames": None}))
        if not recording.has_images:
            raise InputError(f"{recording.name}: holds features; the check needs images")
        result = _measure(recording, correction_of(args), args.frames)
    print(json.dumps(result.as_json(), indent=2) if args.json else result.as_text())
    if args.plot:
        from kys_slam.plot_rows import draw_rows
        draw_rows(result.first, result.field, result.verdict, args.plot)
        if not args.json:
            print(f"wrote {args.plot}")
    return CANNOT_TELL if result.kind == "unknown" else 0


class _Result:
    """What the pairs of a recording show."""

    def __init__(self, recording, field, problem: str, first: np.ndarray) -> None:
        self.name, self.length = recording.name, len(recording)
        self.field, self.problem, self.first = field, problem, first

    @property
    def kind(self) -> str:
        """"rectified", "not rectified", "not a pair" (swapped, not of one moment) or "unknown"."""
        if self.problem:
            return "not rectified" if "not rectified" in self.problem else "not a pair"
        return self.field.verdict

    @property
    def verdict(self) -> str:
        return self.problem or str(self.field)

    def as_json(self) -> dict:
        f = self.field

        def cells(values):
            return [[None if np.isnan(v) else round(float(v), 4) for v in row] for row in values]

        return {"recording": self.name, "pairs": f.pairs, "stereo_matches": f.stereo_matches,
                "rows_measured": len(f.matches), "matches_per_cell": f.counts.tolist(),
                "medians_px": cells(f.medians), "medians_after_px": cells(f.medians_after),
                "rows_sigma_before_px": f.sigma_before, "rows_sigma_after_px": f.sigma_after,
                "rows_field_px": f.field, "largest_px": f.largest,
                "largest_after_px": f.largest_after, "result": self.kind, "verdict": self.verdict}

    def as_text(self) -> str:
        f = self.field
        of = f" of {self.length}" if self.length else ""
        return "\n".join([
            f"  {'pairs':<22} {f.pairs}{of}",
            f"  {'stereo matches':<22} {f.stereo_matches}, {len(f.matches)} with a measured row",
            "", "  row in the right image less row in the left one, px, medians over the left image",
            "", *("  " + "".join(f"{'-' if np.isnan(v) else format(round(v, 2) + 0.0, '.2f'):>8}" for v in row)
                  for row in f.medians), "",
            f"  {'standard deviation':<22} {f.sigma_before:.2f} px, with the fitted correction "
            f"{f.sigma_after:.2f} px",
            f"  {'field':<22} {f.field:.2f} px (root mean square)", "", self.verdict])


def _measure(recording, correction: Optional[str], wanted: int) -> _Result:
    """correction: of the calibration, whose rest is measured."""
    meter, history = kys_slam.RowMeter(recording.camera, correction), kys_slam.PairHistory()
    first: Optional[np.ndarray] = None
    only = ""
    for frame in _pairs(recording, wanted):
        meter.add(frame.left, frame.right)
        history.check(frame.left, frame.right, frame.index)
        if first is None:
            first = np.array(frame.left)
            only = kys_slam.check_stereo_pair(frame.left, frame.right).problem
    if first is None:
        raise InputError(f"{recording.name}: holds no stereo pair")
    history.finish()
    field = meter.field()
    return _Result(recording, field, history.warning or (only if field.pairs == 1 else ""), first)


def _pairs(recording, wanted: int) -> Iterator:
    """Pairs spread over a sequence; the first ones of a stream, which is read in order."""
    total = len(recording)
    if isinstance(recording, kys_slam.Sequence):
        wanted = min(wanted, total)
        for i in range(wanted):
            yield recording.read((2 * i + 1) * total // (2 * wanted))
    else:
        stride = min(_STRIDE, max(1, total // wanted)) if total else _STRIDE
        yield from islice(recording, 0, wanted * stride, stride)
