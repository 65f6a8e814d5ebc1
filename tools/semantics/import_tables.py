#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Makes the label spaces shipped in kys/data.

    import_tables.py --semantics FOLDER --output kys/data

FOLDER holds the class lists coco_panoptic_133.json and ade20k_150.json and the tables
coco133_hamming_ftvec.json and ade_partial_70_hamming_ftvec.json (Hamming distances of sign bits of
300-d FastText vectors). cityscapes_19 is made of COCO's list and table. Classes without a vector
there get surrogate distances from surrogates.csv, and are flagged as surrogates in the class file:

    102  the two classes are declared near each other, or near one same class
    119  same group
    135  otherwise

These are the averages over the pairs with real vectors of close, related and unrelated classes.
With a FastText file at hand, make_table.py replaces them all.
"""

import argparse
import csv
import json
from pathlib import Path

from label_files import LabelClass, summary, write_classes, write_table
import inputs  # label_files knows where it is

NEAR, RELATED, UNRELATED = 102, 119, 135
HERE = Path(__file__).parent

# Virtual KITTI 2 classes in the order of colors.txt; the words their vectors are made of.
VKITTI2 = [
    ("Terrain", "terrain", False),
    ("Sky", "sky", False),
    ("Tree", "tree", False),
    ("Vegetation", "vegetation", False),
    ("Building", "building", False),
    ("Road", "road", False),
    ("GuardRail", "guard rail", False),
    ("TrafficSign", "traffic sign", False),
    ("TrafficLight", "traffic light", False),
    ("Pole", "pole", False),
    ("Misc", "miscellaneous", False),
    ("Truck", "truck", True),
    ("Car", "car", True),
    ("Van", "van", True),
]
# Substitutes: a class whose real vector is used for one that has none.
VKITTI2_SUBSTITUTES = {
    "terrain": "ground",
    "vegetation": "plant",
    "guard rail": "railing",
    "traffic sign": "stop sign",
}

# Cityscapes, the evaluated classes by their ids; the words their vectors are made of.
CITYSCAPES_19 = [
    (7, "road", False),
    (8, "sidewalk", False),
    (11, "building", False),
    (12, "wall", False),
    (13, "fence", False),
    (17, "pole", False),
    (19, "traffic light", False),
    (20, "traffic sign", False),
    (21, "vegetation", False),
    (22, "terrain", False),
    (23, "sky", False),
    (24, "person", True),
    (25, "rider", True),
    (26, "car", True),
    (27, "truck", True),
    (28, "bus", True),
    (31, "train", True),
    (32, "motorcycle", True),
    (33, "bicycle", True),
]
CITYSCAPES_19_SUBSTITUTES = {
    "sidewalk": "pavement",
    "traffic sign": "stop sign",
    "vegetation": "tree",
    "terrain": "grass",
    "rider": "person",
}
CITYSCAPES_19_COMMENTS = [
    "Cityscapes, the 19 evaluated classes by their ids 7..33.",
    "Marked surrogate: sidewalk, traffic sign, vegetation, terrain and rider borrow the vectors of",
    "COCO's pavement, stop sign, tree, grass and person; pole, and rider to person, are 102 (near),",
    "119 (same group) or 135 (otherwise) by tools/semantics/surrogates.csv.",
]


def load(folder, name):
    with inputs.reading(folder / name):
        return json.loads((folder / name).read_text(encoding="utf-8"))


def read_surrogates(path):
    """{space: {class name: (group, set of near names)}}"""
    spaces = {}
    with open(path, newline="", encoding="utf-8") as file:
        rows = (line for line in file if not line.startswith("#"))
        for row in csv.DictReader(rows, delimiter=";"):
            near = {n for n in row["near"].split("|") if n}
            spaces.setdefault(row["space"], {})[row["name"]] = (row["group"], near)
    return spaces


def surrogate_distance(a, b, rules):
    group_a, near_a = rules[a]
    group_b, near_b = rules[b]
    if a in near_b or b in near_a or near_a & near_b:
        return NEAR
    return RELATED if group_a == group_b else UNRELATED


def coco(folder):
    classes = load(folder, "coco_panoptic_133.json")["categories"]
    words = load(folder, "coco133_hamming_ftvec.json")
    if words["names"] != [c["name"] for c in classes]:
        inputs.fail("COCO class list and table disagree")
    return [
        LabelClass(c["id"], bool(c["isthing"]), "fasttext", text.replace("-", " "), c["name"])
        for c, text in zip(classes, words["text_used"])
    ], words["table"]


def ade20k(folder, rules):
    categories = load(folder, "ade20k_150.json")["categories"]
    partial = load(folder, "ade_partial_70_hamming_ftvec.json")
    row_of = {index: row for row, index in enumerate(partial["index"])}
    names = [c["name"] for c in categories]
    classes = []
    for c in categories:
        row = row_of.get(c["index"])
        real = row is not None
        text = partial["text_used"][row] if real else c["name"]
        vector = "fasttext" if real else "surrogate"
        classes.append(
            LabelClass(c["objectInfo150_idx"], bool(c["isthing"]), vector, text, c["name"])
        )

    def distance(i, j):
        if i == j:
            return 0
        if i in row_of and j in row_of:
            return partial["table"][row_of[i]][row_of[j]]
        return surrogate_distance(names[i], names[j], rules)

    return classes, [[distance(i, j) for j in range(len(names))] for i in range(len(names))]


def vkitti2(folder, rules):
    sources = []
    for name in ("coco133_hamming_ftvec.json", "ade_partial_70_hamming_ftvec.json"):
        source = load(folder, name)
        sources.append(({t: i for i, t in enumerate(source["text_used"])}, source["table"]))
    known = set().union(*(rows for rows, _ in sources))
    classes = [
        LabelClass(i + 1, thing, "fasttext" if text in known else "surrogate", text, name)
        for i, (name, text, thing) in enumerate(VKITTI2)
    ]

    def distance(a, b):
        if a is b:
            return 0
        text_a = VKITTI2_SUBSTITUTES.get(a.text, a.text)
        text_b = VKITTI2_SUBSTITUTES.get(b.text, b.text)
        for rows, table in sources:
            if text_a in rows and text_b in rows:
                return table[rows[text_a]][rows[text_b]]
        return surrogate_distance(a.name, b.name, rules)

    return classes, [[distance(a, b) for b in classes] for a in classes]


def cityscapes(coco_classes, coco_table, rules):
    """The classes and the table, from those of COCO panoptic."""
    row_of = {c.text: row for row, c in enumerate(coco_classes)}
    classes = [LabelClass(number, thing, "fasttext" if name in row_of else "surrogate", name, name)
               for number, name, thing in CITYSCAPES_19]

    def distance(a, b):
        if a is b:
            return 0
        rows = [row_of.get(CITYSCAPES_19_SUBSTITUTES.get(c.text, c.text)) for c in (a, b)]
        if None in rows or rows[0] == rows[1]:
            return surrogate_distance(a.name, b.name, rules)
        return coco_table[rows[0]][rows[1]]

    return classes, [[distance(a, b) for b in classes] for a in classes]


def write_space(output, name, classes, table, comments):
    surrogates = [c.name for c in classes if c.vector == "surrogate"]
    how = "Regenerate both files from a FastText file: tools/semantics/make_table.py"
    source = "Sign-binarised FastText (English, 300-d) vectors, Hamming distance in bits (Eq. 1)."
    write_classes(output / f"{name}.classes.csv", name, classes, [*comments, how])
    write_table(output / f"{name}.table.csv", name, table, [source, *comments, how])
    print(f"{name}: {len(classes)} classes, {len(surrogates)} of them surrogates")
    real = [i for i, c in enumerate(classes) if c.vector == "fasttext"]
    for line in summary(table, [c.name for c in classes], real):
        print("  " + line)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--semantics", type=Path, required=True, help="folder of the JSON files")
    parser.add_argument("--output", type=Path, required=True, help="folder for the label spaces")
    arguments = parser.parse_args()
    rules = read_surrogates(HERE / "surrogates.csv")
    folder, output = arguments.semantics, arguments.output
    output.mkdir(parents=True, exist_ok=True)

    with inputs.reading(folder):
        classes, table = coco(folder)
    write_space(output, "coco_panoptic_133", classes, table, [
        "COCO panoptic, 133 classes, ids of the panoptic annotations (1..200, with gaps).",
        "Every class has real vectors. Off-diagonal range 50..174; the paper's own table, which is",
        "not public, has 0..172. S_max = 155 is exceeded by 1.6 % of the pairs.",
    ])
    classes, table = cityscapes(classes, table, rules["cityscapes_19"])
    write_space(output, "cityscapes_19", classes, table, CITYSCAPES_19_COMMENTS)
    with inputs.reading(folder):
        classes, table = ade20k(folder, rules["ade20k_150"])
    write_space(output, "ade20k_150", classes, table, [
        "ADE20K scene parsing, 150 classes, ids 1..150 (0 is void in the annotations).",
        "70 classes have real vectors; distances to the other 80, marked surrogate, are 102 (near),",
        "119 (same group) or 135 (otherwise) by tools/semantics/surrogates.csv. Pairs of real",
        "classes with the same words (earth - land, counter - buffet) have distance 0.",
    ])
    with inputs.reading(folder):
        classes, table = vkitti2(folder, rules["vkitti2"])
    write_space(output, "vkitti2", classes, table, [
        "Virtual KITTI 2, 14 classes in the order of colors.txt, ids 1..14; Undefined is void.",
        "Marked surrogate: Terrain, Vegetation, GuardRail and TrafficSign borrow the vectors of",
        "ground, plant, railing and stop sign; Pole, Misc and Van, and borrowed pairs not in one",
        "table, are 102 (near), 119 (same group) or 135 (otherwise).",
    ])


if __name__ == "__main__":
    inputs.run(main)
