#!/usr/bin/env python3
"""The pages of this repository as a site.

    make_site.py OUTPUT [--api HTML]    needs MkDocs (tools/setup.sh --site)
    make_site.py OUTPUT --check         only looks where the links lead

Copies every Markdown page, and what it shows or links to, into OUTPUT/pages, and lets MkDocs build
OUTPUT/html from them. A link that leads nowhere is an error. With --api the folder of the API
reference (target api_reference) becomes part of the site.
"""
import argparse
import os
import re
import shutil
import subprocess
import sys

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
LINK = re.compile(r"\]\(([^)\s#]+)")
NAVIGATION = [
    ("Start", "README.md"),
    ("Architecture", "docs/architecture.md"),
    ("Differences from the paper", "docs/differences.md"),
    ("Results", "docs/results.md"),
    ("Calibration", "docs/calibration.md"),
    ("Python", "python/README.md"),
    ("Priors", "priors/README.md"),
    ("Matching library", "kys/README.md"),
    ("Examples", "examples/README.md"),
    ("Contributing", "CONTRIBUTING.md"),
    ("Changes", "CHANGELOG.md"),
]


def pages():
    listed = subprocess.run(["git", "ls-files", "*.md"], cwd=ROOT, capture_output=True, text=True,
                            check=True).stdout.split()
    return [page for page in listed if page != "docs/api.md"]  # that one is Doxygen's


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
        with open(os.path.join(ROOT, page), encoding="utf-8") as file:
            # What is between ``` or indented as code holds no links.
            text = re.sub(r"^(```.*?^```|    .*?)$", "", file.read(), flags=re.M | re.S)
        for link in LINK.findall(text):
            if "://" in link or link.startswith("mailto:"):
                continue
            path = os.path.normpath(os.path.join(os.path.dirname(page), link))
            if not os.path.exists(os.path.join(ROOT, path)):
                broken.append(f"{page}: {link}")
            elif os.path.isfile(os.path.join(ROOT, path)) and not path.endswith(".md"):
                copy(path, folder)
    if broken:
        sys.exit("links that lead nowhere:\n" + "\n".join(broken))
    if arguments.check:
        return 0
    navigation = [f'  - "{title}": {page}' for title, page in NAVIGATION]
    if arguments.api:
        shutil.copytree(arguments.api, os.path.join(folder, "api"))
        navigation.append('  - "API reference": api/index.html')
    others = sorted(set(pages()) - {page for _, page in NAVIGATION})
    navigation.append('  - "Folders":')
    navigation += [f'    - "{os.path.dirname(page) or page}": {page}' for page in others]
    configuration = os.path.join(arguments.output, "mkdocs.yml")
    with open(configuration, "w", encoding="utf-8") as file:
        file.write("site_name: KYS-SLAM\ndocs_dir: pages\nsite_dir: html\nuse_directory_urls: false\n"
                   "theme: {name: readthedocs, highlightjs: false}\n"
                   "validation: {links: {not_found: warn, anchors: warn}}\nnav:\n"
                   + "\n".join(navigation) + "\n")
    return subprocess.run([sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "-f",
                           configuration]).returncode


if __name__ == "__main__":
    sys.exit(main())
