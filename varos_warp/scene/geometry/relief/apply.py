"""Which parts of a scene have relief, how fine each becomes, and the parts as they are afterwards."""

import itertools
import zlib
from dataclasses import replace

import numpy as np

from varos_warp.cache import cached, code_hash, digest
from varos_warp.errors import warn
from varos_warp.scene.description import Scene
from varos_warp.scene.description.surfaces import Layered
from varos_warp.scene.geometry.course import places, used_stops
from varos_warp.scene.geometry.parts import Instances, Moving, Part, Skin
from varos_warp.scene.geometry.relief.budget import MOST_TRIANGLES, factor_for, rough
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
        parts: What is solid in it.
    """
    if not any(isinstance(part.material, Layered) for part in parts):
        return parts
    seen = footprint(scene, parts)
    parts = [some for part in parts for some in (_by_detail(part, seen) if isinstance(part, Instances) and isinstance(
        part.material, Layered) else [part])]
    chosen = [i for i, part in enumerate(parts) if isinstance(part.material, Layered)]
    bases = {i: base_of(parts[i]) for i in chosen}
    pixels = {i: pixels_on(scene, parts[i], bases[i], seen) for i in chosen}
    most = scene.render.max_triangles or MOST_TRIANGLES
    # without bodies, of which every vehicle sees others: all see the same world
    alike = [i for i in chosen if parts[i].name not in scene.companions]
    factor = _factor(scene, {i: (parts[i], bases[i], pixels[i]) for i in alike}, seen, most)
    done: dict[int, Part | Instances] = {}
    for i in sorted(chosen, key=lambda i: parts[i].name == "terrain"):  # the ground comes last: it lies against them
        now = [done.get(k, part) for k, part in enumerate(parts)]
        done[i] = _formed(scene, parts[i], now, bases[i], pixels[i], seen, factor)
    if factor > TOLD_FACTOR:
        warn(f"render.max_triangles: {most} triangles are few for surfaces with relief: their edges are {factor:.1f} "
             "times as long as asked, so the finest forms are missing; raise it")
    return [done.get(i, part) for i, part in enumerate(parts)]


def _factor(scene, surfaces, seen, most):
    """By how much all edges are longer than asked; kept, as it takes seconds."""
    depends_on = {"meshes": [digest(base.vertices, base.faces, base.normals, base.middle)
                             for _, base, _ in surfaces.values()],
                  "places": [_places_of(scene, part) for part, _, _ in surfaces.values()], "most": most,
                  "cameras": seen.digest, "code": _code()}

    def build():
        looks = [rough(base.vertices, base.faces, pixel, base.normals) for _, base, pixel in surfaces.values()]
        return {"factor": np.array(factor_for(looks, most))}

    return float(cached("relief_factor", depends_on, build)["factor"])


def _places_of(scene, part):
    """What tells where a part comes to, beside its mesh; None of what stands in one place."""
    if isinstance(part, Instances):
        return digest(part.T_w_o)
    return digest(way_of(scene, part), np.array(part.origin)) if isinstance(part, Moving) else None


def _code():
    return code_hash(__name__, ("varos_warp.scene.geometry", "varos_warp.kernels.mesh", "varos_warp.kernels.world"))


def pixels_on(scene: Scene, part: Part | Instances, base: Base, seen: Footprint) -> Pixels:
    """How wide a pixel is at points about a base's middle.

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


def _formed(scene, part, parts, base, pixels, seen, factor):
    """A part with its relief; from the user's cache where it was made before."""
    look = part.material.model_copy(update={"seed": _seed(scene, part)})
    others = [other for other in parts if other.name != part.name and not isinstance(other, Moving)]
    around = _around(scene, others) if part.name == "terrain" else None
    ground = _ground_of(part, parts)
    tint = tint_of(ground.material if ground else part.material)
    depends_on = {"mesh": digest(base.vertices, base.faces, base.normals, base.middle), "factor": factor,
                  "look": look.model_dump(mode="json"), "cameras": seen.digest, "code": _code(),
                  "places": _places_of(scene, part), "tint": tint.tolist(),
                  "stands": ground and [bool(scene.terrain.around_objects), digest(*_standing(ground))],
                  "ground": around and [digest(*_standing(other)) for other in others],
                  "around": around and bool(scene.terrain.around_objects) and list(scene.current.velocity)}

    def build():
        foot = foot_of(part, ground and Surface(ground.vertices, ground.faces), base.middle,
                       bool(ground and scene.terrain.around_objects), scene.seed)
        return formed(base, look, lambda points, normals: longest_edge(pixels(points, normals), factor), around, foot,
                      tint)

    made = cached("relief", depends_on, build,
                  what=f"the relief of {part.name}" if len(base.faces) > TOLD_FACES else None)
    vertices, faces = made["vertices"].astype(float) + base.middle, made["faces"]
    facts = {"triangles": len(faces), "edge_factor": round(factor, 3)}
    return replace(part, vertices=vertices, faces=faces, normals=made["normals"][faces], smooth_shading=True,
                   smooth_angle=np.pi, skin=Skin(made["colours"][faces]), relief=facts, before=part,
                   doubts=(*part.doubts, *_doubts(part, base), *_held(made)))


def _ground_of(part, parts):
    """The terrain that a part may stand in; None for itself, and for what moves."""
    if part.name == "terrain" or isinstance(part, Moving):
        return None
    return next((other for other in parts if other.name == "terrain"), None)


def _held(made):
    """That a part is too thin for its form, if it is."""
    if made["held"] > TOLD_SHARE:
        yield (f"it is {1000.0 * float(made['thinnest']):.3g} mm thin at the least: its form goes inwards by a third "
               f"of the thickness at most, which holds it back on {100.0 * float(made['held']):.0f} % of its surface")


def _doubts(part, base):
    """What relief cannot do well on a mesh, a sentence each; a sea floor may end anywhere."""
    open_edges, crossed = (len(keys) for keys in edge_uses(base.faces))
    corners = base.vertices[base.faces]
    if not open_edges and np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) < 0.0:
        yield ("its faces look inwards: silt lies below and growth stands inside; turn them around in the program that "
               "made the mesh")
    elif not is_consistent(base.faces):
        yield "some of its faces look inwards, others outwards: relief and silt are torn there; make them agree"
    if _back_to_back(base) > TOLD_SHARE:
        yield ("faces of it lie back to back, so that it has no outside there: relief cannot move them; give it a "
               "thickness, or leave out one side")
    if open_edges and part.name != "terrain" and part.material.relief != "none":
        yield (f"its mesh has holes ({open_edges} open edges): relief moves their rims, and what is thin may cross "
               "itself; close them, or choose relief: none")
    if crossed:
        yield (f"{crossed} edges of its mesh have more than two faces: relief moves all of them one way; divide it "
               "into closed meshes, or choose relief: none")


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
