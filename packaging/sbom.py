# SPDX-License-Identifier: BSD-3-Clause
"""Lists what a package of ours contains of others, with licences (CycloneDX 1.5, JSON).

    sbom.py wheel FILE.whl...       puts the list and the licences' texts into wheels that auditwheel repaired
    sbom.py package NAME FOLDER     writes NAME.cdx.json for a Debian package into a folder

packaging/components.csv says what is compiled into which package, and the licence of each library; SuiteSparse,
which decides the licence of a package, is listed where it is linked. Versions,
texts and names of packages come from the Debian system that the package is built on. A library in a wheel that
the table does not know, or one under the GPL or LGPL, is an error (exit status 2).
"""

import argparse
import csv
import datetime
import hashlib
import importlib.metadata
import json
import os
import platform
import re
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Dict, List, NamedTuple, Optional

HERE = Path(__file__).resolve().parent
BUNDLED = re.compile(r"\.libs/(?P<stem>.+?)-[0-9a-f]{8,}(?P<rest>\.so[0-9.]*)$")  # as auditwheel renames


class InputError(Exception):
    """What is wrong with a package or the table, in one line."""


class Component(NamedTuple):
    """A row of components.csv."""
    name: str
    licence: str    # SPDX expression
    library: str    # file name up to .so, of shared libraries
    source: str     # Debian package, "pip NAME", "pip NAME HEADER" (its first comment) or "file PATH"
    packages: List[str]  # of ours, into which it is compiled, or which are linked with it


def read_components(machine: str = platform.machine()) -> List[Component]:
    """The rows for all architectures, and those for `machine` alone."""
    with open(HERE / "components.csv", encoding="ascii", newline="") as file:
        return [Component(r["name"], r["licence"], r["library"], r["source"], r["packages"].split())
                for r in csv.DictReader(file) if r["machine"] in ("", machine)]


def output_of(*call: str) -> str:
    try:
        return subprocess.run(call, check=True, capture_output=True, text=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError) as error:
        raise InputError(f"{' '.join(call)}: {getattr(error, 'stderr', None) or error}".strip()) from None


class Origin(NamedTuple):
    """Where a component came from."""
    version: Optional[str]
    purl: Optional[str]
    text: bytes  # copyright and licence


def deb_origin(package: str) -> Origin:
    version, architecture = output_of("dpkg-query", "-W", "-f=${Version} ${Architecture}", package).split()
    text = Path(f"/usr/share/doc/{package.split(':')[0]}/copyright").read_bytes()
    vendor = output_of("sh", "-c", ". /etc/os-release && echo $ID")
    quoted = version.replace("+", "%2B").replace(":", "%3A")
    return Origin(version, f"pkg:deb/{vendor}/{package.split(':')[0]}@{quoted}?arch={architecture}", text)


def origin_of(source: str) -> Origin:
    kind, _, rest = source.partition(" ")
    if kind == "file":
        return Origin(None, None, Path(rest).read_bytes())
    if kind == "pip":
        return pip_origin(*rest.split())
    return deb_origin(source)


def pip_origin(package: str, header: str = "") -> Origin:
    try:
        found = importlib.metadata.distribution(package)
    except importlib.metadata.PackageNotFoundError:
        raise InputError(f"{package} is not installed for {sys.executable}") from None
    if header:  # a copy of another project, whose version is not told
        text = Path(str(found.locate_file(header))).read_bytes().split(b"*/")[0] + b"*/\n"
        return Origin(None, None, text)
    text = b"\n".join(Path(str(found.locate_file(f))).read_bytes() for f in found.files or []
                      if "licen" in str(f).lower())
    return Origin(found.version, f"pkg:pypi/{package}@{found.version}", text)


def entry(component: Component, origin: Origin, scope: str) -> Dict:
    simple = " " not in component.licence
    row = {
        "type": "library", "name": component.name, "version": origin.version, "purl": origin.purl,
        "licenses": [{"license": {"id": component.licence}} if simple else {"expression": component.licence}],
        "properties": [{"name": "kys-slam:contained", "value": scope}],
    }
    return {key: value for key, value in row.items() if value is not None}


def document(name: str, version: str, entries: List[Dict]) -> bytes:
    licence = "GPL-3.0-or-later" if name == "kys-slam-maps" else "BSD-3-Clause"  # as its copyright file says
    stamp = datetime.datetime.fromtimestamp(int(os.environ.get("SOURCE_DATE_EPOCH", "0")), datetime.timezone.utc)
    entries = sorted(entries, key=lambda e: e["name"].lower())
    for i, row in enumerate(entries):
        row["bom-ref"] = f"component-{i}"
    content = {
        "$schema": "http://cyclonedx.org/schema/bom-1.5.schema.json",
        "bomFormat": "CycloneDX", "specVersion": "1.5", "version": 1,
        "metadata": {
            "timestamp": stamp.strftime("%Y-%m-%dT%H:%M:%SZ"),
            "component": {"type": "application", "bom-ref": "self", "name": name, "version": version,
                          "licenses": [{"license": {"id": licence}}]},
        },
        "components": entries,
        "dependencies": [{"ref": "self", "dependsOn": [row["bom-ref"] for row in entries]}],
    }
    return (json.dumps(content, indent=1) + "\n").encode()


def project_version() -> str:
    text = (HERE.parent / "CMakeLists.txt").read_text(encoding="utf-8")
    found = re.search(r"project\(kys_slam VERSION ([0-9.]+)", text)
    assert found
    return found[1]


def package_list(name: str) -> bytes:
    """The list for a Debian package. Shared libraries are its dependencies, and mostly not in it."""
    parts = [c for c in read_components() if name in c.packages]
    if not parts:
        raise InputError(f"components.csv has nothing for {name}")
    return document(name, project_version(), [
        entry(c, origin_of(c.source), "linked: a dependency" if c.library else "compiled in") for c in parts])


def owner_of(library: str) -> str:
    """The Debian package of a shared library."""
    found = {line.split(": ")[0] for line in output_of("dpkg", "-S", f"*/{library}").splitlines()}
    if len(found) != 1:
        raise InputError(f"{library} is in {', '.join(sorted(found))}")
    return found.pop()


def complete_wheel(path: Path) -> None:
    """Adds the list and the texts to a wheel, in place."""
    table = read_components()
    with zipfile.ZipFile(path) as old:
        members = [(info, old.read(info)) for info in old.infolist() if not info.is_dir()]
    info_folder = next(i.filename.split("/")[0] for i, _ in members if i.filename.endswith(".dist-info/WHEEL"))
    entries, texts = [], {}

    def add(component: Component, origin: Origin, scope: str, data: Optional[bytes] = None) -> None:
        if "GPL" in component.licence:
            raise InputError(f"{component.name} is under {component.licence}: not for a wheel")
        row = entry(component, origin, scope)
        if data is not None:
            row["hashes"] = [{"alg": "SHA-256", "content": hashlib.sha256(data).hexdigest()}]
        entries.append(row)
        texts[re.sub(r"[^A-Za-z0-9]+", "-", component.name).strip("-") + ".txt"] = origin.text

    for info, data in members:
        if ".libs/" not in info.filename:
            continue
        found = BUNDLED.search(info.filename)
        component = next((c for c in table if found and c.library == found["stem"]), None)
        if not found or component is None:
            raise InputError(f"components.csv does not know {info.filename}")
        add(component, deb_origin(owner_of(found["stem"] + found["rest"])), f"copied: {info.filename}", data)
    for component in table:
        if "wheel" in component.packages:
            add(component, origin_of(component.source), "compiled in")

    from wheel.wheelfile import WheelFile  # of the environment that builds
    named = path.parent / "new" / path.name  # WheelFile reads the project's name from the file's
    named.parent.mkdir(exist_ok=True)
    with WheelFile(named, "w", compression=zipfile.ZIP_DEFLATED) as wheel:
        for info, data in members:
            generated = info.filename.endswith(".dist-info/RECORD") or f"{info_folder}/sboms/" in info.filename
            if not generated:
                wheel.writestr(info, data)
        stamp = members[0][0].date_time

        def write(name: str, data: bytes) -> None:
            info = zipfile.ZipInfo(f"{info_folder}/{name}", stamp)
            info.external_attr = 0o100644 << 16
            info.compress_type = zipfile.ZIP_DEFLATED
            wheel.writestr(info, data)

        version = re.search(r"-([^-]+)\.dist-info$", info_folder)
        assert version
        write("sboms/kys-slam.cdx.json", document("kys-slam", version[1], entries))
        for name, text in sorted(texts.items()):
            write(f"licenses/bundled/{name}", text)
    os.replace(named, path)
    named.parent.rmdir()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    wheel = commands.add_parser("wheel")
    wheel.add_argument("wheels", nargs="+", type=Path)
    package = commands.add_parser("package")
    package.add_argument("name")
    package.add_argument("folder", type=Path)
    args = parser.parse_args()
    if args.command == "wheel":
        for path in args.wheels:
            complete_wheel(path)
    else:
        (args.folder / f"{args.name}.cdx.json").write_bytes(package_list(args.name))
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except InputError as error:
        print(f"sbom.py: {error}", file=sys.stderr)
        sys.exit(2)
