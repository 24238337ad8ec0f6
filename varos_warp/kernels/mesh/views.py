"""How near a course's cameras come to points that they have in view."""

import warp as wp

wp.set_module_options({"enable_backward": False})

SLANT = wp.constant(0.4)
"""Cosine between a surface's normal and the view, below which its relief faces the view anyway."""
BEHIND = wp.constant(-0.3)
"""Below, not even relief does."""


@wp.kernel(module="unique")
def find_nearest_view(
    first_row: int, eyes: wp.array(dtype=wp.vec3), axes: wp.array(dtype=wp.vec3), cosines: wp.array(dtype=wp.float32),
    points: wp.array(dtype=wp.vec3), normals: wp.array(dtype=wp.vec3),  # zero: not known
    # out
    distance: wp.array(dtype=wp.float32),  # from the nearest eye [m]; shape [N]
    seen: wp.array(dtype=wp.float32),  # from the nearest that has the point in its cone [m]; infinite: none has
):
    """How near eyes come to points; what is seen at a slant is as if it were farther away."""
    i = first_row + wp.tid()
    known = wp.length_sq(normals[i]) > 0.0
    nearest = float(wp.inf)
    in_view = float(wp.inf)
    for k in range(eyes.shape[0]):
        way = points[i] - eyes[k]
        d = wp.length(way)
        nearest = wp.min(nearest, d)
        facing = wp.where(known, -wp.dot(way, normals[i]) / wp.max(d, 1.0e-6), 1.0)
        slanted = d / wp.sqrt(wp.max(facing, SLANT))
        if facing > BEHIND and slanted < in_view and wp.dot(way, axes[k]) >= d * cosines[k]:
            in_view = slanted
    distance[i] = nearest
    seen[i] = in_view
