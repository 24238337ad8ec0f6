"""White balance and gains of single cameras, through `run`: recorded, read, checked, the same however it is divided."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import standins
from standins import make_scene, scene_dict, tree

from varos_warp.dataset import files
from varos_warp.dataset.noise_pass import add_noise
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.reader.exposures import GAINS
from varos_warp.dataset.report.curves import curves
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.validate import validate
from varos_warp.errors import InputError
from varos_warp.render.image.exposure import centre_weights
from varos_warp.scene.description.noise_profile import NoiseProfile
from varos_warp.scene.file.noise_profiles import load_profile

METER = {"meter": "percentile", "percentile": 98.0}


@pytest.fixture(autouse=True)
def _stand_ins(monkeypatch):
    standins.install(monkeypatch)


def scene_of(exposures, **render):
    """A scene whose two cameras have these exposures."""
    vehicle = scene_dict()["vehicle"]
    for camera, exposure in zip(vehicle["cameras"], exposures, strict=True):
        camera["exposure"] = exposure
    return make_scene(render={"outputs": ["A", "B"]} | render, vehicle=vehicle)


def made(out, exposures=({"white_balance": "grey_world"}, {"gain": 0.02}), frames=slice(0, 4), **render):
    how = render.pop("how", {})
    produce(scene_of(exposures, **render), out, quiet=True, sensors=False, frames=frames, **how)
    return Path(out)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A dataset whose first camera is balanced; read it, do not change it."""
    with pytest.MonkeyPatch.context() as patch:
        standins.install(patch)
        return made(tmp_path_factory.mktemp("balanced") / "out", exposure={"A": METER}, dither="tpdf")


def problems(root):
    return validate(root, quiet=True).problems


def test_each_camera_has_its_own_gains(whole):
    data = Dataset(whole)
    assert problems(whole) == []
    assert data.gain("A", 1, "R0") == 0.02
    assert len(data.gain("A", 1, "L0")) == 3
    assert data.gain("B", 1, "L0") == 1.0
    assert data.camera("L0")["exposure"] == {"time_s": 0.0, "readout_s": 0.0, "white_balance": "grey_world"}
    assert data.camera("R0")["exposure"] == {"time_s": 0.0, "readout_s": 0.0, "gain": 0.02}


def test_its_texts_tell_of_three_gains(whole):
    assert "gain_red" in Dataset(whole).meta["conventions"]["A"]
    assert "gain_red" not in Dataset(whole).meta["conventions"]["B"]
    assert "With white balance A has three of them" in (whole / "README.txt").read_text()


def test_the_mean_of_the_balanced_images_is_grey(whole):
    """Gains are smoothed, so it is so of the mean of the logarithms over time, about."""
    data, weight = Dataset(whole), centre_weights(27, 48)
    means = [np.tensordot(weight, data.linear("A", f, "L0") * data.gain("A", f, "L0"), 2) for f in data.frames]
    off = np.log(np.array(means) / np.array(means)[:, 1:2])
    assert np.abs(off.mean(0)).max() < 0.02
    raw = np.log([np.tensordot(weight, data.linear("A", f, "L0"), 2) for f in data.frames])
    assert np.abs(raw - raw[:, 1:2]).max() > 0.2  # there was something to balance


def test_radiance_is_read_back_to_eight_bits(whole):
    """Dither moves a value by less than one step more than rounding does."""
    data = Dataset(whole)
    for frame in data.frames:
        gain, linear = np.array(data.gain("A", frame, "L0")), data.linear("A", frame, "L0")
        error = np.abs(data.image("A", frame, "L0") - linear) * gain
        assert error[linear * gain < 1.0].max() <= 1.5 / 255.0 * 2.4


def test_shards_give_the_same_bytes(whole, tmp_path):
    for shard in (1, 0):
        made(tmp_path / "parts", exposure={"A": METER}, dither="tpdf", how={"shard": (shard, 2)})
    made(tmp_path / "parts", exposure={"A": METER}, dither="tpdf")
    assert tree(tmp_path / "parts") == tree(whole)


def test_balance_and_gain_of_a_camera_change_without_rendering_anew(whole, tmp_path):
    """EXR stay as they are, and back again all bytes are the same."""
    out = shutil.copytree(whole, tmp_path / "copy")
    times = {path: path.stat().st_mtime_ns for path in out.rglob("*_exr/*.exr")}
    made(out, ({}, {"gain": 0.04, "white_balance": "grey_world"}), exposure={"A": METER}, dither="tpdf")
    data = Dataset(out)
    assert isinstance(data.gain("A", 1, "L0"), float)
    assert data.gain("A", 1, "R0")[1] == 0.04
    assert problems(out) == []
    made(out, exposure={"A": METER}, dither="tpdf")
    assert tree(out) == tree(whole)
    assert times == {path: path.stat().st_mtime_ns for path in out.rglob("*_exr/*.exr")}


def test_no_balance_is_no_key(tmp_path):
    """The same bytes as of a scene without the block, B too."""
    plain = made(tmp_path / "plain", ({}, {}))
    said = made(tmp_path / "said", ({}, {}), exposure={"white_balance": "none"})
    assert tree(said) == tree(plain)
    assert "white_balance" not in (plain / "dataset.json").read_text()


def test_all_cameras_may_be_balanced_by_one_key_and_one_of_them_not(tmp_path):
    data = Dataset(made(tmp_path / "all", ({}, {"white_balance": "none"}), exposure={"white_balance": "grey_world"}))
    assert (len(data.gain("A", 0, "L0")), np.ndim(data.gain("A", 0, "R0"))) == (3, 0)


def test_for_lamps_every_frame_has_the_gains_of_dataset_json(tmp_path):
    out = made(tmp_path / "lamps", ({"gain": 0.5}, {}), exposure={"white_balance": "lamps"})
    data = Dataset(out)
    of_lamps = data.meta["color"]["lamp_gains"]
    np.testing.assert_allclose(data.gain("A", 2, "L0"), 0.5 * np.array(of_lamps["L0"]), rtol=1e-12)
    ratio = np.array(data.gain("A", 2, "R0")) / data.gain("A", 2, "R0")[1]
    np.testing.assert_allclose(ratio, of_lamps["R0"], rtol=1e-12)
    assert problems(out) == []
    meta = json.loads((out / "dataset.json").read_text())
    meta["color"]["lamp_gains"]["R0"][0] *= 1.1
    (out / "dataset.json").write_text(json.dumps(meta))
    assert any("color.lamp_gains.R0.0" in problem for problem in problems(out))


@pytest.mark.parametrize("column", ["gain_red", "mean_blue", "highlight_red"])
def test_a_changed_table_is_found(whole, tmp_path, column):
    out = shutil.copytree(whole, tmp_path / "copy")
    path = Dataset(out).layout.exposures("L0", "A")
    table = files.read_csv(path)
    table[column][1] *= 1.01
    files.write_csv(path, list(table), *[values.tolist() for values in table.values()])
    assert any(path.name in problem for problem in problems(out))


def test_curves_have_one_for_each_channel(whole):
    drawn = next(plot for plot in curves(Dataset(whole), np.arange(4.0)) if plot["title"] == "Exposure gain")
    assert [name for name in ("L0 A red", "L0 A green", "L0 A blue", "R0 A") if name in json.dumps(drawn)]
    assert set(GAINS) <= files.read_csv(Dataset(whole).layout.exposures("L0", "A")).keys()


def test_noise_of_the_scene_is_that_of_the_pass_and_before_the_balance(tmp_path):
    """Where nothing clips, the mean of the noise is none: colours are those of the clean image."""
    noise = load_profile("machine_vision")
    out = made(tmp_path / "noisy", exposure={"A": METER}, noise="machine_vision")
    clean = made(tmp_path / "clean", exposure={"A": METER})
    added = add_noise(clean, NoiseProfile(name="scene", camera=noise.camera), tmp_path / "pass", seed=3, quiet=True)
    data = Dataset(out)
    assert problems(out) == []
    for frame in data.frames:
        assert np.array_equal(data.pixels("A", frame, "L0"), added.pixels("A", frame, "L0"))
        assert np.array_equal(data.pixels("A", frame, "L0", truth=True), Dataset(clean).pixels("A", frame, "L0"))


def test_a_gain_that_follows_the_frames_is_no_time_of_exposure():
    sensor = {"electrons_per_dn": 2.6}
    exposures = [{"time_s": 0.01, "gain": 1.0}, {"time_s": 0.01, "gain": "constant", "white_balance": "grey_world"}]
    scene_of(exposures, noise=sensor)
    with pytest.raises(InputError, match=r"render\.noise\.electrons_per_dn.*camera L0 is exposed for 0\.01 s"):
        scene_of([exposures[0] | {"white_balance": "grey_world"}, exposures[1]], noise=sensor)
