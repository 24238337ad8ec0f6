"""Image A: radiance of underwater pixels by one path tracer, with or without the field of open water.

Every segment of a path gathers the light that reaches it straight from the lights by one more event: a reflection off
the surface at its end, or a scattering on the way. On the camera's own segment these are the layers `direct` and
`single`. Subpaths carry light of more events. One starts with a reflection at the end of the camera's segment, another
with a scattering on it; both continue from vertex to vertex, in the water or on a surface, until roulette ends them. No
sample is clamped or dropped.

With the field (kernels/field) paths carry only what surfaces change: D = L - F, the radiance of the scene minus that of
scattered light in open water. Along a segment of length t, from p along d to the surface at q,

    light scattered once counts V - 1: nothing where the light is visible, minus itself where it is blocked;
    at q, direct light and reflectance E_F / pi are added, and F(q, d), which would come from behind, is subtracted;
    D itself continues, scattered in the water or reflected off the surface.

The camera's own segment adds F up to its end. The field does not store its own mirror image in metals, so a segment
that leaves a metal carries L, not D. docs/transport.md derives this, and says why second moments are finite.
"""

from dataclasses import dataclass, replace
from functools import cache

import warp as wp

from varos_warp.kernels.conventions import FAR, LONG_KERNEL
from varos_warp.kernels.field.lookup import reflected_field, sample_field
from varos_warp.kernels.field.open_water import Field, multiple_in_scattering
from varos_warp.kernels.field.single_scattering import single_scattering
from varos_warp.kernels.film.film import Film, PixelPart, Sums, add_sample, next_part, store
from varos_warp.kernels.numerics import brightest
from varos_warp.kernels.sampling import half_key, uniforms
from varos_warp.kernels.transport.next_event import sample_in_scattered, sample_reflected
from varos_warp.kernels.transport.pixel import sample_pixel
from varos_warp.kernels.transport.sobol import sobol4
from varos_warp.kernels.transport.subpath import (
    Subpath,
    Vertex,
    advance,
    first_scattering_pdf,
    is_metal,
    light_distance,
    light_reach,
    light_share,
    lobe_reaches_lights,
    own_lobe_pdf,
    sample_direction,
    sample_first_scattering,
    subpath_from_surface,
    subpath_from_water,
    surface_vertex,
    water_vertex,
)
from varos_warp.kernels.transport.virtual_lights import VirtualLight, found_weight, gather_virtual_light, may_have_lobe
from varos_warp.kernels.world.camera import Camera, Ray, camera_ray
from varos_warp.kernels.world.intersect import Hit, SceneData, make_hit_surface, make_rays, shading_normal
from varos_warp.kernels.world.light import get_light, light_count
from varos_warp.kernels.world.medium import transmittance
from varos_warp.kernels.world.texture import SUBPATH_ANGLE, footprint_width

wp.set_module_options({"enable_backward": False})

LOW_DIMENSIONS, IN_WATER = wp.constant(14), wp.constant(64)
"""Number of groups of four numbers that are low-discrepancy points, for each of the two subpaths of a sample; later
vertices hardly benefit. The second constant is the first group of the subpath that starts in the water."""
MOST_AROUND, LEAST_AROUND = wp.constant(0.5), wp.constant(0.03)
"""Fraction of directions around the lights, bounded by `light_share`. With the field, only blocked light is left to
find there, so it is the second number at vertices where no light was found to be blocked."""
NEAR_SHARE = wp.constant(0.5)
"""Fraction of first scatterings drawn near the lights, where objects light the water and shade it."""


@dataclass(frozen=True)
class PathSpec:
    """What a path kernel is compiled for; features that a scene lacks cost nothing."""

    medium: bool = True
    """The water scatters."""
    direct: bool = True
    single: bool = True
    multiple: bool = True
    """Which layers are wanted."""
    instances: bool = False
    """There are instances."""
    textures: bool = True
    """Some material is more than one constant reflectance."""
    surfaces: bool = True
    """There are surfaces."""
    field: bool = False
    """The field of open water is known."""
    camera_field: bool = False
    """It is also known along this camera's rays."""

    def apart(self) -> list["PathSpec"]:
        """Two kernels for the same image: the layers of the camera's own segments, and those of subpaths.

        Both trace the same camera rays wherever single scattering is wanted or no light is in view. On a GPU the
        threads of the first run in step through the quadrature of single scattering in open water, which takes ten
        times as long in one kernel with subpaths: a third of the time in the paper's water.
        """
        parts = [replace(self, multiple=False), replace(self, direct=False, single=False)]
        return [spec for spec in parts if spec.direct or spec.single or spec.multiple]


@wp.struct
class PathBounds:
    """Bounds on paths."""

    scatterings: int
    bounces: int
    """The largest number of each."""


@wp.func(inline=False)
def draw(key: wp.uint32, pixel: int, sample: int, group: int):
    """Four numbers in [0, 1): two pairs of a Sobol sequence, or independent numbers far down a path.

    Even and odd samples have sequences of their own.
    """
    half = half_key(key, sample & 1)
    if group % IN_WATER < LOW_DIMENSIONS:
        return sobol4(half, pixel, sample >> 1, 2 * group)
    return uniforms(half, pixel, sample >> 1, group)


@wp.func(inline=False)
def scattered_by_lights(scene: SceneData, o: wp.vec3, d: wp.vec3, t: float):
    """Single scattering of all lights along an unobstructed ray up to ``t``, by quadrature."""
    L = wp.vec3(0.0)
    for i in range(light_count(scene.lights)):
        L += single_scattering(scene.medium, get_light(scene.lights, i), o, d, t)
    return L


@wp.func
def camera_segment(ray: Ray):
    """The camera's own segment as the first of a path."""
    path = Subpath()
    path.alive = 1
    path.vertex = water_vertex(ray.o, ray.d)
    path.throughput = wp.vec3(1.0)
    return path


@wp.func
def start_in_water(scene: SceneData, eye: Vertex, t_max: float, reach: float, u: float, v: float):
    """Subpath that starts with a scattering on the camera's segment, of length ``t_max`` from ``eye``."""
    near = light_distance(scene, eye.p)
    t = sample_first_scattering(scene.medium, near, NEAR_SHARE, t_max, u, v)
    pdf = first_scattering_pdf(scene.medium, near, NEAR_SHARE, t_max, t)
    return subpath_from_water(scene, eye.p, eye.d, t, pdf, reach)


@cache
def make_path_kernel(spec: PathSpec) -> wp.Kernel:
    """Path tracing of a film's parts from ``first`` on, specialised to ``spec``.

    One loop handles the segments of camera and subpaths, and one part after another, so that the threads of a GPU's
    warp trace rays together whatever their paths are doing (path regeneration, Novak et al. 2010; persistent threads,
    Aila and Laine 2009).
    """
    first_hit, visible = make_rays(spec.instances)
    hit_surface = make_hit_surface(spec.textures)
    camera_scatters = spec.medium and (spec.single or spec.multiple)
    shadow_probes = spec.direct or (spec.field and spec.multiple)  # subpaths use what the camera's probes find

    @wp.func
    def carries_all(path: Subpath):
        """Whether the segment from the subpath's vertex carries all light, not the difference from open water."""
        if wp.static(spec.field):
            return is_metal(path.vertex)
        return True

    @wp.func
    def image_place(scene: SceneData, camera: Camera, part: PixelPart, u: wp.vec4):
        """Image point of a sample and its weight."""
        if wp.static(camera_scatters and not spec.camera_field):
            return sample_pixel(scene, camera, part.row, part.col, u)
        return wp.vec3(float(part.col) + u[0], float(part.row) + u[1], 1.0)

    @wp.func
    def virtual_light(scene: SceneData, lights: wp.array(dtype=VirtualLight), path: Subpath, half: int, u: wp.vec2):
        """Light of virtual point lights at a subpath's vertex."""
        found = gather_virtual_light(scene, lights, path.vertex, half, u)
        if brightest(found.L) > 0.0:
            if visible(scene, path.vertex.p, found.p):
                return wp.cw_mul(path.throughput, found.L)
        return wp.vec3(0.0)

    @wp.func
    def share_around_lights(scene: SceneData, path: Subpath, whole: bool):
        """Fraction of directions around the lights at a subpath's vertex."""
        share = light_share(path, MOST_AROUND)
        if wp.static(spec.field):
            if path.vertex.shadowed == 0:
                share = light_share(path, LEAST_AROUND)
        if wp.static(spec.field and spec.textures):
            if whole:
                share = 0.5 * lobe_reaches_lights(scene, path.vertex)
        return share

    @wp.func
    def end_vertex(scene: SceneData, hit: Hit, d: wp.vec3, angle: float):
        """The vertex at the end of a segment along ``d``, whose ray stands for a cone of ``angle``."""
        n = shading_normal(scene, hit)
        return surface_vertex(hit, d, n, hit_surface(scene, hit, n, footprint_width(angle, hit.t, d, hit.n)))

    @wp.func
    def scattered_once(scene: SceneData, o: wp.vec3, d: wp.vec3, t: float, whole: bool, u: wp.vec4):
        """Light scattered once into a segment; unless ``whole``, minus that of open water."""
        L = wp.vec3(0.0)
        scattered = sample_in_scattered(scene, o, d, t, u[0], u[1])
        if brightest(scattered.L) > 0.0:
            if visible(scene, scattered.p, scattered.q):
                L = scattered.L
            if not whole:
                L -= scattered.L
        return L

    @wp.func
    def reflected_once(scene: SceneData, hit: Hit, end: Vertex, u: float, v: wp.vec2):
        """Direct light that the surface at the end of a segment reflects into it, at that end."""
        reflected = sample_reflected(scene, hit, end, u, v)
        if brightest(reflected.L) > 0.0:
            if not visible(scene, reflected.p, reflected.q):
                reflected.L = wp.vec3(0.0)
                reflected.blocked = 1
        return reflected

    @wp.func
    def beside_virtual_lights(scene: SceneData, before: Vertex, d: wp.vec3, hit: Hit, light: int):
        """Weight of direct light found by a segment along ``d``, given that virtual point lights find it too."""
        if is_metal(before) or may_have_lobe(scene, hit):
            return 1.0
        return found_weight(scene, own_lobe_pdf(scene, before, d), d, hit.t, light, hit.p, hit.n)

    @wp.func
    def field_behind(scene: SceneData, field: Field, hit: Hit, d: wp.vec3, u: wp.vec4):
        """Estimate of the scattered light of open water that would come from behind a surface, F(q, d)."""
        once = sample_in_scattered(scene, hit.p, d, FAR, u[0], u[1])
        return once.L + sample_field(scene, field, hit.p, d, FAR, u[2], u[3])

    @wp.kernel(**LONG_KERNEL)
    def trace_paths(
        scene: SceneData,
        camera: Camera,
        first: int,
        field: Field,
        virtual_lights: wp.array(dtype=VirtualLight),
        bounds: PathBounds,
        key: wp.uint32,
        # out
        film: Film,
    ):
        i = first + wp.tid()
        parts = film.parts.shape[0]
        part = film.parts[i]
        height, width = film.sums.shape[1], film.sums.shape[2]
        pixel = part.row * width + part.col
        sample = part.begin
        sums = Sums()
        black = wp.vec3(0.0)
        L_direct = black
        L_single = black
        L_field = black
        L_paths = black
        correction = black
        on_camera = bool(True)
        whole = bool(True)
        group = int(0)
        place = wp.vec3(0.0)
        path = Subpath()
        before = Vertex()
        eye = Vertex()
        eye_t = float(0.0)
        reach = float(0.0)
        waits = bool(False)
        while i < parts:
            # a segment: through the pixel, or from a vertex, which virtual point lights also light
            if on_camera:
                u = draw(key, pixel, sample, 0)
                place = image_place(scene, camera, part, u)
                path = camera_segment(camera_ray(camera, place[0], place[1], wp.vec2(u[2], u[3])))
                group = 1
            else:
                u = draw(key, pixel, sample, group)
                v = draw(key, pixel, sample, group + 1)
                group += 2
                whole = carries_all(path)
                before = path.vertex
                if wp.static(spec.surfaces):
                    if path.bounces < bounds.bounces and not is_metal(before):
                        L_paths += virtual_light(scene, virtual_lights, path, sample & 1, wp.vec2(v[2], v[3]))
                share = float(0.0)
                if wp.static(spec.medium):
                    if path.scatterings < bounds.scatterings:
                        share = share_around_lights(scene, path, whole)
                path = sample_direction(scene, path, share, u, v)

            if path.alive == 1:
                o, d = path.vertex.p, path.vertex.d
                hit = first_hit(scene, o, d)
                T = transmittance(scene.medium, hit.t)
                u = draw(key, pixel, sample, group)
                v = draw(key, pixel, sample, group + 1)
                w = wp.vec4(0.0)
                if wp.static(spec.field):
                    w = draw(key, pixel, sample, group + 2)
                group += 3

                # light of one more event: scattered on the segment, or reflected at its end
                L_water = wp.vec3(0.0)
                if wp.static(camera_scatters):
                    if path.scatterings < bounds.scatterings and (wp.static(spec.single) or not on_camera):
                        all_of_it = wp.static(not spec.field) or (whole and not on_camera)
                        L_water = scattered_once(scene, o, d, hit.t, all_of_it, u)
                L_surface = wp.vec3(0.0)
                end = Vertex()
                if hit.face >= 0:
                    end = end_vertex(scene, hit, d, wp.where(on_camera, camera.pixel_angle, SUBPATH_ANGLE))
                    if path.bounces < bounds.bounces and (wp.static(shadow_probes) or not on_camera):
                        reflected = reflected_once(scene, hit, end, u[2], wp.vec2(u[3], v[3]))
                        end.shadowed = reflected.blocked
                        L_surface = wp.cw_mul(T, reflected.L)
                        if not on_camera and brightest(L_surface) > 0.0:
                            L_surface *= beside_virtual_lights(scene, before, d, hit, reflected.light)
                    if wp.static(spec.field and spec.multiple):
                        if path.bounces < bounds.bounces:
                            L_reflected = wp.cw_mul(T, reflected_field(scene, field, end.surface, end.p, end.n))
                            if on_camera:
                                L_field += L_reflected
                            else:
                                L_surface += L_reflected
                        if not on_camera and not whole:
                            L_surface -= wp.cw_mul(T, field_behind(scene, field, hit, d, w))

                # the next vertex
                if on_camera:
                    if wp.static(spec.direct):
                        L_direct = L_surface
                    L_single = L_water
                    if wp.static(spec.field):
                        correction = L_water
                        if wp.static(spec.single):
                            L_single += scattered_by_lights(scene, o, d, hit.t)
                        if wp.static(spec.multiple and spec.camera_field):
                            x, y = place[0] / float(width), place[1] / float(height)
                            L_field += multiple_in_scattering(field, x, y, hit.t)
                        if wp.static(spec.multiple and not spec.camera_field):
                            L_paths += sample_field(scene, field, o, d, hit.t, w[1], w[2])
                    # one subpath starts at the surface, then another in the water
                    on_camera = False
                    eye = path.vertex
                    eye_t = hit.t
                    path.alive = 0
                    if wp.static(spec.multiple and (spec.surfaces or not spec.field)):
                        reach = light_reach(scene, hit)
                        waits = bounds.scatterings > 0
                        if hit.face >= 0 and bounds.bounces > 0:
                            path = subpath_from_surface(scene, end, hit.t, reach)
                else:
                    if wp.static(spec.field and spec.medium):
                        if whole:
                            L_water += sample_field(scene, field, o, d, hit.t, w[0], w[1])
                    L_paths += wp.cw_mul(path.throughput, L_water + L_surface)
                    path = advance(scene, path, hit, end, bounds.scatterings, bounds.bounces, v)

            if path.alive == 0 and waits:
                u = draw(key, pixel, sample, IN_WATER)
                path = start_in_water(scene, eye, eye_t, reach, u[0], u[1])
                waits = False
                group = IN_WATER + 1
            if path.alive == 0:
                # the sample is complete: continue with the next one, or the next part
                weight = place[2]
                sums = add_sample(sums, sample, weight * L_direct, weight * L_single, weight * (L_field + L_paths),
                                  weight * (correction + L_paths))
                L_field = black
                L_paths = black
                correction = black
                on_camera = True
                sample += 1
                if sample == part.end:
                    store(film, i, sums)
                    i = next_part(film)
                    if i < parts:
                        part = film.parts[i]
                        pixel = part.row * width + part.col
                        sample = part.begin
                        sums = Sums()

    return trace_paths
