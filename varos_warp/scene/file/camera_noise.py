"""The noise profiles that come with the package, and camera noise that a scene takes from one, or from a file."""

from dataclasses import replace
from importlib import resources
from pathlib import Path

from pydantic import ValidationError

from varos_warp.errors import InputError, warn
from varos_warp.files import absolute, is_file
from varos_warp.scene.description.noise_profile import CameraNoise, NoiseProfile
from varos_warp.scene.file.problems import input_error
from varos_warp.scene.file.source import Source
from varos_warp.scene.file.yaml_files import parse_file

FOLDER = resources.files("varos_warp") / "data" / "noise"
"""Profiles that come with the package."""
WHAT = "noise profile"


def named_profiles() -> list[str]:
    """Names of the profiles that come with the package."""
    return sorted(Path(entry.name).stem for entry in FOLDER.iterdir() if entry.name.endswith(".yaml"))


def profile_path(name: str | Path) -> Path:
    """The file of a profile that comes with the package, by its name, or of another, by its path."""
    return Path(str(FOLDER / f"{name}.yaml")) if str(name) in named_profiles() else Path(name)


def with_camera_noise(source: Source, base_dir: Path) -> Source:
    """The data of a scene with the camera noise of a profile in the place of its name.

    Raises:
        InputError: There is no such profile, it is none, or it has no camera.
    """
    key = ("render", "noise")
    if not isinstance(name := source.value(key), str):
        return source
    path, known = absolute(base_dir, str(profile_path(name))), ", ".join(named_profiles())
    if not is_file(path):
        raise InputError(
            f"there is no such {WHAT} ({path})",
            **source.where(key),
            value=name,
            remedy=f"Paths are relative to the scene file; profiles of the package are: {known}.",
        )
    noise = _camera_of(path, name, source.where(key))
    render = {**source.data["render"], "noise": noise.model_dump(exclude_unset=True)}
    return replace(source, data={**source.data, "render": render})


def _camera_of(path: Path, name: str, where: dict) -> CameraNoise:
    file = parse_file(path, WHAT, "", NoiseProfile)
    try:
        profile = NoiseProfile.model_validate(file.data)
    except ValidationError as error:
        raise input_error(error, file) from None
    if profile.camera is None:
        raise InputError(
            f"this {WHAT} has no camera",
            **where,
            value=name,
            remedy="Give one with a block camera, such as machine_vision.",
        )
    if others := list(profile.of_sensors):
        warn(
            f"render.noise: of the profile {name} the scene takes the camera only, not {', '.join(others)}; "
            "`varos-warp noise` adds the noise of sensors to a dataset without any"
        )
    return profile.camera
