"""Light of one of several lamps on a segment of a path, chosen by how much it is without obstacles."""

import warp as wp

from varos_warp.kernels.sampling import Pick, reservoir
from varos_warp.kernels.transport.in_scatter import LampLight, in_scattered, lamp_beam
from varos_warp.kernels.transport.subpath import Vertex, vertex_eval
from varos_warp.kernels.world.intersect import Hit, SceneData
from varos_warp.kernels.world.light import LitInterval, brightest, lit_interval

wp.set_module_options({"enable_backward": False})


@wp.func
def gather_in_scattered(scene: SceneData, o: wp.vec3, d: wp.vec3, t_max: float, u: float, v: float):
    """in_scattered of one lamp, chosen by the integral of 1/d^2 over the interval it lights."""
    total = float(0.0)
    pick = Pick()
    pick.u = u
    pick.index = -1
    lit = LitInterval()
    for i in range(scene.lights.shape[0]):
        candidate = lit_interval(scene.lights[i], o, d, t_max)
        weight = candidate.angle * brightest(scene.lights[i].intensity)
        total += weight
        pick = reservoir(pick, i, weight, total)
        if pick.index == i:
            lit = candidate
    scattered = LampLight()
    if total > 0.0:
        scattered = in_scattered(scene, scene.lights[pick.index], lit, o, d, v)
        scattered.lamp = pick.index
        scattered.L *= total / pick.weight
    return scattered


@wp.func
def gather_reflected(scene: SceneData, hit: Hit, vertex: Vertex, u: float):
    """Light of one lamp reflected at a hit against its ray, chosen by how much that is without obstacles."""
    total = float(0.0)
    pick = Pick()
    pick.u = u
    pick.index = -1
    reflected = LampLight()
    reflected.p = hit.start
    for i in range(scene.lights.shape[0]):
        to_light = wp.normalize(scene.lights[i].position - hit.p)
        L = wp.cw_mul(vertex_eval(scene, vertex, to_light), lamp_beam(scene, scene.lights[i], hit.p))
        weight = brightest(L)
        total += weight
        pick = reservoir(pick, i, weight, total)
        if pick.index == i:
            reflected.L = L
    reflected.lamp = pick.index
    if total > 0.0:
        reflected.L *= total / pick.weight
    return reflected
