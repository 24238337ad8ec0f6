"""Projection of a mesh onto a model: nearest points, first hits, signed distances, and one step of a shrinkwrap.

Every kernel takes the number of its first thread, so that a CPU can run one launch as chunks from several threads.
"""

import warp as wp

from varos_warp.kernels.conventions import FAR

wp.set_module_options({"enable_backward": False})

FACING = wp.constant(0.5)
"""Smallest cosine between the direction to the nearest point and the vertex normal; below it the point is on a rim."""

ON_SURFACE = wp.constant(0.02)
"""Fraction of the grid step within which a point counts as on the model, whatever the direction."""

RELAX = wp.constant(0.5)
"""Share of the way to the middle of its neighbours that a vertex goes in a step, within the surface."""

FOLDED = wp.constant(0.2)
"""Smallest cosine between a face's normals before and after a step."""


@wp.kernel(module="unique")
def find_nearest(
    first_row: int,
    mesh: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    reach: float,
    # out
    face: wp.array(dtype=wp.int32),  # -1: none within reach; shape [N]
    place: wp.array(dtype=wp.vec3),  # nearest point of the mesh [m]
):
    """Nearest point of the mesh within reach."""
    i = first_row + wp.tid()
    query = wp.mesh_query_point_no_sign(mesh, points[i], reach)
    face[i] = -1
    if query.result:
        face[i] = query.face
        place[i] = wp.mesh_eval_position(mesh, query.face, query.u, query.v)


@wp.kernel(module="unique")
def find_first_hits(
    first_row: int,
    mesh: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    # out
    face: wp.array(dtype=wp.int32),  # -1: none; shape [N]
    side: wp.array(dtype=wp.float32),  # 1: front, -1: back
):
    """First face on each ray."""
    i = first_row + wp.tid()
    face[i] = -1
    query = wp.mesh_query_ray(mesh, points[i], directions[i], FAR)
    if query.result:
        face[i] = query.face
        side[i] = query.sign


@wp.kernel(module="unique")
def sample_signed_distance(
    first_row: int,
    mesh: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    known: wp.array(dtype=wp.int8),
    threshold: float,
    # out
    value: wp.array(dtype=wp.float32),  # [m], negative inside; shape [N]
):
    """Distance with the given sign; if that is 0, negative where the winding number is above the threshold.

    Winding numbers by Barill et al. (2018), ACM Transactions on Graphics 37(4); they cost ten times a distance.
    """
    i = first_row + wp.tid()
    p = points[i]
    sign = float(known[i])
    if known[i] != wp.int8(0):
        near = wp.mesh_query_point_no_sign(mesh, p, FAR)
        if near.result:
            value[i] = sign * wp.length(wp.mesh_eval_position(mesh, near.face, near.u, near.v) - p)
    else:
        query = wp.mesh_query_point_sign_winding_number(mesh, p, FAR, 2.0, threshold)
        if query.result:
            value[i] = query.sign * wp.length(wp.mesh_eval_position(mesh, query.face, query.u, query.v) - p)


@wp.func
def face_normal(points: wp.array(dtype=wp.vec3), face: wp.vec3i):
    """Normal with twice the area as its length."""
    a = points[face[0]]
    return wp.cross(points[face[1]] - a, points[face[2]] - a)


@wp.func
def ring(
    i: int,
    points: wp.array(dtype=wp.vec3),
    faces: wp.array(dtype=wp.vec3i),
    first: wp.array(dtype=wp.int32),
    incident: wp.array(dtype=wp.int32),
):
    """Area-weighted unit normal of a vertex, and the mean of its neighbours."""
    n = wp.vec3(0.0)
    mean = wp.vec3(0.0)
    p = points[i]
    for k in range(first[i], first[i + 1]):
        face = faces[incident[k]]
        n += face_normal(points, face)
        mean += (points[face[0]] - p) + (points[face[1]] - p) + (points[face[2]] - p)
    return wp.normalize(n), p + mean / wp.max(2.0 * float(first[i + 1] - first[i]), 1.0)


@wp.func
def along_normal(mesh: wp.uint64, p: wp.vec3, d: wp.vec3, n: wp.vec3, reach: float):
    """Signed distance along ``d`` of the nearest surface that faces like ``n``; FAR where there is none."""
    t = float(FAR)
    ahead = wp.mesh_query_ray(mesh, p, d, reach)
    if ahead.result and wp.dot(ahead.normal, n) > 0.0:
        t = ahead.t
    behind = wp.mesh_query_ray(mesh, p, -d, wp.min(reach, wp.abs(t)))
    if behind.result and wp.dot(behind.normal, n) > 0.0:
        t = -behind.t
    return t


@wp.func
def inner_target(mesh: wp.uint64, p: wp.vec3, n: wp.vec3, step: float, reach: float):
    """Target of a vertex on the model (the nearest point, else along n), and whether there is such a point."""
    query = wp.mesh_query_point_no_sign(mesh, p, reach)
    if query.result:
        x = wp.mesh_eval_position(mesh, query.face, query.u, query.v)
        d = wp.length(x - p)
        facing = wp.dot(wp.mesh_eval_face_normal(mesh, query.face), n) > 0.0
        if facing and (d < ON_SURFACE * step or wp.abs(wp.dot(x - p, n)) > FACING * d):
            return x, True
    t = along_normal(mesh, p, n, n, reach)
    return p + t * n, t < 0.5 * FAR


@wp.func
def border_target(mesh: wp.uint64, p: wp.vec3, n: wp.vec3, lock: wp.vec3, step: float, reach: float):
    """Target of a vertex on a side of the region, within that side (along n, else near by), and whether it exists."""
    inside = p - 1.0e-3 * step * lock  # a ray in the model's own rim would miss it
    free = wp.vec3(1.0 - wp.abs(lock[0]), 1.0 - wp.abs(lock[1]), 1.0)
    d = wp.normalize(wp.cw_mul(n, free))
    t = along_normal(mesh, inside, d, n, reach)
    if t < 0.5 * FAR:
        return p + t * d, True
    query = wp.mesh_query_point_no_sign(mesh, p, reach)
    if query.result:
        x = wp.mesh_eval_position(mesh, query.face, query.u, query.v)
        if wp.length(x - p) < ON_SURFACE * step:
            return p + wp.cw_mul(x - p, free), True
    return p, False


@wp.kernel(module="unique")
def move_vertices(
    first_row: int,
    mesh: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    faces: wp.array(dtype=wp.vec3i),
    first: wp.array(dtype=wp.int32),
    incident: wp.array(dtype=wp.int32),  # faces at every vertex, in CSR
    lock: wp.array(dtype=wp.vec3b),  # -1 or 1: on that side of the region, shape [V]
    step: float,  # of the grid [m]; the model is looked for within two of them
    # out
    moved: wp.array(dtype=wp.vec3),
    held: wp.array(dtype=wp.int8),  # 1: on the model
):
    """Spread the vertices evenly over their surface and move them onto the model; over a hole they form a membrane."""
    i = first_row + wp.tid()
    p = points[i]
    reach = 2.0 * step
    n, mean = ring(i, points, faces, first, incident)
    side = wp.vec3(float(lock[i][0]), float(lock[i][1]), 0.0)
    pull = wp.cw_mul(mean - p, wp.vec3(1.0 - wp.abs(side[0]), 1.0 - wp.abs(side[1]), 1.0))
    spread = p + RELAX * (pull - wp.dot(pull, n) * n)
    if wp.dot(side, side) > 0.0:
        spread = p  # its neighbours are all on one side
        target, found = border_target(mesh, spread, n, side, step, reach)
    else:
        target, found = inner_target(mesh, spread, n, step, reach)
    moved[i] = wp.where(found, target, p + RELAX * pull)
    held[i] = wp.where(found, wp.int8(1), wp.int8(0))


@wp.kernel(module="unique")
def undo_folds(
    first_row: int,
    before: wp.array(dtype=wp.vec3),
    moved: wp.array(dtype=wp.vec3),
    faces: wp.array(dtype=wp.vec3i),
    first: wp.array(dtype=wp.int32),
    incident: wp.array(dtype=wp.int32),
    # out
    after: wp.array(dtype=wp.vec3),
):
    """Move a vertex back if the step turned one of its faces over."""
    i = first_row + wp.tid()
    p = moved[i]
    for k in range(first[i], first[i + 1]):
        face = faces[incident[k]]
        old, new = face_normal(before, face), face_normal(moved, face)
        if wp.dot(old, new) < FOLDED * wp.length(old) * wp.length(new):
            p = before[i]
    after[i] = p
