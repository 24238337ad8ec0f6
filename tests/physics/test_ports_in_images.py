"""Images through ports and distorting lenses, against rays in float64 and radiances in closed form."""

from functools import cache

import numpy as np
import pytest
from test_lens import rectangle

from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.description import Scene
from varos_warp.scene.frames import R_V_C
from varos_warp.scene.optics.camera import camera_model, pixel_centres

pytestmark = pytest.mark.subject("camera")

FLAT = {"kind": "flat", "distance_m": 0.02, "thickness_m": 0.008, "n_glass": 1.49, "normal": [0.1, -0.05, 1.0]}
DOME = {"kind": "dome", "radius_m": 0.05, "thickness_m": 0.007, "n_glass": 1.473, "centre": [0.004, -0.003, 0.012]}
BARREL = {"model": "brown_conrady", "k": [-0.35, 0.12, 0.001, -0.002, -0.01]}
FISHEYE = {"model": "kannala_brandt", "k": [-0.02, 0.003, -0.001, 0.0002]}
CAMERAS = {
    "barrel": {"distortion": BARREL},
    "fisheye": {"distortion": FISHEYE, "focal_mm": 1.6},
    "flat": {"port": FLAT, "n_water": 1.342},
    "flat, colours apart": {"port": FLAT, "n_water": {"temperature_C": 10, "salinity": 35}},
    "dome": {"port": DOME, "n_water": 1.342},
    "dome and barrel": {"port": DOME, "distortion": BARREL},
    "rational": {"distortion": {"model": "rational", "k": [4.1, 2.7, 0.001, -0.002, 0.1, 4.5, 4.0, 0.9]}},
    "sphere in a dome, aside": {
        "port": DOME,
        "distortion": {"model": "double_sphere", "xi": -0.2, "alpha": 0.59},
        "intrinsics": {"fx": 49.0, "fy": 48.0, "cx": 35.2, "cy": 15.1},
    },
}
LAMP = {"kind": "point", "position": [0.3, 0, 0.2], "intensity": [40.0, 40.0, 40.0]}


def scene_of(camera, water="none", **more):
    size = {} if "intrinsics" in camera else {"sensor_mm": [4.416, 2.484], "focal_mm": 3.4}
    view = {"resolution": [64, 36]} | size | camera
    return Scene(
        water=water,
        vehicle={"cameras": [view], "lights": [LAMP]},
        trajectory={"poses": [{"position": [0, 0, 0]}]},
        **more,
    )


def plane_through(scene, y, slope=0.3):
    """Where rays of pixel centres meet the plane y = ``y`` + slope x of the vehicle: t, point, cosine of the slant."""
    view = scene.vehicle.cameras[0]
    ray = camera_model(view).rays(pixel_centres(*view.resolution))
    o, d = ray.origin @ R_V_C.T, ray.direction @ R_V_C.T
    t = (y + slope * o[..., 0] - o[..., 1]) / (d[..., 1] - slope * d[..., 0])
    slant = np.abs(d[..., 1] - slope * d[..., 0]) / np.hypot(1.0, slope)
    return np.where(t > 0.0, t, np.inf), o + t[..., None] * d, slant


@pytest.mark.parametrize("camera", CAMERAS)
def test_depth_and_objects_are_where_the_rays_of_the_host_meet_a_plane(truth, camera):
    """A slanted plane with a square on it, through every pixel: D to rounding, and S."""
    scene, slope = scene_of(CAMERAS[camera]), 0.3
    plane = rectangle((-30, 3 - 30 * slope, -30), (60, 60 * slope, 0), (0, 0, 60), 0.5, "plane")
    square = rectangle((-0.4, 2 - 0.4 * slope, -0.3), (0.9, 0.9 * slope, 0), (0, 0, 0.7), 0.5, "square")
    frame = FrameRenderer(scene, "cpu", parts=[plane, square]).render(np.eye(4), outputs="DS")
    t_near, near, slant = plane_through(scene, 2.0)
    t_far, far, _ = plane_through(scene, 3.0)

    def within(margin):
        return (
            (near[..., 0] > -0.4 - margin)
            & (near[..., 0] < 0.5 + margin)
            & (near[..., 2] > -0.3 - margin)
            & (near[..., 2] < 0.4 + margin)
        )

    sure = within(1e-5) == within(-1e-5)  # not on the edge of the square
    seen = np.isfinite(t_far) & sure & (np.abs(far) < 29.0).all(-1)
    assert seen.mean() > 0.85
    on_square = within(0.0)
    assert np.array_equal((frame.S.instance == 2)[seen], on_square[seen])
    assert 20 < on_square.sum() < 1500
    t, point = np.where(on_square, t_near, t_far), np.where(on_square[..., None], near, far)
    rounding = 1e-6 * (1.0 + t[seen]) / slant[seen]
    how = {"tolerance": rounding, "reason": "float32 rounding over the cosine of the slant"}
    truth(
        f"water path [m] of all pixels, {camera}",
        source="float64 ray to the plane",
        expected=t[seen],
        got=frame.D.range[seen],
        **how,
    )
    truth(
        f"planar depth [m] of all pixels, {camera}",
        source="forward part of the point seen",
        expected=point[seen][:, 1],
        got=frame.D.depth[seen],
        **how,
    )


@pytest.mark.parametrize("camera", ["flat", "flat, colours apart", "dome"])
def test_radiance_of_a_plate_in_water_that_absorbs_is_that_at_the_sensor(truth, camera):
    """T / n^2 of what the plate reflects after absorption, for each channel along its own ray; pixels are small."""
    scene = scene_of(
        CAMERAS[camera] | {"resolution": [8, 6], "sensor_mm": [0.8, 0.6], "focal_mm": 20.0},
        {"coefficients": {"sigma_s": [0, 0, 0], "sigma_a": [0.4, 0.1, 0.05]}},
    )
    plate = rectangle((-5, 2, -5), (10, 0, 0), (0, 0, 10), 0.6, "plate")
    A = (
        FrameRenderer(scene, "cpu", parts=[plate])
        .render(np.eye(4), outputs="A", spp=6, integrator="path", layers=("direct",), denoise="none")
        .A
    )
    view = scene.vehicle.cameras[0]
    expected = np.empty((6, 8, 3))
    for channel, sigma in enumerate((0.4, 0.1, 0.05)):
        ray = camera_model(view).rays(pixel_centres(8, 6), channel)
        o, d = ray.origin @ R_V_C.T, ray.direction @ R_V_C.T
        t = (2.0 - o[..., 1]) / d[..., 1]
        to_lamp = np.array([0.3, 0.0, 0.2]) - (o + t[..., None] * d)
        s = np.linalg.norm(to_lamp, axis=-1)
        expected[..., channel] = ray.weight * 0.6 / np.pi * 40.0 * 2.0 / s**3 * np.exp(-sigma * (s + t))
    truth(
        f"radiance [W/sr/m^2] of a plate 2 m away, {camera}",
        source="T / n^2 times reflectance / pi, inverse square, Beer",
        expected=expected,
        got=A.radiance,
        tolerance=1e-3 * expected,
        reason="radiance within a pixel of 5 mrad, to second order",
    )


ONCE, ALL = ("direct", "single"), ("direct", "single", "multiple")


@cache
def mean_of_a_plate(n_water, integrator, layers=ALL, seeds=12):
    """Mean radiance in water that scatters, and its standard error."""
    water = {"coefficients": {"sigma_s": [0.3] * 3, "sigma_a": [0.1] * 3, "phase": {"g": 0.8}}}
    renderer = FrameRenderer(
        scene_of({"port": FLAT, "n_water": n_water, "resolution": [16, 8]}, water),
        "cpu",
        parts=[rectangle((-5, 2, -5), (10, 0, 0), (0, 0, 10), 0.6, "plate")],
    )
    how = {"outputs": "A", "spp": 12, "integrator": integrator, "layers": layers, "denoise": "none"}
    images = [renderer.render(np.eye(4), seed=seed, **how).A.radiance.mean((0, 1)) for seed in range(seeds)]
    return np.mean(images, 0), np.std(images, 0, ddof=1) / np.sqrt(seeds)


@pytest.mark.parametrize(("integrator", "layers"), [("path", ONCE), ("field", ALL), ("reference", ONCE)])
def test_each_channel_of_a_dispersive_camera_is_that_of_a_camera_with_its_index(truth, integrator, layers):
    """By every integrator; the indices differ more than water's.

    Of `reference` without multiple scattering: it draws nothing around the lamp, so that has no variance to go by. Nor
    of `path`, whose kernel of more events is that which corrects the field.
    """
    indices = (1.30, 1.36, 1.42)
    got, error = mean_of_a_plate(indices, integrator, layers)
    alone = [mean_of_a_plate(n, "path", layers) for n in indices]
    expected, other = (np.array([pair[i][c] for c, pair in enumerate(alone)]) for i in range(2))
    # of twelve images each the standard error is itself uncertain: 5 of Student's t are 4 of Gauss
    truth(
        f"mean radiance of R, G, B at indices 1.30, 1.36, 1.42, by {integrator}",
        source="a camera with each of them",
        expected=expected,
        got=got,
        stderr=np.hypot(error, other),
        sigmas=5.0,
        tolerance=2e-3 * expected * (integrator == "field"),
        reason="stated bias of the field",
    )


@pytest.mark.parametrize("integrator", ["path", "reference"])
def test_past_the_rim_images_are_black_or_nothing(integrator):
    """All six outputs, in water that scatters: a pane of 9 mm, and each pixel either has a ray or has none."""
    rim = FLAT | {"normal": [0, 0, 1], "clear_radius_m": 0.009}
    water = {"coefficients": {"sigma_s": [0.3] * 3, "sigma_a": [0.1] * 3}}
    scene = scene_of({"port": rim, "distortion": BARREL, "n_water": [1.339, 1.342, 1.347]}, water)
    plate = rectangle((-5, 2, -5), (10, 0, 0), (0, 0, 10), 0.6, "plate")
    frame = FrameRenderer(scene, "cpu", parts=[plate]).render(
        np.eye(4), outputs="ABCDS", spp=4, spp_b=4, integrator=integrator, layers=ONCE, denoise="none", denoise_b="none"
    )
    border = camera_model(scene.vehicle.cameras[0])
    row, col = np.indices((37, 65))
    corners = np.array([border.rays(np.stack([col, row], -1), channel).weight > 0.0 for channel in range(3)])
    squares = np.lib.stride_tricks.sliding_window_view(corners, (2, 2), axis=(1, 2))
    whole, none = squares.all((0, 3, 4)), ~squares.any((0, 3, 4))  # in all colours
    assert min(whole.sum(), none.sum()) > 300
    for image in (frame.A.radiance, frame.B.radiance):
        assert (image[whole] > 0.0).all()
        assert (image[none] == 0.0).all()
    assert np.isfinite(frame.D.range[whole]).all()
    assert np.isinf(frame.D.range[none]).all()
    assert np.isinf(frame.D.depth[none]).all()
    assert not frame.C.normal[none].any()
    assert not frame.S.instance[none].any()
    assert np.isfinite(frame.A.stderr).all()


def test_white_surroundings_stay_white_in_b():
    """B has no water, so no port takes light from it; where the glass is not met, it is black."""
    scene = scene_of({"port": FLAT, "distortion": {"model": "kannala_brandt"}, "focal_mm": 1.3})
    plate = rectangle((-5, 2, -5), (10, 0, 0), (0, 0, 10), 1.0, "plate")
    B = FrameRenderer(scene, "cpu", parts=[plate]).render(np.eye(4), outputs="B", spp_b=16, denoise_b="none").B.radiance
    weight = camera_model(scene.vehicle.cameras[0]).rays(pixel_centres(64, 36)).weight
    inner = np.zeros((36, 64), bool)
    inner[9:27, 20:44] = True
    np.testing.assert_allclose(B[inner], 1.0, atol=1e-5)
    assert (B[:, 0] == 0.0).all()
    assert (weight[:, 0] == 0.0).all()


@pytest.mark.gpu
@pytest.mark.parametrize("camera", CAMERAS)
def test_a_gpu_sees_through_lens_and_port_as_a_cpu_does(camera):
    """The same random numbers, so that rounding alone differs: that of a ray errs in 1 / D of a plane, at any slant."""
    scene = scene_of(CAMERAS[camera], {"coefficients": {"sigma_s": [0, 0, 0], "sigma_a": [0.4, 0.1, 0.05]}})
    parts = [
        rectangle((-30, -6, -30), (60, 18, 0), (0, 0, 60), 0.5, "plane"),
        rectangle((-0.4, 1.88, -0.3), (0.9, 0.27, 0), (0, 0, 0.7), 0.8, "square"),
    ]
    how = {"outputs": "ADS", "spp": 6, "integrator": "path", "layers": ("direct",), "denoise": "none"}
    cpu, gpu = (FrameRenderer(scene, device, parts=parts).render(np.eye(4), **how) for device in ("cpu", "cuda:0"))
    same = cpu.S.instance == gpu.S.instance
    assert same.mean() > 0.999
    np.testing.assert_allclose(1.0 / gpu.D.range[same], 1.0 / cpu.D.range[same], rtol=0, atol=1e-6)
    off = np.abs(gpu.A.radiance - cpu.A.radiance) > 1e-3 * cpu.A.radiance
    assert off[same].mean() < 1e-3  # samples at edges, on either side
