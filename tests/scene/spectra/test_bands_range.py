"""Ways of light that bands are chosen for: the scene's key, what is kept, and a warning where there are others."""

import numpy as np
import pytest

from varos_warp.errors import InputError
from varos_warp.scene.band_checks import ways_of_light
from varos_warp.scene.checks import check_scene
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.info import water_info
from varos_warp.scene.passes import described
from varos_warp.scene.spectra import bands
from varos_warp.scene.spectra.bands import rms_over, scene_bands

BOARD = {"kind": "calibration_board", "square_m": 0.5, "rows": 9, "columns": 9}


def scene_of(folder=".", wall_m=5.0, lamp="led_b4", water="IB", **render):
    """A camera before a wall, with a lamp at the camera, and one 2 m behind."""
    lamps = [{"spectrum": lamp, "power_W": 10.0}, {"spectrum": "led_b1", "power_W": 10.0, "position": [0, -2.0, 0]}]
    return scene_from_dict(
        {
            "water": {"spectral": {"jerlov": water}},
            "objects": [BOARD | {"position": [0, wall_m, 0]}],
            "vehicle": {"lights": lamps, "cameras": [{"id": "M0", "resolution": [64, 36], "response": "nikon_5100"}]},
            "trajectory": {"poses": [{"position": [0, 0, 0]}]},
            "render": render,
        },
        folder,
    )


def same(one, other):
    return all(np.array_equal(a, b) for a, b in zip(vars(one).values(), vars(other).values(), strict=True))


def test_bands_are_those_of_the_scenes_ways_and_of_1_to_20_m_without():
    camera = scene_of().vehicle.cameras[0]
    assert same(scene_bands(scene_of(), camera), scene_bands(scene_of(bands_range_m=[1, 20]), camera))
    near = scene_of(bands_range_m=[0.5, 2.0], bands=6)
    found = scene_bands(near, camera)
    assert same(found, scene_bands(scene_of(bands=6), camera, (0.5, 2.0)))
    assert not same(found, scene_bands(scene_of(bands=6), camera))
    np.testing.assert_allclose(rms_over(near, camera, (0.5, 2.0)), found.rms, rtol=1e-12)
    assert rms_over(near, camera, (10.0, 20.0)).max() > 1.5 * found.rms.max()


def test_they_are_stated_where_bands_are():
    scene = scene_of(bands_range_m=[0.5, 2.0])
    assert [block["range_m"] for block in described(scene)] == [[0.5, 2.0]]
    assert water_info(scene)["paths_m"] == [0.5, 2.0]
    assert water_info(scene_of())["paths_m"] == [1.0, 20.0]


def test_bands_are_chosen_once_for_what_they_follow_from(tmp_path, monkeypatch):
    calls, choose = [], bands.choose_bands
    monkeypatch.setattr(bands, "choose_bands", lambda *arguments: calls.append(arguments) or choose(*arguments))
    bands._chosen.cache_clear()
    table = tmp_path / "lamp.csv"
    table.write_text("wavelength_nm,power\n400,1\n700,1\n")
    for _ in range(3):
        scene = scene_of(tmp_path, lamp="lamp.csv", bands=3)
        found = scene_bands(scene, scene.vehicle.cameras[0])
    assert len(calls) == 1
    with pytest.raises(ValueError, match="read-only"):
        found.weights[0] = 0.0
    table.write_text("wavelength_nm,power\n400,1\n700,3\n")  # the same name
    other = scene_bands(scene, scene.vehicle.cameras[0])
    assert len(calls) == 2
    assert not np.array_equal(found.lamps, other.lamps)
    for change in ({"bands": 6}, {"bands": 3, "bands_range_m": [1, 5]}):
        scene_bands(scene_of(tmp_path, lamp="lamp.csv", **change), scene.vehicle.cameras[0])
    assert len(calls) == 4


@pytest.mark.parametrize(
    ("value", "says"),
    [
        ([20, 1], "must be longer than the shortest"),
        ([0, 1], "greater than 0"),
        ([1, 2000], "at most 1000 m"),
        ([5, 5], "must be longer"),
        (5, "bands_range_m"),
        (["nan", 5], "bands_range_m"),
    ],
)
def test_ways_that_are_none_are_refused_by_key(value, says):
    with pytest.raises(InputError, match=r"render\.bands_range_m") as refused:
        scene_of(bands_range_m=value)
    assert says in str(refused.value)


def test_without_wavelengths_they_mean_nothing():
    with pytest.raises(InputError, match=r"render\.bands_range_m.*means nothing"):
        scene_from_dict({"render": {"bands_range_m": [1, 5]}, "trajectory": {"poses": [{"position": [0, 0, 0]}]}}, ".")


def test_ways_are_those_over_the_nearest_lamp():
    """Of a wall at 5 m and a lamp in the camera: there and back, longer to the corners by the tangents of the view."""
    scene = scene_of()
    low, high = ways_of_light(scene, scene.vehicle.cameras[0], build_parts(scene), np.eye(4)[None])
    assert 10.0 < low < 10.05
    corner = np.hypot(1.0, np.hypot(0.5 * 4.416, 0.5 * 2.484) / 3.4)
    assert 0.9 * 10.0 * corner < high < 10.0 * corner
    away = scene_of(wall_m=-5.0)
    assert ways_of_light(away, away.vehicle.cameras[0], build_parts(away), np.eye(4)[None]) is None


def test_a_warning_tells_of_other_ways_and_what_it_asks_for_helps():
    def told(**render):
        scene = scene_of(bands=6, **render)
        return [words for words in check_scene(scene, build_parts(scene)) if "its bands are chosen" in words]

    assert told() == []
    (words,) = told(bands_range_m=[0.2, 1.0])
    assert "vehicle.cameras.0 (M0)" in words
    assert "chosen for 0.2 to 1 m" in words
    advice = [float(x) for x in words.rpartition("[")[2].rstrip("]").split(",")]
    assert 9.0 < advice[0] < advice[1] < 15.0
    assert told(bands_range_m=advice) == []


@pytest.mark.parametrize(("bands", "says"), [(31, "at most 30"), (2, "at least 3"), ("all", "auto")])
def test_a_wrong_number_of_bands_is_told_which_there_are(bands, says):
    with pytest.raises(InputError, match=rf"render\.bands = '?{bands}.*{says}"):
        scene_of(bands=bands)
