"""Meter, dither and a noisy sensor of the scene, through `run`: the same bytes however it is divided, and sound."""

import json

import numpy as np
import pytest
import standins
from standins import make_scene, tree

from varos_warp.dataset.noise_pass import add_noise
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.validate import validate
from varos_warp.errors import InputError
from varos_warp.render.image.exposure import centre_weights
from varos_warp.scene.description.noise_profile import NoiseProfile
from varos_warp.scene.file.noise_profiles import load_profile

METER = {"meter": "percentile"}
LOOK = {"noise": "machine_vision", "dither": "tpdf", "exposure": {"A": METER}}


@pytest.fixture(autouse=True)
def _stand_ins(monkeypatch):
    standins.install(monkeypatch)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A complete dataset; read it, do not change it."""
    with pytest.MonkeyPatch.context() as patch:
        standins.install(patch)
        return made(tmp_path_factory.mktemp("look") / "out")


def made(out, render=LOOK, **how):
    produce(make_scene(render=render), out, quiet=True, **how)
    return out


def test_it_is_sound(whole):
    assert validate(whole, quiet=True).problems == []


def test_shards_and_an_interruption_give_the_same_bytes(whole, tmp_path):
    for shard in (2, 0, 1):
        made(tmp_path / "shards", shard=(shard, 3))
    made(tmp_path / "shards")
    assert tree(tmp_path / "shards") == tree(whole)
    made(tmp_path / "later", frames=slice(0, 10))
    for path in list((tmp_path / "later").rglob("A_clean/*.png"))[::3]:
        path.unlink()
    next((tmp_path / "later").rglob("A/*.png")).write_bytes(b"")
    made(tmp_path / "later")
    assert tree(tmp_path / "later") == tree(whole)


def test_a_is_what_the_noise_pass_makes_of_the_same_scene_without_noise(whole, tmp_path):
    """With the scene's seed; what it keeps as A_clean is A of the run without."""
    clean = made(tmp_path / "clean", render={key: LOOK[key] for key in ("dither", "exposure")})
    sensor = NoiseProfile(camera=load_profile("machine_vision").camera)
    noisy = add_noise(clean, sensor, tmp_path / "noisy", seed=3, quiet=True)
    data = Dataset(whole)
    for camera in data.cameras:
        for truth in (False, True):
            np.testing.assert_array_equal(
                data.pixels("A", 4, camera, truth=truth), noisy.pixels("A", 4, camera, truth=truth)
            )
    assert (data.pixels("A", 4) != data.pixels("A", 4, truth=True)).mean() > 0.3


def test_gains_are_those_of_the_meter(whole):
    """The percentile of the half floats, by sorting, for every frame; smoothed by a Gaussian of 1 s."""
    data, read = Dataset(whole), []
    for frame in data.frames:
        brightest = data.linear("A", frame).max(-1)
        order = np.argsort(brightest, axis=None)
        weight = np.cumsum(centre_weights(*brightest.shape).ravel()[order])
        read.append(brightest.ravel()[order][np.searchsorted(weight, 0.985 * weight[-1])])
    time = np.arange(len(read)) / 10.0
    blur = np.exp(-np.square(time[:, None] - time) / 2.0)
    target = np.log(0.95 / np.array(read, float))
    np.testing.assert_allclose(list(data.gains("A").values()), np.exp(blur @ target / blur.sum(1)), rtol=1e-9)


def test_another_percentile_or_level_exposes_what_is_there_anew(whole, tmp_path):
    out = made(tmp_path / "out", render=LOOK | {"exposure": {"A": METER | {"percentile": 90.0, "level": 0.5}}})
    with_adaptive = made(tmp_path / "out", render=LOOK | {"exposure": {"A": "adaptive"}})
    assert "percentile" not in Dataset(out).layout.exposures("L0", "A").read_text()
    assert validate(with_adaptive, quiet=True).problems == []
    made(out)
    assert {name: data for name, data in tree(out).items() if "/A" in name} == {
        name: data for name, data in tree(whole).items() if "/A" in name
    }


def test_dataset_json_and_the_readme_tell_of_it(whole, tmp_path):
    meta = json.loads((whole / "dataset.json").read_text())
    assert meta["noise"]["profile"]["camera"]["electrons_per_dn"] == 2.6
    assert meta["scene"]["render"]["noise"]["electrons_per_dn"] == 2.6
    assert "A_clean" in meta["conventions"]["A"]
    assert "dithered" in meta["conventions"]["B"]
    assert "CAMERA NOISE" in (whole / "README.txt").read_text()
    assert Dataset(whole).has_noise("A")
    plain = json.loads((made(tmp_path / "plain", {}, frames=slice(1)) / "dataset.json").read_text())
    assert "noise" not in plain
    assert not {"noise", "dither"} & plain["scene"]["render"].keys()
    assert not list((tmp_path / "plain").rglob("A_clean"))


def test_damage_to_either_image_is_named(whole, tmp_path):
    out = made(tmp_path / "out", frames=slice(2))
    data = Dataset(out)
    (out / "checksums").unlink()
    for path, other in (
        (data.layout.clean("L0", 0), data.layout.clean("L0", 1)),
        (data.layout.image("R0", "A", 0), data.layout.clean("R0", 0)),
        (data.layout.image("R0", "B", 1), data.layout.image("R0", "B", 0)),
    ):
        path.write_bytes(other.read_bytes())
    problems = validate(out, quiet=True).problems
    for words in (
        "A_clean/seq01_veh0_camL0_A-00000000.png: is not its EXR with the gain",
        "camR0_A-00000000.png: is not its EXR with the noise",
        "camR0_B-00000001.png: is not its EXR",
    ):
        assert any(words in problem for problem in problems), problems


def test_noise_is_not_added_to_it_and_other_noise_does_not_go_on_in_its_folder(whole, tmp_path):
    with pytest.raises(InputError, match=r"render\.noise.*A has noise already, of the scene"):
        add_noise(whole, load_profile("bar30"), tmp_path / "out", quiet=True)
    out = made(tmp_path / "small", frames=slice(1))
    with pytest.raises(InputError, match=r"render\.noise"):
        made(out, LOOK | {"noise": {"electrons_per_dn": 3.0}}, frames=slice(2))


def test_of_a_profile_with_sensors_the_camera_is_taken_and_that_is_told():
    with pytest.warns(UserWarning, match="takes the camera only, not imu0, depth0"):
        scene = make_scene(render={"noise": "low_light_rov"})
    assert scene.render.noise == load_profile("low_light_rov").camera


@pytest.mark.parametrize(
    ("render", "said"),
    [
        ({"noise": "machine_visoin"}, r"render\.noise.*no such noise profile.*machine_vision"),
        ({"noise": "bar30"}, r"render\.noise.*has no camera"),
        ({"noise": {"bits": 12}}, r"render\.noise.*give one of electrons_per_dn"),
        (
            {"noise": {"electrons_per_dn": 2.6, "dark_current_electrons_per_s": 9.0}},
            r"render\.noise\.dark_current_electrons_per_s.*no exposure",
        ),
        ({"dither": "blue"}, r"render\.dither.*choices"),
        ({"exposure": {"A": {"meter": "median"}}}, r"render\.exposure\.A\.meter.*choices"),
        ({"exposure": {"A": {"percentile": 98}}}, r"render\.exposure\.A\.meter.*missing"),
        ({"exposure": {"A": {"meter": "percentile", "percentile": 120}}}, r"render\.exposure\.A\.percentile.*100"),
        ({"exposure": {"A": {"meter": "percentile", "level": 0}}}, r"render\.exposure\.A\.level"),
        ({"exposure": {"A": {"meter": "percentile", "gain": 3}}}, r"render\.exposure\.A\.gain.*unknown key"),
        ({"exposure": {"A": "adaptiv"}}, r"render\.exposure\.A.*adaptive"),
    ],
)
def test_bad_values_are_refused_by_name(render, said):
    with pytest.raises(InputError, match=f"(?s){said}"):
        make_scene(render=render)


def test_a_gain_that_is_a_time_of_exposure_does_not_vary_behind_a_shutter():
    vehicle = make_scene().vehicle.model_dump(mode="json")
    vehicle["cameras"][0]["exposure"] = {"time_s": 0.01}
    for exposure in ("adaptive", METER):
        with pytest.raises(InputError, match=r"render\.noise\.electrons_per_dn.*camera L0"):
            make_scene(vehicle=vehicle, render=LOOK | {"exposure": {"A": exposure}})
    for exposure in ("constant", 3.0):
        assert make_scene(vehicle=vehicle, render=LOOK | {"exposure": {"A": exposure}}).render.noise


def test_another_reading_of_the_meter_is_named_by_its_column(tmp_path):
    out = made(tmp_path / "out", frames=slice(3))
    (out / "checksums").unlink()
    path = Dataset(out).layout.exposures("R0", "A")
    head, row, *rest = path.read_text().splitlines()
    for place, name in ((-2, "percentile_98.5"), (-1, "centre_weighted_mean")):
        cells = row.split(",")
        cells[place] = repr(1.5 * float(cells[place]))
        path.write_text("\n".join([head, ",".join(cells), *rest, ""]))
        problems = validate(out, quiet=True).problems
        assert any(f"camR0_exposure_A.csv:2: {name} = " in problem and "meter" in problem for problem in problems)


def test_a_word_for_a_meter_is_told_the_block():
    with pytest.raises(InputError, match=r"render\.exposure\.A.*Give {meter: percentile}"):
        make_scene(render={"exposure": {"A": "percentile"}})


def test_a_dataset_that_says_no_way_to_expose_is_told_of(tmp_path):
    out = made(tmp_path / "out", frames=slice(1))
    (out / "checksums").unlink()
    meta = json.loads((out / "dataset.json").read_text())
    meta["color"]["exposure"]["A"] = {"meter": "percentile", "percentile": 200.0}
    (out / "dataset.json").write_text(json.dumps(meta))
    assert any("color.exposure: says no way to expose" in problem for problem in validate(out, quiet=True).problems)
