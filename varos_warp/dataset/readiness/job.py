"""Readiness of one dataset, of several, or of all that a sweep has made."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from varos_warp.dataset import files
from varos_warp.dataset.layout import datasets_in
from varos_warp.dataset.progress import Progress
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.readiness.measure import Readiness, check, measure
from varos_warp.dataset.readiness.opencv import opencv
from varos_warp.errors import InputError
from varos_warp.files import is_file

SWEEP = "sweep.json"


def of_one_sea(roots: Sequence[Path]) -> dict[Path, str]:
    """A name for what datasets of sweeps have in common that differ in nothing but the key ``seed``, by folder.

    Those that no other one is like are left out, and so are those with a seed that one before them has: they are the
    same again, and tell nothing of the spread.
    """
    alike: dict[tuple[Path, str], dict[int, tuple[str, Path]]] = {}
    for root in roots:
        if not is_file(root / SWEEP):
            continue
        for version in files.read_json(root / SWEEP)["versions"]:
            rest = {key: value for key, value in version["overrides"].items() if key != "seed"}
            for entry in version["datasets"]:
                vehicle, folder = Path(entry["folder"]).relative_to(version["name"]), root / entry["folder"]
                if is_file(folder / "dataset.json"):
                    key = (root, json.dumps([rest, str(vehicle)], sort_keys=True))
                    seed = version["overrides"].get("seed", files.read_json(folder / "dataset.json").get("seed"))
                    alike.setdefault(key, {}).setdefault(seed, (_named(root / vehicle, rest), folder))
    groups = [list(group.values()) for group in alike.values() if len(group) > 1]
    return {folder.absolute(): name for group in groups for name, folder in group}


def _named(root: Path, rest: dict) -> str:
    """Name of a group of datasets, such as ``waters water.jerlov.type=IB``."""
    return " ".join([str(root), *(f"{key}={value}" for key, value in rest.items())])


def named(roots: Sequence[Path]) -> list[Path]:
    """Folders of the datasets that paths lead to, each once: those of sweeps and of several vehicles, too."""
    found = [folder for root in roots for folder in (_of_sweep(root) if is_file(root / SWEEP) else datasets_in(root))]
    return list({folder.absolute(): folder for folder in found}.values())


def _of_sweep(root: Path) -> list[Path]:
    content = files.read_json(root / SWEEP)
    versions = content.get("versions") if isinstance(content, dict) else None
    try:
        folders = [root / entry["folder"] for version in versions or () for entry in version["datasets"]]
    except (KeyError, TypeError):
        raise InputError("is not the list of a sweep", file=root / SWEEP, remedy="Run the sweep again.") from None
    made = [folder for folder in folders if is_file(folder / "dataset.json")]
    if not made:
        raise InputError("the sweep has made no dataset yet", file=root / SWEEP, remedy="Run the sweep first.")
    return made


def readiness(roots: Sequence[Path], camera: str | None = None, seeds: int = 3, quiet: bool = True) -> list[Readiness]:
    """Measure datasets, after all were looked at: what cannot be measured is refused before any work.

    Args:
        roots: Folders of datasets, of sweeps or of runs of several vehicles.
        camera: Id of the camera; absent: the first of each.
        seeds: Runs of the odometry on each.
        quiet: No progress.

    Raises:
        InputError: As `measure` does, or if ``seeds`` is less than 1.
    """
    if seeds < 1:
        raise InputError("at least one run is needed", key="seeds", value=seeds, remedy="Such as --seeds 3.")
    opencv()
    folders = named(roots)
    groups = of_one_sea(roots)
    for folder in folders:
        data = Dataset(folder)
        check(data, data.camera(camera)["id"])
    found = []
    with Progress("readiness", len(folders), "datasets", quiet) as progress:
        for folder in folders:
            found.append(replace(measure(folder, camera, seeds), group=groups.get(folder.absolute())))
            progress.advance()
    return found
