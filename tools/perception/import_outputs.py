# SPDX-License-Identifier: BSD-3-Clause
"""Outputs of networks that ran elsewhere, as build_priors reads them.

    import_outputs.py unimatch-flow FOLDER --output flow/left [--backward flow_back/left]
    import_outputs.py unimatch-disparity FOLDER --output disparity [--right disparity_right]
    import_outputs.py kmax FOLDER --json predictions.json --output panoptic/left

UniMatch, run with --save_flo_flow (--pred_bidir_flow) or --save_pfm_disp (--pred_bidir_disp), leaves
NAME_pred.flo, NAME_pred_bwd.flo, NAME_disp.pfm, NAME_disp_right.pfm. kMaX-DeepLab (and whatever else
is evaluated by detectron2's COCO panoptic evaluator) leaves NAME.png and predictions.json. NAME has to
be that of the sequence's image. --images: the folder of images they were made of (disparity: of left
images), noted so that build_priors refuses them for another camera pair.
"""

import argparse
import json
import shutil
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import common  # noqa: E402


def take(folder, ending, output, images):
    """Copies NAME<ending> to OUTPUT/NAME<suffix>; how many there are."""
    files = sorted(Path(folder).glob("*" + ending))
    if not files:
        common.fail(f"{folder}: holds no *{ending}")
    output = Path(output)
    output.mkdir(parents=True, exist_ok=True)
    for file in files:
        target = output / (file.name[:-len(ending)] + file.suffix)
        shutil.copyfile(file, target)
    if images:
        common.note_images(output, images)
    return len(files)


def right_images(left):
    """The folder of the right images beside a folder of left ones; None where its name does not say."""
    partner = dict(common.PAIRS.values()).get(Path(left).resolve().name) if left else None
    return partner and Path(left).resolve().with_name(partner)


def take_panoptic(folder, document, output, images):
    """COCO panoptic: PNG files, and the document with their segments as OUTPUT.json."""
    try:
        annotations = json.loads(Path(document).read_text(encoding="utf-8"))["annotations"]
        segments = {Path(a["file_name"]).stem: a["segments_info"] for a in annotations}
        for name, infos in segments.items():
            for info in infos:
                int(info["id"]), int(info["category_id"])
    except OSError as error:
        common.fail(f"{document}: {error.strerror}")
    except common.BAD_CONTENT as error:
        common.fail(f"{document}: not the document of COCO panoptic predictions "
                    f"({common.first_line(error)})")
    output = Path(output)
    count = take(folder, ".png", output, images)
    missing = [f.stem for f in sorted(output.glob("*.png")) if f.stem not in segments]
    if missing:
        common.fail(f"{document}: says nothing of {missing[0]}.png")
    kept = [{"file_name": f"{name}.png", "segments_info": infos}
            for name, infos in sorted(segments.items())]
    common.write_atomic(output.parent / f"{output.name}.json",
                        json.dumps({"annotations": kept}).encode())
    return count


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0],
                                     formatter_class=argparse.RawDescriptionHelpFormatter,
                                     epilog=__doc__)
    parser.add_argument("kind", choices=("unimatch-flow", "unimatch-disparity", "kmax"))
    parser.add_argument("folder")
    parser.add_argument("--output", required=True)
    parser.add_argument("--backward", help="folder for the backward flow")
    parser.add_argument("--right", help="folder for the right disparity")
    parser.add_argument("--json", help="JSON file of the predictions (kmax)")
    parser.add_argument("--images", help="folder of the input images")
    options = parser.parse_args()
    if options.kind == "kmax":
        if not options.json:
            common.fail("kmax needs --json predictions.json")
        count = take_panoptic(options.folder, options.json, options.output, options.images)
    else:
        ending, other, second = (("_pred.flo", "_pred_bwd.flo", options.backward)
                                 if options.kind == "unimatch-flow" else
                                 ("_disp.pfm", "_disp_right.pfm", options.right))
        count = take(options.folder, ending, options.output, options.images)
        if second:
            right = options.kind == "unimatch-disparity"
            take(options.folder, other, second, right_images(options.images) if right else options.images)
    print(f"{count} files")


if __name__ == "__main__":
    common.run(main)
