"""The geometry of a dataset's scene, made anew."""

from pathlib import Path

from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.write import texts as writers
from varos_warp.errors import InputError
from varos_warp.scene.description import Scene
from varos_warp.scene.file.load import scene_from_dict


def rebuilt(data: Dataset, scene_dir: str | Path = ".") -> tuple[Scene, list]:
    """The scene of a dataset and everything solid in it, as ``build_parts`` makes it; once for each ``data``.

    Files are those in ``scene_dir``; an `InputError` names one that is not at hand, or not as it was. Where its own
    vehicle was the poses of the dataset tell: of a recorded course the file is not needed.
    """
    return data._once(("geometry", str(scene_dir)), lambda: _rebuilt(data, scene_dir))


def _rebuilt(data, scene_dir):
    from varos_warp.scene.geometry.build import build_parts

    scene = scene_from_dict(data.meta["scene"], scene_dir)
    changed = [
        name
        for name, digest in writers.sources(scene).items()
        if digest != data.meta["sources"].get(name) and name != scene.trajectory.file
    ]
    if changed:
        raise InputError(f"{changed[0]} is not at hand, or not as it was")
    return scene, build_parts(scene)
