"""Lights of other vehicles: dataset.json has them, exports too, and a changed one is found; here without a body."""

import json

import numpy as np
import pytest
import standins
from evo.tools import file_interface
from rosbags.highlevel import AnyReader

from varos_warp.dataset.export import export
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.report import write_report
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.validate import validate
from varos_warp.scene.file.load import scene_from_dict

LAMPS = [
    {"kind": "point", "position": [0, 0, 1]},
    {"kind": "spot", "position": [0.2, 0.5, 0], "direction": [1, 0, 0], "cone_deg": 40, "strobe": {"on_s": 0.01}},
]
PLACES = [
    {"time_s": 0, "position": [1, 2, 0], "rotation_euler_deg": [0, 0, 90]},
    {"time_s": 1, "position": [3, 2, 0], "rotation_euler_deg": [0, 0, 90]},
]


@pytest.fixture(scope="module")
def lit(tmp_path_factory):
    scene = standins.scene_dict()
    own = scene.pop("vehicle") | {"id": "0", "trajectory": scene.pop("trajectory")}
    scene["vehicles"] = [own, {"id": "2", "lights": LAMPS, "trajectory": {"poses": PLACES}}]
    out = tmp_path_factory.mktemp("lit") / "out"
    with pytest.MonkeyPatch.context() as patch:
        standins.install(patch)
        produce(scene_from_dict(scene), out, quiet=True, frames=slice(0, 2))
    return out


def test_the_dataset_has_them_and_where_they_are(lit):
    data = Dataset(lit)
    (entry,) = data.meta["moving"]
    assert (data.moving, set(entry)) == (["vehicles.2"], {"key", "lights"})
    assert entry["lights"][1]["strobe"] == {"on_s": 0.01, "delay_s": 0.0}
    T_w_l = data.poses("vehicles.2")[1] @ np.array(entry["lights"][1]["T_v_light"])
    np.testing.assert_allclose(T_w_l[0, :3, 3], [1 - 0.5, 2 + 0.2, 0], atol=1e-12)  # turned to the left
    np.testing.assert_allclose(T_w_l[0, :3, 2], [0, 1, 0], atol=1e-12)
    assert "vehicles.2, light 1" in write_report(data, lit.parent / "report.html", True).read_text()


def test_one_that_is_not_that_of_the_scene_is_found(lit, unchecked):
    assert validate(lit, quiet=True).problems == []
    copied = unchecked(lit)
    meta = json.loads((copied / "dataset.json").read_text())
    meta["moving"][0]["lights"][1]["cone_deg"] = 41.0
    (copied / "dataset.json").write_text(json.dumps(meta))
    assert validate(copied, quiet=True).problems == [
        "dataset.json: moving.0.lights.1.cone_deg is 41.0, but its scene makes it 40.0"
    ]


def test_exports_have_them_at_every_frame(lit, tmp_path):
    export(lit, "mcap", tmp_path / "out")
    data, moving = Dataset(lit), tmp_path / "out" / "moving"
    time_ns, T_w_v = data.poses("vehicles.2")
    for i, light in enumerate(data.meta["moving"][0]["lights"]):
        read = file_interface.read_tum_trajectory_file(moving / f"vehicles.2.lights.{i}.txt")
        np.testing.assert_allclose(read.timestamps, 1e-9 * time_ns, atol=1e-12)
        np.testing.assert_allclose(read.poses_se3, T_w_v @ np.array(light["T_v_light"]), atol=1e-12)
    told = (moving / "README.txt").read_text()
    assert "vehicles.2: has lights only" in told
    assert json.loads(told.partition("vehicles.2.lights.1: ")[2]) == data.meta["moving"][0]["lights"][1]
    with AnyReader([tmp_path / "out" / "bag"]) as bag:
        still = [of for of in bag.connections if of.topic == "/tf_static"]
        fixed = [each for of, _, raw in bag.messages(still) for each in bag.deserialize(raw, of.msgtype).transforms]
    where = {each.child_frame_id: (each.header.frame_id, each.transform.translation) for each in fixed}
    frame, place = where["vehicles.2.lights.1"]
    assert (frame, place.x, place.y, place.z) == ("vehicles.2", 0.5, -0.2, 0.0)  # x forward, y left
