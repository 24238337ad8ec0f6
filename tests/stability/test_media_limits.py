"""Where light transport ends over the water: coefficients, phase functions, albedo; on either side of each boundary."""

import numpy as np
import pytest
from physics.rig import VAROS_LAMPS, VAROS_WATER, water

from benchmarks.stability.transport_media import (
    case_zweifel_total,
    flight_error,
    isotropic_total,
    multiple_errors,
    phase_moment_error,
    phase_value_error,
    single_error,
)
from varos_warp.errors import InputError
from varos_warp.render.field.open_water import unavailable
from varos_warp.render.options import resolve_integrator
from varos_warp.scene.description import Scene
from varos_warp.scene.file.load import load_scene


def scene_of(coefficients, lights=VAROS_LAMPS):
    return Scene(
        water={"coefficients": coefficients},
        vehicle={"lights": lights},
        trajectory={"poses": [{"position": (0, 0, 0)}]},
    )


def integrator_of(scene):
    return resolve_integrator("auto", None, lambda: unavailable(scene))


@pytest.mark.parametrize("sigma_t", [1e-7, 1e-3, 0.01, 0.1, 1.0, 50.0, 100.0])
def test_single_scattering_from_clear_to_black_water(sigma_t):
    """0.2 % is what ten nodes leave along a ray to the horizon; paths within four times their noise, 0.5 to 2 %."""
    assert single_error(sigma_t, 0.8, "field") < 2e-3
    assert single_error(sigma_t, 0.8, "path") < 0.08


def test_in_black_water_the_quadrature_misses_what_is_left_of_the_light():
    """At 200/m an optical distance of 66 lies between lamp and camera, and the radiance is 1e-17."""
    assert 2e-3 < single_error(200.0, 0.8, "field") < 0.1


@pytest.mark.parametrize("g", [0.0, 0.5, 0.85])
def test_single_scattering_with_tables_over_g(g):
    for lamp in ((0.15, 0.0, -0.1), (0.02, 0.0, 0.5)):
        assert single_error(0.1, g, "field", lamp) < 3e-3


def test_tables_leave_backward_water_to_paths():
    for g, expected in ((0.0, "field"), (-0.01, "path"), (0.98, "field"), (0.981, "path")):
        assert integrator_of(scene_of(VAROS_WATER | {"phase": {"g": g}})) == expected
    assert np.isnan(single_error(0.1, -0.01, "field"))
    assert single_error(0.1, -0.31, "path") < 0.02


@pytest.mark.parametrize("murkiest", [0.49, 0.51])
def test_tables_leave_water_with_one_very_murky_channel_to_paths(murkiest):
    """Their grid reaches 200 m in the clearest channel; beyond an optical depth of 100 the others are dark on it."""
    scene = scene_of({"sigma_s": [0.0, 0.0, 0.3], "sigma_a": [0.01, 0.1, murkiest - 0.3], "phase": {"g": 0.8}})
    assert integrator_of(scene) == ("field" if murkiest < 0.5 else "path")


@pytest.mark.parametrize("g", [-0.99, -0.9, 0.0, 0.9, 0.99, 0.999])
def test_phase_functions_are_right_where_a_scene_may_name_them(g):
    """1 - g is known to 6e-8/(1 - g), and near the backward peak 1 + cos to 1e-7 of a width of (1 + g)^2."""
    assert phase_value_error(g) < 3e-3
    assert phase_moment_error(g) < 1e-4
    assert scene_of(water(0.1, 0.2, g))


@pytest.mark.parametrize("g", [-0.9901, -0.9999, 0.9991, 1.0 - 1e-9])
def test_sharper_phase_functions_are_refused(g, tmp_path):
    """What a kernel would make of them: 23 % off at -0.999, infinite at -0.9999, 20 % off at 1 - 1e-7."""
    file = tmp_path / "scene.yaml"
    phase = f"{{g: {g:.10f}}}"
    file.write_text(
        f"water: {{coefficients: {{sigma_s: [1, 1, 1], sigma_a: [0, 0, 0], phase: {phase}}}}}\n"
        "trajectory: {poses: [{position: [0, 0, 0]}]}\n"
    )
    with pytest.raises(InputError, match=r"phase\.g"):
        load_scene(file)


def test_phase_functions_fail_right_beyond():
    assert phase_value_error(-0.999) > 0.1
    assert phase_value_error(1 - 1e-7) > 0.1


@pytest.mark.parametrize("albedo", [0.5, 0.9])
def test_the_fourier_integral_has_the_known_totals(albedo):
    """Sums over all orders known to thirteen digits (tests/physics/test_multiple_scattering.py), a metre before."""
    truth = {0.5: 1.483289011131e-3, 0.9: 7.294186485738e-3}[albedo]
    assert case_zweifel_total(albedo, foot=1.0) == pytest.approx(truth, rel=1e-3)


def test_all_orders_of_water_that_absorbs_nothing():
    """Isotropic water without end: tables reach 30 mean free paths, and lose 0.1 % at albedo 0.99, at most 5.6 % at 1.

    Light diffuses: at a distance r its fluence is 3/(4 pi r), of which a dark sphere at 30 takes 3/(4 pi 30). Beyond
    the tables light is not dark but goes on as it falls off at their end. Albedos of 0.5 and 0.9 are held against
    their totals in tests/physics/test_field_integrator.py.
    """
    assert isotropic_total(0.99, "field")[0] / case_zweifel_total(0.99) == pytest.approx(1 - 1e-3, abs=1e-3)
    assert 0.0 < 1 - isotropic_total(1.0 - 1e-9, "field")[0] / case_zweifel_total(1.0 - 1e-9) < 0.056


def test_tables_hold_all_orders_in_thick_water(few_nodes):
    """A mean free path of 33 cm; thicker water is on the page (docs/stability.md), with all nodes.

    Paths have much noise here, rare and bright: 0.8 % is left in the mean of 96 pixels with 32768 samples each.
    """
    error, noise = multiple_errors(3.0, 0.8, "spots of 65 degrees", spp=1 << 15)
    assert noise < 0.01
    assert error < 0.01 + 4 * noise


@pytest.mark.parametrize("optical_depth", [1e-12, 1e-7, 9e-7, 1.1e-6, 1e-3, 1.0, 17.4, 17.6, 100.0, 1e4, 1e8])
def test_free_flights_follow_their_law_through_any_water(optical_depth):
    for t_max in (5.0, 1e9):
        assert flight_error(optical_depth / t_max, t_max) < 2e-6
