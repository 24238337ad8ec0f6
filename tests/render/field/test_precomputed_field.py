"""The precomputed field of open water against exact solutions, order-resolved truths, and the path integrator."""

import warnings

import numpy as np
import pytest
import warp as wp
from fields import look_up
from physics.rig import ISOTROPIC, TURBID, VAROS_LAMPS, VAROS_WATER, one_ray_scene, point, spot, water
from threadpoolctl import threadpool_limits

from varos_warp.device.launcher import Launcher
from varos_warp.render.field import open_water as precomputed
from varos_warp.render.field import solver
from varos_warp.render.field.directions import Directions, irradiance_matrix
from varos_warp.render.field.open_water import OpenWater, unavailable
from varos_warp.render.field.scattering import scattering_matrix
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.description import Scene
from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.geometry.parts import Part
from varos_warp.scene.lights.records import Lights
from varos_warp.scene.water.phase.henyey_greenstein import HenyeyGreenstein

PAPER_WATER = VAROS_WATER | {"phase": {"g": 0.8}}
FOUR_PI = 4.0 * np.pi


@pytest.fixture
def small(few_nodes, monkeypatch):
    """A field in a second, within 1 % of the light scattered towards a plane that faces the light."""
    monkeypatch.setattr(precomputed, "MULTIPLE", precomputed.MULTIPLE._replace(counts=(64, 3, 3)))
    monkeypatch.setattr(precomputed, "SINGLE", precomputed.SINGLE._replace(counts=(64, 3, 3)))


@pytest.fixture
def tiny(small, any_field):
    """Next to no nodes along the rays of cameras too, for tests that compare bytes."""


def open_water(lights, coefficients, **camera) -> OpenWater:
    return OpenWater(one_ray_scene(lights, coefficients, pixels=2, **camera), Launcher("cpu"))


def in_scattered(made: OpenWater, T) -> np.ndarray:
    """Light scattered twice or more on the rig's ray up to T [3]."""
    kept = made.field(made.scene.vehicle.cameras[0]).multiple
    values = kept.radiance.numpy()
    t = kept.nearest * np.exp(kept.log_step * np.arange(len(values)))
    middle = values[:, values.shape[1] // 2, values.shape[2] // 2]
    return np.array([np.interp(np.log(T), np.log(t), middle[:, c]) for c in range(3)])


def looked_up(made: OpenWater, p, d):
    """Irradiance of planes with normals d, and what rays along d receive, of the first lamp; [n, 3] each."""
    p, d = (wp.array(np.asarray(x, np.float32).reshape(-1, 3), dtype=wp.vec3, device="cpu") for x in (p, d))
    E, S = (wp.zeros(len(p), dtype=wp.vec3, device="cpu") for _ in range(2))
    carried = Lights(made.scene, "cpu")  # keeps the profiles to which the records point
    lights = carried.at(np.eye(4), np.zeros(3))[:1]
    wp.launch(look_up, len(p), inputs=[made._lights, lights, p, d, E, S], device="cpu")
    return E.numpy().astype(float), S.numpy().astype(float)


# -------------------------------------------------------------------------------------------------- exact solutions


@pytest.mark.parametrize(
    ("channel", "albedo", "fluence"),
    [
        (0, 0.5, {0.1: 8.0321037501, 0.5: 0.29476312213, 1: 0.058695137513, 2: 0.0079276237357, 5: 1.291324139e-4}),
        (1, 0.9, {0.1: 8.9189769392, 0.5: 0.48283269187, 1: 0.14328386153, 2: 0.037126399324, 5: 0.0029151250698}),
    ],
)
def test_fluence_around_a_point_source_is_that_of_case_and_zweifel(channel, albedo, fluence):
    """Isotropic scattering turns fluence into a source of albedo/(4 pi); within 0.5 % (1.1 % at 5 and albedo 0.5)."""
    made = open_water([point((0, 0, 0))], ISOTROPIC)
    r = np.array(list(fluence))
    p = np.outer(r, [0.6, 0.0, 0.8])
    source = looked_up(made, p, np.tile([0.0, 1.0, 0.0], (len(r), 1)))[1][:, channel]
    scattered = np.array(list(fluence.values())) * FOUR_PI - np.exp(-r) / r**2
    error = source / (albedo / FOUR_PI * scattered) - 1.0
    assert np.abs(error[r < 5]).max() < 0.005
    assert np.abs(error).max() < 0.015


SEA = {"kind": "fournier_forand", "backscatter_fraction": 0.0183}


def directions_of(half_angle, inside, outside):
    """Angles to the axis of the nodes, as kernels/field/open_water.py sets them."""
    k = np.arange(inside + outside + 1)
    beyond = np.maximum(k - inside, 0) / max(outside, 1)
    return np.where(
        k <= inside, half_angle * (1 - (1 - k / inside) ** 2), half_angle + (np.pi - half_angle) * beyond**2
    )


def flux_through_spheres(light, coefficients):
    """Distances in free paths, and the net flux outwards at each, direct light included, over what the lamp sends.

    In blue, where nothing is absorbed.
    """
    made, sigma = open_water([light], coefficients), coefficients["sigma_s"][2]
    assert coefficients["sigma_a"][2] == 0.0
    assert len(made._lights) == 1
    (field,) = made._fields.values()
    grid, E = field.grid, field.irradiance.numpy()[..., 2]
    d = solver.NEAREST_M * np.exp(grid.log_step * np.arange(grid.distances))
    net = (E[:, 0, 0] - E[:, -1, 0]).T * (d * np.exp(-grid.decay[2] * d))[:, None]
    if light["kind"] == "point":
        return sigma * d, net[:, 0] + np.exp(-sigma * d)
    x = np.linspace(0, np.pi, 20001)
    sent = np.trapezoid((x < grid.half_angle) * np.sin(x), x)
    nodes = directions_of(grid.half_angle, grid.inside, grid.outside)
    scattered = np.array([np.trapezoid(np.interp(x, nodes, row) * np.sin(x), x) for row in net])
    return sigma * d, scattered / sent + np.exp(-sigma * d)


@pytest.mark.parametrize(
    ("light", "coefficients", "near", "far"),
    [
        (point((0, 0, 0)), water(1.0, 1.0, 0.0), 3e-3, 1.5e-2),
        (point((0, 0, 0)), water(1.0, 1.0, 0.9), 3e-3, 1.5e-2),
        (point((0, 0, 0)), water(1.0, 1.0, 0.0) | {"phase": SEA}, 3e-3, 1.5e-2),
        (spot((0, 0, 0), cone_deg=precomputed.CONES_DEG[0]), water(1.0, 1.0, 0.0) | {"phase": SEA}, 7e-3, 3.5e-2),
        (spot((0, 0, 0)), PAPER_WATER, 1e-3, 5e-3),
    ],
    ids=["point, isotropic", "point, g 0.9", "point, Fournier-Forand", "narrow, Fournier-Forand", "the paper's"],
)
@pytest.mark.subject("multiple scattering")
def test_all_that_a_lamp_sends_passes_through_every_sphere_around_it(truth, light, coefficients, near, far):
    """In water that absorbs nothing, whatever its phase function: within 0.3 % up to two free paths, 1.5 % up to five.

    Of the narrowest cone, which is seen as a thin line from aside, 0.7 and 3.5 %, and of the paper's lamp in its water
    0.1 and 0.5 %. The net flux is what is left of light in opposite directions, so it is off by more than either.
    """
    d, flux = flux_through_spheres(light, coefficients)
    for nearest, farthest, tolerance in ((0.02, 2.0, near), (2.0, 5.0, far)):
        chosen = (d >= nearest) & (d <= farthest)
        assert chosen.sum() >= 5
        lamp = f"{light['kind']} {light.get('cone_deg', '')}"
        truth(
            f"net flux through spheres of {nearest} to {farthest} free paths, {lamp}, {coefficients['phase']}",
            source="energy is conserved",
            expected=1.0,
            got=flux[chosen],
            tolerance=tolerance,
            reason="the field's stated error",
        )


@pytest.mark.parametrize(
    ("T", "first", "total"),
    [
        (2.0, (6.756067373011e-4, 1.216092127142e-3), (1.432446393789e-3, 6.91971457098e-3)),
        (150.0, (6.94657213878e-4, 1.25038298498e-3), (1.483289011131e-3, 7.294186485738e-3)),
    ],
)
def test_multiple_in_scattering_of_an_isotropic_medium(T, first, total):
    """Along a ray 1 m from a point source of 1 W, albedo 0.5 and 0.9; within 0.2 % of the light in the water."""
    made = open_water([point((1, 0, 1), 1 / FOUR_PI)], ISOTROPIC)
    got, total = in_scattered(made, T), np.array(total)
    assert np.all(np.abs(got[:2] - (total - first)) <= 2e-3 * total)
    assert got[2] == 0.0


def test_multiple_in_scattering_of_the_papers_rig():
    """Both lamps, against an independent Monte Carlo; within 0.1 % of the light in the water."""
    made = open_water(VAROS_LAMPS, PAPER_WATER)
    single = {"R": 5.42226576952195e-5, "G": 6.17358347687215e-4, "B": 1.51897711245271e-3}
    assert in_scattered(made, 5.0)[0] == pytest.approx(2 * 5.8974e-8, abs=1e-3 * single["R"])
    assert in_scattered(made, 5.0)[1] == pytest.approx(2 * 7.8923e-6 + 5.577e-7 + 3.995e-8, rel=4e-3, abs=0)
    assert in_scattered(made, 25.0)[2] == pytest.approx(1.6521e-3 - single["B"], abs=1e-3 * 1.6521e-3 + 1.7e-6)
    # the lights are alike, so their field is one
    assert len(made._fields) == 1


def test_multiple_in_scattering_of_turbid_water():
    """At sigma_t = 1 and albedo 0.8 half of the light is scattered twice or more; within 0.2 % of all of it."""
    made = open_water(VAROS_LAMPS, TURBID)
    assert in_scattered(made, 2.0)[2] == pytest.approx(2.179e-2 - 0.0109644027294663, abs=2e-3 * 2.179e-2)


# ----------------------------------------------------------------------------------------- irradiance, by other means


def plate(p, n, size=5e-4):
    a = np.cross(n, [0.3, 0.5, 0.8])
    a /= np.linalg.norm(a)
    b = np.cross(n, a)
    corners = np.array([p + size * (i * a + j * b) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
    return Part("plate", corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), Diffuse(reflectance=[1.0] * 3))


def traced_irradiance(light, coefficients, p, n, spp):
    """Scattered irradiance of a white plate of a square millimetre, seen from 2 mm: mean and standard error [3]."""
    view = {
        "position": list(p + 2e-3 * n),
        "look_at": list(p),
        "resolution": [16, 16],
        "sensor_mm": [1e-3, 1e-3],
        "focal_mm": 34.0,
    }
    scene = Scene(
        water={"coefficients": coefficients},
        vehicle={"lights": [light], "cameras": [{"focal_mm": 1e3, **view}]},
        trajectory={"poses": [{"position": [0, 0, 0]}]},
    )
    how = {"spp": spp, "max_bounces": 1, "layers": ("multiple",), "integrator": "path", "seed": 5}
    image = FrameRenderer(scene, "cpu", parts=[plate(p, n)]).render(np.eye(4), outputs="A", **how).A
    pixels = np.pi * image.radiance.reshape(-1, 3).astype(float)
    return pixels.mean(axis=0), pixels.std(axis=0) / np.sqrt(len(pixels))


def facing(d, angle_deg, turn):
    """A point at an angle from the axis +y, and a normal: towards the lamp, turned, sideways or away."""
    a = np.radians(angle_deg)
    p = d * np.array([np.sin(a), np.cos(a), 0.0])
    z, x, y = -p / d, np.array([np.cos(a), -np.sin(a), 0.0]), np.array([0.0, 0.0, 1.0])
    return p, {"to": z, "turned": 0.8 * z + 0.6 * x, "sideways": y, "away": -z}[turn]


@pytest.mark.parametrize(
    ("light", "coefficients", "d", "angle", "turn"),
    [
        (spot((0, 0, 0)), PAPER_WATER, 5.0, 20, "to"),
        (spot((0, 0, 0)), PAPER_WATER, 5.0, 20, "turned"),
        (spot((0, 0, 0)), PAPER_WATER, 2.0, 10, "sideways"),
        (spot((0, 0, 0)), PAPER_WATER, 5.0, 20, "away"),
        (spot((0, 0, 0)), PAPER_WATER, 3.0, 45, "to"),
        (spot((0, 0, 0), cone_deg=20.0), water(0.2, 0.3, 0.8), 3.0, 5, "to"),
        (spot((0, 0, 0), cone_deg=120.0, blend=1.0), water(0.2, 0.3, 0.5), 3.0, 40, "turned"),
        (spot((0, 0, 0)), water(0.3, 0.4, 0.9), 3.0, 25, "to"),
        (point((0, 0, 0)), water(0.3, 0.4, 0.0), 2.0, 10, "sideways"),
    ],
)
def test_irradiance_is_that_of_a_traced_plate(request, light, coefficients, d, angle, turn):
    """Within 4 standard errors and 1 % of what a plate that faces the lamp receives.

    In the paper's water with all nodes, which other tests need too.
    """
    if coefficients is not PAPER_WATER:
        request.getfixturevalue("small")
    p, n = facing(d, angle, turn)
    got = looked_up(open_water([light], coefficients), [p, p], [n, -p / d])[0]
    mean, stderr = traced_irradiance(light, coefficients, p, n, spp=256)
    assert np.all(stderr < 0.07 * got[1])
    assert np.all(np.abs(got[0] - mean) < 4.0 * stderr + 0.01 * got[1]), f"{got[0] / mean} {stderr / mean}"


@pytest.mark.parametrize("coefficients", [PAPER_WATER, TURBID], ids=["the paper's", "turbid"])
def test_the_field_has_converged(monkeypatch, tmp_path, coefficients):
    """Inside the cone to an optical depth of 8 it is right to 0.5 % in the paper's water, to 1 % in turbid.

    It is linear between its nodes, so half of them leave an error four times as large: they differ by three errors.
    """
    rng = np.random.default_rng(3)
    farthest = 10.0 if coefficients is PAPER_WATER else 8.0
    a, d = np.radians(rng.uniform(0.0, 32.4, 2000)), np.exp(rng.uniform(np.log(0.2), np.log(farthest), 2000))
    p = np.stack([d * np.sin(a), d * np.cos(a), 0.0 * d], 1)
    one = looked_up(open_water([spot((0, 0, 0))], coefficients), p, -p / d[:, None])[0]
    monkeypatch.setenv("VAROS_WARP_CACHE", str(tmp_path))
    for name in ("FINE", "COARSE"):
        monkeypatch.setattr(solver, name, tuple(count // 2 for count in getattr(solver, name)))
    half = looked_up(open_water([spot((0, 0, 0))], coefficients), p, -p / d[:, None])[0]
    assert np.abs(half / one - 1).max() < 3.0 * (0.005 if coefficients is PAPER_WATER else 0.01)


# ------------------------------------------------------------------------------------------- scattering as a matrix


@pytest.mark.parametrize("g", [0.0, 0.5, 0.8, 0.9, 0.95])
def test_scattering_keeps_the_power_and_turns_lobes_into_wider_ones(g):
    """A lobe of Henyey and Greenstein of mean cosine b becomes one of g b; the first harmonic shrinks by g."""
    arriving, leaving = Directions.quadrature(80, 32, power=2), Directions.ends(41, 19, power=2)
    scatter = scattering_matrix(HenyeyGreenstein(g), arriving, leaving)

    def lobe(b, cosine):
        return (1 - b * b) / (1 + b * b - 2 * b * cosine) ** 1.5

    got = scatter @ lobe(0.7, np.cos(arriving.pairs[:, 0]))
    truth = lobe(0.7 * g, np.cos(leaving.pairs[:, 0]))
    assert got == pytest.approx(truth, abs=2e-3 * truth.max())
    # quantities in the plane of the axis too
    assert scatter @ arriving.vectors[:, 0] == pytest.approx(g * leaving.vectors[:, 0], abs=5e-3)


def test_irradiance_of_even_light_is_pi_and_of_a_far_lamp_the_cosine():
    arriving, normals = Directions.quadrature(80, 32, power=2), Directions.ends(41, 13, power=1)
    matrix = irradiance_matrix(arriving, normals)
    assert matrix.sum(axis=1) == pytest.approx(np.pi, rel=2e-3)
    lamp = np.exp(-((arriving.pairs[:, 0] / 0.01) ** 2))
    E = matrix @ lamp
    assert E / E.max() == pytest.approx(np.maximum(normals.vectors[:, 2], 0.0), abs=5e-3)


# ------------------------------------------------------------------------------------------- building and keeping


def test_the_field_comes_from_disk_the_second_time(tiny, monkeypatch, tmp_path):
    monkeypatch.setenv("VAROS_WARP_CACHE", str(tmp_path))
    lights, coefficients = [point((0.3, 0, 0))], water(0.2, 0.3, 0.6)
    first = in_scattered(open_water(lights, coefficients), 3.0)
    assert {path.name.split("-")[0] for path in tmp_path.iterdir()} == {"light", "camera"}

    def never(*_):
        raise AssertionError("built again")

    with monkeypatch.context() as patch:
        patch.setattr(solver.LightFieldSolver, "solve", never)
        patch.setattr(OpenWater, "_tabulated", never)
        assert np.array_equal(in_scattered(open_water(lights, coefficients), 3.0), first)
        # lights of the same kind share a field wherever they are and however bright
        open_water([point((0.1, 0, 0), 9.0)], coefficients)._lights  # noqa: B018
        for other in (water(0.2, 0.3, 0.61), water(0.2, 0.31, 0.6), water(0.21, 0.3, 0.6)):
            with pytest.raises(AssertionError, match="built again"):
                in_scattered(open_water(lights, other), 3.0)
        rigs = ([point((0.2, 0, 0))], {}), ([point((0.3, 0, 0), 2.0)], {}), (lights, {"focal_mm": 2.0})
        for moved, camera in rigs:
            with pytest.raises(AssertionError, match="built again"):
                in_scattered(open_water(moved, coefficients, **camera), 3.0)


def test_an_unwritable_cache_costs_only_the_time(tiny, monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    lights, coefficients = [point((0.3, 0, 0))], water(0.2, 0.3, 0.6)
    kept = in_scattered(open_water(lights, coefficients), 3.0)
    monkeypatch.setenv("VAROS_WARP_CACHE", str(tmp_path / "file" / "below"))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert np.array_equal(in_scattered(open_water(lights, coefficients), 3.0), kept)
    assert caught


def test_threads_do_not_change_a_byte(tiny, monkeypatch, tmp_path):
    """Neither those that run kernels, nor those that multiply matrices."""
    scene = one_ray_scene([spot((0.1, 0, 0), cone_deg=40)], water(0.2, 0.3, 0.6), pixels=2)
    made = []
    for threads in (1, 3):
        monkeypatch.setenv("VAROS_WARP_CACHE", str(tmp_path / str(threads)))
        with threadpool_limits(threads):
            made.append(in_scattered(OpenWater(scene, Launcher("cpu", threads)), 3.0))
    assert np.array_equal(*made)


@pytest.mark.parametrize(
    ("lights", "coefficients", "camera", "why"),
    [
        ([], PAPER_WATER, {}, "no lights"),
        (VAROS_LAMPS, None, {}, "does not scatter"),
        (VAROS_LAMPS, water(0.0, 0.1, 0.8), {}, "does not scatter"),
        (VAROS_LAMPS, water(0.1, 0.1, 0.99), {}, "mean cosine"),
        (VAROS_LAMPS, water(0.1, 0.1, -0.01), {}, "mean cosine"),
        (VAROS_LAMPS, VAROS_WATER | {"phase": {"kind": "petzold"}}, {}, None),
        (VAROS_LAMPS, PAPER_WATER, {"mount": "world"}, None),
        ([*VAROS_LAMPS, spot((0, 0, 0), cone_deg=180.0)], PAPER_WATER, {}, "cone"),
        ([spot((0, 0, 0), cone_deg=5.0)], PAPER_WATER, {}, "cone"),
        ([spot((0, 0, 0)) | {"radius_m": 0.01}], PAPER_WATER, {}, None),
        (VAROS_LAMPS, PAPER_WATER, {}, None),
        ([point((0, 0, 0)), spot((0, 0, 0), cone_deg=360.0)], water(0.1, 0.1, 0.0), {}, None),
        (VAROS_LAMPS, {"sigma_s": [0.005, 0.05, 0.24], "sigma_a": [0.005, 0.05, 0.25]}, {}, None),
        (VAROS_LAMPS, {"sigma_s": [0.005, 0.05, 0.26], "sigma_a": [0.005, 0.05, 0.25]}, {}, "murkier"),
    ],
)
def test_where_the_field_does_not_serve_a_sentence_says_why(lights, coefficients, camera, why):
    scene = one_ray_scene(lights, coefficients, **camera)
    got = unavailable(scene)
    assert got is None if why is None else why in got


def test_the_field_refuses_kinds_of_light_that_it_does_not_know():
    scene = one_ray_scene([point((0, 0, 0))], PAPER_WATER)
    unknown = scene.vehicle.lights[0].model_copy(update={"kind": "area"})
    scene = scene.model_copy(update={"vehicle": scene.vehicle.model_copy(update={"lights": [unknown]})})
    assert "'area'" in unavailable(scene)
