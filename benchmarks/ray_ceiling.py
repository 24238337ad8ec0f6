"""Cost of rays alone on a device: the queries of a path kernel with nothing around them.

    python -m benchmarks.ray_ceiling SCENE [--device cuda:0] [--resolution 1280x720]

Rays/s of `wp.mesh_query_ray` for camera rays (coherent) and for rays that leave their hits in cosine directions
(incoherent), and of `wp.mesh_query_ray_anyhit` from those hits to the lights.
"""

import argparse
import json
import time

import numpy as np
import warp as wp

from varos_warp.kernels.sampling import sample_cosine, uniforms
from varos_warp.kernels.spec import SceneSpec
from varos_warp.kernels.world.camera import Camera, camera_ray
from varos_warp.kernels.world.intersect import SceneData, make_rays
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.file.load import load_scene
from varos_warp.sim.trajectory import simulate

first_hit = make_rays(SceneSpec()).first_hit


@wp.kernel(enable_backward=False)
def coherent(scene: SceneData, camera: Camera, first_row: int, rays: int, out: wp.array2d(dtype=float)):
    """Rays through a pixel."""
    row, col = wp.tid()
    row += first_row
    total = float(0.0)
    for k in range(rays):
        u = uniforms(wp.uint32(k), row, col, 0)
        ray = camera_ray(camera, float(col) + u[0], float(row) + u[1], wp.vec2(0.0, 0.0))
        query = wp.mesh_query_ray(scene.mesh, ray.o, ray.d, 1.0e9)
        total += query.t
    out[row, col] = total


@wp.kernel(enable_backward=False)
def incoherent(scene: SceneData, camera: Camera, first_row: int, rays: int, out: wp.array2d(dtype=float)):
    """Rays in cosine directions from what a pixel sees."""
    row, col = wp.tid()
    row += first_row
    ray = camera_ray(camera, float(col) + 0.5, float(row) + 0.5, wp.vec2(0.0, 0.0))
    hit = first_hit(scene, ray.o, ray.d)
    total = float(0.0)
    for k in range(rays):
        if hit.face >= 0:
            u = uniforms(wp.uint32(k), row, col, 0)
            query = wp.mesh_query_ray(scene.mesh, hit.start, sample_cosine(hit.n, u[0], u[1]), 1.0e9)
            total += query.t
    out[row, col] = total


@wp.kernel(enable_backward=False)
def to_lamps(scene: SceneData, camera: Camera, first_row: int, rays: int, out: wp.array2d(dtype=float)):
    """Shadow rays from what a pixel sees."""
    row, col = wp.tid()
    row += first_row
    ray = camera_ray(camera, float(col) + 0.5, float(row) + 0.5, wp.vec2(0.0, 0.0))
    hit = first_hit(scene, ray.o, ray.d)
    total = float(0.0)
    for k in range(rays):
        if hit.face >= 0:
            offset = scene.lights[k % scene.lights.shape[0]].position - hit.start
            length = wp.length(offset)
            if wp.mesh_query_ray_anyhit(scene.mesh, hit.start, offset / length, length):
                total += 1.0
    out[row, col] = total


def ceilings(renderer, T_w_v, rays: int = 16) -> dict[str, float]:
    """Rays per second of each kind."""
    view = renderer.scene.vehicle.cameras[0]
    shape = view.resolution[::-1]
    scene = renderer.world.lit(T_w_v)
    camera = renderer.world.camera(view, T_w_v)
    out = wp.zeros(shape, dtype=float, device=renderer.device)
    share_hit = np.isfinite(renderer.render(T_w_v, outputs="D").D.range).mean()
    found = {}
    for kernel in (coherent, incoherent, to_lamps):
        renderer.launcher.rows(kernel, shape, {"scene": scene, "camera": camera, "rays": 1, "out": out})
        wp.synchronize()
        seconds = []
        for _ in range(3):
            start = time.perf_counter()
            renderer.launcher.rows(kernel, shape, {"scene": scene, "camera": camera, "rays": rays, "out": out})
            wp.synchronize()
            seconds.append(time.perf_counter() - start)
        traced = rays * np.prod(shape) * (1.0 if kernel is coherent else share_hit)
        found[kernel.key] = float(traced / np.median(seconds))
    return found


def main():
    """Print the three rates."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene")
    parser.add_argument("--device", default="auto")
    parser.add_argument("--resolution", help="WIDTHxHEIGHT instead of the scene's")
    args = parser.parse_args()
    changes = [] if args.resolution is None else [f"vehicle.cameras.0.resolution=[{args.resolution.replace('x', ',')}]"]
    scene = load_scene(args.scene, changes)
    renderer = FrameRenderer(scene, args.device)
    print(json.dumps(ceilings(renderer, simulate(scene).trajectory.T_w_v(0)), indent=1))


if __name__ == "__main__":
    main()
