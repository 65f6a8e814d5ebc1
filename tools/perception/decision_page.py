# SPDX-License-Identifier: BSD-3-Clause
"""A page that shows which objects of a sequence were judged to move, and why.

    decision_page.py PRIORS SEQUENCE --output page.html [--truth ground_truth.csv] [--wrong]

PRIORS is a folder made by build_priors (.kysp files and segments.csv) for the images of SEQUENCE. The
page is one HTML file with the pictures inside. Per object (one identity in both cameras, where the
files share identities): its belief over time, pictures of moments spread over it, and what each source
said. Red outlines move, green ones stand, yellow ones are not judged. --truth is a table with frame, camera, moving, segment_id or input_id,
and part where parts of a segment differ (simulate_sequence's ground_truth.csv): wrong decisions are
marked, and --wrong shows those alone. The last frame has no flow: it is left out.
"""

import argparse
import base64
import html
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "python" / "kys_slam"))
sys.path.insert(0, str(Path(__file__).resolve().parent))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "semantics"))
import common  # noqa: E402
import kysp  # noqa: E402
from label_files import read_classes  # noqa: E402

COLOURS = {"moving": (40, 40, 230), "static": (60, 180, 60), "not_judged": (0, 200, 230)}  # BGR
MARGIN = 0.6       # of a segment's size, shown around it
HEIGHT = 150       # px, of a picture
STYLE = """body{font:15px sans-serif;margin:2em auto;max-width:70em}figure{display:inline-block;
margin:.3em;vertical-align:top;width:19em}img{max-width:19em}figcaption{font-size:13px}
.moving{color:#c00}.static{color:#080}.not_judged{color:#a80}.wrong{background:#fcc}svg{background:#f4f4f4}"""


def state(text):
    if text not in COLOURS:
        raise ValueError(f"state '{text}'")
    return text


COLUMNS = {"frame": str, "camera": str, "input_id": str, "part": str, "identity": int,
           "label": int, "area_px": int, "state": state, **dict.fromkeys(
               ("log_odds", "mean_depth_m", "evidence_flow", "median_px", "valid", "patches",
                "evidence_appearance", "still_alike", "keypoints", "evidence_keypoints",
                "keypoint_inliers", "keypoint_shift_m", "keypoint_span_s", "evidence_space",
                "place_free", "place_occupied", "place_span_s"), float)}  # of segments.csv


def frame_number(text):
    digits = text[len(text.rstrip("0123456789")):]
    return int(digits) if digits else -1


def read_truth(path):
    """Whether it moves, by frame, camera, number in the segmentation and part of that segment."""
    rows = common.read_table(path, {"frame": str, "camera": str, "moving": str})
    with common.reading(path):
        return {(frame_number(row["frame"]), row["camera"], row.get("input_id") or row["segment_id"],
                 row.get("part", "0")): row["moving"] == "1" for row in rows}


def reasons(row):
    """What each source said, in words."""
    number, said = row, []
    if number["evidence_flow"]:
        said.append(f"flow {number['evidence_flow']:+.1f}: median residual {number['median_px']:.1f} px "
                    f"in {100 * number['valid']:.0f} % of its pixels")
    elif number["valid"] < 0.1:
        said.append(f"no flow ({100 * number['valid']:.0f} % valid)")
    else:
        said.append(f"flow 0: residual {number['median_px']:.1f} px, scattered or contradicted")
    if number["patches"]:
        said.append(f"appearance {number['evidence_appearance']:+.1f}: {100 * number['still_alike']:.0f} % of "
                    f"{number['patches']:.0f} patches agree with a static object")
    if number["keypoints"]:
        said.append(f"keypoints {number['evidence_keypoints']:+.1f}: {number['keypoint_inliers']:.0f} of "
                    f"{number['keypoints']:.0f} moved {number['keypoint_shift_m']:.2f} m in "
                    f"{number['keypoint_span_s']:.1f} s")
    if number["evidence_space"]:
        said.append(f"free space {number['evidence_space']:+.1f}: its place was free at "
                    f"{number['place_free']:.0f} px and occupied at "
                    f"{number['place_occupied']:.0f}, {number['place_span_s']:.1f} s before")
    return said


class Pictures:
    """Crops of segments with their outline."""

    def __init__(self, priors, folders):
        self.priors, self.folders = Path(priors), folders
        self.files = [None, None]  # by camera: image by name
        self.name, self.frame = None, None

    def load(self, name):
        """The priors of a frame."""
        if self.name != name:
            try:
                self.frame = kysp.read(self.priors / (name + ".kysp"))
            except (OSError, kysp.FormatError) as error:
                common.fail(common.first_line(error))
            self.name = name
        return self.frame

    def image_of(self, side, name):
        """The image file of a frame."""
        if self.files[side] is None:
            self.files[side] = {path.stem: path for path in common.list_images(self.folders[side])}
        if name not in self.files[side]:
            common.fail(f"{self.folders[side]}: has no image {name}")
        return self.files[side][name]

    def crop(self, row):
        """A JPEG of the segment's surroundings, or None where the segment is not in the file."""
        import cv2

        side = int(row["camera"] == "right")
        camera = self.load(row["frame"]).cameras[side]
        at = np.flatnonzero(camera.segments["instance"] == row["identity"])
        if len(at) == 0:
            return None
        mask = camera.segment_map == at[0] + 1
        rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        path = self.image_of(side, row["frame"])
        image = cv2.imread(str(path), cv2.IMREAD_COLOR)
        if image is None or image.shape[:2] != mask.shape:
            common.fail(f"{path}: is not an image of the priors' size")
        border = (int(MARGIN * len(rows)) + 12, int(MARGIN * len(columns)) + 20)
        y0, y1 = max(0, rows[0] - border[0]), min(mask.shape[0], rows[-1] + border[0] + 1)
        x0, x1 = max(0, columns[0] - border[1]), min(mask.shape[1], columns[-1] + border[1] + 1)
        scale = HEIGHT / (y1 - y0)
        size = (max(1, round(scale * (x1 - x0))), HEIGHT)
        picture = cv2.resize(image[y0:y1, x0:x1], size, interpolation=cv2.INTER_CUBIC)
        big = cv2.resize(mask[y0:y1, x0:x1].astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
        outlines, _ = cv2.findContours(big, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        cv2.drawContours(picture, outlines, -1, COLOURS[row["state"]], 2)
        good, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 80])
        return data.tobytes() if good else None


def curve(rows):
    """Belief of an object over time (log-odds, -5 to 5), as SVG."""
    frames = [frame_number(row["frame"]) for row in rows]
    first, last = min(frames), max(frames)
    points = " ".join(f"{10 + 480 * (f - first) / max(1, last - first):.0f},"
                      f"{30 - 5 * row['log_odds']:.1f}" for f, row in zip(frames, rows))
    return (f'<svg width="500" height="60"><line x1="0" y1="30" x2="500" y2="30" stroke="#aaa"/>'
            f'<polyline points="{points}" fill="none" stroke="#00c" stroke-width="2"/></svg>')


def is_wrong(row, truth):
    key = frame_number(row["frame"]), row["camera"], row["input_id"]
    moves = truth.get((*key, row["part"]), truth.get((*key, "0")))
    return moves is not None and moves != (row["state"] == "moving")


def chosen(rows, count, truth, wrong_alone):
    """Rows spread over an object's time; with a truth, wrong ones first."""
    wrong = [row for row in rows if is_wrong(row, truth)]
    rest = [] if wrong_alone else rows
    spread = [rest[round(i)] for i in np.linspace(0, len(rest) - 1, min(count, len(rest)))]
    some = [wrong[round(i)] for i in np.linspace(0, len(wrong) - 1, min(count, len(wrong)))]
    picked = {id(row): row for row in (some + spread)[:count]}
    return [row for row in rows if id(row) in picked]


def names_of(label_space):
    """Class names by dense label; empty where the label space is not known."""
    file = Path(__file__).resolve().parents[2] / "kys" / "data" / f"{label_space}.classes.csv"
    return [c.name for c in read_classes(file)[1]] if file.exists() else []


def figure(row, picture, names, truth):
    label = row["label"]
    name = names[label] if 0 <= label < len(names) else f"class {label}"
    wrong = is_wrong(row, truth)
    text = [f'<b class="{row["state"]}">{row["state"].replace("_", " ")}</b>'
            + (" <b>(the truth says otherwise)</b>" if wrong else ""),
            f"frame {html.escape(row['frame'])} {html.escape(row['camera'])}, {html.escape(name)}, {row['area_px']} px at "
            f"{row['mean_depth_m']:.0f} m, belief {row['log_odds']:+.1f}"]
    text += [html.escape(reason) for reason in reasons(row)]
    data = base64.b64encode(picture).decode("ascii")
    return (f'<figure class="{"wrong" if wrong else ""}"><img src="data:image/jpeg;base64,{data}" alt="">'
            f"<figcaption>{'<br>'.join(text)}</figcaption></figure>")


def make_page(options):
    rows = [row for row in common.read_table(Path(options.priors) / "segments.csv", COLUMNS)
            if row["area_px"] >= options.min_area]
    last = max(Path(options.priors).glob("*.kysp"), key=common.frame_order, default=Path()).stem
    rows = [row for row in rows if row["frame"] != last]
    if not rows:
        common.fail(f"{options.priors}: has no judged segments of {options.min_area} px before the last "
                    "frame (segments.csv)")
    truth = read_truth(options.truth) if options.truth else {}
    pictures = Pictures(options.priors, options.images)
    first = pictures.load(rows[0]["frame"])
    objects = {}
    for row in rows:
        shared = row["identity"] % kysp.RIGHT_INSTANCES if first.shares_instances else row["identity"]
        objects.setdefault(shared, []).append(row)
    if options.wrong:
        objects = {k: v for k, v in objects.items() if any(is_wrong(row, truth) for row in v)}

    def weight(item):
        moving = sum(row["state"] == "moving" for row in item[1])
        return (-min(moving, len(item[1]) - moving), -moving, -len(item[1]), item[0])

    kept = sorted(objects.items(), key=weight)[:options.objects]
    names = names_of(first.label_space)
    counts = {state: sum(row["state"] == state for row in rows) for state in COLOURS}
    wrong = sum(is_wrong(row, truth) for row in rows)
    parts = [f"<!doctype html><meta charset=utf-8><title>Decisions</title><style>{STYLE}</style>",
             "<h1>What is judged to move, and why</h1>",
             f"<p>{len(rows)} segments of at least {options.min_area} px: {counts['moving']} moving, "
             f"{counts['static']} static, {counts['not_judged']} not judged"
             + (f"; {wrong} wrong by the given truth" if truth else "") + ". Evidence is in nats: above 0 "
             "says moving. Belief adds up over both cameras and over time; above 0 an object counts as "
             f"moving. {len(kept)} of {len(objects)} objects are shown, those that are undecided first."
             "</p>"]
    for identity, seen in common.progress(kept, "objects"):
        parts.append(f"<h2>Object {identity}, {len(seen)} segments</h2>{curve(seen)}<div>")
        for row in chosen(seen, options.pictures, truth, options.wrong):
            picture = pictures.crop(row)
            if picture is not None:
                parts.append(figure(row, picture, names, truth))
        parts.append("</div>")
    common.write_atomic(options.output, "\n".join(parts).encode("utf-8"))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("priors", type=Path)
    parser.add_argument("sequence", type=Path)
    parser.add_argument("--output", required=True, type=Path, help="HTML file")
    parser.add_argument("--pair", default="", choices=tuple(common.PAIRS), help="images of SEQUENCE "
                        "(default: image_0 and image_1 if they exist), those the priors were made of")
    parser.add_argument("--truth", help="table of the true decisions")
    parser.add_argument("--wrong", action="store_true", help="only wrong decisions (with --truth)")
    parser.add_argument("--objects", type=common.whole(0), default=40, help="largest number of objects")
    parser.add_argument("--pictures", type=common.whole(0), default=6, help="largest number of images per object")
    parser.add_argument("--min-area", type=common.whole(0), default=200, help="px, of a segment")
    options = parser.parse_args()
    if options.wrong and not options.truth:
        parser.error("--wrong needs --truth")
    common.need("cv2")
    options.images = common.image_pair(options.sequence, options.pair)
    make_page(options)


if __name__ == "__main__":
    common.run(main)
