"""Coarser prototypes for copies of few pixels, and places that are kept."""

import numpy as np
import pytest

from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.geometry.growth import grow as growing
from varos_warp.scene.geometry.growth.kinds import KINDS, prototypes
from varos_warp.scene.geometry.growth.levels import LEVELS, level_of
from varos_warp.scene.geometry.parts import Grown
from varos_warp.scene.geometry.relief.density import footprint

SHELLS = {"on": ["terrain"], "kind": "shell", "per_m2": 3, "size_m": [0.01, 0.3]}


def scene(*growth, **more):
    """Growth on level ground of 8 m, seen from 2 m above its middle: a pixel is a centimetre there."""
    camera = {
        "id": "M0",
        "resolution": [320, 320],
        "sensor_mm": [6.4, 6.4],
        "focal_mm": 4.0,
        "rotation_euler_deg": [-90, 0, 0],
    }
    return scene_from_dict(
        {
            "trajectory": {"poses": [{"position": [0, 0, 2]}]},
            "vehicle": {"cameras": [camera]},
            "growth": list(growth),
            "terrain": {"kind": "procedural", "size_m": 8, "resolution": 9, "relief_m": 0.0},
            **more,
        }
    )


def grown(*growth, **more) -> list[Grown]:
    return [part for part in build_parts(scene(*growth, **more)) if isinstance(part, Grown)]


def area_vectors(solid):
    a, b, c = np.moveaxis(solid.vertices[solid.faces], 1, 0)
    return 0.5 * np.cross(b - a, c - a)


def mean_colour(solid):
    area = np.linalg.norm(area_vectors(solid), axis=1)
    return area @ solid.corners.mean(axis=1) / area.sum()


@pytest.mark.parametrize("kind", KINDS)
def test_coarser_prototypes_have_the_triangles_that_their_level_may(kind):
    for shape in prototypes(kind):
        assert len(shape) == 1 + len(LEVELS)
        for solid, (_, triangles) in zip(shape[1:], LEVELS, strict=True):
            assert 0.5 * triangles < len(solid.faces) < 1.5 * triangles


def outline(solid, axis, pixels, samples=8):
    """Samples, ``samples`` to a pixel, that a shape covers which is so many pixels large, seen along an axis."""
    flat = np.delete(solid.vertices, axis, axis=1) * pixels * samples + 0.75 * pixels * samples
    side = int(1.5 * pixels * samples)
    centres, covered = np.arange(side) + 0.5, np.zeros((side, side), bool)
    for corners in flat[solid.faces]:
        box = tuple(slice(*ends) for ends in np.searchsorted(centres, [corners.min(axis=0), corners.max(axis=0)]).T)
        x, y = np.ix_(centres[box[0]], centres[box[1]])
        turns = [
            (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])
            for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)
        ]
        covered[box] |= (np.min(turns, axis=0) >= 0.0) | (np.max(turns, axis=0) <= 0.0)
    return covered


@pytest.mark.parametrize("axis", [0, 2])
@pytest.mark.parametrize("kind", ["barnacle", "coralline", "mussel", "pebble", "shell", "starfish"])
def test_outlines_of_coarser_bodies_differ_by_less_than_half_a_pixel(kind, axis):
    """In the mean along the outline, at the largest size that a level is for."""
    whole, *coarse = prototypes(kind)[0]
    for (pixels, _), solid in zip(LEVELS, coarse, strict=True):
        here, there = (outline(each, axis, pixels) for each in (whole, solid))
        border = sum(np.count_nonzero(np.diff(here, axis=k)) for k in (0, 1)) / 8 * np.pi / 4  # in pixels
        assert np.count_nonzero(here ^ there) / 64 < 0.5 * border


@pytest.mark.parametrize("kind", ["hydroid", "seagrass", "kelp", "tube_worm"])
def test_strips_keep_the_surface_of_all_of_them(kind):
    """Each level shows as much of itself as the whole: what is left becomes wider, but for turning to unit height."""
    for shape in prototypes(kind):
        whole, coarsest = (np.linalg.norm(area_vectors(solid), axis=1).sum() for solid in (shape[0], shape[-1]))
        assert 0.75 < coarsest / whole < 1.33


@pytest.mark.parametrize("kind", KINDS)
def test_coarser_prototypes_have_the_colour_of_the_whole(kind):
    for shape in prototypes(kind):
        for solid in shape[1:]:
            np.testing.assert_allclose(mean_colour(solid), mean_colour(shape[0]), rtol=0.2)


@pytest.mark.parametrize("kind", ["seagrass", "kelp"])
def test_coarser_plants_have_the_colour_of_the_whole_exactly(kind):
    for shape in prototypes(kind):
        for solid in shape[1:]:
            np.testing.assert_allclose(mean_colour(solid), mean_colour(shape[0]), rtol=1e-5)


def test_levels_end_at_their_limits():
    (first, _), (second, _) = LEVELS
    pixels = np.array([first, np.nextafter(first, 0), second, np.nextafter(second, 0)])
    np.testing.assert_array_equal(level_of(pixels), [0, 1, 1, 2])


@pytest.mark.usefixtures("few_bodies")
def test_copies_are_as_fine_as_they_are_large_in_the_nearest_view():
    near = footprint(scene(), build_parts(scene()))
    triangles = {len(solid.faces): level for shape in prototypes("shell") for level, solid in enumerate(shape)}
    groups = grown(SHELLS)
    assert {triangles[len(group.faces)] for group in groups} == {0, 1, 2}
    for group in groups:
        pixels = group.scale / near(group.T_w_o[:, :3, 3])
        np.testing.assert_array_equal(level_of(pixels), triangles[len(group.faces)])


@pytest.mark.usefixtures("few_bodies")
def test_copies_of_each_level_are_told():
    groups = grown(SHELLS)
    facts = groups[0].facts
    assert sum(facts["by_level"]) == facts["copies"] == sum(map(len, groups))
    assert facts["triangles"] == sum(len(group) * len(group.faces) for group in groups)
    assert all(group.facts == {} for group in groups[1:])


@pytest.mark.usefixtures("few_bodies")
def test_many_triangles_are_told_with_the_numbers(monkeypatch):
    monkeypatch.setattr(growing, "MANY_TRIANGLES", 1000)
    with pytest.warns(UserWarning, match=r"growth\.0: \d+ copies of shell have 0\.\d million triangles.*per_m2 \(3\)"):
        assert grown(SHELLS)


def poses(groups):
    return [group.T_w_o for group in groups]


def test_places_are_kept_and_are_the_same_again(tmp_path, monkeypatch):
    monkeypatch.setenv("VAROS_WARP_CACHE", str(tmp_path))
    first = grown(SHELLS)
    (kept,) = tmp_path.glob("growth-*.npz")
    monkeypatch.setattr(growing, "rooted", None)  # nothing is placed again
    again = grown(SHELLS)
    kept.unlink()
    monkeypatch.undo()
    anew = grown(SHELLS)
    for a, b, c in zip(*map(poses, (first, again, anew)), strict=True):
        np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(a, c)
    assert first[0].facts == again[0].facts == anew[0].facts


@pytest.mark.usefixtures("few_bodies")
@pytest.mark.parametrize(
    "change",
    [
        {"seed": 2},
        {"trajectory": {"poses": [{"position": [1, 0, 2]}]}},
        {"surface_depth_m": 9.0},
        {"terrain": {"kind": "procedural", "size_m": 8, "resolution": 9, "relief_m": 0.1}},
        {"growth": [{**SHELLS, "per_m2": 4}]},
        {"growth": [{**SHELLS, "kind": "pebble"}]},
    ],
)
def test_what_places_depend_on_makes_new_ones(change, tmp_path, monkeypatch):
    monkeypatch.setenv("VAROS_WARP_CACHE", str(tmp_path))
    grown(SHELLS)
    more = {"growth": [SHELLS]} | change
    build_parts(scene(*more.pop("growth"), **more))
    assert len(list(tmp_path.glob("growth-*.npz"))) == 2


def test_nothing_is_kept_of_scenes_without_growth(tmp_path, monkeypatch):
    monkeypatch.setenv("VAROS_WARP_CACHE", str(tmp_path))
    build_parts(scene())
    assert not list(tmp_path.glob("growth-*"))


def test_what_is_too_small_to_be_placed_does_not_drive_out_others():
    """In the view of both, what is seen from farther away is some of what is seen from near, where it stands then."""
    block = {"on": ["terrain"], "kind": "pebble", "per_m2": 150, "size_m": [0.01, 0.1], "cluster": 0}
    near, far = (grown(block, trajectory={"poses": [{"position": [0, 0, z]}]}) for z in (1.5, 3.0))
    places = [
        {tuple(root) for group in groups for root in group.T_w_o[:, :3, 3] if np.abs(root[:2]).max() < 1.0}
        for groups in (near, far)
    ]
    assert 0 < len(places[1]) < len(places[0])
    assert places[1] <= places[0]
