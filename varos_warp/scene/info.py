"""A scene in numbers, as `varos-warp info` tells them."""

import numpy as np

from varos_warp.products.sensors.registry import ASKED_FOR, mounted
from varos_warp.scene.courses.recorded import RecordedCourse
from varos_warp.scene.description import Scene
from varos_warp.scene.description.lights import Light
from varos_warp.scene.frames import attitude, intrinsics, opencv_intrinsics
from varos_warp.scene.geometry.course import find_course
from varos_warp.scene.geometry.parts import Grown, Instances, Part
from varos_warp.scene.geometry.placed import object_part
from varos_warp.scene.hull import vehicle_radius
from varos_warp.scene.lights.profiles import read_profile
from varos_warp.scene.optics.camera import camera_model
from varos_warp.scene.passes import backscatter_error
from varos_warp.scene.spectra.bands import PATHS_M, scene_bands
from varos_warp.scene.spectra.spectrum import GRID, VISIBLE
from varos_warp.scene.spectra.water import water_spectra
from varos_warp.scene.water import optical_properties, phase_function
from varos_warp.scene.water.particles import particle_laws

LENS_KEYS = ("resolution", "sensor_mm", "focal_mm")


def scene_info(scene: Scene, parts: list[Part | Instances]) -> dict:
    """The scene in numbers, as plain JSON types: ``water``, ``cameras``, ``lights``, ``meshes``, ``survey`` ..."""
    find_course(scene, parts)
    pattern, body = scene.trajectory.pattern, scene.vehicle.rigid_body
    kind, stops = "poses" if scene.trajectory.is_exact else "waypoints", scene.trajectory.stops
    return {
        "name": scene.name,
        "water": water_info(scene),
        "cameras": [camera_info(camera) for camera in scene.vehicle.cameras],
        "stereo": _pairs(scene.vehicle.cameras),
        "lights": [light_info(light, scene) for light in scene.vehicle.lights],
        "meshes": _mesh_info([part for part in parts if not isinstance(part, Grown)]),
        **_growth_info(parts),
        "mesh_files": _file_info(parts),
        **({"relief": relief} if (relief := {part.name: part.relief for part in parts if part.relief}) else {}),
        **({"survey": parts[0].survey} if parts and parts[0].survey else {}),
        **_body_info(scene),
        **_sensor_info(scene),
        "vehicle": {
            "mass_kg": scene.vehicle.mass_kg,
            "radius_m": vehicle_radius(scene),
            **({"rigid_body": True, "thrusters": len(body.thrusters or ())} if body else {}),
        },
        "trajectory": {
            "kind": kind,
            "count": len(stops),
            **({"pattern": pattern.kind} if pattern else {}),
            **({"recorded": stops.about} if isinstance(stops, RecordedCourse) else {}),
        },
    }


def light_info(light: Light, scene: Scene) -> dict:
    """The keys of a light; of a lamp with a file also what that says, in ``profile``.

    ``uneven`` is by how much of the peak the file's intensities differ around the axis, at most.
    """
    keys = light.model_dump(mode="json")
    if light.kind != "profile":
        return keys
    profile = read_profile(scene.resolve(light.file), f"{scene.key_of_light(light)}.file")
    return {**keys, "profile": profile.describe()}


def _mesh_info(parts):
    """Name, counts and bounds of every mesh, copies of a scatter together."""
    info = []
    for part in parts:
        corners, count = part.extents(), len(part) if isinstance(part, Instances) else 1
        info.append(
            {
                "name": part.name + (f" ({count} copies)" if isinstance(part, Instances) else ""),
                "vertices": count * len(part.vertices),
                "triangles": count * len(part.faces),
                "bounds_m": [corners[:, 0].min(axis=0).tolist(), corners[:, 1].max(axis=0).tolist()],
            }
        )
    return info


def _growth_info(parts):
    """Facts of every block of growth with copies: kind, copies, their triangles in all, on what, what is too small."""
    facts = [part.facts for part in parts if isinstance(part, Grown) and part.facts]
    return {"growth": facts} if facts else {}


def _file_info(parts):
    """What became of every mesh file, once for each part that it makes."""
    return [
        {
            "name": part.name,
            "file": facts.file.name,
            "up": facts.up_axis,
            "up_is_guess": facts.up_is_guess,
            "unit_m": facts.unit_m,
            "triangles": facts.triangles,
            "without_area": facts.lost,
            "area_m2": facts.area_m2,
            "area_lost": facts.area_lost,
            "textures": [
                {"name": name, "outside": share, "constant": name in facts.constant}
                for name, share in facts.textures.items()
            ],
        }
        for part in parts
        for facts in part.files
    ]


def _body_info(scene):
    """The body of this vehicle, in its own axes, and the ids of those that see it: no mesh of its own world."""
    body = getattr(scene.vehicle, "body", None)
    if body is None:
        return {}
    key = f"vehicles.{(scene.vehicles or []).index(scene.vehicle)}.body"
    (info,) = _mesh_info([object_part(scene, body, key)])
    return {"body": info | {"seen_by": [other.id for other in scene.companions.values()]}}


def _sensor_info(scene):
    """Rate of the IMU, and the noise of its readings, None where they are exact; the blocks of sensors asked for."""
    imu = scene.vehicle.imu
    asked = {
        sensor.key: block.model_dump(mode="json") for sensor, block in mounted(scene.vehicle) if sensor.key in ASKED_FOR
    }
    return {
        **({} if imu is None else {"imu": imu.model_dump(mode="json", include={"rate_hz", "noise"})}),
        **({"sensors": asked} if asked else {}),
    }


def water_info(scene: Scene) -> dict:
    """Absorption a, scattering b, extinction c [1/m], albedo b / c, mean free path 1 / c and 10 % range [m] by channel.

    ``phase`` is what there is to know of the phase function. At the 10 % range, ln(10) / c, a tenth of the light is
    left. Infinite lengths are None. ``particles`` says of each block of bodies how many there are.
    """
    if scene.is_spectral:
        return spectral_info(scene)
    water = optical_properties(scene)
    bodies = [law.describe() for law in particle_laws(scene)]
    c = water.sigma_t

    def lengths(x):
        return [float(x / value) if value > 0.0 else None for value in c]

    return {
        "a": water.sigma_a.tolist(),
        "b": water.sigma_s.tolist(),
        "c": c.tolist(),
        "g": float(water.g),
        "phase": water.phase.describe(),
        "albedo": water.albedo.tolist(),
        "mean_free_path_m": lengths(1.0),
        "range_10_percent_m": lengths(np.log(10.0)),
        **({"particles": bodies} if bodies else {}),
    }


def spectral_info(scene: Scene) -> dict:
    """Water by wavelength: a, b, c, b_b [1/m] and the range of a black disk, 4.8 / c [m]; the bands of each camera.

    ``bands`` has wavelengths, and the root mean square and the worst of the relative errors of what red, green and blue
    see directly of a colour chart, over paths from lamp to surface to camera between ``paths_m``; and the largest error
    of light scattered straight back, as three bands at a time share a phase function.
    """
    water = water_spectra(scene)
    at = np.isin(GRID, np.arange(*VISIBLE, 25.0)) | (GRID == VISIBLE[1])
    chosen = [(camera, scene_bands(scene, camera)) for camera in scene.vehicle.cameras]
    return {
        "source": water.source,
        "wavelength_nm": GRID[at].tolist(),
        **{name: getattr(water, name)[at].tolist() for name in ("a", "b", "c", "b_b", "visibility_m")},
        "phase": phase_function(scene).describe(),
        "paths_m": list(scene.render.bands_range_m or PATHS_M),
        "bands": [
            {
                "camera": camera.id,
                "wavelength_nm": bands.wavelength_nm.tolist(),
                "rms": bands.rms.tolist(),
                "worst": bands.worst.tolist(),
                "backscatter": backscatter_error(scene, camera).tolist(),
            }
            for camera, bands in chosen
        ],
    }


def camera_info(camera) -> dict:
    """Intrinsics [pixels] with the first pixel's centre at 0.5 (COLMAP) and at 0 (OpenCV); fields of view [degrees].

    The view is that in the water, behind the port. ``position`` [m] and ``looks_along`` are in the axes of the mount;
    ``defaults`` are keys that the scene file leaves to the paper's camera, ``calibration`` names the file that it is
    calibrated by, ``lens_end`` says where the lens ends within the image; None: there is none, or it does not.
    """
    K, model, c = intrinsics(camera), camera_model(camera), opencv_intrinsics(camera)[:2, 2].tolist()
    if model.is_pinhole and camera.intrinsics is None:
        fov = [float(np.degrees(2.0 * np.arctan(0.5 * size / camera.focal_mm))) for size in camera.sensor_mm]
    else:
        fov = np.degrees(model.field_of_view(*camera.resolution)).tolist()
    lens_keys = LENS_KEYS[:1] if camera.intrinsics else LENS_KEYS
    return {
        "id": camera.id,
        "resolution": list(camera.resolution),
        "fx": K[0, 0].item(),
        "fy": K[1, 1].item(),
        "cx_colmap": K[0, 2].item(),
        "cy_colmap": K[1, 2].item(),
        "cx_opencv": c[0],
        "cy_opencv": c[1],
        "horizontal_fov_deg": fov[0],
        "vertical_fov_deg": fov[1],
        "mount": camera.mount,
        "position": list(camera.position),
        "looks_along": (attitude(camera)[:, 1].round(6) + 0.0).tolist(),
        "defaults": [key for key in lens_keys if key not in camera.model_fields_set],
        "calibration": camera.calibration,
        "lens_end": _lens_end(model, camera),
    }


def _lens_end(model, camera) -> dict | None:
    end = model.lens_end(*camera.resolution)
    if end is None:
        return None
    return {
        "pixels": end.pixels,
        "share": end.share,
        "radius_px": end.radius_px,
        "half_angle_deg": float(np.degrees(end.half_angle)),
    }


def _pairs(cameras) -> list[dict]:
    """Left and right cameras of one number, and their distance [m]."""
    known = {camera.id.upper(): camera for camera in cameras}
    pairs = [(left, known[f"R{name[1]}"]) for name, left in known.items() if name[0] == "L" and f"R{name[1]}" in known]
    return [
        {
            "cameras": [left.id, right.id],
            "baseline_m": float(np.linalg.norm(np.subtract(left.position, right.position))),
        }
        for left, right in pairs
        if left.mount == right.mount
    ]
