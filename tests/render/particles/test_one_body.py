"""One body, put where the test wants it: its light, its place, its size and its streak, in closed form."""

import numpy as np
import pytest
from flakes import CAMERA, LAMP, Snowing, snow_scene, soft_edge
from scipy.spatial.transform import Rotation

from varos_warp.render.renderer import NextFrame
from varos_warp.scene.frames import transform
from varos_warp.scene.optics.shutter import row_offsets_s
from varos_warp.scene.water.flocs import flocs
from varos_warp.scene.water.phase.lambert_sphere import LambertSphere

F_PX = 6 / 8 * 96
STILL = {"drift_m_s": [0, 0, 0], "wander_m_s": 0.0}
PLACE, RADIUS = np.array([0.11, 1.2, 0.06]), 4e-3
SIGMA_S, SIGMA_T = np.array([0.2, 0.3, 0.25]), np.array([0.5, 0.4, 0.3])


def image_of(p, eye=(0, 0, 0)):
    """Image point of a pinhole that looks along y."""
    x, y, z = np.moveaxis(np.asarray(p, float) - eye, -1, 0)
    return np.stack([48 + F_PX * x / y, 27 - F_PX * z / y], -1)


def sum_of_pixels(p, r, u):
    """Sum of the radiance over the image of a body: J exp(-c d) over the area that a pixel sees there."""
    lamp = np.array(LAMP["position"], float)
    axis = np.array(LAMP["direction"]) / np.linalg.norm(LAMP["direction"])
    way, distance = p - lamp, np.linalg.norm(p - lamp)
    half = np.cos(np.radians(LAMP["cone_deg"] / 2))
    s = np.clip((way @ axis / distance - half) / (LAMP["blend"] * (1 - half)), 0, 1)
    profile = s * s * (3 - 2 * s)
    t = np.linalg.norm(p)
    turned = way @ -p / distance / t  # cosine of the angle by which light is turned
    E = np.array(LAMP["intensity"]) * profile * np.exp(-SIGMA_T * distance) / distance**2
    J = E * np.pi * r**2 * SIGMA_S / SIGMA_S.max() * LambertSphere().density(0.5 * (1 - turned))
    tumbling = 1 + 0.3 * np.sin(2 * np.pi * u[3])
    return tumbling * J * np.exp(-SIGMA_T * t) / (p[1] ** 3 / (t * F_PX**2))


def moving(velocity):
    """Of the vehicle, from the origin on at the frame's time."""
    return lambda offset_ns: transform(np.eye(3), np.multiply.outer(1e-9 * offset_ns, np.asarray(velocity, float)))


def moments_of(light):
    """Centre [2] and covariance [2, 2] of an image."""
    weight = light[..., 1].astype(float) / light[..., 1].sum()
    y, x = np.indices(weight.shape) + 0.5
    centre = np.array([(weight * x).sum(), (weight * y).sum()])
    off = np.stack([x - centre[0], y - centre[1]], -1)
    return centre, np.einsum("ij,ija,ijb->ab", weight, off, off)


VIEWS = {
    "in focus": {},
    "out of focus": {"f_stop": 1.0, "focus_m": 0.25},
    "streaked": {"exposure": {"time_s": 0.05}},
}


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("radius", [1.7e-3, RADIUS, 3e-2])
def test_the_pixels_of_a_body_sum_to_its_light(view, radius):
    """Light of the lamp that the body scatters, less what the water keeps of it on both ways.

    Pixels of a body that is seen round sum to it but for rounding; those of a floc, whose grains lie in pixels anyhow,
    to a hundredth. Its mean over places is held to less beside the kernel.
    """
    snowing = Snowing(snow_scene(VIEWS[view], STILL), (PLACE, radius))
    n = snowing(motion=moving([0.5, 0, 0.1])) if view == "streaked" else snowing()
    # the phase function is a table in float32
    np.testing.assert_allclose(snowing.splats["flux"][0], sum_of_pixels(PLACE, radius, snowing.u), rtol=2e-4)
    is_round = snowing.splats["floc"]["loose"][0] == 0
    assert is_round == (radius < RADIUS)
    rel = 1e-5 if is_round else 0.01
    np.testing.assert_allclose(n.light.sum((0, 1), dtype=float), snowing.splats["flux"][0], rtol=rel)


def test_cameras_see_a_floc_from_their_sides():
    """Angles between what four poses call right and down are those between them as the grains of the floc see them."""
    snowing, world, own = Snowing(snow_scene({}, STILL), (PLACE, 3e-2)), [], []
    for R in Rotation.from_euler("zyx", [[0, 0, 0], [90, 0, 0], [20, 60, -30], [0, 0, 80]], degrees=True).as_matrix():
        snowing(transform(R, PLACE - 1.2 * R[:, 1]))  # the floc is straight ahead
        splat, floc = snowing.splats[0], snowing.splats[0]["floc"]
        np.testing.assert_allclose([splat["x"], splat["y"]], [48, 27], atol=1e-2)
        assert floc["loose"] == 1
        assert floc["size"] == pytest.approx(F_PX * 3e-2 / 1.2, rel=1e-4)
        world += [R[:, 0], -R[:, 2]]
        own += [floc["across"] / floc["size"], floc["down"] / floc["size"]]
    np.testing.assert_allclose(np.array(own) @ np.transpose(own), np.array(world) @ np.transpose(world), atol=1e-4)


def test_grains_come_apart_as_a_body_comes_close():
    """By the share that is seen of it, and no faster."""
    apart = []
    for distance in (2.4, 2.0, 1.6, 1.3):
        place = np.array([0.0, distance, 0.0])
        snowing = Snowing(snow_scene({}, STILL), (place, 6e-3))
        snowing()
        splat, floc = snowing.splats[0], snowing.splats[0]["floc"]
        apart.append(floc["loose"])
        for name in ("across", "down"):
            assert np.linalg.norm(floc[name]) == pytest.approx(floc["loose"] * floc["size"], rel=1e-4, abs=1e-7)
        grains = flocs().at[floc["shape"]] @ np.transpose([floc["across"], floc["down"]])
        disc = splat["radius"] + splat["edge"] / 2
        np.testing.assert_allclose(splat["reach"], np.abs(grains).max(0) + disc, rtol=1e-4)
    assert 0 <= apart[0] < apart[1] < apart[2] < apart[3] <= 1
    assert 0 < apart[2] < 1


@pytest.mark.parametrize("view", ["in focus", "out of focus"])
def test_what_an_image_shows_of_a_body_at_its_edge_is_what_a_larger_image_shows_there(view):
    small = CAMERA | VIEWS[view] | {"resolution": [48, 54], "sensor_mm": [4, 4.5]}
    place = np.array([24.2 / F_PX * 1.2, 1.2, 0.06])  # 0.2 pixels beyond the edge
    both = [Snowing(snow_scene(camera, STILL), (place, RADIUS))() for camera in (small, VIEWS[view])]
    np.testing.assert_allclose(
        both[0].light, both[1].light[:, 24:72], rtol=0, atol=2e-5 * both[1].light.max()
    )  # a place in float32
    assert 0 < both[0].light.sum() < both[1].light.sum()


def test_place_and_radius_of_a_blurred_disc():
    """Of defocus, body and lens together; its pixels have the second moments of a disc with a soft edge."""
    snowing = Snowing(snow_scene({"f_stop": 0.5, "focus_m": 0.15}, STILL), (PLACE, 5e-3))
    centre, spread = moments_of(snowing().light)
    body = F_PX * 5e-3 / 1.2 * np.sqrt(np.linalg.norm(PLACE) / 1.2)
    blur = F_PX * 6e-3 * (1 / 0.15 - 1 / 1.2)
    size, edge = np.sqrt(body**2 + 1.0**2 + blur**2), np.sqrt((0.9 * body) ** 2 + 2.0**2 + (0.5 * blur) ** 2)
    for name, value in (("radius", size), ("edge", edge)):
        assert snowing.splats[name][0] == pytest.approx(value, rel=5e-3)  # a pixel is no square across a slanted ray
    r = np.linspace(0, size + 0.5 * edge, 4001)
    soft = soft_edge(r - size, edge)
    variance = 0.5 * (soft * r**3).sum() / (soft * r).sum()
    np.testing.assert_allclose(centre, image_of(PLACE), atol=0.05)
    np.testing.assert_allclose(2 * np.sqrt(np.diag(spread)), 2 * np.sqrt(variance), atol=0.05)


def test_a_streak_is_as_long_as_the_way_of_the_image_while_the_shutter_is_open():
    """Its variance is more than the disc's by a twelfth of the square of its length, nearly: measured in the splat."""
    snowing = Snowing(snow_scene({"exposure": {"time_s": 0.1}}, STILL), (PLACE, RADIUS))
    n = snowing(motion=moving([0.8, 0.0, 0.3]))
    splat = snowing.splats[0]
    ends = [image_of(PLACE, np.array([0.8, 0.0, 0.3]) * t) for t in (-0.05, 0.05)]
    sign = np.sign(splat["along"] @ (ends[1] - ends[0]))
    np.testing.assert_allclose(2 * sign * splat["along"], ends[1] - ends[0], atol=0.05)
    np.testing.assert_allclose(moments_of(n.light)[0], np.mean(ends, 0), atol=0.05)


def test_a_rolling_shutter_sees_a_body_at_the_instant_of_its_row():
    """Rows are read over 0.1 s, in which the camera moves by 0.1 m."""
    snowing = Snowing(
        snow_scene({"exposure": {"time_s": 0.001, "readout_s": 0.1}}, STILL), (PLACE + [0, 0, 0.15], RADIUS)
    )
    place, v = PLACE + [0, 0, 0.15], np.array([1.0, 0.0, 0.2])
    times = row_offsets_s(snowing.renderer.scene.vehicle.cameras[0])
    snowing(motion=moving(v))
    at = image_of(place)
    for _ in range(10):
        at = image_of(place, v * np.interp(at[1] - 0.5, np.arange(54), times))
    splat = snowing.splats[0]
    # within a row the time is that of its middle: half a row's time, and the image moves 60 pixels a second
    row = int(splat["y"])
    np.testing.assert_allclose([splat["x"], splat["y"]], image_of(place, v * times[row]), atol=0.05)
    np.testing.assert_allclose([splat["x"], splat["y"]], at, atol=0.1)


@pytest.mark.parametrize("time_s", [0, 1000])
def test_a_body_drifts_with_the_current_and_flow_leads_to_where_it_is_next(time_s):
    """0.2 m/s, which is 1.2 pixels in a tenth of a second."""
    scene = snow_scene({}, STILL | {"radius_m": [1e-3, 4e-3]}, current={"velocity": [0.2, 0.0, -0.05]})
    snowing = Snowing(scene)
    n = snowing(time_ns=time_s * 10**9, following=NextFrame(np.eye(4), time_ns=time_s * 10**9 + 10**8))
    first, before = snowing.splats, snowing.bodies()
    snowing(time_ns=time_s * 10**9 + 10**8)
    after = snowing.bodies()
    where = {u.tobytes(): p for p, u in zip(after[0], after[2], strict=True)}
    moved = np.array(
        [where[u.tobytes()] - p for p, u in zip(before[0], before[2], strict=True) if u.tobytes() in where]
    )
    assert len(moved) > 100
    np.testing.assert_allclose(moved, np.broadcast_to([0.02, 0.0, -0.005], moved.shape), atol=2e-5)
    ahead = before[0][:, 1] > 0.01
    images, numbers = image_of(before[0][ahead]), before[2][ahead]
    off = []
    for splat in first:
        at = np.array([splat["x"], splat["y"]])
        u = numbers[np.linalg.norm(images - at, axis=1).argmin()].tobytes()
        if 8 < at[0] < 88 and 8 < at[1] < 46 and u in where:
            off.append(at + splat["flow"] - image_of(where[u]))
    assert len(off) > 20
    assert np.abs(off).max() < 0.05
    assert np.abs(n.flow).max() > 0.5
