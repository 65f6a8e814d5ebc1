# SPDX-License-Identifier: BSD-3-Clause
"""How real movers are followed, and where it breaks.

    object_breaks.py SEQUENCE --priors PRIORS --truth label_02/NAME.txt --output DIR [--bin DIR]
        [--parts FIRST:LAST ...] [--max-range M] [--pictures] [--set KEY=VALUE ...]

Runs run_stereo_kitti on the sequence with its prior files, compares its objects with labelled boxes
(KITTI Tracking's format; evaluate_objects), over all frames and over each of --parts, and says of
every frame in which a moving object is not followed under its main identity why:

    no segment   no thing covers the object
    in parts     things of several instances cover it
    merged       most of the thing that covers it is beside it
    renamed      its thing has another instance than in the last frame
    class        the same, and the class is another one too
    standing     one thing covers it, and it is not believed to move
    other name   one thing covers it, it has an estimate, under another identity

DIR has the run, breaks.csv (a row per object and frame) and, with --pictures, breaks/FRAME.jpg. Things
that stand: those that cover no labelled moving object; the share of them that is flagged as moving in
the prior files is printed too.
"""
import argparse
import csv
import json
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "common"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "semantics"))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "python" / "kys_slam"))
import inputs  # noqa: E402
import kysp  # noqa: E402
from label_files import read_classes  # noqa: E402

SOURCE = Path(__file__).resolve().parents[2]
LABELS = {"frame": 0, "object": 1, "box": slice(6, 10)}
MIN_AREA = 200  # px, of things that are counted
COVERS = 0.5    # share of a thing that is in an object's box: it is of this object; or
FILLS = 0.3     # share of the box that the thing fills
PART = 0.1      # of an object's pixels, from which a second instance counts
EDGE = 20       # px around a box: what is there is not sure to stand
CAUSES = ("no segment", "in parts", "merged", "renamed", "class", "standing", "other name")


def read_labels(path):
    """{(object, frame): box in px} of a label file of KITTI Tracking."""
    labels = {}
    with inputs.reading(path), open(path, encoding="utf-8") as file:
        for number, line in enumerate(file, 1):
            with inputs.reading(f"{path}:{number}"):
                word = line.split()
                if int(word[LABELS["object"]]) < 0:
                    continue  # DontCare
                box = [float(x) for x in word[LABELS["box"]]]
                if not np.all(np.isfinite(box)):
                    inputs.fail(f"{path}:{number}: is not finite")
                key = int(word[LABELS["object"]]), int(word[LABELS["frame"]])
                labels[key] = box
    return labels


def pixels_in(box, segment_map, count, margin=0):
    """Pixels of each segment in a box, by number, and pixels of the box."""
    height, width = segment_map.shape
    x0, y0 = (max(0, int(v) - margin) for v in box[:2])
    x1, y1 = min(width, int(box[2]) + 1 + margin), min(height, int(box[3]) + 1 + margin)
    part = segment_map[y0:y1, x0:x1]
    return np.bincount(part.ravel(), minlength=count + 1), part.size


class Things:
    """The things of a frame of the left image that can move."""

    def __init__(self, path, movable):
        with inputs.reading(path):
            camera = kysp.read(path).cameras[0]
        self.segments, self.map = camera.segments, camera.segment_map
        self.numbers = [k + 1 for k, s in enumerate(self.segments)
                        if s["flags"] & kysp.THING and int(s["label"]) in movable]

    def on(self, box):
        """[(pixels in the box, number)] of the things that are of the object in a box, most first."""
        pixels, area = pixels_in(box, self.map, len(self.segments))
        found = [(int(pixels[k]), k) for k in self.numbers
                 if pixels[k] >= COVERS * self.segments[k - 1]["area"] or pixels[k] >= FILLS * area]
        return sorted((p for p in found if p[0] > 0), reverse=True)

    def beside(self, boxes):
        """Numbers of the things that touch none of the boxes."""
        touched = set()
        for box in boxes:
            pixels, _ = pixels_in(box, self.map, len(self.segments), EDGE)
            touched.update(np.flatnonzero(pixels).tolist())
        return [k for k in self.numbers if k not in touched and self.segments[k - 1]["area"] >= MIN_AREA]


def cause_of(things, on, last, estimate, name):
    """Why an object is not followed under its main identity in a frame; "" when it is."""
    if estimate is not None and estimate == name:
        return ""
    if not on:
        return "no segment"
    segment = things.segments[on[0][1] - 1]
    total = sum(pixels for pixels, _ in on)
    instances = {int(things.segments[k - 1]["instance"]) for pixels, k in on if pixels >= PART * total}
    if len(instances) > 1:
        return "in parts"
    if on[0][0] < COVERS * segment["area"]:
        return "merged"
    if last is not None and last[0] != int(segment["instance"]):
        return "renamed" if last[1] == int(segment["label"]) else "class"
    return "standing" if estimate is None else "other name"


def programs(options, output):
    """Runs the program and the evaluation over all frames and each part: their JSON by part."""
    run = [str(options.bin / "run_stereo_kitti"), str(options.sequence), "--priors", str(options.priors),
           "--output", str(output), "--quiet", "--schedule", options.schedule]
    run += [word for setting in options.set for word in ("--set", setting)]
    results = {}
    evaluate = [str(options.bin / "evaluate_objects"), str(output), "--truth", str(options.truth), "--json",
                "--max-range", str(options.max_range)]
    commands = {"run": run, "all": [*evaluate, "--rows", str(output / "objects_rows.csv")]}
    for first, last in options.parts:
        commands[f"{first}-{last}"] = [*evaluate, "--first-frame", str(first), "--last-frame", str(last)]
    for name, command in commands.items():
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode not in (0, 1) or (name != "run" and done.returncode):
            inputs.fail(f"{command[0]}: {inputs.first_line(done.stderr)}")
        if name != "run":
            results[name] = json.loads(done.stdout)
    return results


def part_of(text):
    first, _, last = text.partition(":")
    return inputs.whole(0)(first), inputs.whole(0)(last)


def print_results(results):
    print(f"{'frames':>8} {'object':>7} {'class':<11} {'frames':>6} {'followed':>8} {'identities':>10} "
          f"{'estimates':>9} {'m/s':>6} {'deg':>5} {'m':>6}")
    for part, result in results.items():
        rows = result["objects"] + [dict(result, object="all", frames=result["life"]["frames"],
                                         identities="", followed=None, **{"class": ""})]
        for row in rows:
            share = (result["life"]["share_under_one_identity"] if row["followed"] is None
                     else row["followed"] / max(1, row["frames"]))
            print(f"{part:>8} {row['object']:>7} {row['class']:<11} {row['frames']:>6} {100 * share:>7.0f}% "
                  f"{row['identities']:>10} {row['speed_m_s']['count']:>9} {row['speed_m_s']['median']:>6.3f} "
                  f"{row['heading_deg']['median']:>5.1f} {row['position_m']['median']:>6.3f}")
        print(f"{'':>8} estimates {result['estimates']}, on no object {result['unassigned']}, on objects "
              f"that stand {result['on_standing_objects']}")


def diagnose(options, labels, estimates, moving, things_of, classes):
    """Rows of breaks.csv."""
    name = {}
    for key in moving:
        counts = Counter(estimates[o, f] for o, f in moving if o == key[0] and (o, f) in estimates)
        name[key[0]] = min(counts, key=lambda i: (-counts[i], i)) if counts else None
    rows, last = [], {}
    for object_, frame in sorted(moving):
        box, reach = labels[object_, frame], moving[object_, frame]
        things = things_of(frame)
        on = things.on(box)
        cause = cause_of(things, on, last.get(object_), estimates.get((object_, frame)), name[object_])
        if on:
            segment = things.segments[on[0][1] - 1]
            last[object_] = int(segment["instance"]), int(segment["label"])
        rows.append({"object": object_, "frame": frame, "range_m": round(reach, 1),
                     "segments": " ".join(
                         f"{classes[things.segments[k - 1]['label']].name.replace(' ', '_')}:"
                         f"{int(things.segments[k - 1]['instance'])}:{pixels}:"
                         f"{'m' if things.segments[k - 1]['flags'] & kysp.DYNAMIC else 's'}"
                         for pixels, k in on),
                     "identity": estimates.get((object_, frame), ""), "cause": cause})
    return rows


def print_causes(rows, parts):
    print(f"\n{'frames':>8} {'object':>7} " + " ".join(f"{c:>10}" for c in CAUSES))
    everything = (min(r["frame"] for r in rows), max(r["frame"] for r in rows))
    for first, last in [everything, *parts]:
        for object_ in sorted({r["object"] for r in rows}):
            counts = Counter(r["cause"] for r in rows
                             if r["object"] == object_ and first <= r["frame"] <= last)
            print(f"{first:>4}-{last:<3} {object_:>7} " + " ".join(f"{counts[c]:>10}" for c in CAUSES))


def standing(labels, moving_objects, things_of, frames):
    """Number of things that stand, and of those flagged as moving: [(frame, number)]."""
    count, flagged = 0, []
    for frame in frames:
        boxes = [labels[o, f] for o, f in labels if f == frame and o in moving_objects]
        things = things_of(frame)
        for k in things.beside(boxes):
            count += 1
            if things.segments[k - 1]["flags"] & kysp.DYNAMIC:
                flagged.append((frame, k))
    return count, flagged


def draw(options, frame, things, boxes, notes, classes):
    """The left image with its things (colour by instance, outlined where they move) and boxes."""
    import cv2

    found = sorted(p for p in (options.sequence / "image_2", options.sequence / "image_0") if p.is_dir())
    files = sorted(found[-1].iterdir())
    image = cv2.imread(str(files[frame]))
    for k in things.numbers:
        segment, mask = things.segments[k - 1], (things.map == k).astype(np.uint8)
        rng = np.random.default_rng(int(segment["instance"]))
        image[mask > 0] = (0.5 * image[mask > 0] + 0.5 * rng.integers(40, 255, 3)).astype(np.uint8)
        edges, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        moves = segment["flags"] & kysp.DYNAMIC
        cv2.drawContours(image, edges, -1, (0, 0, 255) if moves else (0, 255, 0), 2 if moves else 1)
        y, x = (int(v) for v in np.argwhere(mask).mean(0))
        cv2.putText(image, f"{classes[segment['label']].name} {segment['instance'] - 65536}", (x - 30, y),
                    cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 1)
    for box in boxes:
        cv2.rectangle(image, tuple(int(v) for v in box[:2]), tuple(int(v) for v in box[2:]), (255, 255, 0), 1)
    cv2.putText(image, f"{frame}  {notes}", (5, 15), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 255, 255), 1)
    (options.output / "breaks").mkdir(exist_ok=True)
    cv2.imwrite(str(options.output / "breaks" / f"{frame:06d}.jpg"), image)


def report(options, classes, results, seen):
    labels = read_labels(options.truth)
    movable = {k for k, c in enumerate(classes) if c.thing}
    names = sorted(p for p in options.priors.iterdir() if p.suffix == ".kysp")
    things = [Things(name, movable) for name in names]
    moving = {key: row["range_m"] for key, row in seen.items()}
    estimates = {key: int(row["identity"]) for key, row in seen.items() if row["identity"]}
    rows = diagnose(options, labels, estimates, moving, things.__getitem__, classes)
    with open(options.output / "breaks.csv", "w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, list(rows[0]))
        table.writeheader()
        table.writerows(rows)
    print_results(results)
    print_causes(rows, options.parts)
    movers = {o for o, _ in moving} | {o for o in options.also_moving}
    for first, last in [(0, len(things) - 2), *options.parts]:  # nothing is known of the last frame
        count, flagged = standing(labels, movers, things.__getitem__,
                                  range(first, min(last + 1, len(things) - 1)))
        print(f"frames {first}-{last}: things that stand, from {MIN_AREA} px: {count}, flagged as moving "
              f"{len(flagged)} ({100 * len(flagged) / max(1, count):.1f} %)")
        if (first, last) == (0, len(things) - 2):
            for frame, k in flagged[:options.list]:
                s = things[frame].segments[k - 1]
                print(f"    frame {frame}: {classes[s['label']].name} {s['instance']}, {s['area']} px")
    for frame in range(len(things)) if options.pictures else ():
        notes = "  ".join(f"{r['object']}: {r['identity']} {r['cause']}" for r in rows if r["frame"] == frame)
        draw(options, frame, things[frame], [labels[o, f] for o, f in labels if f == frame and o in movers],
             notes, classes)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sequence", type=Path)
    parser.add_argument("--priors", required=True, type=Path)
    parser.add_argument("--truth", required=True, type=Path, help="label file of KITTI Tracking")
    parser.add_argument("--output", required=True, type=Path)
    parser.add_argument("--bin", type=Path, default=SOURCE / "build" / "release" / "bin")
    parser.add_argument("--parts", type=part_of, nargs="+", default=[], metavar="FIRST:LAST")
    parser.add_argument("--max-range", type=float, default=25, help="m, of an object that counts")
    parser.add_argument("--schedule", default="sequential", choices=("sequential", "pipelined"))
    parser.add_argument("--set", nargs="+", default=[], metavar="KEY=VALUE", help="settings of the run")
    parser.add_argument("--label-space", default=str(SOURCE / "kys" / "data" / "cityscapes_19"),
                        help="path of its files without .classes.csv")
    parser.add_argument("--also-moving", type=int, nargs="+", default=[], metavar="OBJECT",
                        help="labelled objects that move too, for too short to count")
    parser.add_argument("--list", type=inputs.whole(0), default=0, metavar="N",
                        help="print N things that stand and are flagged")
    parser.add_argument("--pictures", action="store_true")
    options = parser.parse_args()
    try:
        classes = read_classes(f"{options.label_space}.classes.csv")[1]
        options.output.mkdir(parents=True, exist_ok=True)
        results = programs(options, options.output)
        seen = {(r["object"], r["frame"]): r for r in inputs.read_table(
            options.output / "objects_rows.csv",
            {"object": int, "frame": int, "range_m": float, "identity": str})}
        report(options, classes, results, seen)
    except ValueError as error:
        inputs.fail(str(error))


if __name__ == "__main__":
    inputs.run(main)
