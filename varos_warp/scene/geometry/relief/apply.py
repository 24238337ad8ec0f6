"""Which parts of a scene have relief, how fine each becomes, and the parts as they are afterwards."""

import itertools
import zlib
from dataclasses import replace
from threading import Lock

import numpy as np

from varos_warp.cache import cached, code_hash, digest
from varos_warp.device.launch import in_threads, in_tiles
from varos_warp.errors import warn
from varos_warp.scene.description import Scene
from varos_warp.scene.description.surfaces import Layered
from varos_warp.scene.geometry.course import places, used_stops
from varos_warp.scene.geometry.lazily import once
from varos_warp.scene.geometry.parts import Instances, Moving, Part, Skin
from varos_warp.scene.geometry.relief.budget import MOST_TRIANGLES, Rough, factor_for, rough
from varos_warp.scene.geometry.relief.contact import foot_of
from varos_warp.scene.geometry.relief.density import STEP_M, Footprint, Pixels, footprint, longest_edge
from varos_warp.scene.geometry.relief.drifts import flow_direction, surroundings
from varos_warp.scene.geometry.relief.form import Base, base_of, formed, vertex_normals
from varos_warp.scene.geometry.relief.recipes.sand import tint_of
from varos_warp.scene.geometry.surface import Surface
from varos_warp.scene.geometry.topology import area_normals, edge_uses, is_consistent, largest

TOLD_SHARE = 0.02
"""Share of faces back to back that is warned of."""
TOLD_FACES = 20_000
"""A line of the log is for surfaces of more triangles than this before their relief."""
LEVELS = 4
"""Meshes that copies of one prototype have, at most: near ones a finer one than far ones."""
TOLD_FACTOR = 2.0
"""Edges longer than asked by more than this are warned of."""


def with_relief(scene: Scene, parts: list[Part | Instances]) -> list[Part | Instances]:
    """The parts of a scene, those of layered materials with form and colours; the others as they are.

    Args:
        scene: Its course says how near cameras come, its ``render.max_triangles`` how much form there may be.
    """
    if not any(isinstance(part.material, Layered) for part in parts):
        return parts
    seen = footprint(scene, parts)
    parts = [
        some
        for part in parts
        for some in (
            _by_detail(part, seen) if isinstance(part, Instances) and isinstance(part.material, Layered) else [part]
        )
    ]
    unformed = {i: Unformed(scene, part, seen) for i, part in enumerate(parts) if isinstance(part.material, Layered)}
    most = scene.render.max_triangles or MOST_TRIANGLES
    # without bodies, of which every vehicle sees others: all see the same world
    alike = [each for each in unformed.values() if each.part.name not in scene.companions]
    factor = _factor(alike, seen, most)
    done = _all_formed(scene, parts, unformed, seen, factor)
    if factor > TOLD_FACTOR:
        warn(
            f"render.max_triangles: {most} triangles are few for surfaces with relief: their edges are {factor:.1f} "
            "times as long as asked, so the finest forms are missing; raise it"
        )
    return [done.get(i, part) for i, part in enumerate(parts)]


class Unformed:
    """A part before its relief. What only a surface that is not kept is made from waits until it is asked for."""

    def __init__(self, scene: Scene, part: Part | Instances, seen: Footprint):
        self.part, self.places, self._scene, self._seen = part, _places_of(scene, part), scene, seen

    @once
    def digest(self) -> str:
        """A hash of all that the base is made from."""
        part = self.part
        return digest(part.vertices, part.faces, np.array([part.smooth_shading, part.smooth_angle], float))

    @once
    def base(self) -> Base:
        """The surface that relief is laid on."""
        return base_of(self.part)

    def pixels(self) -> Pixels:
        """Width of a pixel on the part."""
        return pixels_on(self._scene, self.part, self.base, self._seen)

    def rough(self) -> Rough:
        """The coarse surface by which the part's triangles are counted."""
        base = self.base
        return rough(base.vertices, base.faces, self.pixels(), base.normals)


def _all_formed(scene, parts, unformed, seen, factor):
    """Parts with their relief by their numbers: the ground last, as it lies against all others."""
    ground = Ground(next((part for part in parts if part.name == "terrain"), None))

    def form(i, now):
        return _formed(scene, unformed[i], now, ground, seen, factor)

    free, last = ([i for i in unformed if (parts[i].name == "terrain") == is_last] for is_last in (False, True))
    done = dict(zip(free, in_threads(lambda i: form(i, parts), free), strict=True))
    return done | {i: form(i, [done.get(k, part) for k, part in enumerate(parts)]) for i in last}


class Ground:
    """The terrain before its relief, which all parts ask that may stand in it; None: there is none."""

    def __init__(self, part: Part | None):
        self.part, self.digest = part, part and digest(*_standing(part))
        self._lock, self._surface = Lock(), None

    @property
    def surface(self) -> Surface | None:
        """Surface of the terrain, over which heights are measured; None: there is no terrain."""
        with self._lock:
            if self._surface is None and self.part is not None:
                self._surface = Surface(self.part.vertices, self.part.faces)
            return self._surface

    def under(self, part: Part | Instances) -> bool:
        """Whether a part may stand in the ground; the ground itself does not, nor what moves."""
        return self.part is not None and part.name != "terrain" and not isinstance(part, Moving)


def _factor(surfaces, seen, most):
    """Factor on all edges, so that triangles are no more than ``most``; kept, as it takes seconds."""
    depends_on = {
        "meshes": [each.digest for each in surfaces],
        "places": [each.places for each in surfaces],
        "most": most,
        "cameras": seen.digest,
        "code": _code(),
    }

    def build():
        return {"factor": np.array(factor_for(in_threads(Unformed.rough, surfaces), most))}

    return float(cached("relief_factor", depends_on, build)["factor"])


def _places_of(scene, part):
    """What tells where a part comes to, beside its mesh; None of what stands in one place."""
    if isinstance(part, Instances):
        return digest(part.T_w_o)
    return digest(way_of(scene, part), np.array(part.origin)) if isinstance(part, Moving) else None


def _code():
    return code_hash(__name__, ("varos_warp.scene.geometry", "varos_warp.kernels.mesh", "varos_warp.kernels.world"))


def pixels_on(scene: Scene, part: Part | Instances, base: Base, seen: Footprint) -> Pixels:
    """Width of a pixel at points about a base's middle.

    Copies share one mesh, which the copy decides that is nearest for its size; so does what moves.
    """
    if isinstance(part, Instances):
        alike = float(_pixels(part, seen).min())
    elif isinstance(part, Moving):
        reach = np.linalg.norm(base.vertices + base.middle - part.origin, axis=1).max()
        if vehicle := scene.companions.get(part.name):
            seen = footprint(scene, [], but=vehicle.id)
        alike = float(seen.angle * seen.distance(way_of(scene, part), radius=reach).min())
    else:
        return lambda points, normals: seen(points + base.middle, normals)
    return lambda points, normals: np.full(len(points), alike)


def _pixels(copies: Instances, seen: Footprint) -> np.ndarray:
    """Width [N] of a pixel on each of some copies, in the axes of their prototype [m]."""
    reach = np.linalg.norm(copies.vertices, axis=1).max()
    return seen.angle * seen.distance(copies.T_w_o[:, :3, 3], radius=reach * copies.scale) / copies.scale


def way_of(scene: Scene, part: Moving) -> np.ndarray:
    """Places [N, 3] along the straight lines between the stops of what moves, or along the course of a vehicle."""
    vehicle = scene.companions.get(part.name)
    stops = np.array([stop.position for stop in part.path] or [part.origin], float)
    if vehicle is not None:
        stops = places(vehicle.trajectory)[used_stops(vehicle.trajectory)]
    pieces = [np.linspace(a, b, int(np.ceil(np.linalg.norm(b - a) / STEP_M)) + 1) for a, b in itertools.pairwise(stops)]
    return np.concatenate([stops, *pieces])


def _by_detail(copies: Instances, seen: Footprint) -> list[Instances]:
    """Copies in groups that need about the same edges, `LEVELS` at most, each twice as long as the one before."""
    pixel = _pixels(copies, seen)
    level = np.minimum(np.log2(pixel / pixel.min()), LEVELS - 1).astype(int)
    return [copies.some(level == k) for k in np.unique(level)]


def _formed(scene, unformed, parts, ground, seen, factor):
    """A part with its relief; from the user's cache where it was made before."""
    part = unformed.part
    look = part.material.model_copy(update={"seed": _seed(scene, part)})
    others = [other for other in parts if other.name != part.name and not isinstance(other, Moving)]
    around = _around(scene, others) if part.name == "terrain" else None
    stands, banked = ground.under(part), bool(scene.terrain and scene.terrain.around_objects)
    tint = tint_of(ground.part.material if stands else part.material)
    depends_on = {
        "mesh": unformed.digest,
        "factor": factor,
        "look": look.model_dump(mode="json", exclude={"diffuse_roughness", "grain"}),
        "cameras": seen.digest,
        "code": _code(),
        "places": unformed.places,
        "tint": tint.tolist(),
        "stands": [banked, ground.digest] if stands else None,
        "ground": around and [digest(*_standing(other)) for other in others],
        "around": around and banked and list(scene.current.velocity),
    }

    def build():
        base, pixels = unformed.base, unformed.pixels()
        foot = foot_of(part, ground.surface if stands else None, base.middle, banked, scene.seed)
        made = formed(
            base, look, lambda points, normals: longest_edge(pixels(points, normals), factor), around, foot, tint
        )
        return {**made, "middle": base.middle, "doubts": np.array([*_doubts(part, base), *_held(made)], str)}

    made = cached(
        "relief", depends_on, build, what=f"the relief of {part.name}" if len(part.faces) > TOLD_FACES else None
    )
    vertices, faces = made["vertices"].astype(float) + made["middle"], made["faces"]
    facts = {"triangles": len(faces), "edge_factor": round(factor, 3)}
    return replace(
        part,
        vertices=vertices,
        faces=faces,
        normals=_at_corners(made["normals"], faces),
        smooth_shading=True,
        smooth_angle=np.pi,
        skin=Skin(_at_corners(made["colours"], faces)),
        relief=facts,
        before=part,
        doubts=(*part.doubts, *made["doubts"].tolist()),
    )


def _at_corners(values, faces):
    """Values [V, 3] of vertices at the corners of faces, [F, 3, 3]."""
    found = np.empty((*faces.shape, 3), values.dtype)

    def fill(rows):
        found[rows] = values[faces[rows]]

    in_tiles(fill, len(faces))
    return found


def _held(made):
    """A warning if a part is too thin for its form."""
    if made["held"] > TOLD_SHARE:
        yield (
            f"it is {1000.0 * float(made['thinnest']):.3g} mm thin at the least: its form goes inwards by a third "
            f"of the thickness at most, which holds it back on {100.0 * float(made['held']):.0f} % of its surface"
        )


def _doubts(part, base):
    """What relief cannot do well on a mesh, a sentence each; a sea floor may end anywhere."""
    open_edges, crossed = (len(keys) for keys in edge_uses(base.faces))
    corners = base.vertices[base.faces]
    if not open_edges and np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) < 0.0:
        yield (
            "its faces look inwards: silt lies below and growth stands inside; turn them around in the program that "
            "made the mesh"
        )
    elif not is_consistent(base.faces):
        yield "some of its faces look inwards, others outwards: relief and silt are torn there; make them agree"
    if _back_to_back(base) > TOLD_SHARE:
        yield (
            "faces of it lie back to back, so that it has no outside there: relief cannot move them; give it a "
            "thickness, or leave out one side"
        )
    if open_edges and part.name != "terrain" and part.material.relief != "none":
        yield (
            f"its mesh has holes ({open_edges} open edges): relief moves their rims, and what is thin may cross "
            "itself; close them, or choose relief: none"
        )
    if crossed:
        yield (
            f"{crossed} edges of its mesh have more than two faces: relief moves all of them one way; divide it "
            "into closed meshes, or choose relief: none"
        )


def _back_to_back(base):
    """Share of the faces whose corners' mean normals are at right angles to them or behind."""
    face = area_normals(base.vertices, base.faces)
    facing = np.einsum("fki,fi->fk", vertex_normals(base.vertices, base.faces)[base.faces], face)
    return float((largest(facing) < 0.1 * np.linalg.norm(face, axis=1)).mean())


def _seed(scene, part):
    """The seed of a part's patterns: by its material, its name and the scene, not by where it stands.

    Of copies also by their shape: stones of one block differ.
    """
    shape = f" {digest(part.vertices)}" if isinstance(part, Instances) else ""
    return zlib.crc32(f"{part.name} {part.material.seed}{shape}".encode(), scene.seed) % 2**31


def _around(scene, others):
    """What the sea floor knows of what stands on it; it takes no form of it unless the scene says so."""
    flow, shaped = flow_direction(scene.current.velocity), float(bool(scene.terrain.around_objects))

    def around(points):
        clear, height = surroundings(points, others, flow, scene.seed)
        return clear, shaped * height

    return around


def _standing(part):
    """Arrays that tell where a part stands."""
    return (part.vertices, part.faces, part.T_w_o) if isinstance(part, Instances) else (part.vertices, part.faces)
