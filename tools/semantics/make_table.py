#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Makes the semantic table of a label space from a FastText file (Eq. 1).

    make_table.py --classes kys/data/ade20k_150.classes.csv --vectors crawl-300d-2M.vec --output own

Every class has a text of one or more words; their vectors are summed, the signs of the sum (value
above 0) are the bits, and the distance of two classes is the number of bits in which they differ.
Writes NAME.classes.csv and NAME.table.csv into the output folder and prints range and percentiles.

A class with a word that has no vector is an error, unless --keep TABLE names the table to take its
distances from: then it is flagged as a surrogate.
"""

import argparse
from pathlib import Path

from fasttext_files import load_vectors
import inputs  # fasttext_files knows where it is
from label_files import read_classes, read_table, summary, write_classes, write_table


def parse_arguments():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--classes", type=Path, required=True, help="class file of the label space")
    parser.add_argument("--vectors", type=Path, required=True, help="FastText .vec or .bin file")
    parser.add_argument("--output", type=Path, required=True, help="folder for the two files")
    parser.add_argument("--keep", type=Path, help="table with distances of classes without vector")
    return parser.parse_args()


def class_bits(label_class, vectors):
    """Sign bits of the class as an integer; None when one of its words has no vector."""
    words = label_class.text.split()
    if not words or any(word not in vectors for word in words):
        return None
    bits = 0
    for values in zip(*(vectors[word] for word in words)):
        bits = bits << 1 | (sum(values) > 0)
    return bits


def make_table(bits, old):
    def distance(i, j):
        if i == j:
            return 0
        if bits[i] is None or bits[j] is None:
            return old[i][j]
        return bin(bits[i] ^ bits[j]).count("1")

    return [[distance(i, j) for j in range(len(bits))] for i in range(len(bits))]


def main():
    arguments = parse_arguments()
    name, classes = read_classes(arguments.classes)
    old = read_table(arguments.keep, name, len(classes)) if arguments.keep else None
    words = {word for c in classes for word in c.text.split()}
    vectors = load_vectors(arguments.vectors, words)
    bits = [class_bits(c, vectors) for c in classes]
    missing = [c.name for c, b in zip(classes, bits) if b is None]
    if missing and old is None:
        inputs.fail(
            f"{arguments.vectors}: no vector for a word of: {', '.join(missing)} "
            "(give --keep TABLE to keep their distances)"
        )
    for c, b in zip(classes, bits):
        c.vector = "surrogate" if b is None else "fasttext"
    table = make_table(bits, old)
    arguments.output.mkdir(parents=True, exist_ok=True)
    comments = [f"Made by tools/semantics/make_table.py from {arguments.vectors.name}."]
    write_classes(arguments.output / f"{name}.classes.csv", name, classes, comments)
    write_table(arguments.output / f"{name}.table.csv", name, table, comments)
    print(f"{name}: {len(classes)} classes, {len(missing)} without vectors (surrogates)")
    for line in summary(table, [c.name for c in classes]):
        print(line)


if __name__ == "__main__":
    inputs.run(main)
