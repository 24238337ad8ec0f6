import numpy as np
import pytest
import trimesh
from pydantic import TypeAdapter

from varos_warp.errors import InputError
from varos_warp.scene.description.world import Object
from varos_warp.scene.geometry.assets import (
    FLANGES_MM,
    HEX_SIZES_MM,
    default_chord_error,
    flange_measures,
    hex_measures,
    make_asset,
)
from varos_warp.scene.geometry.normals import corner_normals
from varos_warp.scene.geometry.query import is_inside
from varos_warp.scene.geometry.surface import Surface

ASSETS = {
    "pipe": {"kind": "pipe", "radius": 0.15, "length": 4.0},
    "thin pipe": {"kind": "pipe", "radius": 1.0, "length": 0.01, "wall": 0.001},
    "rod": {"kind": "pipe", "radius": 0.15, "length": 4.0, "wall": 0.15},
    "elbow": {"kind": "elbow", "radius": 0.15, "bend_radius": 0.4},
    "small elbow": {"kind": "elbow", "radius": 0.15, "bend_radius": 0.4, "angle_deg": 1.0},
    "solid elbow": {"kind": "elbow", "radius": 0.15, "bend_radius": 0.4, "wall": 1.0},
    "ring": {"kind": "elbow", "radius": 0.15, "bend_radius": 0.4, "angle_deg": 360},
    "almost ring": {"kind": "elbow", "radius": 0.15, "bend_radius": 0.4, "angle_deg": 359.9},
    "flange": {"kind": "flange", "radius": 0.15},
    "small flange": {"kind": "flange", "radius": 0.005},
    "support": {"kind": "pipe_support", "radius": 0.15},
    "flat support": {"kind": "pipe_support", "radius": 0.15, "cradle_deg": 90.0},
    "deep support": {"kind": "pipe_support", "radius": 0.15, "cradle_deg": 165.0},
    "tall support": {"kind": "pipe_support", "radius": 0.15, "height": 2.0},
    "leaning support": {"kind": "pipe_support", "radius": 0.15, "height": 0.5, "length": 0.4, "batter_deg": 12.0},
    "bolt": {"kind": "bolt", "size": "M24"},
    "short bolt": {"kind": "bolt", "size": "M48", "length": 0.005},
    "nut": {"kind": "nut", "size": "M5"},
    "valve": {"kind": "valve", "radius": 0.1},
    "bolted valve": {"kind": "valve", "radius": 0.1, "bolted": True},
    "boulder": {"kind": "boulder", "diameter": 1.0, "seed": 3},
    "boulder of joints": {"kind": "boulder", "diameter": 1.0, "seed": 3, "form": "joints"},
}
BEVELLED = {name: block for name, block in ASSETS.items() if block["kind"] not in ("valve", "boulder")}
CHORD_ERROR = 2e-5


def block_of(data):
    return TypeAdapter(Object).validate_python(data)


def make(data, chord_error_m=None) -> trimesh.Trimesh:
    block = block_of(data)
    asked = block if chord_error_m is None else block.model_copy(update={"chord_error_m": chord_error_m})
    return trimesh.Trimesh(*make_asset(asked), process=False)


def assert_sound(mesh):
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    slender = 2.0 * mesh.area_faces / np.ptp(mesh.triangles, axis=1).max(axis=1) ** 2
    assert slender.min() > 1e-7  # no three points in line
    assert volumes(mesh).min() > 0.0


def volumes(mesh):
    """Volume of each of the solids of a closed mesh."""
    solid = trimesh.graph.connected_component_labels(mesh.face_adjacency, node_count=len(mesh.faces))
    a, b, c = np.moveaxis(mesh.triangles - mesh.centroid, 1, 0)
    return np.bincount(solid, (a * np.cross(b, c)).sum(axis=1)) / 6.0


@pytest.mark.parametrize("coarser", [0.2, 1.0, 10.0, 1000.0])
@pytest.mark.parametrize("data", ASSETS.values(), ids=ASSETS)
def test_every_asset_is_made_of_closed_solids_whose_normals_point_outwards_at_every_level_of_detail(data, coarser):
    assert_sound(make(data, coarser * default_chord_error(block_of(data))))


@pytest.mark.parametrize("kind", ["bolt", "nut"])
def test_every_size_of_bolt_and_nut_is_sound(kind):
    for size in HEX_SIZES_MM:
        assert_sound(make({"kind": kind, "size": size}, 2e-4))


@pytest.mark.parametrize("chord_error", [1e-4, 4e-4, 1e-2])
def test_every_size_of_flange_is_sound(chord_error):
    for pipe, *_ in FLANGES_MM.values():
        assert_sound(make({"kind": "flange", "radius": pipe / 2e3}, chord_error))


@pytest.mark.parametrize("data", BEVELLED.values(), ids=BEVELLED)
def test_an_asset_is_one_piece(data):
    assert make(data).body_count == 1


# ------------------------------------------------------------------------------------------------------------- volumes


def close_to(volume, mesh, chord_error=CHORD_ERROR, rounding=0.0):
    """A surface that is off by no more than the chord error encloses a volume that is off by no more than this."""
    return pytest.approx(volume, abs=mesh.area * chord_error + rounding)


def rounding(b, r, side):
    """Volume between a right-angled edge of radius r around an axis and its rounding b (Pappus); side 1: the outer.

    The spandrel's area is b^2 (1 - pi / 4), its centroid b (5 / 6 - pi / 4) / (1 - pi / 4) from the edge.
    """
    return 2.0 * np.pi * b**2 * ((1.0 - np.pi / 4.0) * r - side * b * (5.0 / 6.0 - np.pi / 4.0))


def tube_volume(r, wall, length):
    b = 0.25 * wall
    return np.pi * (r**2 - (r - wall) ** 2) * length - 2.0 * (rounding(b, r, 1) + rounding(b, r - wall, -1))


def test_a_pipe_has_the_volume_of_its_wall():
    mesh = make({"kind": "pipe", "radius": 0.15, "length": 4.0, "wall": 0.02}, CHORD_ERROR)
    assert mesh.extents == pytest.approx([0.3, 0.3, 4.0])
    assert mesh.volume == close_to(tube_volume(0.15, 0.02, 4.0), mesh)
    rod = make({"kind": "pipe", "radius": 0.15, "length": 1.0, "wall": 0.2}, CHORD_ERROR)
    assert rod.volume == close_to(np.pi * 0.15**2 - 2.0 * rounding(0.25 * 0.15, 0.15, 1), rod)


@pytest.mark.parametrize("angle", [10.0, 90.0, 200.0, 350.0])
def test_an_elbow_has_the_volume_of_a_pipe_as_long_as_its_centre_line(angle):
    """Pappus: what the inside of a bend lacks the outside has more, in the rounded rims as well."""
    mesh = make({"kind": "elbow", "radius": 0.1, "bend_radius": 0.5, "angle_deg": angle, "wall": 0.01}, CHORD_ERROR)
    assert mesh.volume == close_to(tube_volume(0.1, 0.01, 0.5 * np.radians(angle)), mesh)


def test_a_full_turn_has_the_volume_of_a_torus():
    mesh = make({"kind": "elbow", "radius": 0.1, "bend_radius": 0.5, "angle_deg": 360}, CHORD_ERROR)
    assert mesh.volume == close_to(2.0 * np.pi**2 * 0.5 * 0.1**2, mesh)


def test_an_elbow_leaves_the_origin_along_z_towards_x():
    mesh = make({"kind": "elbow", "radius": 0.1, "bend_radius": 0.5})
    start = mesh.vertices[mesh.vertices[:, 2] < 1e-9]
    np.testing.assert_allclose(start.mean(axis=0), 0.0, atol=1e-9)
    end = mesh.vertices[mesh.vertices[:, 0] > 0.5 - 1e-9]
    np.testing.assert_allclose(end.mean(axis=0), [0.5, 0.0, 0.5], atol=1e-9)


def test_a_flange_has_the_volume_of_a_plate_less_its_bore_and_holes():
    radius = 0.5 * 0.1143
    mesh = make({"kind": "flange", "radius": radius}, CHORD_ERROR)
    T, inner, b = 0.022, 1.012 * radius, 0.04 * 0.022
    plate = np.pi * T * (0.110**2 - inner**2 - 8 * 0.009**2)
    edges = rounding(b, 0.110, 1) + rounding(b, inner, -1) + 8 * rounding(b, 0.009, -1)
    assert mesh.volume == close_to(plate - 2.0 * edges, mesh)


def frustum(r1, r2, h):
    return np.pi * h / 3.0 * (r1**2 + r1 * r2 + r2**2)


def prism(s, low, high):
    """A hexagon prism whose upper end is chamfered by a cone of 30 degrees that starts 0.475 s from the axis."""
    theta = np.linspace(0.0, np.pi / 6.0, 2001)
    outer, inner = 0.5 * s / np.cos(theta), 0.475 * s
    wedge = outer**3 / 3.0 - inner * outer**2 / 2.0 + inner**3 / 6.0  # of (rho - inner) rho over rho
    return np.sqrt(3.0) / 2.0 * s**2 * (high - low) - 12.0 * np.tan(np.pi / 6.0) * np.trapezoid(wedge, theta)


def test_a_short_bolt_has_the_volume_of_its_head_and_shank():
    d, s, k, length = 0.024, 0.036, 0.015, 0.004  # shorter than two pitches: no thread
    mesh = make({"kind": "bolt", "size": "M24", "length": length}, 2e-6)
    washer, c = 0.0008, 0.3 * length
    head = prism(s, 0.0, k - washer) + np.pi * (0.47 * s) ** 2 * washer
    shank = np.pi * 0.25 * d**2 * (length - c) + frustum(0.5 * d, 0.5 * d - c, c)
    b = 0.02 * s  # roundings take no more than (1 - pi / 4) b^2 off their edges, six corners (2 b) a fourth of that
    edges = (1.0 - np.pi / 4.0) * b**2 * (2.0 * np.sqrt(3.0) * s + np.pi * s + np.pi * s + np.pi * d + 6.0 * k)
    assert mesh.volume == close_to(head + shank, mesh, 2e-6, edges)
    assert edges < 0.005 * mesh.volume


def test_a_nut_has_the_volume_of_its_prism_less_bore_and_thread():
    d, s, m, P = 0.024, 0.036, 0.0215, 0.003
    mesh = make({"kind": "nut", "size": "M24"}, 2e-6)
    r, sunk, minor = 0.5 * d, 0.04 * d, 0.5 * d - 0.5413 * P
    turns = 6  # in 19.58 mm
    ring = np.pi * (0.125 * r**2 + 0.25 * minor**2) * P + 2.0 * frustum(r, minor, 0.3125 * P)
    bore = 2.0 * frustum(r, r + sunk, sunk) + np.pi * r**2 * (m - 2.0 * sunk - turns * P) + turns * ring
    b = 0.02 * s
    edges = (1.0 - np.pi / 4.0) * b**2 * (2.0 * 2.0 * np.sqrt(3.0) * s + 2.0 * np.pi * (s + d) + 6.0 * m)
    assert mesh.volume == close_to(2.0 * prism(s, 0.0, 0.5 * m) - bore, mesh, 2e-6, edges)
    assert edges < 0.012 * mesh.volume


# ------------------------------------------------------------------------------------------------------------ measures


def test_a_bolt_and_a_nut_have_the_measures_of_the_standard():
    bolt, nut = make({"kind": "bolt", "size": "M24", "length": 0.1}), make({"kind": "nut", "size": "M24"})
    # The flats are perpendicular to x: width across flats 36 mm, head 15 mm, nut 21.5 mm, shank 24 mm.
    assert bolt.extents[[0, 2]] == pytest.approx([0.036, 0.115])
    assert 0.03998 < bolt.extents[1] < 0.036 / np.cos(np.pi / 6.0)  # e min of ISO 4014, grade A: 39.98 mm
    assert bolt.vertices[:, 2].min() == 0.0
    shank = bolt.vertices[bolt.vertices[:, 2] > 0.02]
    assert np.linalg.norm(shank[:, :2], axis=1).max() == pytest.approx(0.012)
    assert nut.extents[[0, 2]] == pytest.approx([0.036, 0.0215])
    # ISO 724: minor diameter of the nut's M24 thread D1 = 20.752 mm
    assert 2.0 * np.linalg.norm(nut.vertices[:, :2], axis=1).min() == pytest.approx(0.020752, abs=1e-6)


@pytest.mark.parametrize(("length", "thread"), [(0.096, 0.054), (0.15, 0.060), (0.25, 0.073), (0.03, 0.03)])
def test_a_bolt_is_threaded_as_far_as_the_standard_says(length, thread):
    """ISO 888: b = 2 d + 6 mm up to 125 mm, + 12 mm up to 200 mm, + 25 mm beyond; a short one all the way."""
    mesh = make({"kind": "bolt", "size": "M24", "length": length})
    shank = mesh.vertices[mesh.vertices[:, 2] > 0.015]
    # ISO 724: d3 = d - 1.22687 P = 20.319 mm
    root = shank[np.abs(np.linalg.norm(shank[:, :2], axis=1) - 0.0101597) < 1e-6]
    low, high = root[:, 2].min() - 0.015, root[:, 2].max() - 0.015
    pitch = 0.003
    assert length - thread <= low < length - thread + 2.0 * pitch
    assert length - 2.0 * pitch <= high <= length


def test_hexagon_sizes_grow_with_the_thread():
    sizes = np.array([(float(name[1:]), *values) for name, values in HEX_SIZES_MM.items()])
    assert (np.diff(sizes[:, :4], axis=0) > 0.0).all()
    assert (np.diff(sizes[:, 4]) >= 0.0).all()
    ratio = sizes[:, 1] / sizes[:, 0]
    assert 1.45 < ratio.min() < ratio.max() < 1.85


@pytest.mark.parametrize(("size", "s", "k", "m"), [("M3", 5.5, 2, 2.4), ("M10", 16, 6.4, 8.4), ("M64", 95, 40, 51)])
def test_measures_by_size_in_metres(size, s, k, m):
    assert hex_measures(size) == pytest.approx((float(size[1:]) / 1e3, s / 1e3, k / 1e3, m / 1e3))


def test_a_flange_has_the_measures_of_the_standard_and_between_its_sizes_they_are_scaled():
    assert flange_measures(0.5 * 0.1143) == pytest.approx((0.110, 0.090, 0.009, 8, 0.022))  # DN 100
    assert flange_measures(0.12)[:3] == pytest.approx(np.array([0.170, 0.1475, 0.011]) * 0.24 / 0.2191)  # DN 200
    mesh = make({"kind": "flange", "radius": 0.5 * 0.1143})
    assert mesh.extents == pytest.approx([0.22, 0.22, 0.022])
    angle = np.pi / 8.0 + np.pi / 4.0 * np.arange(8)
    at = {"hole": angle, "between": angle + np.pi / 8.0}
    inside = {
        name: is_inside(
            mesh.vertices, mesh.faces, np.column_stack([0.09 * np.cos(a), 0.09 * np.sin(a), np.full(8, 0.011)])
        )
        for name, a in at.items()
    }
    assert not inside["hole"].any()
    assert inside["between"].all()


@pytest.mark.parametrize(("given", "top", "low"), [({}, 0.0, -168.54), ({"cradle_deg": 120.0}, -0.0487, -150.0)])
def test_a_support_touches_its_pipe_along_the_groove_and_reaches_its_foot(given, top, low):
    mesh = make({"kind": "pipe_support", "radius": 0.15, "height": 0.5, **given})
    assert mesh.bounds[:, 2] == pytest.approx([-0.5, top], abs=1e-4)
    groove = np.linalg.norm(mesh.vertices[:, [0, 2]], axis=1)
    assert groove.min() == pytest.approx(0.15)
    touching = mesh.vertices[np.abs(groove - 0.15) < 1e-9]
    angle = np.degrees(np.arctan2(touching[:, 2], touching[:, 0]))
    assert (angle.min(), angle.max()) == pytest.approx((low, -180.0 - low), abs=0.1)


@pytest.mark.parametrize("edge", [None, 0.02])
def test_a_support_with_a_batter_widens_to_its_foot_by_the_tangent(edge):
    given = {"kind": "pipe_support", "radius": 0.15, "height": 0.5, "cradle_deg": 120.0, "length": 0.4}
    plain, leaning = (make({**given, "max_edge_m": edge, "batter_deg": lean}) for lean in (0.0, 12.0))
    rise, lean = np.ptp(plain.bounds[:, 2]), np.tan(np.radians(12.0))
    top = leaning.vertices[leaning.vertices[:, 2] > leaning.bounds[1, 2] - 1e-6]
    assert np.ptp(top[:, 1]) == pytest.approx(np.ptp(plain.vertices[:, 1]), abs=0.012)  # but for the rounded edge
    wider = leaning.bounds[1, :2] - plain.bounds[1, :2]
    rounding = 0.1 * 0.15 * (1.0 / np.tan(np.radians(39.0)) - 1.0)  # of an arc in a corner of 78 degrees
    assert wider[0] == pytest.approx(lean * rise - rounding, abs=3e-4)
    assert lean * rise - 0.5 * 0.03 * 0.15 < wider[1] < lean * rise  # the ends' bevel takes less than half of itself


# -------------------------------------------------------------------------------------------------- bevels and details


@pytest.mark.parametrize("data", BEVELLED.values(), ids=BEVELLED)
def test_sharp_edges_are_rounded(data):
    """No two faces meet outwards at more than what is smoothed over, but for a thread's crests (60 degrees)."""
    mesh = make(data, 3e-5)
    convex = np.degrees(mesh.face_adjacency_angles[mesh.face_adjacency_convex])
    assert convex.max() < (60.1 if data["kind"] in ("bolt", "nut") else 30.0)


@pytest.mark.parametrize("data", BEVELLED.values(), ids=BEVELLED)
def test_edges_keep_a_bevel_at_the_coarsest_level(data):
    """Bevels of 45 degrees, and half a step of 25 degrees along a bend."""
    mesh = make(data, 1.0)
    assert np.degrees(mesh.face_adjacency_angles[mesh.face_adjacency_convex].max()) < 70.0


def test_smoothed_normals_bend_in_the_roundings_and_nowhere_else():
    block = block_of({"kind": "pipe", "radius": 0.15, "length": 4.0})
    vertices, faces = make_asset(block)
    normals = corner_normals(vertices, faces, np.radians(30.0))
    long = np.ptp(vertices[faces][..., 2], axis=1) > 1.0
    assert np.count_nonzero(long) == 4 * 52
    assert np.abs(normals[long][..., 2]).max() < 1e-9
    rim = np.linalg.norm(vertices[faces][..., :2], axis=2)
    ends = (np.ptp(vertices[faces][..., 2], axis=1) < 1e-12) & (np.ptp(rim, axis=1) > 2e-3)  # 12 mm less the roundings
    assert np.count_nonzero(ends) == 4 * 52
    assert np.abs(normals[ends][..., 2]).min() > 1.0 - 1e-9


def off_pipe(points):
    radius = np.linalg.norm(points[:, :2], axis=1)
    return np.minimum(np.abs(radius - 0.15), np.abs(radius - 0.138))


def off_torus(points):
    """Distance from the wall of an elbow, but for its rims."""
    centre = points[:, [0, 2]] - [0.4, 0.0]
    angle = np.arctan2(centre[:, 1], -centre[:, 0])
    radius = np.hypot(np.linalg.norm(centre, axis=1) - 0.4, points[:, 1])
    off = np.minimum(np.abs(radius - 0.15), np.abs(radius - 0.138))
    return off[(angle > 0.05) & (angle < np.pi / 2 - 0.05)]


@pytest.mark.parametrize("chord_error", [1e-5, 1e-4, 1e-3])
def test_triangles_lie_within_the_chord_error_of_the_surface_and_use_most_of_it(chord_error):
    pipe = make(ASSETS["pipe"], chord_error)
    points = trimesh.sample.sample_surface(pipe, 20000, seed=1)[0]
    off = off_pipe(points[np.abs(points[:, 2]) < 1.9])
    assert 0.7 * chord_error < off.max() <= chord_error * (1.0 + 1e-9)
    elbow = make(ASSETS["elbow"], chord_error)
    off = off_torus(trimesh.sample.sample_surface(elbow, 20000, seed=1)[0])
    assert 0.5 * chord_error < off.max() <= chord_error * (1.0 + 1e-3)  # sagittas add up to first order


def test_levels_of_detail_go_from_fine_to_cheap():
    for name, data in ASSETS.items():
        default = default_chord_error(block_of(data))
        counts = [len(make(data, default * factor).faces) for factor in (0.25, 1.0, 4.0, 16.0, 64.0)]
        assert counts == sorted(counts, reverse=True), name
        assert counts[-1] < 0.4 * counts[0], name
    assert len(make(ASSETS["bolt"], 5e-3).faces) < 700


def test_the_chord_error_is_a_length_in_the_world():
    """Ten times as large and the same error: as if it were made so large."""
    scaled = make({"kind": "pipe", "radius": 0.1, "length": 1.0, "scale": 10.0, "chord_error_m": 1e-3})
    large = make({"kind": "pipe", "radius": 1.0, "length": 10.0, "chord_error_m": 1e-3})
    np.testing.assert_allclose(10.0 * scaled.vertices, large.vertices, atol=1e-12)
    assert len(make({"kind": "pipe", "radius": 1.0, "length": 10.0, "chord_error_m": 1e-5}).faces) > len(large.faces)


def test_defaults_follow_the_radius_within_bounds():
    def default(**block):
        return default_chord_error(block_of(block))

    assert default(kind="pipe", radius=0.1, length=1) == pytest.approx(2e-4)
    assert default(kind="pipe", radius=10, length=1) == pytest.approx(25 / 65535)
    assert default(kind="bolt", size="M8") == pytest.approx(5e-5)


def test_boulders_follow_from_their_seed():
    a, b, c = (make({"kind": "boulder", "seed": seed}).vertices for seed in (1, 1, 2))
    np.testing.assert_array_equal(a, b)
    assert np.abs(a - c).max() > 0.01


def test_levels_of_a_boulder_lie_within_the_chord_error_of_the_finest():
    for seed in (11, 12):
        rock = {"kind": "boulder", "diameter": 1.0, "seed": seed}
        true = make(rock, 1e-4)
        finest = Surface(true.vertices, true.faces)
        for chord_error in (0.031, 0.0121, 0.006):
            points = np.asarray(trimesh.sample.sample_surface(make(rock, chord_error), 300, seed=1)[0])
            off = finest.nearest(points)[0].max()
            assert 0.4 * chord_error < off <= chord_error


def test_levels_of_a_boulder_between_joints_lie_within_the_chord_error_of_the_finest():
    for seed in (11, 12):
        rock = {"kind": "boulder", "diameter": 1.0, "seed": seed, "form": "joints"}
        true = make(rock, 3e-4)
        finest = Surface(true.vertices, true.faces)
        for chord_error in (0.062, 0.0241, 0.0092):
            points = np.asarray(trimesh.sample.sample_surface(make(rock, chord_error), 300, seed=1)[0])
            assert finest.nearest(points)[0].max() <= chord_error


def test_a_boulder_between_joints_is_about_as_wide_as_its_diameter():
    """No corner lies farther out than 1.15 radii, stretched by 1.05."""
    for seed in range(8):
        mesh = make({"kind": "boulder", "diameter": 2.0, "seed": seed, "form": "joints"})
        assert np.linalg.norm(mesh.vertices, axis=1).max() <= 1.15 * 1.05
        assert 0.6 < np.ptp(mesh.vertices, axis=0)[:2].mean() / 2.0 < 1.15


def test_the_form_of_a_boulder_is_written_only_where_it_is_given():
    plain = {"kind": "boulder", "seed": 3}
    assert "form" not in block_of(plain).model_dump()
    assert block_of({**plain, "form": "joints"}).model_dump()["form"] == "joints"
    rounded = make({**plain, "form": "rounded"})
    np.testing.assert_array_equal(make(plain).vertices, rounded.vertices)


@pytest.mark.parametrize(
    ("data", "key"),
    [
        ({"kind": "bolt", "size": "M7"}, "object.size"),
        ({"kind": "nut", "size": "M100"}, "object.size"),
        ({"kind": "elbow", "radius": 0.2, "bend_radius": 0.2}, "object.bend_radius"),
        ({"kind": "pipe_support", "radius": 0.2, "height": 0.2}, "object.height"),
    ],
)
def test_measures_that_make_no_solid_are_refused(data, key):
    with pytest.raises(InputError) as caught:
        make(data)
    assert caught.value.key == key
    assert caught.value.remedy
