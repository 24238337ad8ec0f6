"""Where things meet the ground both are under the same sediment, which thins out upwards."""

import numpy as np
import pytest
import trimesh

from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.geometry.noise import Patterns
from varos_warp.scene.geometry.parts import Instances, Part
from varos_warp.scene.geometry.procedural import grid_mesh
from varos_warp.scene.geometry.relief.contact import foot_of
from varos_warp.scene.geometry.surface import Surface

BOX = trimesh.creation.box((0.4, 0.4, 1.0))
X = np.linspace(-3.0, 3.0, 31)
GROUND = Surface(*grid_mesh(X, X, np.full((31, 31), 0.2)))


def box(z):
    return Part("objects.0", BOX.vertices + [0, 0, z], np.array(BOX.faces, np.int32), Diffuse())


def column(low, high):
    z = np.linspace(low, high, 200)
    return np.column_stack([np.full(200, 0.2), np.zeros(200), z])


def test_a_foot_is_covered_and_what_stands_out_is_not():
    """The ground lies at 0.2, the box from 0 to 1; its middle is at 0.5, and points are about that."""
    foot = foot_of(box(0.5), GROUND, np.array([0.0, 0.0, 0.5]), True)
    cover = [foot.covers(p, Patterns(p, np.full(200, 0.005), 1)) for p in (column(-0.5, -0.3), column(0.1, 0.5))]
    assert (cover[0] == 1.0).all()
    assert (cover[1] == 0.0).all()


def test_heights_are_over_the_ground():
    foot = foot_of(box(0.5), GROUND, np.array([0.0, 0.0, 0.5]), True)
    assert foot.height(np.array([[0.1, 0.0, 0.3]])) == pytest.approx([0.6])


@pytest.mark.parametrize("z", [1.0, -0.5])
def test_what_hovers_or_is_buried_has_no_foot(z):
    assert foot_of(box(z), GROUND, np.zeros(3), True) is None


def test_copies_share_the_mean_of_where_they_stand():
    """Sunk by 0.1 and 0.3 of their own height, at scales 1 and 2."""
    T = np.tile(np.eye(4), (2, 1, 1))
    T[1, :3, :3] *= 2.0
    T[0, 2, 3], T[1, 2, 3], T[1, 0, 3] = 0.2 + 0.5 - 0.1, 0.2 + 2.0 * (0.5 - 0.3), 1.5
    group = Instances("scatter.0", np.array(BOX.vertices), np.array(BOX.faces, np.int32), Diffuse(), T)
    foot = foot_of(group, GROUND, np.zeros(3), True)
    assert foot.height(np.array([[0.0, 0.0, -0.3]])) == pytest.approx([0.0], abs=1e-9)


def test_no_line_of_colour_is_left_where_a_stone_meets_the_ground():
    """Mean colours of the dark stone just over the ground and of the ground beside it differ by less than a fifth."""
    parts = build_parts(
        scene_from_dict(
            {
                "trajectory": {"poses": [{"position": [0, 0, 0.8], "look_at": [0, 2, 0]}]},
                "vehicle": {"cameras": [{"id": "M0", "resolution": [320, 180]}]},
                "terrain": {
                    "kind": "procedural",
                    "size_m": 6,
                    "resolution": 21,
                    "relief_m": 0.0,
                    "material": "sand",
                    "around_objects": True,
                },
                "objects": [{"kind": "boulder", "diameter": 0.8, "position": [0, 2, 0.1], "material": "rock"}],
                "materials": {
                    "sand": {"kind": "layered", "relief": "sand"},
                    "rock": {"kind": "layered", "relief": "rock", "silt": 0.0, "paint": [0.03, 0.03, 0.03]},
                },
            }
        )
    )
    ground, stone = parts
    colours = [part.skin.corners.reshape(-1, 3) for part in parts]
    places = [part.vertices[part.faces].reshape(-1, 3) for part in parts]
    seam = Surface(ground.vertices, ground.faces).nearest(places[1], 0.02)[0] < 0.02
    beside = Surface(stone.vertices, stone.faces).nearest(places[0], 0.02)[0] < 0.02
    assert colours[1][seam].mean() == pytest.approx(colours[0][beside].mean(), rel=0.2)
    assert colours[1][places[1][:, 2] > places[1][:, 2].max() - 0.2].mean() < 0.5 * colours[0][beside].mean()
