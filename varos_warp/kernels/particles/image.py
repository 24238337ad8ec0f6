"""Find where a camera sees a small body: the inverse of world/camera.py, through any lens and port.

Rays of image points are all that a lens and a port are known by, so their inverse is found by Newton's method, from
the place that a table has for the direction. Its last step also tells how large a pixel is there.
"""

from functools import cache

import warp as wp

from varos_warp.kernels.numerics import bilinear, brightest
from varos_warp.kernels.transport.moments import Moments
from varos_warp.kernels.world.camera import Camera, image_point, make_ray
from varos_warp.kernels.world.optics import OpticsSpec

wp.set_module_options({"enable_backward": False})

STEPS = wp.constant(4)
"""Steps of Newton's method: the table is right to some pixels, and each step squares the error."""
SETTLED_PX = wp.constant(0.02)
"""A point is not seen where the last step was longer [pixels]."""
PROBE_PX = wp.constant(0.5)
"""Distance of the image points whose rays tell how an image point moves [pixels]."""
BEHIND = wp.constant(1.0e-4)
"""Points of less depth are not seen by a camera without lens and port [m]."""


@wp.struct
class Image:
    """The image of a point."""

    seen: int
    x: float
    y: float
    """Image point [pixels]."""
    t: float
    """Distance along its ray in the water [m]."""
    d: wp.vec3
    """Direction of the ray, from the camera on."""
    area: float
    """Area across the ray, at the point, that a pixel sees [m^2]."""
    blur: float
    """Radius of the disc of defocus [pixels]."""
    weight: wp.vec3
    """Radiance at the sensor over that in the water."""


@wp.struct
class Directions:
    """Image points by direction, for lenses and ports: where Newton's method starts."""

    points: wp.array2d(dtype=wp.vec2)
    """Image points of directions; the angle to the axis goes with the distance from the table's middle. Empty for
    cameras without lens and port."""
    half_angle: float
    """Angle to the axis at the middles of the sides [rad]."""


@wp.func
def in_plane(o: wp.vec3, d: wp.vec3, p: wp.vec3, n: wp.vec3):
    """Find where a ray meets the plane through ``p`` with normal ``n``, from p."""
    return o + wp.dot(p - o, n) / wp.dot(d, n) * d - p


@wp.func
def straight_image(camera: Camera, table: Directions, p: wp.vec3, channel: int):
    """`Image` of a point for a pinhole or a thin lens, in closed form."""
    image = Image()
    at = image_point(camera, p, wp.vec2(0.0, 0.0))
    v = p - camera.position
    z = at[2]
    if z > BEHIND:
        image.seen = 1
        image.x = at[0]
        image.y = at[1]
        image.t = wp.length(v)
        image.d = v / image.t
        image.area = z * z * z / (image.t * camera.fx * camera.fy)
        image.blur = camera.fx * camera.aperture * wp.abs(1.0 / camera.focus - 1.0 / z)
        image.weight = wp.vec3(1.0)
    return image


@wp.func
def first_guess(camera: Camera, table: Directions, p: wp.vec3):
    """Image point that the table has for the direction of a point from the lens."""
    v = p - camera.position
    x, y, z = wp.dot(v, camera.right), wp.dot(v, camera.down), wp.dot(v, camera.forward)
    across = wp.sqrt(x * x + y * y)
    share = wp.atan2(across, z) / (table.half_angle * wp.max(across, 1.0e-12))
    nodes = float(table.points.shape[0] - 1)
    row = wp.clamp(0.5 * (1.0 + share * y) * nodes, 0.0, nodes - 1.0e-3)
    col = wp.clamp(0.5 * (1.0 + share * x) * nodes, 0.0, nodes - 1.0e-3)
    return bilinear(table.points, row, col)


@cache
def make_image_of(spec: OpticsSpec) -> wp.Function:
    """The function ``image_of(camera, table, p, channel)``: the `Image` of a point."""
    if not spec.bends:
        return straight_image
    ray_of = make_ray(spec)

    @wp.func
    def step_to(camera: Camera, x: float, y: float, p: wp.vec3, channel: int):
        """How an image point has to move for its ray to pass ``p``, the `Image` there, and whether there is a ray."""
        image = Image()
        centre = wp.vec2(0.0, 0.0)
        ray, weight = ray_of(camera, x, y, centre, channel)
        right, seen_right = ray_of(camera, x + PROBE_PX, y, centre, channel)
        below, seen_below = ray_of(camera, x, y + PROBE_PX, centre, channel)
        off = in_plane(ray.o, ray.d, p, ray.d)
        ex = (in_plane(right.o, right.d, p, ray.d) - off) / PROBE_PX
        ey = (in_plane(below.o, below.d, p, ray.d) - off) / PROBE_PX
        image.area = wp.length(wp.cross(ex, ey))
        xx, xy, yy = wp.dot(ex, ex), wp.dot(ex, ey), wp.dot(ey, ey)
        det = xx * yy - xy * xy
        image.t = wp.dot(p - ray.o, ray.d)
        image.d = ray.d
        image.weight = weight
        bright = wp.min(brightest(weight), wp.min(brightest(seen_right), brightest(seen_below)))
        image.seen = int(bright > 0.0 and det > 0.0 and image.t > 0.0)
        a, b = -wp.dot(off, ex), -wp.dot(off, ey)
        return wp.vec2(a * yy - b * xy, b * xx - a * xy) / wp.max(det, 1.0e-30), image

    @wp.func
    def bent_image(camera: Camera, table: Directions, p: wp.vec3, channel: int):
        at = first_guess(camera, table, p)
        image = Image()
        move = wp.vec2(0.0)
        for _ in range(STEPS):
            move, image = step_to(camera, at[0], at[1], p, channel)
            at += move
        image.x = at[0]
        image.y = at[1]
        if wp.length(move) > SETTLED_PX:
            image.seen = 0
        if camera.aperture > 0.0:
            # the edge of the lens sees the point beside its image
            edge, _seen = ray_of(camera, at[0], at[1], wp.vec2(1.0, 0.0), channel)
            centre, _weight = ray_of(camera, at[0], at[1], wp.vec2(0.0, 0.0), channel)
            off = in_plane(edge.o, edge.d, p, image.d) - in_plane(centre.o, centre.d, p, image.d)
            image.blur = wp.length(off) / wp.sqrt(wp.max(image.area, 1.0e-30))
        return image

    return bent_image


@wp.func
def mixed_camera(before: Camera, after: Camera, share: float):
    """The camera at a share of the way between two of its poses."""
    camera = before  # a copy: what is read of an array would be written there
    camera.position = wp.lerp(before.position, after.position, share)
    camera.right = wp.normalize(wp.lerp(before.right, after.right, share))
    camera.down = wp.normalize(wp.lerp(before.down, after.down, share))
    camera.forward = wp.normalize(wp.lerp(before.forward, after.forward, share))
    return camera


@wp.func
def camera_between(moments: Moments, instant: float):
    """The camera at a time in instants from the beginning of the first, linear between their middles."""
    last = moments.cameras.shape[0] - 1
    if last == 0:
        return moments.cameras[0]
    at = wp.clamp(instant - 0.5, -0.5, float(last) + 0.5)
    i = wp.clamp(int(at), 0, last - 1)
    return mixed_camera(moments.cameras[i], moments.cameras[i + 1], at - float(i))
