"""The scene on the device and its rays: first hit and visibility."""

from typing import NamedTuple

import warp as wp

from varos_warp.kernels.conventions import FAR
from varos_warp.kernels.spec import SceneSpec, specialised
from varos_warp.kernels.world.lights.record import Light
from varos_warp.kernels.world.medium import Medium
from varos_warp.kernels.world.texture import Material, page_alpha

wp.set_module_options({"enable_backward": False})


@wp.struct
class Instance:
    """One of many copies of a mesh, or an object that moves: x_world = scale R x + p."""

    mesh: wp.uint64
    whole: wp.uint64
    """Mesh of those faces that no mask cuts, which come first; 0 if there are none. Only made where some are cut."""
    part: int
    first_face: int
    """Index of the mesh's first face in the arrays per face."""
    R: wp.mat33
    p: wp.vec3
    scale: float


@wp.struct
class Masks:
    """What tells where masks of mesh files cut holes; of arrays, those of the scene."""

    first_cut_face: int
    """First face of the scene's mesh that a mask may cut; those that none cuts come before."""
    face_part: wp.array(dtype=wp.int32)
    materials: wp.array(dtype=Material)
    corner_values: wp.array(dtype=wp.vec3)
    face_tint: wp.array(dtype=wp.int32)
    corner_tints: wp.array(dtype=wp.vec4)
    face_page: wp.array(dtype=wp.int32)


@wp.struct
class SceneData:
    """Everything that rays meet, in the local world; the host's DeviceScene owns the handles.

    All objects that occur once and stand still form one mesh in world axes. Objects that move and copies are instances:
    they have, or share, a mesh in its own axes, and a BVH over their boxes finds those that a ray may hit.
    """

    mesh: wp.uint64
    """Mesh of everything that stands still and is no instance; 0 if there is no such thing."""
    whole: wp.uint64
    """Mesh of those faces of ``mesh`` that no mask cuts; 0 if there are none. Only made where some are cut."""
    masks: wp.array(dtype=Masks)
    """One record, for functions that are not inlined; none if no mask cuts anything."""
    instance_bvh: wp.uint64
    """BVH over the boxes of what moves, wherever it is while a shutter is open, and then of the copies."""
    moving: wp.array(dtype=Instance)
    """What moves, where it is at one instant."""
    instances: wp.array(dtype=Instance)
    """Copies."""
    face_part: wp.array(dtype=wp.int32)
    """Part that a face of the mesh belongs to, shape [F]."""
    materials: wp.array(dtype=Material)
    """Material of each part."""
    shading_normals: wp.array(dtype=wp.vec3)
    """Normals for the lighting of A and B, per face corner in the mesh's axes; unused if ``has_shading_normals`` is 0.
    """
    has_shading_normals: int
    smooth_normals: wp.array(dtype=wp.vec3)
    """Normals of image C, per face corner in the mesh's axes."""
    corner_values: wp.array(dtype=wp.vec3)
    """Texture coordinates or colours from mesh files, per face corner (see texture.material_at); may be empty."""
    face_tint: wp.array(dtype=wp.int32)
    """Index of each face's three corners in ``corner_tints``, in threes; -1: it has none. Empty if no face has any."""
    corner_tints: wp.array(dtype=wp.vec4)
    """Colours from mesh files that multiply textures, and alpha."""
    face_page: wp.array(dtype=wp.int32)
    """Page of the mesh file's textures of each face, -1 for colours; empty if all have page 0, or colours."""
    lobe_albedo: wp.array2d(dtype=float)
    """Table of a white metal's albedo (bsdf.lobe_albedo); empty without metals."""
    to_bands: wp.array(dtype=wp.mat33)
    """Matrices from R, G, B to reflectances in the bands that the channels are, per part; empty without bands."""
    medium: Medium
    lights: wp.array(dtype=Light)


@wp.struct
class Hit:
    """First surface on a ray; ``t`` is FAR and ``face`` -1 if there is none."""

    t: float
    face: int
    """Index in the arrays per face."""
    part: int
    instance: int
    """Number of the instance in the BVH of instances; -1 in the mesh of single objects."""
    bary: wp.vec2
    p: wp.vec3
    """Point on the surface."""
    start: wp.vec3
    """Origin of secondary rays: a rounding error off the surface, on the side from which the ray came."""
    n: wp.vec3
    """Geometric normal towards the side the ray came from."""


@wp.func(inline=False)  # one copy for all callers: a GPU waits for long code
def any_hit(mesh: wp.uint64, o: wp.vec3, d: wp.vec3, t_max: float):
    """Return whether a ray hits a mesh, in its axes, before ``t_max``."""
    return wp.mesh_query_ray_anyhit(mesh, o, d, t_max)


@wp.func
def offset_distance(mesh: wp.uint64, face: int, p: wp.vec3):
    """Distance from the surface at which a secondary ray starts, in the units of the mesh.

    A few float32 spacings of the coordinates and of the triangle's size, as the rounding error of hits grows with both.
    """
    reach = wp.max(wp.abs(p))
    for i in range(3):
        reach = wp.max(reach, wp.max(wp.abs(wp.mesh_get_point(mesh, 3 * face + i) - p)))
    return 1.0e-6 + 4.0e-6 * reach


@wp.func
def get_instance(scene: SceneData, k: int):
    """The instance with a number in their BVH: what moves comes first."""
    moving = scene.moving.shape[0]
    if k < moving:
        return scene.moving[k]
    return scene.instances[k - moving]


@wp.func
def moves(scene: SceneData, hit: Hit):
    """Return whether what a ray hit is one of the objects that move; ``scene.moving[hit.instance]`` then."""
    return hit.instance >= 0 and hit.instance < scene.moving.shape[0]


@wp.func
def to_instance(instance: Instance, q: wp.vec3):
    """A vector of the world in an instance's axes and units; of a point, its offset from ``instance.p``."""
    return (wp.transpose(instance.R) * q) / instance.scale


# --------------------------------------------------------------------------------------------------------------- holes


@wp.func
def between(values: wp.array(dtype=wp.vec3), face: int, bary: wp.vec2):
    """Values given per face corner, interpolated at a place of a face."""
    corner = 3 * face
    w = 1.0 - bary[0] - bary[1]
    return bary[0] * values[corner] + bary[1] * values[corner + 1] + w * values[corner + 2]


@wp.func
def tint_between(face_tint: wp.array(dtype=wp.int32), tints: wp.array(dtype=wp.vec4), face: int, bary: wp.vec2):
    """Colour that multiplies a texture at a place of a face, and alpha; ones where there is none."""
    if face_tint.shape[0] == 0 or face_tint[face] < 0:
        return wp.vec4(1.0)
    corner = 3 * face_tint[face]
    w = 1.0 - bary[0] - bary[1]
    return bary[0] * tints[corner] + bary[1] * tints[corner + 1] + w * tints[corner + 2]


@wp.func
def page_of(face_page: wp.array(dtype=wp.int32), face: int):
    """Page of a mesh file's textures that a face shows; -1 for colours."""
    if face_page.shape[0] > 0:
        return face_page[face]
    return 0


@wp.func
def in_hole(masks: Masks, face: int, part: int, bary: wp.vec2):
    """Return whether a mask cuts a hole at a place of a face (glTF 2.0, 3.9.4: below the cutoff is nothing)."""
    if masks.materials[part].has_holes == 0:
        return False
    page = page_of(masks.face_page, face)
    if page < 0:
        return False
    layer = masks.materials[part].layers[page]
    if layer.cutoff <= 0.0:
        return False
    at = between(masks.corner_values, face, bary)
    alpha = page_alpha(layer, at[0], at[1]) * tint_between(masks.face_tint, masks.corner_tints, face, bary)[3]
    return alpha < layer.cutoff


STEEPEST = wp.constant(0.2)
"""Least cosine to a surface with which a ray steps through a hole in one step."""


@wp.func
def set_hit(hit: Hit, query: wp.MeshQueryRay):
    """The hit that a query found, in the axes of its mesh."""
    found = hit
    found.t = query.t
    found.face = query.face
    found.bary = wp.vec2(query.u, query.v)
    found.n = query.normal
    return found


@wp.func(inline=False)  # one copy for all callers, with one query in it: a GPU waits for long code
def first_solid(
    masks: wp.array(dtype=Masks),
    mesh: wp.uint64,
    whole: wp.uint64,
    first_face: int,
    part: int,
    o: wp.vec3,
    d: wp.vec3,
    t_max: float,
):
    """First hit of a mesh that is not in a hole, in its axes; face -1 if there is none before ``t_max``.

    ``whole`` is a mesh of those of its faces, the first ones, that no mask cuts; 0 if all may be cut. ``part`` is that
    of the mesh, or -1 if its faces have their own; ``first_face`` is where they start in the arrays per face.
    """
    hit = Hit()
    hit.face = -1
    start = o
    begin = float(0.0)
    end = t_max
    speed = wp.length(d)
    asks_whole = bool(False)
    while True:
        origin = wp.where(asks_whole, o, start)
        query = wp.mesh_query_ray(wp.where(asks_whole, whole, mesh), origin, d, wp.where(asks_whole, end, end - begin))
        if asks_whole:
            asks_whole = False
            if query.result:
                hit = set_hit(hit, query)
                end = query.t
        else:
            if not query.result:
                return hit
            face = first_face + query.face
            of = part
            if part < 0:
                of = masks[0].face_part[face]
            p = wp.mesh_eval_position(mesh, query.face, query.u, query.v)
            if face < masks[0].first_cut_face or not in_hole(masks[0], face, of, wp.vec2(query.u, query.v)):
                hit = set_hit(hit, query)
                if begin > 0.0:  # from the triangle: rounding errors of the steps do not add up
                    hit.t = wp.dot(p - o, d) / (speed * speed)
                return hit
            # after the first hole, what no mask cuts, from where the ray began: steps would pass what lies close behind
            asks_whole = begin == 0.0 and whole != wp.uint64(0)
            # on from just behind the hole; a grazing ray may meet the same face again, and takes another step
            cosine = wp.max(wp.abs(wp.dot(query.normal, d)) / speed, STEEPEST)
            step = offset_distance(mesh, query.face, p) / cosine / speed
            begin += query.t + step
            start = p + step * d
    return hit


# ----------------------------------------------------------------------------------------------------------- instances


@specialised("masks")
def make_in_instances(spec: SceneSpec):
    """The functions ``nearest_instance(scene, o, d, before)`` and ``any_instance(scene, o, d, t_max)``."""

    @wp.func
    def nearest_instance(scene: SceneData, o: wp.vec3, d: wp.vec3, before: Hit):
        """The nearer of a given hit and the ray's first hit of an instance, in the axes of its mesh."""
        hit = before
        query = wp.bvh_query_ray(scene.instance_bvh, o, d)
        k = int(0)
        while wp.bvh_query_next(query, k, hit.t):
            copy = get_instance(scene, k)
            # the direction is not normalised, so that t stays in units of the world
            if wp.static(spec.masks):
                solid = first_solid(
                    scene.masks,
                    copy.mesh,
                    copy.whole,
                    copy.first_face,
                    copy.part,
                    to_instance(copy, o - copy.p),
                    to_instance(copy, d),
                    hit.t,
                )
                if solid.face >= 0:
                    hit = solid
                    hit.instance = k
            else:
                found = wp.mesh_query_ray(copy.mesh, to_instance(copy, o - copy.p), to_instance(copy, d), hit.t)
                if found.result:
                    hit = set_hit(hit, found)
                    hit.instance = k
        return hit

    @wp.func
    def any_instance(scene: SceneData, o: wp.vec3, d: wp.vec3, t_max: float):
        """Return whether the ray hits an instance before ``t_max``."""
        query = wp.bvh_query_ray(scene.instance_bvh, o, d)
        k = int(0)
        while wp.bvh_query_next(query, k, t_max):
            copy = get_instance(scene, k)
            if wp.static(spec.masks):
                solid = first_solid(
                    scene.masks,
                    copy.mesh,
                    copy.whole,
                    copy.first_face,
                    copy.part,
                    to_instance(copy, o - copy.p),
                    to_instance(copy, d),
                    t_max,
                )
                if solid.face >= 0:
                    return True
            else:
                if any_hit(copy.mesh, to_instance(copy, o - copy.p), to_instance(copy, d), t_max):
                    return True
        return False

    return nearest_instance, any_instance


@wp.func
def locate(scene: SceneData, d: wp.vec3, found: Hit):
    """Complete a hit: its point in the world, the origin of secondary rays, and its part."""
    hit = found
    # from the triangle, not from o + t d: its rounding error does not grow with the ray's length
    if hit.instance < 0:
        hit.p = wp.mesh_eval_position(scene.mesh, hit.face, hit.bary[0], hit.bary[1])
        offset = offset_distance(scene.mesh, hit.face, hit.p)
        hit.part = scene.face_part[hit.face]
    else:
        copy = get_instance(scene, hit.instance)
        p = wp.mesh_eval_position(copy.mesh, hit.face, hit.bary[0], hit.bary[1])
        hit.p = copy.scale * (copy.R * p) + copy.p
        offset = copy.scale * offset_distance(copy.mesh, hit.face, p) + 4.0e-6 * wp.max(wp.abs(hit.p))
        hit.n = copy.R * hit.n
        hit.part = copy.part
        hit.face += copy.first_face
    hit.n = wp.where(wp.dot(hit.n, d) > 0.0, -hit.n, hit.n)
    hit.start = hit.p + offset * hit.n
    return hit


class Rays(NamedTuple):
    """Device functions of rays."""

    first_hit: wp.Function
    """(scene, o, d) -> Hit."""
    visible: wp.Function
    """(scene, p, q): whether nothing blocks the segment between two points."""


@specialised("instances", "masks")
def make_rays(spec: SceneSpec) -> Rays:
    """Functions of rays, with or without instances and masks.

    The stack of the query over instances would cost scenes without any a tenth of their speed. With masks the first hit
    is asked for in shadow rays too: whether there is any at all would have to be asked beside.
    """
    nearest_instance, any_instance = make_in_instances(spec)

    @wp.func
    def first_hit(scene: SceneData, o: wp.vec3, d: wp.vec3):
        """Nearest surface along the ray."""
        hit = Hit()
        hit.t = FAR
        hit.face = -1
        hit.instance = -1
        if scene.mesh != wp.uint64(0):
            if wp.static(spec.masks):
                solid = first_solid(scene.masks, scene.mesh, scene.whole, 0, -1, o, d, FAR)
                if solid.face >= 0:
                    hit = solid
                    hit.instance = -1
            else:
                query = wp.mesh_query_ray(scene.mesh, o, d, FAR)
                if query.result:
                    hit = set_hit(hit, query)
        if wp.static(spec.instances):
            hit = nearest_instance(scene, o, d, hit)
        if hit.face >= 0:
            hit = locate(scene, d, hit)
        return hit

    @wp.func
    def visible(scene: SceneData, p: wp.vec3, q: wp.vec3):
        """Return whether nothing blocks the segment between two points."""
        offset = q - p
        distance = wp.length(offset)
        if distance == 0.0:
            return True
        d = offset / distance
        if scene.mesh != wp.uint64(0):
            if wp.static(spec.masks):
                solid = first_solid(scene.masks, scene.mesh, scene.whole, 0, -1, p, d, distance)
                if solid.face >= 0:
                    return False
            else:
                if any_hit(scene.mesh, p, d, distance):
                    return False
        if wp.static(spec.instances):
            return not any_instance(scene, p, d, distance)
        return True

    return Rays(first_hit, visible)
