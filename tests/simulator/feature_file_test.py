# SPDX-License-Identifier: BSD-3-Clause
"""The Python reader of feature files against files of simulate_features. Arguments: the program,
the folder of the reader."""
import math
import os
import subprocess
import sys
import tempfile
import unittest

PROGRAM, TOOLS = sys.argv[1], sys.argv[2]
sys.path.insert(0, TOOLS)
try:
    import numpy as np
    from feature_file import FeatureFile, FeatureFileError
except ImportError as missing:
    print("skipped:", missing)
    sys.exit(77)


def make(folder, name, *options):
    """A straight drive of eight frames, 0.6 m each."""
    path = os.path.join(folder, "drive.txt")
    with open(path, "w", encoding="utf-8") as file:
        for i in range(8):
            file.write(f"1 0 0 0 0 1 0 0 0 0 1 {0.6 * i}\n")
    output = os.path.join(folder, name)
    subprocess.run([PROGRAM, path, "--output", output, "--features", "400", "--quiet", *options],
                   check=True, stdout=subprocess.DEVNULL)
    return output


def bits(a, b):
    return sum(bin(int(x) ^ int(y)).count("1") for x, y in zip(a, b))


class Files(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)

    def test_both_versions_hold_the_same_features(self):
        one = FeatureFile(make(self.folder.name, "one"))
        two = FeatureFile(make(self.folder.name, "two", "--perception", "exact"))
        self.assertEqual((one.version, two.version), (1, 2))
        self.assertTrue(np.array_equal(one.poses, two.poses))
        for a, b in zip(one.frames(), two.frames(), strict=True):
            for column in ("x", "y", "angle", "response", "octave", "landmark", "descriptors"):
                self.assertTrue(np.array_equal(getattr(a.left, column), getattr(b.left, column)))
                self.assertTrue(np.array_equal(getattr(a.right, column), getattr(b.right, column)))
            self.assertIsNone(a.left.label)
            self.assertEqual(len(b.left.label), len(b.left.x))

    def test_several_levels_of_perception_at_once_write_what_single_ones_write(self):
        traffic = ("--traffic", "light")
        single = [make(self.folder.name, level + "-alone", *traffic, "--perception", level)
                  for level in ("exact", "poor")]
        poor = os.path.join(self.folder.name, "poor")
        both = [make(self.folder.name, "exact", *traffic, "--perception", "exact,poor", "--output", poor),
                poor]
        for alone, together in zip(single, both):
            with open(alone, "rb") as a, open(together, "rb") as b:
                self.assertEqual(a.read(), b.read())
        with open(both[0], "rb") as a, open(both[1], "rb") as b:
            self.assertNotEqual(a.read(), b.read())

    def test_objects_project_to_their_features(self):
        file = FeatureFile(make(self.folder.name, "jam", "--traffic", "jam", "--perception",
                                "estimated"))
        objects, (position, owner, label) = file.truth()
        c = file.camera
        checked = 0
        for frame in file.frames():
            eye = file.poses[frame.index][1:4]  # the drive does not turn
            for i, landmark in enumerate(frame.left.landmark):
                if landmark < 0 or owner[landmark] < 0 or objects[owner[landmark]].kind == 2:
                    continue
                o = objects[owner[landmark]]
                pose = o.poses[0 if o.kind == 0 else frame.index - o.first_frame]
                q, t = pose[3:], pose[:3]
                v, w = q[:3], q[3]
                p = position[landmark].astype(float)
                p = p + 2 * np.cross(v, np.cross(v, p) + w * p) + t - eye
                error = math.hypot(c["fx"] * p[0] / p[2] + c["cx"] - frame.left.x[i],
                                   c["fy"] * p[1] / p[2] + c["cy"] - frame.left.y[i])
                self.assertLess(error, 2 + 1.5 * 1.2 ** float(frame.left.octave[i]))
                self.assertEqual(label[landmark], o.label)
                checked += 1
        self.assertGreater(checked, 20)

    def test_same_landmarks_look_alike(self):
        file = FeatureFile(make(self.folder.name, "one", "--traffic", "light", "--repeats", "0.5"))
        frame = next(file.frames())
        right = dict(zip(frame.right.landmark.tolist(), frame.right.descriptors))
        both = [bits(d, right[m]) for m, d in zip(frame.left.landmark.tolist(),
                                                 frame.left.descriptors) if m >= 0 and m in right]
        self.assertGreater(len(both), 30)
        self.assertLess(sum(both) / len(both), 50)

    def test_damage_is_noticed(self):
        path = make(self.folder.name, "bad", "--traffic", "light")
        with open(path, "rb") as file:
            good = file.read()
        for at in range(0, len(good), 1 + len(good) // 40):
            with open(path, "wb") as file:
                file.write(good[:at] + bytes([good[at] ^ 16]) + good[at + 1:])
            with self.assertRaises(FeatureFileError):
                damaged = FeatureFile(path)
                damaged.truth()
                list(damaged.frames())


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
