# SPDX-License-Identifier: BSD-3-Clause
"""object_breaks.py: why an object is not followed, on prior files and labels that are made up."""
import pathlib
import sys
import tempfile
import unittest

SOURCE = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(SOURCE / "tools" / "evaluation"))
try:
    import numpy as np

    import object_breaks
    from object_breaks import inputs, kysp
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

CAR, PERSON, ROAD = 13, 11, 0  # cityscapes_19
BOX = [20.0, 10.0, 39.0, 29.0]  # px, 20 x 20


class Breaks(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folder = pathlib.Path(temporary.name)

    def things(self, *things):
        """A picture of 200 x 60 px with things: (label, instance, x0, y0, x1, y1, flags)."""
        segments = np.zeros(len(things) + 1, kysp.SEGMENT)
        segments[0]["label"] = ROAD
        pixels = np.ones((60, 200), np.uint16)
        for k, (label, instance, x0, y0, x1, y1, flags) in enumerate(things, 2):
            segments[k - 1]["label"], segments[k - 1]["instance"] = label, instance
            segments[k - 1]["flags"] = kysp.THING | flags
            pixels[y0:y1, x0:x1] = k
        file = self.folder / "0.kysp"
        kysp.write(file, kysp.Frame("cityscapes_19", [kysp.Camera(
            segments, pixels, np.zeros(pixels.shape, np.float32))], has_motion=True))
        return object_breaks.Things(file, {CAR, PERSON})

    def cause(self, things, last=None, estimate=None, name=70000):
        return object_breaks.cause_of(things, things.on(BOX), last, estimate, name)

    def test_causes(self):
        whole = self.things((CAR, 70000, 20, 10, 40, 30, 0))
        self.assertEqual(self.cause(whole, estimate=70000), "")
        self.assertEqual(self.cause(whole), "standing")
        self.assertEqual(self.cause(whole, estimate=70001), "other name")
        self.assertEqual(self.cause(whole, last=(70001, CAR)), "renamed")
        self.assertEqual(self.cause(whole, last=(70001, PERSON)), "class")
        self.assertEqual(self.cause(whole, last=(70000, PERSON)), "standing")
        self.assertEqual(self.cause(self.things((CAR, 70000, 60, 10, 80, 30, 0))), "no segment")
        self.assertEqual(self.cause(self.things((CAR, 70000, 20, 10, 80, 30, 0))), "merged")
        parts = ((CAR, 70000, 20, 10, 40, 25, 0), (PERSON, 70001, 20, 25, 40, 30, 0))
        self.assertEqual(self.cause(self.things(*parts)), "in parts")
        self.assertEqual(self.cause(self.things(parts[0], (PERSON, 70000, 20, 25, 40, 30, 0))), "standing")
        self.assertEqual(self.cause(self.things(parts[0], (PERSON, 70001, 20, 29, 25, 30, 0))), "standing",
                         "a few pixels")

    def test_what_stands_is_beside_the_movers(self):
        things = self.things((CAR, 70000, 20, 10, 40, 30, kysp.DYNAMIC), (CAR, 70001, 50, 10, 90, 30, 0),
                             (CAR, 70002, 100, 10, 140, 30, kysp.DYNAMIC), (PERSON, 70003, 150, 10, 160, 25, 0))
        labels = {(0, 0): BOX, (7, 0): [100.0, 10.0, 139.0, 29.0]}
        count, flagged = object_breaks.standing(labels, {0}, lambda _: things, [0])
        # The second car is within 20 px of the mover, the person below 200 px.
        self.assertEqual((count, [things.segments[k - 1]["instance"] for _, k in flagged]), (1, [70002]))

    def test_labels(self):
        file = self.folder / "labels.txt"
        row = "0 5 Van 0 0 -1.79 20 10 39 29 2.0 1.8 4.4 -4.5 1.9 13.4 -2.1\n"
        file.write_text(row + "0 -1 DontCare -1 -1 -10 1 2 3 4 -1 -1 -1 -1000 -1000 -1000 -10\n")
        self.assertEqual(object_breaks.read_labels(file), {(5, 0): BOX})
        for wrong in (row.replace("39", "nan"), row.replace("20 10 39 29", "20 10"), "x " + row, "0 5\n"):
            file.write_text(row + wrong)
            with self.assertRaisesRegex(inputs.InputError, "labels.txt:2"):
                object_breaks.read_labels(file)
        with self.assertRaisesRegex(inputs.InputError, "none.txt"):
            object_breaks.read_labels(self.folder / "none.txt")

    def test_parts(self):
        self.assertEqual(object_breaks.part_of("3:40"), (3, 40))
        for wrong in ("3", "a:4", "4:3", "-1:4"):
            with self.assertRaises(ValueError):
                object_breaks.part_of(wrong)


if __name__ == "__main__":
    unittest.main()
