"""What bodies add in the mean, by a table along the camera's rays: as right as stated in unlike scenes, or not used."""

import numpy as np
import pytest
from flakes import LAMP, Snowing, snow_scene

from varos_warp.render.field import along_camera
from varos_warp.render.particles import snow as module

VIEW = {"resolution": [64, 40], "sensor_mm": [8, 5], "focal_mm": 6}
BEHIND = LAMP | {"position": [0.5, -0.1, 0.2], "direction": [-0.1, 1, 0]}
FOUR = [
    LAMP | {"position": [x, -0.1, z], "direction": [-0.3 * x, 1, -0.6 * z], "cone_deg": cone, "blend": blend}
    for x, z, cone, blend in ((-0.5, 0.3, 80, 0.5), (0.5, 0.3, 90, 0.8), (-0.5, -0.3, 70, 1.0), (0.5, -0.3, 100, 0.6))
]
CLEAR = {"coefficients": {"sigma_s": [0.02, 0.03, 0.025], "sigma_a": [0.3, 0.05, 0.04], "phase": {"g": 0.8}}}
WALL = [{"kind": "concrete_block", "only": ["block"], "size_m": [4, 0.2, 4], "position": [1.6, 1.5, -2.0]}]
UNLIKE = {
    "one lamp": {"lights": [BEHIND]},
    "four tilted": {"lights": FOUR},
    "clear": {"lights": FOUR[:2], "water": CLEAR},
    "half a wall": {"lights": [BEHIND], "objects": WALL},
    "a disk": {"lights": [BEHIND | {"radius_m": 0.1}]},
    "beside the lens": {"lights": [LAMP | {"position": [0.06, -0.02, 0.03], "direction": [0, 1, 0], "cone_deg": 150}]},
}


def expected_of(scene):
    """E of a scene's first frame, float64 [H, W, 3], and its renderer."""
    snowing = Snowing(scene)
    n = snowing()
    return ((n.light - n.added) / n.passed[..., None]).astype(float), snowing.snow


def by_quadrature(monkeypatch):
    monkeypatch.setattr(module, "lamps_tabled", lambda *_: False)


def is_tabulated(snow):
    ((tables, _),) = snow._lamp_tables.values()
    return len(tables) > 0


PANELS = 5e-3
"""Error of the quadrature's long panels, as stated, where a short stretch of water is in sight."""


DENSE = 50, 45, 81
"""Numbers of nodes twice as dense as a table's: errors are found to be as large as with three times, to 5 %."""


@pytest.mark.parametrize("name", UNLIKE)
def test_images_by_table_are_as_right_as_stated(name, monkeypatch):
    """Against nodes twice as dense, pixel by pixel; and against the quadrature along each ray, within its error.

    Errors are in proportion to the square of the distance of nodes: dense ones have a quarter, which is added.
    """
    scene = snow_scene(VIEW, **UNLIKE[name])
    tabulated, snow = expected_of(scene)
    assert is_tabulated(snow)
    with monkeypatch.context() as patch:
        patch.setattr(module, "LAMP_NODES", DENSE)
        dense, snow = expected_of(scene)
        assert is_tabulated(snow)
    error, scale = (tabulated - dense) / (1 - 1 / 4), np.sqrt(np.mean(dense**2, axis=(0, 1)))
    assert np.all(np.sqrt(np.mean(error**2, axis=(0, 1))) <= along_camera.MOST_ERROR * scale)
    assert np.all(np.abs(error) <= along_camera.MOST_ERROR_AT_A_POINT * scale)
    by_quadrature(monkeypatch)
    known, _ = expected_of(scene)
    off = tabulated - known
    assert off.any()
    if name == "a disk":  # rays see points of it by chance: of that 0.1 % of the scale is left in the mean
        off = off.mean(axis=(0, 1))
    assert np.all(np.abs(off) <= PANELS * scale)


@pytest.mark.parametrize(
    "lights",
    [
        [LAMP | {"position": [0.0, 1.0, 0.1], "direction": [0, 1, 0]}],
        [LAMP | {"position": [-0.5, 0.5, 0.0], "direction": [1, 0.3, 0], "cone_deg": 8, "blend": 0.0}],
        [BEHIND | {"radius_m": 0.2}],
    ],
    ids=["in view", "narrow beam across", "a disk as large as it is near"],
)
def test_where_a_table_would_not_be_right_there_is_none(lights, monkeypatch):
    made, snow = expected_of(snow_scene(VIEW, lights=lights))
    assert not is_tabulated(snow)
    by_quadrature(monkeypatch)
    assert np.array_equal(made, expected_of(snow_scene(VIEW, lights=lights))[0])
