"""Scattered light on bodies, from the field of open water.

A surface that reflects after Lambert's law sends E(n) / pi, with the irradiance E on a plane of its normal n. So a
sphere sends, per cross section, 1 / pi times the mean of E(n) over normals that lie around the direction of the view
by their cosine; one that transmits, over those around the opposite. The mean is taken over a few fixed normals, the
same for the bodies and for their expectation, which therefore agree.

Along a camera's rays the expectation is smooth, for nothing blocks the field: it is tabulated.
"""

import warp as wp

from varos_warp.kernels.field.lookup import scattered_irradiance
from varos_warp.kernels.field.open_water import Field
from varos_warp.kernels.numerics import brightest, make_gauss_legendre, trilinear
from varos_warp.kernels.particles.bodies import NEAREST, Particles, drawn_at
from varos_warp.kernels.sampling import sample_cosine
from varos_warp.kernels.spec import SceneSpec, specialised
from varos_warp.kernels.world.camera import GREEN, Camera, make_ray
from varos_warp.kernels.world.intersect import SceneData
from varos_warp.kernels.world.lights.light import get_light, light_count
from varos_warp.kernels.world.medium import transmittance

wp.set_module_options({"enable_backward": False})

NORMALS = wp.constant(4)
STEP_NODES = wp.constant(2)

step_node = make_gauss_legendre(STEP_NODES)


@wp.func
def mean_irradiance(scene: SceneData, field: Field, p: wp.vec3, around: wp.vec3):
    """Mean irradiance [W/m^2] from scattered light on planes whose normals lie around a direction by their cosine."""
    E = wp.vec3(0.0)
    for k in range(NORMALS):
        n = sample_cosine(around, (float(k) + 0.5) / float(NORMALS), 0.375 * float(k))
        for i in range(light_count(scene.lights)):
            E += scattered_irradiance(field.lights[i], get_light(scene.lights, i), p, n)
    return E / float(NORMALS)


@wp.func
def field_on_body(scene: SceneData, field: Field, opacity: float, p: wp.vec3, d: wp.vec3):
    """Light of the field that a white body at ``p`` sends against ``d``, per cross section [W/sr/m^2]."""
    E = wp.vec3(0.0)
    if opacity > 0.0:
        E += opacity * mean_irradiance(scene, field, p, -d)
    if opacity < 1.0:
        E += (1.0 - opacity) * mean_irradiance(scene, field, p, d)
    return E / wp.pi


@wp.func
def table_distance(particles: Particles, k: float, nodes: int):
    """Distance [m] along a ray of a place among the nodes of a table, which are even in the logarithm."""
    return NEAREST * wp.pow(particles.reach / NEAREST, k / float(nodes - 1))


@wp.func
def expected_of_field(table: wp.array3d(dtype=wp.vec3), particles: Particles, x: float, y: float, t: float):
    """Radiance that bodies scatter of the field before ``t``, in the mean; (x, y) in [0, 1]^2 is the image point."""
    nodes = table.shape[0]
    k = wp.log(wp.max(t, NEAREST) / NEAREST) / wp.log(particles.reach / NEAREST) * float(nodes - 1)
    return trilinear(
        table, wp.clamp(k, 0.0, float(nodes - 1) - 1.0e-3), y * float(table.shape[1] - 1), x * float(table.shape[2] - 1)
    )


@specialised("optics")
def make_field_light_kernel(spec: SceneSpec) -> wp.Kernel:
    """The table of `expected_of_field` for a camera, not summed up as yet along the rays."""
    ray_of = make_ray(spec.optics)

    @wp.kernel(module="unique", enable_backward=False)
    def tabulate_field_light(
        scene: SceneData,
        camera: Camera,
        field: Field,
        particles: Particles,
        size: wp.vec2,  # of the image [pixels]
        first_row: int,
        # out
        table: wp.array3d(dtype=wp.vec3),
    ):
        """Radiance in the water, of the step before each distance [distance, row, column]; from edge to edge."""
        tile_row, row, col = wp.tid()
        k = first_row + tile_row
        x = size[0] * float(col) / float(table.shape[2] - 1)
        y = size[1] * float(row) / float(table.shape[1] - 1)
        ray, weight = ray_of(camera, x, y, wp.vec2(0.0, 0.0), GREEN)
        L = wp.vec3(0.0)
        if k > 0 and brightest(weight) > 0.0:
            begin = table_distance(particles, float(k) - 1.0, table.shape[0])
            step = table_distance(particles, float(k), table.shape[0]) - begin
            for j in range(STEP_NODES):
                at = step_node(j)
                t = begin + at[0] * step
                seen = field_on_body(scene, field, particles.opacity, ray.o + t * ray.d, ray.d)
                L += step * at[1] * drawn_at(particles, t) * wp.cw_mul(transmittance(scene.medium, t), seen)
        table[k, row, col] = wp.cw_mul(particles.sigma_s, L)

    return tabulate_field_light


@wp.kernel
def sum_along_rays(table: wp.array3d(dtype=wp.vec3)):
    """Each distance's light, and that of all before, in place of what it has alone."""
    row, col = wp.tid()
    for k in range(1, table.shape[0]):
        table[k, row, col] += table[k - 1, row, col]
