"""Subpaths, which carry the light of two or more events in image A, with or without the field of open water.

Every segment of a path gathers the light that reaches it straight from the lights by one more event: a reflection off
the surface at its end, or a scattering on the way. On the camera's own segment these are the layers `direct` and
`single`; where it ends on metal, the next segment counts there too (camera_segment.py). Subpaths carry the rest. A
subpath starts with a reflection at the end of the camera's segment or with a scattering on it, and continues from
vertex to vertex, in the water or on a surface, until roulette ends it. No sample is clamped or dropped.

With the field (kernels/field) paths carry only what surfaces change: D = L - F, the radiance of the scene minus that of
scattered light in open water. Along a segment of length t, from p along d to the surface at q,

    light scattered once counts V - 1: nothing where the light is visible, minus itself where it is blocked;
    at q, direct light and reflectance E_F / pi are added, and F(q, d), which would come from behind, is subtracted;
    D itself continues, scattered in the water or reflected off the surface.

The camera's own segment adds F up to its end. The field does not store its own mirror image in metals, so a segment
that leaves a metal carries L, not D. Of rough surfaces it has what a Lambertian one would reflect, so a segment that
leaves one carries D and a share of F (`field_share`). docs/transport.md derives this, and says why second moments are
finite.
"""

import warp as wp

from varos_warp.kernels.conventions import FAR, in_step, in_step_kernel
from varos_warp.kernels.field.lookup import matte_reflectance, reflected_field, sample_field
from varos_warp.kernels.field.open_water import Field
from varos_warp.kernels.film.film import Film, Sums, add_correction, next_batch, pixel_of, sample_of, store
from varos_warp.kernels.numerics import brightest
from varos_warp.kernels.sampler import draw, make_sampler, next_vertex
from varos_warp.kernels.spec import SceneSpec, specialised
from varos_warp.kernels.transport.moments import Moments, instant_of, place_of, with_points
from varos_warp.kernels.transport.next_event import LightConnection, sample_in_scattered
from varos_warp.kernels.transport.segment import PATH, PathBounds, make_segment
from varos_warp.kernels.transport.subpath import (
    Subpath,
    Vertex,
    advance,
    events,
    first_scattering_pdf,
    is_metal,
    light_distance,
    light_reach,
    light_share,
    sample_direction,
    sample_first_scattering,
    share_from_metal,
    subpath_from_surface,
    subpath_from_water,
    water_vertex,
)
from varos_warp.kernels.transport.virtual_lights import (
    VirtualLight,
    found_weight,
    group_of,
    make_gather_virtual_light,
    may_have_lobe,
)
from varos_warp.kernels.world.bsdf import facing
from varos_warp.kernels.world.camera import Camera, Ray, make_sample_ray
from varos_warp.kernels.world.intersect import Hit, SceneData
from varos_warp.kernels.world.lights.light import get_light, light_direction
from varos_warp.kernels.world.lights.record import Light
from varos_warp.kernels.world.medium import transmittance
from varos_warp.kernels.world.rough_diffuse import rough_diffuse
from varos_warp.kernels.world.texture import SUBPATH_ANGLE

wp.set_module_options({"enable_backward": False})

MOST_AROUND, LEAST_AROUND = wp.constant(0.5), wp.constant(0.06)
"""Fraction of directions around the lights, bounded by `light_share`. With the field, only blocked light is left to
find there, so it is the second number at vertices where no light was found to be blocked. Blocked light that is found
there all the same weighs up to the inverse of the number: a rare negative sample, which a denoiser leaves as a black
pixel. With half the number (0.03), the noise of raw images in eight unlike scenes was 0.92 to 1.16 times as much, the
darkest samples 0.65 to 2.4 times as dark, and the error of denoised images 0.98 to 1.02 times as much (H200)."""
NEAR_SHARE = wp.constant(0.5)
"""Fraction of first scatterings drawn near the lights, where objects light the water and shade it."""
FILM = wp.constant(0)
"""Random numbers for the place in the pixel and on the lens."""
LEAVE = wp.constant(0)
"""Random numbers for the direction from a vertex: two groups."""
CAMERA_END, END = wp.constant(1), wp.constant(2)
"""Random numbers for the direct light at a segment's end, and for light scattered on the way."""
CAMERA_GO_ON, GO_ON = wp.constant(4), wp.constant(3)
"""Random numbers for the next vertex."""
FIELD = wp.constant(4)
"""Random numbers for the field's light on the way and behind the end."""
GROUPS = wp.constant(5)
"""Number of a vertex's groups."""
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


@wp.func
def start_at_camera(ray: Ray, weight: wp.vec3):
    """A path on the camera's segment, without an event as yet; none where the sensor gets nothing of it."""
    path = Subpath()
    path.alive = int(brightest(weight) > 0.0)
    path.vertex = water_vertex(ray.o, ray.d)
    return path


@wp.func
def beside_virtual_lights(scene: SceneData, path: Subpath, hit: Hit, light: int):
    """Weight of direct light that a subpath's segment finds, given that virtual point lights find it too."""
    if is_metal(path.vertex) or may_have_lobe(scene, hit):
        return 1.0
    return found_weight(scene, path.lobe_pdf, path.vertex.d, hit.t, light, hit.p, hit.n)


@wp.func
def is_rough(vertex: Vertex):
    """Whether the vertex lies on a rough surface without a metal's lobe."""
    return vertex.on_surface == 1 and vertex.bsdf.metal <= 0.0 and vertex.bsdf.diffuse_roughness > 0.0


@wp.func
def rough_share(scene: SceneData, path: Subpath, light: int):
    """`field_share` of a segment from a rough surface: what it reflects beyond the Lambertian one of the field."""
    vertex = path.vertex
    to_light = light_direction(get_light(scene.lights, light), vertex.p)
    bsdf = vertex.bsdf
    v = facing(vertex.n, path.viewer)
    counted = matte_reflectance(bsdf, vertex.n, path.viewer, to_light)
    own = rough_diffuse(bsdf.reflectance, bsdf.diffuse_roughness, vertex.n, v, vertex.d)
    return wp.vec3(1.0) - wp.cw_div(counted, wp.max(own, wp.vec3(1.0e-20)))


@specialised("field", "metals", "surfaces", "rough")
def make_field_share(spec: SceneSpec) -> wp.Function:
    """The function ``field_share`` of a path, for scenes with or without a field, metals and rough surfaces."""

    @wp.func
    def field_share(scene: SceneData, path: Subpath, light: int):
        """Share of a light's field F that a path's segment carries beside D.

        Without a field, or from metal, that is all; else none, but from rough surfaces what `reflected_field` lacks.
        """
        share = wp.vec3(wp.static(0.0 if spec.field else 1.0))
        if wp.static(spec.field and spec.mirrors):
            if is_metal(path.vertex):
                share = wp.vec3(1.0)
        if wp.static(spec.field and spec.rough):
            if light >= 0 and is_rough(path.vertex):
                share = rough_share(scene, path, light)
        return share

    return field_share


@specialised(*PATH)
def make_leave_vertex(spec: SceneSpec) -> wp.Function:
    """The function ``leave_vertex`` of a subpath, specialised to ``spec``."""
    visible = make_segment(spec).visible
    gather_virtual_light = make_gather_virtual_light(spec)

    @wp.func
    def virtual_light(scene: SceneData, lights: wp.array(dtype=VirtualLight), path: Subpath, u: wp.vec2):
        """Light of virtual point lights at a subpath's vertex."""
        found = gather_virtual_light(scene, lights, path.vertex, u)
        if brightest(found.L) > 0.0:
            if visible(scene, path.vertex.p, found.p):
                return wp.cw_mul(path.throughput, found.L)
        return wp.vec3(0.0)

    @wp.func
    def share_around_lights(scene: SceneData, path: Subpath):
        """Fraction of directions around the lights at a subpath's vertex."""
        share = light_share(path, MOST_AROUND)
        if wp.static(spec.field):
            if path.vertex.shadowed == 0:
                share = light_share(path, LEAST_AROUND)
        if wp.static(spec.field and spec.mirrors):
            if is_metal(path.vertex):
                share = share_from_metal(scene, path.vertex)
        return share

    @wp.func
    def leave_vertex(
        scene: SceneData,
        lights: wp.array(dtype=VirtualLight),
        path: Subpath,
        bounds: PathBounds,
        u: wp.vec4,
        v: wp.vec4,
    ):
        """The subpath with its next direction, and the light of virtual point lights at the vertex that it leaves."""
        L = wp.vec3(0.0)
        if wp.static(spec.surfaces):
            if path.bounces < bounds.bounces and not is_metal(path.vertex):
                L = virtual_light(scene, lights, path, wp.vec2(v[2], v[3]))
        share = float(0.0)
        if wp.static(spec.medium):
            if path.scatterings < bounds.scatterings:
                share = share_around_lights(scene, path)
        return sample_direction(scene, path, share, u, v), L

    return leave_vertex


@specialised(*PATH)
def make_gather(spec: SceneSpec) -> wp.Function:
    """The function ``gather`` of a subpath, specialised to ``spec``."""
    scattered_once = make_segment(spec).scattered_once
    field_share = make_field_share(spec)

    @wp.func
    def field_behind(scene: SceneData, field: Field, path: Subpath, hit: Hit, u: wp.vec4):
        """Estimate of what a segment does not carry of the field that would come from behind its end, F(q, d)."""
        d = path.vertex.d
        once = sample_in_scattered(scene, hit.p, d, FAR, u[0], u[1])
        more = sample_field(scene, field, hit.p, d, FAR, u[2], u[3])
        L = wp.cw_mul(wp.vec3(1.0) - field_share(scene, path, once.light), once.L)
        return L + wp.cw_mul(wp.vec3(1.0) - field_share(scene, path, more.light), more.L)

    @wp.func
    def gather(
        scene: SceneData,
        field: Field,
        path: Subpath,
        hit: Hit,
        end: Vertex,
        reflected: LightConnection,
        bounds: PathBounds,
        u: wp.vec4,
        w: wp.vec4,
    ):
        """Light of one more event on a subpath's segment: reflected at its end, or scattered on the way."""
        if wp.static(spec.mirrors):
            if events(path) == 1 and is_metal(path.vertex):
                return wp.vec3(0.0)  # the camera's segments have it
        o, d = path.vertex.p, path.vertex.d
        L_end = reflected.L
        if brightest(L_end) > 0.0:
            L_end *= beside_virtual_lights(scene, path, hit, reflected.light)
        if wp.static(spec.field):
            if hit.face >= 0 and path.bounces < bounds.bounces:
                L_end += reflected_field(scene, field, end.bsdf, end.p, end.n, -end.d)
            if hit.face >= 0 and not is_metal(path.vertex):
                L_end -= field_behind(scene, field, path, hit, w)
        L = wp.cw_mul(transmittance(scene.medium, hit.t), L_end)
        if wp.static(spec.medium):
            if path.scatterings < bounds.scatterings:
                once = scattered_once(scene, o, d, hit.t, u[0], u[1])
                L += wp.cw_mul(field_share(scene, path, once.light) - wp.vec3(float(once.blocked)), once.L)
        if wp.static(spec.field and spec.medium):
            carries = is_metal(path.vertex)
            if wp.static(spec.rough):
                carries = carries or is_rough(path.vertex)
            if carries:
                more = sample_field(scene, field, o, d, hit.t, w[0], w[1])
                L += wp.cw_mul(field_share(scene, path, more.light), more.L)
        return wp.cw_mul(path.throughput, L)

    return gather


@specialised(*PATH)
def make_arrive(spec: SceneSpec) -> wp.Function:
    """The function ``arrive`` of a path, specialised to ``spec``."""
    segment = make_segment(spec)
    end_vertex, reflected_once = segment.end_vertex, segment.reflected_once

    @wp.func
    def arrive(scene: SceneData, path: Subpath, hit: Hit, bounds: PathBounds, pixel_angle: float, u: float):
        """The vertex at the end of a path's segment, and the direct light that it reflects into the segment."""
        on_camera = events(path) == 0
        end = Vertex()
        reflected = LightConnection()
        if hit.face >= 0:
            end = end_vertex(scene, hit, path.vertex.d, wp.where(on_camera, pixel_angle, SUBPATH_ANGLE))
            if path.bounces < bounds.bounces and (wp.static(spec.field) or not on_camera):
                reflected = reflected_once(scene, hit, end, u)
                end.shadowed = reflected.blocked
        return end, reflected

    return arrive


@wp.func
def go_on(scene: SceneData, path: Subpath, hit: Hit, end: Vertex, bounds: PathBounds, u: wp.vec4):
    """The path at its next vertex; after the camera's segment, the subpath at its first."""
    if events(path) == 0:
        return start_subpath(scene, path.vertex, hit, end, bounds, u)
    return advance(scene, path, hit, end, bounds.scatterings, bounds.bounces, u)


@specialised(*PATH)
def make_subpath_kernel(spec: SceneSpec) -> wp.Kernel:
    """Subpaths of a film's batches from ``first_row`` on, specialised to ``spec``.

    One loop handles the segments of camera and subpaths, and one batch after another, so that the threads of a GPU's
    warp trace rays together whatever their paths are doing (path regeneration, Novak et al. 2010; persistent threads,
    Aila and Laine 2009).
    """
    segment = make_segment(spec)
    first_hit, film_point = segment.first_hit, segment.film_point
    leave_vertex, arrive, gather = make_leave_vertex(spec), make_arrive(spec), make_gather(spec)
    sample_ray = make_sample_ray(spec.optics)

    @wp.kernel(**in_step_kernel(spec.instances))
    def trace_subpaths(
        scene: SceneData,
        camera: Camera,
        moments: Moments,
        first_row: int,
        field: Field,
        bounds: PathBounds,
        key: wp.uint32,
        virtual_lights: wp.array2d(dtype=VirtualLight),
        # out
        film: Film,
    ):
        i = first_row + wp.tid()
        batch = film.batches[i]
        taken = batch.begin
        sums = Sums()
        L = wp.vec3(0.0)
        weight = wp.vec3(1.0)
        path = Subpath()
        sampler = make_sampler(key, pixel_of(film, batch), sample_of(film, batch, taken))
        group = int(0)
        if wp.static(spec.disks > 0):
            drawn = wp.zeros(shape=wp.static(spec.disks), dtype=Light)
            lights = scene.lights
        while i < film.batches.shape[0]:
            # a ray: from the camera, or on from a subpath's vertex
            in_step()
            on_camera = events(path) == 0
            if on_camera:
                if wp.static(spec.varies):
                    instant = instant_of(moments, batch.row, sampler)
                    scene.lights = moments.lights[instant]
                    scene.moving = moments.moving[instant]
                    camera = moments.cameras[instant]
                    group = group_of(instant, moments, virtual_lights)
                if wp.static(spec.disks > 0):
                    if wp.static(spec.varies):
                        lights = scene.lights
                    scene = with_points(scene, lights, place_of(sampler), drawn)
                u = draw(sampler, FILM)
                point = film_point(scene, camera, batch.row, batch.col, u)
                ray, seen = sample_ray(camera, point.x, point.y, wp.vec2(u[2], u[3]), sampler)
                path = start_at_camera(ray, seen)
                weight = point.weight * seen
            else:
                points = virtual_lights[2 * group + (sampler.sample & 1)]
                path, found = leave_vertex(scene, points, path, bounds, draw(sampler, LEAVE), draw(sampler, LEAVE + 1))
                L += found
            in_step()
            hit = Hit()
            if path.alive == 1:
                hit = first_hit(scene, path.vertex.p, path.vertex.d)

            # the light that reaches its segment by one more event
            in_step()
            u = draw(sampler, wp.where(on_camera, CAMERA_END, END))
            end = Vertex()
            reflected = LightConnection()
            if path.alive == 1:
                end, reflected = arrive(scene, path, hit, bounds, camera.pixel_angle, u[2])
            in_step()
            if path.alive == 1 and not on_camera:
                w = wp.vec4(0.0)
                if wp.static(spec.field):
                    w = draw(sampler, FIELD)
                L += gather(scene, field, path, hit, end, reflected, bounds, u, w)

            # the next vertex; once there is none, the next sample, or the next batch
            in_step()
            if path.alive == 1:
                v = draw(sampler, wp.where(on_camera, CAMERA_GO_ON, GO_ON))
                path = go_on(scene, path, hit, end, bounds, v)
                sampler = next_vertex(sampler, GROUPS)
            if path.alive == 0:
                sums = add_correction(sums, sampler.sample, wp.cw_mul(weight, L))
                L = wp.vec3(0.0)
                path = Subpath()
                taken += 1
                if taken == batch.end:
                    store(film, i, sums)
                    i = next_batch(film)
                    if i < film.batches.shape[0]:
                        batch = film.batches[i]
                        taken = batch.begin
                        sums = Sums()
                sampler = make_sampler(key, pixel_of(film, batch), sample_of(film, batch, taken))

    return trace_subpaths
