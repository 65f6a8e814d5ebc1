#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Runs plot_trajectory.py on a made-up run: pictures are made, bad input is one line and status 2."""
import importlib.util
import os
import subprocess
import sys
import tempfile

SKIPPED = 77


def run(*arguments):
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=False,
                          errors="replace", env={**os.environ, "PYTHONIOENCODING": "utf-8:strict"})


def check_labels(script, folder, truth):
    """Every text of the comparison is readable: no formula is left as it is written."""
    sys.path.insert(0, os.path.dirname(script))
    import compare_runs
    figures = []
    compare_runs.save = lambda figure, path: figures.append(figure)
    before, sys.argv = sys.argv, ["compare_runs.py", folder, "--ground-truth", truth, "--output", "x.png"]
    try:
        assert compare_runs.main() == 0
    finally:
        sys.argv = before
    figures[0].canvas.draw()
    texts = [label.get_text() for axes in figures[0].axes
             for label in axes.get_yticklabels() + axes.get_xticklabels()]
    assert any(texts) and not any("$" in text for text in texts), texts


def main():
    if any(importlib.util.find_spec(name) is None for name in ("matplotlib", "numpy")):
        print("no matplotlib")
        return SKIPPED
    script = sys.argv[1]
    data = os.path.join(os.path.dirname(os.path.abspath(__file__)), "data")
    with tempfile.TemporaryDirectory() as folder:
        with open(os.path.join(data, "estimate.tum"), encoding="utf-8") as file:
            text = file.read()
        with open(os.path.join(folder, "trajectory.tum"), "w", encoding="utf-8") as file:
            file.write(text)
        with open(os.path.join(folder, "summary.json"), "w", encoding="utf-8") as file:
            file.write('{"mode": "stock"}')
        picture = os.path.join(folder, "trajectory.png")
        truth = os.path.join(data, "reference.tum")
        for extra in ([], ["--ground-truth", truth], ["--ground-truth", truth, "--plane", "xy"]):
            result = run(script, folder, *extra)
            assert result.returncode == 0, result.stderr
            with open(picture, "rb") as file:
                content = file.read()
            assert content.startswith(b"\x89PNG") and len(content) > 10000, len(content)
            os.unlink(picture)
        # A name that matplotlib would take for a formula, and a summary that is nested too deeply.
        odd = os.path.join(folder, "a$b$c_{x}")
        os.mkdir(odd)
        for name, content in (("trajectory.tum", text), ("summary.json", "[" * 100000)):
            with open(os.path.join(odd, name), "w", encoding="utf-8") as file:
                file.write(content)
        result = run(script, odd)
        assert result.returncode == 0, result.stderr
        # A name that is not UTF-8, and one that is half a formula.
        for name in (b"caf\xe9", b"a$b$c_{x"):
            odd = os.path.join(folder, os.fsdecode(name))
            os.mkdir(odd)
            with open(os.path.join(odd, "trajectory.tum"), "w", encoding="utf-8") as file:
                file.write(text)
            compare = os.path.join(os.path.dirname(script), "compare_runs.py")
            for command in ((script, odd), (compare, odd, "--ground-truth", truth, "--output",
                                             os.path.join(odd, "c.png"))):
                result = run(*command)
                assert result.returncode == 0, result.stderr
        # Moving objects are drawn into the picture: it changes.
        objects = os.path.join(folder, "objects.csv")
        pictures = []
        for rows in ("", "".join(f"{k},{k:06},{k},65540,car,1,40,{k},0,{9 * k},1,0,9,0.1\n"
                                 for k in range(20))):
            with open(objects, "w", encoding="utf-8") as file:
                file.write("frame,name,timestamp,instance,class,p_moving,keypoints,x,y,z,vx,vy,vz,"
                           "sigma_v\n" + rows)
            result = run(script, folder, "--ground-truth", truth)
            assert result.returncode == 0, result.stderr
            with open(picture, "rb") as file:
                pictures.append(file.read())
        assert pictures[0] != pictures[1]
        with open(objects, "a", encoding="utf-8") as file:
            file.write("20,000020,20,65540,car,1,40,nan,0,1,1,0,9,0.1\n")
        result = run(script, folder)
        assert result.returncode == 2 and "objects.csv" in result.stderr, result
        os.unlink(objects)
        compare = os.path.join(os.path.dirname(script), "compare_runs.py")
        together = os.path.join(folder, "together.png")
        result = run(compare, folder, f"{folder}=same $", "--ground-truth", truth, "--output", together)
        assert result.returncode == 0, result.stderr
        with open(together, "rb") as file:
            plots = file.read()
        assert plots.startswith(b"\x89PNG")
        result = run(compare, folder, "--ground-truth", truth, "--output", together, "--image", picture)
        assert result.returncode == 0, result.stderr
        with open(together, "rb") as file:
            assert file.read(24)[20:] > plots[20:24]  # the height in the header
        check_labels(script, folder, truth)
        for bad in (["/none", "--output", together], [folder, "--output", together],
                    [folder, "--ground-truth", truth, "--output", "/none/x.png"],
                    [folder, "--ground-truth", truth, "--output", together, "--image", truth],
                    [folder, "--ground-truth", truth, "--output", together, "--image", "/none"]):
            result = run(compare, *bad)
            assert result.returncode == 2 and result.stderr.count("\n") == 1, (bad, result)
        for bad in (["/none"], [folder, "--ground-truth", "/none"],
                    [folder, "--ground-truth", script], [folder, "--output", "/none/x.png"]):
            result = run(script, *bad)
            assert result.returncode == 2, (bad, result)
            assert result.stderr.count("\n") == 1, result.stderr
    return 0


if __name__ == "__main__":
    sys.exit(main())
