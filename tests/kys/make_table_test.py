# SPDX-License-Identifier: BSD-3-Clause
"""Makes tables from tiny made-up FastText files and compares with distances counted by hand.

make_table_test.py TOOLS_FOLDER LABEL_SPACE_FOLDER
"""

import shutil
import struct
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

TOOLS, SPACES = (Path(p) for p in sys.argv[1:3])
sys.path.insert(0, str(TOOLS))

import fasttext_files  # noqa: E402
import import_tables  # noqa: E402
import label_files  # noqa: E402

CLASSES = [
    label_files.LabelClass(1, False, "surrogate", "road", "road"),
    label_files.LabelClass(2, True, "surrogate", "red car", "car, red"),
    label_files.LabelClass(3, False, "surrogate", "sky", "sky"),
]
VECTORS = {  # signs: road 1010, red + car 1001, sky 0101 (0 counts as not above 0)
    "road": [0.5, -0.1, 2.0, 0.0],
    "red": [1.0, 0.5, -1.0, 0.25],
    "car": [-0.5, -0.75, 0.5, 0.25],
    "sky": [-1.0, 0.3, -0.2, 0.1],
}
EXPECTED = [[0, 2, 4], [2, 0, 2], [4, 2, 0]]


def write_bin(path, vectors, buckets=0, shortest=0, longest=0, bucket_rows=()):
    """A FastText model file, as its saveModel() lays it out."""
    dimensions = len(next(iter(vectors.values())))
    with open(path, "wb") as file:
        file.write(struct.pack("<ii", fasttext_files.BIN_MAGIC, 12))
        file.write(struct.pack("<12id", dimensions, 5, 5, 1, 5, 1, 2, 2, buckets, shortest,
                               longest, 100, 1e-4))
        file.write(struct.pack("<iiiqq", len(vectors), len(vectors), 0, 99, -1))
        for word in vectors:
            file.write(word.encode("utf-8") + b"\0" + struct.pack("<qb", 7, 0))
        file.write(struct.pack("<?qq", False, len(vectors) + buckets, dimensions))
        for row in [*vectors.values(), *bucket_rows]:
            file.write(struct.pack(f"<{dimensions}f", *row))


class MakeTable(unittest.TestCase):
    def setUp(self):
        self.folder = Path(tempfile.mkdtemp())
        self.classes = self.folder / "tiny.classes.csv"
        label_files.write_classes(self.classes, "tiny", CLASSES)

    def tearDown(self):
        shutil.rmtree(self.folder)

    def write_vec(self, vectors, header=True):
        lines = [f"{len(vectors)} 4"] if header else []
        lines += [f"{word} {' '.join(map(str, v))}" for word, v in vectors.items()]
        path = self.folder / "tiny.vec"
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return path

    def run_tool(self, vectors, *more):
        command = [sys.executable, TOOLS / "make_table.py", "--classes", self.classes, "--vectors",
                   vectors, "--output", self.folder / "out", *more]
        return subprocess.run([str(c) for c in command], capture_output=True, text=True)

    def result(self):
        name, classes = label_files.read_classes(self.folder / "out" / "tiny.classes.csv")
        return classes, label_files.read_table(self.folder / "out" / "tiny.table.csv", name, 3)

    def test_vec(self):
        for header in (True, False):
            done = self.run_tool(self.write_vec(VECTORS, header))
            self.assertEqual(done.returncode, 0, done.stderr)
            classes, table = self.result()
            self.assertEqual(table, EXPECTED)
            self.assertEqual({c.vector for c in classes}, {"fasttext"})
            self.assertEqual(classes[1].name, "car, red")
            self.assertIn("3 pairs, off-diagonal range 2..4", done.stdout)
            self.assertIn("50: 2", done.stdout)

    def test_case_is_a_last_resort(self):
        vectors = {"Road": [-9.0] * 4, **VECTORS}
        self.assertEqual(self.run_tool(self.write_vec(vectors)).returncode, 0)
        self.assertEqual(self.result()[1], EXPECTED)
        vectors = {k.upper(): v for k, v in VECTORS.items()}
        self.assertEqual(self.run_tool(self.write_vec(vectors)).returncode, 0)
        self.assertEqual(self.result()[1], EXPECTED)

    def test_bin(self):
        path = self.folder / "tiny.bin"
        write_bin(path, VECTORS)
        done = self.run_tool(path)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(self.result()[1], EXPECTED)

    def test_bin_averages_word_and_subwords(self):
        path = self.folder / "tiny.bin"
        rows = [[float(i), 0.0, -float(i), 1.0] for i in range(8)]
        write_bin(path, {"sky": [4.0, 3.0, 2.0, 1.0]}, 8, 3, 4, rows)
        parts = list(fasttext_files.subwords("sky", 3, 4))
        self.assertEqual(parts, [b"<sk", b"<sky", b"sky", b"sky>", b"ky>"])
        hashed = sum(fasttext_files.subword_hash(p) % 8 for p in parts)
        vector = fasttext_files.load_vectors(path, {"sky"})["sky"]
        wanted = [(4 + hashed) / 6, 3 / 6, (2 - hashed) / 6, (1 + 5) / 6]
        for got, want in zip(vector, wanted):
            self.assertAlmostEqual(got, want, places=5)

    def test_subword_hash_is_fnv1a(self):
        self.assertEqual(fasttext_files.subword_hash(b"a"), 0xE40C292C)
        self.assertEqual(fasttext_files.subword_hash(b"foobar"), 0xBF9CF968)

    def test_long_dictionaries(self):
        words = {f"word{i}": [float(i % 3 - 1), 1.0, float(i), 0.0] for i in range(2500)}
        path = self.folder / "long.bin"
        write_bin(path, words)
        found = fasttext_files.load_vectors(path, {"word0", "word999", "word1000", "word2499"})
        self.assertEqual([found[w][2] for w in sorted(found)], [0.0, 1000.0, 2499.0, 999.0])

    def test_missing_words(self):
        vectors = {k: v for k, v in VECTORS.items() if k != "red"}
        done = self.run_tool(self.write_vec(vectors))
        self.assertEqual(done.returncode, 2)
        self.assertIn("no vector for a word of: car, red", done.stderr)
        old = self.folder / "old.csv"
        label_files.write_table(old, "tiny", [[0, 9, 8], [9, 0, 7], [8, 7, 0]])
        done = self.run_tool(self.write_vec(vectors), "--keep", old)
        self.assertEqual(done.returncode, 0, done.stderr)
        classes, table = self.result()
        self.assertEqual(table, [[0, 9, 4], [9, 0, 7], [4, 7, 0]])
        self.assertEqual([c.vector for c in classes], ["fasttext", "surrogate", "fasttext"])

    def test_bad_files_are_one_line(self):
        bad = self.folder / "bad.bin"
        write_bin(bad, VECTORS)
        whole = bad.read_bytes()
        cases = [whole[:n] for n in (0, 3, 7, 40, 90, 120, len(whole) - 1)]
        cases += [b"road 1 2 x 4\n", b"road 1 nan 2 3\n", b"5 4\nroad 1 2\n"]
        for content in cases:
            bad.write_bytes(content)
            done = self.run_tool(bad)
            self.assertEqual(done.returncode, 2, content)
            self.assertEqual(done.stderr.count("\n"), 1, done.stderr)
        self.assertEqual(self.run_tool(self.folder / "none.vec").returncode, 2)

    def test_truncated_files_make_no_surrogates(self):
        old = self.folder / "old.csv"
        label_files.write_table(old, "tiny", [[0, 9, 8], [9, 0, 7], [8, 7, 0]])
        bad = self.write_vec(VECTORS)
        whole = bad.read_bytes()
        model = self.folder / "tiny.bin"
        write_bin(model, VECTORS)
        for content in (b"", whole[:whole.index(b"sky")], whole[:2], model.read_bytes()[:3]):
            bad.write_bytes(content)
            done = self.run_tool(bad, "--keep", old)
            self.assertEqual(done.returncode, 2, content)
            self.assertIn("tiny.vec", done.stderr)
            self.assertEqual(done.stderr.count("\n"), 1, done.stderr)

    def test_numbers_that_make_no_table(self):
        """Signs of NaN and of no dimensions are all alike: every distance would be 0."""
        bad = self.folder / "bad.bin"
        write_bin(bad, {**VECTORS, "sky": [1.0, float("nan"), 0.5, 0.5]})
        cases = [bad.read_bytes()]
        write_bin(bad, dict.fromkeys(VECTORS, []))
        cases += [bad.read_bytes(), b"3 0\nroad\nred\ncar\nsky\n"]
        for content in cases:
            bad.write_bytes(content)
            done = self.run_tool(bad)
            self.assertEqual(done.returncode, 2, content)
            self.assertIn("bad.bin", done.stderr)
            self.assertEqual(done.stderr.count("\n"), 1, done.stderr)
            self.assertFalse((self.folder / "out" / "tiny.table.csv").exists())

    def test_table_to_keep_names_its_line(self):
        old = self.folder / "old.csv"
        vectors = self.write_vec({k: v for k, v in VECTORS.items() if k != "red"})
        for value in ("nan", "inf", "-1", "x"):
            old.write_text(f"kys-table,1,tiny,3\n0,9,8\n9,0,{value}\n8,7,0\n")
            done = self.run_tool(vectors, "--keep", old)
            self.assertEqual((done.returncode, done.stderr.count("\n")), (2, 1), done.stderr)
            self.assertIn("old.csv:3", done.stderr)

    def test_shipped_spaces_are_readable(self):
        for name, count in (("coco_panoptic_133", 133), ("ade20k_150", 150), ("cityscapes_19", 19),
                            ("vkitti2", 14)):
            found, classes = label_files.read_classes(SPACES / f"{name}.classes.csv")
            self.assertEqual((found, len(classes)), (name, count))
            label_files.read_table(SPACES / f"{name}.table.csv", name, count)

    def test_cityscapes_is_made_of_coco(self):
        name, coco = label_files.read_classes(SPACES / "coco_panoptic_133.classes.csv")
        table = label_files.read_table(SPACES / "coco_panoptic_133.table.csv", name, len(coco))
        rules = import_tables.read_surrogates(TOOLS / "surrogates.csv")["cityscapes_19"]
        classes, distances = import_tables.cityscapes(coco, table, rules)
        import_tables.write_space(self.folder, "cityscapes_19", classes, distances,
                                  import_tables.CITYSCAPES_19_COMMENTS)
        for kind in ("classes", "table"):
            file = f"cityscapes_19.{kind}.csv"
            self.assertEqual((self.folder / file).read_bytes(), (SPACES / file).read_bytes())


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
