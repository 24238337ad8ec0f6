"""Rays through distorting lenses and ports in float32: those of the host, scene/optics."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from chance import rng_array, run
from scipy.spatial.transform import Rotation

from varos_warp.kernels.sampler import make_sampler
from varos_warp.kernels.world.camera import Camera as CameraData
from varos_warp.kernels.world.camera import channel_of, make_ray
from varos_warp.kernels.world.optics import OpticsSpec
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.device import camera_record, optics_spec
from varos_warp.scene.frames import camera_pose, transform
from varos_warp.scene.optics.camera import camera_model

PORTS = {
    "none": None,
    "flat": {"kind": "flat", "distance_m": 0.02, "thickness_m": 0.008, "normal": [0.2, -0.1, 1.0]},
    "dome": {"kind": "dome", "radius_m": 0.05, "thickness_m": 0.007, "centre": [0.004, -0.003, 0.012]},
}
RIMS = {"flat": {"clear_radius_m": 0.012}, "dome": {"half_angle_deg": 20.0}}
LENSES = {
    "none": None,
    "brown_conrady": {"model": "brown_conrady", "k": [-0.3, 0.1, 0.001, -0.002, -0.01]},
    "rational": {"model": "rational", "k": [4.1, 2.7, 0.001, -0.002, 0.1, 4.5, 4.0, 0.9]},
    "kannala_brandt": {"model": "kannala_brandt", "k": [-0.02, 0.003, -0.001, 0.0002]},
    "double_sphere": {"model": "double_sphere", "xi": -0.2, "alpha": 0.59},
}
ENDING = {
    "brown_conrady": {"model": "brown_conrady", "k": [-0.7, 0.1, 0.0, 0.0, 0.0]},
    "tangential": {"model": "brown_conrady", "k": [-0.7, 0.1, 0.02, -0.03, 0.0]},
    "rational": {"model": "rational", "k": [-0.6, -0.3, 0.004, -0.003, 0.0, 0.2, 0.1, 0.3]},
    "kannala_brandt": {"model": "kannala_brandt", "k": [-0.4, 0.0, 0.0, 0.0]},
    "double_sphere": {"model": "double_sphere", "xi": -0.3, "alpha": 0.95},
    "far sphere": {"model": "double_sphere", "xi": 1.5, "alpha": 0.4},
}
"""Lenses that end within the paper's image, some by a shorter focal length."""
SHORT = {"double_sphere": 1.6, "far sphere": 1.2, "rational": 2.5}
T_W_V = transform(Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix(), [3.0, -2.0, 1.0])
INDICES = (1.338, 1.342, 1.347)


def camera_of(port, lens, **more):
    n_water = {"n_water": INDICES} if PORTS[port] else {}
    return Camera(port=PORTS[port], distortion=LENSES[lens], rotation_euler_deg=[-15, 5, 30], **n_water, **more)


def shoot(view, image, lens, channel=1):
    """Rays on the device in camera axes, from the camera's place, and their weights."""
    spec = optics_spec(view)
    ray_of = make_ray(spec)

    @wp.kernel(enable_backward=False, module="unique")
    def rays(
        camera: CameraData,
        image: wp.array(dtype=wp.vec2),
        lens: wp.array(dtype=wp.vec2),
        channel: int,
        o: wp.array(dtype=wp.vec3),
        d: wp.array(dtype=wp.vec3),
        weight: wp.array(dtype=wp.vec3),
    ):
        i = wp.tid()
        ray, seen = ray_of(camera, image[i][0], image[i][1], lens[i], channel)
        o[i] = ray.o
        d[i] = ray.d
        weight[i] = seen

    T_w_c = camera_pose(view, T_W_V)
    record = camera_record(view, T_W_V, T_w_c[:3, 3])
    o, d, weight = run(rays, [record, image, lens, channel], [wp.vec3] * 3)
    return o.astype(float) @ T_w_c[:3, :3], d.astype(float) @ T_w_c[:3, :3], weight.astype(float)


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("port", PORTS)
def test_rays_are_the_hosts(port, lens):
    """Directions to a few units in the last place of float32; places to as many of the port's 5 cm."""
    view, image = camera_of(port, lens), rng_array(1, (2000, 2)) * np.float32([1280, 720])
    for channel in range(3) if port == "dome" else (1,):
        o, d, weight = shoot(view, image, np.zeros((2000, 2)), channel)
        expected = camera_model(view).rays(image, channel)
        np.testing.assert_allclose(d, expected.direction, atol=1e-6, rtol=0)
        np.testing.assert_allclose(o, expected.origin, atol=1e-7, rtol=0)
        whole = 3.0 * np.eye(3)[channel] if port != "none" else np.ones(3)
        np.testing.assert_allclose(weight, expected.weight[:, None] * whole, atol=2e-6, rtol=0)


@pytest.mark.parametrize("port", RIMS)
def test_rays_past_the_rim_are_none_as_on_the_host(port):
    """But for those within rounding of it, of which there are hardly any."""
    plain, image = camera_of(port, "none"), rng_array(2, (2000, 2)) * np.float32([1280, 720])
    view = plain.model_copy(update={"port": plain.port.model_copy(update=RIMS[port])})
    _, d, weight = shoot(view, image, np.zeros((2000, 2)))
    expected = camera_model(view).rays(image)
    passes = expected.weight > 0.0
    assert 200 < passes.sum() < 1800
    assert np.count_nonzero((weight[:, 1] > 0.0) != passes) <= 2
    both = passes & (weight[:, 1] > 0.0)
    np.testing.assert_allclose(d[both], camera_model(plain).rays(image).direction[both], atol=1e-6, rtol=0)
    np.testing.assert_allclose(weight[both, 1], 3.0 * camera_model(plain).rays(image).weight[both], atol=2e-6, rtol=0)


@pytest.mark.parametrize("lens", ["none", "brown_conrady"])
@pytest.mark.parametrize("port", PORTS)
def test_all_rays_of_an_image_point_aim_at_one_point_in_the_plane_of_focus(port, lens):
    """From each point of the lens, in air; then the port bends them."""
    view = camera_of(port, lens, f_stop=1.7, focus_m=0.8)
    image, u = np.tile(np.float32([[900.0, 500.0]]), (500, 1)), rng_array(2, (500, 2))
    o, d, _ = shoot(view, image, u)
    model, radius = camera_model(view), 0.5e-3 * 3.4 / 1.7
    # the lens's points, from the same camera without anything behind them
    at = shoot(camera_of("none", "none", f_stop=1.7, focus_m=0.8), image, u)[0]
    assert np.hypot(*at.T[:2]).max() < radius * (1 + 1e-5)
    aim = model.directions(image[:1].astype(float))
    aim = 0.8 * aim / aim[:, 2:] - at
    aim /= np.linalg.norm(aim, axis=1, keepdims=True)
    expected = (at, aim) if model.port is None else model.port.leave(at, aim, INDICES[1])[:2]
    np.testing.assert_allclose(o, expected[0], atol=1e-7, rtol=0)
    np.testing.assert_allclose(d, expected[1], atol=1e-6, rtol=0)


def ending(lens, port="none"):
    return Camera(
        port=PORTS[port], distortion=ENDING[lens], focal_mm=SHORT.get(lens, 3.4), rotation_euler_deg=[-15, 5, 30]
    )


@pytest.mark.parametrize(
    ("lens", "port"), [*((lens, "none") for lens in ENDING), ("tangential", "dome"), ("kannala_brandt", "flat")]
)
def test_where_a_lens_ends_there_is_no_ray_as_on_the_host(lens, port):
    """But for image points within 0.02 px of its edge. Directions agree as far as float32 tells image points apart:
    0.001 px, some roundings of 1280. Close to a fold that is more than elsewhere, for there the image hardly moves.
    """
    view, image = ending(lens, port), rng_array(1, (20_000, 2)) * np.float32([1280, 720])
    assert optics_spec(view).ends
    _, d, weight = shoot(view, image, np.zeros((20_000, 2)))
    model, seen = camera_model(view), weight[:, 1] > 0.0
    expected = model.rays(image)
    assert 0.02 < (expected.weight == 0.0).mean() < 0.9
    unlike = image[seen != (expected.weight > 0.0)].astype(float)
    aside = [model.rays(unlike + 0.02 * np.array(step)).weight > 0.0 for step in ((1, 0), (-1, 0), (0, 1), (0, -1))]
    assert (np.any(aside, 0) & ~np.all(aside, 0)).all()
    both = seen & (expected.weight > 0.0)
    moved = [model.rays(image[both] + 1e-3 * np.array(step)).direction for step in ((1, 0), (-1, 0), (0, 1), (0, -1))]
    slack = np.max([np.linalg.norm(each - expected.direction[both], axis=-1) for each in moved], 0)
    off = np.linalg.norm(d[both] - expected.direction[both], axis=-1)
    far = np.isfinite(slack)
    assert far.mean() > 0.99
    assert (off[far] < 2e-6 + slack[far]).all()


TURNING = {
    "almost folds": [-0.4696, 0.0995, -0.0318, 0.0267, 0.0345],
    "far off its axis": [-0.25, 0.1, 0.08, -0.06, 0.0],
}
"""Lenses that do not end within the paper's image, but where six of Newton's steps do not lead to each direction."""


@pytest.mark.parametrize("k", TURNING.values(), ids=TURNING)
def test_a_lens_that_almost_folds_is_followed_to_the_corner(k):
    """Directions agree as far as float32 tells image points apart, 0.001 px."""
    view = Camera(distortion={"model": "brown_conrady", "k": k}, rotation_euler_deg=[-15, 5, 30])
    model, image = camera_model(view), (1.0 - rng_array(3, (20_000, 2)) ** 3) * np.float32([1280, 720])
    image = np.concatenate([image, np.float32([1280, 720]) - image])
    assert not model.lens_ends_within(1280, 720)
    _, d, weight = shoot(view, image, np.zeros(image.shape))
    expected = model.rays(image).direction
    moved = [model.rays(image + 1e-3 * np.array(step)).direction for step in ((1, 0), (-1, 0), (0, 1), (0, -1))]
    slack = np.nanmax([np.linalg.norm(each - expected, axis=-1) for each in moved], 0)
    assert (weight == 1.0).all()
    assert (np.linalg.norm(d - expected, axis=-1) < 2e-6 + slack).all()


@pytest.mark.parametrize("lens", LENSES)
def test_a_lens_far_from_any_fold_keeps_its_short_inverse(lens):
    assert not optics_spec(camera_of("none", lens)).ends


def test_a_ray_that_misses_the_pane_weighs_nothing():
    """A fisheye of 195 degrees behind flat glass."""
    view = replace_port(camera_of("flat", "kannala_brandt", focal_mm=1.3))
    image = np.float32([[5.0, 360.0], [640.0, 360.0]])
    o, d, weight = shoot(view, image, np.zeros((2, 2)))
    assert np.isfinite([o, d]).all()
    assert (weight[0] == 0.0).all()
    assert (weight[1] > 0.5).all()


def replace_port(view):
    """With one index for all channels."""
    return view.model_copy(update={"n_water": 1.34})


def test_one_index_is_one_ray_for_all_channels():
    assert optics_spec(camera_of("flat", "none")) == OpticsSpec("none", "flat", dispersion=True)
    assert optics_spec(replace_port(camera_of("flat", "none"))) == OpticsSpec("none", "flat")
    assert not optics_spec(Camera()).bends
    assert replace(OpticsSpec(), lens="brown_conrady").bends


@wp.kernel(enable_backward=False)
def channels(key: wp.uint32, pixel: wp.array(dtype=int), samples: int, counts: wp.array(dtype=wp.vec3)):
    i = wp.tid()
    total = wp.vec3(0.0)
    for sample in range(samples):
        total[channel_of(make_sampler(key, pixel[i], sample))] += 1.0
    counts[i] = total


def test_channels_take_turns_and_all_come_alike():
    """Six samples have each twice; of four, each is as likely as the others over the pixels."""
    pixels = np.arange(1 << 14, dtype=np.int32)
    assert (run(channels, [wp.uint32(7), pixels, 6], [wp.vec3]) == 2.0).all()
    four = run(channels, [wp.uint32(7), pixels, 4], [wp.vec3])
    assert (four.sum(axis=1) == 4.0).all()
    stderr = four.std(axis=0) / np.sqrt(len(four))
    assert (np.abs(four.mean(axis=0) - 4.0 / 3.0) < 4.0 * stderr).all()
