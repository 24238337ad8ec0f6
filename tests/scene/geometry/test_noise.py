import itertools
from functools import partial

import numpy as np
import pytest

from varos_warp.device import launch
from varos_warp.kernels.mesh import noise as kernels
from varos_warp.scene.geometry import noise
from varos_warp.scene.geometry.noise import faces, fbm, fbm_vector, worley

SUMS = [fbm, partial(fbm, kind=kernels.RIDGED, gain=0.55), partial(fbm, kind=kernels.BILLOW)]


def places(count=20_000, reach=30.0, seed=0):
    return np.random.default_rng(seed).uniform(-reach, reach, (count, 3))


@pytest.mark.parametrize("sum_of", SUMS)
def test_what_is_too_short_vanishes(sum_of):
    """All octaves from 5 cycles a metre on, edges of 0.15 m: nothing is left but a constant."""
    assert np.ptp(sum_of(places(), 5.0, 4, seed=1, edge=0.15)) < 1e-6


@pytest.mark.parametrize("sum_of", SUMS)
def test_what_is_longer_than_four_edges_is_whole(sum_of):
    p = places()
    np.testing.assert_array_equal(sum_of(p, 1.0, 3, seed=1, edge=0.06), sum_of(p, 1.0, 3, seed=1))


def test_an_octave_fades_in_proportion_between_five_halves_and_four_thirds_of_an_edge_a_cell():
    p = places()
    whole = fbm(p, 1.0, 1, seed=1)
    for edge, share in ((0.4, 1.0), (0.575, 0.5), (0.6625, 0.25), (0.75, 0.0)):
        np.testing.assert_allclose(fbm(p, 1.0, 1, seed=1, edge=edge), share * whole, atol=1e-6)


def test_each_place_has_its_own_edge():
    p = places(1000)
    edge = np.where(np.arange(1000) % 2, 0.0, 1.0)
    value = fbm(p, 2.0, 3, seed=1, edge=edge)
    np.testing.assert_array_equal(value[1::2], fbm(p[1::2], 2.0, 3, seed=1))
    assert not value[::2].any()


@pytest.mark.parametrize("sum_of", SUMS)
def test_coarse_meshes_are_as_high_as_fine_ones_on_average(sum_of):
    """Octaves that are left out leave their mean: 0.01 is five standard errors of a mean of 2e4 places."""
    p = places(50_000, 300.0)
    fine, coarse = sum_of(p, 1.0, 5, seed=1, edge=0.0), sum_of(p, 1.0, 5, seed=1, edge=0.3)
    assert abs(fine.mean() - coarse.mean()) < 0.01


def test_two_densities_agree_to_the_square_of_the_edge():
    """Between vertices a mesh is linear: halving its edges takes three quarters of the error away."""
    start = places(4000, 5.0)

    def error(edge):
        along = np.array([edge, 0.0, 0.0])
        ends = [fbm(start + k * along, 1.0, 3, seed=2, edge=edge) for k in (0.0, 1.0)]
        return np.sqrt(
            np.mean((fbm(start + 0.5 * along, 1.0, 3, seed=2, edge=0.5 * edge) - np.mean(ends, axis=0)) ** 2)
        )

    assert error(0.04) / error(0.02) == pytest.approx(4.0, rel=0.15)


def test_gradient_noise_is_zero_at_the_corners_of_its_lattice():
    corners = np.array(list(itertools.product(range(-4, 5), repeat=3)), float) / 2.0
    assert np.abs(fbm(corners, 2.0, 1, seed=5)).max() == 0.0


def test_gradient_noise_is_smooth_across_the_cells_of_its_lattice():
    """Values and slopes are continuous: second differences across a border fall with the square of the step."""
    p = places(5000)
    p[:, 0] = np.round(p[:, 0])
    step = np.array([1e-2, 0.0, 0.0])
    a, b, c = (fbm(p + k * step, 1.0, 1, seed=3) for k in (-1.0, 0.0, 1.0))
    assert np.abs(a - 2.0 * b + c).max() < 40.0 * 1e-4


def test_noise_far_from_the_origin_is_as_smooth_as_near_it():
    """100 km out, a step of single precision is 8 mm; places 0.1 mm apart still differ by what a slope makes of it."""
    p = places(2000) + np.array([1e5, -1e5, 0.0])
    apart = np.abs(fbm(p + [1e-4, 0.0, 0.0], 3.0, 1, seed=1) - fbm(p, 3.0, 1, seed=1))
    assert 0.0 < np.median(apart) < apart.max() < 3e-3


def test_another_seed_is_another_noise():
    p = places()
    a, b = fbm(p, 1.0, 4, seed=1), fbm(p, 1.0, 4, seed=2)
    assert abs(np.corrcoef(a, b)[0, 1]) < 0.05
    assert np.abs(np.corrcoef(fbm_vector(p, 1.0, 3, seed=1).T)[np.triu_indices(3, 1)]).max() < 0.05


def test_noise_does_not_depend_on_the_number_of_threads(monkeypatch):
    p = places(100_000)
    many = fbm(p, 3.0, 5, seed=1, edge=0.01), np.array(worley(p, 3.0, seed=1))
    monkeypatch.setattr(launch, "usable_cores", lambda: 1)
    monkeypatch.setattr(launch, "CHUNK", 777)
    np.testing.assert_array_equal(many[0], fbm(p, 3.0, 5, seed=1, edge=0.01))
    np.testing.assert_array_equal(many[1], np.array(worley(p, 3.0, seed=1)))


@pytest.mark.gpu
@pytest.mark.parametrize("sum_of", SUMS)
def test_noise_on_a_gpu_is_that_of_the_cpu(sum_of):
    """But for the rounding of fused operations."""
    p = places()
    np.testing.assert_allclose(
        sum_of(p, 3.0, 5, seed=1, edge=0.01, device="cuda:0"), sum_of(p, 3.0, 5, seed=1, edge=0.01), atol=1e-5
    )


@pytest.mark.gpu
def test_cells_on_a_gpu_are_those_of_the_cpu():
    p = places()
    here = worley(p, 3.0, seed=1, device="cuda:0")
    there = worley(p, 3.0, seed=1)
    np.testing.assert_allclose([here.near, here.second], [there.near, there.second], atol=1e-5)
    assert np.mean(here.id != there.id) < 1e-4  # where two centres are equally far
    np.testing.assert_allclose(faces(p, 3.0, seed=1, device="cuda:0").height, faces(p, 3.0, seed=1).height, atol=1e-4)


def test_no_places_have_no_noise():
    assert fbm(np.zeros((0, 3)), 1.0).shape == (0,)
    assert worley(np.zeros((0, 3)), 1.0).near.shape == (0,)


# ------------------------------------------------------------------------------------------------------------- cells


def centres(seed, reach, flat):
    """All points of a lattice's cells and their bits, in Python's whole numbers."""
    start = int(np.random.SeedSequence(seed).generate_state(1)[0])
    found = {}
    for i, j, k in itertools.product(range(-reach, reach), range(-reach, reach), [0] if flat else range(-reach, reach)):
        h = start + k * 3266489917 + i * 2654435761 + j * 2246822519 & 0xFFFFFFFF
        h = (h ^ h >> 16) * 2146121005 & 0xFFFFFFFF
        h = (h ^ h >> 15) * 2221713035 & 0xFFFFFFFF
        h ^= h >> 16
        third = h * 747796405 & 0xFFFFFFFF ^ h >> 7
        offset = h & 65535, h >> 16, 0 if flat else third & 65535
        found[(i, j, k)] = np.array([i, j, k]) + np.array(offset) / 65536, (h * 747796405 & 0xFFFFFFFF) >> 16
    return np.array([c for c, _ in found.values()]), np.array([bits / 65536 for _, bits in found.values()])


@pytest.mark.parametrize("flat", [False, True])
def test_cells_are_those_of_a_search_through_all_points(flat):
    p = places(3000, 2.0)
    points, ids = centres(9, 8, flat)
    q = 2.0 * p * [1.0, 1.0, 0.0 if flat else 1.0]
    distance = np.sqrt(((q[:, None] - points) ** 2).sum(axis=2))
    order = np.argsort(distance, axis=1)[:, :2]
    first, second = np.take_along_axis(distance, order, axis=1).T
    cells = worley(p, 2.0, seed=9, flat=flat)
    np.testing.assert_allclose(cells.near, first, atol=1e-5)
    np.testing.assert_allclose(cells.second, second, atol=1e-5)
    sure = second - first > 1e-5
    np.testing.assert_array_equal(cells.id[sure], ids[order[sure, 0]])


def test_faces_are_planes_of_all_slopes_inside_of_cells():
    p, step = places(20000, 2.0), np.array([0.01, 0.0, 0.0])
    inside = np.minimum.reduce([worley(p + k * step, 2.0, seed=9).gap for k in (-1, 0, 1)]) > 0.2
    inside &= worley(p - step, 2.0, seed=9).id == worley(p + step, 2.0, seed=9).id
    assert np.count_nonzero(inside) > 5000
    np.testing.assert_array_equal(faces(p, 2.0, seed=9).id, worley(p, 2.0, seed=9).id)
    low, middle, high = (faces(p + k * step, 2.0, seed=9).height for k in (-1, 0, 1))
    np.testing.assert_allclose((low + high - 2.0 * middle)[inside], 0.0, atol=1e-5)
    slope = ((high - low) / 0.04)[inside]  # over two steps of 0.01 m and two cells a metre
    assert np.abs(slope).max() < 1.0 + 1e-4
    # of a uniform direction one component is uniform over -1 to 1; a cell counts for many places, hence the wide bound
    assert np.std(slope) == pytest.approx(1.0 / np.sqrt(3.0), abs=0.1)


def test_faces_have_no_steps_where_two_or_more_meet():
    """What changes over a step falls as the step does, everywhere: of a jump it would not."""
    line = np.linspace(0.0, 40.0, 4000)[:, None] * [1.0, 0.0, 0.0]
    p = (line + np.random.default_rng(3).random((20, 1, 3))).reshape(-1, 3)
    here = faces(p, 1.0, seed=9).height
    most = [np.abs(faces(p + [h, 0.0, 0.0], 1.0, seed=9).height - here).max() for h in (1e-2, 1e-3)]
    assert most[1] < 0.2 * most[0]  # a tenth, and what rounding and bends leave


def test_flat_cells_do_not_depend_on_height():
    p = places()
    np.testing.assert_array_equal(
        np.array(worley(p, 2.0, seed=1, flat=True)), np.array(worley(p * [1.0, 1.0, 0.1], 2.0, seed=1, flat=True))
    )


def test_patterns_are_the_noises_at_a_mesh():
    p, edge = places(100), np.full(100, 0.02)
    pattern = noise.Patterns(p, edge, seed=3)
    np.testing.assert_array_equal(pattern.fbm(2.0, 3, 7), fbm(p, 2.0, 3, 1009 * 3 + 7, edge=edge))
    moved = pattern.moved(0.1, 1.0, 4)
    assert 0.01 < np.abs(moved.p - p).max() < 0.1
