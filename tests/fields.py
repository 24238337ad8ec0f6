"""A field of fewer nodes, for tests of other things, and the kernel by which tests read a field."""

import warp as wp

from varos_warp.kernels.field.open_water import LightField, scattered_irradiance, source_function
from varos_warp.kernels.world.lights.record import Light
from varos_warp.render.field import along_camera, solver
from varos_warp.render.field.directions import Directions

SMALL_FIELD = {
    "FINE": (44, 14, 32),
    "MIDDLE": (20, 8, 10),
    "COARSE": (16, 7, 8),
    "ONCE": Directions.quadrature(56, 20, power=2),
    "TWICE": Directions.quadrature(20, 10, power=2),
    "AGAIN": Directions.quadrature(16, 6, power=2),
    "LEAVING": Directions.ends(40, 13, power=2),
}
"""By the names of varos_warp.render.field.solver: solved in two seconds, not ten, and right to a hundredth of the light
(2 % at the edges of cones)."""

TINY_FIELD = SMALL_FIELD | {"FINE": (20, 4, 6), "MIDDLE": (12, 3, 4), "COARSE": (12, 3, 4)}
"""Next to no nodes, for tests to which any field will do; products of matrices stay as large as those of the small."""


FEW_POINTS = 1 << 8
"""Where any field will do, tables along rays are compared at so few points; at all, disks take seconds a renderer."""


def with_fewer_nodes(monkeypatch, nodes=SMALL_FIELD):
    """Fields are solved with these nodes from now on."""
    for name, value in nodes.items():
        monkeypatch.setattr(solver, name, value)
    if nodes is TINY_FIELD:
        monkeypatch.setattr(along_camera, "POINTS", FEW_POINTS)


@wp.kernel(enable_backward=False)
def look_up(
    fields: wp.array(dtype=LightField),
    lights: wp.array(dtype=Light),
    p: wp.array(dtype=wp.vec3),
    d: wp.array(dtype=wp.vec3),
    E: wp.array(dtype=wp.vec3),
    S: wp.array(dtype=wp.vec3),
):
    """Irradiance of planes with normals d at p, and what rays along d receive there, of the first light."""
    i = wp.tid()
    E[i] = scattered_irradiance(fields[0], lights[0], p[i], d[i])
    S[i] = source_function(fields[0], lights[0], p[i], d[i])
