from functools import cache

import numpy as np
import pytest
from surfaces import Look, ball, sheet, sites_of, vertex_normals

from varos_warp.scene.geometry.relief.recipes import concrete, rock, sand, steel, zinc
from varos_warp.scene.geometry.relief.recipes.layers import THICKEST_SILT_M, tones_of
from varos_warp.scene.geometry.relief.recipes.masks import neighbours_of, shape_of
from varos_warp.scene.geometry.relief.recipes.registry import RECIPES

NAMES = sorted(RECIPES)
SIZE_M = 1.0
DEFAULT = Look()
WORN = [Look(wear=0.0), Look(wear=0.3, seed=2), Look(wear=1.0, seed=3)]
HALF_WORN = Look(wear=0.6)
BOUNDS = {
    "rock": (rock.LIMIT * SIZE_M, rock.FINE_LIMIT_M),
    "sand": (sand.LIMIT_M, sand.FINE_LIMIT_M),
    "steel": (steel.LIMIT_M, steel.FINE_LIMIT_M),
    "concrete": (concrete.LIMIT_M, concrete.FINE_LIMIT_M),
    "zinc": (zinc.LIMIT_M, zinc.FINE_LIMIT_M),
    "none": (0.0, 0.0),
}


@cache
def surface(name, subdivisions=6):
    """The mesh that a recipe is tried on: a sea floor or a stone, 1 cm edges."""
    return sheet(150, 0.01) if name == "sand" else ball(0.5 * SIZE_M, subdivisions)


@cache
def dressed(name, look=DEFAULT, subdivisions=6):
    """Sites, displacements and colours of a recipe on its mesh, by the steps of the pipeline; not to be changed."""
    p, faces, n = surface(name, subdivisions)
    sites = sites_of(p, faces, n, size=SIZE_M)
    coarse = RECIPES[name].coarse(sites, look)
    x = p + coarse[:, None] * n
    n = vertex_normals(x, faces)
    sites = sites_of(p, faces, n, size=SIZE_M)
    fine = RECIPES[name].fine(sites, look)
    x = x + fine[:, None] * n
    n = vertex_normals(x, faces)
    sites = sites_of(p, faces, n, size=SIZE_M)
    colour, silt = RECIPES[name].colour(sites, shape_of(x, neighbours_of(len(x), faces), n, sites.edge), look)
    return sites, coarse, fine, colour, silt


@pytest.mark.parametrize("name", NAMES)
def test_names_are_those_of_the_registry(name):
    assert RECIPES[name].name == name


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("look", WORN, ids=lambda look: str(look.wear))
def test_reflectances_are_those_of_the_sea(name, look):
    _, _, _, colour, _ = dressed(name, look)
    assert colour.shape == (len(colour), 3)
    assert 0.01 <= colour.min() < colour.max() <= 0.85
    assert 0.03 < colour.mean() < 0.25


@pytest.mark.parametrize("name", NAMES)
def test_what_is_moved_is_moved_no_farther_than_is_said(name):
    for look in (*WORN, HALF_WORN):
        _, coarse, fine, _, silt = dressed(name, look)
        assert np.abs(coarse).max() <= BOUNDS[name][0]
        assert np.abs(fine).max() <= BOUNDS[name][1]
        assert 0.0 <= silt.min() <= silt.max() <= THICKEST_SILT_M


@pytest.mark.parametrize("name", sorted(set(NAMES) - {"none"}))
def test_surfaces_have_form_and_tones(name):
    _, coarse, fine, colour, _ = dressed(name, HALF_WORN)
    assert coarse.std() > 5e-4
    assert fine.std() > 2e-4
    assert colour.mean(axis=1).std() > 0.1 * colour.mean()


@pytest.mark.parametrize("name", NAMES)
def test_the_same_seed_is_the_same_surface_and_another_is_not(name):
    """On a mesh of 2 cm edges: where a byte depends on anything else, it does there too."""
    anew = dressed.__wrapped__
    a, b, c = dressed(name, DEFAULT, 5), anew(name, subdivisions=5), dressed(name, Look(seed=2), 5)
    for one, two in zip(a[1:], b[1:], strict=True):
        np.testing.assert_array_equal(one, two)
    assert np.abs(a[3] - c[3]).max() > 0.02


@pytest.mark.parametrize("name", NAMES)
def test_displacements_do_not_depend_on_which_vertices_are_asked_for(name):
    p, faces, n = surface(name)
    chosen = np.arange(0, len(p), 7)
    whole = sites_of(p, faces, n, size=SIZE_M)
    some = sites_of(p, faces, n, size=SIZE_M)
    some = type(some)(p[chosen], n[chosen], whole.edge[chosen], SIZE_M, whole.height[chosen], whole.clear[chosen])
    for step in ("coarse", "fine"):
        np.testing.assert_allclose(
            getattr(RECIPES[name], step)(some, Look()), getattr(RECIPES[name], step)(whole, Look())[chosen], atol=1e-9
        )


@pytest.mark.parametrize("name", ["rock", "sand", "concrete", "steel", "zinc"])
def test_coarse_meshes_show_the_large_forms_of_fine_ones(name):
    """At places that both have, a mesh of twice the edges differs by less than half of what it shows itself."""
    p, _, n = surface(name)
    size = len(p)
    fine, coarse = (
        sites_of(p, np.array([[0, 1, 2]]), n, size=SIZE_M, edge=np.full(size, edge), height=np.zeros(size))
        for edge in (0.005, 0.01)
    )
    a, b = (RECIPES[name].coarse(sites, Look()) for sites in (fine, coarse))
    assert np.std(a - b) < 0.5 * np.std(b)


@pytest.mark.parametrize("name", ["rock", "steel", "concrete", "zinc", "none"])
def test_silt_lies_on_what_faces_up(name):
    sites, _, _, _, silt = dressed(name, DEFAULT, 5)
    assert silt[sites.n[:, 2] > 0.9].mean() > 5.0 * silt[sites.n[:, 2] < 0.2].mean()


@pytest.mark.parametrize("name", NAMES)
def test_without_silt_none_lies_anywhere(name):
    assert not dressed(name, Look(silt=0.0), 5)[4].any()


@pytest.mark.parametrize("name", ["steel", "none"])
def test_paint_without_wear_film_and_silt_is_nearly_the_paint(name):
    paint = (0.40, 0.10, 0.05)
    colour = dressed(name, Look(paint, wear=0.0, silt=0.0, film=0.0))[3]
    np.testing.assert_allclose(colour.mean(axis=0), paint, rtol=0.25)
    assert np.all(colour[:, 0] > 1.5 * colour[:, 1])  # no rust, film or silt anywhere


def test_the_share_of_bare_steel_is_the_square_of_wear():
    look = [Look(wear=wear, film=0.0, silt=0.0) for wear in (0.0, 0.5, 0.7, 1.0)]
    p, faces, n = ball(2.0, 6)
    sites = sites_of(p, faces, n, size=4.0, edge=np.full(len(p), 0.004))
    bare = [steel._damage(sites, sites.patterns(1), one).bare.mean() for one in look]
    np.testing.assert_allclose(bare, [0.0, 0.25, 0.49, 1.0], atol=0.1)
    assert bare[0] == 0.0
    assert bare[3] == 1.0


def test_film_makes_paint_browner():
    means = [
        dressed("steel", Look((0.1, 0.2, 0.4), wear=0.0, silt=0.0, film=film), 5)[3].mean(axis=0)
        for film in (0.0, 0.5, 1.0)
    ]
    redness = [mean[0] / mean[2] for mean in means]
    assert redness[0] < redness[1] < redness[2]


def test_ripples_end_at_objects_and_on_slopes():
    p, faces, n = sheet(150, 0.01)
    pattern = sites_of(p, faces, n).patterns(1)
    amplitude = sand._ripples(sites_of(p, faces, n), pattern)[0]
    assert amplitude.max() > 0.003
    assert not sand._ripples(sites_of(p, faces, n, clear=np.full(len(p), 0.02)), pattern)[0].any()
    steep = np.broadcast_to([np.sin(0.7), 0.0, np.cos(0.7)], p.shape)  # 40 degrees
    assert not sand._ripples(sites_of(p, faces, steep), pattern)[0].any()


def test_ripples_are_no_steeper_than_0_15():
    """Amplitude times the slope of the profile 1 - 2 |sin pi phase|, at the mean wavelength: at most 2 pi a / L."""
    p, faces, n = sheet(150, 0.01)
    amplitude, _ = sand._ripples(sites_of(p, faces, n), sites_of(p, faces, n).patterns(1))
    assert 2.0 * amplitude.max() / sand.WAVELENGTH_M <= 0.15


def test_streaks_of_a_wall_are_in_zones():
    """Of squares of 40 cm some have streaks several times as strong as others."""
    p, faces, n = sheet(200, 0.02)
    hung = tones_of(sites_of(p[:, [0, 2, 1]], faces, n[:, [0, 2, 1]]).patterns(1)).hung.reshape(10, 20, 10, 20)
    strength = np.percentile(hung.std(axis=(1, 3)), [10, 90])
    assert strength[1] > 4.0 * strength[0]


def test_loose_stones_keep_less_of_the_forms_of_bedrock():
    """The same places as an object with edges of its own, as a large one, and as ground: of 1 m, 10 m and any size."""
    p, faces, n = ball(0.5, 5)
    rock = RECIPES["rock"]

    def spread(size, sharp):
        return rock.coarse(sites_of(p, faces, n, size=size, sharp=sharp), Look()).std()

    assert spread(1.0, np.zeros(len(p))) < 0.5 * spread(1.0, None)
    assert spread(10.0, np.zeros(len(p))) == spread(10.0, None)


def test_edges_lose_their_paint_first():
    p, faces, n = ball(0.5, 5)
    sharp = np.where(p[:, 2] > 0.0, 0.33, 0.0)
    sites = sites_of(p, faces, n, sharp=sharp)
    bare = steel._damage(sites, sites.patterns(1), Look(wear=0.3)).bare
    assert bare[p[:, 2] > 0.0].mean() > 2.0 * bare[p[:, 2] < 0.0].mean()


def test_a_long_pipe_has_weld_seams_and_a_ball_has_none():
    t, x = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False), np.arange(-3.0, 3.0, 0.01))
    n = np.stack([0.0 * t, np.cos(t), np.sin(t)], axis=2).reshape(-1, 3)
    p = 0.15 * n + np.stack([x, 0.0 * x, 0.0 * x], axis=2).reshape(-1, 3)
    faces = np.array([[0, 1, 2]])
    seams = steel._seams(sites_of(p, faces, n, edge=np.full(len(p), 0.005)), 1)
    rows = np.unique(np.round(p[seams > 0.5, 0], 3))
    assert 1 <= np.count_nonzero(np.diff(rows) > 0.5) + 1 <= 3
    p, faces, n = ball(2.0, 4)
    assert not steel._seams(sites_of(p, faces, n), 1).any()


def test_edges_of_concrete_are_chipped():
    p, faces, n = ball(0.5, 5)
    sharp = np.where(p[:, 2] > 0.0, 0.33, 0.0)
    chipped = RECIPES["concrete"].coarse(sites_of(p, faces, n, sharp=sharp), Look())
    whole = RECIPES["concrete"].coarse(sites_of(p, faces, n), Look())
    assert np.all(chipped <= whole)
    assert (whole - chipped)[p[:, 2] > 0.1].max() > 0.005


def test_the_beds_of_a_rock_are_layers():
    """Along a bed the level varies less than across beds."""
    line = np.linspace(-0.5, 0.5, 400)[:, None]
    across = rock._bedding(1)
    along = np.cross(across, [1.0, 0.0, 0.0])
    along /= np.linalg.norm(along)
    levels = []
    for way in (across, along):
        p = line * way
        sites = sites_of(p, np.array([[0, 1, 2]]), p, size=SIZE_M, edge=np.full(400, 0.0025))
        levels.append(rock._beds(sites.patterns(1), across, 0.085, 20).level)
    assert levels[0].std() > 0.3
    assert levels[1].std() < 1e-6


@pytest.mark.parametrize("name", sorted(name for name, recipe in RECIPES.items() if recipe.by_vertex))
def test_some_vertices_look_as_among_all_others(name):
    """By the byte: tiles of a mesh are made apart from each other, and only where a recipe has a share."""
    look, (p, faces, n) = Look(silt=0.4, film=0.5, seed=3), ball(0.5, 5)
    joined = neighbours_of(len(p), faces)
    sites = sites_of(p, faces, n, size=SIZE_M)
    rows = np.flatnonzero(np.random.default_rng(0).random(len(p)) < 0.3)
    recipe, shape = RECIPES[name], shape_of(p, joined, n, sites.edge)
    for step in (recipe.coarse, recipe.fine):
        np.testing.assert_array_equal(step(sites.some(rows), look), step(sites, look)[rows])
    some, whole = (recipe.colour(*given, look) for given in ((sites.some(rows), shape.some(rows)), (sites, shape)))
    for one, other in zip(some, whole, strict=True):
        np.testing.assert_array_equal(one, other[rows])
