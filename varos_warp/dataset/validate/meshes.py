"""The meshes that a dataset was made of, where their files are at hand: what was built against what the files hold."""

from pathlib import Path

from varos_warp.dataset.geometry import rebuilt
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.validate.outcome import Validation
from varos_warp.errors import InputError
from varos_warp.scene.geometry.mesh_files import FORMATS, LEAST_LOSS


def check_meshes(data: Dataset, result: Validation) -> None:
    """The area of what is built is that of the faces in the files; what their readers warn of is told anew."""
    if not any(Path(name).suffix.lower() in FORMATS for name in data.meta["sources"]):
        return
    try:
        _, parts = rebuilt(data)
    except InputError:
        return
    for part in parts:
        for facts in part.files:
            result.measure(f"{part.name}: area of {facts.file.name} that is not built", facts.area_lost, LEAST_LOSS, "")
