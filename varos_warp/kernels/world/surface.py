"""What a ray finds on a surface: the point, its normals and how it scatters light."""

import warp as wp

from varos_warp.kernels.spec import SceneSpec, specialised
from varos_warp.kernels.world.intersect import (
    Hit,
    SceneData,
    between,
    get_instance,
    moves,
    page_of,
    tint_between,
    to_instance,
)
from varos_warp.kernels.world.texture import MAPPED, Bsdf, footprint_width, make_material_at

wp.set_module_options({"enable_backward": False})

MATERIALS = ("textures", "patterns", "metals", "grain", "rough")
"""What surfaces are compiled for."""


@wp.struct
class SurfacePoint:
    """Point at which a ray hit a surface."""

    start: wp.vec3
    """Origin of rays that leave, off the surface on the side from which the ray came."""
    n_geometric: wp.vec3
    """Normal of the triangle, towards that side."""
    n: wp.vec3
    """Shading normal, towards that side."""
    bsdf: Bsdf


@wp.func
def corner_normal(scene: SceneData, normals: wp.array(dtype=wp.vec3), hit: Hit):
    """Interpolated corner normal in the world, flipped to the side of ``hit.n``."""
    n = wp.normalize(between(normals, hit.face, hit.bary))
    if hit.instance >= 0:
        n = get_instance(scene, hit.instance).R * n
    return wp.where(wp.dot(n, hit.n) < 0.0, -n, n)


@wp.func
def shading_normal(scene: SceneData, hit: Hit):
    """Shading normal at a hit."""
    if scene.has_shading_normals == 0:
        return hit.n
    return corner_normal(scene, scene.shading_normals, hit)


@specialised("patterns", "metals", "grain", "instances")
def make_textured(spec: SceneSpec) -> wp.Function:
    """The function ``textured`` of a material other than one plain reflectance."""
    material_at = make_material_at(spec)

    @wp.func
    def textured(scene: SceneData, hit: Hit, n: wp.vec3, footprint: float):
        """Scattering function at a hit, averaged over ``footprint`` [m]."""
        m = scene.materials[hit.part]
        at = wp.vec3(0.0)
        if scene.corner_values.shape[0] > 0:
            at = between(scene.corner_values, hit.face, hit.bary)
        page = page_of(scene.face_page, hit.face)
        p = hit.p
        up = n
        if wp.static(spec.patterns and spec.instances):
            if hit.instance >= 0 and m.kind == MAPPED and page >= 0:
                at[2] = at[2] / get_instance(scene, hit.instance).scale
        if wp.static((spec.patterns or spec.grain) and spec.instances):
            if moves(scene, hit):
                # patterns move with their object
                copy = scene.moving[hit.instance]
                p = to_instance(copy, hit.p - copy.p)
                up = to_instance(copy, n)
        bsdf = material_at(m, p, up, at, page, footprint)
        if scene.face_tint.shape[0] > 0:
            tint = tint_between(scene.face_tint, scene.corner_tints, hit.face, hit.bary)
            bsdf.reflectance = wp.cw_mul(bsdf.reflectance, wp.vec3(tint[0], tint[1], tint[2]))
        return bsdf

    return textured


@specialised(*MATERIALS, "instances", "bands")
def make_surface_at(spec: SceneSpec) -> wp.Function:
    """The function ``surface_at(scene, hit, d, angle) -> SurfacePoint``, of a ray along ``d`` for a cone of ``angle``.

    Without textures every surface is a plain reflectance: on a GPU textures take half as many registers again, which
    spill to memory.
    """
    textured = make_textured(spec)

    @wp.func
    def surface_at(scene: SceneData, hit: Hit, d: wp.vec3, angle: float):
        """The surface at a hit, averaged over where the ray's cone meets it."""
        point = SurfacePoint()
        point.start = hit.start
        point.n_geometric = hit.n
        point.n = shading_normal(scene, hit)
        if wp.static(spec.textures):
            point.bsdf = textured(scene, hit, point.n, footprint_width(angle, hit.t, d, hit.n))
        else:
            point.bsdf.reflectance = scene.materials[hit.part].base
        if wp.static(spec.rough):
            point.bsdf.diffuse_roughness = scene.materials[hit.part].diffuse_roughness
        if wp.static(spec.bands):
            point.bsdf.reflectance = scene.to_bands[hit.part] * point.bsdf.reflectance
            point.bsdf.specular = scene.to_bands[hit.part] * point.bsdf.specular
        return point

    return surface_at
