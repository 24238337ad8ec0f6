"""How near a course's cameras come to points that they have in view."""

import warp as wp

wp.set_module_options({"enable_backward": False})

SLANT = wp.constant(0.4)
"""Cosine between a surface's normal and the view, below which its relief faces the view anyway."""
BEHIND = wp.constant(-0.3)
"""Cosine between a surface's normal and the view, below which not even its relief faces the view."""
FARTHER = wp.constant(1.0001)
"""Square of how much farther an eye must be to be passed over, beyond rounding."""
MARGIN = wp.constant(1.0e-4)
"""Difference between cosines within which it takes the angles to tell whether a point is in a cone."""


@wp.func
def cone_edge(cosine: float, sine: float, ball: float):
    """Cosine of the half angle of a cone and of that which a ball is seen under together; -2 beyond half a turn."""
    if ball >= 1.0 or (cosine < 0.0 and ball >= sine):
        return -2.0
    return cosine * wp.sqrt(1.0 - ball * ball) - sine * ball


@wp.func
def is_in_cone(along: float, cone: wp.vec3, ball: float):
    """Return whether a ball that is seen under an angle meets a cone.

    Args:
        along: Cosine of the angle between the axis and the way to the ball's middle.
        cone: Half angle of the cone [rad], its cosine and its sine.
        ball: Sine of half the angle that the ball is seen under.
    """
    edge = cone_edge(cone[1], cone[2], ball)
    if edge > -1.0 and wp.abs(along - edge) > MARGIN:  # as below, without the angles
        return along > edge
    return wp.acos(along) <= cone[0] + wp.asin(ball)


@wp.kernel(module="unique")
def find_nearest_view(
    first_row: int,
    eyes: wp.array(dtype=wp.vec3),
    axes: wp.array(dtype=wp.vec3),
    cones: wp.array(dtype=wp.vec3),  # half angle [rad], its cosine and its sine
    points: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),  # zero: not known
    radius: wp.array(dtype=wp.float32),  # of balls about the points [m]
    # out
    distance: wp.array(dtype=wp.float32),  # from the nearest eye [m]; shape [N]
    seen: wp.array(dtype=wp.float32),  # from the nearest whose cone meets the ball [m]; infinite: none does
):
    """How near eyes come to balls; what is seen at a slant is as if it were farther away."""
    i = first_row + wp.tid()
    point = points[i]
    normal = normals[i]
    ball = radius[i]
    known = wp.length_sq(normal) > 0.0
    nearest = float(wp.inf)
    in_view = float(wp.inf)
    reach = float(wp.inf)
    for k in range(eyes.shape[0]):
        way = point - eyes[k]
        square = wp.length_sq(way)
        if square > reach:  # nearer than what is in view nothing is at a slant, either
            continue
        d = wp.sqrt(square)
        near = wp.max(d - ball, 0.0)
        nearest = wp.min(nearest, near)
        facing = wp.where(known, -wp.dot(way, normal) / wp.max(d, 1.0e-6), 1.0)
        slanted = near / wp.sqrt(wp.max(facing, SLANT))
        if facing > BEHIND and slanted < in_view:
            along = wp.clamp(wp.dot(way, axes[k]) / wp.max(d, 1.0e-6), -1.0, 1.0)
            inside = bool(near == 0.0)
            if not inside:
                inside = is_in_cone(along, cones[k], ball / d)
            if inside:
                in_view = slanted
                reach = FARTHER * (in_view + ball) * (in_view + ball)
    distance[i] = nearest
    seen[i] = in_view
