"""The table of light scattered once: right to its tolerance wherever it is used, and not used where it would not be."""

import sys
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from varos_warp.kernels.single_table import TOLERANCE, SingleTable, scattered_by_lamps, scattered_once
from varos_warp.kernels.world.camera import Camera, camera_ray
from varos_warp.kernels.world.intersect import SceneData
from varos_warp.kernels.world.medium import transmittance
from varos_warp.render.field import open_water as tables
from varos_warp.render.field.open_water import OpenWater
from varos_warp.render.frame import FrameRenderer
from varos_warp.render.launch import Launcher

sys.path.append(str(Path(__file__).parents[1] / "physics"))
from rig import VAROS_WATER, floor, one_ray_scene, point, spot, water

PAPER_WATER = VAROS_WATER | {"phase": {"g": 0.8}}
LENS = {"resolution": [256, 144], "sensor_mm": [4.416, 2.484], "focal_mm": 3.4, "look_at": [0, 1, 0]}
PIECES = wp.constant(40)

RIGS = {
    "the paper's, soft edges": ([spot((-0.15, 0, -0.1), blend=0.15), spot((0.15, 0, -0.1), blend=0.15)], PAPER_WATER),
    "hard edges": ([spot((-0.15, 0, -0.1)), spot((0.15, 0, -0.1))], PAPER_WATER),
    "a lamp in view": ([point((0.1, 0.05, 1.5))], PAPER_WATER),
    "a beam across the view": ([spot((1.0, 0, 2.0), axis=(-1, 0.2, 0), cone_deg=10.0)], PAPER_WATER),
    "far lamps": ([spot((-2.0, 0, 0), axis=(0.3, 0, 1), blend=0.5), spot((2.5, 0, -0.5))], PAPER_WATER),
    "murky": ([spot((0.15, 0, -0.1), blend=0.15)], water(2.0, 4.0, 0.6)),
    "at the camera": ([point((0, 0, 0))], water(0.02, 0.05, 0.3)),
}


@wp.kernel(enable_backward=False)
def compare(
    scene: SceneData,
    table: SingleTable,
    camera: Camera,
    size: wp.vec2,
    places: wp.array(dtype=wp.vec3),  # x, y in [0, 1) and the distance
    # out
    truth: wp.array(dtype=wp.vec3),
    got: wp.array(dtype=wp.vec3),
):
    """By quadrature in forty pieces, much finer than any use of it, and as images have it."""
    i = wp.tid()
    x, y, t = places[i][0], places[i][1], places[i][2]
    ray = camera_ray(camera, size[0] * x, size[1] * y, wp.vec2(0.0, 0.0))
    L = wp.vec3(0.0)
    for k in range(PIECES):
        start = t * float(k) / float(PIECES)
        piece = scattered_by_lamps(scene.medium, scene.lights, ray.o + start * ray.d, ray.d, t / float(PIECES))
        L += wp.cw_mul(transmittance(scene.medium, start), piece)
    truth[i] = L
    got[i] = scattered_once(scene, table, ray.o, ray.d, x, y, t)


def made(rig: str) -> tuple[OpenWater, SingleTable]:
    lights, coefficients = RIGS[rig]
    water = OpenWater(one_ray_scene(lights, coefficients, **LENS), Launcher("cpu"))
    return water, water.single_table(water.scene.vehicle.cameras[0])


def looked_up(rig: str, count: int = 20_000):
    """Truth, what images get, and whether the cell is smooth, at random places; distances evenly in the table."""
    water, table = made(rig)
    rng = np.random.default_rng(1)
    places = rng.random((count, 3)) * [1.0, 1.0, 0.99]
    cells = tuple((places * [n - 1 for n in tables.SINGLE[::-1]]).astype(int).T[::-1])
    places[:, 2] *= table.scale / (1.0 - places[:, 2])
    out = [wp.empty(count, dtype=wp.vec3, device="cpu") for _ in "tg"]
    where = wp.array(places, dtype=wp.vec3, device="cpu")
    scene, camera, size = water._at_rest(tables._as_pinhole(water.scene.vehicle.cameras[0])[0])
    wp.launch(compare, count, inputs=[scene, table, camera, size, where], outputs=out, device="cpu")
    return *(array.numpy().astype(float) for array in out), table.smooth.numpy()[cells] == 1


@pytest.mark.parametrize("rig", RIGS)
def test_wherever_the_table_is_used_it_is_right(rig):
    truth, got, smooth = looked_up(rig)
    lit = smooth[:, None] & (truth > 0.0)
    assert lit.mean() > 0.2 or rig == "a beam across the view"  # which bends everywhere
    assert np.abs(got[lit] / truth[lit] - 1.0).max(initial=0.0) <= TOLERANCE
    assert not got[smooth[:, None] & (truth == 0.0)].any()


@pytest.mark.parametrize(("rig", "least"), [("the paper's, soft edges", 0.8), ("far lamps", 0.8), ("murky", 0.6)])
def test_most_of_it_is_used_where_lamps_are_beside_the_camera(rig, least):
    assert looked_up(rig, 5000)[2].mean() >= least


def test_around_a_lamp_in_view_it_is_not_used():
    """The light rises with the inverse of the angle to the lamp: no grid can follow."""
    _, table = made("a lamp in view")
    smooth = table.smooth.numpy()
    assert not smooth[-1, smooth.shape[1] // 2 - 4 : smooth.shape[1] // 2 + 4, 66:75].any()


def test_the_tables_of_the_last_cameras_are_kept(monkeypatch):
    monkeypatch.setattr(tables, "SINGLE", (3, 3, 3))
    monkeypatch.setattr(tables, "SINGLE_KEPT", 2)
    water = OpenWater(one_ray_scene(*RIGS["hard edges"], **LENS), Launcher("cpu"))
    a, b, c = (water.scene.vehicle.cameras[0].model_copy(update={"focal_mm": f}) for f in (3.0, 4.0, 5.0))
    of_a, of_b = water.single_table(a), water.single_table(b)
    assert water.single_table(a) is of_a
    water.single_table(c)
    assert water.single_table(a) is of_a
    assert water.single_table(b) is not of_b


@pytest.mark.parametrize(("camera", "lights"), [
    ({"resolution": [120, 72]}, RIGS["hard edges"][0]),
    ({"f_stop": 0.1, "focus_m": 2.0}, RIGS["hard edges"][0]),
    ({"f_stop": 8.0, "focus_m": 2.0}, RIGS["at the camera"][0]),
])
def test_small_images_and_wide_lenses_do_without(camera, lights):
    water = OpenWater(one_ray_scene(lights, PAPER_WATER, **(LENS | camera)), Launcher("cpu"))
    assert water.single_table(water.scene.vehicle.cameras[0]).radiance is None


@pytest.mark.parametrize(("lens", "block"), [({}, 1), ({"f_stop": 1.7, "focus_m": 3.0}, 16)])
def test_images_are_the_same_with_it_and_without(monkeypatch, lens, block):
    """Of a floor at an angle: pixel by pixel, and through a lens, which blurs it a little, by blocks of pixels."""
    scene = one_ray_scene(*RIGS["the paper's, soft edges"], **(LENS | lens | {"look_at": [0.3, 1, 0.4]}))
    images = []
    for pixels in (1 << 15, 1 << 40):
        monkeypatch.setattr(tables, "SINGLE_PIXELS", pixels)
        renderer = FrameRenderer(scene, "cpu", parts=[floor(4.0, 0.0)])
        radiance = renderer.render(np.eye(4), outputs="A", layers=("single",), spp=2, integrator="tables").A.radiance
        images.append(radiance.astype(float).reshape(144 // block, block, 256 // block, block, 3).mean((1, 3)))
    with_table, without = images
    assert not np.array_equal(with_table, without)
    lit = without > 0.01 * without.max()
    assert np.abs(with_table[lit] / without[lit] - 1.0).max() < 2 * TOLERANCE
