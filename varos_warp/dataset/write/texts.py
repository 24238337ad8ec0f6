"""What a dataset says of itself: dataset.json and README.txt."""

import contextlib
import platform
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from importlib import metadata, resources
from pathlib import Path

import numpy as np

import varos_warp
from varos_warp.dataset import files
from varos_warp.dataset.layout import Layout, runs
from varos_warp.dataset.reader.schema import SCHEMA_VERSION
from varos_warp.dataset.write.checksums import sha256
from varos_warp.errors import InputError
from varos_warp.products.images.depth import DEPTH_LEVELS
from varos_warp.products.images.registry import OUTPUTS, colors
from varos_warp.products.sensors.protocol import SensorProduct
from varos_warp.products.sensors.registry import SENSORS, mounted
from varos_warp.render.decisions import Plan, models_in_words
from varos_warp.render.image.exposure import rule_of
from varos_warp.scene import plain_yaml
from varos_warp.scene.description.exposure import CameraExposure, white_balance_of
from varos_warp.scene.description.image_types import AMBIENT, TWIN, WATER
from varos_warp.scene.description.noise_profile import NoiseProfile
from varos_warp.scene.description.optics import has_lens
from varos_warp.scene.description.world import GROUND_TEXTURES, SlopeBlend
from varos_warp.scene.file.load import scene_to_dict
from varos_warp.scene.frames import R_V_C, intrinsics, opencv_intrinsics, pose_matrix, transform
from varos_warp.scene.lights.records import light_axes
from varos_warp.scene.optics.camera import camera_model
from varos_warp.scene.optics.distortion import FISHEYES
from varos_warp.scene.optics.shutter import is_rolling
from varos_warp.scene.passes import described
from varos_warp.scene.spectra.matrix import color_matrix
from varos_warp.scene.spectra.spectrum import GRID, is_file_name
from varos_warp.scene.spectra.water import water_spectra
from varos_warp.scene.water import optical_properties, phase_function
from varos_warp.scene.water.particles import particle_laws


def light_pose(light) -> np.ndarray:
    """T_v_l [4, 4]: z is the axis of the light, outwards; of a sheet y is its normal, of a profile -y is its up."""
    return transform(light_axes(light), light.position)


def describe_lights(vehicle) -> list[dict]:
    """The lights of a vehicle: their keys, and where they are on it."""
    return [
        {**light.model_dump(mode="json"), "T_v_light": light_pose(light).tolist(), "intensity_unit": "W/sr"}
        for light in vehicle.lights
    ]


def describe_camera(layout: Layout, camera, matrix: np.ndarray | None = None) -> dict:
    """Calibration of a camera, with its colour matrix if it has one; the released file's keys (mm) first."""
    T = pose_matrix(camera) @ transform(R_V_C)
    width, height = camera.resolution
    sizes = {"focal_length": camera.focal_mm, "sensor_width": camera.sensor_mm[0], "sensor_height": camera.sensor_mm[1]}
    return {
        "id": camera.id,
        "folder": layout.camera_dir(camera.id).relative_to(layout.root).as_posix(),
        **(sizes if camera.intrinsics is None else {}),  # of a camera that is measured in pixels nobody knows them
        "width": width,
        "height": height,
        "resolution": {"width": width, "height": height},
        "f_stop": camera.f_stop,
        "focus_m": camera.focus_m,
        **describe_optics(camera),
        **({} if matrix is None else {"color_matrix": matrix.tolist()}),
        **describe_exposure(layout, camera),
        **({"rays": layout.rays(camera.id).relative_to(layout.root).as_posix()} if has_lens(camera) else {}),
        "K_center_half": intrinsics(camera).tolist(),
        "K_opencv": opencv_intrinsics(camera).tolist(),
        "mount": camera.mount,
        "T_w_c" if camera.mount == "world" else "T_v_c": T.tolist(),
    }


def describe_optics(camera) -> dict:
    """Lens, port and vignetting, as `described_camera` reads them."""
    lens, port = camera.distortion, camera.port
    fisheye = lens is not None and lens.model in FISHEYES
    about = {
        "camera_model": "fisheye" if fisheye else "pinhole",
        "distortion": "none" if lens is None else lens.model_dump(mode="json"),
    }
    if port is not None:
        about |= {"port": port.model_dump(mode="json"), "n_water": list(camera_model(camera).n_water)}
    return about if camera.vignetting is None else about | {"vignetting": camera.vignetting.model_dump(mode="json")}


def describe_exposure(layout: Layout, camera) -> dict:
    """Exposure of a camera, when its rows are exposed, and where their poses are; nothing where its scene says none."""
    if camera.exposure == CameraExposure():
        return {}
    times = {"time_s": camera.exposure.time_s, "readout_s": camera.exposure.readout_s}
    about = times | camera.exposure.model_dump(mode="json")
    if camera.exposure.is_instant:
        return {"exposure": about}
    about["line_delay_s"] = camera.exposure.readout_s / camera.resolution[1]
    about["time_stamp"] = "middle of the exposure of the middle row"
    if has_row_poses(camera):
        about["row_poses"] = layout.row_poses(camera.id).relative_to(layout.root).as_posix()
    return {"exposure": about}


def lamp_gains_of(scene) -> dict[str, list[float]]:
    """Gains of the channels of those cameras that are balanced for lamps, by their ids."""
    rules = {camera.id: rule_of(scene, camera.id, WATER) for camera in scene.vehicle.cameras}
    return {camera: list(rule.balance) for camera, rule in rules.items() if isinstance(rule.balance, tuple)}


def is_balanced(scene) -> bool:
    """Whether A of some camera has white balance."""
    exposures = (camera.exposure for camera in scene.vehicle.cameras)
    return any(white_balance_of(scene.render.exposure, exposure, WATER) != "none" for exposure in exposures)


def has_row_poses(camera) -> bool:
    """Return whether its rows are seen from poses of their own: a rolling shutter on the vehicle."""
    return is_rolling(camera) and camera.mount == "vehicle"


def describe_water(scene) -> dict:
    """Optical properties per channel R, G, B; of water by wavelength, by that and by the bands of each camera."""
    if scene.is_spectral:
        return _describe_spectra(scene)
    water, bodies = optical_properties(scene), [law.describe() for law in particle_laws(scene)]
    return {
        "source": water.source,
        "sigma_a": water.sigma_a.tolist(),
        "sigma_s": water.sigma_s.tolist(),
        "sigma_t": water.sigma_t.tolist(),
        "albedo": water.albedo.tolist(),
        "unit": "1/m",
        "phase": water.phase.kind,
        "g": water.g,
        **({} if water.phase.is_henyey_greenstein else {"phase_function": water.phase.describe()}),
        **({"particles": bodies} if bodies else {}),
    }


def _describe_spectra(scene) -> dict:
    water, phase = water_spectra(scene), phase_function(scene)
    return {
        "source": "spectral",
        "water": water.source,
        "unit": "1/m",
        "wavelength_nm": GRID.tolist(),
        **{name: getattr(water, name).tolist() for name in ("a", "b_water", "b_particles")},
        "phase": phase.kind,
        "g": phase.mean_cosine,
        "phase_function": phase.describe(),
        "bands": described(scene),
    }


def describe_sensors(vehicle) -> dict[str, dict]:
    """Rate, mounting and noise of each sensor on the vehicle, and what else its readings follow from."""
    return {
        sensor.id: {
            "rate_hz": block.rate_hz,
            "T_v_s": sensor.mounting(block).tolist(),
            "noise": block.model_dump(mode="json").get("noise"),
            **sensor.describe(block),
        }
        for sensor, block in mounted(vehicle)
    }


def versions() -> dict[str, str]:
    """Versions of everything that affects numerical results."""
    return {"varos_warp": varos_warp.__version__, "python": platform.python_version(), **_installed(), "simd": simd()}


@cache
def _installed() -> dict[str, str]:
    """Versions of packages; once, for it searches folders and parses files."""
    found = {}
    for package in ("warp-lang", "numpy", "scipy", "OpenEXR", "pillow", "isal", "pyoidn"):
        found[package] = "absent"
        with contextlib.suppress(metadata.PackageNotFoundError):
            found[package] = metadata.version(package)
    return found


def simd() -> str:
    """What NumPy's code is chosen by on this kind of CPU: the last digits of tables follow from it."""
    return " ".join(np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])) or "baseline"


def sources(scene, sum_of: Callable[[Path], str] = sha256) -> dict[str, str | None]:
    """SHA-256 of every mesh, image, course and table that the scene names, but not of images that mesh files name.

    ``sum_of`` takes a path, such as a function that remembers. None stands for a file that cannot be read, of which its
    loader tells.
    """
    terrain = getattr(scene.terrain, "file", None) or []
    named = [terrain] if isinstance(terrain, str) else list(terrain)
    bodies = [vehicle.body for vehicle in scene.vehicles or () if vehicle.body]
    objects = [*scene.objects, *(block.object for block in scene.scatter), *bodies]
    named += [o.file for o in objects if getattr(o, "file", None)]
    textures = [
        texture.texture
        for material in scene.materials.values()
        if isinstance(material, SlopeBlend)
        for texture in (material.flat, material.steep)
    ]
    named += [name for name in textures if name not in GROUND_TEXTURES]
    named += [light.file for light in scene.lights if getattr(light, "file", None)]
    named += [course.file for course in scene.trajectories.values() if course.file]
    water = None if scene.water == "none" else scene.water.coefficients or scene.water.jerlov or scene.water.spectral
    phase = getattr(water, "phase", None)
    named += [part.file for part in getattr(phase, "of", [phase]) if getattr(part, "file", None)]
    named += [water.file] if getattr(water, "file", None) else []
    for kind, names in (
        ("lamps", [light.spectrum for light in scene.lights]),
        ("cameras", [camera.response for camera in scene.vehicle.cameras]),
    ):
        named += [name for name in names if name and is_file_name(name, kind)]
    named += scene.calibrations
    found: dict[str, str | None] = dict.fromkeys(named)
    for name in found:
        with contextlib.suppress(InputError):
            found[name] = sum_of(scene.resolve(name))
    return found


def with_models(plan: Plan, scene, outputs: list[str], denoisers: dict[str, str | None]) -> Plan:
    """A plan that says how each of the outputs is made; of those of which it does already, it says the same."""
    if plan.models.keys() >= {*outputs}:
        return plan
    words = models_in_words(scene, plan, outputs, denoisers) | plan.models
    return replace(plan, models={letter: words[letter] for letter in outputs})


CHANNELS = "linear, channels of each camera, balanced for the first lamp"
"""What EXR hold in water by wavelength."""
BODIES = "; with bodies in the water (water.particles), which no denoiser touched"
CLEAN = "; A_clean: without the noise of noise.profile.camera, which A has"
_BALANCE = """
  With white balance A has three of them, gain_red, gain_green and gain_blue, each of its channel."""
BALANCED = "; with white balance by gain_red, gain_green and gain_blue, each of its channel"
DITHERED = "; dithered with triangular noise before it is rounded to 8 bits (A with the noise of a sensor is not)"


def describe(
    layout: Layout,
    scene,
    *,
    frames: list[int],
    frame_count: int,
    outputs: list[str],
    plan: dict | None,
    device: dict | None,
    denoisers: dict[str, str | None],
    moving: Sequence[dict] = (),
    lamp_gains: dict[str, list[float]] | None = None,
) -> dict:
    """Everything that dataset.json says.

    Args:
        layout: Of the dataset.
        scene: The resolved scene.
        frames: Numbers of the frames that the dataset has or is to have.
        frame_count: Frames of the whole sequence.
        outputs: Image types that it has or is to have.
        plan: What the planner chose, as `Plan.to_dict` has it; None: nothing is rendered yet.
        device: Where it was rendered first; None: nowhere yet.
        denoisers: What denoised A and B, which need not be what the scene asks for; None: nothing was rendered yet.
        moving: Entries of objects that move (moving.py).
        lamp_gains: Of cameras that are balanced for lamps (`lamp_gains_of`).
    """
    vehicle, render = scene.vehicle, scene.render
    bent = any(map(has_lens, vehicle.cameras))
    absent = set() if bent else {"rays"}
    absent |= {key for key in ("moving", "companions") if not getattr(scene, key)}
    absent |= {"exposure"} if all(camera.exposure.is_instant for camera in vehicle.cameras) else set()
    conventions = {key: words for key, words in _conventions(vehicle, outputs).items() if key not in absent}
    if scene.render.noise is not None and WATER in outputs:
        conventions[WATER] += CLEAN
    if is_balanced(scene):
        conventions |= {letter: conventions[letter] + BALANCED for letter in {WATER, TWIN} & conventions.keys()}
    if scene.particles and scene.render.shows_bodies:
        conventions |= {letter: conventions[letter] + BODIES for letter in {WATER, TWIN} & conventions.keys()}
    if scene.render.dither is not None:
        conventions |= {letter: conventions[letter] + DITHERED for letter in colors(outputs)}
    start, end = render.depth_range_m
    return {
        "format": "varos_warp dataset",
        "schema_version": SCHEMA_VERSION,
        "name": scene.name,
        "sequence": scene.sequence,
        "vehicle": vehicle.id,
        "seed": scene.seed,
        "versions": versions(),
        "device": device,
        "conventions": conventions,
        "frames": {"of": frame_count, "ranges": runs(frames), "rate_hz": render.frame_rate_hz},
        "outputs": outputs,
        "color": {
            "png": "sRGB (IEC 61966-2-1), 8 bit",
            "exr": CHANNELS if scene.is_spectral else "linear, Rec. 709 primaries",
            "radiance_unit": "W/sr/m^2 per channel",
            "exposure": render.exposure.model_dump(mode="json"),
            **({"lamp_gains": lamp_gains} if lamp_gains else {}),
        },
        "depth": {
            "kind": render.depth_kind,
            "range_m": [start, end],
            "levels": DEPTH_LEVELS,
            "scale_m": (end - start) / DEPTH_LEVELS,
            "at_or_beyond_end": DEPTH_LEVELS,
        },
        "samples": {"plan": plan, "spp_b": render.spp_b, "denoise": denoisers[WATER], "denoise_b": denoisers[AMBIENT]},
        "cameras": [describe_camera(layout, camera, color_matrix(scene, camera)) for camera in vehicle.cameras],
        "sensors": describe_sensors(vehicle),
        "lights": describe_lights(vehicle),
        "water": describe_water(scene),
        **({"moving": list(moving)} if moving else {}),
        "gravity": [0.0, 0.0, -scene.gravity],
        "surface_depth_m": scene.surface_depth_m,
        **describe_noise(scene, outputs),
        "sources": sources(scene),
        "scene": scene_to_dict(scene),
    }


def describe_noise(scene, outputs: Sequence[str]) -> dict:
    """The noise that A has of the scene, as `add_noise` describes that of a profile; nothing if it has none."""
    if scene.render.noise is None or WATER not in outputs:
        return {}
    profile = NoiseProfile(name="scene", camera=scene.render.noise)
    return {"noise": {"profile": profile.model_dump(mode="json"), "seed": scene.seed, "versions": versions()}}


def _conventions(vehicle, outputs: Sequence[str]) -> dict[str, str]:
    """What the numbers mean; those of sensors and images of which notes tell are in their places."""
    told = {
        "sensors": {sensor.key: sensor.convention for sensor in _noted(vehicle)},
        "images": {
            letter: image.convention
            for letter, image in OUTPUTS.items()
            if image.convention and (image.released or letter in outputs)
        },
    }
    found: dict[str, str] = {}
    for key, words in plain_yaml.parse(_text("conventions.yaml")).items():
        found |= told.get(key, {key: words})
    return found


def _noted(vehicle) -> list[SensorProduct]:
    """The sensors of which the notes of a dataset tell."""
    there = [sensor for sensor, _ in mounted(vehicle)]
    return [sensor for sensor in SENSORS if sensor.is_standard or sensor in there]


_KINDS = {"z": "planar: along the camera's z axis", "range": "along the ray"}
_RAYS = {
    "z": "# z = 1: D is planar",
    "range": "ray /= np.linalg.norm(ray, axis=-1, keepdims=True)  # D is along the ray",
}
_INSTANTS = """Each reading and image is for the instant of its time stamp (global
  shutter; nothing is averaged over an interval)."""
_PINHOLES = "Pinhole without distortion, in both conventions of pixels:"


def _text(name: str) -> str:
    """A file that comes with the package."""
    return (resources.files("varos_warp") / "data" / name).read_text(encoding="utf-8")


def write_readme(layout: Layout, scene, outputs: Sequence[str] = ()) -> None:
    """README.txt: each convention in words; ``outputs`` are the image types that the dataset has or is to have."""
    text = _text("dataset_readme.txt")
    start, end = scene.render.depth_range_m
    more = [_text(f"{key}_readme.txt") for key in ("moving", "companions") if getattr(scene, key)]
    more += [_text("particles_readme.txt")] * bool(scene.particles and scene.render.shows_bodies)
    more += [_text("camera_noise_readme.txt")] * bool(describe_noise(scene, outputs))
    bent = any(map(has_lens, scene.vehicle.cameras))
    words = {
        "SENSORS": "\n".join([*(sensor.chapter for sensor in _noted(scene.vehicle)), *more]),
        "LENS": _text("bent_readme.txt").rstrip("\n") if bent else _PINHOLES,
        "KIND": _KINDS[scene.render.depth_kind],
        "START": f"{start:g}",
        "END": f"{end:g}",
        "GRAVITY": f"{scene.gravity:g}",
        "STEP": f"{(end - start) / DEPTH_LEVELS * 1000:.6g}",
        "STEP_M": repr((end - start) / DEPTH_LEVELS),
        "RAY": _RAYS[scene.render.depth_kind],
        "SURFACE": f"{scene.surface_depth_m:g}",
        "IMAGES": "".join("\n" + OUTPUTS[letter].readme for letter in outputs if OUTPUTS[letter].readme),
        "SHUTTER": _INSTANTS
        if all(c.exposure.is_instant for c in scene.vehicle.cameras)
        else _text("shutter_readme.txt").rstrip("\n"),
        "BALANCE": _BALANCE if is_balanced(scene) else "",
        "VEHICLE": scene.vehicle.id,
        "SEQUENCE": scene.sequence,
        "CAMERA": scene.vehicle.cameras[0].id,
    }
    for word, value in words.items():
        text = text.replace("{" + word + "}", value)
    text = text.replace("{NAME}", scene.name)  # last: it may look like one of the words
    files.write_bytes(layout.root / "README.txt", text.encode())
