"""Noise for a finished dataset: a second dataset beside it, whose sensors err as a profile says; docs/noise.md.

The truth stays: readings without noise are columns of the same tables, A without noise is in ``A_clean``. All that is
the same is linked, not copied. Random numbers follow from the seed, the sensor and the frame alone, so that the bytes
do not depend on how the work is divided.
"""

import contextlib
import itertools
import os
import warnings
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from importlib import resources
from pathlib import Path

import numpy as np

from varos_warp.dataset import files
from varos_warp.dataset.progress import in_threads
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.reader.rows import exposure_s
from varos_warp.dataset.write import tables
from varos_warp.dataset.write import texts as writers
from varos_warp.dataset.write.checksums import LEFT_OUT, NOTES, Record, read_checksums, sha256
from varos_warp.errors import InputError
from varos_warp.products.sensors.protocol import Samples
from varos_warp.products.sensors.registry import BY_ID, SENSORS
from varos_warp.render.image.camera_noise import noisy_color
from varos_warp.scene.block import Block
from varos_warp.scene.description.image_types import WATER
from varos_warp.scene.description.noise_profile import CameraNoise, NoiseProfile
from varos_warp.sim.sensors import image_noise

ANEW = (
    "dataset.json",
    "README.txt",
    "contact_sheet.png",
    "report.html",
    "readiness.html",
    "checksums",
    "log/validation.json",
)
"""Files beside and below dataset.json that tell of the sensors, so they are made anew or left out."""


def add_noise(root, profile: NoiseProfile, out, seed: int = 0, quiet: bool = False) -> Dataset:
    """Write a dataset with the noise of a profile.

    Args:
        root: Folder of a dataset without noise.
        profile: What errs, and how.
        out: Folder to make; it must not be there yet.
        seed: Of all random numbers; the same seed gives the same bytes.
        quiet: No progress on stderr.

    Raises:
        InputError: If the dataset has noise already, is not complete, or ``out`` is there or cannot be written.
    """
    data, out = Dataset(root), Path(out)
    if seed < 0:
        raise InputError("is negative", key="seed", value=seed, remedy="Give a whole number from 0 on.")
    profile = _applicable(data, profile)
    _refuse_noise(data, profile)
    if profile.camera is not None:
        _refuse_exposures(data, profile.camera)
    data.require_images()
    with files.new_folder(out) as temp, _naming_the_original(temp, data.root), Record(temp).recording() as record:
        _link(data, profile, temp, record)
        _describe(data, profile, seed, temp)
        noisy = Dataset(temp)
        for name, model in profile.of_sensors.items():
            reading, bias = noisy_readings(data, name, model, seed)
            tables.write_readings(noisy.layout, name, reading, data.readings(name), bias)
        if profile.camera is not None:

            def write(frame: int, camera: str) -> None:
                pixels = noisy_pixels(data, profile, seed, frame, camera)
                files.write_png(noisy.layout.image(camera, WATER, frame), pixels)

            views = zip(*itertools.product(data.frames, data.cameras), strict=True)
            list(in_threads("noise", write, *views, quiet=quiet))
        from varos_warp.dataset.write.pictures import contact_sheet

        contact_sheet(noisy, temp / "contact_sheet.png")
        record.write_checksums()
    return Dataset(out)


@contextlib.contextmanager
def _naming_the_original(temp: Path, root: Path) -> Iterator[None]:
    """Errors name a file of the dataset, not its link in a folder that will be gone."""
    try:
        yield
    except InputError as error:
        if error.file is None or not Path(error.file).is_relative_to(temp):
            raise
        raise error.but(file=root / Path(error.file).relative_to(temp)) from error


def noise_of(data: Dataset) -> tuple[NoiseProfile, int] | None:
    """Profile and seed of the noise that was added to a dataset; None: there was none added."""
    about = data.meta.get("noise")
    return about and (NoiseProfile.model_validate(about["profile"]), about["seed"])


def is_repeatable(data: Dataset) -> bool:
    """Return whether the noise was added by this version of NumPy, whose random numbers another may not repeat."""
    return data.meta["noise"]["versions"]["numpy"] == writers.versions()["numpy"]


def noisy_pixels(data: Dataset, profile: NoiseProfile, seed: int, frame: int, camera: str) -> np.ndarray:
    """Pixels uint8 [H, W, 3] of A as a profile and its seed make them from the frame's linear radiance."""
    linear, gain = data.linear(WATER, frame, camera), data.gain(WATER, frame, camera)
    rng, open_s = image_noise.frame_generator(seed, frame, camera), exposure_s(data.camera(camera))
    return noisy_color(profile.camera, linear, gain, data.camera_model(camera), open_s, rng, data.color_matrix(camera))


# ------------------------------------------------------------------------------------------------------------- checks


def _applicable(data: Dataset, profile: NoiseProfile) -> NoiseProfile:
    """The profile without blocks of sensors that the dataset does not have, of which it warns."""
    there = {sensor.key: data.layout.sensor(sensor.id).is_file() for sensor in SENSORS}
    there["camera"] = WATER in data.outputs
    absent = [name for name, known in there.items() if getattr(profile, name) is not None and not known]
    if absent:
        warnings.warn(
            f"the dataset has no readings of: {', '.join(absent)}; that part of the profile is left out", stacklevel=3
        )
    seen = [about["id"] for about in data.meta["cameras"] if about.get("vignetting")]
    if seen and there["camera"] and profile.camera is not None and profile.camera.vignetting is not None:
        warnings.warn(
            f"A of {', '.join(seen)} has the vignetting of the scene; the profile's is left out there", stacklevel=3
        )
    return profile.model_copy(update=dict.fromkeys(absent))


def _refuse_noise(data: Dataset, profile: NoiseProfile) -> None:
    """Noise is added once, to the truth."""
    if data.has_scene_noise:
        raise InputError(
            "A has noise already, of the scene",
            file=data.root,
            key="render.noise",
            remedy="Take it out of the scene, `run` anew into another folder, and give its profile here, too.",
        )
    if data.meta.get("noise"):
        raise InputError(
            "has the noise of a profile already",
            file=data.root,
            key="noise.profile.name",
            value=data.meta["noise"]["profile"]["name"],
            remedy="Add noise to the dataset that this one was made of.",
        )
    for sensor in (BY_ID[name] for name in profile.of_sensors if data.has_noise(name)):
        raise InputError(
            f"the {sensor.label} has noise already, of the scene",
            file=data.root,
            key=f"vehicle.{sensor.key}.noise",
            remedy="Take it out of the scene and `varos-warp simulate` anew, or leave "
            f"{sensor.key} out of the profile.",
        )


def _refuse_exposures(data: Dataset, model: CameraNoise) -> None:
    """A camera is exposed for its time, in every frame alike."""
    for camera in data.cameras:
        seconds = exposure_s(data.camera(camera))
        if model.dark_current_electrons_per_s and not seconds:
            raise InputError(
                f"camera {camera} has no time of exposure in which it gathers",
                file=data.root,
                key="camera.dark_current_electrons_per_s",
                value=model.dark_current_electrons_per_s,
                remedy="Give the camera exposure.time_s in the scene and `run` it anew, or "
                "leave the dark current out of the profile.",
            )
        gains = np.array([np.min(gain) for gain in data.gains(WATER, camera).values()])
        if model.electrons_per_dn is not None and seconds and np.ptp(gains) > 1e-9 * gains.max():
            alike = model.electrons_per_dn * image_noise.levels(model) * np.median(gains)
            raise InputError(
                f"takes the gain of a frame for its time of exposure, but camera {camera} is exposed for "
                f"{seconds:g} s in every frame, and its gains differ ({gains.min():.3g} to "
                f"{gains.max():.3g})",
                file=data.root,
                key="camera.electrons_per_dn",
                value=model.electrons_per_dn,
                remedy=f"Say electrons_per_radiance: {alike:.4g} instead in a profile of your own: as "
                "many electrons at the middle gain, which is then an amplifier's. Or render with "
                "the camera's exposure.gain: constant.",
            )


# -------------------------------------------------------------------------------------------------------------- files


def _link(data: Dataset, profile: NoiseProfile, temp: Path, record: Record) -> None:
    """Link what stays as it is, and A to its name for what is clean; an `InputError` where a checksum differs."""
    known = read_checksums(data.root)
    left_out = {data.root / name for name in ANEW}
    left_out |= {data.layout.sensor(name) for name in profile.of_sensors}
    renamed = {data.layout.camera_dir(camera) / WATER for camera in data.cameras} if profile.camera is not None else ()

    def link(path: Path) -> None:
        folder = path.parent.with_name(f"{WATER}_clean") if path.parent in renamed else path.parent
        name, target = path.relative_to(data.root).as_posix(), folder.relative_to(data.root) / path.name
        files.link(path, temp / target)
        if target.parts[0] not in LEFT_OUT:
            value = sha256(path)
            if known.get(name, value) != value:
                raise InputError(
                    "is not as it was written: its checksum differs", file=path, remedy="`run` again to make it anew."
                )
            record.vouch(target.as_posix(), value)

    paths = [path for path in files.visible(data.root) if path not in left_out and not path.match(f"log/{NOTES}")]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(link, paths))


def _describe(data: Dataset, profile: NoiseProfile, seed: int, temp: Path) -> None:
    """dataset.json with profile and seed, README.txt with a chapter on noise."""
    meta = {**data.meta, "sensors": dict(data.meta["sensors"]), "conventions": dict(data.meta["conventions"])}
    for name, block in profile.of_sensors.items():
        meta["sensors"][name] = {**meta["sensors"][name], "noise": block.model_dump(mode="json")}
    meta["noise"] = {"profile": profile.model_dump(mode="json"), "seed": seed, "versions": writers.versions()}
    if profile.camera is not None:
        meta["conventions"][WATER] += writers.CLEAN
    files.write_json(temp / "dataset.json", meta)
    readme = data.root / "README.txt"
    words = readme.read_text(encoding="utf-8") if readme.is_file() else ""
    chapter = (resources.files("varos_warp") / "data" / "noise_readme.txt").read_text(encoding="utf-8")
    chapter = chapter.replace("{PROFILE}", profile.name).replace("{SEED}", str(seed))
    files.write_bytes(temp / "README.txt", (words + "\n" + chapter).encode())


def noisy_readings(data: Dataset, name: str, model: Block, seed: int) -> tuple[Samples, Samples | None]:
    """Readings of a sensor as a block of a profile and its seed make them from those without noise, and their bias."""
    return BY_ID[name].noisy(data.readings(name, truth=True), data.meta["sensors"][name], model, seed)
