"""Hull section, mooring chain, quay wall and ROV panel: closed solids with the measures they are asked for."""

import numpy as np
import pytest
import trimesh
from pydantic import ValidationError

from tests.scene.geometry.test_assets import assert_sound, block_of
from varos_warp.errors import InputError
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.geometry.assets import default_chord_error, make_asset, make_coloured
from varos_warp.scene.geometry.assets.structures.chain import chain_nodes
from varos_warp.scene.geometry.assets.structures.hull import section_at
from varos_warp.scene.geometry.assets.structures.panel import places
from varos_warp.scene.geometry.build import build_single_parts
from varos_warp.scene.geometry.query import is_inside
from varos_warp.scene.geometry.surface import Surface

STRUCTURES = {
    "hull": {"kind": "hull_section", "length_m": 5.0},
    "stiffened outside": {
        "kind": "hull_section",
        "length_m": 5.0,
        "stiffeners": "outside",
        "bilge_radius_m": 0.3,
        "bilge_keel_m": 0.3,
    },
    "chain": {"kind": "mooring_chain", "links": 4},
    "hanging chain": {"kind": "mooring_chain", "links": 5, "sag_m": 0.4},
    "quay": {"kind": "quay_wall", "length_m": 4.8},
    "anode": {"kind": "anode"},
    "bracelet": {"kind": "anode", "form": "bracelet", "pipe_radius_m": 0.2},
    "flange joint": {"kind": "flange_joint", "radius": 0.15},
    "hand wheel": {"kind": "hand_wheel"},
    "concrete block": {"kind": "concrete_block"},
    "panel": {"kind": "wellhead_panel", "fittings": [["bucket", "t_bar"], ["valve_stem", "hot_stab"]]},
    "rov": {"kind": "rov", "lamps": [[-0.33, 0.38, 0.0], [0.2, 0.45, 0.05]]},
    "rov with a tether": {"kind": "rov", "tether_m": 3.0},
}
SMOOTH_HULL = {"kind": "hull_section", "only": ["plating"], "dent_m": 0, "seam_m": 0}


def make(data, **options) -> trimesh.Trimesh:
    return trimesh.Trimesh(*make_asset(block_of(data), **options), process=False)


@pytest.mark.parametrize("coarser", [1.0, 10.0, 1000.0])
@pytest.mark.parametrize("data", STRUCTURES.values(), ids=STRUCTURES)
def test_structures_are_closed_solids_whose_normals_point_outwards(data, coarser):
    assert_sound(make(data | {"chord_error_m": coarser * default_chord_error(block_of(data))}))


@pytest.mark.parametrize("data", STRUCTURES.values(), ids=STRUCTURES)
def test_structures_make_grids_too(data):
    mesh = make(data, max_edge_m=0.1)
    assert_sound(mesh)
    assert mesh.edges_unique_length.max() <= 0.1 * (1.0 + 1e-12)


def test_structures_have_colours_unless_a_material_is_named():
    panel = {"kind": "wellhead_panel", "position": [0, 0, 0]}
    scene = scene_from_dict(
        {
            "objects": [panel, panel | {"material": "paint"}],
            "materials": {"paint": {}},
            "trajectory": {"poses": [{"position": [0, 0, 0]}]},
        }
    )
    bare, painted = build_single_parts(scene)
    assert bare.skin.corners.shape == (len(bare.faces), 3, 3)
    assert len(np.unique(bare.skin.corners[:, 0], axis=0)) == 6
    assert painted.skin is None


def test_pieces_are_made_apart_where_only_some_are_named():
    data = {"kind": "quay_wall"}
    apart = [make_asset(block_of(data | {"only": [name]})) for name in ("piles", "coping", "fenders", "ladder")]
    whole = make_asset(block_of(data))
    assert sum(len(faces) for _, faces in apart) == len(whole[1])
    np.testing.assert_array_equal(np.concatenate([vertices for vertices, _ in apart]), whole[0])


def test_pieces_that_an_object_does_not_have_are_refused():
    with pytest.raises(InputError) as caught:
        make_asset(block_of({"kind": "hull_section", "marks": False, "only": ["marks"]}), "objects.2")
    assert caught.value.key == "objects.2.only"
    with pytest.raises(ValidationError, match="only"):
        block_of({"kind": "hull_section", "only": ["fenders"]})


@pytest.mark.parametrize(
    "data",
    [
        {"kind": "hull_section", "bilge_radius_m": 3.0},
        {"kind": "mooring_chain", "sag_m": 1.0, "end": [1, 0, 0]},
        {"kind": "mooring_chain", "sag_m": 5.0},
        {"kind": "mooring_chain", "end": [7, 0, 0]},
        {"kind": "mooring_chain", "end": [0, 0, -3]},
        {"kind": "quay_wall", "coping_m": 7.9},
        {"kind": "quay_wall", "ladder_m": 5.0},
        {"kind": "quay_wall", "length_m": 1.0},
        {"kind": "anode", "form": "bracelet"},
        {"kind": "anode", "pipe_radius_m": 0.2},
        {"kind": "anode", "length_m": 0.1},
        {"kind": "anode", "width_m": 0.05},
        {"kind": "anode", "form": "bracelet", "pipe_radius_m": 0.02},
        {"kind": "concrete_block", "eyes": 7},
        {"kind": "concrete_block", "size_m": [1, 1, 0.05]},
        {"kind": "wellhead_panel", "width_m": 1.0},
        {"kind": "wellhead_panel", "fittings": []},
    ],
)
def test_measures_that_do_not_fit_are_refused(data):
    with pytest.raises(ValidationError):
        block_of(data)


def test_a_hanging_chain_of_too_many_triangles_is_refused():
    with pytest.raises(InputError) as caught:
        make_asset(block_of({"kind": "mooring_chain", "links": 2000, "chord_error_m": 1e-6}))
    assert caught.value.key == "object.chord_error_m"


# ----------------------------------------------------------------------------------------------------------------- hull


def test_smooth_plating_has_the_volume_of_its_plates():
    mesh = make(SMOOTH_HULL | {"chord_error_m": 1e-5})
    side, bottom, t = 3.0, 2.0, 0.014  # less the bilge of 1 m
    section = t * (side + bottom) + np.pi / 4.0 * (1.0 - (1.0 - t) ** 2)
    assert mesh.volume == pytest.approx(8.0 * section, abs=mesh.area * 1e-5)


def test_the_bilge_lies_within_the_chord_error():
    mesh = make(SMOOTH_HULL | {"chord_error_m": 1e-3})
    points = trimesh.sample.sample_surface(mesh, 5000, seed=1)[0]
    points = points[(points[:, 1:] < 0.98).all(axis=1) & (np.abs(points[:, 0]) < 3.999)]  # not the cut ends
    off = np.linalg.norm(points[:, 1:] - 1.0, axis=1)
    assert np.minimum(np.abs(off - 1.0), np.abs(off - 0.986)).max() <= 1e-3


def test_seams_stand_out_by_their_height_and_dents_go_in():
    flat = np.array(make(SMOOTH_HULL | {"seam_m": 0.003}).vertices)
    side = flat[flat[:, 2] > 1.1]
    assert side[:, 1].min() == pytest.approx(-0.003)
    dented = make(SMOOTH_HULL | {"dent_m": 0.004}).vertices
    outer = dented[(dented[:, 2] > 1.1) & (dented[:, 1] < 0.007)]
    assert outer[:, 1].min() == pytest.approx(0.0, abs=1e-9)
    assert 0.002 < outer[:, 1].max() <= 0.004


def test_draught_figures_have_their_feet_every_20_cm_and_are_10_cm_high():
    mesh = make({"kind": "hull_section", "only": ["marks"]})
    feet = sorted({round(solid.bounds[0, 2], 2) for solid in mesh.split()})
    np.testing.assert_allclose(feet, np.arange(1.0, 3.85, 0.2), atol=0.006)  # round figures reach below the line
    assert mesh.bounds[0, 1] > 0.0 - 0.0051
    heights = [np.ptp(solid.bounds[:, 2]) for solid in mesh.split()]
    assert 0.099 < min(heights) < max(heights) < 0.106


def test_the_section_runs_from_the_side_round_the_bilge_to_the_bottom():
    block = block_of({"kind": "hull_section"})
    place, normal = section_at(block, np.array([0.0, 3.0, 3.0 + 0.25 * np.pi, 3.0 + 0.5 * np.pi, 5.0 + 0.5 * np.pi]))
    h = np.sqrt(0.5)
    np.testing.assert_allclose(place, [[0, 4], [0, 1], [1 - h, 1 - h], [1, 0], [3, 0]], atol=1e-12)
    np.testing.assert_allclose(normal, [[-1, 0], [-1, 0], [-h, -h], [0, -1], [0, -1]], atol=1e-12)


# ---------------------------------------------------------------------------------------------------------------- chain


def test_a_link_has_the_proportions_of_iso_1704_and_takes_four_diameters():
    link = make({"kind": "mooring_chain", "link_m": 0.1, "links": 1, "roll_deg": 0, "seed": 1})
    low, high = link.bounds
    assert high[0] - low[0] == pytest.approx(0.6)
    width = np.linalg.norm(link.vertices[:, 1:], axis=1).max()
    assert width == pytest.approx(0.18, abs=1e-4)
    chain = make({"kind": "mooring_chain", "link_m": 0.1, "links": 6})
    assert np.ptp(chain.bounds[:, 0]) == pytest.approx(6 * 0.4 + 0.2)


def test_neighbouring_links_touch_and_do_not_cross():
    mesh = make({"kind": "mooring_chain", "link_m": 0.1, "links": 2, "chord_error_m": 1e-4})
    bars = sorted(
        (solid for solid in mesh.split() if np.ptp(solid.bounds[:, 0]) > 0.5), key=lambda solid: solid.bounds[0, 0]
    )
    near = np.asarray(bars[1].vertices[bars[1].vertices[:, 0] < 0.45])
    away = Surface(bars[0].vertices, bars[0].faces).nearest(near)[0]
    inside = is_inside(bars[0].vertices, bars[0].faces, near)
    assert away.min() < 2e-3
    assert away[inside].max(initial=0.0) < 2e-4


def test_a_chain_hangs_in_a_catenary_as_deep_as_asked():
    block = block_of({"kind": "mooring_chain", "links": 40, "sag_m": 2.0})
    nodes = chain_nodes(block)
    assert nodes[20, 2] == pytest.approx(-2.0)
    assert nodes[-1, 2] == pytest.approx(0.0, abs=1e-12)
    x, z = nodes[:, 0] - nodes[20, 0], nodes[:, 2] + 2.0
    a = ((0.5 * block.length) ** 2 - 2.0**2) / (2.0 * 2.0)
    np.testing.assert_allclose(z, a * (np.cosh(x / a) - 1.0), atol=1e-9)


def test_a_chain_ends_where_it_is_asked_to_and_is_as_long_as_its_links():
    block = block_of({"kind": "mooring_chain", "links": 400, "link_m": 0.02, "end": [12, 5, -9]})
    nodes = chain_nodes(block)
    np.testing.assert_allclose(nodes[[0, -1]], [[0, 0, 0], [12, 5, -9]], atol=1e-9)
    assert np.linalg.norm(np.diff(nodes, axis=0), axis=1).sum() == pytest.approx(block.length, rel=1e-3)


# ------------------------------------------------------------------------------------------------------- quay and panel


def test_a_quay_wall_has_its_measures():
    piles = make({"kind": "quay_wall", "only": ["piles"]})
    assert piles.bounds[:, 1] == pytest.approx([0.0, 0.31], abs=1e-6)
    assert np.ptp(piles.bounds[:, 0]) == pytest.approx(9.6, abs=0.02)
    whole = make({"kind": "quay_wall"})
    assert whole.bounds[:, 2] == pytest.approx([0.0, 8.0])
    front = piles.vertices[np.abs(piles.vertices[:, 1]) < 1e-6][:, 0]
    groups = np.split(np.unique(front.round(4)), np.flatnonzero(np.diff(np.unique(front.round(4))) > 0.5) + 1)
    middles = np.array([0.5 * (group.min() + group.max()) for group in groups])
    np.testing.assert_allclose(np.diff(middles), 1.2, atol=1e-3)  # every second pile


def test_rungs_are_30_cm_apart():
    ladder = make({"kind": "quay_wall", "only": ["ladder"]})
    rungs = [solid.bounds.mean(axis=0) for solid in ladder.split() if np.ptp(solid.bounds[:, 0]) > 0.3]
    heights = np.sort([middle[2] for middle in rungs])
    assert len(heights) > 15
    np.testing.assert_allclose(np.diff(heights), 0.3)
    np.testing.assert_allclose([middle[0] for middle in rungs], 0.6, atol=1e-9)


def test_a_panel_has_a_hole_behind_each_receptacle_and_is_whole_elsewhere():
    block = block_of({"kind": "wellhead_panel", "only": ["panel"]})
    mesh = trimesh.Trimesh(*make_asset(block), process=False)
    for _, kind, (x, z) in places(block):
        at = is_inside(mesh.vertices, mesh.faces, np.array([[x, 0.5 * block.plate_m, z]]))[0]
        assert at == (kind not in ("bucket", "hot_stab"))


def test_fittings_stand_in_rows_from_above_and_from_the_left():
    block = block_of({"kind": "wellhead_panel", "fittings": [["bucket", "none", "t_bar"], ["hot_stab"]]})
    names = [(label, kind) for label, kind, _ in places(block)]
    assert names == [("A1", "bucket"), ("A3", "t_bar"), ("B1", "hot_stab")]
    (a1, a3, b1) = (np.array(at) for _, _, at in places(block))
    assert a1[0] < b1[0] < a3[0]
    assert a1[1] == a3[1] > b1[1]


def test_colours_are_reflectances_of_faces():
    _, faces, colours = make_coloured(block_of({"kind": "quay_wall"}))
    assert colours.shape == (len(faces), 3)
    assert colours.dtype == np.float32
    assert 0.0 < colours.min() < colours.max() <= 0.5
    assert make_coloured(block_of({"kind": "nut", "size": "M24"}))[2] is None


# ------------------------------------------------------------------------------------------------------------------ rov


def test_nothing_of_an_rov_is_before_its_lamps_in_their_cones():
    """A light 4 cm before each pane, a cone of 90 degrees: no ray of it meets the body."""
    lamps = np.array([(-0.33, 0.38, 0.0), (0.33, 0.38, 0.0)])
    mesh = make({"kind": "rov", "lamps": lamps.tolist()})
    surface = Surface(np.array(mesh.vertices), np.array(mesh.faces, np.int32))
    turn, off = (a.ravel() for a in np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 24), np.radians([5.0, 25.0, 45.0])))
    rays = np.column_stack([np.sin(off) * np.cos(turn), np.cos(off), np.sin(off) * np.sin(turn)])
    for lamp in lamps:
        start = np.broadcast_to(lamp + [0.0, 0.04, 0.0], rays.shape)
        assert np.isinf(surface.distances(start, rays)).all()


def test_panes_of_an_rov_lie_where_its_lamps_are_said_to():
    lamps = [(-0.33, 0.38, 0.0)]
    mesh = make({"kind": "rov", "lamps": lamps, "only": ["lamps"]})
    surface = Surface(np.array(mesh.vertices), np.array(mesh.faces, np.int32))
    t = surface.distances(np.array([[-0.33, 1.38, 0.0]]), np.array([[0.0, -1.0, 0.0]]))
    assert t == pytest.approx([1.0], abs=1e-9)


@pytest.mark.parametrize("length", [0.5, 9.0])
def test_a_tether_is_as_long_as_asked_and_begins_at_the_stern(length):
    """Its volume is a cable's of 15 mm; no two of its ends meet, and it leaves the body upwards."""
    mesh = make({"kind": "rov", "tether_m": length, "only": ["tether"]})
    assert mesh.volume == pytest.approx(np.pi * 0.0075**2 * length, rel=0.03)
    assert np.linalg.norm(mesh.vertices - [0.0, -0.315, 0.189], axis=1).min() < 0.01
    assert mesh.vertices[:, 2].min() > 0.18
    assert mesh.vertices[:, 2].max() > 0.18 + 0.5 * length
    with pytest.raises(InputError):
        make_asset(block_of({"kind": "rov", "only": ["tether"]}))


# ------------------------------------------------------------------------------------------------------------- fittings


def cut(radius, angle):
    """By how much rounding shortens what ends in an edge of an angle: its arc touches both sides."""
    return radius * (1.0 / np.tan(0.5 * angle) - 1.0)


def test_a_bar_of_zinc_has_its_measures_and_leans_by_its_mould():
    mesh = make({"kind": "anode", "length_m": 0.5, "width_m": 0.12, "thick_m": 0.05, "only": ["zinc"]})
    lean = 0.13 * 0.12
    less = 2.0 * cut(0.06 * 0.05, np.arctan2(0.046, lean))
    np.testing.assert_allclose(np.ptp(mesh.bounds, axis=0), [0.5 - less, 0.046, 0.12 - less], atol=1e-4)
    outer = mesh.vertices[mesh.vertices[:, 1] < -0.05 + 1e-9]
    assert np.ptp(outer[:, 2]) < 0.12 - 2.0 * lean


def test_half_shells_of_a_bracelet_leave_gaps_and_clear_the_pipe():
    mesh = make(
        {"kind": "anode", "form": "bracelet", "pipe_radius_m": 0.2, "thick_m": 0.06, "length_m": 0.5, "only": ["zinc"]}
    )
    shells = mesh.split()
    assert len(shells) == 2
    radius = np.linalg.norm(mesh.vertices[:, :2], axis=1)
    assert radius.min() == pytest.approx(0.204, abs=2e-4)
    assert radius.max() == pytest.approx(0.264, abs=2e-4)
    assert abs(shells[0].vertices[:, 0]).min() == pytest.approx(0.015, rel=0.02)
    assert mesh.bounds[1, 2] == pytest.approx(0.25 - cut(0.08 * 0.06, np.arctan2(0.06, 0.8 * 0.06)), abs=1e-4)


def test_a_joint_has_a_stud_and_two_nuts_in_every_hole():
    bolts = make({"kind": "flange_joint", "radius": 0.1619, "only": ["bolts"]}).split()
    assert len(bolts) == 3 * 12  # DN 300
    places = np.array([np.hypot(*solid.centroid[:2]) for solid in bolts])
    np.testing.assert_allclose(places, 0.205, rtol=1e-3)  # half of the bolt circle of 410 mm, scaled to 323.8 mm


def test_flanges_of_a_joint_mirror_each_other_and_hold_the_gasket_between_them():
    flanges, gasket = (make({"kind": "flange_joint", "radius": 0.1, "only": [name]}) for name in ("flanges", "gasket"))
    assert flanges.bounds[0, 2] == pytest.approx(-flanges.bounds[1, 2])
    assert np.abs(gasket.vertices[:, 2]).max() > np.abs(flanges.vertices[:, 2]).min()


def test_a_hand_wheel_has_its_radius_and_its_spokes():
    mesh = make({"kind": "hand_wheel", "radius": 0.3, "spokes": 7, "stem_m": 0.0})
    assert np.linalg.norm(mesh.vertices[:, :2], axis=1).max() == pytest.approx(0.3, abs=2e-4)
    assert len(mesh.split()) == 7 + 3  # rim, hub, nut


def test_a_concrete_block_has_its_size_and_rounded_edges():
    block = make({"kind": "concrete_block", "size_m": [1.0, 0.5, 0.4], "chamfer_m": 0.03, "only": ["block"]})
    np.testing.assert_allclose(block.bounds, [[-0.5, -0.25, 0.0], [0.5, 0.25, 0.4]], atol=1e-9)
    assert 1.0 - 0.1 < block.volume / 0.2 < 1.0
    eyes = make({"kind": "concrete_block", "eyes": 3, "only": ["eyes"]}).split()
    np.testing.assert_allclose(sorted(solid.bounds.mean(axis=0)[0] for solid in eyes), [-0.4, 0.0, 0.4], atol=1e-6)
