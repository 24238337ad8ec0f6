import numpy as np
import pytest
import trimesh
from pydantic import TypeAdapter

from varos_warp.errors import InputError
from varos_warp.scene.assets import HEX_SIZES_MM, make_asset
from varos_warp.scene.description import Object

ASSETS = {
    "pipe": {"kind": "pipe", "radius": 0.15, "length": 4.0},
    "thin pipe": {"kind": "pipe", "radius": 1.0, "length": 0.01, "wall": 0.001},
    "rod": {"kind": "pipe", "radius": 0.15, "length": 4.0, "wall": 0.15},
    "elbow": {"kind": "elbow", "radius": 0.15, "bend_radius": 0.4},
    "small elbow": {"kind": "elbow", "radius": 0.15, "bend_radius": 0.4, "angle_deg": 1.0},
    "solid elbow": {"kind": "elbow", "radius": 0.15, "bend_radius": 0.4, "wall": 1.0},
    "ring": {"kind": "elbow", "radius": 0.15, "bend_radius": 0.4, "angle_deg": 360},
    "almost ring": {"kind": "elbow", "radius": 0.15, "bend_radius": 0.4, "angle_deg": 359.9},
    "support": {"kind": "pipe_support", "radius": 0.15},
    "tall support": {"kind": "pipe_support", "radius": 0.15, "height": 2.0},
    "bolt": {"kind": "bolt", "size": "M24"},
    "short bolt": {"kind": "bolt", "size": "M48", "length": 0.005},
    "nut": {"kind": "nut", "size": "M5"},
    "valve": {"kind": "valve", "radius": 0.1},
    "boulder": {"kind": "boulder", "diameter": 1.0, "seed": 3},
}


def make(data) -> trimesh.Trimesh:
    return trimesh.Trimesh(*make_asset(TypeAdapter(Object).validate_python(data)), process=False)


@pytest.mark.parametrize("data", ASSETS.values(), ids=ASSETS)
def test_every_asset_is_made_of_closed_solids_whose_normals_point_outwards(data):
    mesh = make(data)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert all(solid.volume > 0.0 for solid in mesh.split())
    assert mesh.area_faces.min() > 0.0


@pytest.mark.parametrize("data", [a for a in ASSETS.values() if a["kind"] not in ("valve", "boulder")],
                         ids=[n for n, a in ASSETS.items() if a["kind"] not in ("valve", "boulder")])
def test_an_asset_is_one_piece(data):
    assert make(data).body_count == 1


def polygon_area(n, r):
    return 0.5 * n * r * r * np.sin(2.0 * np.pi / n)


def test_a_pipe_has_the_volume_of_its_wall():
    mesh = make({"kind": "pipe", "radius": 0.15, "length": 4.0, "wall": 0.02})
    assert mesh.extents == pytest.approx([0.3, 0.3, 4.0])
    # 48-gons; the four bevels of 5 mm take off at most their rings' cross section.
    exact = 4.0 * (polygon_area(48, 0.15) - polygon_area(48, 0.13))
    assert exact * (1.0 - 4 * 0.005 / 4.0) < mesh.volume < exact


def test_an_elbow_has_the_volume_of_pappus_and_leaves_the_origin_along_z_towards_x():
    mesh = make({"kind": "elbow", "radius": 0.1, "bend_radius": 0.5, "angle_deg": 90, "wall": 0.1})
    assert mesh.volume == pytest.approx(np.pi * 0.1**2 * 0.5 * np.pi / 2, rel=0.02)
    start = mesh.vertices[mesh.vertices[:, 2] < 1e-9]
    np.testing.assert_allclose(start.mean(axis=0), 0.0, atol=1e-3)
    end = mesh.vertices[mesh.vertices[:, 0] > 0.5 - 1e-9]
    np.testing.assert_allclose(end.mean(axis=0), [0.5, 0.0, 0.5], atol=1e-3)


def test_a_bolt_and_a_nut_have_the_measures_of_the_standard():
    bolt, nut = make({"kind": "bolt", "size": "M24", "length": 0.1}), make({"kind": "nut", "size": "M24"})
    # The flats are perpendicular to x: width across flats 36 mm, head 15 mm, nut 21.5 mm, shank 24 mm.
    assert bolt.extents[[0, 2]] == pytest.approx([0.036, 0.115], rel=1e-3)
    assert bolt.vertices[:, 2].min() == 0.0
    shank = bolt.vertices[bolt.vertices[:, 2] > 0.02]
    assert np.ptp(shank[:, 0]) == pytest.approx(0.024, rel=0.01)
    assert nut.extents[[0, 2]] == pytest.approx([0.036, 0.0215], rel=1e-3)
    assert np.linalg.norm(nut.vertices[:, :2], axis=1).min() == pytest.approx(0.012)


def test_hexagon_sizes_grow_with_the_thread():
    sizes = np.array([(float(name[1:]), *values) for name, values in HEX_SIZES_MM.items()])
    assert (np.diff(sizes, axis=0) > 0.0).all()
    ratio = sizes[:, 1] / sizes[:, 0]
    assert (ratio.min(), ratio.max()) == pytest.approx((1.5, 1.667), abs=0.07)


def test_a_support_touches_its_pipe_all_along_the_groove_and_reaches_its_foot():
    mesh = make({"kind": "pipe_support", "radius": 0.15, "height": 0.5})
    assert mesh.bounds[:, 2] == pytest.approx([-0.5, 0.0])
    groove = np.linalg.norm(mesh.vertices[:, [0, 2]], axis=1)
    assert groove.min() == pytest.approx(0.15)
    assert np.count_nonzero(np.abs(groove - 0.15) < 1e-9) >= 2 * 25


def test_sharp_edges_are_bevelled():
    """No two faces of a pipe, bolt or nut meet outwards at a right angle or more."""
    for name in ("pipe", "elbow", "bolt", "nut"):
        mesh = make(ASSETS[name])
        convex = mesh.face_adjacency_angles[mesh.face_adjacency_convex]
        assert np.degrees(convex.max()) < 89.0, name


def test_boulders_follow_from_their_seed():
    a, b, c = (make({"kind": "boulder", "seed": seed}).vertices for seed in (1, 1, 2))
    np.testing.assert_array_equal(a, b)
    assert np.abs(a - c).max() > 0.01


@pytest.mark.parametrize(("data", "key"), [
    ({"kind": "bolt", "size": "M7"}, "object.size"), ({"kind": "nut", "size": "M100"}, "object.size"),
    ({"kind": "elbow", "radius": 0.2, "bend_radius": 0.2}, "object.bend_radius"),
    ({"kind": "pipe_support", "radius": 0.2, "height": 0.2}, "object.height"),
])
def test_measures_that_make_no_solid_are_refused(data, key):
    with pytest.raises(InputError) as caught:
        make(data)
    assert caught.value.key == key
    assert caught.value.remedy
