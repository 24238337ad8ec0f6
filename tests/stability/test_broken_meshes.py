"""Broken meshes either work or are refused with one message; they never crash, hang, or leave a broken terrain."""

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from varos_warp.errors import InputError
from varos_warp.scene.geometry import terrain, topology
from varos_warp.scene.geometry.procedural import generate_terrain

SHEET = generate_terrain(20.0, 17, 2.0, seed=3)
BALL = trimesh.creation.icosphere(2)


def sound(vertices, faces):
    """What every result keeps: finite, numbered, no face without an area, no vertex unused."""
    assert np.isfinite(vertices).all()
    assert len(faces) > 0
    assert faces.min() >= 0
    assert faces.max() < len(vertices)
    assert len(np.unique(faces)) == len(vertices)
    normals = topology.area_normals(vertices, faces)
    assert (normals != 0.0).any(axis=1).all()


def works_or_is_refused(vertices, faces, **options):
    """Runs preprocess; a refusal must be an InputError that names a key and a remedy."""
    try:
        result = terrain.preprocess(vertices, faces, **options)
    except InputError as error:
        refusal = error
    else:
        sound(*result)
        return result
    assert refusal.key
    assert refusal.remedy
    return None


# ------------------------------------------------------------------------------------------------------- named cases


def non_manifold():
    vertices, faces = SHEET
    fins = np.column_stack([faces[:40, :2], np.full(40, len(vertices))])
    return np.vstack([vertices, [0.0, 0.0, 5.0]]), np.concatenate([faces, fins]).astype(np.int32)


def zero_area():
    vertices, faces = SHEET
    return vertices, np.concatenate([faces, faces[:50, [0, 0, 1]], faces[:50, [2, 2, 2]]])


def self_intersecting():
    return terrain.join(
        [SHEET, (SHEET[0][:, [1, 0, 2]] * [1.0, 1.0, -1.0], SHEET[1][:, ::-1]), (BALL.vertices * 3.0, BALL.faces)]
    )


def far_away():
    return SHEET[0] + [1e6, 1e6, -1e3], SHEET[1]


def with_gaps():
    return SHEET[0], SHEET[1][np.random.default_rng(1).random(len(SHEET[1])) > 0.3]


def soup():
    return SHEET[0][SHEET[1]].reshape(-1, 3), np.arange(SHEET[1].size, dtype=np.int32).reshape(-1, 3)


def with_nan():
    vertices = SHEET[0].copy()
    vertices[::29] = np.nan
    return vertices, SHEET[1]


BROKEN = [non_manifold, zero_area, self_intersecting, far_away, with_gaps, soup, with_nan]


@pytest.mark.parametrize("shrinkwrap", [None, 25], ids=["as it is", "wrapped"])
@pytest.mark.parametrize("broken", BROKEN, ids=lambda function: function.__name__)
def test_a_broken_sheet_becomes_a_sound_one(broken, shrinkwrap):
    vertices, faces = broken()
    result = works_or_is_refused(vertices, faces, shrinkwrap_resolution=shrinkwrap, target_vertices=200)
    assert result is not None
    assert len(result[0]) < 400  # the target, and the feet of a skirt
    extent = np.nanmax(vertices, axis=0) - np.nanmin(vertices, axis=0)
    np.testing.assert_allclose(np.ptp(result[0], axis=0)[:2], extent[:2], atol=1.3)  # an edge of the model


@pytest.mark.parametrize("shrinkwrap", [None, 25], ids=["as it is", "wrapped"])
def test_an_inverted_sheet_is_turned_up(shrinkwrap):
    result = terrain.preprocess(SHEET[0], SHEET[1][:, ::-1], shrinkwrap_resolution=shrinkwrap, close="none")
    assert (topology.area_normals(*result)[:, 2] > 0.0).all()


def test_an_inverted_ball_is_turned_out():
    vertices, faces = terrain.preprocess(
        np.asarray(BALL.vertices), np.asarray(BALL.faces[:, ::-1], np.int32), shrinkwrap_resolution=25
    )
    assert trimesh.Trimesh(vertices, faces, process=False).volume == pytest.approx(BALL.volume, rel=0.05)


@pytest.mark.parametrize(
    ("vertices", "faces"),
    [
        ([[0, 0, 0], [1, 0, 0]], [[0, 1, 1]]),
        ([[0, 0, 0]] * 3, [[0, 1, 2]]),
        ([[0, 0, 0], [1, 1, 1], [2, 2, 2]], [[0, 1, 2]]),
        ([[np.nan] * 3] * 3, [[0, 1, 2]]),
        (np.zeros((0, 3)), np.zeros((0, 3))),
    ],
    ids=["two vertices", "one place", "one line", "all NaN", "empty"],
)
def test_a_mesh_of_nothing_is_refused_with_one_message(vertices, faces):
    with pytest.raises(InputError, match="no triangles are left") as caught:
        terrain.preprocess(np.array(vertices, float), np.array(faces, np.int32), shrinkwrap_resolution=9)
    assert caught.value.remedy


def test_one_triangle_is_a_terrain():
    triangle = np.array([[0, 0, 0], [4, 0, 1], [0, 4, 0]], float), np.array([[0, 1, 2]], np.int32)
    for how, spacing in (({}, 0.0), ({"shrinkwrap_resolution": 9}, 0.5)):
        vertices, faces = works_or_is_refused(*triangle, **how, close="none")
        np.testing.assert_allclose(np.ptp(vertices[:, :2], axis=0), 4.0, atol=spacing + 1e-9)
        assert (topology.area_normals(vertices, faces)[:, 2] > 0.0).all()


# --------------------------------------------------------------------------------------------------------- at random


FAULTS = ["drop", "turn", "nan", "repeat", "swap", "flat", "offset", "jitter"]


def broken_mesh(seed, kind, size, share, faults):
    """A sheet, a ball or noise, with faults in any mixture on a share of its faces."""
    rng = np.random.default_rng(seed)
    if kind == "noise":
        vertices = rng.normal(size=(2 + size % 30, 3)) * 10.0 ** (size % 7 - 3)
        faces = rng.integers(len(vertices), size=(1 + size, 3)).astype(np.int32)
    else:
        shape = SHEET if kind == "sheet" else (np.asarray(BALL.vertices), np.asarray(BALL.faces, np.int32))
        vertices, faces = (x.copy() for x in shape)
    some = rng.random(len(faces)) < share
    if "drop" in faults and not some.all():
        faces, some = faces[~some], some[~some]
    if "turn" in faults:
        faces[some] = faces[some, ::-1]
    if "repeat" in faults:
        faces = np.concatenate([faces, faces[some], faces[some][:, [1, 1, 2]]])
    if "swap" in faults:
        faces[rng.integers(len(faces), size=3)] = rng.integers(len(vertices), size=(3, 3))
    if "flat" in faults:
        vertices = vertices * rng.choice([0.0, 1.0], size=3)
    if "jitter" in faults:
        vertices = vertices + rng.normal(size=vertices.shape) * np.ptp(vertices, axis=0).max() * 0.05
    if "offset" in faults:
        vertices = vertices + [1e6, -1e6, 1e4]
    if "nan" in faults:
        vertices[rng.integers(len(vertices), size=2), rng.integers(3)] = rng.choice([np.nan, np.inf])
    return vertices, faces.astype(np.int32)


@settings(max_examples=40, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(
    seed=st.integers(0, 2**32 - 1),
    kind=st.sampled_from(["sheet", "ball", "noise"]),
    size=st.integers(0, 60),
    share=st.floats(0.05, 0.95),
    faults=st.sets(st.sampled_from(FAULTS)),
    options=st.fixed_dictionaries(
        {
            "shrinkwrap_resolution": st.sampled_from([None, 2, 12]),
            "target_vertices": st.sampled_from([None, 4, 50]),
            "close": st.sampled_from(["none", "skirt", "solid"]),
            "merge_tolerance_m": st.sampled_from([0.0, 1e-4]),
        }
    ),
)
def test_meshes_broken_at_random_work_or_are_refused(seed, kind, size, share, faults, options):
    mesh = broken_mesh(seed, kind, size, share, faults)
    result = works_or_is_refused(*mesh, **options)
    if result is not None and options["shrinkwrap_resolution"] is None:
        kept = mesh[0][np.isfinite(mesh[0]).all(axis=1)]
        slack = 1e-6 * np.abs(kept).max() + 0.5 * np.ptp(kept, axis=0).max()
        assert (result[0] >= kept.min(axis=0) - slack).all()
        assert (result[0] <= kept.max(axis=0) + slack).all()
