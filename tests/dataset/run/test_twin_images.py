"""P in datasets: written, exposed, resumed and read as A is, with the gain of A for what the port lets through."""

import numpy as np
import pytest
from standins import make_scene, scene_dict, tree

from varos_warp.dataset import files
from varos_warp.dataset.export import export
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.validate import validate
from varos_warp.errors import InputError

PORT = {"kind": "flat", "distance_m": 0.02, "thickness_m": 0.008}


def scene_of(outputs, **render):
    """A stereo pair of which one camera has a port."""
    left, right = scene_dict()["vehicle"]["cameras"]
    vehicle = scene_dict()["vehicle"] | {"cameras": [left | {"port": PORT}, right]}
    return make_scene(vehicle=vehicle, render={"outputs": list(outputs), "linear_exr": True} | render)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A complete dataset; read it, do not change it."""
    import standins

    out = tmp_path_factory.mktemp("twin")
    with pytest.MonkeyPatch.context() as patch:
        standins.install(patch)
        produce(scene_of("AP"), out, frames=slice(3), quiet=True)
    return out


@pytest.mark.parametrize("exposure", ["adaptive", "constant", 3.0])
def test_the_gain_is_that_of_a_times_what_the_port_lets_through(tmp_path, exposure):
    produce(scene_of("AP", exposure={"A": exposure}), tmp_path / "out", frames=slice(3), quiet=True)
    data = Dataset(tmp_path / "out")
    assert validate(data.root, quiet=True).problems == []
    weight = data.camera_model("L0").axis_weight
    fresnel = (1 - (0.49 / 2.49) ** 2) * (1 - ((1.49 - 1.34) / (1.49 + 1.34)) ** 2)
    assert weight == pytest.approx(fresnel / 1.34**2, rel=1e-9)
    for frame in data.frames:
        assert data.gain("P", frame, "L0") == pytest.approx(weight * data.gain("A", frame, "L0"), rel=1e-12)
        assert data.gain("P", frame, "R0") == data.gain("A", frame, "R0")
    assert np.array_equal(data[1, "R0"].P, data[1, "R0"].A)  # no port: the same image
    assert not np.array_equal(data[1].P, data[1].A)


def test_files_and_columns_are_those_of_a(whole):
    data = Dataset(whole)
    assert data.outputs == ["A", "P"]
    table = files.read_csv(data.layout.camera_file("L0", "_timestamps.csv"))
    assert list(table) == ["# timestamp [ns]", "A", "B", "C", "D", "P"]
    assert table["P"][1] == data.layout.image("L0", "P", 1).name
    np.testing.assert_allclose(data.image("P", 1), data[1].P_radiance, atol=0.02 / data.gain("P", 1), rtol=0)
    channels = files.read_exr(data.layout.linear("L0", 1, "P"))
    assert {"R", "stderr.R", "direct.B"} <= set(channels)
    assert "P" in data.meta["conventions"]


def test_added_later_it_makes_the_same_files(whole, tmp_path):
    """A first, P by a second run into the folder, and P alone before A."""
    for order in ("AP", "PA"):
        for outputs in order:
            produce(scene_of(outputs), tmp_path / order, frames=slice(3), quiet=True)
        mine, all_at_once = tree(tmp_path / order), tree(whole)
        assert mine.keys() == all_at_once.keys()
        assert [
            name for name in mine if mine[name] != all_at_once[name] and name not in ("dataset.json", "checksums")
        ] == []


def test_a_wrong_gain_and_a_damaged_image_are_found(tmp_path):
    produce(scene_of("AP"), tmp_path / "out", frames=slice(3), quiet=True)
    data = Dataset(tmp_path / "out")
    (data.root / "checksums").unlink()
    path = data.layout.exposures("L0", "P")
    table = files.read_csv(path)
    files.write_csv(path, list(table), *[values * 1.01 if name == "gain" else values for name, values in table.items()])
    data.layout.image("L0", "P", 2).write_bytes(data.layout.image("L0", "P", 1).read_bytes())
    text = "\n".join(validate(data.root, quiet=True).problems)
    assert "camL0_exposure_P.csv:2: gain = " in text
    assert "the gain of frame 0 and of 2 more is not that of A times what the port lets through" in text
    assert "P-00000002.png: is not its EXR with the gain of the exposure table" in text


def test_pytorch_gets_it_as_it_gets_a(whole):
    pytest.importorskip("torch")
    item, frame = Dataset(whole).torch(("P", "P_radiance"))[1], Dataset(whole)[1]
    np.testing.assert_array_equal(np.rint(item["P"].numpy() * 255), np.moveaxis(frame.P, -1, 0))
    np.testing.assert_array_equal(item["P_radiance"].numpy(), np.moveaxis(frame.P_radiance, -1, 0))


def test_it_is_not_exported_for_it_does_not_lie_on_the_depth(whole, tmp_path):
    with pytest.raises(InputError, match=r"are no colour images of this dataset.*It has: A"):
        export(whole, "tum", tmp_path / "out", images="P")
