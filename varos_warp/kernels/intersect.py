"""The scene on the device and its rays: first hit and visibility."""

import warp as wp

from varos_warp.kernels.conventions import FAR
from varos_warp.kernels.light import Light
from varos_warp.kernels.medium import Medium
from varos_warp.kernels.texture import Material, reflectance

wp.set_module_options({"enable_backward": False})


@wp.struct
class SceneData:
    """Everything that rays meet; in the local world, as handles that the host's DeviceScene owns."""

    mesh: wp.uint64
    """0 in open water."""
    face_material: wp.array(dtype=wp.int32)
    """Material index, shape [F]."""
    materials: wp.array(dtype=Material)
    shading_normals: wp.array(dtype=wp.vec3)
    """Normals that A and B are lit with, per face corner, shape [3 F]; unused while ``has_shading_normals`` is 0."""
    has_shading_normals: int
    smooth_normals: wp.array(dtype=wp.vec3)
    """Normals of image C, per face corner, shape [3 F]."""
    medium: Medium
    lights: wp.array(dtype=Light)
    ray_count: wp.array(dtype=wp.int64)
    """Counts rays, shape [1]; empty but for benchmarks."""


@wp.struct
class Hit:
    """First surface on a ray; ``t`` is FAR and ``face`` -1 where there is none."""

    t: float
    face: int
    bary: wp.vec2
    p: wp.vec3
    """Point on the surface."""
    start: wp.vec3
    """Where rays leave the surface: a rounding error off it, on the side the ray came from."""
    n: wp.vec3
    """Geometric normal towards the side the ray came from."""


@wp.func
def offset_distance(mesh: wp.uint64, face: int, p: wp.vec3):
    """How far a secondary ray starts from its surface [m].

    A few float32 spacings of the coordinates and of the triangle's size, with which the rounding of hits grows.
    """
    reach = wp.max(wp.abs(p))
    for i in range(3):
        reach = wp.max(reach, wp.max(wp.abs(wp.mesh_get_point(mesh, 3 * face + i) - p)))
    return 1.0e-6 + 4.0e-6 * reach


@wp.func
def count_ray(scene: SceneData):
    """Count a ray where a benchmark asks for it."""
    if scene.ray_count.shape[0] > 0:
        wp.atomic_add(scene.ray_count, 0, wp.int64(1))


@wp.func
def first_hit(scene: SceneData, o: wp.vec3, d: wp.vec3):
    """Nearest surface along the ray."""
    hit = Hit()
    hit.t = FAR
    hit.face = -1
    if scene.mesh == wp.uint64(0):
        return hit
    count_ray(scene)
    query = wp.mesh_query_ray(scene.mesh, o, d, FAR)
    if query.result:
        hit.t = query.t
        hit.face = query.face
        hit.bary = wp.vec2(query.u, query.v)
        hit.n = wp.where(wp.dot(query.normal, d) > 0.0, -query.normal, query.normal)
        # from the triangle, not from o + t d: the rounding does not grow with the ray
        hit.p = wp.mesh_eval_position(scene.mesh, query.face, query.u, query.v)
        hit.start = hit.p + offset_distance(scene.mesh, query.face, hit.p) * hit.n
    return hit


@wp.func
def corner_normal(normals: wp.array(dtype=wp.vec3), hit: Hit):
    """Interpolated corner normal, turned to the side of ``hit.n``."""
    corner = 3 * hit.face
    w = 1.0 - hit.bary[0] - hit.bary[1]
    n = wp.normalize(hit.bary[0] * normals[corner] + hit.bary[1] * normals[corner + 1] + w * normals[corner + 2])
    return wp.where(wp.dot(n, hit.n) < 0.0, -n, n)


@wp.func
def shading_normal(scene: SceneData, hit: Hit):
    """Normal for the reflected light at a hit."""
    if scene.has_shading_normals == 0:
        return hit.n
    return corner_normal(scene.shading_normals, hit)


@wp.func
def hit_reflectance(scene: SceneData, hit: Hit, n: wp.vec3, footprint: float):
    """Lambertian reflectance per channel at a hit, averaged over ``footprint`` [m] (see texture.footprint_width)."""
    return reflectance(scene.materials[scene.face_material[hit.face]], hit.p, n, footprint)


@wp.func
def visible(scene: SceneData, p: wp.vec3, q: wp.vec3):
    """Whether nothing stands between two points."""
    offset = q - p
    distance = wp.length(offset)
    if distance == 0.0 or scene.mesh == wp.uint64(0):
        return True
    count_ray(scene)
    return not wp.mesh_query_ray_anyhit(scene.mesh, p, offset / distance, distance)
