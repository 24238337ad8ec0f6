"""Lamps that are disks, and sheets of light: against closed forms, quadratures, triangulation and the reference."""

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss
from rig import assert_agrees, floor, hg, one_ray_scene, radiance, single_scattering, spot, to_vehicle, water

from varos_warp.errors import InputError
from varos_warp.render.field.along_camera import along_camera
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.description import Scene
from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.geometry.parts import Part

WATER = {"sigma_s": [0.2] * 3, "sigma_a": [0.1] * 3, "phase": {"g": 0.8}}
FAINT = water(0.3, 0.5, 0.0)


def disk(radius_m, position=(0, 0, 0), **how):
    return spot(position, **how) | {"radius_m": radius_m}


def sheet(position=(0, 0, 0), axis=(0, 0, 1), normal=(0, 1, 0), fan_deg=60.0, thickness_deg=0.2):
    return {
        "kind": "sheet",
        "position": to_vehicle(position),
        "direction": to_vehicle(axis),
        "normal": to_vehicle(normal),
        "fan_deg": fan_deg,
        "thickness_deg": thickness_deg,
        "intensity": [1.0] * 3,
    }


def plate(name, corners, reflectance=0.0):
    return Part(
        name,
        np.asarray(corners, float),
        np.array([[0, 2, 1], [0, 3, 2]], np.int32),
        Diffuse(reflectance=[reflectance] * 3),
    )


# --------------------------------------------------------------------------------------------------------------- disks


@pytest.mark.parametrize("radius", [0.1, 0.5, 2.0])
@pytest.mark.parametrize("integrator", ["path", "reference"])
def test_a_lambertian_disk_has_the_irradiance_of_the_textbook(tmp_path, radius, integrator):
    """A lamp of intensity I cos(theta): of radiance L = I / (pi r^2), so E = pi L r^2 / (r^2 + d^2) on its axis."""
    angle = np.linspace(0.0, 90.0, 2001)
    rows = "\n".join(f"{a},{np.cos(np.radians(a))}" for a in angle[:-1]) + "\n90,0\n"
    (tmp_path / "cosine.csv").write_text(f"angle_deg,intensity\n{rows}")
    lamp = {"kind": "profile", "file": str(tmp_path / "cosine.csv"), "intensity": [1.0] * 3, "radius_m": radius}
    estimate = radiance(one_ray_scene([lamp], None), [floor(1.0, 0.3)], "direct", integrator=integrator)
    assert_agrees(estimate, 0.3 / np.pi / (radius**2 + 1.0))


def irradiance_beside_an_edge(x, radius, edge, ground):
    """At ``x`` on the ground, below a disk of intensity 1 and a half-plane x > 0 at the distance ``edge``."""
    last = np.clip(-x * edge / (ground - edge), -radius, radius)  # lamp points up to there are seen past the edge
    node, weight = leggauss(64)
    end = np.arccos(-last / radius)
    t = 0.5 * end * (node + 1.0)
    across, half_chord = -radius * np.cos(t), radius * np.sin(t)
    d2 = (x - across[:, None]) ** 2 + (half_chord[:, None] * node) ** 2 + ground**2
    inner = (ground / d2**1.5) @ weight * half_chord
    return float(0.5 * end * (inner * radius * np.sin(t)) @ weight / (np.pi * radius**2))


@pytest.mark.parametrize("x", [-0.3, -0.15, 0.0, 0.1, 0.18, 0.201])
def test_the_penumbra_behind_an_edge_is_that_of_straight_lines(x):
    """Of a disk of radius 0.1 an edge at 1 m casts on the ground at 3 m a penumbra of +-0.2 m, and darkness beyond."""
    edge = plate("edge", [[0, 1, -50], [50, 1, -50], [50, 1, 50], [0, 1, 50]])
    scene = one_ray_scene([disk(0.1, cone_deg=120.0)], None, position=[x, 1.5, 0.0], look_at=[x, 3.0, 0.0])
    estimate = radiance(scene, [floor(3.0, 0.3), edge], "direct")
    if x > 0.2:
        assert not estimate[0].any()
    else:
        assert_agrees(estimate, 0.3 / np.pi * irradiance_beside_an_edge(x, 0.1, 1.0, 3.0), precision=0.05)


def over_disk(radius, f):
    """Mean of a function of the place (x, y) on a disk."""
    node, weight = leggauss(6)
    angles = 2 * np.pi * (np.arange(12) + 0.5) / 12
    return sum(
        w / 2 * np.mean([f(r * np.cos(a), r * np.sin(a)) for a in angles])
        for r, w in zip(radius * np.sqrt(0.5 * (node + 1.0)), weight, strict=True)
    )


def test_what_a_disk_scatters_once_is_the_mean_over_its_points():
    """A soft edge of all the cone, so that the quadrature is right to 1e-4."""
    lamp, T = disk(0.1, (-0.15, 0, -0.1), blend=1.0), 3.0
    estimate = radiance(one_ray_scene([lamp], WATER), [floor(T, 0.0)], "single", spp=256)
    expected = over_disk(
        0.1,
        lambda x, y: single_scattering(
            (x - 0.15, y, -0.1), 0.2, 0.3, 0.8, T, axis=(0, 0, 1), cone_deg=65.0, blend=1.0, breaks=20
        ),
    )
    assert_agrees(estimate, expected, truth_stderr=2e-4 * expected)


def test_a_disk_of_no_size_is_a_point():
    ground = [floor(3.0, 0.3)]
    point, small = (
        radiance(one_ray_scene([lamp], WATER), ground, "single")
        for lamp in (spot((-0.15, 0, -0.1)), disk(1e-6, (-0.15, 0, -0.1)))
    )
    assert_agrees(small, point[0], truth_stderr=point[1])


CORNER = [floor(2.0, 0.8), plate("wall", [[0.7, -5, -5], [0.7, 5, -5], [0.7, 5, 5], [0.7, -5, 5]], 0.8)]
"""A floor and a wall, which light each other."""


@pytest.mark.parametrize("lit", [(1.0, 0.0), (0.0, 1.0)], ids=["disk", "sheet"])
def test_paths_and_the_reference_agree_on_light_from_wall_to_wall(lit):
    """Virtual point lights and paths, weighted against each other, sum to the light that there is; one is dark."""
    lamps = [disk(0.6, (0, 0, 0.5)), sheet((0, 0.3, 0), (0.3, -0.15, 1), thickness_deg=20.0)]
    lamps = [lamp | {"intensity": [one] * 3} for lamp, one in zip(lamps, lit, strict=True)]
    scene = one_ray_scene(lamps, None, direction=(0.2, 0, 1))
    one = radiance(scene, CORNER, "multiple", spp=256)
    other = radiance(scene, CORNER, "multiple", spp=2048, integrator="reference")
    assert_agrees(one, other[0], truth_stderr=other[1])


def test_paths_and_the_reference_agree_in_turbid_water():
    lamps = [disk(0.6, (-0.7, 0, -0.3)), sheet((-0.7, 0.2, -0.3), thickness_deg=80.0)]
    scene, ground = one_ray_scene(lamps, FAINT), [floor(2.0, 0.5)]
    one, other = radiance(scene, ground, spp=128), radiance(scene, ground, spp=2048, integrator="reference")
    assert_agrees(one, other[0], truth_stderr=other[1], precision=0.02)


@pytest.mark.parametrize("radius", [0.05, 0.4], ids=["tables along the rays", "no tables"])
@pytest.mark.parametrize("layer", ["single", "multiple"])
def test_the_field_and_paths_agree_on_a_disk_beside_the_camera(radius, layer, few_nodes):
    """With a wall that hides a part of what it scatters; in the corner, the penumbra shows.

    Few nodes of the field are right enough.
    """
    lamp = disk(radius, (-0.25, 0, -0.1), axis=(0.2, 0, 1), cone_deg=80.0)
    scene = one_ray_scene([lamp], WATER, direction=(0.2, 0, 1))
    assert along_camera(scene, scene.vehicle.cameras[0]) == (radius < 0.1)
    parts = [*CORNER, plate("edge", [[-0.1, -0.5, 0.8], [0.1, -0.5, 0.8], [0.1, 0.5, 0.8], [-0.1, 0.5, 0.8]], 0.3)]
    field = radiance(scene, parts, layer, spp=512, integrator="field")
    paths = radiance(scene, parts, layer, spp=2048)
    assert_agrees(field, paths[0], truth_stderr=paths[1])


def test_sheets_are_rendered_by_paths_and_the_field_says_why():
    renderer = FrameRenderer(one_ray_scene([sheet()], WATER, pixels=2), "cpu", parts=[])
    with pytest.raises(InputError, match="'sheet'"):
        renderer.render(np.eye(4), outputs="A", spp=1, integrator="field")


# -------------------------------------------------------------------------------------------------------------- sheets


def scattered_from_sheet(lamp, T):
    """Radiance along z of unit light that a sheet at ``lamp`` sends, scattered once in WATER up to T, in 1e6 steps."""
    p, axis, normal = (np.array(to_vehicle(lamp[key])) for key in ("position", "direction", "normal"))
    axis = axis / np.linalg.norm(axis)
    normal = normal - (normal @ axis) * axis
    normal /= np.linalg.norm(normal)
    t = T * (np.arange(1_000_000) + 0.5) / 1_000_000
    x = t[:, None] * [0.0, 0.0, 1.0] - p
    ahead, up, aside = x @ axis, x @ normal, x @ np.cross(axis, normal)
    tangents = np.tan(np.radians([lamp["thickness_deg"], lamp["fan_deg"]]) / 2)
    lit = (np.abs(up) < tangents[0] * ahead) & (np.abs(aside) < tangents[1] * ahead)
    d = np.linalg.norm(x, axis=1)
    return T * float((lit * 0.2 * hg(-x[:, 2] / d, 0.8) / d**2 * np.exp(-0.3 * (t + d))).mean())


@pytest.mark.parametrize(
    "lamp",
    [
        sheet((-0.5, 0, 0), (0.5, 0, 1), (1, 0, -0.5), thickness_deg=0.5),
        sheet((-0.5, 0, 0), (0.5, 0, 1), (0, 1, 0)),
        sheet((0.1, 0.002, 0.5), (-1, 0, 0), (1, 1, 0), fan_deg=150.0, thickness_deg=4.0),
    ],
    ids=["across", "in the sheet", "beside the ray"],
)
def test_a_ray_through_a_sheet_receives_what_a_quadrature_says(lamp):
    estimate = radiance(one_ray_scene([lamp], WATER, pixels=8), [floor(3.0, 0.0)], "single", spp=64)
    expected = scattered_from_sheet(lamp, 3.0)
    assert expected > 0.0
    assert_agrees(estimate, expected, truth_stderr=5e-4 * expected)


def test_the_line_of_a_sheet_lies_where_triangulation_says():
    """On a tilted plate, to 0.01 pixels: the image of where the sheet's plane meets it is a straight line."""
    laser, point, across = np.array([0.1, 0.0, 0.5]), np.array([0.0, 2.0, 0.0]), np.array([0.3, -1.0, 0.2])
    u, v = np.array([1.0, 0.3, 0.0]), np.array([0.0, 0.2, 1.0])  # in the plate
    corners = [point + 5 * (a * u + b * v) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    lamp = {
        "kind": "sheet",
        "position": laser.tolist(),
        "direction": [0, 1, -0.25],
        "normal": [0.1, 0.2, 1.0],
        "fan_deg": 80.0,
        "thickness_deg": 0.05,
    }
    scene = Scene(
        water="none",
        trajectory={"poses": [{"position": [0, 0, 0]}]},
        vehicle={
            "lights": [lamp],
            "cameras": [{"id": "M0", "resolution": [96, 48], "sensor_mm": [9.6, 4.8], "focal_mm": 50.0}],
        },
    )
    renderer = FrameRenderer(scene, "cpu", parts=[plate("plate", corners, 0.5)])
    image = renderer.render(np.eye(4), outputs="A", spp=256, seed=3, layers=("direct",)).A.radiance[..., 0]
    found = (image * (np.arange(48)[:, None] + 0.5)).sum(axis=0) / image.sum(axis=0)
    axis = np.array([0, 1, -0.25]) / np.hypot(1, 0.25)
    normal = np.array([0.1, 0.2, 1.0])
    normal -= (normal @ axis) * axis
    start = np.linalg.solve([across, normal, [1.0, 0, 0]], [across @ point, normal @ laser, 0.0])
    ends = start + np.array([[-0.2], [0.2]]) * np.cross(across, normal)
    x, y = 48 + 500 * ends[:, 0] / ends[:, 1], 24 - 500 * ends[:, 2] / ends[:, 1]
    columns = np.arange(96) + 0.5
    exact = y[0] + (columns - x[0]) * (y[1] - y[0]) / (x[1] - x[0])
    assert np.ptp(exact) > 3.0
    off = np.polynomial.Polynomial.fit(columns, found - exact, 1)
    assert np.abs(off(np.array([0.0, 96.0]))).max() < 0.01
