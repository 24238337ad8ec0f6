"""The example of a colour chart by distance: its numbers are those of the water, the lamp and the camera."""

import runpy
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.produce import produce
from varos_warp.scene.file.load import load_scene, scene_from_dict
from varos_warp.scene.passes import BandWater
from varos_warp.scene.spectra.bands import scene_bands
from varos_warp.scene.spectra.surfaces import chart_reflectances

FOLDER = Path(__file__).parents[1] / "examples" / "spectra"
CAMERAS = 5


@pytest.fixture(scope="module")
def example():
    return runpy.run_path(str(FOLDER / "colours_by_distance.py"))


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """Small, and of the direct light alone, which has no noise."""
    out = tmp_path_factory.mktemp("chart")
    small = [f"vehicle.cameras.{i}.resolution=[240, 135]" for i in range(CAMERAS)]
    direct = ["render.spp=1", "render.layers=[direct]", "render.denoise=none"]
    scene = load_scene(FOLDER / "chart.yaml", [*small, *direct, "terrain.resolution=33"])
    produce(scene, out, device="cpu", quiet=True)
    return Dataset(out)


def test_the_chart_is_whole_in_all_cameras_but_that_of_the_floor(example, data):
    views = example["chart_views"](data)
    np.testing.assert_allclose([view.distance for view in views], [1, 3, 5, 10], rtol=0.01)
    assert [view.frame.camera for view in views] == ["M0", "M1", "M2", "M3"]


def test_patches_are_attenuated_as_lamp_water_patch_and_camera_have_it(example, data):
    """By the bands, over the way from the lamp to each patch and on to the camera."""
    scene = load_scene(FOLDER / "chart.yaml")
    bands = scene_bands(scene, scene.vehicle.cameras[0])
    c, chart = bands.a + bands.b_water + bands.b_particles, np.array(list(chart_reflectances().values()))
    reflectance = np.array([patch.at(bands.wavelength_nm) for patch in chart])
    lamp = np.subtract(scene.trajectory.poses[0].position, scene.objects[0].position)
    column, row = (grid.ravel() for grid in np.meshgrid(np.arange(6) - 2.5, 1.5 - np.arange(4)))
    way = np.linalg.norm(0.046 * np.stack([column, 0.0 * row, row], -1) - lamp, axis=-1)
    views = example["chart_views"](data)

    def left(distance):
        return (reflectance * np.exp(-np.outer(way + distance, c))) @ (bands.weights * bands.lamps[0]).T

    for near, far in pairwise(views):
        step = far.distance - near.distance
        exact = np.log(left(near.distance) / left(far.distance)) / step
        np.testing.assert_allclose(example["of_patches"](near, far), exact, atol=0.01 / step)  # the lamp's, within 1 %


def test_what_all_pixels_have_is_that_of_white(example, data):
    frame = data[0, "O0"]
    edges = np.linspace(3.0, 15.0, 13)
    middles = 0.5 * (edges[1:] + edges[:-1])
    found = example["by_distance"](frame, edges)
    water = BandWater.of(data.meta["water"], "O0")
    np.testing.assert_allclose(found, -np.log(water.left(middles)) / middles[:, None], rtol=0.01)
    assert (np.diff(found[:, 0]) < 0.0).all()


def test_the_figure_is_drawn_and_white_is_told(example, data, tmp_path, capsys):
    assert example["main"]([str(data.root), "-o", str(tmp_path / "chart.png")]) == 0
    assert Image.open(tmp_path / "chart.png").size == (1050, 730)
    assert len(capsys.readouterr().out.splitlines()) == 3


def test_a_dataset_that_it_cannot_draw_is_refused(example, tmp_path, capsys):
    with pytest.raises(SystemExit) as end:
        example["main"]([str(tmp_path / "none"), "-o", str(tmp_path / "chart.png")])
    assert end.value.code == 2
    assert "there is no such folder" in capsys.readouterr().err

    scene = depths_of_a_floor(tmp_path)
    produce(scene, tmp_path / "out", device="cpu", quiet=True)
    with pytest.raises(SystemExit) as end:
        example["main"]([str(tmp_path / "out"), "-o", str(tmp_path / "chart.png")])
    assert end.value.code == 2
    assert "needs images A, D and T" in capsys.readouterr().err
    assert not (tmp_path / "chart.png").exists()


def depths_of_a_floor(folder):
    return scene_from_dict(
        {
            "terrain": {"kind": "procedural", "size_m": 20, "resolution": 17},
            "vehicle": {"cameras": [{"id": "M0", "resolution": [16, 9]}]},
            "trajectory": {"poses": [{"position": [0, 0, 1.0]}]},
            "render": {"outputs": ["D"]},
        },
        folder,
    )
