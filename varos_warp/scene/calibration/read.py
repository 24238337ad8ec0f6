"""A camera of a calibration file, by ``FILE#camera``."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from varos_warp.errors import InputError, did_you_mean
from varos_warp.files import absolute, is_file
from varos_warp.scene.calibration import kalibr, matrices
from varos_warp.scene.calibration.documents import Entry, read_document
from varos_warp.scene.calibration.models import Calibration

FORMS = (
    "Kalibr's camchain.yaml, EuRoC's sensor.yaml, OpenCV's FileStorage (camera_matrix, distortion_coefficients) "
    "and ROS's camera_info; docs/cameras.md says more."
)


def file_part(name: str, base: Path) -> tuple[str, str]:
    """The file and the camera of ``FILE#camera``, empty if there is none; files may have a # in their names."""
    file, hash_, camera = name.rpartition("#")
    return (name, "") if not hash_ or is_file(absolute(base, name)) else (file, camera)


def read_calibration(name: str, base: Path) -> Calibration:
    """The facts that a calibration file gives of a camera.

    Args:
        name: ``FILE#camera``; the camera may be left out where the file has one.
        base: Folder that the file is relative to.

    Raises:
        InputError: There is no such file or camera, it cannot be read, or has a model that is not had here.
    """
    file, wanted = file_part(name, base)
    document = read_document(absolute(base, file))
    cameras = _cameras(document)
    if not cameras:
        raise InputError("holds no camera of a form that is read here", file=document.file, remedy=f"Read are {FORMS}")
    if len(cameras) == 1 and (not wanted or wanted == _own_name(document)):
        (wanted,) = cameras
    known = ", ".join(filter(None, cameras)) or "one without a name"
    if not wanted and wanted not in cameras:
        raise InputError(
            f"holds several cameras: {known}",
            file=document.file,
            remedy=f"Choose one: {Path(file).name}#{next(iter(cameras))}.",
        )
    if wanted not in cameras:
        raise InputError(
            f"holds no camera {wanted!r}",
            file=document.file,
            remedy=did_you_mean(wanted, cameras) or f"There is: {known}.",
        )
    return cameras[wanted]()


def _own_name(document: Entry) -> str | None:
    """The name that ROS gives the one camera of a file."""
    name = document["camera_name"].value if "camera_name" in document else None
    return name if isinstance(name, str) else None


def _cameras(document: Entry) -> dict[str, Callable[[], Calibration]]:
    """How to read each camera of a file, by its name, which may be empty for one alone."""
    found = _cameras_of(document, "")
    for name, block in document.items() if not found else ():
        found |= _cameras_of(block, name)
    return found


def _cameras_of(block: Entry, name: str) -> dict[str, Callable[[], Calibration]]:
    """How to read the cameras that stand in a block itself, by name."""
    if kalibr.is_camera(block):
        return {name: partial(kalibr.read_camera, block)}
    return {
        ".".join(filter(None, (name, side))): partial(matrices.read_camera, names, side)
        for side, names in matrices.cameras_of(block)
    }
