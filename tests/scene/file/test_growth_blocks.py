"""What scene files may say of growth, what is refused, and what is not written."""

import pytest

from varos_warp.errors import InputError
from varos_warp.scene.description.growth import LARGEST_M
from varos_warp.scene.file.load import load_scene, scene_from_dict
from varos_warp.scene.geometry.growth.kinds import KINDS

BARE = {
    "trajectory": {"poses": [{"position": [0, 0, 2]}]},
    "terrain": {"kind": "procedural"},
    "objects": [
        {"kind": "boulder"},
        {"kind": "boulder", "path": [{"time_s": 0, "position": [0, 0, 1]}, {"time_s": 5, "position": [1, 0, 1]}]},
    ],
}
GOOD = {"on": ["terrain", "objects.0"], "kind": "barnacle"}


def scene(**changes):
    return scene_from_dict({**BARE, "growth": [{**GOOD, **changes}]})


def test_a_good_block_is_read():
    assert scene(per_m2=10).growth[0].per_m2 == 10


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"on": ["objects.7"]}, r"growth\.0\.on\.0.*no surface 'objects\.7'.*objects\.0"),
        ({"on": ["terrain", "rocks"]}, r"growth\.0\.on\.1.*no surface 'rocks'"),
        ({"on": ["objects.1"]}, r"growth\.0\.on\.0.*moves"),
        ({"on": ["scatter.0"]}, r"growth\.0\.on\.0.*no surface"),
        ({"on": ["terrain", "terrain"]}, r"growth\.0.*twice"),
        ({"on": []}, r"growth\.0\.on"),
        ({"kind": "coral"}, r"growth\.0\.kind"),
        ({"per_m2": -1}, r"growth\.0\.per_m2"),
        ({"cluster": -1}, r"growth\.0\.cluster"),
        ({"up": [0.5, -0.5]}, r"growth\.0\.up.*begins above its end"),
        ({"up": [-2, 1]}, r"growth\.0\.up"),
        ({"size_m": [0.0, 0.1]}, r"growth\.0\.size_m"),
        ({"size_m": [0.2, 0.1]}, r"growth\.0\.size_m.*begins above its end"),
        ({"size_m": [0.1, 10]}, r"growth\.0.*size_m.*larger than any barnacle is; 0\.3 m is the most"),
        ({"kind": "turf", "size_m": [0.1, 0.6]}, r"growth\.0.*size_m.*larger than any turf.*0\.5 m"),
        ({"depth_m": [20, 10]}, r"growth\.0\.depth_m.*begins above its end"),
    ],
)
def test_bad_blocks_are_refused_by_key(changes, problem):
    with pytest.raises(InputError, match=problem):
        scene(**changes)


def test_every_kind_has_a_largest_size():
    for kind, largest in LARGEST_M.items():
        own = KINDS[kind].size_m
        assert scene(kind=kind, size_m=[own[0], largest]).growth[0].size_m[1] == largest
        assert own[1] <= 0.5 * largest
    assert set(LARGEST_M) == set(KINDS)


def test_two_blocks_do_not_put_copies_in_the_same_places():
    with pytest.raises(InputError, match=r"growth\.1\.seed.*another seed"):
        scene_from_dict({**BARE, "growth": [GOOD, {**GOOD, "on": ["objects.0"]}]})
    scene_from_dict({**BARE, "growth": [GOOD, {**GOOD, "seed": 2}, {**GOOD, "kind": "hydroid"}]})


def test_on_is_a_key_and_no_truth_value(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text(
        "terrain: {kind: procedural}\ntrajectory: {poses: [{position: [0, 0, 2]}]}\n"
        "growth:\n  - {on: [terrain], kind: shell}\n"
    )
    assert load_scene(path).growth[0].on == ["terrain"]


def test_only_boulders_have_several_shapes():
    block = {"object": {"kind": "nut", "size": "M24"}, "count": 3, "shapes": 2}
    with pytest.raises(InputError, match=r"scatter\.0\.shapes.*nut"):
        scene_from_dict({**BARE, "scatter": [block]})


def test_nothing_of_it_is_written_where_it_is_absent():
    written = scene_from_dict({**BARE, "scatter": [{"object": {"kind": "boulder"}, "count": 1}]}).model_dump()
    assert "growth" not in written
    assert "segments" not in written["render"]
    assert "shapes" not in written["scatter"][0]
    whole = scene().model_copy(update={"render": scene().render.model_copy(update={"segments": "fine"})}).model_dump()
    assert whole["growth"][0]["kind"] == "barnacle"
    assert whole["render"]["segments"] == "fine"
