"""Which cells of the water a camera may see while its shutter is open, and how far bodies are drawn."""

from collections.abc import Iterable, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import warp as wp

from varos_warp.errors import InputError
from varos_warp.kernels.particles.bodies import FADE, FAR_FADE, FARTHEST_GRAIN, NEAREST, Cells, Grain
from varos_warp.kernels.particles.bodies import Particles as ParticleData
from varos_warp.kernels.particles.draw import Cone
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.optics.camera import camera_model
from varos_warp.scene.water.flocs import flocs
from varos_warp.scene.water.particles import ParticleLaw

IN_CELL = 8.0
"""Mean number of bodies in a cell."""
WIDEST_CLASS = 2.5
"""Largest over smallest radius of a class of sizes, each of which has cells of its own."""
MOST_CELLS = 2e7
"""Most cells of a block in one image: with eight bodies in each, up to 1.4 GB while splats are counted."""
FARTHEST_M, OPTICAL_DEPTHS = 8.0, 4.0
"""Bodies are drawn up to this distance, or fewer where so many optical depths lie before it."""
NODES, FINE = 1024, 16
"""Nodes of a table by distance, and steps between two nodes of those that are summed up."""
WANDER_PERIOD_S, TURN_RATE = 4.0, 0.2
"""Period of a body's own motion to and fro [s], and rate at which it turns [rad/s]."""
ASKED = 33
"""Image points along each side whose rays tell how wide a camera sees."""


class Field(NamedTuple):
    """How a camera sees: half angle of a cone around its axis that holds all rays [rad], and the port's size [m]."""

    half_angle: float
    port: float


@lru_cache(maxsize=16)
def field_of(view: Camera) -> Field:
    """The `Field` of a camera."""
    width, height = view.resolution
    points = np.stack(np.meshgrid(np.linspace(0.0, width, ASKED), np.linspace(0.0, height, ASKED)), -1)
    rays = camera_model(view).rays(points)
    seen = np.isfinite(rays.direction).all(-1)
    d = rays.direction[seen]
    angle = np.arctan2(np.hypot(d[:, 0], d[:, 1]), d[:, 2]).max()
    margin = 3.0 * camera_model(view).pixel_angle + (0.03 if not seen.all() else 0.0)
    return Field(float(min(angle + margin, np.pi)), float(np.linalg.norm(rays.origin[seen], axis=-1).max()))


def reach_of(law: ParticleLaw) -> float:
    """Distance from a camera beyond which no body is drawn [m]."""
    return float(np.clip(OPTICAL_DEPTHS / max(law.water.sigma_t.min(), 1e-9), 4.0 * NEAREST, FARTHEST_M))


@lru_cache(maxsize=16)
def grains_on(device: str) -> wp.array:
    """The shapes of flocs on a device, [shape, grain]."""
    shapes = flocs()
    table = np.empty(shapes.radius.shape, Grain.numpy_dtype())
    for name, values in shapes._asdict().items():
        table[name] = values
    return wp.array(table, dtype=Grain, device=device)


def particle_record(law: ParticleLaw, pixel_angle: float, device: str) -> ParticleData:
    """What kernels know of the bodies of a block, but for their motion; keeps what it points to alive itself.

    Args:
        law: The bodies.
        pixel_angle: Angle that a pixel sees in the middle of the image [rad].
        device: Where the kernels run.
    """
    record, reach = ParticleData(), reach_of(law)
    record.least_angle, record.reach, record.step = law.block.least_px * pixel_angle, reach, reach / (NODES - 1)
    fine = np.linspace(0.0, reach, (NODES - 1) * FINE + 1)
    share = law.drawn(fine, record.least_angle, FAR_FADE) * np.clip(4.0 * (1.0 - fine / reach), 0.0, 1.0)
    near = share * np.clip((fine - NEAREST) / FADE, 0.0, 1.0)
    depth = np.append(0.0, np.cumsum(0.5 * (near[1:] + near[:-1]))) * (record.step / FINE) * law.extinction
    record.drawn, record.covered = (
        wp.array(values[::FINE].astype(np.float32), dtype=float, device=device) for values in (share, depth)
    )
    record.sigma_s, record.albedo = wp.vec3(*law.sigma_s), wp.vec3(*law.albedo)
    record.grains = grains_on(device)
    record.phase, record.opacity = law.phase.device_record(device), law.block.opacity
    return record


class SizeClass(NamedTuple):
    """A class of sizes."""

    r_low: float
    r_high: float
    """[m]"""
    side: float
    """Side of its cells [m]."""
    mean: float
    """Bodies in a cell."""


def size_classes(law: ParticleLaw) -> list[SizeClass]:
    """The classes of a block's bodies: all cells hold about as many."""
    low, high = law.block.radius_m
    edges = np.geomspace(low, high, 1 + int(np.ceil(np.log(high / low) / np.log(WIDEST_CLASS))))
    numbers = [law.number(a, b) for a, b in pairwise(edges)]
    return [
        SizeClass(float(a), float(b), float((IN_CELL / n) ** (1.0 / 3.0)), IN_CELL)
        for (a, b), n in zip(pairwise(edges), numbers, strict=True)
    ]


def slack_of(law: ParticleLaw, view: Camera, way: float = 0.0) -> float:
    """Return how far bodies may be off a camera's rays and still be seen [m]; ``way`` is that of the water."""
    aperture = 0.5e-3 * view.focal_mm / view.f_stop if view.f_stop > 0.0 else 0.0
    blur = aperture * (1.0 + reach_of(law) / max(view.focus_m, 0.02))
    return float(way + 2.0 * wander_of(law) + float(FARTHEST_GRAIN) * law.block.radius_m[1] + blur + 1e-3)


def wander_of(law: ParticleLaw) -> float:
    """Amplitude of a body's own motion along each axis [m], by the root mean square of its velocity."""
    return float(law.block.wander_m_s * np.sqrt(2.0 / 3.0) * WANDER_PERIOD_S / (2.0 * np.pi))


def check_cells(laws: Sequence[ParticleLaw], cameras: Iterable[Camera]) -> None:
    """Refuse bodies that would fill the memory.

    Raises:
        InputError: If some camera would see more than `MOST_CELLS` cells of a block.
    """
    for i, law in enumerate(laws):
        for view in cameras:
            cone = cone_of(np.eye(4)[None], np.zeros(3), field_of(view), slack_of(law, view))
            least = law.block.least_px * camera_model(view).pixel_angle
            count = sum(_count(size, cone, min(reach_of(law), size.r_high / least)) for size in size_classes(law))
            if count > MOST_CELLS:
                raise InputError(
                    f"camera {view.id} would see bodies in {count:.2g} cells of water, and {MOST_CELLS:.2g} are the "
                    "most",
                    key=f"particles.{i}.least_px",
                    value=law.block.least_px,
                    remedy="Raise it, or the smallest radius; or give a smaller share, or a lens that is less open.",
                )


def _count(size: SizeClass, cone: Cone, reach: float) -> float:
    """How many cells there are around a cone, about; as a float, which has no end."""
    ahead, behind = _extents(cone)
    return float(np.prod(((ahead + behind) * reach + 2.0 * cone.slack) / size.side + 2.0))


def _extents(cone: Cone) -> tuple[np.ndarray, np.ndarray]:
    """How far a cone of length 1 reaches from its apex along each axis [3], and against it."""
    between = np.arccos(np.clip(np.array(cone.axis, float), -1.0, 1.0))
    ahead, behind = (
        np.maximum(np.cos(np.maximum(angle - cone.half_angle, 0.0)), 0.0) for angle in (between, np.pi - between)
    )
    return ahead, behind


def cone_of(T_w_c: np.ndarray, origin: np.ndarray, field: Field, slack: float) -> Cone:
    """A cone that holds what a camera sees at several instants.

    Args:
        T_w_c: Poses [N, 4, 4] of the camera.
        origin: Of the local world, float64 [3] [m].
        field: How it sees.
        slack: By how much points may be off [m], besides its own way.
    """
    places, axes = T_w_c[:, :3, 3] - origin, T_w_c[:, :3, 2]
    cone, middle = Cone(), 0.5 * (places.min(0) + places.max(0))
    axis = axes.mean(0) / max(np.linalg.norm(axes.mean(0)), 1e-9)
    turned = np.arccos(np.clip(axes @ axis, -1.0, 1.0)).max()
    cone.apex, cone.axis = wp.vec3(*middle), wp.vec3(*axis)
    cone.half_angle = float(min(field.half_angle + turned, np.pi))
    cone.slack = float(slack + field.port + np.linalg.norm(places - middle, axis=-1).max())
    return cone


def cells_of(size: SizeClass, cone: Cone, reach: float, origin: np.ndarray, moved: np.ndarray) -> Cells:
    """The cells of a class around a cone.

    Args:
        size: The class.
        cone: What the camera may see, in the local world.
        reach: Distance to which the class is drawn [m].
        origin: Of the local world, float64 [3] [m].
        moved: Way of the water since time 0, float64 [3] [m]: cells are numbered in the water.
    """
    ahead, behind = _extents(cone)
    still = np.array(cone.apex, float) + origin - moved
    first = np.floor((still - behind * reach - cone.slack) / size.side).astype(np.int64)
    last = np.floor((still + ahead * reach + cone.slack) / size.side).astype(np.int64)
    cells = Cells()
    cells.base = wp.vec3ui(*(int(i) & 0xFFFFFFFF for i in first))
    cells.size = wp.vec3i(*(int(n) for n in last - first + 1))
    cells.corner = wp.vec3(*(first * size.side + moved - origin))
    cells.side, cells.mean, cells.r_low, cells.r_high = size.side, size.mean, size.r_low, size.r_high
    return cells
