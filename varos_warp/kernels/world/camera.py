"""Pinhole and thin-lens cameras, OpenCV optical axes; in the water, or in air behind a port (optics.py)."""

from functools import cache

import warp as wp

from varos_warp.kernels.sampler import Sampler
from varos_warp.kernels.sampling import half_key, pcg4d, sample_disk
from varos_warp.kernels.world.optics import Bent, Optics, OpticsSpec, make_behind_port, make_undistorted

wp.set_module_options({"enable_backward": False})


@wp.struct
class Camera:
    """Pose in the local world and intrinsics [pixels], with the centre of the top left pixel at (0.5, 0.5)."""

    position: wp.vec3
    right: wp.vec3
    down: wp.vec3
    forward: wp.vec3
    fx: float
    fy: float
    cx: float
    cy: float
    pixel_angle: float
    """Angle of a pixel [rad]: 1 / fx."""
    aperture: float
    """Radius of the lens [m]; 0 is a pinhole."""
    focus: float
    """Distance of the plane of focus [m]."""
    optics: Optics
    """What else bends its rays, where there is anything: `camera_ray` does not read it."""


@wp.struct
class Ray:
    """Origin and unit direction."""

    o: wp.vec3
    d: wp.vec3


@wp.func
def camera_ray(camera: Camera, x: float, y: float, lens: wp.vec2):
    """Ray through image point (x, y) [pixels] from a point of the lens; ``lens`` uniform in [0, 1)^2.

    All rays of one image point meet in the plane of focus (thin lens).
    """
    px = (x - camera.cx) / camera.fx
    py = (y - camera.cy) / camera.fy
    through = px * camera.right + py * camera.down + camera.forward
    on_lens = camera.aperture * sample_disk(lens[0], lens[1])
    offset = on_lens[0] * camera.right + on_lens[1] * camera.down
    ray = Ray()
    ray.o = camera.position + offset
    ray.d = wp.normalize(camera.focus * through - offset)
    return ray


GREEN = wp.constant(1)
"""Channel whose rays B, C, D, S and T follow."""


@wp.func
def straight_ray(camera: Camera, x: float, y: float, lens: wp.vec2, channel: int):
    """`camera_ray`, whose radiance is that in the water, for `make_ray`."""
    return camera_ray(camera, x, y, lens), wp.vec3(1.0)


@cache
def make_ray(spec: OpticsSpec) -> wp.Function:
    """The function ``ray_of(camera, x, y, lens, channel)`` of a camera with lens and port of ``spec``.

    It returns the ray in the water of one channel, and the radiance at the sensor over that in the water, R, G, B: 1 if
    nothing bends rays, else the transmittance of the port / n^2. If each channel has its own rays, that is three times
    as much for this one and 0 for the others. 0 for all: there is no ray, for the lens or the port ends before.
    """
    if not spec.bends:
        return straight_ray
    undistorted, behind_port = make_undistorted(spec.lens, spec.ends), make_behind_port(spec.port, spec.rim)
    fisheye = spec.lens in ("kannala_brandt", "double_sphere")

    @wp.func
    def in_camera_axes(camera: Camera, x: float, y: float, lens: wp.vec2):
        at = wp.vec2((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy)
        through = undistorted(camera.optics, at)
        ray = Bent()
        ray.T = wp.vec2(1.0)
        if wp.static(spec.ends):
            if wp.dot(through, through) == 0.0:
                ray.T = wp.vec2(0.0)
                through = wp.vec3(0.0, 0.0, 1.0)
        if wp.static(not fisheye):
            on_lens = camera.aperture * sample_disk(lens[0], lens[1])
            ray.o = wp.vec3(on_lens[0], on_lens[1], 0.0)
            through = camera.focus * through - ray.o
        ray.d = wp.normalize(through)
        return ray

    @wp.func
    def radiance_weight(camera: Camera, T: float, channel: int):
        if wp.static(spec.port == "none"):
            return wp.vec3(T)
        n = camera.optics.n_water[channel]
        share = T / (n * n)
        if wp.static(not spec.dispersion):
            return wp.vec3(share)
        weight = wp.vec3(0.0)
        weight[channel] = 3.0 * share
        return weight

    @wp.func
    def bent_ray(camera: Camera, x: float, y: float, lens: wp.vec2, channel: int):
        bent = behind_port(camera.optics, in_camera_axes(camera, x, y, lens), channel)
        ray = Ray()
        ray.o = camera.position + bent.o[0] * camera.right + bent.o[1] * camera.down + bent.o[2] * camera.forward
        ray.d = wp.normalize(bent.d[0] * camera.right + bent.d[1] * camera.down + bent.d[2] * camera.forward)
        return ray, radiance_weight(camera, 0.5 * (bent.T[0] + bent.T[1]), channel)

    return bent_ray


COLOURS = wp.constant(wp.uint32(0xC0105))
"""Tells the random numbers of `channel_of` from others."""


@wp.func
def channel_of(sampler: Sampler):
    """Channel of a sample where each has its own rays: in turn, from a random one on in each half of the samples.

    Six samples, three in each half, have all alike.
    """
    x, _, _, _ = pcg4d(wp.uint32(sampler.pixel), COLOURS, COLOURS, half_key(sampler.key, sampler.sample & 1))
    return int(((x >> wp.uint32(8)) + wp.uint32(sampler.sample >> 1)) % wp.uint32(3))


@cache
def make_sample_ray(spec: OpticsSpec) -> wp.Function:
    """The function ``sample_ray``: that of `make_ray` for a sample, whose channel follows if each has its own rays."""
    ray_of = make_ray(spec)

    @wp.func
    def sample_ray(camera: Camera, x: float, y: float, lens: wp.vec2, sampler: Sampler):
        channel = int(GREEN)
        if wp.static(spec.dispersion):
            channel = channel_of(sampler)
        return ray_of(camera, x, y, lens, channel)

    return sample_ray


@wp.func
def image_point(camera: Camera, p: wp.vec3, lens: wp.vec2):
    """Image point (x, y) [pixels] whose ray from a point of the lens passes ``p``, and the depth of p [m].

    Inverse of `camera_ray`; meaningless unless the depth is positive.
    """
    v = p - camera.position
    z = wp.dot(v, camera.forward)
    on_lens = (1.0 / camera.focus - 1.0 / z) * camera.aperture * sample_disk(lens[0], lens[1])
    x = camera.cx + camera.fx * (wp.dot(v, camera.right) / z + on_lens[0])
    y = camera.cy + camera.fy * (wp.dot(v, camera.down) / z + on_lens[1])
    return wp.vec3(x, y, z)


@wp.func
def node_ray(camera: Camera, size: wp.vec2, row: float, col: float, rows: int, cols: int):
    """Pinhole ray through a node, or a place between nodes, of a grid that spans an image of ``size`` [pixels]."""
    x = size[0] * col / float(cols - 1)
    y = size[1] * row / float(rows - 1)
    return camera_ray(camera, x, y, wp.vec2(0.0, 0.0))
