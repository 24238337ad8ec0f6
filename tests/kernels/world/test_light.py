"""Lamps: Blender's soft edge, and the part of a ray that a cone lights, against brute force in float64."""

import numpy as np
import pytest
import warp as wp
from chance import run

from varos_warp.kernels.world.lights import light

EPS = 1.2e-7
"""Spacing of float32 at 1."""


@wp.kernel(enable_backward=False)
def shade(lamp: light.Light, cos_angle: wp.array(dtype=float), share: wp.array(dtype=float)):
    i = wp.tid()
    share[i] = light.falloff(lamp, cos_angle[i])


@wp.kernel(enable_backward=False)
def clip(
    lamps: wp.array(dtype=light.Light),
    o: wp.array(dtype=wp.vec3),
    d: wp.array(dtype=wp.vec3),
    t_max: wp.array(dtype=float),
    lit: wp.array(dtype=light.LitInterval),
):
    i = wp.tid()
    lit[i] = light.light_beam(lamps[i], o[i], d[i], t_max[i])


def lamp(cone_deg=65.0, blend=0.0, position=(0, 0, 0), axis=(0, 0, 1)):
    record = light.Light()
    record.position, record.axis = wp.vec3(*map(float, position)), wp.vec3(*map(float, axis))
    record.cos_half, record.blend = float(np.cos(np.radians(cone_deg) / 2)) if cone_deg < 360 else -1.0, blend
    record.intensity = wp.vec3(1.0)
    return record


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def light_beams(cone_deg, o, d, t_max, position=None, axis=None):
    """Intervals of the device as distances along the rays, float64 [N, 2], NaN where nothing is lit; its record."""
    n = len(o)
    position = np.zeros((n, 3)) if position is None else position
    axis = np.tile([0.0, 0, 1], (n, 1)) if axis is None else axis
    cone_deg = np.broadcast_to(cone_deg, n)
    lamps = wp.array(
        [lamp(c, 0.0, p, a) for c, p, a in zip(cone_deg, position, axis, strict=True)], dtype=light.Light, device="cpu"
    )
    lit = run(clip, [lamps, o, d, np.broadcast_to(t_max, n).astype(float)], [light.LitInterval], dim=n)
    interval = np.column_stack([lit["ya"], lit["yb"]]).astype(float) + lit["foot"].astype(float)[:, None]
    interval[~(lit["angle"] > 0)] = np.nan
    return interval, lit


def assert_matches_brute_force(cone_deg, o, d, t_max, position, axis, nodes=400):
    """Every node of a fine grid on each ray is lit in the device's interval if it lies in the cone, and only then.

    Of cones that are as good as half the space the interval may hold more: the falloff tells there.

    Nodes so close to the cone that float32 coordinates cannot tell are left out: the cosine is uncertain by a few EPS,
    and by the position's rounding seen from the lamp.
    """
    interval, _ = light_beams(cone_deg, o, d, t_max, position, axis)
    o, d, position, axis = (np.float32(x).astype(float) for x in (o, d, position, axis))
    cos_half = np.float32(np.cos(np.radians(np.broadcast_to(cone_deg, len(o))) / 2)).astype(float)[:, None]
    foot = ((position - o) * d).sum(axis=1)[:, None]
    h = np.maximum(np.linalg.norm(position - o - foot * d, axis=1), 1e-6)[:, None]
    start, end = np.arctan2(-foot, h), np.arctan2(np.reshape(t_max, (-1, 1)) - foot, h)
    theta = start + (end - start) * (np.arange(nodes) + 0.5) / nodes
    t = foot + h * np.tan(theta)
    offset = o[:, None] + t[..., None] * d[:, None] - position[:, None]
    distance = np.linalg.norm(offset, axis=2)
    cosine = (offset * axis[:, None]).sum(axis=2) / distance
    doubt = 6 * EPS * (1 + (np.abs(foot) + np.abs(position).max(axis=1, keepdims=True) + np.abs(t)) / distance)
    clear = np.abs(cosine - cos_half) > doubt
    inside = cosine > cos_half
    found = (t >= interval[:, :1]) & (t <= interval[:, 1:])
    wrong = clear & np.where(cos_half > 1e-4, inside != found, inside & ~found)
    assert clear.mean() > 0.9
    rays = np.flatnonzero(wrong.any(axis=1))
    for i in rays:
        raise AssertionError(
            f"{len(rays)} of {len(o)} rays, first: cone {cone_deg}, o {o[i]}, d {d[i]}, "
            f"lamp {position[i]}, axis {axis[i]}, lit {interval[i]}"
        )
    return inside


# ------------------------------------------------------------------------------------------------------- the soft edge


@pytest.mark.parametrize("cone_deg", [1.0, 40.0, 65.0, 179.0, 200.0, 359.0])
@pytest.mark.parametrize("blend", [0.0, 0.15, 0.5, 1.0])
def test_the_edge_is_blenders(cone_deg, blend):
    """smoothstep(((z - size)/(1 - size))/blend) with z = cos(angle), size = cos(half angle)."""
    z = np.linspace(-1, 1, 20001)
    size = np.cos(np.radians(cone_deg) / 2)
    x = (z - size) / (1 - size)
    s = np.clip(x / blend, 0, 1) if blend else (x >= 0).astype(float)
    got = run(shade, [lamp(cone_deg, blend), z], [float])
    away = np.abs(z - size) > 2 * EPS
    width = max(blend * (1 - size), EPS)
    np.testing.assert_allclose(got[away], (s * s * (3 - 2 * s))[away], atol=2e-6 + 1.5 * 2 * EPS / width * (blend > 0))


def test_blend_1_leaves_full_intensity_on_the_axis_alone_and_a_cone_of_360_degrees_everywhere():
    assert run(shade, [lamp(65.0, 1.0), np.array([1.0])], [float])[0] == 1.0
    assert run(shade, [lamp(65.0, 1.0), np.array([0.99])], [float])[0] < 1.0
    for blend in (0.0, 1.0):
        assert np.all(run(shade, [lamp(360.0, blend), np.linspace(-1, 1, 101)], [float]) == 1.0)


def test_the_paper_cone_holds_its_share_of_the_sphere():
    """Solid angle of 65 deg: 0.984000566647 sr."""
    z = (np.arange(200_000) + 0.5) / 100_000 - 1
    share = run(shade, [lamp(65.0), z], [float])
    assert abs(4 * np.pi * share.mean() - 0.984000566647) < 4 * np.pi / len(z)


# ------------------------------------------------------------------------------------------------------ lit intervals


def random_rays(seed, n, spread=3.0):
    rng = np.random.default_rng(seed)
    return rng.normal(0, spread, (n, 3)), unit(rng.normal(size=(n, 3))), rng.choice([0.5, 5.0, 50.0], n)


@pytest.mark.parametrize("cone_deg", [1.0, 10.0, 40.0, 65.0, 90.0, 120.0, 170.0, 179.0, 179.98, 179.9999, 180.0])
def test_light_beams_of_random_rays(cone_deg):
    """Lamps before, behind and beside the camera, rays in every direction."""
    n = 3000
    o, d, t_max = random_rays(int(cone_deg * 100), n)
    rng = np.random.default_rng(1)
    # half of the lamps look where the ray passes, so that narrow cones meet it
    position = rng.normal(0, 1, (n, 3))
    aim = o + rng.uniform(0, 5, (n, 1)) * d + rng.normal(0, 0.05, (n, 3))
    axis = unit(np.where(np.arange(n)[:, None] % 2, aim - position, rng.normal(size=(n, 3))))
    inside = assert_matches_brute_force(cone_deg, o, d, t_max, position, axis)
    assert 0.02 < inside.any(axis=1).mean()


@pytest.mark.parametrize("cone_deg", [1.0, 40.0, 65.0, 120.0, 179.0, 180.0])
@pytest.mark.parametrize("tilt", [0.0, 1e-7, 1e-5, 1e-3, -1e-5, -1e-3])
def test_rays_along_the_generator_of_a_cone(cone_deg, tilt):
    """The quadratic's leading term vanishes; inside and outside of the cone, with and against the light."""
    half = np.radians(cone_deg) / 2
    phi = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    across, along = np.sin(half + tilt), np.cos(half + tilt)
    d = np.column_stack([across * np.cos(phi), across * np.sin(phi), np.full(24, along)])
    o = np.random.default_rng(2).normal(0, 0.3, (24, 3)) - np.where(phi > np.pi, 3, -3)[:, None] * d
    d = np.where(phi > np.pi, 1, -1)[:, None] * d
    zeros, axis = np.zeros((24, 3)), np.tile([0.0, 0, 1], (24, 1))
    assert_matches_brute_force(cone_deg, o, d, np.full(24, 8.0), zeros, axis)


@pytest.mark.parametrize("cone_deg", [40.0, 120.0, 179.0, 179.98, 179.9999, 180.0])
def test_rays_across_the_axis(cone_deg):
    """Perpendicular to it, before and behind the lamp: a chord of the cone, or nothing."""
    o = np.array([[-5.0, 0.3, 2.0], [-5, 0.3, -2], [-5, 0, 1e-3], [-5, 0, -1e-3], [0, -5, 0.1], [5, 1, 100.0]])
    d = np.array([[1.0, 0, 0], [1, 0, 0], [1, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0]])
    zeros, axis = np.zeros((6, 3)), np.tile([0.0, 0, 1], (6, 1))
    assert_matches_brute_force(cone_deg, o, d, np.full(6, 10.0), zeros, axis)


@pytest.mark.parametrize("side", [1e-6, 1e-5, 1e-4, 1e-3])
def test_rays_close_to_the_lamp(side):
    """Past it at ``side`` metres: the lit part begins or ends at the lamp, and the integral of 1/d^2 must keep it."""
    rng = np.random.default_rng(3)
    n = 200
    d = unit(rng.normal(size=(n, 3)))
    across = unit(np.cross(d, rng.normal(size=(n, 3))))
    o = side * across - 1.0 * d
    position, axis = np.zeros((n, 3)), unit(rng.normal(size=(n, 3)))
    interval, lit = light_beams(65.0, o, d, 3.0, position, axis)
    o, d, axis = (np.float32(x).astype(float) for x in (o, d, axis))
    foot = -(o * d).sum(axis=1)
    h = np.linalg.norm(o + foot[:, None] * d, axis=1)
    theta = np.linspace(np.arctan2(-foot, h), np.arctan2(3 - foot, h), 20001, axis=1)
    # at the angle theta from the foot: cosine to the axis = (v cos(theta) + h d sin(theta)) . axis / h
    v = ((o + foot[:, None] * d) * axis).sum(axis=1)[:, None] / h[:, None]
    cosine = v * np.cos(theta) + (d * axis).sum(axis=1)[:, None] * np.sin(theta)
    exact = (cosine > np.float32(np.cos(np.radians(32.5)))).mean(axis=1) * (theta[:, -1] - theta[:, 0])
    angle = np.where(np.isfinite(interval[:, 0]), lit["angle"], 0.0) * lit["h"]
    # the foot is known to a few spacings of its distance: a turn of that over h of what is seen
    np.testing.assert_allclose(angle, exact, atol=3e-4 + 8 * EPS / side)


def test_a_lamp_without_a_cone_lights_the_whole_ray():
    o, d, t_max = random_rays(4, 200)
    for cone_deg in (200.0, 360.0):
        interval, lit = light_beams(cone_deg, o, d, t_max)
        np.testing.assert_allclose(interval, np.column_stack([np.zeros(200), t_max]), atol=2e-5)
        np.testing.assert_allclose(lit["h"], np.linalg.norm(np.cross(o, d), axis=1), rtol=1e-5, atol=1e-6)


def test_an_open_ray_is_lit_to_its_end():
    """Along the axis from inside the cone, nothing hit: the interval ends where rays end."""
    interval, lit = light_beams(65.0, np.array([[0.1, 0, 1.0]]), np.array([[0.0, 0, 1]]), 1e9)
    np.testing.assert_allclose(interval, [[0.0, 1e9]], atol=1e-6)
    np.testing.assert_allclose(lit["angle"], np.arctan2(0.1, 1.0) / 0.1, rtol=1e-5)


def test_a_ray_from_the_lamp_itself_along_its_axis_is_lit_and_finite():
    interval, lit = light_beams(65.0, np.zeros((2, 3)), np.array([[0.0, 0, 1], [0, 0, -1.0]]), 5.0)
    assert np.isfinite(lit["angle"]).all()
    np.testing.assert_allclose(interval[0], [0, 5], atol=1e-6)
    assert np.isnan(interval[1]).all()


# ------------------------------------------------------------------------------------------------------------- sheets


@wp.kernel(enable_backward=False)
def emit(
    lamp: light.Light,
    u: wp.array(dtype=wp.vec2),
    d: wp.array(dtype=wp.vec3),
    area: wp.array(dtype=float),
    sent: wp.array(dtype=float),
):
    i = wp.tid()
    d[i] = light.light_emit(lamp, u[i][0], u[i][1]).d
    area[i] = light.light_solid_angle(lamp, wp.dot(d[i], lamp.axis))
    sent[i] = light.light_sample(lamp, lamp.position + 2.0 * d[i]).L[0]


def sheet(fan_deg, thickness_deg, position=(0, 0, 0)):
    """Along z; the fan along x."""
    record = lamp(360.0, position=position)
    record.sheet = 1
    record.right, record.up = (
        wp.vec3(*(np.eye(3)[i] / np.tan(np.radians(angle) / 2))) for i, angle in enumerate((fan_deg, thickness_deg))
    )
    return record


@pytest.mark.parametrize(("fan_deg", "thickness_deg"), [(60.0, 0.1), (120.0, 1.0), (170.0, 30.0), (5.0, 5.0)])
def test_a_sheet_emits_the_light_within_its_four_planes(fan_deg, thickness_deg):
    """Its solid angle is that of a rectangular pyramid, 4 asin(sin a sin b); directions fill it and nothing else."""
    side = (np.arange(600) + 0.5) / 600
    u = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    d, area, sent = run(emit, [sheet(fan_deg, thickness_deg), u], [wp.vec3, float, float])
    a, b = np.radians([fan_deg, thickness_deg]) / 2
    assert sent.min() == 1.0
    assert abs((area.astype(float) * sent).mean() / (4 * np.arcsin(np.sin(a) * np.sin(b))) - 1) < 1e-4
    np.testing.assert_allclose(np.abs(d[:, :2] / d[:, 2:]).max(axis=0), np.tan([a, b]), rtol=2e-3)
    beyond = np.array([[np.tan(1.001 * a), 0, 1], [0, -np.tan(1.001 * b), 1], [0, 0, -1]])
    assert not run(look, [sheet(fan_deg, thickness_deg), beyond], [float]).any()


@wp.kernel(enable_backward=False)
def look(lamp: light.Light, p: wp.array(dtype=wp.vec3), sent: wp.array(dtype=float)):
    i = wp.tid()
    sent[i] = light.light_sample(lamp, p[i]).L[0]


@pytest.mark.parametrize(("fan_deg", "thickness_deg"), [(60.0, 0.5), (150.0, 5.0), (40.0, 40.0)])
def test_the_part_of_a_ray_inside_a_sheet_is_between_planes(fan_deg, thickness_deg):
    """Random rays, half of them aimed into the sheet, some in its plane; against the four planes in float64."""
    n = 4000
    o, d, t_max = random_rays(5, n, spread=1.0)
    aim = np.random.default_rng(6).uniform(-0.3, 0.3, (n, 3)) * [1, 0.01, 0] + [0, 0, 2.0]
    d[::2] = unit(aim - o)[::2]
    o[::8, 1] = d[::8, 1] = 0.0
    d = unit(d)
    lit = run(
        clip,
        [wp.array([sheet(fan_deg, thickness_deg)] * n, dtype=light.Light, device="cpu"), o, d, t_max],
        [light.LitInterval],
        dim=n,
    )
    o, d, t_max = (np.float32(x).astype(float) for x in (o, d, t_max))
    a, b = np.tan(np.radians([fan_deg, thickness_deg]) / 2)
    low, high = np.zeros(n), t_max.copy()
    for side in ([1, 0, a], [-1, 0, a], [0, 1, b], [0, -1, b]):
        at, along = o @ side, d @ side
        with np.errstate(divide="ignore", invalid="ignore"):
            y = -at / along
        low = np.where(along > 0, np.maximum(low, y), np.where((along == 0) & (at < 0), np.inf, low))
        high = np.where(along < 0, np.minimum(high, y), high)
    inside = high - low > 1e-4
    assert 0.1 < inside.mean() < 0.9
    found = np.column_stack([lit["ya"], lit["yb"]]).astype(float) + lit["foot"].astype(float)[:, None]
    # planes are known to a few spacings of the coordinates, and crossed at an angle
    angle = np.min(
        [np.abs(d @ side) / np.linalg.norm(side) for side in ([1, 0, a], [-1, 0, a], [0, 1, b], [0, -1, b])], axis=0
    )
    clear = inside & (angle > 1e-3)
    size = np.abs(o).max(axis=1) + np.abs(high)
    doubt = 16 * EPS * size / np.maximum(angle, 1e-3)
    assert np.all(np.abs(found - np.column_stack([low, high]))[clear] <= doubt[clear, None])
    dark = high - low < -16 * EPS * size / np.maximum(angle, 1e-3)
    assert not lit["angle"][dark & (angle > 1e-3)].any()
    assert np.all(lit["angle"][inside & (high - low > 2 * doubt)] > 0.0)


def test_a_ray_along_a_sheet_is_lit_within_it_and_dark_beside_it():
    """Parallel to two of its planes, which it never crosses: 1 m before the lamp the sheet is 0.17 m thick."""
    o, d = np.array([[-1.0, 0.05, 1.0], [-1.0, 0.1, 1.0], [-1.0, -0.5, 1.0]]), np.tile([1.0, 0.0, 0.0], (3, 1))
    lamps = wp.array([sheet(60.0, 10.0)] * 3, dtype=light.Light, device="cpu")
    lit = run(clip, [lamps, o, d, np.full(3, 5.0)], [light.LitInterval], dim=3)
    assert (lit["angle"] > 0.0).tolist() == [True, False, False]
