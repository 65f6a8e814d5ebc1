#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The pages of this repository as a site.

    make_site.py OUTPUT [--api HTML]    needs MkDocs (tools/setup.sh --site)
    make_site.py OUTPUT --check         only looks where the links lead

Copies every Markdown page, and what it shows or links to, into OUTPUT/pages, and lets MkDocs build
OUTPUT/html from them. A link to a file or heading that does not exist is an error. With --api the
folder of the API reference (target api_reference) becomes part of the site.
"""
import argparse
import os
import re
import shutil
import subprocess
import sys

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
LINK = re.compile(r"\]\(([^)\s#]*)(?:#([^)\s]*))?\)")
MAX_README_WORDS = 700  # read in five minutes
# By what readers look for; pages not named here are the folders of "Design".
NAVIGATION = [
    ("Start", "README.md"),
    ("Guide", [
        ("Guide", "docs/guide.md"),
        ("Calibration", "docs/calibration.md"),
        ("Saved maps", "docs/maps.md"),
        ("Pose quality", "docs/pose_quality.md"),
        ("Python package", "python/README.md"),
        ("Networks", "tools/perception/README.md"),
        ("Priors", "priors/README.md"),
        ("Examples", "examples/README.md"),
        ("ROS 2", "ros/README.md"),
        ("Packages", "packaging/README.md"),
    ]),
    ("Reference", [
        ("Reference", "docs/reference.md"),
        ("Troubleshooting", "docs/troubleshooting.md"),
        ("Glossary", "docs/glossary.md"),
        ("Settings", "configs/README.md"),
        ("Matching library", "kys/README.md"),
        ("Maps on disk", "src/map_file/README.md"),
        ("Feature files", "tools/simulator/features/README.md"),
        ("Changes", "CHANGELOG.md"),
        ("Security", "SECURITY.md"),
    ]),
    ("Results", [
        ("Results", "docs/results.md"),
        ("How it is measured", "docs/results/measuring.md"),
        ("Real recordings", "docs/real.md"),
        ("Dense traffic", "docs/results/traffic.md"),
        ("Cost", "docs/results/cost.md"),
        ("Tables 1 and 2", "docs/results/paper_tables_1_2.md"),
        ("Tables 3 to 5, S1 to S4", "docs/results/paper_tables_3_5.md"),
        ("Lessons", "docs/results/lessons.md"),
        ("Differences from the paper", "docs/differences.md"),
        ("Experiments", "tools/experiments/README.md"),
        ("Simulated worlds", "tools/simulator/README.md"),
        ("Plots", "tools/plots/README.md"),
    ]),
    ("Design", [
        ("Architecture", "docs/architecture.md"),
        ("Contributing", "CONTRIBUTING.md"),
        ("Dependencies", "third_party/README.md"),
    ]),
]


def pages():
    listed = subprocess.run(["git", "ls-files", "*.md"], cwd=ROOT, capture_output=True, text=True,
                            check=True).stdout.split()
    return [page for page in listed if page != "docs/api.md"]  # that one is Doxygen's


def text_of(page):
    """A page without code: what is between ``` or indented as code holds no links and no headings."""
    with open(os.path.join(ROOT, page), encoding="utf-8") as file:
        return re.sub(r"^(```.*?^```|    .*?)$", "", file.read(), flags=re.M | re.S)


def anchors(page):
    """The names by which links find the headings of a page."""
    headings = re.findall(r"^#+ +(.*?) *$", text_of(page), flags=re.M)
    return {re.sub(r"\s+", "-", re.sub(r"[^\w\s-]", "", title).strip().lower()) for title in headings}


def navigation(others, api):
    lines = []
    for title, content in NAVIGATION:
        if isinstance(content, str):
            lines.append(f'  - "{title}": {content}')
            continue
        lines.append(f'  - "{title}":')
        lines += [f'    - "{name}": {page}' for name, page in content]
        if title == "Reference" and api:
            lines.append('    - "C++ API": api/index.html')
    lines.append('    - "Folders":')  # the last section is "Design"
    return lines + [f'      - "{os.path.dirname(page) or page}": {page}' for page in others]


def copy(path, output):
    target = os.path.join(output, path)
    os.makedirs(os.path.dirname(target), exist_ok=True)
    shutil.copyfile(os.path.join(ROOT, path), target)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("output")
    parser.add_argument("--api", help="folder of the API reference")
    parser.add_argument("--check", action="store_true", help="check links and pages only")
    arguments = parser.parse_args()
    folder = os.path.join(arguments.output, "pages")
    shutil.rmtree(folder, ignore_errors=True)
    broken = []
    for page in pages():
        copy(page, folder)
        for link, heading in LINK.findall(text_of(page)):
            if "://" in link or link.startswith("mailto:"):
                continue
            path = os.path.normpath(os.path.join(os.path.dirname(page), link)) if link else page
            if not os.path.exists(os.path.join(ROOT, path)):
                broken.append(f"{page}: {link}")
            elif path.endswith(".md"):
                if heading and heading not in anchors(path):
                    broken.append(f"{page}: {link}#{heading}")
            elif os.path.isfile(os.path.join(ROOT, path)):
                copy(path, folder)
    if broken:
        sys.exit("links that lead nowhere:\n" + "\n".join(broken))
    with open(os.path.join(ROOT, "README.md"), encoding="utf-8") as file:
        words = len(re.findall("[0-9A-Za-z]+", file.read()))
    if words > MAX_README_WORDS:
        sys.exit(f"README.md: {words} words, at most {MAX_README_WORDS}; the rest belongs to docs")
    if arguments.check:
        return 0
    copy("docs/site.css", folder)
    if arguments.api:
        shutil.copytree(arguments.api, os.path.join(folder, "api"))
    named = {page for _, content in NAVIGATION
             for page in ([content] if isinstance(content, str) else [path for _, path in content])}
    others = sorted(set(pages()) - named)
    configuration = os.path.join(arguments.output, "mkdocs.yml")
    with open(configuration, "w", encoding="utf-8") as file:
        file.write("site_name: KYS-SLAM\ndocs_dir: pages\nsite_dir: html\nuse_directory_urls: false\n"
                   "theme: {name: readthedocs, highlightjs: false}\nextra_css: [docs/site.css]\n"
                   "validation: {links: {not_found: warn, anchors: warn}}\nnav:\n"
                   + "\n".join(navigation(others, arguments.api)) + "\n")
    return subprocess.run([sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "-f",
                           configuration]).returncode


if __name__ == "__main__":
    sys.exit(main())
