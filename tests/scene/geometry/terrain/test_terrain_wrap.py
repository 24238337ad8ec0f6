"""The shrinkwrap on shapes with known surfaces: overhangs, holes, outlines, closed models."""

import numpy as np
import pytest
import trimesh

from varos_warp.errors import InputError
from varos_warp.scene.geometry import joining, terrain
from varos_warp.scene.geometry.procedural import grid_mesh
from varos_warp.scene.geometry.terrain.closing import without_skirt
from varos_warp.scene.geometry.topology import boundary_edges, is_consistent

REGION = (-5.0, -5.0, 5.0, 5.0)
OUTER = 7.2
PROFILE = [
    (OUTER, 0.0),
    (1.2, 0.0),
    (1.0, 0.2),
    (1.0, 1.3),
    (1.2, 1.5),
    (2.4, 1.6),
    (2.6, 1.8),
    (2.4, 2.0),
    (1.5, 2.5),
    (0.0, 2.7),
]
"""Radius and height [m] of a mushroom on flat ground: a cap of 2.6 m on a stem of 1 m."""


def mushroom(rows=120, columns=96):
    """The surface of revolution of ``PROFILE``: a sheet with a round outline."""
    profile = np.array(PROFILE)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(profile, axis=0), axis=1))])
    at = np.union1d(np.linspace(0.0, length[-1], rows - len(profile)), length)
    r, z = np.interp(at, length, profile[:, 0])[:-1], np.interp(at, length, profile[:, 1])[:-1]
    angle = np.arange(columns) * 2.0 * np.pi / columns
    vertices = np.column_stack(
        [np.outer(r, np.cos(angle)).ravel(), np.outer(r, np.sin(angle)).ravel(), np.repeat(z, columns)]
    )
    i = np.arange(len(r) * columns).reshape(len(r), columns)
    j, top = np.roll(i, -1, axis=1), len(vertices)
    faces = [(i[:-1], j[:-1], j[1:]), (i[:-1], j[1:], i[1:]), (i[-1:], j[-1:], np.full((1, columns), top))]
    return np.vstack([vertices, [0.0, 0.0, profile[-1, 1]]]), np.concatenate(
        [np.stack(corners, axis=-1).reshape(-1, 3) for corners in faces]
    ).astype(np.int32)


def profile_distance(points):
    """Distance of points [N, 3] from the exact surface of revolution."""
    p = np.column_stack([np.hypot(points[:, 0], points[:, 1]), points[:, 2]])
    best = np.full(len(p), np.inf)
    for a, b in zip(np.array(PROFILE)[:-1], np.array(PROFILE)[1:], strict=True):
        t = np.clip((p - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(a + t[:, None] * (b - a) - p, axis=1))
    return best


@pytest.fixture(scope="module")
def model():
    return mushroom()


@pytest.fixture(scope="module")
def wrapped(model):
    return terrain.shrinkwrap(*model, 65, REGION)


def test_what_lies_under_an_overhang_is_kept_where_a_height_field_loses_metres(model, wrapped):
    there = terrain.one_sided_distance(model, wrapped, 20_000, region=REGION)
    lost = terrain.one_sided_distance(model, terrain.drape(*model, 65, REGION), 20_000, region=REGION)
    cell = 10.0 / 64
    assert there["max"] < 0.5 * cell  # at its edges, which fall between its vertices
    assert there["rms"] < 0.05 * cell
    assert lost["max"] > 1.4  # the stem is 1.4 m inside the rim of the cap
    assert lost["rms"] > 100.0 * there["rms"]


def test_the_vertices_lie_on_the_surface_and_the_faces_near_it(wrapped, model):
    chord = 2.6 * (1.0 - np.cos(np.pi / 96))  # of the model's own 96 sides
    assert profile_distance(wrapped[0]).max() < chord + 1e-3
    back = terrain.one_sided_distance(wrapped, model, 20_000)
    assert back["max"] < 0.5 * 10.0 / 64


def test_a_finer_wrap_errs_less_by_more_than_the_first_order(model, wrapped):
    """Creases give the order 1 in the largest error and 3/2 in the rms, smooth parts 2."""
    fine = terrain.shrinkwrap(*model, 105, REGION)
    rms = [terrain.one_sided_distance(model, m, 20_000, region=REGION)["rms"] for m in (wrapped, fine)]
    assert rms[0] / rms[1] > 104 / 64


def test_refining_from_a_coarse_surface_comes_to_the_same(model, monkeypatch):
    """Two rounds from a quarter of the resolution, overhangs being wider than two of its cells."""
    monkeypatch.setattr("varos_warp.scene.geometry.terrain.wrapping.BASE", 40)
    wrapped = terrain.shrinkwrap(*model, 129, REGION)
    there = terrain.one_sided_distance(model, wrapped, 20_000, region=REGION)
    assert there["max"] < 10.0 / 128
    assert there["rms"] < 0.1 * 10.0 / 128


def test_a_wrapped_sheet_has_no_boundary_but_its_outline(wrapped):
    vertices, faces = wrapped
    facts = terrain.mesh_facts(vertices, faces)
    assert (facts["pieces"], facts["edges_of_many_faces"]) == (1, 0)
    assert is_consistent(faces)
    rim = vertices[np.unique(boundary_edges(faces))]
    assert (np.abs(rim[:, :2]).max(axis=1) == 5.0).all()  # exactly on the sides of the region
    normals = trimesh.Trimesh(vertices, faces, process=False).face_normals
    assert normals[np.hypot(*vertices[faces[:, 0], :2].T) > 3.0, 2].min() > 0.99  # the ground looks up


def test_a_round_outline_is_followed(model):
    vertices, faces = terrain.shrinkwrap(*model, 65)
    rim = vertices[np.unique(boundary_edges(faces))]
    cell = 2.0 * OUTER / 64
    radius = np.hypot(*rim[:, :2].T)
    assert np.sqrt(np.mean((radius - OUTER) ** 2)) < 0.2 * cell
    assert np.abs(radius - OUTER).max() < cell


def test_holes_are_closed_even_under_an_overhang(model):
    vertices, faces = model
    centre = vertices[faces].mean(axis=1)
    under = np.linalg.norm(centre - [1.8, 0.0, 1.55], axis=1) < 0.35
    beside = np.linalg.norm(centre - [0.0, -4.0, 0.0], axis=1) < 0.5
    assert under.any()
    assert beside.any()
    holed = terrain.clean(vertices, faces[~under & ~beside])
    wrap = terrain.shrinkwrap(*holed, 65, REGION)
    rim = wrap[0][np.unique(boundary_edges(wrap[1]))]
    assert (np.abs(rim[:, :2]).max(axis=1) == 5.0).all()
    assert profile_distance(wrap[0]).max() < 0.15  # both holes are in nearly flat parts: the membrane is near them


def test_a_model_full_of_holes_is_wrapped_as_well(model):
    kept = np.random.default_rng(0).random(len(model[1])) > 0.2
    wrap = terrain.shrinkwrap(*terrain.clean(model[0], model[1][kept]), 65, REGION)
    assert terrain.mesh_facts(*wrap)["pieces"] == 1
    assert np.sqrt(np.mean(profile_distance(wrap[0]) ** 2)) < 0.02


def test_the_place_in_the_world_makes_no_difference(model, wrapped):
    offset = np.array([569_000.0, 7_035_000.0, -120.0])
    region = np.array(REGION) + np.tile(offset[:2], 2)
    moved = terrain.shrinkwrap(model[0] + offset, model[1], 65, tuple(region))
    assert len(moved[0]) == pytest.approx(len(wrapped[0]), rel=1e-3)
    assert profile_distance(moved[0] - offset).max() < 0.01


# -------------------------------------------------------------------------------------------------------- closed models


@pytest.mark.parametrize(
    ("shape", "volume", "genus"),
    [
        (trimesh.creation.icosphere(4), 4.0 / 3.0 * np.pi, 0),
        (trimesh.creation.torus(1.0, 0.3), 2.0 * np.pi**2 * 0.09, 1),
        (trimesh.creation.box((1.0, 2.0, 1.5)), 3.0, 0),
    ],
    ids=["ball", "ring", "box"],
)
def test_a_closed_model_is_wrapped_watertight(shape, volume, genus):
    vertices, faces = terrain.shrinkwrap(np.asarray(shape.vertices), np.asarray(shape.faces, np.int32), 49)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.euler_number == 2 - 2 * genus
    assert mesh.volume == pytest.approx(volume, rel=0.02)


def test_a_hole_in_a_closed_model_is_bridged():
    ball = trimesh.creation.icosphere(4)
    faces = np.asarray(ball.faces[ball.triangles_center[:, 2] < 0.9], np.int32)
    mesh = trimesh.Trimesh(*terrain.shrinkwrap(*terrain.clean(np.asarray(ball.vertices), faces), 49), process=False)
    assert mesh.is_watertight
    flat = trimesh.convex.convex_hull(ball.vertices[np.unique(faces)]).volume  # with a flat lid
    assert flat * 0.995 < mesh.volume < ball.volume


def test_parts_that_overlap_become_one_and_caves_without_a_mouth_are_filled():
    balls = [trimesh.creation.icosphere(3).apply_translation([1.2 * i, 0.0, 0.0]) for i in range(2)]
    cave = trimesh.creation.icosphere(2, radius=0.4)
    cave.invert()
    joined = terrain.join([(m.vertices, m.faces) for m in (*balls, cave)])
    mesh = trimesh.Trimesh(*terrain.shrinkwrap(*joined, 65), process=False)
    assert mesh.body_count == 1
    assert mesh.is_watertight
    lens = np.pi * (4.0 + 1.2) * (2.0 - 1.2) ** 2 / 12.0
    assert mesh.volume == pytest.approx(2.0 * 4.0 / 3.0 * np.pi - lens, rel=0.03)


# ------------------------------------------------------------------------------------------------------- skirt, bottom


def test_skirt_and_bottom_make_a_sheet_watertight_with_the_volume_under_it(wrapped):
    skirted = terrain.add_skirt(*wrapped)
    mesh = trimesh.Trimesh(*terrain.add_bottom(*skirted), process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    z = wrapped[0][wrapped[1]][:, :, 2] - skirted[0][:, 2].min()
    pyramid = 100.0 * (skirted[0][:, 2].min() - mesh.vertices[:, 2].min()) / 3.0
    n = np.cross(*(wrapped[0][wrapped[1][:, i]] - wrapped[0][wrapped[1][:, 0]] for i in (1, 2)))
    assert mesh.volume == pytest.approx(np.sum(0.5 * n[:, 2] * z.mean(axis=1)) + pyramid, rel=1e-9)


def test_the_sheet_is_found_again_under_its_skirt(wrapped):
    skirted = terrain.add_skirt(*wrapped)
    vertices, faces = without_skirt(*skirted, skirted[0][:, 2].min())
    assert (len(vertices), len(faces)) == (len(wrapped[0]), len(wrapped[1]))


def test_decimation_of_a_wrapped_sheet_keeps_its_outline(model):
    options = {"region": REGION, "shrinkwrap_resolution": 65, "target_vertices": 1500}
    vertices, faces = terrain.preprocess(*model, **options, close="none")
    rim = vertices[np.unique(boundary_edges(faces))]
    np.testing.assert_allclose(np.abs(rim[:, :2]).max(axis=1), 5.0, atol=1e-4)
    assert len(vertices) == pytest.approx(1500, rel=0.15)
    solid = terrain.mesh_facts(*terrain.preprocess(*model, **options, close="solid"))
    assert (solid["watertight"], solid["pieces"]) == (True, 1)


def test_a_height_field_becomes_a_grid():
    axis = np.linspace(0.0, 10.0, 21)
    x, y = np.meshgrid(axis, axis)
    model = grid_mesh(axis, axis, 0.2 * np.sin(x) * np.cos(y))
    assert terrain.is_height_field(*model)
    vertices, _ = terrain.shrinkwrap(*model, 33)
    assert len(vertices) == 33 * 33


def test_the_resolution_by_itself_is_twice_that_of_the_model():
    model = mushroom(48, 40)
    auto = terrain.shrinkwrap(*model, "auto", REGION)
    edges = [joining.median_edge(*m) for m in (auto, model)]
    assert 0.4 * edges[1] < edges[0] < 0.7 * edges[1]


def test_a_wall_is_no_sea_floor():
    axis = np.linspace(0.0, 1.0, 5)
    vertices, faces = grid_mesh(axis, axis, np.zeros((5, 5)))
    with pytest.raises(InputError, match="seen from above"):
        terrain.shrinkwrap(vertices[:, [0, 2, 1]], faces, 9)


@pytest.mark.gpu
def test_a_gpu_wraps_as_a_cpu_does(model, wrapped):
    on_gpu = terrain.shrinkwrap(*model, 65, REGION, device="cuda:0")
    assert len(on_gpu[0]) == pytest.approx(len(wrapped[0]), rel=1e-3)
    assert terrain.one_sided_distance(on_gpu, wrapped, 5000, device="cuda:0")["max"] < 0.5 * 10.0 / 64
