# SPDX-License-Identifier: BSD-3-Clause
"""Word vectors out of FastText files, for a few words: .vec (text) and .bin (model with subwords).

Nothing but the standard library; the files may be larger than memory.
"""

import math
import mmap
import os
import struct
import sys
import time
from array import array
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "common"))
from inputs import InputError, fail, reading  # noqa: E402

BIN_MAGIC = 793712314


def load_vectors(path, words):
    """{word: list of float} of those `words` the file has; a .bin file has them all (subwords)."""
    with reading(path):
        with open(path, "rb") as file:
            if file.read(4) == struct.pack("<i", BIN_MAGIC):
                return BinModel(path).vectors(words)
        return read_vec(path, words)


def read_vec(path, words):
    """Text format: an optional line 'COUNT DIMENSIONS', then 'word v1 v2 ...' per line. The exact
    spelling of a word wins over one that differs in case. InputError when there are fewer vectors than
    COUNT."""
    wanted = {word.lower() for word in words}
    exact, folded = {}, {}
    dimensions, number, promised = None, 0, 1
    progress = Progress(path)
    with open(path, "rb") as file:
        for number, line in enumerate(file, 1):
            progress.at(file, number)
            word, _, rest = line.rstrip().partition(b" ")
            if number == 1 and rest.isdigit():
                dimensions = int(rest)
                if dimensions < 1:
                    fail(f"{path}:1: vectors of {dimensions} dimensions")
                promised = 1 + (int(word) if word.isdigit() else 0)
                continue
            word = word.decode("utf-8", "replace")
            if word.lower() not in wanted and number > 1:  # the first line: is it a vector?
                continue
            vector = parse_vector(rest, path, number)
            dimensions = dimensions or len(vector)
            if len(vector) != dimensions:
                fail(f"{path}:{number}: {len(vector)} numbers, other lines have {dimensions}")
            if word in words:
                exact.setdefault(word, vector)
            else:
                folded.setdefault(word.lower(), vector)
    progress.done()
    if number < promised:
        fail(f"{path}: truncated: {number} lines instead of {promised}")
    found = {word: exact.get(word, folded.get(word.lower())) for word in words}
    return {word: vector for word, vector in found.items() if vector is not None}


def parse_vector(text, path, number):
    try:
        vector = [float(value) for value in text.split()]
    except ValueError as error:
        raise InputError(f"{path}:{number}: {error}") from error
    if not vector or not all(abs(value) < 1e30 for value in vector):
        fail(f"{path}:{number}: a value is missing or not finite")
    return vector


class Progress:
    """Percentage of a file on stderr, once a second, when reading takes long."""

    def __init__(self, path):
        self.size = max(1, os.path.getsize(path))
        self.last = time.monotonic() + 1
        self.shown = False

    def at(self, file, number):
        if number % 4096 == 0 and time.monotonic() > self.last:
            self.last = time.monotonic() + 1
            self.shown = True
            print(f"\rreading vectors {100 * file.tell() // self.size} %", end="", file=sys.stderr)

    def done(self):
        if self.shown:
            print(file=sys.stderr)


def subword_hash(text):
    """FastText's FNV-1a: bytes are sign-extended before they are mixed in."""
    value = 2166136261
    for byte in text:
        value ^= byte if byte < 128 else byte | 0xFFFFFF00
        value = value * 16777619 & 0xFFFFFFFF
    return value


def subwords(word, shortest, longest):
    """Character n-grams of '<word>', as bytes."""
    characters = [c.encode("utf-8") for c in f"<{word}>"]
    for start in range(len(characters)):
        for length in range(max(1, shortest), longest + 1):
            end = start + length
            if end > len(characters):
                break
            if length > 1 or 0 < start < len(characters) - 1:
                yield b"".join(characters[start:end])


class BinModel:
    """A FastText model file, format version 11 or 12, not quantised."""

    def __init__(self, path):
        self.path = path
        self.size = os.path.getsize(path)
        with open(path, "rb") as file:
            self._read_head(file)

    def _take(self, file, layout):
        data = file.read(struct.calcsize(layout))
        if len(data) != struct.calcsize(layout):
            fail(f"{self.path}: truncated")
        return struct.unpack(layout, data)

    def _read_head(self, file):
        _, version = self._take(file, "<ii")
        if version not in (11, 12):
            fail(f"{self.path}: format version {version} is not known")
        arguments = self._take(file, "<12id")
        self.dimensions, self.buckets, self.shortest, self.longest = (
            arguments[i] for i in (0, 8, 9, 10)
        )
        if version == 11 and arguments[7] == 3:  # old supervised models use no subwords
            self.longest = 0
        entries, self.word_count, _, _, pruned = self._take(file, "<iiiqq")
        if not 0 <= self.word_count <= entries or entries > self.size:
            fail(f"{self.path}: dictionary makes no sense")
        self.row_of_word = self._read_dictionary(file, entries)
        (quantised,) = self._take(file, "<?")
        if quantised or pruned > 0:
            fail(f"{self.path}: quantised models are not supported, use the .vec")
        self.rows, columns = self._take(file, "<qq")
        self.matrix = file.tell()
        if self.dimensions < 1:
            fail(f"{self.path}: vectors of {self.dimensions} dimensions")
        if columns != self.dimensions or self.rows != self.word_count + self.buckets:
            fail(f"{self.path}: matrix and dictionary do not fit together")
        if self.rows < 0 or self.matrix + 4 * self.rows * columns > self.size:
            fail(f"{self.path}: truncated")

    def _read_dictionary(self, file, entries):
        """{word: row}; leaves the file after the dictionary."""
        rows = {}
        at = file.tell()
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            for row in range(entries):
                end = data.find(b"\0", at)
                if end < 0:
                    fail(f"{self.path}: truncated")
                if row < self.word_count:
                    rows[data[at:end].decode("utf-8", "replace")] = row
                at = end + 10  # terminator, count (8 bytes), type (1 byte)
        file.seek(at)
        return rows

    def vectors(self, words):
        with open(self.path, "rb") as file:
            return {word: self._vector(file, word) for word in words}

    def _vector(self, file, word):
        known = self.row_of_word.get(word)
        rows = [] if known is None else [known]
        if self.longest > 0 and self.buckets > 0:
            for part in subwords(word, self.shortest, self.longest):
                rows.append(self.word_count + subword_hash(part) % self.buckets)
        total = [0.0] * self.dimensions
        for row in rows:
            file.seek(self.matrix + 4 * row * self.dimensions)
            values = array("f")
            values.fromfile(file, self.dimensions)
            if sys.byteorder == "big":
                values.byteswap()
            if not all(map(math.isfinite, values)):
                fail(f"{self.path}: row {row} of the vectors, of '{word}', is not finite")
            total = [a + b for a, b in zip(total, values)]
        return [value / max(1, len(rows)) for value in total]
