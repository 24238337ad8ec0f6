"""Kernels that fill the tables of kernels/open_water.py: once per kind of lamp, and once per camera with its lamps."""

import warp as wp

from varos_warp.kernels.camera import Camera, camera_ray
from varos_warp.kernels.conventions import FAR
from varos_warp.kernels.gather import gather_in_scattered
from varos_warp.kernels.intersect import SceneData
from varos_warp.kernels.light import brightest
from varos_warp.kernels.medium import transmittance
from varos_warp.kernels.open_water import (
    MOMENTS,
    LampTable,
    irradiance_scale,
    node_angle,
    node_distance,
    radiance_moments,
    single_scattering,
)
from varos_warp.kernels.sampling import from_polar, uniforms
from varos_warp.kernels.walk import (
    Walk,
    drift,
    expected_light,
    first_scattering_pdf,
    lamp_distance,
    lamp_lobes_pdf,
    sample_first_scattering,
    sample_lamp_lobes,
    turn,
    water_vertex,
)

wp.set_module_options({"enable_backward": False})

UP = wp.constant(wp.vec3(0.0, 0.0, 1.0))
"""Axis of a table's lamp, which is at the origin."""


@wp.func
def node_point(table: LampTable, row: int, col: int):
    """Where a node lies."""
    theta = node_angle(table, col)
    return node_distance(table, row) * wp.vec3(wp.sin(theta), 0.0, wp.cos(theta))


@wp.func
def towards(p: wp.vec3, gamma: float, phi: float):
    """Direction at an angle gamma from the one to the lamp, phi from the plane of its axis."""
    z = wp.normalize(-p)
    # of the axis, the part at right angles to z; on the axis itself any will do, as the field is round there
    x = wp.vec3(z[2], 0.0, -z[0])
    return wp.cos(gamma) * z + wp.sin(gamma) * (wp.cos(phi) * x + wp.sin(phi) * wp.cross(z, x))


@wp.kernel(enable_backward=False)
def fill_first_order(
    scene: SceneData,
    table: LampTable,
    steps: int,
    # out
    moments: wp.array3d(dtype=wp.vec3),  # [distance, angle, MOMENTS]
):
    """Moments of light scattered once, by quadrature over directions; they are closer where the lamp is."""
    row, col = wp.tid()
    p = node_point(table, row, col)
    for k in range(MOMENTS):
        moments[row, col, k] = wp.vec3(0.0)
    for i in range(steps):
        s = (float(i) + 0.5) / float(steps)
        gamma = wp.pi * s * s * s
        # the solid angle of a ring, both halves of which are alike
        weight = 2.0 * wp.sin(gamma) * (3.0 * wp.pi * s * s / float(steps)) * (wp.pi / float(steps // 2))
        for j in range(steps // 2):
            phi = wp.pi * (float(j) + 0.5) / float(steps // 2)
            d = towards(p, gamma, phi)
            L = weight * single_scattering(scene, scene.lights[0], p, d, FAR)
            basis = radiance_moments(wp.sin(gamma) * wp.cos(phi), wp.cos(gamma))
            for k in range(MOMENTS):
                moments[row, col, k] += basis[k] * L
    for k in range(MOMENTS):
        scale = irradiance_scale(table, wp.length(p))
        moments[row, col, k] = wp.cw_div(moments[row, col, k], scale)


@wp.func
def open_light(scene: SceneData, start: Walk, key: wp.uint32, pixel: int, sample: int):
    """Light that a walk through open water gathers after its first segment, on which it has its direction already."""
    walk = start
    L = wp.vec3(0.0)
    while walk.alive == 1:
        u = uniforms(key, pixel, sample, walk.dimension)
        v = uniforms(key, pixel, sample, walk.dimension + 1)
        w = uniforms(key, pixel, sample, walk.dimension + 2)
        walk.dimension += 3
        walk = turn(scene, walk, 0.5, u, v)
        if walk.alive == 1:
            scattered = gather_in_scattered(scene, walk.vertex.p, walk.vertex.d, FAR, w[0], w[1])
            L += wp.cw_mul(walk.throughput, scattered.L)
            walk = drift(scene, walk, wp.vec4(w[2], w[3], v[2], 0.0))
    return L


@wp.kernel(enable_backward=False)
def fill_higher_orders(
    scene: SceneData,
    table: LampTable,
    first_sample: int,
    samples: int,
    key: wp.uint32,
    # out
    moments: wp.array4d(dtype=wp.vec3),  # [batch, distance, angle, MOMENTS]
):
    """Moments of light scattered twice or more, by walks from each node: sums over ``samples``, divided by them."""
    batch, row, col = wp.tid()
    p = node_point(table, row, col)
    node = row * moments.shape[2] + col
    z = wp.normalize(-p)
    x = wp.vec3(z[2], 0.0, -z[0])
    for k in range(MOMENTS):
        moments[batch, row, col, k] = wp.vec3(0.0)
    for sample in range(first_sample + batch * samples, first_sample + (batch + 1) * samples):
        u = uniforms(key, node, sample, 0)
        v = uniforms(key, node, sample, 1)
        d = sample_lamp_lobes(scene, p, u)
        if v[0] < 0.25:
            d = from_polar(z, 1.0 - 2.0 * u[2], 2.0 * wp.sqrt(u[2] * (1.0 - u[2])), wp.tau * u[3])
        walk = Walk()
        walk.alive = 1
        walk.dimension = 2
        walk.vertex = water_vertex(p, d)
        walk.throughput = wp.vec3(1.0 / (0.75 * lamp_lobes_pdf(scene, p, d) + 0.25 / (4.0 * wp.pi)))
        walk.expected_at_start = expected_light(scene, walk)
        walk = drift(scene, walk, wp.vec4(v[1], v[2], v[3], 0.0))
        if walk.alive == 1:
            L = open_light(scene, walk, key, node, sample)
            basis = radiance_moments(wp.dot(d, x), wp.dot(d, z))
            for k in range(MOMENTS):
                moments[batch, row, col, k] += basis[k] * L
    scale = irradiance_scale(table, wp.length(p))
    for k in range(MOMENTS):
        moments[batch, row, col, k] = wp.cw_div(moments[batch, row, col, k], float(samples) * scale)


@wp.kernel(enable_backward=False)
def fill_veil(
    scene: SceneData,
    camera: Camera,
    width: float,
    height: float,
    nearest: float,
    log_step: float,
    first_sample: int,
    samples: int,
    key: wp.uint32,
    # out
    veil: wp.array4d(dtype=wp.vec3),  # [batch, distance, row, col]
    squares: wp.array3d(dtype=wp.vec3),  # [batch, row, col]
):
    """Radiance of light scattered twice or more that was scattered last between two distances along a camera's rays.

    ``squares`` are those of the sum over all distances. Both are means over ``samples``.
    """
    batch, row, col = wp.tid()
    x = width * float(col) / float(veil.shape[3] - 1)
    y = height * float(row) / float(veil.shape[2] - 1)
    ray = camera_ray(camera, x, y, wp.vec2(0.0, 0.0))
    near = lamp_distance(scene, ray.o)
    last = veil.shape[1] - 1
    reach = nearest * wp.exp(float(last) * log_step)
    node = row * veil.shape[3] + col
    for k in range(veil.shape[1]):
        veil[batch, k, row, col] = wp.vec3(0.0)
    squares[batch, row, col] = wp.vec3(0.0)
    for sample in range(first_sample + batch * samples, first_sample + (batch + 1) * samples):
        u = uniforms(key, node, sample, 0)
        t = sample_first_scattering(scene.medium, near, reach, u[0], u[1])
        walk = Walk()
        walk.dimension = 1
        walk.vertex = water_vertex(ray.o + t * ray.d, ray.d)
        walk.scatterings = 1
        walk.throughput = wp.cw_mul(scene.medium.sigma_s, transmittance(scene.medium, t))
        walk.throughput /= first_scattering_pdf(scene.medium, near, reach, t)
        walk.alive = wp.where(brightest(walk.throughput) > 0.0, 1, 0)
        walk.expected_at_start = expected_light(scene, walk)
        L = open_light(scene, walk, key, node, sample) / float(samples)
        k = wp.clamp(int(wp.ceil(wp.log(t / nearest) / log_step)), 0, last)
        veil[batch, k, row, col] += L
        squares[batch, row, col] += float(samples) * wp.cw_mul(L, L)
