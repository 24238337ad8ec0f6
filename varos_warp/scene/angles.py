"""Angles of a scene file that look wrong: radians where degrees are asked for, and cones that hardly any lamp has."""

import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from pydantic import BaseModel

from varos_warp.products.sensors.imu import ImuNoise
from varos_warp.scene.description import Scene
from varos_warp.scene.lights.profiles import read_profile
from varos_warp.scene.water import phase_function
from varos_warp.scene.water.phase.mixture import Mixture
from varos_warp.scene.water.phase.tabulated import Tabulated

COMMON = np.pi * np.array([1 / 6, 1 / 4, 1 / 3, 1 / 2, 2 / 3, 3 / 4, 5 / 6, 1.0, 3 / 2])
"""What angles in radians mostly are; as degrees they would be odd numbers."""
ROUNDING = 2e-3
"""How near to one of these an angle is one of them: 3.14 is."""
NARROWEST_DEG = 5.0
"""Cones that are narrower are rather in other units."""
HALF_TURN = 3.2
"""Tables by angle that end below are rather in radians: pi, rounded up."""

NOISIEST_GYROSCOPE = 2e-3
"""Density of noise [rad/s/sqrt(Hz)], 0.11 degrees, above that of all gyroscopes on a chip (0.003 to 0.03 degrees)."""


def check_angles(scene: Scene) -> list[str]:
    """Warnings, one for each kind of key: those of all waypoints are told of together."""
    like: dict[str, list[tuple[str, Any]]] = {}
    for key, value in _of_scene(scene):
        if _is_in_radians(value):
            like.setdefault(re.sub(r"\d+", "", key), []).append((key, value))
    warnings = []
    for (key, value), *more in like.values():
        others = f" and {len(more)} more" if more else ""
        warnings.append(
            f"{key}{others}: {_text(value)} looks like radians; keys that end in _deg are in degrees, "
            f"where that would be {_text(np.degrees(value).round())}"
        )
    for i, light in enumerate(scene.vehicle.lights):
        if light.kind == "spot" and light.cone_deg < NARROWEST_DEG and not _is_in_radians(light.cone_deg):
            warnings.append(
                f"vehicle.lights.{i}.cone_deg: {light.cone_deg:g} degrees is a very narrow cone; it is the "
                "full angle, in degrees"
            )
    imu = scene.vehicle.imu
    if imu is not None and imu.noise is not None and (words := odd_gyroscope(imu.noise)):
        warnings.append(f"vehicle.imu.noise.{words}")
    return warnings + _check_tables(scene)


def _check_tables(scene: Scene) -> list[str]:
    """Warnings of files whose angles to the axis, or of scattering, end where half a turn in radians does."""
    ends = {}
    for i, light in enumerate(scene.vehicle.lights):
        if light.kind == "profile" and (path := scene.resolve(light.file)).suffix.lower() != ".ies":
            profile = read_profile(path, f"{scene.key_of_light(light)}.file")
            ends[f"vehicle.lights.{i}.file"] = float(np.degrees(profile.polar[-1]))
    phase = phase_function(scene)
    for part in [each for _, each in phase.parts] if isinstance(phase, Mixture) else [phase]:
        if isinstance(part, Tabulated):
            ends[f"water: {part.name}"] = part.last_deg
    return [
        f"{key}: its angles are {end:.4g} degrees at most, which looks like radians; the file is read in degrees"
        for key, end in ends.items()
        if end <= HALF_TURN
    ]


def odd_gyroscope(noise: ImuNoise) -> str | None:
    """Warn, in words that begin with its key, if the density of the gyroscopes' noise looks like degrees."""
    density = noise.gyroscope_noise_density
    if density <= NOISIEST_GYROSCOPE:
        return None
    return (
        f"gyroscope_noise_density: {density:.3g} rad/s/sqrt(Hz) is {np.degrees(density):.3g} degrees/s/sqrt(Hz), "
        f"more than gyroscopes have; if it is in degrees, give {np.radians(density):.3g}"
    )


def _is_in_radians(value: Any) -> bool:
    """Return whether all angles that are not zero are common in radians; no angle is."""
    angles = np.abs(np.atleast_1d(value))
    angles = angles[angles > 0.0]
    return bool(angles.size and (np.abs(angles[:, None] - COMMON).min(axis=1) < ROUNDING).all())


def _text(value: Any) -> str:
    words = ", ".join(f"{x:g}" for x in np.atleast_1d(value))
    return f"[{words}]" if np.ndim(value) else words


def _of_scene(scene: Scene) -> Iterator[tuple[str, Any]]:
    """Key and value of every angle in degrees that the file gives, of the vehicles for the one that sees."""
    names = {*scene.model_fields_set, "vehicle"} - {"vehicles"}
    for name in sorted(names - {"trajectory"} if scene.vehicles else names):
        yield from _angles(getattr(scene, name), name)


def _angles(block: Any, key: str) -> Iterator[tuple[str, Any]]:
    inner: Any = ()
    if isinstance(block, BaseModel):
        inner = ((name, getattr(block, name)) for name in type(block).model_fields if name in block.model_fields_set)
    elif isinstance(block, dict):
        inner = block.items()
    elif isinstance(block, list | tuple):
        inner = enumerate(block)
    for name, value in inner:
        if str(name).endswith("_deg") and (
            isinstance(value, float) or (isinstance(value, tuple) and all(isinstance(x, float) for x in value))
        ):
            yield f"{key}.{name}", value
        else:
            yield from _angles(value, f"{key}.{name}")
