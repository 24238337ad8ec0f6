"""Datasets of cameras with distortion and ports: sound ones pass, and a wrong coefficient is found."""

import json

import pytest
from standins import make_scene

from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.validate import validate
from varos_warp.errors import InputError

OPTICS = {
    "barrel": {"distortion": {"model": "brown_conrady", "k": [-0.25, 0.06, 0.001, -0.002, 0.0]}},
    "fisheye": {"distortion": {"model": "kannala_brandt", "k": [-0.02, 0.003, -0.001, 0.0002]}},
    "flat": {"port": {"kind": "flat", "distance_m": 0.05, "thickness_m": 0.01, "normal": [0.1, 0.1, 1.0]}},
    "dome": {"port": {"kind": "dome", "radius_m": 0.05, "thickness_m": 0.007, "centre": [0.0, 0.01, 0.01]}},
}


def made(out, optics, kind="z"):
    """Four frames of a camera with such optics."""
    camera = {"id": "M0", "rotation_euler_deg": [-30, 0, 0], "resolution": [96, 54]} | OPTICS[optics]
    vehicle = {"lights": [{"kind": "point"}], "cameras": [camera], "imu": {}, "depth_gauge": {}}
    scene = make_scene(vehicle=vehicle, render={"outputs": ["A", "B", "C", "D"], "depth_kind": kind})
    produce(scene, out, frames=slice(0, 4), quiet=True)
    return out


@pytest.mark.parametrize("kind", ["z", "range"])
@pytest.mark.parametrize("optics", OPTICS)
def test_a_sound_dataset_passes(tmp_path, optics, kind):
    result = validate(made(tmp_path / "data", optics, kind), quiet=True)
    assert result.problems == []
    assert any("D of successive frames" in measure["name"] for measure in result.measures)


@pytest.mark.parametrize(
    ("optics", "key", "value"),
    [
        ("flat", "n_water", None),
        ("flat", "port", {"kind": "flat", "distance_m": 0.05}),
        ("flat", "port", {"kind": "box"}),
        ("barrel", "distortion", {"model": "brown_conrady", "k": [0.1]}),
    ],
)
def test_lenses_and_ports_that_are_not_whole_are_refused(tmp_path, optics, key, value):
    camera = {"id": "M0", "rotation_euler_deg": [-30, 0, 0], "resolution": [16, 9]} | OPTICS[optics]
    scene = make_scene(vehicle={"lights": [], "cameras": [camera]}, render={"outputs": ["D"]})
    produce(scene, tmp_path / "data", frames=slice(0, 2), quiet=True)
    path = tmp_path / "data/dataset.json"
    about = json.loads(path.read_text())
    about["cameras"][0][key] = value
    path.write_text(json.dumps(about))
    with pytest.raises(InputError, match=r"the entry cameras\b"):
        Dataset(tmp_path / "data")


def test_a_wrong_distortion_is_found(tmp_path):
    """D and poses of two frames fit only with the right coefficients."""
    path = made(tmp_path / "data", "barrel") / "dataset.json"
    about = json.loads(path.read_text())
    about["cameras"][0]["distortion"]["k"][0] = 0.0
    path.write_text(json.dumps(about))
    problems = validate(tmp_path / "data", quiet=True).problems
    assert any("D of" in problem or "slopes of D" in problem for problem in problems)
