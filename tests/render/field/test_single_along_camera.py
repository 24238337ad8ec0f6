"""The table of single scattering along a camera's rays: as right as stated, in unlike scenes, or not used."""

import numpy as np
import pytest
from physics.rig import TURBID, VAROS_LAMPS, VAROS_WATER, floor, spot

from varos_warp.device.launcher import Launcher
from varos_warp.kernels.field.along_camera import AlongCamera
from varos_warp.render.field import along_camera, open_water
from varos_warp.render.field.open_water import OpenWater
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.description import Scene

pytestmark = pytest.mark.subject("single scattering")

PAPER = {"coefficients": VAROS_WATER | {"phase": {"g": 0.8}}}
FOUR = [
    spot((x, 0.0, z), axis=(-0.3 * x, 0.2, 1.0), cone_deg=cone, blend=blend)
    for x, z, cone, blend in ((-0.5, 0.3, 80, 0.5), (0.5, 0.3, 90, 0.8), (-0.5, -0.3, 70, 1.0), (0.5, -0.3, 100, 0.6))
]
SCENES = {
    "paper": (PAPER, VAROS_LAMPS),
    "coast": ({"jerlov": {"type": "3C"}}, FOUR),
    "turbid": ({"coefficients": TURBID}, VAROS_LAMPS),
    "close": (PAPER, [spot((0.04, 0.03, -0.02), cone_deg=120.0, blend=0.5)]),
}
NARROW = (PAPER, [spot((-0.5, 0.0, 0.2), axis=(0.3, 0.0, 1.0), cone_deg=25.0)])


def scene_of(water, lights) -> Scene:
    view = {"id": "M0", "resolution": [64, 40], "focal_mm": 3.4, "sensor_mm": [4.4, 2.75]}
    return Scene(
        water=water, vehicle={"lights": lights, "cameras": [view]}, trajectory={"poses": [{"position": [0, 0, 0]}]}
    )


def single(water, lights) -> np.ndarray:
    """The layer, with a black wall that half of the image does not see."""
    wall = floor(4.0, 0.0, size=12.0, offset=(3.0, -2.0, 0.0))
    renderer = FrameRenderer(scene_of(water, lights), "cpu", parts=[wall])
    return renderer.render(np.eye(4), outputs="A", integrator="field", layers=("single",), spp=4, seed=3).A.radiance


def known_by_quadrature(monkeypatch):
    monkeypatch.setattr(OpenWater, "_along", lambda *_: AlongCamera())


@pytest.mark.parametrize("name", SCENES)
def test_images_by_table_and_by_quadrature_agree_within_the_stated_error(name, monkeypatch):
    tabulated = single(*SCENES[name])
    known_by_quadrature(monkeypatch)
    known = single(*SCENES[name])
    error, scale = tabulated - known, np.sqrt(np.mean(known**2, axis=(0, 1)))
    assert not np.array_equal(tabulated, known)  # it was in use
    assert np.all(np.sqrt(np.mean(error**2, axis=(0, 1))) <= along_camera.MOST_ERROR * scale)
    blocks = error.reshape(5, 8, 8, 8, 3).mean(axis=(1, 3))
    assert np.all(np.abs(blocks) <= along_camera.MOST_ERROR_AT_A_POINT * scale)


def test_a_narrow_beam_of_sharp_edge_keeps_the_quadrature(monkeypatch):
    made = single(*NARROW)
    with monkeypatch.context() as patch:
        known_by_quadrature(patch)
        assert np.array_equal(made, single(*NARROW))
    monkeypatch.setattr(along_camera, "_is_right", lambda *_: True)
    monkeypatch.setattr(OpenWater, "_depends_on", lambda *_, **what: what | {"another": "test"})
    assert not np.array_equal(made, single(*NARROW))  # a table would have told


def test_too_few_nodes_are_noticed(monkeypatch):
    monkeypatch.setattr(open_water, "SINGLE", along_camera.SINGLE._replace(counts=(48, 12, 20)))
    scene = scene_of(*SCENES["coast"])
    water = OpenWater(scene, Launcher("cpu"))
    assert water.only_single(scene.vehicle.cameras[0]).single.radiance.size == 0
