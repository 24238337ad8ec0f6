"""Copies of an object strewn over the terrain: places by dart throwing, so that a scene and its seeds fix them all.

Places are drawn one after the other; one that is too near to what stands already, beside the terrain or on too steep
a slope is dropped (Cook 1986, Poisson disks by dart throwing; here every copy has a disk of its own size).
"""

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from varos_warp.cache import cached, code_hash, digest
from varos_warp.errors import InputError
from varos_warp.scene.description.surfaces import Layered
from varos_warp.scene.description.world import Boulder, Scatter
from varos_warp.scene.geometry.parts import Instances, Part
from varos_warp.scene.geometry.query import clearance, crossings, is_inside

BATCH = 256
"""Places drawn at a time; the copies do not depend on it."""
BURIED = (0.1, 0.5)
"""Share of the height of stones that lies under the ground, where their block does not say."""
PATIENCE = 4000
"""Places in a row without a copy after which the area counts as full: less than a thousandth of it is left."""


@dataclass
class Ground:
    """The ground on which copies may stand, and what is in their way."""

    terrain: Part
    """The terrain; where its surfaces overlap, the highest counts."""
    objects: list[Part] = field(default_factory=list)
    """Objects that copies keep clear of."""
    centre: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    """Centres of the disks, seen from above, that copies take already, float64 [N, 2] [m]."""
    radius: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Radii of these disks, float64 [N] [m]."""

    def take(self, rows: np.ndarray, reach: float) -> None:
        """Take the ground under copies: rows x, y, z, scale ... of `_places`, and their radius at scale 1 [m]."""
        self.centre = np.vstack([self.centre, rows[:, :2]])
        self.radius = np.append(self.radius, rows[:, 3] * reach)

    def digest(self) -> str:
        """Hash of all of it."""
        meshes = [array for part in (self.terrain, *self.objects) for array in (part.vertices, part.faces)]
        return digest(*meshes, self.centre, self.radius)


def scatter(block: Scatter, key: str, prototypes: list[Part], ground: Ground, seed: int) -> list[Instances]:
    """Place the copies of one block, and mark their ground as taken.

    Args:
        key: Where it stands, ``scatter.0``: the name of the result, and for messages.
        prototypes: The shapes of the object that is copied, scale and rotation applied, around its origin. Copies have
            them in turn, and all keep the distance that the largest needs.

    Returns:
        The copies of each shape that has any.

    Raises:
        InputError: The area has no extent, or no room for so many copies.
    """
    lowest = [prototype.vertices[:, 2].min() + block.sink_m for prototype in prototypes]
    shapes = [own.vertices - [0.0, 0.0, low] for own, low in zip(prototypes, lowest, strict=True)]
    vertices = np.concatenate(shapes) if len(shapes) > 1 else shapes[0]
    reach = np.linalg.norm(vertices if block.max_tilt_deg else vertices[:, :2], axis=1).max()
    depends_on = {
        "block": block.model_dump(mode="json", exclude={"object"}),
        "seed": seed,
        "ground": ground.digest(),
        "copy": digest(vertices),
        "code": code_hash(__name__, (__name__.rpartition(".")[0],)),
    }
    places = cached("scatter", depends_on, lambda: {"places": _places(block, key, vertices, reach, ground, seed)})
    places = places["places"]
    ground.take(places, reach)
    T = np.tile(np.eye(4), (len(places), 1, 1))
    deep = _depths(block, shapes, prototypes[0].material, places[:, 3], seed)
    for pose, (x, y, z, scale, yaw, dzdx, dzdy) in zip(T, places, strict=True):
        turned = _lean(dzdx, dzdy, np.radians(block.max_tilt_deg)) * Rotation.from_euler("z", yaw)
        pose[:3, :3], pose[:3, 3] = scale * turned.as_matrix(), (x, y, z)
    T[:, 2, 3] -= deep
    groups, first = [], 0
    for k, (own, prototype) in enumerate(zip(shapes, prototypes, strict=True)):
        of_shape = T[k :: len(shapes)]
        if len(of_shape):
            groups.append(
                Instances(
                    key,
                    own,
                    prototype.faces,
                    prototype.material,
                    of_shape,
                    first + np.arange(len(of_shape)),
                    smooth_angle=prototype.smooth_angle,
                    smooth_shading=prototype.smooth_shading,
                    skin=prototype.skin,
                    files=prototype.files,
                )
            )
        first += len(of_shape)
    return groups


def _depths(block, shapes, material, scale, seed):
    """How far copies [N] are let into the ground [m]: a share of their height by chance.

    Each shape has a part of the range for itself, so that its mesh, which its copies share, knows where the ground is.
    """
    stone = isinstance(block.object, Boulder) and isinstance(material, Layered)
    low, high = block.buried or (BURIED if stone else (0.0, 0.0))
    rng = np.random.default_rng([seed, block.seed, 7])
    part, height = rng.permutation(len(shapes)), np.array([np.ptp(own[:, 2]) for own in shapes])
    shape = np.arange(len(scale)) % len(shapes)
    return (low + (high - low) * (part[shape] + rng.random(len(scale))) / len(shapes)) * height[shape] * scale


def _places(block, key, vertices, reach, ground, seed):
    """Rows of x, y, z, scale, yaw and the slopes dz/dx, dz/dy of the ground, one per copy."""
    rng, centre, radius = np.random.default_rng([seed, block.seed]), ground.centre, ground.radius
    low, high, share = _bounds(block, key, ground.terrain)
    kept, dropped, barren = [], Counter(), 0
    while barren * BATCH * share < PATIENCE:
        before, drawn = len(kept), _draw(block, low, high, rng)
        for row in _standing(block, drawn, vertices, reach, ground, dropped):
            gap = np.linalg.norm(centre - row[:2], axis=1) - radius - row[3] * reach
            if len(gap) and gap.min() < block.clearance_m:
                dropped["too near to a copy"] += 1
                continue
            centre, radius = np.vstack([centre, row[:2]]), np.append(radius, row[3] * reach)
            kept.append(row)
            if len(kept) == block.count:
                return np.array(kept)
        barren = barren + 1 if len(kept) == before else 0
    why = ", ".join(f"{number} were {reason}" for reason, number in dropped.items() if number)
    raise InputError(
        f"there is room for {len(kept)} only; of the other places that were tried {why}",
        key=f"{key}.count",
        value=block.count,
        remedy="Lower count or clearance_m, or widen the area.",
    )


def _draw(block, low, high, rng):
    """A batch of rows x, y, scale, yaw in the area of a block."""
    u = rng.random((BATCH, 4))
    xy, scale = low + u[:, :2] * (high - low), _scales(block, u[:, 2])
    return np.column_stack([xy, scale, 2.0 * np.pi * u[:, 3] * block.random_yaw])[_within(block, xy)]


def _scales(block, u):
    """Scales [N] of uniform numbers [N], by the law of a block."""
    low, high = block.scale_range
    if block.size_exponent is None:
        return low + u * np.ptp(block.scale_range)
    if block.size_exponent == 0.0:
        return low * (high / low) ** u
    most, least = low**-block.size_exponent, high**-block.size_exponent
    return (most + u * (least - most)) ** (-1.0 / block.size_exponent)


def _standing(block, drawn, vertices, reach, ground, dropped):
    """Rows, as of ``_places``, of those drawn that stand on the ground and clear of objects; counts the others."""
    rows = _stand(drawn, ground.terrain, 0.5 * reach)
    lost = np.isnan(rows).any(axis=1)
    steep = ~lost & (np.arctan(np.hypot(rows[:, 5], rows[:, 6])) > np.radians(block.max_slope_deg))
    near = np.zeros(len(rows), bool)
    near[~lost & ~steep] = _near_objects(
        rows[~lost & ~steep], vertices, block.max_tilt_deg > 0.0, block.clearance_m, ground.objects
    )
    for reason, which in (("beside the terrain", lost), ("too steep", steep), ("too near to an object", near)):
        dropped[reason] += np.count_nonzero(which)
    return rows[~(lost | steep | near)]


def _bounds(block, key, terrain):
    """Corners [2] of the rectangle that places are drawn from, and the share of it that is the area."""
    if block.polygon is not None:
        corners = np.array(block.polygon)
        low, high = corners.min(axis=0), corners.max(axis=0)
        x, y = (corners - low).T
        area = 0.5 * abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))
        if not area > 1e-6 * np.prod(high - low) > 0.0:
            raise InputError("encloses no area", key=f"{key}.polygon", remedy="Give the corners in order around it.")
        return low, high, area / np.prod(high - low)
    if block.circle is not None:
        x, y, radius = block.circle
        return np.array([x - radius, y - radius]), np.array([x + radius, y + radius]), np.pi / 4.0
    if block.area is not None:
        return np.array(block.area[:2]), np.array(block.area[2:]), 1.0
    return terrain.vertices[:, :2].min(axis=0), terrain.vertices[:, :2].max(axis=0), 1.0


def _within(block, xy):
    """Which points [N, 2] lie in the circle or polygon of a block."""
    if block.circle is not None:
        return np.linalg.norm(xy - block.circle[:2], axis=1) <= block.circle[2]
    if block.polygon is not None:
        from skimage.measure import points_in_poly

        return points_in_poly(xy, np.array(block.polygon))
    return np.ones(len(xy), bool)


def _stand(rows, terrain, reach):
    """Rows x, y, z, scale, yaw, dz/dx, dz/dy of rows x, y, scale, yaw; NaN beside the terrain.

    The slope is taken between points ``reach`` times the scale apart from the middle: what the copy stands on counts,
    not the one triangle under its middle.
    """
    step = reach * rows[:, 2]
    around = rows[:, None, :2] + step[:, None, None] * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
    line, _, height = crossings(terrain.vertices, terrain.faces, around.reshape(-1, 2))
    z = np.full(around.shape[:2], np.nan)
    z.reshape(-1)[line] = height  # ascending: the highest stays
    slopes = np.column_stack([z[:, 1] - z[:, 2], z[:, 3] - z[:, 4]]) / (2.0 * step[:, None])
    return np.column_stack([rows[:, :2], z[:, 0], rows[:, 2:], slopes])


def _near_objects(rows, vertices, leaning, gap, objects):
    """Which copies' bounding balls come nearer to an object than ``gap``, or lie in it; bool [N]."""
    # about the foot where copies lean on it
    height = 0.0 if leaning else 0.5 * (vertices[:, 2].min() + vertices[:, 2].max())
    middle = np.array([0.0, 0.0, height])
    centre = rows[:, :3] + rows[:, 3:4] * middle
    radius = rows[:, 3] * np.linalg.norm(vertices - middle, axis=1).max() + gap
    near = np.zeros(len(rows), bool)
    for part in objects if (radius > 0.0).any() else ():
        near |= clearance(part.vertices, part.faces, centre, radius.max()) < radius
        low, high = part.vertices.min(axis=0), part.vertices.max(axis=0)
        boxed = ~near & ((centre > low) & (centre < high)).all(axis=1)
        if boxed.any() and trimesh.Trimesh(part.vertices, part.faces, process=False).is_watertight:
            near[boxed] = is_inside(part.vertices, part.faces, centre[boxed])
    return near


def _lean(dzdx, dzdy, most):
    """Rotation of the vertical towards the normal of a slope, by ``most`` [rad] at the most."""
    steepness = np.hypot(dzdx, dzdy)
    if steepness == 0.0 or most == 0.0:
        return Rotation.identity()
    axis = np.array([dzdy, -dzdx, 0.0]) / steepness  # z cross n, for n = (-dzdx, -dzdy, 1)
    return Rotation.from_rotvec(min(np.arctan(steepness), most) * axis)
