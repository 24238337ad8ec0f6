"""Marine snow in tests: a scene, a body put where a test wants it, and the splats of a frame."""

import numpy as np
import warp as wp

from varos_warp.kernels.particles import bodies
from varos_warp.kernels.particles.bodies import Cells
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.file.load import scene_from_dict

WATER = {
    "coefficients": {
        "sigma_s": [0.2, 0.3, 0.25],
        "sigma_a": [0.3, 0.1, 0.05],
        "phase": {"kind": "henyey_greenstein", "g": 0.5},
    }
}
LAMP = {
    "kind": "spot",
    "position": [0.5, 0.1, 0.3],
    "direction": [-0.1, 1, -0.05],
    "intensity": [100, 80, 60],
    "cone_deg": 90,
    "blend": 0.5,
}
CAMERA = {"id": "M0", "resolution": [96, 54], "sensor_mm": [8, 4.5], "focal_mm": 6}


def snow_scene(camera=None, particles=None, lights=(LAMP,), bodies=True, **changes):
    """Open water with one camera that looks along y, and bodies, on which only lamps shine."""
    return scene_from_dict(
        {
            "seed": 1,
            "water": WATER,
            "particles": [{"share": 0.005} | (particles or {})] if bodies else [],
            "vehicle": {"lights": list(lights), "cameras": [CAMERA | (camera or {})]},
            "trajectory": {"poses": [{"position": [0, 0, 0]}]},
            "render": {"integrator": "path"},
        }
        | changes
    )


@wp.kernel(enable_backward=False)
def list_bodies(
    cells: Cells,
    p: wp.array(dtype=wp.vec3),
    r: wp.array(dtype=float),
    u: wp.array(dtype=wp.vec4),
    counts: wp.array(dtype=int),
):
    """Up to 32 bodies of each cell."""
    i = wp.tid()
    at = bodies.cell_of(cells, i)
    counts[i] = bodies.bodies_in_cell(cells, at)
    for n in range(wp.min(counts[i], 32)):
        body = bodies.body_of(cells, at, n)
        p[32 * i + n] = body.p
        r[32 * i + n] = body.r
        u[32 * i + n] = body.u


def bodies_of(cells):
    """Places, radii and numbers of the bodies of cells."""
    n = int(np.prod(cells.size))
    p, r, u = (wp.zeros(32 * n, dtype=kind, device="cpu") for kind in (wp.vec3, float, wp.vec4))
    counts = wp.zeros(n, dtype=int, device="cpu")
    wp.launch(list_bodies, n, [cells], [p, r, u, counts], device="cpu")
    there = (np.arange(32) < counts.numpy()[:, None]).ravel()
    return tuple(array.numpy()[there] for array in (p, r, u))


def lone_cell(place, radius):
    """A cell of a micrometre that holds one body, of a place and radius, and its numbers."""
    for key in range(1, 100):
        cells = Cells()
        cells.base, cells.size, cells.corner = wp.vec3ui(0, 0, 0), wp.vec3i(1, 1, 1), wp.vec3(*place)
        cells.side, cells.mean, cells.slope, cells.key = 1e-7, 1.0, 3.0, wp.uint32(1000 * key)
        cells.r_low, cells.r_high = radius, radius
        p, _, u = bodies_of(cells)
        if len(p) == 1:
            return cells, u[0].astype(float)
    raise AssertionError("no cell holds one body")


class Snowing:
    """A renderer whose splats can be looked at, and whose bodies can be put in place.

    Args:
        scene: The scene.
        lone: Place [3] and radius [m] of the only body; None: the scene's bodies.
    """

    def __init__(self, scene, lone=None):
        self.renderer = FrameRenderer(scene, "cpu")
        self.snow, self.listed, self.cells = self.renderer.snow, None, []
        made, seen = self.snow._splats, self.snow._cells
        if lone is not None:
            alone, self.u = lone_cell(*lone)

        def splats(*arguments):
            found = made(*arguments)
            self.listed = None if found is None else {name: array.numpy() for name, array in found.items()}
            return found

        def few(*arguments):
            found = seen(*arguments)
            if lone is not None:
                found = [found[0]._replace(cells=alone)]
            self.cells = [some.cells for some in found]
            return found

        self.snow._splats, self.snow._cells = splats, few

    def __call__(self, T_w_v=None, **options):
        """Image N."""
        return self.renderer.render(np.eye(4) if T_w_v is None else T_w_v, outputs="N", **options).N

    @property
    def splats(self):
        """The splats of the last image, each once."""
        if self.listed is None:
            return np.empty(0)
        splats = self.listed["splats"]
        return splats[np.unique(splats[["x", "y", "t"]], return_index=True)[1]]

    def bodies(self):
        """Places, radii and numbers of the bodies of all cells that the last image visited."""
        return tuple(np.concatenate(arrays) for arrays in zip(*map(bodies_of, self.cells), strict=True))


def soft_edge(outwards, width):
    """Share of a disc at a distance beyond its edge [pixels]: that is a step under two boxes, one a pixel at least."""
    long = max(width / 2, 1)
    fine = np.linspace(-width / 2, width / 2, 20001)
    step = [np.clip((fine + sign * long / 2) / (width - long) + 0.5, 0, 1) for sign in (1, -1)]
    share = np.append(0, np.cumsum(np.diff(fine) * np.convolve(step[0] - step[1], [0.5, 0.5], "valid")))
    return 1 - np.interp(outwards, fine, share / long, 0, 1)
