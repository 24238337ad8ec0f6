"""How near a course's cameras come to points that they have in view."""

import warp as wp

wp.set_module_options({"enable_backward": False})

SLANT = wp.constant(0.4)
"""Cosine between a surface's normal and the view, below which its relief faces the view anyway."""
BEHIND = wp.constant(-0.3)
"""Below, not even relief does."""


@wp.kernel(module="unique")
def find_nearest_view(
    first_row: int, eyes: wp.array(dtype=wp.vec3), axes: wp.array(dtype=wp.vec3), halves: wp.array(dtype=wp.float32),
    points: wp.array(dtype=wp.vec3), normals: wp.array(dtype=wp.vec3),  # zero: not known
    radius: wp.array(dtype=wp.float32),  # of balls about the points [m]
    # out
    distance: wp.array(dtype=wp.float32),  # from the nearest eye [m]; shape [N]
    seen: wp.array(dtype=wp.float32),  # from the nearest whose cone meets the ball [m]; infinite: none does
):
    """How near eyes come to balls; what is seen at a slant is as if it were farther away."""
    i = first_row + wp.tid()
    known = wp.length_sq(normals[i]) > 0.0
    nearest = float(wp.inf)
    in_view = float(wp.inf)
    for k in range(eyes.shape[0]):
        way = points[i] - eyes[k]
        d = wp.length(way)
        near = wp.max(d - radius[i], 0.0)
        nearest = wp.min(nearest, near)
        facing = wp.where(known, -wp.dot(way, normals[i]) / wp.max(d, 1.0e-6), 1.0)
        slanted = near / wp.sqrt(wp.max(facing, SLANT))
        if facing > BEHIND and slanted < in_view:
            aside = wp.acos(wp.clamp(wp.dot(way, axes[k]) / wp.max(d, 1.0e-6), -1.0, 1.0))
            if near == 0.0 or aside <= halves[k] + wp.asin(radius[i] / d):
                in_view = slanted
    distance[i] = nearest
    seen[i] = in_view
