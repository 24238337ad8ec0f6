"""Virtual point lights: where rays from the lights first hit surfaces, traced anew for each frame.

Light that a surface reflects to a vertex can be found in two ways: from the vertex, by a ray from its lobe that happens
to hit the lit point, or from the light, by a virtual point light that happens to be visible from the vertex. The first
fails for small bright areas far away, the second for points close by. Both are used, weighted by the power heuristic
(Veach and Guibas 1995), which bounds both. One of several virtual point lights is chosen by its unobstructed
contribution (resampling, Talbot et al. 2005).
"""

import warp as wp

from varos_warp.kernels.numerics import brightest
from varos_warp.kernels.sampling import half_key, make_reservoir, offer
from varos_warp.kernels.sobol import sobol2, sobol4
from varos_warp.kernels.spec import SceneSpec, specialised
from varos_warp.kernels.transport.moments import Moments, first_instant, instants_taken, with_points
from varos_warp.kernels.transport.next_event import irradiance
from varos_warp.kernels.transport.subpath import Vertex, own_lobe_pdf, vertex_eval
from varos_warp.kernels.world.bsdf import facing
from varos_warp.kernels.world.intersect import Hit, SceneData, make_rays, moves, to_instance
from varos_warp.kernels.world.lights.choice import choose_by_flux, total_flux
from varos_warp.kernels.world.lights.light import (
    get_light,
    light_axis,
    light_emit,
    light_flux,
    light_sample,
    light_solid_angle,
)
from varos_warp.kernels.world.lights.record import Light
from varos_warp.kernels.world.medium import transmittance
from varos_warp.kernels.world.rough_diffuse import rough_diffuse
from varos_warp.kernels.world.surface import MATERIALS, SurfacePoint, make_surface_at
from varos_warp.kernels.world.texture import METAL, SUBPATH_ANGLE

wp.set_module_options({"enable_backward": False})

CANDIDATES = wp.constant(4)
"""Number of virtual point lights from which one is chosen."""


@wp.struct
class VirtualLight:
    """A point that a light lights."""

    p: wp.vec3
    """Origin of rays from it; on what moves, an offset in its axes and units."""
    n: wp.vec3
    """Geometric normal on the lit side; on what moves, in its axes."""
    moving: int
    """Number of what moves that it lies on; -1 for others."""
    L: wp.vec3
    """Radiance that the surface reflects, if rough that a white Lambertian one would; 0 if the ray hit nothing, or a
    material that may be metal."""
    density: float
    """Density of such points [1/m^2]."""
    shading: wp.vec3
    """Shading normal of a rough surface, and the direction to the light; on what moves, in its axes."""
    to_light: wp.vec3
    reflectance: wp.vec3
    """Reflectance of a rough surface's diffuse part, and the roughness of that; 0 for a Lambertian one."""
    diffuse_roughness: float


@wp.func
def radiance_towards(point: VirtualLight, v: wp.vec3):
    """Radiance that the surface reflects in direction ``v``."""
    if point.diffuse_roughness <= 0.0:
        return point.L
    n = point.shading
    matte = rough_diffuse(point.reflectance, point.diffuse_roughness, n, facing(n, v), point.to_light)
    return wp.cw_mul(matte, point.L)


@wp.func
def may_have_lobe(scene: SceneData, hit: Hit):
    """Whether a surface's material can be metal; decided by the material, so that rays of any footprint agree."""
    material = scene.materials[hit.part]
    return material.kind == METAL or material.metallic == 1


@wp.func
def virtual_density(scene: SceneData, i: int, p: wp.vec3, n: wp.vec3):
    """Density [1/m^2] of the virtual point lights of light ``i`` at a lit point with geometric normal ``n``."""
    light = get_light(scene.lights, i)
    sample = light_sample(light, p)
    slant = wp.abs(wp.dot(n, sample.d)) / (sample.distance * sample.distance)
    solid_angle = light_solid_angle(light, -wp.dot(sample.d, light_axis(light)))
    return light_flux(light) / total_flux(scene.lights) * slant / solid_angle


@wp.func
def group_of(instant: int, moments: Moments, points: wp.array2d(dtype=VirtualLight)):
    """Group of virtual point lights for the samples of an instant."""
    return (instant - first_instant(moments)) * (points.shape[0] / 2) / instants_taken(moments)


@wp.func
def instant_of_group(moments: Moments, group: int, groups: int, u: float):
    """The instant of a virtual point light, one of its group's."""
    instants = instants_taken(moments)
    first = (group * instants + groups - 1) / groups
    after = ((group + 1) * instants + groups - 1) / groups
    return first_instant(moments) + first + int(u * float(after - first))


@specialised("instances", *MATERIALS, "masks", "bands", "varies", "disks")
def make_virtual_lights_kernel(spec: SceneSpec) -> wp.Kernel:
    """Rays from the lights to the first surface."""
    first_hit = make_rays(spec).first_hit
    surface_at = make_surface_at(spec)

    @wp.func
    def moves_with(scene: SceneData, hit: Hit, point: VirtualLight):
        """The point in the axes of what moves, if it lies on that: samples of other instants find it on the surface."""
        after = point
        if moves(scene, hit):
            copy = scene.moving[hit.instance]
            after.p = to_instance(copy, point.p - copy.p)
            after.n = wp.transpose(copy.R) * point.n
            if wp.static(spec.rough):
                after.shading = wp.transpose(copy.R) * point.shading
                after.to_light = wp.transpose(copy.R) * point.to_light
            after.moving = hit.instance
        return after

    @wp.func
    def as_rough(point: VirtualLight, lit: SurfacePoint, d: wp.vec3, E: wp.vec3):
        """The point with what the radiance of a rough surface needs, lit along ``d`` by irradiance E."""
        after = point
        if lit.bsdf.diffuse_roughness > 0.0 and wp.dot(lit.n, d) < 0.0:
            after.L = E / wp.pi
            after.shading = lit.n
            after.to_light = -d
            after.reflectance = lit.bsdf.reflectance
            after.diffuse_roughness = lit.bsdf.diffuse_roughness
        return after

    @wp.kernel(module="unique", enable_backward=False)
    def find_virtual_lights(
        scene: SceneData,
        moments: Moments,
        first_row: int,
        key: wp.uint32,
        # out
        points: wp.array2d(dtype=VirtualLight),
    ):
        """Virtual point lights for each group of instants and half of the samples: [2 * group + half, point]."""
        k = first_row + wp.tid()
        row = k / points.shape[1]
        col = k % points.shape[1]
        u = sobol4(half_key(key, row), -1, col, 0)
        if wp.static(spec.varies):
            v = sobol2(half_key(key, row), -1, col, 2)
            instant = instant_of_group(moments, row / 2, points.shape[0] / 2, v[0])
            scene.lights = moments.lights[instant]
            scene.moving = moments.moving[instant]
        if wp.static(spec.disks > 0):
            drawn = wp.zeros(shape=wp.static(spec.disks), dtype=Light)
            scene = with_points(scene, scene.lights, sobol2(half_key(key, row), -1, col, 3), drawn)
        i = choose_by_flux(scene.lights, u[2])
        light = get_light(scene.lights, i)
        ray = light_emit(light, u[0], u[1])
        d = ray.d
        hit = first_hit(scene, ray.o, d)
        point = VirtualLight()
        point.moving = -1
        if hit.face >= 0:
            lit = surface_at(scene, hit, d, SUBPATH_ANGLE)
            point.p = lit.start
            point.n = lit.n_geometric
            if not may_have_lobe(scene, hit):
                E = wp.max(-wp.dot(lit.n, d), 0.0) * irradiance(scene.medium, light_sample(light, hit.p))
                point.L = wp.cw_mul(lit.bsdf.reflectance, E) / wp.pi
                if wp.static(spec.rough):
                    point = as_rough(point, lit, d, E)
                point.density = virtual_density(scene, i, hit.p, hit.n)
            if wp.static(spec.instances and spec.varies):
                point = moves_with(scene, hit, point)
        points[row, col] = point

    return find_virtual_lights


@wp.struct
class VirtualConnection:
    """Unobstructed light of one virtual point light at a vertex."""

    p: wp.vec3
    L: wp.vec3


@wp.func
def in_world(scene: SceneData, point: VirtualLight):
    """A virtual point light where what it lies on is at the sample's instant."""
    after = point
    if point.moving >= 0:
        copy = scene.moving[point.moving]
        after.p = copy.scale * (copy.R * point.p) + copy.p
        after.n = copy.R * point.n
        after.shading = copy.R * point.shading
        after.to_light = copy.R * point.to_light
    return after


@specialised("instances", "varies", "rough")
def make_gather_virtual_light(spec: SceneSpec) -> wp.Function:
    """The function ``gather_virtual_light(scene, points, vertex, u)``, with or without what moves or is rough."""

    @wp.func
    def gather_virtual_light(scene: SceneData, points: wp.array(dtype=VirtualLight), vertex: Vertex, u: wp.vec2):
        """Light of the virtual point lights at a vertex, towards where its ray came from, estimated by one of them.

        The CANDIDATES are neighbours in the list, which as points of a Sobol sequence lie far apart in the light, and
        close together in memory. Even and odd samples of a pixel use different points, so their difference shows the
        error that all pixels share.
        """
        chosen = make_reservoir(u[1])
        best = VirtualConnection()
        sets = points.shape[0] / CANDIDATES
        first = CANDIDATES * wp.min(int(u[0] * float(sets)), sets - 1)
        candidates = int(CANDIDATES)  # a variable, so that the loop is not unrolled: small code is faster on a GPU
        for k in range(candidates):
            point = points[first + k]
            if wp.static(spec.instances and spec.varies):
                point = in_world(scene, point)
            offset = point.p - vertex.p
            r2 = wp.max(wp.dot(offset, offset), 1.0e-12)
            r = wp.sqrt(r2)
            d = offset / r
            towards = -wp.dot(point.n, d) / r2
            if towards > 0.0 and point.density > 0.0:
                found = own_lobe_pdf(scene, vertex, d) * towards
                # from the ratio of weight and density, because the square of either alone might overflow
                ratio = found / (float(CANDIDATES) * point.density)
                share = 1.0 / (point.density * (1.0 + ratio * ratio))
                f = vertex_eval(scene, vertex, d)
                sent = point.L
                if wp.static(spec.rough):
                    sent = radiance_towards(point, -d)
                L = (towards * share) * wp.cw_mul(wp.cw_mul(f, transmittance(scene.medium, r)), sent)
                weight = brightest(L)
                chosen = offer(chosen, k, weight)
                if weight > 0.0 and chosen.index == k:
                    best.p = point.p
                    best.L = L / weight
        best.L *= chosen.total / float(CANDIDATES)
        return best

    return gather_virtual_light


@wp.func
def found_weight(scene: SceneData, lobe_pdf: float, d: wp.vec3, t: float, light: int, p: wp.vec3, n: wp.vec3):
    """Power heuristic against `gather_virtual_light`, for what a ray of density ``lobe_pdf`` found after ``t``."""
    found = lobe_pdf * wp.abs(wp.dot(d, n)) / (t * t)
    ratio = wp.min(float(CANDIDATES) * virtual_density(scene, light, p, n) / wp.max(found, 1.0e-30), 1.0e15)
    return 1.0 / (1.0 + ratio * ratio)
