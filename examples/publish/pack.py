"""The archive of a publication, with bytes that follow from those of its files alone; the table of views; checksums."""

import csv
import hashlib
import io
import os
import tarfile
from pathlib import Path

from facts import Facts

from varos_warp.dataset.write.checksums import NAME, sha256
from varos_warp.errors import InputError

TIME = 315532800
"""Of every file: 1980-01-01."""


def pack(facts: Facts, sweep: Path, place: Path) -> Path:
    """Write the archive: every dataset with the files that its checksums list, in order.

    A file that an earlier dataset has under the same name with the same bytes is a hard link to it, and so takes no
    place, whether or not the disk has it as one.

    Raises:
        InputError: If a file is not as its checksum says; then there is no archive.
    """
    path, part = place / f"{facts.name}.tar", place / f".{facts.name}.tar.part"
    first: dict[tuple[str, str], str] = {}
    try:
        with tarfile.open(part, "w", format=tarfile.PAX_FORMAT) as tar:
            add(tar, sweep, f"{facts.name}/{sweep.name}", sha256(sweep))
            for data, sums in zip(facts.datasets, facts.sums, strict=True):
                for name, value in sorted({**sums, NAME: sha256(data.root / NAME)}.items()):
                    member = f"{facts.name}/{data.root.name}/{name}"
                    if (name, value) in first:
                        tar.addfile(entry(member, link=first[name, value]))
                    else:
                        add(tar, data.root / name, member, value)
                        first[name, value] = member
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
    return path


def add(tar: tarfile.TarFile, path: Path, member: str, value: str) -> None:
    """Add a file whose SHA-256 is known."""
    content = path.read_bytes()
    if hashlib.sha256(content).hexdigest() != value:
        raise InputError(
            "is not as it was written: its checksum differs", file=path, remedy="Delete it and run the command again."
        )
    tar.addfile(entry(member, size=len(content)), io.BytesIO(content))


def entry(member: str, size: int = 0, link: str = "") -> tarfile.TarInfo:
    """Header of a file, the same whoever packs it and whenever."""
    info = tarfile.TarInfo(member)
    info.size, info.mtime, info.mode = size, TIME, 0o644
    if link:
        info.type, info.linkname = tarfile.LNKTYPE, link
    return info


def write_index(facts: Facts, place: Path) -> Path:
    """Write the table of all views: water, camera, number, time, and the path of each image in the archive."""
    path = place / "frames.csv"
    letters = facts.datasets[0].outputs
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["water", "camera", "frame", "time_ns", *letters])
        for data in facts.datasets:
            for camera in data.cameras:
                for frame in data[:, camera]:
                    images = [data.layout.image(camera, letter, frame.number) for letter in letters]
                    names = [
                        f"{facts.name}/{data.root.name}/{image.relative_to(data.root).as_posix()}" for image in images
                    ]
                    table.writerow([data.root.name, camera, frame.number, frame.time_ns, *names])
    return path


def write_sums(place: Path) -> None:
    """Write the SHA-256 of every file that is published, as ``sha256sum -c`` reads it; the last file to be written."""
    lines = [f"{sha256(path)}  {path.name}\n" for path in sorted(place.iterdir())]
    (place / "SHA256SUMS").write_text("".join(lines), encoding="utf-8")
