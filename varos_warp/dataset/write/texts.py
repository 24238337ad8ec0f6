"""The text files of a dataset: sensors, poses, lights, camera calibration, dataset.json and README.txt."""

import contextlib
import platform
from functools import cache
from importlib import metadata, resources

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

import varos_warp
from varos_warp.dataset import files
from varos_warp.dataset.layout import Layout, runs
from varos_warp.dataset.reader.dataset import SCHEMA_VERSION
from varos_warp.dataset.write.checksums import sha256
from varos_warp.errors import InputError
from varos_warp.render.image.outputs import DEPTH_LEVELS
from varos_warp.scene.description.noise_profile import SENSOR_BLOCKS
from varos_warp.scene.description.optics import has_twin
from varos_warp.scene.description.world import GROUND_TEXTURES
from varos_warp.scene.frames import R_V_C, camera_pose, euler_angles, intrinsics, pose_matrix, transform
from varos_warp.scene.lights.records import light_axes
from varos_warp.scene.load import scene_to_dict
from varos_warp.scene.optics.camera import camera_model
from varos_warp.scene.water import optical_properties
from varos_warp.sim.sensors.dvl import Dvl, beam_directions

TIME = "# timestamp [ns]"
POSE_HEADERS = {
    "euler": "s_x_vw s_y_vw s_z_vw theta_x_vw theta_y_vw theta_z_vw",
    "transformation_matrix": "r11 r12 r13 s_x_vw r21 r22 r23 s_y_vw r31 r32 r33 s_z_vw",
    "quaternion": "s_x_vw s_y_vw s_z_vw q_w q_x q_y q_z",
}
"""Columns after the time, by the form of a file of poses; the matrices are authoritative."""
LATER_SENSORS = ("magnetometer", "dvl")
"""Of which README.txt and the conventions tell only where the vehicle has them."""


# ----------------------------------------------------------------------------------------------------- poses, sensors


def pose_columns(form: str, T: np.ndarray) -> np.ndarray:
    """The numbers [N, 6, 12 or 7] of a file of poses T_w_x [N, 3 or 4, 4]; Euler angles as in the paper, 4.1."""
    if form == "transformation_matrix":
        return T[:, :3].reshape(-1, 12)
    turn = Rotation.from_matrix(T[:, :3, :3])
    angles = euler_angles(turn) if form == "euler" else turn.as_quat(canonical=True, scalar_first=True)
    return np.hstack([T[:, :3, 3], angles])


def write_poses(layout: Layout, name: str, time_ns: np.ndarray, T_w_x: np.ndarray) -> None:
    """Poses [N, 4, 4] in each of the three forms."""
    for form, header in POSE_HEADERS.items():
        files.write_csv(layout.poses(name, form), [TIME, *header.split()], time_ns, pose_columns(form, T_w_x))


def _xyz(name: str, unit: str) -> list[str]:
    """Headers of the three components of a vector."""
    return [f"{name}_{axis} [{unit}]" for axis in "xyz"]


def write_sensors(layout: Layout, scene, simulation) -> None:
    """Vehicle and sensors: data and the pose of each at each of its samples."""
    trajectory, vehicle = simulation.trajectory, scene.vehicle

    def write_mounted(name: str, sensor, time_ns: np.ndarray) -> None:
        write_poses(layout, name, time_ns, trajectory.at(time_ns).poses() @ pose_matrix(sensor))

    write_poses(layout, "vehicle", trajectory.time_ns, trajectory.poses())
    quaternion = ["q_wv_w", "q_wv_x", "q_wv_y", "q_wv_z"]
    files.write_csv(
        layout.states,
        [TIME, *_xyz("p_wv", "m"), *_xyz("v_wv", "m s^-1"), *_xyz("a_wv", "m s^-2"), *quaternion,
         *_xyz("w_wv_v", "rad s^-1"), *_xyz("alpha_wv_v", "rad s^-2")],
        trajectory.time_ns, trajectory.position, trajectory.velocity, trajectory.acceleration, trajectory.quaternion,
        trajectory.angular_velocity, trajectory.angular_acceleration)
    if vehicle.imu is not None:
        imu, truth, bias = simulation.imu, None, None
        if vehicle.imu.noise is not None:
            truth = imu.true_acceleration, imu.true_angular_velocity
            bias = imu.acceleration_bias, imu.angular_velocity_bias
        write_imu(layout, imu.time_ns, (imu.acceleration, imu.angular_velocity), truth, bias)
        write_mounted("imu0", vehicle.imu, imu.time_ns)
    if vehicle.depth_gauge is not None:
        write_depth_gauge(layout, simulation.depth_gauge.time_ns, simulation.depth_gauge.depth)
        write_mounted("depth0", vehicle.depth_gauge, simulation.depth_gauge.time_ns)
    if vehicle.magnetometer is not None:
        write_magnetometer(layout, simulation.magnetometer.time_ns, simulation.magnetometer.field)
        write_mounted("mag0", vehicle.magnetometer, simulation.magnetometer.time_ns)
    if vehicle.dvl is not None:
        write_dvl(layout, simulation.dvl)
        write_mounted("dvl0", vehicle.dvl, simulation.dvl.time_ns)


def write_imu(layout: Layout, time_ns: np.ndarray, reading, truth=None, bias=None) -> None:
    """Readings of the IMU; where they have noise, what they would be without it beside them, and its bias.

    Args:
        layout: Of the dataset.
        time_ns: int64 [N].
        reading: Specific force [m/s^2] and angular velocity [rad/s], each [N, 3].
        truth: The same without noise.
        bias: The slowly varying part of the noise.
    """
    def header(prefix: str) -> list[str]:
        return [*_xyz(f"{prefix}a_RS_S", "m s^-2"), *_xyz(f"{prefix}w_RS_S", "rad s^-1")]

    names = [TIME, *header(""), *(header("true_") if truth else ())]
    files.write_csv(layout.sensor("imu0"), names, time_ns, *reading, *(truth or ()))
    if bias:
        files.write_csv(layout.imu_bias, [TIME, *header("b_")], time_ns, *bias)


def write_depth_gauge(layout: Layout, time_ns: np.ndarray, reading: np.ndarray, truth: np.ndarray | None = None,
                      bias: np.ndarray | None = None) -> None:
    """Readings of the depth gauge [N] [m]; where they have noise, the true depth and the bias beside them."""
    more = [] if truth is None else [truth, bias]
    names = [TIME, "d_v_w [m]", "true_d_v_w [m]", "b_d_v_w [m]"]
    files.write_csv(layout.sensor("depth0"), names[:2 + len(more)], time_ns, reading, *more)


def write_magnetometer(layout: Layout, time_ns: np.ndarray, reading: np.ndarray, truth: np.ndarray | None = None,
                       bias: np.ndarray | None = None) -> None:
    """Readings of the magnetometer [N, 3] [T]; where they have noise, the true field and the bias beside them."""
    more = [] if truth is None else [("true_", truth), ("b_", bias)]
    names = [name for prefix, _ in [("", reading), *more] for name in _xyz(f"{prefix}B_S", "T")]
    files.write_csv(layout.sensor("mag0"), [TIME, *names], time_ns, reading, *(columns for _, columns in more))


def write_dvl(layout: Layout, reading: Dvl, truth: Dvl | None = None) -> None:
    """Readings of the DVL; where they have noise, what they would be without it beside them."""
    def header(prefix: str) -> list[str]:
        return [*_xyz(f"{prefix}v_RS_S", "m s^-1"), f"{prefix}altitude [m]",
                *(f"{prefix}range_{i} [m]" for i in range(1, 5)),
                *(f"{prefix}beam_velocity_{i} [m s^-1]" for i in range(1, 5))]

    both = [("", reading)] if truth is None else [("", reading), ("true_", truth)]
    files.write_csv(layout.sensor("dvl0"), [TIME, *(name for prefix, _ in both for name in header(prefix))],
                    reading.time_ns, *(columns for _, dvl in both for columns in (
                        dvl.velocity, dvl.altitude, dvl.range, dvl.beam_velocity)))


_PIXELS = "# The centre of the top left pixel is (0, 0) in K_opencv and (0.5, 0.5) in K_center_half.\n"


def write_camera(layout: Layout, camera, frames: list[int], time_ns: np.ndarray, T_w_v: np.ndarray,
                 outputs: list[str]) -> None:
    """Calibration, time stamps with file names, and poses of one camera at its frames [N]."""
    path = layout.camera_file(camera.id, ".yaml")
    text = yaml.safe_dump(describe_camera(layout, camera), sort_keys=False, default_flow_style=None, width=120)
    files.write_bytes(path, (_PIXELS + text).encode())
    letters = [*"ABCD", *(letter for letter in outputs if letter not in "ABCD")]  # the released sequence has four
    names = [[layout.png(camera.id, letter, frame).name if letter in outputs else "" for frame in frames]
             for letter in letters]
    files.write_csv(layout.camera_file(camera.id, "_timestamps.csv"), [TIME, *letters], time_ns, *names)
    write_poses(layout, camera.id, time_ns, np.array([camera_pose(camera, T) for T in T_w_v]))


def light_pose(light) -> np.ndarray:
    """T_v_l [4, 4]: z is the axis of the light, outwards; of a sheet y is its normal."""
    return transform(light_axes(light), light.position)


def write_lights(layout: Layout, scene, frames: list[int], time_ns: np.ndarray, T_w_v: np.ndarray) -> None:
    """Position and direction of every light in the world at every frame, a row each."""
    lights = scene.vehicle.lights
    if not lights:
        return
    T = (T_w_v[:, None] @ np.array([light_pose(light) for light in lights])).reshape(-1, 4, 4)
    direction = ["direction_w_x", "direction_w_y", "direction_w_z"]
    files.write_csv(layout.lights, [TIME, "frame", "light", *_xyz("p_wl", "m"), *direction],
                    np.repeat(time_ns, len(lights)), np.repeat(frames, len(lights)),
                    np.tile(np.arange(len(lights)), len(frames)), T[:, :3, 3], T[:, :3, 2])


# ------------------------------------------------------------------------------------------------------- dataset.json


def describe_camera(layout: Layout, camera) -> dict:
    """Calibration of a camera; the released file's keys (mm) first."""
    K = intrinsics(camera)
    K_opencv = K - np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
    T = pose_matrix(camera) @ transform(R_V_C)
    width, height = camera.resolution
    return {
        "id": camera.id, "folder": layout.camera_dir(camera.id).relative_to(layout.root).as_posix(),
        "focal_length": camera.focal_mm, "sensor_width": camera.sensor_mm[0], "sensor_height": camera.sensor_mm[1],
        "width": width, "height": height, "resolution": {"width": width, "height": height},
        "f_stop": camera.f_stop, "focus_m": camera.focus_m, **describe_optics(camera),
        **({"rays": layout.rays(camera.id).relative_to(layout.root).as_posix()} if has_twin(camera) else {}),
        "K_center_half": K.tolist(), "K_opencv": K_opencv.tolist(), "mount": camera.mount,
        "T_w_c" if camera.mount == "world" else "T_v_c": T.tolist(),
    }


def describe_optics(camera) -> dict:
    """Lens, port and vignetting, as `described_camera` reads them."""
    lens, port = camera.distortion, camera.port
    fisheye = lens is not None and lens.model == "kannala_brandt"
    about = {"camera_model": "fisheye" if fisheye else "pinhole",
             "distortion": "none" if lens is None else lens.model_dump(mode="json")}
    if port is not None:
        about |= {"port": port.model_dump(mode="json"), "n_water": list(camera_model(camera).n_water)}
    return about if camera.vignetting is None else about | {"vignetting": camera.vignetting.model_dump(mode="json")}


def describe_water(scene) -> dict:
    """Optical properties per channel R, G, B."""
    water = optical_properties(scene)
    return {"source": water.source, "sigma_a": water.sigma_a.tolist(), "sigma_s": water.sigma_s.tolist(),
            "sigma_t": water.sigma_t.tolist(), "albedo": water.albedo.tolist(), "unit": "1/m",
            "phase": water.phase.kind, "g": water.g,
            **({} if water.phase.is_henyey_greenstein else {"phase_function": water.phase.describe()})}


def describe_sensors(vehicle) -> dict[str, dict]:
    """Rate, mounting and noise of each sensor on the vehicle, and what else its readings follow from."""
    found = {}
    for name, block in SENSOR_BLOCKS.items():
        if (sensor := getattr(vehicle, block)) is not None:
            found[name] = {"rate_hz": sensor.rate_hz, "T_v_s": pose_matrix(sensor).tolist(),
                           "noise": sensor.model_dump(mode="json").get("noise")}
    if vehicle.magnetometer is not None:
        found["mag0"]["field_T"] = list(vehicle.magnetometer.field_T)
    if vehicle.dvl is not None:
        found["dvl0"] |= {"beams": beam_directions(vehicle.dvl).tolist(), "range_m": list(vehicle.dvl.range_m)}
    return found


def versions() -> dict[str, str]:
    """Of what shapes the numbers."""
    return {"varos_warp": varos_warp.__version__, "python": platform.python_version(), **_installed(), "simd": simd()}


@cache
def _installed() -> dict[str, str]:
    """Versions of packages; once, for it searches folders and parses files."""
    found = {}
    for package in ("warp-lang", "numpy", "scipy", "OpenEXR", "pillow", "pyoidn"):
        found[package] = "absent"
        with contextlib.suppress(metadata.PackageNotFoundError):
            found[package] = metadata.version(package)
    return found


def simd() -> str:
    """What NumPy's code is chosen by on this kind of CPU: the last digits of tables follow from it."""
    return " ".join(np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])) or "baseline"


def sources(scene) -> dict[str, str | None]:
    """SHA-256 of every mesh, image and table that the scene names; of images that mesh files name it knows nothing.

    None stands for a file that cannot be read, of which its loader tells.
    """
    terrain = getattr(scene.terrain, "file", None) or []
    named = [terrain] if isinstance(terrain, str) else list(terrain)
    objects = [*scene.objects, *(block.object for block in scene.scatter)]
    named += [o.file for o in objects if getattr(o, "file", None)]
    textures = [getattr(material, side, None) for material in scene.materials.values() for side in ("flat", "steep")]
    named += [texture.texture for texture in textures if texture is not None and texture.texture not in GROUND_TEXTURES]
    named += [light.file for light in scene.vehicle.lights if getattr(light, "file", None)]
    water = None if scene.water == "none" else scene.water.coefficients or scene.water.jerlov
    phase = getattr(water, "phase", None)
    named += [part.file for part in getattr(phase, "of", [phase]) if getattr(part, "file", None)]
    found: dict[str, str | None] = dict.fromkeys(named)
    for name in found:
        with contextlib.suppress(InputError):
            found[name] = sha256(scene.resolve(name))
    return found


def describe(layout: Layout, scene, *, frames: list[int], frame_count: int, outputs: list[str], plan: dict | None,
             device: dict | None, denoisers: dict[str, str | None]) -> dict:
    """Everything that dataset.json says.

    Args:
        layout: Of the dataset.
        scene: The resolved scene.
        frames: Numbers of the frames that the dataset has or is to have.
        frame_count: Frames of the whole sequence.
        outputs: Image types that it has or is to have.
        plan: What the planner chose; None: nothing is rendered yet.
        device: Where it was rendered first; None: nowhere yet.
        denoisers: What denoised A and B, which need not be what the scene asks for; None: nothing was rendered yet.
    """
    vehicle, render = scene.vehicle, scene.render
    conventions = yaml.safe_load(_text("conventions.yaml"))
    bent = any(map(has_twin, vehicle.cameras))
    absent = {"P", "F"} - set(outputs) | (set() if bent else {"rays"})
    absent |= {key for key in LATER_SENSORS if getattr(vehicle, key) is None}
    conventions = {key: words for key, words in conventions.items() if key not in absent}
    start, end = render.depth_range_m
    return {
        "format": "varos_warp dataset", "schema_version": SCHEMA_VERSION,
        "name": scene.name, "sequence": scene.sequence, "vehicle": vehicle.id, "seed": scene.seed,
        "versions": versions(), "device": device, "conventions": conventions,
        "frames": {"of": frame_count, "ranges": runs(frames), "rate_hz": render.frame_rate_hz},
        "outputs": outputs,
        "color": {"png": "sRGB (IEC 61966-2-1), 8 bit", "exr": "linear, Rec. 709 primaries",
                  "radiance_unit": "W/sr/m^2 per channel", "exposure": render.exposure.model_dump(mode="json")},
        "depth": {"kind": render.depth_kind, "range_m": [start, end], "levels": DEPTH_LEVELS,
                  "scale_m": (end - start) / DEPTH_LEVELS, "at_or_beyond_end": DEPTH_LEVELS},
        "samples": {"plan": plan, "spp_b": render.spp_b, "denoise": denoisers["A"], "denoise_b": denoisers["B"]},
        "cameras": [describe_camera(layout, camera) for camera in vehicle.cameras],
        "sensors": describe_sensors(vehicle),
        "lights": [{**light.model_dump(mode="json"), "T_v_light": light_pose(light).tolist(), "intensity_unit": "W/sr"}
                   for light in vehicle.lights],
        "water": describe_water(scene),
        "gravity": [0.0, 0.0, -scene.gravity], "surface_depth_m": scene.surface_depth_m,
        "sources": sources(scene), "scene": scene_to_dict(scene),
    }


_KINDS = {"z": "planar: along the camera's z axis", "range": "along the ray"}
_RAYS = {"z": "# z = 1: D is planar",
         "range": "ray /= np.linalg.norm(ray, axis=-1, keepdims=True)  # D is along the ray"}

_PINHOLES = "Pinhole without distortion, in both conventions of pixels:"
_BENT = """Not all are pinholes: camXX.yaml names the port and the lens's distortion, coefficients in OpenCV's order.
  camXX_rays.exr has the ray in the water of every pixel's centre: float32 channels green.ox, oy, oz (its origin on the
  port [m]), green.dx, dy, dz (its unit direction), both in camera axes, and green.weight (radiance at the sensor over
  that in the water); NaN where no water is seen. red and blue have theirs where their index differs, else green's.
  What a pixel sees lies at o + D d if D is the range, at o + (D - oz) / dz d if it is along the axis.
  varos_warp.Dataset(".").camera_model("M0").rays(points) gives those of any point; the code below is for pinholes.
  B, C, D and S follow the rays of green. D along the ray is the path in the water; D along the axis is from the lens.
  Intrinsics in both conventions of pixels:"""


def _text(name: str) -> str:
    """A file that comes with the package."""
    return (resources.files("varos_warp") / "data" / name).read_text(encoding="utf-8")


def write_readme(layout: Layout, scene) -> None:
    """README.txt: each convention in words."""
    text = _text("dataset_readme.txt")
    start, end = scene.render.depth_range_m
    bent = any(map(has_twin, scene.vehicle.cameras))
    words = {"LENS": _BENT if bent else _PINHOLES,
             "KIND": _KINDS[scene.render.depth_kind], "START": f"{start:g}", "END": f"{end:g}",
             "GRAVITY": f"{scene.gravity:g}",
             "STEP": f"{(end - start) / DEPTH_LEVELS * 1000:.6g}", "STEP_M": repr((end - start) / DEPTH_LEVELS),
             "RAY": _RAYS[scene.render.depth_kind], "SURFACE": f"{scene.surface_depth_m:g}",
             "MORE": "".join("\n" + _text(f"{key}_readme.txt") for key in LATER_SENSORS if getattr(scene.vehicle, key)),
             "VEHICLE": scene.vehicle.id, "SEQUENCE": scene.sequence, "CAMERA": scene.vehicle.cameras[0].id}
    for word, value in words.items():
        text = text.replace("{" + word + "}", value)
    text = text.replace("{NAME}", scene.name)  # last: it may look like one of the words
    files.write_bytes(layout.root / "README.txt", text.encode())
