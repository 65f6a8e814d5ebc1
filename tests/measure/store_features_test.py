#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Files of store_features.py, as evaluate_places reads them: whole ones are read, others refused. Arguments:
evaluate_places."""
import os
import subprocess
import sys
import tempfile

try:
    import numpy as np

    sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
    import store_features as tool
    from kys_slam import Features
except ImportError as error:
    print(error)
    sys.exit(77)

IMAGE = np.arange(48 * 64, dtype=np.uint8).reshape(48, 64)


def corners(image):
    """Five features with bits."""
    at = np.array([[8, 8], [20, 8], [8, 20], [30.5, 30.25], [40, 12]], np.float32)
    return {"positions": at, "descriptors": np.tile(np.arange(32, dtype=np.uint8), (5, 1)),
            "scores": np.arange(5.0)}


def error_of(program, file, folder):
    """The message of the program, which has no sequence to read."""
    sequence = os.path.join(folder, "none")
    done = subprocess.run([program, sequence, "--stored-features", file], capture_output=True, text=True)
    assert done.returncode == 2, (done.returncode, done.stderr)
    return done.stderr


def main(program):
    features = Features(corners, "corners")
    found = features(IMAGE)
    whole = tool.header(features).encode() + tool.image_bytes(IMAGE, found) + tool.image_bytes(IMAGE.T, found)
    one = len(tool.image_bytes(IMAGE, found))
    assert one == 2 * 8 + 4 + 5 * (4 * 4 + 1 + 32)
    with tempfile.TemporaryDirectory() as folder:
        file = os.path.join(folder, "a.bin")

        def error(content):
            with open(file, "wb") as stream:
                stream.write(content)
            return error_of(program, file, folder)

        assert "a.bin" not in error(whole) and "none" in error(whole), "read, and the sequence is missing"
        for cut in (whole[:-1], whole[:-one + 10]):
            assert "a.bin: ends in the middle of an image" in error(cut)
        assert "a.bin" in error(b"") and "a.bin" in error(b"no header\n" + whole)
        assert "a.bin" in error(whole.replace(b'"levels"', b'"stages"'))
        many = bytearray(whole)
        many[-2 * one + 16:-2 * one + 20] = b"\xff\xff\xff\xff"
        assert "4294967295 features of an image" in error(bytes(many))
        assert "missing.bin" in error_of(program, os.path.join(folder, "missing.bin"), folder)


if __name__ == "__main__":
    main(sys.argv[1])
