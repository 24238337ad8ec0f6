"""Pinhole and thin-lens cameras, OpenCV optical axes."""

import warp as wp

from varos_warp.kernels.sampling import sample_disk

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
