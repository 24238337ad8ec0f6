"""Mesh files and parametric objects become parts of the world: placed, in float64."""

from dataclasses import replace

import numpy as np

from varos_warp.cache import cached, code_hash, digest
from varos_warp.errors import InputError, warn
from varos_warp.scene.courses.recorded import read_course
from varos_warp.scene.description import Scene
from varos_warp.scene.description.surfaces import Layered
from varos_warp.scene.description.survey import Heights
from varos_warp.scene.description.world import (
    CalibrationBoard,
    ColorChart,
    Diffuse,
    MeshObject,
    Object,
    ProceduralTerrain,
    Terrain,
)
from varos_warp.scene.frames import attitude
from varos_warp.scene.geometry import assets, procedural, terrain
from varos_warp.scene.geometry.assets.boards import board, chart
from varos_warp.scene.geometry.joining import join
from varos_warp.scene.geometry.mesh_files import load_mesh
from varos_warp.scene.geometry.parts import Moving, Part, Skin
from varos_warp.scene.geometry.rounding import single_precision_step
from varos_warp.scene.geometry.survey import read_survey

GRID_M = 0.05
"""Longest edge of objects that get relief [m], which begins with an even grid."""
SMALLEST_M, LARGEST_M = 1e-9, 1e9
"""Sizes of parts: the products of smaller lengths leave single precision, longer rays hit nothing."""


def terrain_part(scene: Scene) -> Part:
    """The terrain, which the scene must have."""
    return _part(scene, scene.terrain, "terrain", *_terrain_mesh(scene))


def may_have_colours(block: Terrain | Heights | ProceduralTerrain | Object) -> bool:
    """Return whether a block takes the colours of its mesh file or board, if that has any."""
    if isinstance(block, Terrain):
        return (
            block.material is None
            and block.preprocess is None
            and (isinstance(block.file, str) or len(block.file) == 1)
        )
    brings_along = isinstance(block, MeshObject | CalibrationBoard | ColorChart) or assets.has_colours(block)
    return block.material is None and brings_along


def may_have_images(block: Terrain | Heights | ProceduralTerrain | Object) -> bool:
    """Whether the colours that a block takes may be images: those of mesh files."""
    return isinstance(block, Terrain | MeshObject)


def object_part(scene: Scene, block: Object, key: str) -> Part:
    """An object of the scene file where its block places it; ``key`` names it, also in messages."""
    if isinstance(block, MeshObject):
        path = scene.resolve(block.file)
        mesh = load_mesh(path, f"{key}.file", block.up_axis, with_skin=may_have_colours(block))
        part = _part(scene, block, key, mesh.vertices, mesh.faces, mesh.skin, (mesh.facts,))
    elif isinstance(block, CalibrationBoard | ColorChart):
        vertices, faces, skin = board(block) if isinstance(block, CalibrationBoard) else chart(block)
        part = _part(scene, block, key, vertices, faces, skin if may_have_colours(block) else None)
    else:
        layered = isinstance(scene.materials.get(block.material or ""), Layered)
        edge = GRID_M if layered and block.max_edge_m is None else None
        vertices, faces, colours = assets.make_coloured(block, key, max_edge_m=edge)
        part = _part(scene, block, key, vertices, faces, _of_one_colour(colours) if may_have_colours(block) else None)
    return _moving(part, block)


def _of_one_colour(colours):
    """The skin of faces that are each of one colour [F, 3]."""
    return Skin(np.repeat(colours[:, None], 3, axis=1))


def moving_part(scene: Scene, key: str) -> Moving:
    """One of `Scene.moving`; the axes of a body are those of its vehicle."""
    block, vehicle = scene.moving[key], scene.companions.get(key)
    if vehicle is None:
        part = object_part(scene, block, key)
        assert isinstance(part, Moving)
        return part
    read_course(scene.observed_by(vehicle.id))
    where = f"vehicles.{(scene.vehicles or []).index(vehicle)}.body"
    own, start, R = object_part(scene, block, where), np.array(vehicle.start.position), attitude(vehicle.start)
    placed = replace(own, name=key, vertices=own.vertices @ R.T + start, origin=vehicle.start.position)
    return Moving.of(placed, R)


def _moving(part: Part, block: Object) -> Part:
    """A part that knows its path, if its block has one; it stands at the first stop."""
    if not block.path:
        return part
    return Moving.of(part, attitude(block.stops[0]), tuple(block.stops))


def _terrain_mesh(scene):
    """Return vertices, faces and Skin or None of the terrain in its own axes, and its `Survey` or None."""
    block = scene.terrain
    if isinstance(block, ProceduralTerrain):
        return (
            *procedural.generate_terrain(
                block.size_m, block.resolution, block.relief_m, block.feature_m, block.rockiness, block.seed
            ),
            None,
            (),
            None,
        )
    skin, files, survey = None, (), None
    if isinstance(block, Heights):
        survey = read_survey(block, scene.resolve)
        vertices, faces = survey.vertices, survey.faces
    else:
        vertices, faces, skin, files = _joined_files(scene, block)
    if block.preprocess is not None:
        vertices, faces = _preprocessed(vertices, faces, block.preprocess.model_dump())
    if block.detail is not None:
        vertices = procedural.add_detail(vertices, **block.detail.model_dump())
    return vertices if block.origin is None else vertices - block.origin, faces, skin, files, survey


def _joined_files(scene, block):
    """Return vertices, faces, Skin or None and facts of the mesh files of a terrain; several have no Skin."""
    names = [block.file] if isinstance(block.file, str) else block.file
    with_skin = may_have_colours(block)
    loaded = [load_mesh(scene.resolve(name), "terrain.file", block.up_axis, with_skin=with_skin) for name in names]
    return *join((mesh.vertices, mesh.faces) for mesh in loaded), loaded[0].skin, tuple(mesh.facts for mesh in loaded)


def _preprocessed(vertices, faces, options):
    """A terrain made fit for use, with what there is to warn of; kept for later runs."""
    key = "terrain.preprocess"

    def preprocess():
        log = terrain.Log()
        mesh = terrain.preprocess(vertices, faces, key=key, log=log, **options)
        return {"vertices": mesh[0], "faces": mesh[1], "warnings": np.array(log.warnings, dtype=str)}

    code = code_hash(terrain.__name__, ("varos_warp.kernels", "varos_warp.scene.geometry"))
    kept = cached(
        "terrain",
        {"mesh": digest(vertices, faces), "options": options, "code": code},
        preprocess,
        what="the sea floor by terrain.preprocess",
    )
    for text in kept["warnings"]:
        warn(f"{key}: {text}")
    return kept["vertices"], kept["faces"]


def _part(scene, block, key, vertices, faces, skin=None, files=(), survey=None):
    """A mesh where its block places it: scaled, turned, moved."""
    doubts = [] if survey is None else survey.warnings
    if step := single_precision_step(vertices):
        doubts = [
            *doubts,
            f"its places were rounded to {step:.2g} m, as single precision has them so far from the "
            "origin: export it in double precision, or about an origin that is nearer",
        ]
    with np.errstate(over="ignore", invalid="ignore"):
        turned = (vertices * block.scale) @ attitude(next(iter(getattr(block, "stops", ())), block)).T
    reach, size = float(np.abs(turned).max()), float(np.ptp(turned, axis=0).max())
    if not (reach <= LARGEST_M and size >= SMALLEST_M):
        what = f"is {size:.3g} m across" if reach <= LARGEST_M else f"reaches {reach:.3g} m from its origin"
        raise InputError(
            f"{what}; parts are {SMALLEST_M:g} to {LARGEST_M:g} m large",
            key=key,
            remedy=f"Check the units of its file or its measures, and its scale ({block.scale}).",
        )
    return Part(
        name=key,
        vertices=turned + np.asarray(block.position),
        faces=np.asarray(faces, np.int32),
        material=scene.materials[block.material] if block.material is not None else Diffuse(),
        origin=block.position,
        smooth_angle=float(np.radians(block.smooth_angle_deg)),
        smooth_shading=block.shading == "smooth",
        skin=skin,
        files=files,
        survey=survey and survey.facts,
        doubts=tuple(doubts),
    )
