"""dataset.json against the scene in it, and against files that state the same: YAML, segments, rays, time stamps."""

from pathlib import Path

import numpy as np

from varos_warp.dataset import files
from varos_warp.dataset.layout import POSE_FORMS, TIME
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.reader.schema import renewed
from varos_warp.dataset.validate.completeness import Pending, exposure_tables
from varos_warp.dataset.validate.outcome import Validation
from varos_warp.dataset.write import texts as writers
from varos_warp.dataset.write.rays import ray_channels
from varos_warp.errors import InputError
from varos_warp.products.images.registry import DENOISE_KEYS
from varos_warp.products.images.segments import segment_table
from varos_warp.products.sensors.registry import SENSORS
from varos_warp.scene import plain_yaml
from varos_warp.scene.description import Scene
from varos_warp.scene.description.image_types import SEGMENTS
from varos_warp.scene.description.water import HenyeyGreenstein, SpectralWater, Water
from varos_warp.scene.file.load import scene_from_dict, scene_to_dict
from varos_warp.scene.optics.camera import CameraModel
from varos_warp.scene.passes import with_lights
from varos_warp.scene.spectra.spectrum import is_file_name

RELATIVE = 1e-9
"""Numbers that differ by less are the same."""
ROUNDING = 2.0**-23
"""Two roundings to float32, for another machine may round otherwise before."""


def check_metadata(data: Dataset, result: Validation) -> None:
    """What dataset.json says follows from the scene in it, and the cameras' YAML files say the same."""
    meta, samples, scene = data.meta, data.meta["samples"], scene_from_dict(data.meta["scene"])
    known = _without_table(scene)
    made = writers.describe(
        data.layout,
        known,
        frames=data.frames,
        outputs=data.outputs,
        frame_count=meta["frames"]["of"],
        plan=samples["plan"],
        device=meta["device"],
        denoisers={letter: samples[key] for letter, key in DENOISE_KEYS.items()},
        lamp_gains=_lamp_gains(known) if known is scene else None,
    )
    for key in ("versions", "sources", "conventions"):  # not of the scene alone
        del made[key]
    if "noise" in made:
        del made["noise"]["versions"]
    if known is not scene:
        made["scene"] = scene_to_dict(scene)
        for key in ("phase", "g", "phase_function"):
            made["water"].pop(key, None)
        if scene.is_spectral:  # its tables, of which all follows, are not in the dataset
            del made["water"]
            made["lights"] = writers.describe_lights(scene.vehicle)
            for entry, camera in zip(made["cameras"], scene.vehicle.cameras, strict=True):
                if camera.color_matrix == "auto":
                    del entry["color_matrix"]
    profile = (meta.get("noise") or {}).get("profile", {})
    for sensor in SENSORS:
        if profile.get(sensor.key):
            made["sensors"][sensor.id]["noise"] = profile[sensor.key]
    result.add_all(
        [
            f"dataset.json: {key} is {here!r}, but its scene makes it {there!r}"
            for key, here, there in files.differences(meta, made, same, every=False)
        ],
        "entries",
    )
    for camera in data.cameras:
        path = data.layout.camera_file(camera, ".yaml")
        found = [
            f"{result.name(path)}: {key} is {here!r}, in dataset.json {there!r}"
            for key, here, there in files.differences(renewed(_read_yaml(path)), data.camera(camera), same, every=False)
        ]
        result.add_all(found, "entries")


def _lamp_gains(scene: Scene) -> dict[str, list[float]] | None:
    """Gains of cameras that are balanced for lamps; None where a lamp's own file is not at hand."""
    try:
        return writers.lamp_gains_of(scene)
    except InputError:
        return None


def _without_table(scene: Scene) -> Scene:
    """The scene with another phase function or spectra if those are tables, whose files are not in the dataset."""
    if scene.is_spectral:
        return _without_spectra(scene)
    for name in ("coefficients", "jerlov"):
        form = getattr(scene.water, name, None)
        if form is not None and _is_table(form.phase):
            water = scene.water.model_copy(update={name: form.model_copy(update={"phase": HenyeyGreenstein()})})
            return scene.model_copy(update={"water": water})
    return scene


def _is_table(phase) -> bool:
    return '"tabulated"' in phase.model_dump_json()


def _without_spectra(scene: Scene) -> Scene:
    """The scene itself if all of its spectra come with the package."""
    water = scene.water.spectral
    own = {name for name in (light.spectrum for light in scene.lights) if is_file_name(name, "lamps")}
    own |= {name for name in (camera.response for camera in scene.vehicle.cameras) if is_file_name(name, "cameras")}
    if not own and water.file is None and not _is_table(water.phase):
        return scene

    cameras = [camera.model_copy(update={"response": "nikon_5100"}) for camera in scene.vehicle.cameras]
    plain = with_lights(scene, lambda light: {"spectrum": "led_b4"})
    return plain.model_copy(
        update={
            "water": Water(spectral=SpectralWater(jerlov="IB")),
            "vehicle": plain.vehicle.model_copy(update={"cameras": cameras}),
        }
    )


def check_segments(data: Dataset, result: Validation) -> None:
    """segments.json numbers terrain, objects and copies in the order of the scene, with the scene's materials."""
    if SEGMENTS not in data.outputs:
        return
    scene, rows = scene_from_dict(data.meta["scene"]), data.segments()
    # how many copies find a place only the meshes tell
    copies = sorted({row["key"] for row in rows} - set(scene.numbered), key=_place)
    found = files.differences(rows, segment_table(scene, [*scene.numbered, *copies]), same)
    result.add_all(
        [
            f"segments.json: segments.{key} is {here!r}, but the scene makes it {there!r}"
            if key
            else f"segments.json: lists {len(here)} objects, but the scene has {len(there)}"
            for key, here, there in found
        ],
        "entries",
    )


def check_rays(data: Dataset, result: Validation) -> None:
    """The rays of a camera's pixels are those of its lens and port, to the rounding of float32."""
    for camera in data.cameras:
        path = data.layout.rays(camera)
        if "rays" in (about := data.camera(camera)) and path.is_file():
            if problem := _of_rays(files.read_exr(path), data.camera_model(camera), (about["width"], about["height"])):
                result.add(f"{result.name(path)}: {problem}")


def _of_rays(found: dict[str, np.ndarray], model: CameraModel, size: tuple[int, int]) -> str | None:
    """Problem of channels of rays, the first that is found; None: there is none."""
    if any(plane.shape != size[::-1] for plane in found.values()):
        return f"is not of {size[0]} x {size[1]} pixels"
    made = ray_channels(model, *size)
    if names := sorted(made.keys() ^ found.keys()):
        return f"channel {names[0]} is {'missing' if names[0] in made else 'none of its rays'}"
    wrong = [~np.isclose(found[name], plane, ROUNDING, ROUNDING, equal_nan=True) for name, plane in made.items()]
    if count := np.count_nonzero(np.any(wrong, axis=0)):
        return f"{count} pixels have other rays than lens and port give them"
    return None


def _place(key: str) -> tuple:
    """Rank of an object's key in the order of ids: terrain, objects, copies."""
    group, *numbers = key.split(".")
    order = ("terrain", "objects", "scatter", "growth")
    return order.index(group) if group in order else len(order), *(int(n) for n in numbers if n.isdigit())


def _read_yaml(path: Path) -> dict:
    with files.reading(path):
        content = plain_yaml.parse(path.read_text(encoding="utf-8"))
    if not isinstance(content, dict):
        raise InputError("holds no keys", file=path, remedy="`run` again to make it anew.")
    return content


def same(here, there) -> bool:
    """Equal to rounding."""
    if isinstance(there, float) and isinstance(here, float | int):
        return abs(here - there) <= RELATIVE * max(abs(here), abs(there), RELATIVE)
    return here == there


# --------------------------------------------------------------------------------------------------------------- time


def check_times(data: Dataset, result: Validation, pending: Pending) -> None:
    """Time stamps follow from the rate, name their files and are those of poses and gains; the IMU goes on longer."""
    expected = np.rint(np.array(data.frames) * (1e9 / data.meta["frames"]["rate_hz"])).astype(np.int64)
    for camera in data.cameras:
        path = data.layout.camera_file(camera, "_timestamps.csv")
        table = files.read_csv(path)
        if not _same_times(data, result, path, table, expected):
            continue
        for output in data.outputs:
            names = np.array([data.layout.image(camera, output, frame).name for frame in data.frames])
            for i in np.flatnonzero(table[output] != names)[:1]:
                result.add(f"{result.cell(path, i, output)}: is not {names[i]}")
        if "imu0" in data.recorded and len(expected) and data.imu()["time_ns"][-1] <= expected[-1]:
            result.add(f"{result.name(path)}: the IMU has no sample after the last frame")
    tables = [data.layout.poses(camera, form) for camera in data.cameras for form in POSE_FORMS]
    for path in tables + ([] if pending.files else exposure_tables(data)):
        _same_times(data, result, path, files.read_csv(path), expected)


def _same_times(data: Dataset, result: Validation, path: Path, table: dict, expected: np.ndarray) -> bool:
    """Return whether the rows of a table are at the times expected."""
    time_ns = table[TIME]
    if len(time_ns) != len(expected):
        result.add(f"{result.name(path)}: {len(time_ns)} rows, not {len(expected)}")
        return False
    wrong = np.flatnonzero(time_ns != expected)
    if wrong.size:
        result.add(f"{result.cell(path, wrong[0], TIME)}: is not {expected[wrong[0]]} ns")
    return not wrong.size
