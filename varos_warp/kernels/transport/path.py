"""Subpaths, which carry the light of two or more events in image A, with or without the field of open water.

Every segment of a path gathers the light that reaches it straight from the lights by one more event: a reflection off
the surface at its end, or a scattering on the way. On the camera's own segment these are the layers `direct` and
`single` (camera_segment.py). Subpaths carry light of more events. A subpath starts with a reflection at the end of the
camera's segment or with a scattering on it, and continues from vertex to vertex, in the water or on a surface, until
roulette ends it. No sample is clamped or dropped.

With the field (kernels/field) paths carry only what surfaces change: D = L - F, the radiance of the scene minus that of
scattered light in open water. Along a segment of length t, from p along d to the surface at q,

    light scattered once counts V - 1: nothing where the light is visible, minus itself where it is blocked;
    at q, direct light and reflectance E_F / pi are added, and F(q, d), which would come from behind, is subtracted;
    D itself continues, scattered in the water or reflected off the surface.

The camera's own segment adds F up to its end. The field does not store its own mirror image in metals, so a segment
that leaves a metal carries L, not D. docs/transport.md derives this, and says why second moments are finite.
"""

from functools import cache

import warp as wp

from varos_warp.kernels.conventions import FAR, LONG_KERNEL
from varos_warp.kernels.field.lookup import reflected_field, sample_field
from varos_warp.kernels.field.open_water import Field
from varos_warp.kernels.film.film import Film, Sums, add_sample, next_part, store
from varos_warp.kernels.numerics import brightest
from varos_warp.kernels.transport.next_event import LightConnection, sample_in_scattered
from varos_warp.kernels.transport.segment import PathBounds, PathSpec, draw, make_segment
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
    water_vertex,
)
from varos_warp.kernels.transport.virtual_lights import VirtualLight, found_weight, gather_virtual_light, may_have_lobe
from varos_warp.kernels.world.camera import Camera, camera_ray
from varos_warp.kernels.world.intersect import Hit, SceneData
from varos_warp.kernels.world.medium import transmittance
from varos_warp.kernels.world.texture import SUBPATH_ANGLE

wp.set_module_options({"enable_backward": False})

MOST_AROUND, LEAST_AROUND = wp.constant(0.5), wp.constant(0.03)
"""Fraction of directions around the lights, bounded by `light_share`. With the field, only blocked light is left to
find there, so it is the second number at vertices where no light was found to be blocked."""
NEAR_SHARE = wp.constant(0.5)
"""Fraction of first scatterings drawn near the lights, where objects light the water and shade it."""
LEAST_CHOSEN = wp.constant(0.25)
"""Least probability of either start of a subpath, in the water or on a surface, where both are possible."""


@wp.func
def start_in_water(scene: SceneData, eye: Vertex, t_max: float, reach: float, u: float, v: float):
    """Subpath that starts with a scattering on the camera's segment, of length ``t_max`` from ``eye``."""
    near = light_distance(scene, eye.p)
    t = sample_first_scattering(scene.medium, near, NEAR_SHARE, t_max, u, v)
    pdf = first_scattering_pdf(scene.medium, near, NEAR_SHARE, t_max, t)
    return subpath_from_water(scene, eye.p, eye.d, t, pdf, reach)


@wp.func
def start_subpath(scene: SceneData, eye: Vertex, hit: Hit, end: Vertex, bounds: PathBounds, u: wp.vec4):
    """Subpath that starts at the end of the camera's segment or in the water on it, chosen by the light to expect."""
    reach = light_reach(scene, hit)
    water = Subpath()
    path = Subpath()
    if bounds.scatterings > 0:
        water = start_in_water(scene, eye, hit.t, reach, u[0], u[1])
    if hit.face >= 0 and bounds.bounces > 0:
        path = subpath_from_surface(scene, end, hit.t, reach)
    share = float(water.alive)
    if water.alive == 1 and path.alive == 1:
        share = water.expected_at_start / (water.expected_at_start + path.expected_at_start)
        share = wp.clamp(share, LEAST_CHOSEN, 1.0 - LEAST_CHOSEN)
    chosen = 1.0 - share
    if u[2] < share:
        path = water
        chosen = share
    path.throughput /= wp.max(chosen, LEAST_CHOSEN)
    path.expected_at_start /= wp.max(chosen, LEAST_CHOSEN)
    return path


@cache
def make_subpath_kernel(spec: PathSpec) -> wp.Kernel:
    """Subpaths of a film's parts from ``first`` on, specialised to ``spec``.

    One loop handles the segments of camera and subpaths, and one part after another, so that the threads of a GPU's
    warp trace rays together whatever their paths are doing (path regeneration, Novak et al. 2010; persistent threads,
    Aila and Laine 2009).
    """
    first_hit, visible, end_vertex, scattered_once, reflected_once, image_place = make_segment(
        spec.instances, spec.textures, spec.medium and not spec.camera_field)

    @wp.func
    def carries_all(path: Subpath):
        """Whether the segment from the subpath's vertex carries all light, not the difference from open water."""
        if wp.static(spec.field):
            return is_metal(path.vertex)
        return True

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
    def trace_subpaths(
        scene: SceneData,
        camera: Camera,
        first: int,
        field: Field,
        bounds: PathBounds,
        key: wp.uint32,
        virtual_lights: wp.array(dtype=VirtualLight),
        # out
        film: Film,
    ):
        i = first + wp.tid()
        parts = film.parts.shape[0]
        part = film.parts[i]
        width = film.sums.shape[2]
        pixel = part.row * width + part.col
        sample = part.begin
        sums = Sums()
        black = wp.vec3(0.0)
        L = black
        on_camera = bool(True)
        whole = bool(True)
        group = int(0)
        weight = float(1.0)
        path = Subpath()
        before = Vertex()
        while i < parts:
            # a segment: through the pixel, or from a vertex, which virtual point lights also light
            if on_camera:
                u = draw(key, pixel, sample, 0)
                place = image_place(scene, camera, part.row, part.col, u)
                ray = camera_ray(camera, place[0], place[1], wp.vec2(u[2], u[3]))
                weight = place[2]
                path = Subpath()
                path.alive = 1
                path.vertex = water_vertex(ray.o, ray.d)
                group = 1
            else:
                u = draw(key, pixel, sample, group)
                v = draw(key, pixel, sample, group + 1)
                group += 2
                whole = carries_all(path)
                before = path.vertex
                if wp.static(spec.surfaces):
                    if path.bounces < bounds.bounces and not is_metal(before):
                        L += virtual_light(scene, virtual_lights, path, sample & 1, wp.vec2(v[2], v[3]))
                share = float(0.0)
                if wp.static(spec.medium):
                    if path.scatterings < bounds.scatterings:
                        share = share_around_lights(scene, path, whole)
                path = sample_direction(scene, path, share, u, v)

            if path.alive == 1:
                o, d = path.vertex.p, path.vertex.d
                hit = first_hit(scene, o, d)
                u = draw(key, pixel, sample, group)
                v = draw(key, pixel, sample, group + 1)
                w = wp.vec4(0.0)
                if wp.static(spec.field):
                    w = draw(key, pixel, sample, group + 2)
                group += 3
                end = Vertex()
                reflected = LightConnection()
                if hit.face >= 0:
                    end = end_vertex(scene, hit, d, wp.where(on_camera, camera.pixel_angle, SUBPATH_ANGLE))
                    if path.bounces < bounds.bounces and (wp.static(spec.field) or not on_camera):
                        reflected = reflected_once(scene, hit, end, u[2], wp.vec2(u[3], v[3]))
                        end.shadowed = reflected.blocked
                if on_camera:
                    path = start_subpath(scene, path.vertex, hit, end, bounds, draw(key, pixel, sample, group))
                    group += 1
                    on_camera = False
                else:
                    # light of one more event: reflected at the segment's end, or scattered on it
                    L_end = reflected.L
                    if brightest(L_end) > 0.0:
                        L_end *= beside_virtual_lights(scene, before, d, hit, reflected.light)
                    if wp.static(spec.field):
                        if hit.face >= 0 and path.bounces < bounds.bounces:
                            L_end += reflected_field(scene, field, end.surface, end.p, end.n)
                        if hit.face >= 0 and not whole:
                            L_end -= field_behind(scene, field, hit, d, w)
                    L_new = wp.cw_mul(transmittance(scene.medium, hit.t), L_end)
                    if wp.static(spec.medium):
                        if path.scatterings < bounds.scatterings:
                            L_new += scattered_once(scene, o, d, hit.t, whole, u[0], u[1])
                    if wp.static(spec.field and spec.medium):
                        if whole:
                            L_new += sample_field(scene, field, o, d, hit.t, w[0], w[1])
                    L += wp.cw_mul(path.throughput, L_new)
                    path = advance(scene, path, hit, end, bounds.scatterings, bounds.bounces, v)

            if path.alive == 0:
                # the sample is complete: continue with the next one, or the next part
                sums = add_sample(sums, sample, black, black, weight * L, weight * L)
                L = black
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

    return trace_subpaths
