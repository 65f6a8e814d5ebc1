# SPDX-License-Identifier: BSD-3-Clause
"""kysp.py against the C++ programs: `exchange FILE` of priors_exchange reads a file with the C++
reader and writes it again with the C++ writer."""

import os
import struct
import subprocess
import sys
import tempfile
import unittest
import zlib

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(__file__), "..", "..", "python", "kys_slam"))
import kysp  # noqa: E402

EXCHANGE = os.environ.get("KYS_PRIORS_EXCHANGE", "")


def example(seed=0, width=211, height=57):
    random = np.random.default_rng(seed)
    frame = kysp.Frame("coco_panoptic_133", [], 0x0123456789ABCDEF, 77, True, seed % 2 == 0)
    for c in range(2):
        segments = np.zeros(5, kysp.SEGMENT)
        segments["label"] = [100, 101, 2, 2, 7]
        segments["flags"] = [0, 9, 1, 3, 7]
        segments["instance"] = np.arange(5) + c * kysp.RIGHT_INSTANCES
        segments["scale"] = [1e6, 2e6, 300, 0, 12.5]
        segments["score"] = [0, 0, 0, 55, 3]
        map_ = np.repeat(random.integers(0, 6, (height, width // 7 + 1)), 7, axis=1)[:, :width]
        codes = random.integers(0, 256, (height, width))
        frame.cameras.append(
            kysp.Camera(segments, map_.astype(np.uint16), kysp.MOTION[codes]))
    return frame


class KyspTest(unittest.TestCase):
    def check_equal(self, a, b):
        self.assertEqual((a.label_space, a.calibration_hash, a.content_key, a.has_motion,
                          a.shares_instances),
                         (b.label_space, b.calibration_hash, b.content_key, b.has_motion,
                          b.shares_instances))
        for left, right in zip(a.cameras, b.cameras):
            np.testing.assert_array_equal(left.segment_map, right.segment_map)
            for name in ("label", "flags", "instance", "scale", "score"):
                np.testing.assert_array_equal(left.segments[name], right.segments[name])
            moving = np.isin(left.segment_map, [4, 5])
            np.testing.assert_array_equal(left.motion[moving], right.motion[moving])
            self.assertEqual(float(np.abs(right.motion[~moving]).max()), 0.0)

    def test_round_trip_in_python(self):
        frame = example()
        self.check_equal(frame, kysp.decode(kysp.encode(frame)))

    @unittest.skipUnless(EXCHANGE, "the C++ program is not built")
    def test_round_trip_through_cpp(self):
        frame = example(3)
        with tempfile.TemporaryDirectory() as folder:
            ours, theirs = os.path.join(folder, "a.kysp"), os.path.join(folder, "b.kysp")
            kysp.write(ours, frame)
            subprocess.run([EXCHANGE, ours, theirs], check=True)
            self.check_equal(frame, kysp.read(theirs))
            with open(ours, "rb") as a, open(theirs, "rb") as b:
                self.assertEqual(a.read(), b.read())  # same runs, same bytes

    def test_gates_are_kept(self):
        values = np.array([8.0, np.nextafter(np.float32(8), np.float32(9)), 20.0, 20.01, 0, 100],
                          np.float32)
        decoded = kysp.MOTION[kysp._motion_codes(values)]
        np.testing.assert_array_equal(decoded > 8, values > 8)
        np.testing.assert_array_equal(decoded > 20, values > 20)

    def test_what_readers_refuse_is_not_written(self):
        def wrong(said, change, c=0):
            frame = example()
            change(frame, frame.cameras[c])
            with self.assertRaisesRegex(ValueError, said):
                kysp.encode(frame)

        def segment(field, value, c=0, k=0):
            wrong(field, lambda frame, camera: camera.segments[field].__setitem__(k, value), c)

        def put(name, value):
            return lambda frame, camera: setattr(camera if hasattr(camera, name) else frame, name, value)

        segment("label", kysp.VOID_LABEL)
        segment("flags", 16)
        wrong("radial-only", lambda frame, camera: camera.segments["flags"].__setitem__(0, 4))
        segment("instance", -1)
        segment("instance", kysp.RIGHT_INSTANCES)
        segment("instance", 5, c=1)
        for field in ("scale", "score"):
            for value in (np.nan, np.inf, -1):
                segment(field, value)
        segment("score", 100.5)
        moving = np.isin(example().cameras[0].segment_map, [4, 5])
        for value in (np.nan, np.inf, -0.1, 100.1):
            wrong("motion", lambda frame, camera: camera.motion.__setitem__(moving, value))
        wrong("motion", put("motion", None))
        wrong("motion", put("motion", np.zeros((3, 3), np.float32)))
        for map_ in (np.full((57, 211), 6), np.full((57, 211), -1), np.zeros((57, 211)),
                     np.zeros((57, 210), int), np.zeros((0, 0), int), np.zeros(57, int),
                     np.zeros((1, 16385), np.uint16)):
            wrong("segment_map", put("segment_map", map_))
        wrong("segments", put("segments", [("x",)]))
        for name in ("", "a b", "x" * 33, "caf\u00e9"):
            wrong("label_space", put("label_space", name))
        for field in ("calibration_hash", "content_key"):
            wrong(field, put(field, 1 << 64))
            wrong(field, put(field, -1))
        with tempfile.TemporaryDirectory() as folder:
            frame = example()
            frame.cameras[0].segments["instance"][0] = -1
            with self.assertRaisesRegex(kysp.FormatError, "a.kysp: .*instance"):
                kysp.write(os.path.join(folder, "a.kysp"), frame)
            self.assertEqual(os.listdir(folder), [])

    def test_motion_outside_of_dynamic_segments_is_not_read(self):
        frame = example()
        still = ~np.isin(frame.cameras[0].segment_map, [4, 5])
        data = kysp.encode(frame)
        frame.cameras[0].motion[still] = np.nan
        self.assertEqual(kysp.encode(frame), data)

    def test_damage_is_refused(self):
        data = kysp.encode(example())
        for at in range(0, len(data), 97):
            bad = bytearray(data)
            bad[at] ^= 0x55
            with self.assertRaises(kysp.FormatError):
                kysp.decode(bytes(bad))
        for size in range(0, len(data), 101):
            with self.assertRaises(kysp.FormatError):
                kysp.decode(data[:size])

    def verdicts(self, data, path):
        """What is wrong with the bytes for us and for the C++ reader ("": nothing)."""
        try:
            kysp.decode(bytes(data))
            ours = ""
        except kysp.FormatError as error:
            ours = str(error)
        with open(path, "wb") as file:
            file.write(data)
        theirs = subprocess.run([EXCHANGE, path, path + ".out"], stderr=subprocess.PIPE, text=True,
                                check=False)
        self.assertIn(theirs.returncode, (0, 2), theirs.stderr)
        return ours, theirs.stderr

    @unittest.skipUnless(EXCHANGE, "the C++ program is not built")
    def test_forged_files_get_the_verdict_of_cpp(self):
        """Mutations with a right checksum: nothing but FormatError, and only of what C++ refuses."""
        data = kysp.encode(example(1, 40, 9))
        random = np.random.default_rng(5)
        places = [*range(20, 150), *random.integers(150, len(data), 170)]
        refused = 0
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "forged.kysp")
            for at in places:
                forged = bytearray(data)
                forged[at] ^= int(random.choice([0x01, 0x55, 0x80, 0xFF]))
                struct.pack_into("<I", forged, 16, zlib.crc32(forged[20:]))
                ours, theirs = self.verdicts(forged, path)
                self.assertEqual(bool(ours), bool(theirs), f"byte {at}: {ours!r}, {theirs!r}")
                refused += bool(ours)
            header_only = bytearray(data[:kysp.HEADER.size])
            struct.pack_into("<I", header_only, 12, len(header_only))
            struct.pack_into("<I", header_only, 16, zlib.crc32(header_only[20:]))
            ours, theirs = self.verdicts(header_only, path)
            self.assertIn("camera table", ours)
            self.assertIn("camera table", theirs)
        self.assertGreater(refused, 100)
        self.assertLess(refused, len(places))  # keys, labels and the like may have any value

    def test_pipes_and_folders_are_refused(self):
        with tempfile.TemporaryDirectory() as folder:
            os.mkfifo(os.path.join(folder, "pipe"))
            for path in (folder, os.path.join(folder, "pipe")):
                with self.assertRaisesRegex(kysp.FormatError, "regular file"):
                    kysp.read(path)
            with self.assertRaises(OSError):
                kysp.read(os.path.join(folder, "missing"))


if __name__ == "__main__":
    unittest.main()
