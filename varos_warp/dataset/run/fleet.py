"""A run of a scene with several vehicles: a dataset of each, one after another."""

from pathlib import Path
from typing import Any

from varos_warp.dataset.layout import Layout, folder_of_vehicle
from varos_warp.dataset.run import produce
from varos_warp.dataset.write.folder import open_folder
from varos_warp.errors import InputError
from varos_warp.scene.description import Scene


def produce_each(scene: Scene, out: Path, only: str | None = None, **options: Any) -> dict[str, produce.Summary]:
    """Produce what each of a scene's ``vehicles``, or ``only`` one, sees in ``OUT/vehID``; of one ``vehicle`` in OUT.

    Options, summaries by the vehicles' ids, and errors are those of `produce.produce`; before anything is made it
    refuses a folder that holds something else.
    """
    found = datasets_of(scene, out, only)
    for alone, root in found.values() if scene.vehicles else ():
        open_folder(alone, Layout.of(alone, root))
    return {each: produce.produce(alone, root, **options) for each, (alone, root) in found.items()}


def datasets_of(scene: Scene, out: Path, only: str | None = None) -> dict[str, tuple[Scene, Path]]:
    """The scene as each vehicle sees it, or ``only`` one, and the folder of its dataset, by the vehicles' ids."""
    if not scene.vehicles:
        return {scene.vehicle.id: (scene, out)}
    if (out / "dataset.json").exists():
        raise InputError(
            "holds a dataset, but each of the scene's vehicles gets one in a folder inside",
            file=out,
            remedy="Give another folder with -o.",
        )
    return {
        vehicle.id: (scene.observed_by(vehicle.id), folder_of_vehicle(out, vehicle.id))
        for vehicle in scene.vehicles
        if only in (None, vehicle.id)
    }
