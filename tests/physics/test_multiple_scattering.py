"""Orders of scattering against exact solutions and independent Monte Carlo with stated errors."""

import numpy as np
import pytest
from rig import (
    VAROS_LAMPS,
    VAROS_WATER,
    assert_agrees,
    floor,
    line_of_sight,
    one_ray_scene,
    point,
    radiance,
    spot,
    water,
)

PAPER_WATER = VAROS_WATER | {"phase": {"g": 0.8}}
CHANNEL = {"R": 0, "G": 1, "B": 2}


def channel(estimate, name):
    return tuple(np.repeat(part[CHANNEL[name]], 3) for part in estimate)


@pytest.mark.parametrize(
    ("albedo", "T", "first", "second", "total"),
    [
        (0.5, 2.0, 6.756067373011e-4, 4.267660665722e-4, 1.432446393789e-3),
        (0.5, np.inf, 6.94657213878e-4, 4.419859876407e-4, 1.483289011131e-3),
        (0.9, 2.0, 1.216092127142e-3, 1.382722055694e-3, 6.91971457098e-3),
        (0.9, np.inf, 1.25038298498e-3, 1.432034599956e-3, 7.294186485738e-3),
    ],
)
def test_isotropic_medium_around_a_point_source(albedo, T, first, second, total):
    """Case and Zweifel's infinite medium, seen along a ray 1 m from the source (power 1 W: intensity 1/4 pi)."""

    def source(gone):
        return [point((1, 0, 1 - gone), 1 / (4 * np.pi))]

    medium = water(albedo, 1.0, 0.0)
    assert_agrees(line_of_sight(source, medium, T, layer="single", spp=512), first)
    assert_agrees(line_of_sight(source, medium, T, layer="multiple", spp=512, max_scatterings=2), second)
    assert_agrees(line_of_sight(source, medium, T, spp=512), total)


@pytest.mark.parametrize(
    ("name", "D", "L2", "L2_error", "one_scatter", "one_scatter_error"),
    [
        ("G", 2, 6.3295e-6, 2.2e-9, 4.6383e-4 + 4.08305e-4, 2.5e-7),
        ("G", 5, 7.8923e-6, 3.0e-9, 1.35350e-4 + 1.21134e-4, 8e-8),
        ("B", 10, 5.1565e-5, 2.1e-8, 1.21722e-4 + 1.09274e-4, 6e-8),
        ("R", 5, 5.8974e-8, 2.4e-11, 6.5531e-6 + 5.79951e-6, 3.6e-9),
    ],
)
def test_double_scattering_and_one_scattering_on_the_way_to_or_from_the_floor(
    name, D, L2, L2_error, one_scatter, one_scatter_error
):
    """A12, one lamp of the paper's rig; the notes allow 0.1 % beside their errors.

    Their L2 is that of a line of sight that ends at D in endless water (a floor would cut off 9 % of it at 2 m).
    """

    def lamp(gone):
        return [spot((0.15, 0, -0.1 - gone))]

    in_water = line_of_sight(lamp, PAPER_WATER, D, layer="multiple", spp=1024, max_scatterings=2)
    assert_agrees(channel(in_water, name), L2, np.hypot(L2_error, 1e-3 * L2 / 4), precision=0.02)
    scene = one_ray_scene(lamp(0.0), PAPER_WATER)
    with_floor = radiance(scene, [floor(D, 0.25)], "multiple", spp=512, max_scatterings=1, max_bounces=1)
    error = np.hypot(one_scatter_error, 1e-3 * one_scatter / 4)
    assert_agrees(channel(with_floor, name), one_scatter, error, precision=0.02)


@pytest.mark.parametrize(
    ("name", "T", "totals"),
    [
        ("G", 5.0, {3: (5.577e-7, 1e-9), None: (6.3372e-4, 6.3e-7)}),
        ("B", 25.0, {2: (1.0889e-4, 1.1e-7), 3: (1.4994e-5, 2e-8), None: (1.6521e-3, 1.7e-6)}),
    ],
)
def test_orders_of_scattering_in_open_water(name, T, totals):
    """A13, both lamps, black floor at T; order n is what n scatterings add to n - 1, independently drawn."""
    scene, end = one_ray_scene(VAROS_LAMPS, PAPER_WATER), [floor(T, 0.0)]
    for order, (truth, error) in totals.items():
        if order is None:
            assert_agrees(channel(radiance(scene, end, spp=256), name), truth, error)
            continue
        up_to = radiance(scene, end, "multiple", spp=1024, max_scatterings=order)
        below = radiance(scene, end, "multiple", spp=1024, max_scatterings=order - 1, seed=9)
        estimate = up_to[0] - below[0], np.hypot(up_to[1], below[1])
        assert_agrees(channel(estimate, name), truth, error, precision=0.2)


def test_the_whole_pixel_in_blue_with_a_floor():
    """A13: B, D = 5 m, reflectance 0.25: direct 3.9528e-3, single 1.48925e-3, total 7.2505e-3 (its error 0.1 %)."""
    scene, end = one_ray_scene(VAROS_LAMPS, PAPER_WATER), [floor(5.0, 0.25)]
    assert_agrees(channel(radiance(scene, end, "direct"), "B"), 3.9528e-3, 2e-7)
    assert_agrees(channel(radiance(scene, end, "single"), "B"), 1.48925e-3, 5e-9)
    assert_agrees(channel(radiance(scene, end, spp=512), "B"), 7.2505e-3, 7e-6)
    blocked = radiance(scene, [floor(5.0, 0.0)], "multiple", spp=1024, max_scatterings=2)
    assert_agrees(channel(blocked, "B"), 8.779e-5, 1e-7)


def test_two_floors_exchange_light_like_a_geometric_series():
    """Between infinite parallel plates of reflectance r and no water, total = direct + what the plates exchange.

    Plates at +-D with a lamp midway: by symmetry both have radiosity B(x), and the bounced part integrated over a plate
    is a geometric series. At one point its first term is a quadrature; r is small, so that two terms carry it.
    """
    r, D = 0.1, 1.0
    scene = one_ray_scene([point((0, 0, 0))], None)
    plates = [floor(D, r, 300.0), floor(-D, r, 300.0)]
    rho = np.linspace(0.0, 40.0, 400_001)
    distance2 = rho**2 + 4 * D**2
    E1 = D / (D**2 + rho**2) ** 1.5
    form_factor = (2 * D) ** 2 / (np.pi * distance2**2)
    second = r * np.trapezoid(E1 * form_factor * 2 * np.pi * rho, rho)
    got = radiance(scene, plates, "multiple", max_bounces=2, spp=512)
    assert_agrees(got, r / np.pi * second)


def test_more_orders_never_change_the_lower_ones():
    """The layers of one event are the same bytes, whatever else is traced."""
    scene, end = one_ray_scene(VAROS_LAMPS, PAPER_WATER), [floor(3.0, 0.25)]
    for layer in ("direct", "single"):
        assert np.array_equal(
            radiance(scene, end, layer, spp=16)[0],
            radiance(scene, end, layer, spp=16, max_scatterings=1, max_bounces=1)[0],
        )
