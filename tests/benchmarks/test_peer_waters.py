"""Phase functions as other renderers are given them, and how agreement is told; what renders is in the last part."""

import json

import numpy as np
import pytest
from physics.rig import Z, one_ray_scene, spot

from benchmarks import peers
from benchmarks.closed_form import along_rays
from benchmarks.peers import agree
from benchmarks.peers.lobes import lobes_of
from benchmarks.peers.view import FOURNIER_FORAND, RAYLEIGH
from varos_warp.errors import InputError
from varos_warp.scene.water import phase_function
from varos_warp.scene.water.phase.fournier_forand import FournierForand
from varos_warp.scene.water.phase.henyey_greenstein import HenyeyGreenstein
from varos_warp.scene.water.phase.mixture import Mixture
from varos_warp.scene.water.phase.petzold import Petzold
from varos_warp.scene.water.phase.rayleigh import Rayleigh

COSINES = np.cos(np.radians([0.05, 0.5, 3.0, 9.9, 10.1, 45.0, 90.0, 135.0, 179.0]))
WATERS = {
    "sea": FournierForand(1.10, 3.5835),
    "broad": FournierForand(1.15, 4.0),
    "by_backscatter": FournierForand.from_backscatter_fraction(0.01),
    "rayleigh": Rayleigh(),
    "mixture": Mixture([(2.0, FournierForand(1.15, 4.0)), (1.0, Rayleigh()), (1.0, HenyeyGreenstein(0.7))]),
}

# ------------------------------------------------------------------------------------------------------------ mapping


def cycles_density(lobe, cosine):
    """What Cycles computes of its node's inputs (kernel/closure/volume_util.h, version 5), here in float64."""
    if lobe.kind == RAYLEIGH:
        return 0.1875 / np.pi * (1.0 + cosine**2)
    if lobe.kind != FOURNIER_FORAND:
        return (1.0 - lobe.g**2) / (4.0 * np.pi * (1.0 + lobe.g**2 - 2.0 * lobe.g * cosine) ** 1.5)
    s, per_s = 0.5 * (1.0 - cosine), 4.0 / (3.0 * (lobe.n - 1.0) ** 2)
    v = -np.log(2.0 * lobe.backscatter * (0.5 * per_s - 1.0) + 1.0) / np.log(0.5 * per_s)
    delta = per_s * s
    power, rest = delta**v, 1.0 - delta
    ahead = (v * rest - (1.0 - power) + (delta * (1.0 - power) - v * rest) / s) / (4.0 * np.pi * rest**2 * power)
    return ahead + (per_s**-v - 1.0) / (per_s - 1.0) * (3.0 * cosine**2 - 1.0) / (16.0 * np.pi)


@pytest.mark.parametrize("name", WATERS)
def test_lobes_add_up_to_the_phase_function(name):
    lobes = lobes_of(WATERS[name])
    assert sum(lobe.weight for lobe in lobes) == pytest.approx(1.0, abs=1e-14)
    total = sum(lobe.weight * cycles_density(lobe, COSINES) for lobe in lobes)
    np.testing.assert_allclose(total, WATERS[name].eval(COSINES), rtol=2e-6)  # ours is divided by its integral


@pytest.mark.parametrize(("n", "mu"), [(1.02, 3.2), (1.10, 3.5835), (1.10, 4.5), (1.20, 4.2), (1.40, 4.9)])
def test_the_slope_comes_back_from_the_backscatter_fraction_that_cycles_is_given(n, mu):
    """In the float32 that its inputs have."""
    (lobe,) = lobes_of(FournierForand(n, mu))
    index, fraction = np.float32(lobe.n), np.float32(lobe.backscatter)
    d90 = np.float32(2) / (np.float32(3) * (index - np.float32(1)) ** 2)
    nu = -np.log(np.float32(2) * fraction * (d90 - np.float32(1)) + np.float32(1)) / np.log(d90)
    assert 3.0 - 2.0 * nu == pytest.approx(mu, abs=1e-5)


@pytest.mark.parametrize(("n", "mu"), [(1.0005, 3.5), (1.10, 5.0)])
def test_what_cycles_would_clamp_is_refused(n, mu):
    with pytest.raises(InputError, match="n below"):
        lobes_of(FournierForand(n, mu))


def test_tables_are_refused():
    with pytest.raises(InputError, match=r"petzold.*Fournier"):
        lobes_of(Petzold())
    with pytest.raises(InputError, match="petzold"):
        lobes_of(Mixture([(1.0, Petzold()), (1.0, Rayleigh())]))


# ---------------------------------------------------------------------------------------------------------- agreement


def found(*mean, stderr=0.0):
    return agree.Estimate(np.array(mean), np.full(3, stderr), 64, 1.0)


def test_programs_agree_within_the_tolerance_and_three_standard_errors_of_both():
    made = {
        "path": found(1.0, 2.0, 4.0, stderr=0.003),
        "field": found(1.0, 2.0, 4.0),
        "cycles": found(1.0, 2.0, 4.06, stderr=0.004),
    }
    row = agree.Row("lens", "ff3.6", "one event", made)
    assert row.pairs() == [("field", "path"), ("cycles", "path"), ("cycles", "field")]
    # 0.015 off; granted are 0.001 and 3 hypot(0.003, 0.004) / 4 = 0.00375, or 3 * 0.004 / 4 = 0.003
    np.testing.assert_allclose(row.excess("cycles", "path"), [0, 0, 0.015 / 0.00475])
    np.testing.assert_allclose(row.excess("cycles", "field"), [0, 0, 0.015 / 0.004])
    assert [line.split("|")[-2].strip() for line in agree.lines(row)] == ["yes", "NO"]
    assert [pair["agrees"] for pair in row.as_dict()["compared"]] == [True, False, False]
    wider = agree.Row("lens", "ff3.6", "all", made)
    np.testing.assert_allclose(wider.excess("cycles", "path"), [0, 0, 0.015 / 0.00875])
    assert "refused: has no such lens" in agree.lines(agree.Row("a", "b", "all", {}, {"x": "has no such lens"}))[0]


def test_rows_replace_older_ones_of_the_same_case(tmp_path):
    path = tmp_path / "agree.json"
    for light, red in (("all", 1.0), ("one event", 2.0), ("all", 3.0)):
        agree.store(path, agree.Row("lens", "ff3.6", light, {"path": found(red, 2.0, 4.0), "cycles": found(1, 1, 1)}))
    rows = json.loads(path.read_text())["rows"]
    assert [(row["light"], row["estimates"]["path"]["mean"][0]) for row in rows] == [("one event", 2.0), ("all", 3.0)]


@pytest.mark.parametrize(("scene", "water"), agree.CASES)
def test_cases_load_and_have_what_they_are_named_for(scene, water):
    built = agree.Case(scene, water).built
    assert len(built.parts) >= 2
    assert all(lamp.blend > 0.0 for lamp in built.scene.vehicle.lights)
    assert (built.camera.f_stop > 0.0) == (scene == "lens")
    assert lobes_of(phase_function(built.scene))


# ---------------------------------------------------------------------------------------------------------- rendering


def needs(peer):
    if peer not in peers.available():
        pytest.skip(f"{peer} is not installed")


def assert_no_residual(image, truth, precision):
    """Their mean is zero within its error by their spread, which must be small enough to tell."""
    residual = (image.astype(float) - truth).reshape(-1, 3)
    stderr = residual.std(axis=0, ddof=1) / np.sqrt(len(residual))
    assert np.all(stderr <= precision * np.mean(truth, axis=(0, 1))), f"too noisy to tell: {stderr}"
    assert np.all(np.abs(residual.mean(axis=0)) <= Z * stderr)


@pytest.mark.parametrize(
    ("peer", "phase"),
    [
        ("cycles", {"kind": "fournier_forand", "n": 1.10, "mu": 3.5835}),
        ("cycles", {"kind": "fournier_forand", "backscatter_fraction": 0.01}),
        ("cycles", {"kind": "rayleigh"}),
        ("mitsuba", {"kind": "rayleigh"}),
        (
            "cycles",
            {
                "kind": "mixture",
                "of": [
                    {"kind": "fournier_forand", "n": 1.15, "mu": 4.0, "weight": 0.6},
                    {"kind": "rayleigh", "weight": 0.1},
                    {"g": 0.7, "weight": 0.3},
                ],
            },
        ),
        (
            "mitsuba",
            {
                "kind": "mixture",
                "of": [{"g": 0.8, "weight": 0.6}, {"kind": "rayleigh", "weight": 0.1}, {"g": -0.5, "weight": 0.3}],
            },
        ),
    ],
)
def test_single_scattering_of_an_open_ray_is_its_integral_in_any_water(peer, phase):
    """A lamp that faces the camera: angles from ahead to behind."""
    needs(peer)
    water = {"sigma_s": [0.05, 0.2, 0.4], "sigma_a": [0.2, 0.1, 0.02], "phase": phase}
    scene = one_ray_scene([spot((0.5, 0.1, 4.0), (0, 0, -1))], water, pixels=32)
    lamp = scene.vehicle.lights[0]
    truth = along_rays(scene, lamp, np.zeros(3), np.array([[0.0, 1.0, 0.0]]), nodes=64)[0]
    how = {"variant": "scalar_rgb"} if peer == "mitsuba" else {}
    made = peers.render(peer, scene, [], scene.vehicle.cameras[0], np.eye(4), spp=256, max_events=1, **how)
    assert_no_residual(made.radiance, np.broadcast_to(truth, made.radiance.shape), 0.02)


def test_fournier_and_forand_is_refused_by_mitsuba():
    needs("mitsuba")
    water = {"sigma_s": [0.1] * 3, "sigma_a": [0.1] * 3, "phase": {"kind": "fournier_forand", "n": 1.1, "mu": 3.6}}
    scene = one_ray_scene([spot((0.5, 0.1, 4.0))], water)
    with pytest.raises(InputError, match="Mitsuba has no Fournier-Forand"):
        peers.render("mitsuba", scene, [], scene.vehicle.cameras[0], np.eye(4), spp=1)


@pytest.mark.parametrize("scene", agree.SCENES)
def test_cycles_sees_the_same_direct_light_and_single_scattering_in_sea_water(scene):
    """To 0.3 % of the image, pixel against pixel; `python -m benchmarks.peers agree` takes longer and tells more."""
    needs("cycles")
    case = agree.Case(scene, "ff3.6")
    truth, _ = case.render("path", "one event", 192, 1)
    image, _ = case.render("cycles", "one event", 48, 1)
    assert_no_residual(image, truth.astype(float), 3e-3)
