"""What the drawn bodies scatter in the mean: light scattered once, with their share and phase function for the water's.

It is taken out of the image before the bodies are added (Campbell's theorem: it is the expectation of what they add),
along the very rays whose ends tell what hides a body.
"""

import warp as wp

from varos_warp.kernels.conventions import CPU_FLAGS
from varos_warp.kernels.field.along_camera import AlongCamera, distance_along, radiance_along
from varos_warp.kernels.numerics import brightest, make_gauss_legendre
from varos_warp.kernels.particles.bodies import FADE, NEAREST, Particles, covered_before, drawn_at, ramp
from varos_warp.kernels.particles.field_light import expected_of_field
from varos_warp.kernels.sampler import draw, make_sampler
from varos_warp.kernels.spec import SceneSpec, specialised
from varos_warp.kernels.transport.moments import Moments, instant_of, place_of, with_points
from varos_warp.kernels.transport.next_event import sample_in_scattered
from varos_warp.kernels.world.camera import Camera, make_sample_ray, node_ray
from varos_warp.kernels.world.intersect import SceneData, make_rays
from varos_warp.kernels.world.lights.light import get_light, light_core, light_count, light_towards, lit_part
from varos_warp.kernels.world.lights.record import Light, LitInterval
from varos_warp.kernels.world.medium import Medium, transmittance
from varos_warp.kernels.world.phase import phase_eval

wp.set_module_options({"enable_backward": False})

NODES = wp.constant(6)
GROWTH = wp.constant(16.0)
"""Panels of the quadrature end where distances along the ray have grown by so much. With six nodes each the error is
below 1e-4 of a pixel's value in coastal water, and 5e-3 where only 20 cm are in sight (measured)."""
STRETCHES = wp.constant(32)
"""Parts of a ray by which a table is judged: with the panels alone, their own error would count as the table's."""
FILM, SHADOW = wp.constant(0), wp.constant(1)
"""Random numbers for the place in the pixel and on the lens, and for what is blocked."""

node = make_gauss_legendre(NODES)


@wp.func
def earlier(t: float, candidate: float, so_far: float):
    """The nearer of two distances beyond ``t`` where a panel may end."""
    return wp.where(candidate > t + 1.0e-5 and candidate < so_far, candidate, so_far)


@wp.func
def panel_end(lit: LitInterval, core: LitInterval, t: float, end: float):
    """End of a panel that begins at ``t`` along the ray: no later than a kink of the integrand."""
    at = earlier(t, wp.max(GROWTH * t, NEAREST + FADE), end)
    at = earlier(t, NEAREST + FADE, at)
    if core.yb > core.ya:
        at = earlier(t, lit.foot + core.ya, at)
        at = earlier(t, lit.foot + core.yb, at)
    for k in range(2):
        r = NEAREST + float(k) * FADE  # close to a lamp bodies fade out
        if lit.h < r:
            half = wp.sqrt(r * r - lit.h * lit.h)
            at = earlier(t, lit.foot - half, at)
            at = earlier(t, lit.foot + half, at)
    return at


@wp.func
def expected_between(
    scene: SceneData,
    particles: Particles,
    light: Light,
    lit: LitInterval,
    o: wp.vec3,
    d: wp.vec3,
    begin: float,
    end: float,
):
    """Radiance of a panel, by quadrature in the angle under which the lamp sees the ray."""
    L = wp.vec3(0.0)
    ya, yb = begin - lit.foot, end - lit.foot
    start = wp.atan2(ya, lit.h)
    turn = wp.atan2(lit.h * (yb - ya), lit.h * lit.h + ya * yb)
    for k in range(NODES):
        at = node(k)
        y = wp.clamp(lit.h * wp.tan(start + at[0] * turn), ya, yb)
        t = lit.foot + y
        distance = wp.sqrt(lit.h * lit.h + y * y)
        p = o + t * d
        share = at[1] * drawn_at(particles, t) * ramp(distance) * phase_eval(particles.phase, 1.0 + y / distance)
        L += share * wp.cw_mul(light_towards(light, p, distance), transmittance(scene.medium, t + distance))
    return turn / lit.h * wp.cw_mul(particles.sigma_s, L)


@wp.func
def expected_of_lamp(
    scene: SceneData, particles: Particles, light: Light, o: wp.vec3, d: wp.vec3, t_min: float, t_max: float
):
    """Radiance of one lamp that drawn bodies between two distances scatter into an unobstructed ray, in the mean."""
    L = wp.vec3(0.0)
    lit = lit_part(light, o, d, wp.min(t_max, particles.reach))
    core = light_core(light, o, d, t_max)
    t = wp.max(lit.foot + lit.ya, wp.max(t_min, NEAREST))
    last = lit.foot + lit.yb
    while t < last:
        end = panel_end(lit, core, t, last)
        L += expected_between(scene, particles, light, lit, o, d, t, end)
        t = end
    return L


@wp.func
def expected_of_lamps(scene: SceneData, particles: Particles, o: wp.vec3, d: wp.vec3, t_min: float, t_max: float):
    """`expected_of_lamp` of all lamps."""
    L = wp.vec3(0.0)
    for i in range(light_count(scene.lights)):
        L += expected_of_lamp(scene, particles, get_light(scene.lights, i), o, d, t_min, t_max)
    return L


@wp.kernel(enable_backward=False)
def tabulate_expected(
    scene: SceneData,
    camera: Camera,
    size: wp.vec2,
    particles: Particles,
    first_row: int,
    # out
    table: AlongCamera,
):
    """What the lamps' light on bodies adds to a camera's rays up to each distance, in the mean."""
    tile_row, col = wp.tid()
    row = first_row + tile_row
    ray = node_ray(camera, size, float(row), float(col), table.radiance.shape[1], table.radiance.shape[2])
    L = wp.vec3(0.0)
    start = float(0.0)
    for k in range(table.radiance.shape[0]):
        end = distance_along(table, k)
        L += expected_of_lamps(scene, particles, ray.o, ray.d, start, end)
        table.radiance[k, row, col] = L
        start = end


@wp.kernel(enable_backward=False)
def compare_expected(
    scene: SceneData,
    camera: Camera,
    size: wp.vec2,
    particles: Particles,
    table: AlongCamera,
    points: wp.array(dtype=wp.vec3),  # (x, y) in [0, 1]^2, distance [m]
    first_row: int,
    # out
    known: wp.array(dtype=wp.vec3),
    tabulated: wp.array(dtype=wp.vec3),
):
    """Compute what bodies add in the mean at some points, by quadrature of short panels and by look-up."""
    i = first_row + wp.tid()
    point = points[i]
    ray = node_ray(camera, size, point[1], point[0], 2, 2)
    L = wp.vec3(0.0)
    stretch = wp.pow(point[2] / NEAREST, 1.0 / float(STRETCHES))
    start = float(NEAREST)
    stretches = int(STRETCHES)  # a variable, so that the loop is not unrolled
    for _k in range(stretches):
        L += expected_of_lamps(scene, particles, ray.o, ray.d, start, start * stretch)
        start *= stretch
    known[i] = L
    tabulated[i] = radiance_along(table, point[0], point[1], point[2])


@specialised("surfaces", "instances", "masks", "optics", "varies", "disks", "field", "lamps_tabled")
def make_expected_kernel(spec: SceneSpec) -> wp.Kernel:
    """What bodies add in the mean, and where rays end, specialised to ``spec``."""
    rays = make_rays(spec)
    first_hit, visible = rays.first_hit, rays.visible
    sample_ray = make_sample_ray(spec.optics)

    @wp.func
    def blocked(scene: SceneData, particles: Particles, o: wp.vec3, d: wp.vec3, t: float, u: float, v: float):
        """Estimate of what surfaces keep from the bodies."""
        water = Medium()
        water.sigma_s = particles.sigma_s
        water.sigma_t = scene.medium.sigma_t
        water.phase = particles.phase
        scene.medium = water
        scattered = sample_in_scattered(scene, o, d, t, u, v)
        share = drawn_at(particles, wp.dot(scattered.p - o, d)) * ramp(wp.length(scattered.q - scattered.p))
        if share * brightest(scattered.L) > 0.0:
            if not visible(scene, scattered.p, scattered.q):
                return share * scattered.L
        return wp.vec3(0.0)

    @wp.kernel(module="unique", enable_backward=False, module_options={"cpu_compiler_flags": CPU_FLAGS})
    def expect_bodies(
        scene: SceneData,
        camera: Camera,
        moments: Moments,
        particles: wp.array(dtype=Particles),
        of_field: wp.array4d(dtype=wp.vec3),  # tables of `expected_of_field`, [kind, distance, row, column]
        of_lamps: wp.array(dtype=AlongCamera),  # of `expected_of_lamps`, of each kind, if there are tables
        key: wp.uint32,
        first_row: int,
        # out
        hits: wp.array3d(dtype=float),
        expected: wp.array2d(dtype=wp.vec3),
        passed: wp.array2d(dtype=float),
    ):
        """Find ends of pixels' rays [m], [ray, height, width], what bodies add in the mean, 1 / what they let pass."""
        tile_row, col = wp.tid()
        row = first_row + tile_row
        if wp.static(spec.disks > 0):
            drawn = wp.zeros(shape=wp.static(spec.disks), dtype=Light)
            lights = scene.lights
        L = wp.vec3(0.0)
        covered = float(0.0)
        rays = hits.shape[0]
        for k in range(rays):
            sampler = make_sampler(key, row * hits.shape[2] + col, k)
            if wp.static(spec.varies):
                instant = instant_of(moments, row, sampler)
                scene.lights = moments.lights[instant]
                scene.moving = moments.moving[instant]
                camera = moments.cameras[instant]
            if wp.static(spec.disks > 0):
                if wp.static(spec.varies):
                    lights = scene.lights
                scene = with_points(scene, lights, place_of(sampler), drawn)
            u = draw(sampler, FILM)
            x, y = float(col) + u[0], float(row) + u[1]
            across, down = x / float(hits.shape[2]), y / float(hits.shape[1])
            ray, weight = sample_ray(camera, x, y, wp.vec2(u[2], u[3]), sampler)
            hits[k, row, col] = 0.0
            if brightest(weight) > 0.0:
                hit = first_hit(scene, ray.o, ray.d)
                hits[k, row, col] = hit.t
                v = draw(sampler, SHADOW)
                for i in range(particles.shape[0]):
                    if wp.static(spec.lamps_tabled):  # long code costs even where it is not run
                        of_kind = radiance_along(of_lamps[i], across, down, hit.t)
                    else:
                        of_kind = expected_of_lamps(scene, particles[i], ray.o, ray.d, 0.0, hit.t)
                    if wp.static(spec.surfaces):
                        if k == 0:  # what is blocked is little: one ray of a pixel tells enough
                            of_kind -= float(rays) * blocked(scene, particles[i], ray.o, ray.d, hit.t, v[0], v[1])
                    if wp.static(spec.field):
                        of_kind += expected_of_field(of_field[i], particles[i], across, down, hit.t)
                    L += wp.cw_mul(weight, of_kind)
                    covered += covered_before(particles[i], hit.t)
        expected[row, col] = L / float(rays)
        passed[row, col] = wp.exp(covered / float(rays))

    return expect_bodies
