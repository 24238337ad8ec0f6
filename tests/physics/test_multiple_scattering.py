"""Orders of scattering against exact solutions and independent Monte Carlo with stated errors."""

import numpy as np
import pytest
from physics.rig import (
    VAROS_LAMPS,
    VAROS_WATER,
    agreement,
    floor,
    line_of_sight,
    one_ray_scene,
    point,
    radiance,
    spot,
    varos_lamps,
    water,
)

from varos_warp.render.renderer import FrameRenderer

pytestmark = pytest.mark.subject("multiple scattering")

FOURIER = "Case and Zweifel (1967); Fourier inversion and integral over the ray"
MONTE_CARLO = "an independent Monte Carlo of other samplers, with its standard error"
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
def test_light_of_a_point_source_in_an_isotropic_medium(truth, albedo, T, first, second, total):
    """Case and Zweifel's infinite medium, seen along a ray 1 m from the source (power 1 W: intensity 1/4 pi)."""

    def source(gone):
        return [point((1, 0, 1 - gone), 1 / (4 * np.pi))]

    medium = water(albedo, 1.0, 0.0)
    for order, expected, how in (
        ("once", first, {"layer": "single"}),
        ("all orders", total, {}),
        ("twice", second, {"layer": "multiple", "max_scatterings": 2}),
    ):
        truth(
            f"scattered {order}, albedo {albedo}, ray 1 m from the source up to {T} m",
            source=FOURIER,
            **agreement(line_of_sight(source, medium, T, spp=512, **how), expected),
        )


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
    truth, name, D, L2, L2_error, one_scatter, one_scatter_error
):
    """One lamp of the paper's rig, against a Monte Carlo of 2e7 samples that is right to 0.1 % beside its errors.

    Light scattered twice is that of a line of sight that ends at D in endless water; a floor would cut off 9 % at 2 m.
    """

    def lamp(gone):
        return [spot((0.15, 0, -0.1 - gone))]

    in_water = line_of_sight(lamp, PAPER_WATER, D, layer="multiple", spp=1024, max_scatterings=2)
    rest = {"precision": 0.02, "tolerance": 1e-3, "reason": "0.1 %, stated with the truth, and float32 rounding"}
    truth(
        f"scattered twice, {name}, ray up to {D} m",
        source=MONTE_CARLO,
        **agreement(channel(in_water, name), L2, L2_error, **rest),
    )
    scene = one_ray_scene(lamp(0.0), PAPER_WATER)
    with_floor = radiance(scene, [floor(D, 0.25)], "multiple", spp=512, max_scatterings=1, max_bounces=1)
    truth(
        f"floor and one scattering, {name}, floor at {D} m",
        source=MONTE_CARLO,
        **agreement(channel(with_floor, name), one_scatter, one_scatter_error, **rest),
    )


@pytest.mark.parametrize(
    ("name", "T", "totals"),
    [
        ("G", 5.0, {3: (5.577e-7, 1e-9), None: (6.3372e-4, 6.3e-7)}),
        ("B", 25.0, {2: (1.0889e-4, 1.1e-7), 3: (1.4994e-5, 2e-8), None: (1.6521e-3, 1.7e-6)}),
    ],
)
def test_orders_of_scattering_in_open_water(truth, name, T, totals):
    """Both lamps, a line of sight up to T in endless water: a black floor would take 0.1 to 0.3 % of all light.

    Order n is what n scatterings add to n - 1 of the same paths, pixel by pixel.
    """
    for order, (expected, error) in totals.items():
        if order is None:
            truth(
                f"all orders, {name}, ray up to {T} m",
                source=MONTE_CARLO,
                **agreement(channel(line_of_sight(varos_lamps, PAPER_WATER, T, spp=512), name), expected, error),
            )
            continue
        here, beyond = (
            order_by_pixel(order, varos_lamps(gone), 1024 if order == 2 else 512, seed)
            for gone, seed in ((0.0, 7), (T, 8))
        )
        pixels = here - np.exp(-T * np.add(PAPER_WATER["sigma_s"], PAPER_WATER["sigma_a"])) * beyond
        estimate = pixels.mean(axis=0), pixels.std(axis=0, ddof=1) / np.sqrt(len(pixels))
        truth(
            f"order {order}, {name}, ray up to {T} m",
            source=MONTE_CARLO,
            **agreement(channel(estimate, name), expected, error, precision=0.2),
        )


def order_by_pixel(order, lamps, spp, seed):
    """Light of one order in open water, in pixels that all see the same ray [N, 3].

    More orders do not change the lower ones, so those cancel, and their noise with them.
    """
    renderer = FrameRenderer(one_ray_scene(lamps, PAPER_WATER), "cpu", parts=[])
    up_to, below = (
        renderer.render(
            np.eye(4), outputs="A", spp=spp, seed=seed, integrator="path", layers=("multiple",), max_scatterings=most
        ).A
        for most in (order, order - 1)
    )
    return (up_to.radiance - below.radiance).reshape(-1, 3).astype(float)


def test_the_whole_pixel_in_blue_with_a_floor(truth):
    """Both lamps of the paper's rig above a floor, layer by layer; the expected sum has an error of 0.1 %."""
    scene, end = one_ray_scene(VAROS_LAMPS, PAPER_WATER), [floor(5.0, 0.25)]
    black = [floor(5.0, 0.0)]
    for what, made, expected, error in (
        ("direct", radiance(scene, end, "direct"), 3.9528e-3, 2e-7),
        ("scattered once", radiance(scene, end, "single"), 1.48925e-3, 5e-9),
        ("all light", radiance(scene, end, spp=512), 7.2505e-3, 7e-6),
        ("scattered twice", radiance(scene, black, "multiple", spp=1024, max_scatterings=2), 8.779e-5, 1e-7),
    ):
        truth(
            f"{what}, blue, floor of reflectance 0.25 at 5 m",
            source=MONTE_CARLO,
            **agreement(channel(made, "B"), expected, error),
        )


@pytest.mark.subject("surfaces and lights")
def test_two_floors_exchange_light_like_a_geometric_series(truth):
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
    truth(
        "floor and plate 1 m from the lamp, two bounces",
        source="form factor of parallel plates, quadrature",
        **agreement(got, r / np.pi * second),
    )


def test_more_orders_never_change_the_lower_ones():
    """The layers of one event are the same bytes, whatever else is traced."""
    scene, end = one_ray_scene(VAROS_LAMPS, PAPER_WATER), [floor(3.0, 0.25)]
    for layer in ("direct", "single"):
        assert np.array_equal(
            radiance(scene, end, layer, spp=16)[0],
            radiance(scene, end, layer, spp=16, max_scatterings=1, max_bounces=1)[0],
        )
