"""Direct light and single scattering against closed forms and 15-digit quadratures."""

import numpy as np
import pytest
from physics.rig import (
    BLUE,
    GREEN,
    RED,
    VAROS_LAMPS,
    VAROS_WATER,
    agreement,
    assert_agrees,
    floor,
    one_ray_scene,
    point,
    radiance,
    single_scattering,
    spot,
    water,
)

pytestmark = pytest.mark.subject("single scattering")

INF = np.inf
PETZOLD_INTEGRAL = 0.9929536
"""Of the published table over the sphere, interpolated log-log: the truths are not normalised."""
TABLE_BEHIND = 8e-4
DIGITS = "two independent quadratures to 15 digits"
QUADRATURE = "adaptive quadrature in the equiangular angle (tests/physics/rig.py)"
SIDE, VAROS_POINT = (1, 0, 0), (0.15, 0, -0.1)


def black_floor(T):
    return [] if np.isinf(T) else [floor(T, 0.0)]


@pytest.mark.parametrize(
    ("sigma_a", "expected"),
    [(0.125, 0.28650479686019), (0.0579890, 0.559959958773234), (0.04, 0.670320046035639), (2.5e-6, 0.999975000312497)],
)
@pytest.mark.subject("surfaces and lights")
def test_absorbing_water_obeys_beer_lambert(truth, sigma_a, expected):
    """A lamp at the camera and a floor at 5 m: 10 m of water."""
    scene = one_ray_scene([point((0, 0, 0))], water(0.0, sigma_a, 0.0))
    truth(
        f"floor seen through 10 m, sigma_a = {sigma_a}",
        source="exp(-sigma_a t) rho/(pi d^2)",
        **agreement(radiance(scene, [floor(5.0, 0.25)]), expected * 0.25 / (np.pi * 25.0)),
    )


@pytest.mark.subject("surfaces and lights")
def test_a_floor_without_water_has_the_radiance_of_the_inverse_square_law(truth):
    scene = one_ray_scene([point((3, 0, 0))], None)
    truth(
        "Lambert's floor 4 m away, lamp 3 m aside",
        source="rho/pi cos/d^2",
        **agreement(radiance(scene, [floor(4.0, 0.5)]), 0.5 / np.pi * (4 / 5) / 25.0),
    )


@pytest.mark.parametrize(
    ("position", "sigma_s", "sigma_t", "g", "T", "expected"),
    POINT_LAMPS := [
        (SIDE, 1, 1, 0.0, INF, 0.015382720109353),
        (SIDE, 1, 1, 0.0, 2, 0.0152954359892282),
        (SIDE, 1, 1, 0.8, INF, 0.0018073046013872),
        (SIDE, 1, 1, 0.8, 2, 0.00180157358033412),
        (SIDE, 0.5, 0.7, -0.5, 3, 0.0143304877593851),
        (VAROS_POINT, *GREEN, 0.0, 5, 0.00874058838653483),
        (VAROS_POINT, *GREEN, 0.8, 5, 0.00061849240331754),
        ((0.01, 0, 1), *GREEN, 0.8, 5, 1.3348754027496),
        ((1e-4, 0, 1), *GREEN, 0.8, 5, 139.603274201375),
    ],
)
def test_light_of_a_point_lamp_scattered_once(truth, position, sigma_s, sigma_t, g, T, expected):
    scene = one_ray_scene([point(position)], water(sigma_s, sigma_t, g))
    truth(
        f"lamp at {position}, sigma_s = {sigma_s}, sigma_t = {sigma_t}, g = {g}, ray up to {T} m",
        source=DIGITS,
        **agreement(radiance(scene, black_floor(T), "single", spp=1024), expected),
    )


def test_the_quadrature_of_these_tests_has_the_known_digits(truth):
    """It then stands for truths where no digits are known."""
    for position, sigma_s, sigma_t, g, T, expected in POINT_LAMPS:
        if position == (1e-4, 0, 1):
            continue  # its peak is 1e-4 of a piece wide in the angle of a ray without end
        truth(
            f"lamp at {position}, sigma_s = {sigma_s}, sigma_t = {sigma_t}, g = {g}, ray up to {T} m",
            source=DIGITS + ", against " + QUADRATURE,
            expected=expected,
            got=single_scattering(position, sigma_s, sigma_t, g, T),
            tolerance=1e-9 * expected,
            reason="the quadrature's own tolerance, 1e-10, summed",
        )


def test_point_lamp_in_water_that_scatters_but_does_not_extinguish(truth):
    """sigma_t -> 0 in the limit: 1/8 for a lamp at 1 m, here per sigma_s = 1e-7."""
    scene = one_ray_scene([point(SIDE)], water(1e-7, 1e-7, 0.0))
    truth(
        "lamp 1 m aside, sigma_s = sigma_t = 1e-7",
        source="sigma_s/8, exact as sigma_t -> 0",
        **agreement(radiance(scene, (), "single", spp=256), 1e-7 / 8),
    )


@pytest.mark.parametrize(
    ("T", "g", "expected"),
    [
        (2, 0.8, (5.19739861055642e-5, 0.000582288048363675, 0.00139849876541647)),
        (5, 0.8, (5.42226576952195e-5, 0.000617358347687215, 0.00148924559123547)),
        (10, 0.8, (5.45304161185223e-5, 0.00062519221619206, 0.00151190406588714)),
        (25, 0.8, (5.45633155963439e-5, 0.000627173268201532, 0.00151897711245271)),
        (5, 0.0, (0.000838168023095091, 0.00956255858258945, 0.0230789239711541)),
    ],
)
def test_the_papers_rig_at_the_centre_of_the_image(truth, T, g, expected):
    scene = one_ray_scene(VAROS_LAMPS, VAROS_WATER | {"phase": {"g": g}})
    truth(
        f"red, green, blue; ray up to {T} m, g = {g}",
        source=DIGITS,
        **agreement(radiance(scene, [floor(T, 0.0)], "single"), expected),
    )


@pytest.mark.parametrize(
    ("phase", "expected"),
    [
        ({"kind": "fournier_forand", "n": 1.10, "mu": 3.5835}, (2.916263e-5, 3.128069e-4, 8.043665e-4)),
        ({"kind": "petzold"}, np.array([2.870030e-5, 3.072249e-4, 7.963130e-4]) / PETZOLD_INTEGRAL),
    ],
    ids=["fournier_forand", "petzold"],
)
def test_the_papers_rig_in_water_that_scatters_as_the_sea(truth, phase, expected):
    """Rays up to 5, 2 and 5 m in red, green and blue."""
    scene = one_ray_scene(VAROS_LAMPS, VAROS_WATER | {"phase": phase})
    far, near = (radiance(scene, [floor(T, 0.0)], "single", spp=256) for T in (5, 2))
    estimate = [np.array([long[0], short[1], long[2]]) for long, short in zip(far, near, strict=True)]
    truth(
        f"red up to 5, green up to 2, blue up to 5 m, {phase['kind']}",
        source="quadrature of the formula in float64",
        **agreement(
            estimate,
            expected,
            tolerance=TABLE_BEHIND if phase["kind"] == "petzold" else 0.0,
            reason="float32 rounding, and Petzold's rows next to 180 degrees within the bins of a table",
        ),
    )


def test_the_papers_rig_off_the_centre(truth):
    """The floor is put so that the ray ends after 8 m."""
    direction = np.array([0.4, 0.2, 1.0])
    scene = one_ray_scene(VAROS_LAMPS, VAROS_WATER | {"phase": {"g": 0.8}}, direction)
    expected = (5.31486891454482e-5, 0.00060670008351821, 0.00146546090975532)
    truth(
        "red, green, blue; ray along (0.4, 0.2, 1) up to 8 m",
        source=DIGITS,
        **agreement(radiance(scene, [floor(8 / np.linalg.norm(direction), 0.0)], "single"), expected),
    )


@pytest.mark.parametrize(
    ("sigma_s", "sigma_t", "expected"), [(0.8, 1.0, 0.0109644027294663), (1.7, 2.0, 0.0115402319855652)]
)
def test_the_papers_rig_in_turbid_water(truth, sigma_s, sigma_t, expected):
    scene = one_ray_scene(VAROS_LAMPS, water(sigma_s, sigma_t, 0.8))
    truth(
        f"sigma_s = {sigma_s}, sigma_t = {sigma_t}, ray up to 2 m",
        source=DIGITS,
        **agreement(radiance(scene, [floor(2, 0.0)], "single"), expected),
    )


def test_a_lamp_beside_the_ray_that_shines_across_it(truth):
    scene = one_ray_scene([spot((0.01, 0, 1), axis=(-1, 0, 0.3))], water(*GREEN, 0.8))
    truth(
        "cone of 65 degrees, 1 cm from the ray",
        source=DIGITS,
        **agreement(radiance(scene, [floor(5, 0.0)], "single", spp=256), 0.0209995178097378),
    )


@pytest.mark.parametrize("blend", [0.15, 1.0])
def test_the_soft_edge_of_a_cone_is_blenders(truth, blend):
    lamp = {"axis": (0, 0, 1), "cone_deg": 65.0, "blend": blend}
    scene = one_ray_scene([spot(VAROS_POINT, blend=blend)], water(*BLUE, 0.8))
    expected = single_scattering(VAROS_POINT, *BLUE, 0.8, 5.0, **lamp)
    truth(
        f"blend {blend}, blue, ray up to 5 m",
        source=QUADRATURE + " of a smoothstep in the cosine",
        **agreement(radiance(scene, [floor(5, 0.0)], "single", spp=256), expected),
    )


@pytest.mark.parametrize(
    ("axis", "cone_deg"),
    [
        ((0, 0, 1), 10),
        ((0, 0, 1), 120),
        ((0, 0, 1), 179),
        ((0, 0, 1), 200),
        ((1, 0, 0.1), 65),
        ((-1, 0, -1), 40),
        ((0, 0, -1), 65),
    ],
)
def test_cones_of_any_width_and_direction_light_the_right_part_of_the_ray(truth, axis, cone_deg):
    scene = one_ray_scene([spot(VAROS_POINT, axis, cone_deg)], water(*BLUE, 0.5))
    expected = single_scattering(VAROS_POINT, *BLUE, 0.5, 5.0, axis, cone_deg, breaks=4000)
    what = f"axis {axis}, cone {cone_deg} degrees, g = 0.5, ray up to 5 m"
    estimate = radiance(scene, [floor(5, 0.0)], "single", spp=256)
    if expected == 0.0:
        truth(what, source=QUADRATURE, expected=0.0, got=estimate[0], tolerance=0.0, reason="exact")
    else:
        # the quadrature's pieces end up to one piece off the edge of the cone: 1/4000 of the angle
        truth(what, source=QUADRATURE, **agreement(estimate, expected, truth_stderr=2e-4 * expected))


def test_radiance_is_the_sum_over_lamps_and_over_layers():
    lamps = [spot((-0.15, 0, -0.1)), spot((0.3, 0.2, 0.0), axis=(-0.2, 0, 1), cone_deg=50, blend=0.3)]
    scenes = [one_ray_scene(chosen, VAROS_WATER | {"phase": {"g": 0.8}}) for chosen in ([lamps[0]], [lamps[1]], lamps)]
    one, two, both = (radiance(scene, [floor(4.0, 0.3)], spp=128) for scene in scenes)
    assert_agrees(both, one[0] + two[0], np.hypot(one[1], two[1]), precision=0.05)


def test_red_scatters_least():
    scene = one_ray_scene(VAROS_LAMPS, VAROS_WATER | {"phase": {"g": 0.8}})
    red, green, blue = radiance(scene, [floor(5, 0.0)], "single")[0]
    assert red < green < blue
    assert RED[0] < GREEN[0] < BLUE[0]
