"""How near a course's cameras come to points that they have in view."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel(module="unique")
def find_nearest_view(
    first_row: int, eyes: wp.array(dtype=wp.vec3), axes: wp.array(dtype=wp.vec3), cosines: wp.array(dtype=wp.float32),
    points: wp.array(dtype=wp.vec3),
    # out
    distance: wp.array(dtype=wp.float32),  # from the nearest eye [m]; shape [N]
    seen: wp.array(dtype=wp.float32),  # from the nearest that has the point in its cone [m]; infinite: none has
):
    """How near eyes come to points."""
    i = first_row + wp.tid()
    nearest = float(wp.inf)
    in_view = float(wp.inf)
    for k in range(eyes.shape[0]):
        way = points[i] - eyes[k]
        d = wp.length(way)
        nearest = wp.min(nearest, d)
        if d < in_view and wp.dot(way, axes[k]) >= d * cosines[k]:
            in_view = d
    distance[i] = nearest
    seen[i] = in_view
