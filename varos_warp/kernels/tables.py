"""Image A from tables: light in open water, less what surfaces take away, plus what they send.

What lamps send through water without end is smooth, stays with the rig, and is known beforehand (open_water.py). Of
each camera sample remain

    direct  lamp light off the surface at the end of the ray, with a shadow ray;
    single  light scattered once: without obstacles from a table or by quadrature (single_table.py), less the light of
            one sampled point if it is blocked (some samples look, for all);
    glow    light that this surface reflects after it was scattered or reflected before: from the lamps' tables, less
            what is blocked, plus what other surfaces send (residual.py);
    veil    light scattered twice or more, or off a surface and on its way to the camera: from the camera's table for
            open water, and the frame's grid for the rest (veil.py).
"""

from functools import cache

import warp as wp

from varos_warp.kernels.conventions import LONG_KERNEL
from varos_warp.kernels.field.open_water import Tables, veil_radiance
from varos_warp.kernels.film.film import Film, Sums, add_sample, store
from varos_warp.kernels.residual import draw, glow
from varos_warp.kernels.single_table import SingleTable, scattered_once
from varos_warp.kernels.transport.next_event import gather_in_scattered, gather_reflected
from varos_warp.kernels.transport.subpath import surface_vertex
from varos_warp.kernels.veil import VeilGrid, frame_veil
from varos_warp.kernels.world.camera import Camera, camera_ray
from varos_warp.kernels.world.intersect import SceneData, make_hit_surface, make_rays, shading_normal
from varos_warp.kernels.world.light import brightest
from varos_warp.kernels.world.medium import transmittance
from varos_warp.kernels.world.texture import footprint_width

wp.set_module_options({"enable_backward": False})

SHADOWED = wp.constant(4)
"""Of so many samples of a part, one looks what is blocked of the light scattered once, and stands for the others:
shadows in water are faint and soft. Their variance is a hundredth of that of the direct light with few samples, and of
bars across the beams 4 % with 64 (measured); a look for each took a tenth of the kernel's time."""


@cache
def make_tables_kernel(direct: bool, single: bool, multiple: bool, instances: bool, textures: bool) -> wp.Kernel:
    """Rendering of a film's parts with tables; arguments as of reference.make_reference_kernel."""
    first_hit, visible = make_rays(instances)
    hit_surface = make_hit_surface(textures)

    @wp.kernel(**LONG_KERNEL)
    def render_with_tables(
        scene: SceneData,
        camera: Camera,
        first: int,
        tables: Tables,
        once: SingleTable,
        grid: VeilGrid,
        max_bounces: int,
        key: wp.uint32,
        # out
        film: Film,
    ):
        i = first + wp.tid()
        part = film.parts[i]
        row, col = part.row, part.col
        height, width = film.sums.shape[1], film.sums.shape[2]
        pixel = row * width + col
        sums = Sums()
        looks = (part.end - part.begin + SHADOWED - 1) / SHADOWED
        for sample in range(part.begin, part.end):
            u = draw(key, pixel, sample, 0)
            v = draw(key, pixel, sample, 1)
            x = float(col) + u[0]
            y = float(row) + u[1]
            ray = camera_ray(camera, x, y, wp.vec2(u[2], u[3]))
            o = ray.o
            d = ray.d
            hit = first_hit(scene, o, d)
            T = transmittance(scene.medium, hit.t)
            L_direct = wp.vec3(0.0)
            L_single = wp.vec3(0.0)
            L_glow = wp.vec3(0.0)
            L_veil = wp.vec3(0.0)

            if hit.face >= 0 and max_bounces > 0:
                n = shading_normal(scene, hit)
                surface = hit_surface(scene, hit, n, footprint_width(camera.pixel_angle, hit.t, d, hit.n))
                vertex = surface_vertex(hit, d, n, surface)
                if wp.static(direct):
                    reflected = gather_reflected(scene, hit, vertex, v[0])
                    if brightest(reflected.L) > 0.0:
                        if visible(scene, reflected.p, scene.lights[reflected.lamp].position):
                            L_direct = wp.cw_mul(T, reflected.L)
                if wp.static(textures):
                    if surface.metal > 0.0 and film.metal.shape[0] > 0:
                        film.metal[row, col] = 1
                if wp.static(multiple):
                    L_glow = wp.cw_mul(T, glow(scene, tables, vertex))
            if wp.static(single):
                L_single = scattered_once(scene, once, o, d, x / float(width), y / float(height), hit.t)
                if sample - part.begin < looks:  # the first ones: of long parts they are spread evenly
                    scattered = gather_in_scattered(scene, o, d, hit.t, v[1], v[2])
                    if brightest(scattered.L) > 0.0:
                        if not visible(scene, scattered.p, scene.lights[scattered.lamp].position):
                            L_single -= (float(part.end - part.begin) / float(looks)) * scattered.L
            if wp.static(multiple):
                L_veil = veil_radiance(tables, x / float(width), y / float(height), hit.t)
                L_veil += frame_veil(grid, x / float(width), y / float(height), hit.t)
            sums = add_sample(sums, L_direct, L_single, L_glow, L_veil)
        store(film, i, sums)

    return render_with_tables
