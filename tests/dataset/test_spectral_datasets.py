"""Datasets of water by wavelength: of two vehicles, with spectra in files that a dataset does not hold."""

import json
import shutil

import numpy as np
import pytest

from varos_warp.dataset.export import export
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.readiness.frames.light import attenuation
from varos_warp.dataset.run.fleet import produce_each
from varos_warp.dataset.validate import validate
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.passes import BandWater

CAMERA = {"id": "M0", "resolution": [32, 18], "response": "nikon_5100"}
OTHER = {"id": "R0", "resolution": [32, 18], "response": "camera.csv", "color_matrix": "auto"}


def vehicle(id, y, spectrum, *cameras, **more):
    return {
        "id": id,
        "cameras": list(cameras),
        "lights": [{"spectrum": spectrum, "power_W": 80.0, "cone_deg": 100.0}],
        "trajectory": {"poses": [{"position": [0.2, y, 1.0]}]},
        **more,
    }


@pytest.fixture(scope="module")
def fleet(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fleet")
    (folder / "lamp.csv").write_text("wavelength_nm,power\n400,1\n550,3\n700,1\n")
    (folder / "camera.csv").write_text("wavelength_nm,r,g,b\n400,0,0,1\n500,0,1,0.1\n600,1,0.1,0\n700,0.2,0,0\n")
    scene = scene_from_dict(
        {
            "terrain": {"kind": "procedural", "size_m": 20, "resolution": 17, "seed": 1},
            "objects": [{"kind": "boulder", "diameter": 0.5, "seed": 3, "position": [0, 3, 0.6]}],
            "water": {"spectral": {"jerlov": "1C"}},
            "render": {"outputs": ["A", "D", "S", "T"], "spp": 1, "integrator": "path", "denoise": "none"},
            "vehicles": [
                vehicle("0", 0.0, "led_b4", CAMERA, OTHER),
                vehicle("1", 1.5, "lamp.csv", CAMERA, body={"kind": "rov", "position": [0, 0, 0]}),
            ],
        },
        folder,
    )
    produce_each(scene, folder / "out", device="cpu", quiet=True)
    return folder


@pytest.mark.parametrize("name", ["veh0", "veh1"])
def test_they_are_sound_though_their_tables_are_elsewhere(fleet, name):
    assert validate(fleet / "out" / name).problems == []


def test_a_matrix_that_does_not_follow_from_tables_is_checked(fleet, tmp_path):
    """Numbers of the scene are known, also where the camera's response is elsewhere; those by ``auto`` are not."""
    root = shutil.copytree(fleet / "out/veh0", tmp_path / "copy")
    (root / "checksums").unlink()
    meta = json.loads((root / "dataset.json").read_text())
    meta["scene"]["vehicles"][0]["cameras"][1]["color_matrix"] = [[1, 0, 0], [0, 1, 0], [0, 0, 1.5]]
    (root / "dataset.json").write_text(json.dumps(meta))
    assert any("cameras.1.color_matrix" in problem for problem in validate(root).problems)


def test_labels_know_what_is_hidden_in_them(fleet, tmp_path):
    export(fleet / "out/veh0", "coco", tmp_path / "coco", scene_dir=fleet)
    found = json.loads((tmp_path / "coco/annotations/amodal.json").read_text())
    assert {entry["key"] for entry in found["annotations"]} >= {"objects.0"}


def test_each_camera_has_an_attenuation_of_its_own(fleet):
    data = Dataset(fleet / "out/veh0")
    for camera in data.cameras:
        water = BandWater.of(data.meta["water"], camera)
        np.testing.assert_allclose(np.exp(-attenuation(data, camera)), water.left(np.array(1.0)), rtol=1e-12)
    assert np.ptp([attenuation(data, camera)[0] for camera in data.cameras]) > 0.01
    assert [bands["range_m"] for bands in data.meta["water"]["bands"]] == [[1.0, 20.0]] * len(data.cameras)


def test_without_bands_each_channel_is_one():
    water = BandWater.of({"sigma_a": [0.1, 0.2, 0.3], "sigma_s": [0.2, 0.2, 0.2]}, "M0")
    np.testing.assert_array_equal(water.left(np.array([0.0, 2.0])), [[1, 1, 1], np.exp([-0.6, -0.8, -1.0])])
