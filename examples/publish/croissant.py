"""Croissant metadata of a publication (JSON-LD, version 1.0 of its vocabulary), which data set searches read."""

import importlib.metadata
import json
import logging
from pathlib import Path

from facts import LICENCES, Facts

from varos_warp.dataset.write.checksums import sha256
from varos_warp.errors import InputError

CONTEXT = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "sc": "https://schema.org/",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "dct": "http://purl.org/dc/terms/",
    "conformsTo": "dct:conformsTo",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "examples": {"@id": "cr:examples", "@type": "@json"},
    **{
        term: f"cr:{term}"
        for term in (
            "citeAs column extract field fileProperty fileObject fileSet format includes isLiveDataset jsonPath key "
            "md5 parentField path recordSet references regex repeated replace separator source subField transform"
        ).split()
    },
}
"""As the specification gives it."""


def write_croissant(facts: Facts, archive: Path, index: Path, place: Path) -> Path:
    """Write the metadata, and return their path."""
    about = {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "name": facts.name,
        "description": description(facts),
        "version": semantic(facts.version),
        "license": LICENCES[facts.licence],
        "url": facts.url,
        "datePublished": facts.date,
        "creator": {"@type": "sc:Organization", "name": "The varos_warp authors"},
        "citeAs": f"The varos_warp authors: {facts.name}, made by varos_warp {facts.version}"
        + (f", commit {facts.commit}" if facts.commit else ""),
        "keywords": ["underwater", "synthetic", "stereo", "depth", "optical flow", "visual odometry"],
        "distribution": [
            file_object(archive, "application/x-tar"),
            file_object(index, "text/csv"),
            *(image_set(facts, letter, archive) for letter in facts.datasets[0].outputs),
        ],
        "recordSet": [record_set(facts, index)],
    }
    path = place / "croissant.json"
    kept = {key: value for key, value in about.items() if value is not None}
    path.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    return path


def description(facts: Facts) -> str:
    """What it is, in two sentences."""
    first = facts.datasets[0]
    waters = ", ".join(data.root.name for data in facts.datasets)
    return (
        f"A synthetic underwater sequence with exact ground truth: the same course of {len(first)} frames through "
        f"{len(first.cameras)} cameras in {len(facts.datasets)} waters ({waters}). "
        "Path traced by varos_warp with all orders of scattering."
    )


def semantic(version: str) -> str:
    """A version as Croissant asks for it, of three numbers: what stands behind them is left out."""
    numbers = [part for part in version.replace("+", ".").split(".") if part.isdigit()]
    return ".".join([*numbers, "0", "0"][:3])


def file_object(path: Path, form: str) -> dict:
    """A file that is published."""
    return {
        "@type": "cr:FileObject",
        "@id": path.name,
        "name": path.name,
        "contentUrl": path.name,
        "contentSize": f"{path.stat().st_size} B",
        "encodingFormat": form,
        "sha256": sha256(path),
    }


def image_set(facts: Facts, letter: str, archive: Path) -> dict:
    """The images of a type, in the archive."""
    data = facts.datasets[0]
    path = data.layout.image(data.cameras[0], letter, data.frames[0])
    return {
        "@type": "cr:FileSet",
        "@id": f"images-{letter}",
        "name": f"images-{letter}",
        "description": facts.meaning(letter),
        "containedIn": {"@id": archive.name},
        "encodingFormat": "image/png" if path.suffix == ".png" else "image/x-exr",
        "includes": f"{facts.name}/*/vehicle*/cam*/{letter}/*{path.suffix}",
    }


def record_set(facts: Facts, index: Path) -> dict:
    """The table of views."""
    columns = {
        "water": ("sc:Text", "Folder of the water's dataset."),
        "camera": ("sc:Text", "Id of the camera."),
        "frame": ("sc:Integer", "Number of the frame."),
        "time_ns": ("sc:Integer", "Nanoseconds since the sequence began."),
        **{
            letter: ("sc:Text", f"Path in the archive. {facts.meaning(letter)}") for letter in facts.datasets[0].outputs
        },
    }
    return {
        "@type": "cr:RecordSet",
        "@id": "frames",
        "name": "frames",
        "description": "Every view in every water.",
        "field": [
            {
                "@type": "cr:Field",
                "@id": f"frames/{name}",
                "name": name,
                "description": meaning,
                "dataType": kind,
                "source": {"fileObject": {"@id": index.name}, "extract": {"column": name}},
            }
            for name, (kind, meaning) in columns.items()
        ],
    }


def valid(path: Path) -> str:
    """Check the metadata with mlcroissant, and say so; without it, say that.

    Raises:
        InputError: If they are not valid.
    """
    try:
        import mlcroissant
    except ImportError:
        return "not validated: pip install mlcroissant"
    logging.getLogger("absl").setLevel(logging.ERROR)
    try:
        mlcroissant.Dataset(path)
    except mlcroissant.ValidationError as error:
        raise InputError(f"mlcroissant finds it not valid: {error}", file=path) from None
    return f"validated by mlcroissant {importlib.metadata.version('mlcroissant')}"
