"""Sweeps of light transport over surfaces: near and far, grazing, needles, tiny and huge ones, places of a map."""

from functools import cache

import numpy as np
import trimesh

from benchmarks.stability.entry import Sweeps
from tests.physics.rig import floor
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.description import Scene
from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.frames import look_at_matrix, transform
from varos_warp.scene.geometry.parts import Part

GREY = Diffuse(reflectance=(0.5, 0.5, 0.5))
LAMP = {"kind": "point", "position": (0.15, 0.0, 0.0), "intensity": (1.0, 1.0, 1.0)}


def part(vertices, faces) -> Part:
    """A grey mesh."""
    return Part("mesh", np.asarray(vertices, float), np.asarray(faces, np.int32), GREY)


def wall(distance: float, size: float, offset=(0.0, 0.0, 0.0)) -> Part:
    """A grey square of two triangles across the view."""
    return floor(distance, 0.5, size, offset)


def scene_of(lights, positions=((0.0, 0.0, 0.0),), **view) -> Scene:
    """A vehicle that takes some positions, with a camera at its origin; no water."""
    view = {"id": "M0", "resolution": (24, 16), "sensor_mm": (6.0, 4.0), "focal_mm": 4.0} | view
    poses = [{"position": tuple(position), "time_s": float(i)} for i, position in enumerate(positions)]
    return Scene(vehicle={"lights": lights, "cameras": [view]}, trajectory={"poses": poses})


def shot(scene: Scene, parts, pose=None, layers=("direct",), spp=4):
    """Images A and D by paths."""
    pose = np.eye(4) if pose is None else pose
    return FrameRenderer(scene, "cpu", parts=parts).render(
        pose, outputs="ACD", spp=spp, layers=layers, seed=3, integrator="path"
    )


def depth_error(distance: float) -> float:
    """Relative error of D of a wall; nan where nothing is hit."""
    depth = shot(scene_of([]), [wall(distance, 3 * distance)]).D.depth
    return float(np.abs(depth / distance - 1).max()) if np.isfinite(depth).all() else np.nan


def grazing_errors(elevation: float) -> tuple[float, float]:
    """Relative errors of range and of direct light on the ground, seen at an angle [rad], the light at the camera."""
    height, distance = 0.5, 0.5 / np.tan(elevation)
    half = 3 * distance + 10
    eye = np.array([0.3, 0.0, height])
    lamp = LAMP | {"position": (0.0, 0.0, 0.0)}
    scene = scene_of([lamp], [eye], sensor_mm=(1.0, 1.0), focal_mm=min(1e6, 1e6 / elevation), resolution=(4, 4))
    ground = part(half * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]), [[0, 1, 2], [0, 2, 3]])
    image = shot(scene, [ground], transform(look_at_matrix(eye, (0.3, distance, 0.0)), eye))
    away = np.hypot(distance, height)
    truth = 0.5 / np.pi * height / away**3
    return float(np.abs(image.D.range.mean() / away - 1)), float(np.abs(image.A.radiance.mean() / truth - 1))


def needle_errors(aspect: float, at_edges: bool = False) -> tuple[float, float]:
    """Share of rays lost, and largest relative error of direct light, on a wall of needles 12 m long.

    The centres of pixels lie anywhere, or on edges between needles.
    """
    width, count = 12.0 / aspect, int(min(2000, aspect))
    half = width * count / 2
    x = width * np.arange(count + 1) - half
    ends = [np.column_stack([x, np.full_like(x, 2.5), np.full_like(x, z)]) for z in (-6.0, 6.0)]
    i = np.arange(count)
    upper = i + count + 1
    faces = np.concatenate([np.column_stack([i, i + 1, upper + 1]), np.column_stack([i, upper + 1, upper])])
    # a lens so long that the needles fill the view
    width_seen = min((1.6 if at_edges else 1.5713) * half, 3.0)
    view = {"sensor_mm": (1.0, 1.0), "focal_mm": 2.5 / width_seen, "resolution": (32, 16)}
    needles = shot(scene_of([LAMP], **view), [part(np.concatenate(ends), faces)])
    whole = shot(scene_of([LAMP], **view), [wall(2.5, 6.0)])
    hit = np.isfinite(needles.D.depth)
    return float(1 - hit.mean()), float(np.abs(needles.A.radiance[hit] / whole.A.radiance[hit] - 1).max())


@cache
def scaled_image(scale: float):
    """A box of half a metre on the ground, everything ``scale`` times as large, lit in proportion."""
    box = trimesh.creation.box((0.5, 0.5, 0.5)).apply_translation((0.0, 2.0, -0.75))
    ground = 20 * np.array([[-1.0, -1, -0.05], [1, -1, -0.05], [1, 1, -0.05], [-1, 1, -0.05]])
    parts = [part(scale * box.vertices, box.faces), part(scale * ground, [[0, 1, 2], [0, 2, 3]])]
    lamp = {"kind": "point", "position": (0.8 * scale, 0.0, 0.3 * scale), "intensity": (scale * scale,) * 3}
    return shot(scene_of([lamp]), parts, layers=("direct", "multiple"), spp=16)


def scale_errors(scale: float, truth) -> tuple[float, float]:
    """Relative errors of the sums of direct light and of light between surfaces, against ``truth``, of scale 1."""
    image = scaled_image(scale)
    return tuple(
        float(abs(image.A.layers[name].mean(dtype=float) / truth.A.layers[name].mean(dtype=float) - 1))
        for name in ("direct", "multiple")
    )


@cache
def _at_the_origin():
    return shot(scene_of([LAMP]), [wall(2.5, 20)])


def map_errors(offset: float, spread: bool) -> tuple[float, float]:
    """Relative errors of D and direct light ``offset`` metres from the origin, or from the middle of a long course."""
    place = offset * np.array([1.0, 1.07, 0.1])
    positions = [-place, place] if spread else [place]
    truth = _at_the_origin()
    walls = [wall(2.5, 20, place)] + [wall(2.5, 20, -place)] * spread
    image = shot(scene_of([LAMP], positions), walls, transform(None, place))
    return (
        float(np.abs(image.D.depth / truth.D.depth - 1).max()),
        float(np.abs(image.A.radiance / truth.A.radiance - 1).max()),
    )


SWEEPS: Sweeps = {
    "depth": {"depth": depth_error},
    "grazing": {("range", "direct"): grazing_errors},
    "rays_at_needles": {
        ("rays lost", "direct"): needle_errors,
        "rays lost, aimed at edges": lambda aspect: needle_errors(aspect, at_edges=True)[0],
    },
    "scale": {("direct", "between surfaces"): lambda scale: scale_errors(scale, scaled_image(1.0))},
    "place_on_a_map": {
        ("D, one place", "direct, one place"): lambda offset: map_errors(offset, spread=False),
        ("D, a course", "direct, a course"): lambda offset: map_errors(offset, spread=True),
    },
}
