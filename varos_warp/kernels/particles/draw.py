"""Splats from cells: which bodies a camera may see in a frame, how they look, and their light."""

import warp as wp

from varos_warp.kernels.conventions import CPU_FLAGS
from varos_warp.kernels.field.open_water import Field
from varos_warp.kernels.numerics import brightest
from varos_warp.kernels.particles.bodies import (
    FARTHEST_GRAIN,
    Body,
    Cells,
    Grain,
    Particles,
    bodies_in_cell,
    body_of,
    cell_of,
    drawn_of_body,
    ramp,
)
from varos_warp.kernels.particles.disc import edge_of, radius_of
from varos_warp.kernels.particles.field_light import field_on_body
from varos_warp.kernels.particles.floc import Floc, floc_extent, lies_along, looseness, shape_of
from varos_warp.kernels.particles.image import Image, camera_between
from varos_warp.kernels.particles.sighting import Exposure, Sighting, make_sightings
from varos_warp.kernels.particles.splat import (
    LARGEST_PX,
    Splat,
    SplatList,
    list_splat,
    profile_sum,
    tiles_of,
)
from varos_warp.kernels.spec import SceneSpec, specialised
from varos_warp.kernels.transport.next_event import irradiance
from varos_warp.kernels.world.camera import GREEN, Camera
from varos_warp.kernels.world.intersect import Instance, SceneData, make_rays
from varos_warp.kernels.world.lights.disk import sample_point
from varos_warp.kernels.world.lights.light import get_light, light_count, light_sample
from varos_warp.kernels.world.lights.record import Light
from varos_warp.kernels.world.medium import transmittance
from varos_warp.kernels.world.phase import phase_eval

wp.set_module_options({"enable_backward": False})

TUMBLE = wp.constant(0.3)
"""Amplitude by which a body is brighter or darker as it turns; its mean is 1."""


@wp.struct
class Cone:
    """What a camera may see: a cone that holds its images while the shutter is open."""

    apex: wp.vec3
    axis: wp.vec3
    half_angle: float
    slack: float
    """How far points may be off: the camera's and the bodies' ways, and the size of a port [m]."""


@wp.func
def cell_is_seen(cone: Cone, cells: Cells, at: wp.vec3i, reach: float):
    """Return whether some body of a cell may be in the cone."""
    middle = wp.vec3(float(at[0]) + 0.5, float(at[1]) + 0.5, float(at[2]) + 0.5)
    v = cells.corner + cells.side * middle - cone.apex
    away = wp.length(v)
    radius = 0.8661 * cells.side + cone.slack
    if away <= radius:
        return True
    if away - radius > reach:
        return False
    angle = wp.atan2(wp.length(wp.cross(v, cone.axis)), wp.dot(v, cone.axis))
    return angle - wp.asin(radius / away) <= cone.half_angle


@wp.kernel(module="unique", enable_backward=False, module_options={"cpu_compiler_flags": CPU_FLAGS})
def count_bodies(
    cone: Cone,
    particles: Particles,
    cells: Cells,
    first_row: int,
    # out
    counts: wp.array(dtype=int),
):
    """How many bodies cells hold that a camera may see."""
    i = first_row + wp.tid()
    at = cell_of(cells, i)
    counts[i] = 0
    if cell_is_seen(cone, cells, at, wp.min(particles.reach, cells.r_high / particles.least_angle)):
        counts[i] = bodies_in_cell(cells, at)


@wp.func
def body_by_number(cells: Cells, i: int):
    """The i-th body of all cells."""
    cell = wp.lower_bound(cells.ends, i + 1)
    first = int(0)
    if cell > 0:
        first = cells.ends[cell - 1]
    return body_of(cells, cell_of(cells, cell), i - first)


@wp.func
def is_out_of_sight(cone: Cone, particles: Particles, body: Body):
    """Return whether a body is too far away to be drawn, or its disc lies beside all that the camera sees."""
    v = body.p - cone.apex
    away = wp.length(v)
    if body.r < particles.least_angle * (away - cone.slack):
        return True
    angle = wp.atan2(wp.length(wp.cross(v, cone.axis)), wp.dot(v, cone.axis))
    return angle - wp.asin(wp.min((FARTHEST_GRAIN * body.r + cone.slack) / away, 1.0)) > cone.half_angle


@wp.func
def lamp_on_body(scene: SceneData, light: Light, p: wp.vec3, particles: Particles, d: wp.vec3):
    """Light of one lamp that a body at ``p`` sends against ``d``, per cross section, if nothing blocks it."""
    sample = light_sample(light, p)
    share = ramp(sample.distance)
    if share == 0.0:
        return wp.vec3(0.0)
    return share * phase_eval(particles.phase, 1.0 - wp.dot(d, sample.d)) * irradiance(scene.medium, sample)


@wp.func
def floc_of(camera: Camera, particles: Particles, body: Body, image: Image, size: float):
    """How a body lies in an image that is so many pixels large."""
    floc = Floc()
    floc.shape = shape_of(body, particles.grains.shape[0])
    floc.size = size
    floc.blur = image.blur
    right = wp.normalize(camera.right - wp.dot(camera.right, image.d) * image.d)
    floc.across = size * lies_along(particles, body, right)
    floc.down = size * lies_along(particles, body, wp.cross(image.d, right))
    return floc


@wp.func
def loosened(splat: Splat, grains: wp.array2d(dtype=Grain)):
    """A splat whose grains are as far apart as is seen of them."""
    after = splat
    extent = floc_extent(splat.floc, grains)
    loose = looseness(wp.length(extent), splat.floc.blur, wp.length(splat.along))
    after.floc.loose = loose
    after.floc.across *= loose
    after.floc.down *= loose
    after.reach = loose * extent
    return after


def make_splat_of(spec: SceneSpec, half_streak: wp.Function) -> wp.Function:
    """(exposure, particles, body, found, drawn, channel) -> the splat of a body that is seen, without its light."""

    @wp.func
    def splat_of(exposure: Exposure, particles: Particles, body: Body, found: Sighting, drawn: float, channel: int):
        """The splat of a body that is seen, of which so much is drawn, without its light."""
        splat = Splat()
        image = found.image
        size = body.r / wp.sqrt(image.area)
        splat.radius = radius_of(size, image.blur)
        splat.edge = edge_of(size, image.blur)
        splat.x = image.x
        splat.y = image.y
        splat.t = image.t
        splat.along = half_streak(exposure, particles, body, found, channel)
        if splat.radius > LARGEST_PX:
            splat.edge *= LARGEST_PX / splat.radius
            splat.radius = LARGEST_PX
        elif looseness(FARTHEST_GRAIN * size, image.blur, wp.length(splat.along)) > 0.0:
            camera = camera_between(exposure.moments, 0.5 * (found.begin + found.end))
            splat.floc = floc_of(camera, particles, body, image, size)
            splat = loosened(splat, particles.grains)
        reach = splat.radius + 0.5 * splat.edge
        splat.reach += wp.vec2(reach, reach)
        splat.cover = drawn * wp.pi * size * size
        if wp.static(spec.optics.dispersion):
            if channel != GREEN:
                splat.cover = 0.0  # what it hides is hidden once
        return splat

    return splat_of


def make_lit(spec: SceneSpec) -> wp.Function:
    """(scene, field, lights, moving, particles, body, found, splat, drawn) -> the splat with the light of its body."""
    visible = make_rays(spec).visible
    channels = 3 if spec.optics.dispersion else 1

    @wp.func
    def light_of(scene: SceneData, field: Field, particles: Particles, body: Body, found: Sighting):
        """Intensity that a body sends to the camera [W/sr], of all lamps that reach it, and of the field."""
        L = wp.vec3(0.0)
        for i in range(light_count(scene.lights)):
            light = sample_point(get_light(scene.lights, i), wp.vec2(body.u[0], body.u[1]))
            E = lamp_on_body(scene, light, found.p, particles, found.image.d)
            if brightest(E) > 0.0:
                if visible(scene, found.p, light.position):
                    L += E
        if wp.static(spec.field):
            L += field_on_body(scene, field, particles.opacity, found.p, found.image.d)
        bright = 1.0 + TUMBLE * wp.sin(wp.tau * body.u[3] + particles.turn)
        return bright * wp.pi * body.r * body.r * wp.cw_mul(particles.albedo, L)

    @wp.func
    def as_lit(scene: SceneData, lights: wp.array2d(dtype=Light), moving: wp.array2d(dtype=Instance), found: Sighting):
        """The scene with its lamps over a row's exposure, and with what moves in the middle of it."""
        after = scene
        after.lights = lights[wp.min(found.row, lights.shape[0] - 1)]
        if wp.static(spec.instances):
            if moving.shape[0] > 0:
                after.moving = moving[wp.clamp(int(0.5 * (found.begin + found.end)), 0, moving.shape[0] - 1)]
        return after

    @wp.func
    def flux_of(scene: SceneData, field: Field, particles: Particles, body: Body, found: Sighting):
        """Sum over all pixels of the radiance of a body, as the sensor gets it."""
        seen = wp.cw_mul(found.image.weight, transmittance(scene.medium, found.image.t))
        I = light_of(scene, field, particles, body, found)
        return wp.static(1.0 / channels) / found.image.area * wp.cw_mul(seen, I)

    @wp.func
    def lit(
        scene: SceneData,
        field: Field,
        lights: wp.array2d(dtype=Light),
        moving: wp.array2d(dtype=Instance),
        particles: Particles,
        body: Body,
        found: Sighting,
        splat: Splat,
        drawn: float,
    ):
        """A splat with the light of its body."""
        after = splat
        after.flux = drawn * flux_of(as_lit(scene, lights, moving, found), field, particles, body, found)
        if splat.floc.loose == 0.0:
            after.scale = 1.0 / profile_sum(splat)
        return after

    return lit


@specialised("instances", "masks", "optics", "rolling", "field")
def make_draw_kernel(spec: SceneSpec) -> wp.Kernel:
    """Splats of the bodies of cells, counted or written, specialised to ``spec``."""
    sightings = make_sightings(spec)
    sighting_of, parts_of, part_of = sightings.sighting_of, sightings.parts_of, sightings.part_of
    splat_of, lit = make_splat_of(spec, sightings.half_streak), make_lit(spec)
    channels = 3 if spec.optics.dispersion else 1

    @wp.func
    def flow_of(following: Exposure, particles: Particles, body: Body, image: Image, channel: int):
        """Flow to the image of a body in the next frame [pixels]; 0 if that is not known."""
        if following.moments.cameras.shape[0] == 0:
            return wp.vec2(0.0)
        then = sighting_of(following, particles, body, channel).image
        if then.seen * image.seen == 0:
            return wp.vec2(0.0)
        return wp.vec2(then.x - image.x, then.y - image.y)

    @wp.kernel(module="unique", enable_backward=False, module_options={"cpu_compiler_flags": CPU_FLAGS})
    def draw_bodies(
        scene: SceneData,
        field: Field,
        exposure: Exposure,
        following: Exposure,  # of the next frame; no cameras: no flow is asked for
        lights: wp.array2d(dtype=Light),  # mean over the exposure, of each row or once
        cone: Cone,
        particles: Particles,
        cells: Cells,
        first_row: int,
        # out
        listed: SplatList,
    ):
        """Splats of a body, one for each tile that they show in, or how many there are."""
        i = first_row + wp.tid()
        counting = listed.ends.shape[0] == 0
        count = int(0)
        if not counting:
            count = listed.ends[i] - listed.counts[i]
            if listed.counts[i] == 0:
                return
        body = body_by_number(cells, i)
        if not is_out_of_sight(cone, particles, body):
            for k in range(wp.static(channels)):
                channel = wp.where(wp.static(channels == 1), GREEN, k)
                whole = sighting_of(exposure, particles, body, channel)
                parts = parts_of(exposure, particles, body, whole, channel)
                for part in range(parts):
                    found = whole
                    if parts > 1:
                        found = part_of(exposure, particles, body, whole, part, parts, channel)
                    drawn = float(0.0)
                    if found.image.seen == 1:
                        drawn = whole.stretch * drawn_of_body(particles, body.r, found.image.t) / float(parts)
                    if drawn > 0.0:
                        splat = splat_of(exposure, particles, body, found, drawn, channel)
                        box = tiles_of(splat, exposure.width, exposure.height)
                        if counting:
                            count += box[2] * box[3]
                        elif box[2] > 0:
                            splat = lit(
                                scene, field, lights, exposure.moments.moving, particles, body, found, splat, drawn
                            )
                            splat.flow = flow_of(following, particles, body, whole.image, channel)
                            count = list_splat(splat, box, exposure.width, count, listed)
        if counting:
            listed.counts[i] = count

    return draw_bodies
