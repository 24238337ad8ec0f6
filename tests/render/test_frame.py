"""A frame: the same bytes for the same seed, layers that sum, honest errors, and geometry that fits the intrinsics."""

import threading
import time
from contextlib import contextmanager
from itertools import pairwise

import numpy as np
import pytest
import trimesh
from chance import ALPHA, assert_plausible, two_sided
from physics.rig import VAROS_LAMPS, floor, one_ray_scene
from scipy import stats
from spread import absolute, assert_honest, evenly, relative

from varos_warp.device import launcher as launch_module
from varos_warp.device.devices import kind_of
from varos_warp.device.launcher import at_once
from varos_warp.errors import InputError
from varos_warp.render import radiance
from varos_warp.render.image.denoise import available_method, denoise_image
from varos_warp.render.image.films import MOST_BATCHES
from varos_warp.render.renderer import LAYERS, FrameRenderer
from varos_warp.scene.description import Scene
from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.frames import camera_pose, euler_to_matrix, intrinsics, transform
from varos_warp.scene.geometry.parts import Part

WATER = {
    "coefficients": {"sigma_s": [0.00175, 0.01825, 0.043125], "sigma_a": [0.12325, 0.039739, 0.0], "phase": {"g": 0.8}}
}
LAMPS = [{"kind": "spot", "position": [x, -0.1, 0.0], "direction": [0, 1, -0.2], "blend": 0.0} for x in (-0.15, 0.15)]
GROUND_Z = -1.5
POSE = transform(euler_to_matrix((-20, 4, 30)), [0.5, -0.3, 0.2])


def camera(name="M0", **view):
    return {"id": name, "resolution": [32, 20], "sensor_mm": [4.416, 2.76], "rotation_euler_deg": [-15, 0, 0]} | view


def make_scene(cameras=None, lights=LAMPS, **blocks):
    return Scene(
        water=WATER,
        vehicle={"lights": lights, "cameras": cameras or [camera()]},
        trajectory={"poses": [{"position": [0, 0, 0]}]},
        **blocks,
    )


def ground_and_ball(ball=True):
    ground = trimesh.creation.box((60, 60, 1)).apply_translation((0, 0, GROUND_Z - 0.5))
    shapes = [("ground", ground, (0.3, 0.25, 0.2))]
    if ball:
        sphere = trimesh.creation.icosphere(subdivisions=3, radius=0.4).apply_translation((-0.6, 2.2, -1.1))
        shapes.append(("ball", sphere, (0.6, 0.2, 0.1)))
    return [
        Part(name, np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int32), Diffuse(reflectance=reflectance))
        for name, mesh, reflectance in shapes
    ]


@pytest.fixture(scope="module")
def renderer():
    return FrameRenderer(make_scene(), "cpu", parts=ground_and_ball())


def arrays(frame):
    """Everything in a frame by name."""
    found = {}
    for output in "ABCD":
        image = getattr(frame, output)
        for name, value in vars(image).items() if image is not None else ():
            if value is None:
                continue
            inner = value if isinstance(value, dict) else {"": np.asarray(value)}
            found |= {f"{output}.{name}{key}": array for key, array in inner.items()}
    return found


def assert_same_bytes(one, two):
    one, two = arrays(one), arrays(two)
    assert one.keys() == two.keys()
    for name in one:
        assert one[name].tobytes() == two[name].tobytes(), name


# -------------------------------------------------------------------------------------------------------- same bytes


@pytest.mark.parametrize(("threads", "tile_rows"), [(1, 8), (2, 8), (4, 8), (2, 1), (4, 3), (1, 1000)])
def test_neither_threads_nor_tiles_change_a_byte(renderer, monkeypatch, threads, tile_rows):
    how = {"spp": 7, "spp_b": 5, "seed": 11, "frame": 4}
    expected = renderer.render(POSE, **how)
    monkeypatch.setattr(launch_module, "TILE_ROWS", tile_rows)
    other = FrameRenderer(make_scene(), "cpu", parts=ground_and_ball(), threads=threads)
    assert_same_bytes(other.render(POSE, **how), expected)
    # nor what was rendered before
    other.render(np.eye(4), spp=3, seed=1)
    assert_same_bytes(other.render(POSE, **how), expected)


def test_another_seed_frame_or_camera_has_other_noise_and_the_same_geometry():
    renderer = FrameRenderer(make_scene([camera("M0"), camera("M1")]), "cpu", parts=ground_and_ball())
    base = arrays(renderer.render(POSE, "M0", spp=4, seed=1, frame=1))
    for change in ({"seed": 2}, {"frame": 2}, {"camera": "M1"}):
        other = arrays(renderer.render(POSE, **{"camera": "M0", "spp": 4, "seed": 1, "frame": 1} | change))
        for name in ("A.radiance", "B.radiance"):
            assert not np.array_equal(base[name], other[name]), (change, name)
            r = np.corrcoef((base[name] - other[name]).ravel(), base[name].ravel())[0, 1]
            assert abs(r) < 0.9
        for name in ("C.normal", "D.depth", "D.range"):
            assert np.array_equal(base[name], other[name]), (change, name)


def test_the_noise_of_frames_is_uncorrelated(renderer):
    """Two frames of a vehicle at rest: their noise, pixel by pixel, has nothing in common."""
    images = [
        renderer.render(POSE, outputs="A", spp=16, frame=i, layers=("direct", "single")).A.radiance.astype(float)
        for i in range(8)
    ]
    noise = np.array(images) - np.mean(images, axis=0)
    spread = noise.std(axis=0)
    noise = (noise / np.maximum(spread, 1e-12))[:, spread > 1e-6 * images[0].max()]
    r = [np.mean(noise[i] * noise[i + 1]) + 1 / 7 for i in range(7)]  # residuals of a mean of 8 have r = -1/7
    # three channels share their paths
    assert_plausible(two_sided(np.array(r) * np.sqrt(noise.shape[1] / 3)))


# ------------------------------------------------------------------------------------------------------------ layers


def test_layers_sum_to_the_radiance(renderer):
    image = renderer.render(POSE, outputs="A", spp=16).A
    assert set(image.layers) == set(LAYERS)
    total = sum(image.layers[name].astype(float) for name in LAYERS)
    np.testing.assert_allclose(image.radiance, total, rtol=2e-7)
    assert all(image.layers[name].max() > 0 for name in LAYERS)


@pytest.mark.parametrize("chosen", [("direct",), ("single",), ("multiple",), ("direct", "single")])
@pytest.mark.parametrize(("integrator", "spp"), [("path", 16), ("field", 2)])
def test_some_layers_are_those_of_the_whole(renderer, monkeypatch, chosen, integrator, spp):
    """Bytes of direct and single; radiance and error are those of the chosen layers alone.

    Beside the whole, the single layers have every two of them with both, either and neither of the two.
    With the field only if samples are even: else the noise of what is rendered decides where they go.
    """
    monkeypatch.setattr(radiance, "share_out", evenly)
    whole, some = (
        renderer.render(POSE, outputs="A", spp=spp, layers=layers, integrator=integrator).A
        for layers in (LAYERS, chosen)
    )
    assert set(some.layers) == set(chosen)
    for name in chosen:
        np.testing.assert_allclose(some.layers[name], whole.layers[name], rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(some.radiance, sum(some.layers[name].astype(float) for name in chosen), rtol=2e-7)
    if "multiple" not in chosen:
        assert np.mean(some.stderr) < np.mean(whole.stderr)


@pytest.mark.parametrize(
    ("bounds", "empty"),
    [
        ({"max_scatterings": 0, "max_bounces": 1}, {"single", "multiple"}),
        ({"max_scatterings": 1, "max_bounces": 0}, {"direct", "multiple"}),
        ({"max_scatterings": 0}, {"single"}),
        ({"max_bounces": 0}, {"direct"}),
    ],
)
def test_bounds_leave_out_what_they_say(renderer, bounds, empty):
    image = renderer.render(POSE, outputs="A", spp=8, **bounds).A
    assert {name for name in LAYERS if image.layers[name].max() == 0.0} == empty


# ------------------------------------------------------------------------------------------------------------ errors


@pytest.mark.parametrize(
    ("output", "layers"), [("A", ("direct",)), ("A", ("single",)), ("A", ("direct", "single")), ("B", None)]
)
def test_the_standard_error_is_that_of_repeated_renders(renderer, output, layers):
    """What 32 images say of themselves against how they differ, averaged alike over the pixels around."""
    how = {"spp": 16, "spp_b": 16, "integrator": "path"} | ({"layers": layers} if layers else {})
    images = [getattr(renderer.render(POSE, outputs=output, seed=s, **how), output) for s in range(32)]
    values, stderr = (np.array([getattr(image, name) for image in images], float) for name in ("radiance", "stderr"))
    noisy = ((stderr**2).mean(axis=0) > 1e-10 * values.mean((0, 1, 2)) ** 2).all(axis=-1)
    assert noisy.sum() > 100
    for ratio in (absolute, relative):
        assert_honest(ratio, values, stderr, where=noisy)


def test_the_standard_error_of_all_orders_is_honest_for_the_whole_image(renderer):
    """The mean over the image of 40 renders: unit variance of their standard scores."""
    seeds, means, errors = 40, [], []
    for seed in range(seeds):
        image = renderer.render(POSE, outputs="A", spp=16, seed=seed, integrator="path").A
        means.append(image.radiance.mean(axis=(0, 1), dtype=float))
        errors.append(np.sqrt((image.stderr.astype(float) ** 2).sum(axis=(0, 1))) / image.stderr[..., 0].size)
    scores = (np.array(means) - np.mean(means, axis=0)) / np.sqrt(np.mean(np.square(errors), axis=0))
    low, high = stats.chi2.ppf([ALPHA / 6, 1 - ALPHA / 6], seeds - 1)
    chi2 = (scores**2).sum(axis=0)
    assert np.all((low < chi2) & (chi2 < high)), chi2


@pytest.mark.parametrize(("integrator", "steepest"), [("reference", -0.5), ("path", -1.0)])
def test_the_standard_error_falls_with_the_root_of_the_samples_or_faster(renderer, integrator, steepest):
    """Sixteen times the samples, a quarter of the error; less with a low-discrepancy sequence, but no less than 1/16.

    The root of a mean over 640 squares of halves is uncertain by 4 %, of those that matter by about 10 %.
    """
    how = {"outputs": "A", "layers": ("direct", "single"), "integrator": integrator}
    rms = [np.sqrt(np.square(renderer.render(POSE, spp=spp, **how).A.stderr, dtype=float).mean()) for spp in (32, 512)]
    slope = np.log(rms[1] / rms[0]) / np.log(16.0)
    uncertain = 0.1 * np.sqrt(2.0) / np.log(16.0)
    assert steepest - uncertain < slope < -0.5 + uncertain


# ---------------------------------------------------------------------------------------------------------- geometry


def world_points(frame, view, pose):
    """What each pixel's centre shows, from planar depth and from range, float64 [H, W, 3] each; and the rays."""
    width, height = view.resolution
    col, row = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    ray = np.stack([col, row, np.ones_like(col)], -1) @ np.linalg.inv(intrinsics(view)).T
    T_w_c = camera_pose(view, pose)
    unit = ray / np.linalg.norm(ray, axis=-1, keepdims=True)
    depth, distance = (np.where(np.isfinite(x), x, 0.0)[..., None] for x in (frame.D.depth, frame.D.range))
    by_depth = ray * depth @ T_w_c[:3, :3].T + T_w_c[:3, 3]
    by_range = unit * distance @ T_w_c[:3, :3].T + T_w_c[:3, 3]
    return by_depth, by_range, unit @ T_w_c[:3, :3].T


STEREO = [
    camera("L0", position=[-0.1, 0.05, 0]),
    camera("R0", position=[0.1, 0, 0.02], f_stop=1.7),
    camera("S0", mount="world", position=[3.0, -2.0, 1.0], rotation_euler_deg=[-30, 0, 50], focal_mm=2.0),
]


@pytest.mark.parametrize("name", ["L0", "R0", "S0"])
def test_depth_range_and_normals_show_the_ground_where_it_is(name):
    """For both cameras of a stereo pair, with a lens or without, and for one that stands in the world."""
    scene = make_scene(STEREO)
    view = next(c for c in scene.vehicle.cameras if c.id == name)
    frame = FrameRenderer(scene, "cpu", parts=ground_and_ball(False)).render(POSE, name, "CD")
    by_depth, by_range, _ = world_points(frame, view, POSE)
    seen = np.isfinite(frame.D.depth)
    assert 0.3 < seen.mean()
    assert np.array_equal(seen, np.isfinite(frame.D.range))
    near = frame.D.range < 10
    np.testing.assert_allclose(by_depth[near, 2], GROUND_Z, atol=2e-5)
    np.testing.assert_allclose(by_range[near, 2], GROUND_Z, atol=2e-5)
    np.testing.assert_allclose(frame.C.normal[near], np.tile([0, 0, 1.0], (near.sum(), 1)), atol=1e-6)
    assert np.all(frame.C.normal[~seen] == 0.0)


def test_normals_are_unit_and_face_the_camera(renderer):
    frame = renderer.render(POSE, outputs="CD")
    _, _, ray = world_points(frame, renderer.scene.vehicle.cameras[0], POSE)
    seen = np.isfinite(frame.D.depth)
    normal = frame.C.normal[seen].astype(float)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0, atol=1e-6)
    # smoothed ones at the ball's rim turn away by up to half the angle between its faces
    assert (normal * ray[seen]).sum(axis=1).max() < np.sin(np.radians(6))


def test_a_camera_in_the_world_stays_and_sees_the_lamps_move():
    renderer = FrameRenderer(make_scene(STEREO), "cpu", parts=ground_and_ball())
    here, there = (renderer.render(pose, "S0", spp=8, spp_b=4, seed=1, integrator="path") for pose in (POSE, np.eye(4)))
    for output in "BCD":
        for name, array in arrays(here).items():
            if name.startswith(output):
                assert np.array_equal(array, arrays(there)[name]), name
    assert not np.array_equal(here.A.radiance, there.A.radiance)


def test_the_images_show_the_same_things_in_the_same_places():
    """The ball is red in A and B, round in C and nearer in D: in the same pixels."""
    frame = FrameRenderer(make_scene([camera(resolution=[96, 60])]), "cpu", parts=ground_and_ball()).render(
        POSE, spp=16, spp_b=16, layers=("direct",)
    )
    ball = np.abs(frame.C.normal - [0, 0, 1]).max(axis=-1) > 1e-3
    ball &= np.isfinite(frame.D.depth)
    inner = ball & np.roll(ball, 1, 0) & np.roll(ball, -1, 0) & np.roll(ball, 1, 1) & np.roll(ball, -1, 1)
    assert inner.sum() > 30
    outer = np.isfinite(frame.D.depth) & ~(
        ball | np.roll(ball, 1, 0) | np.roll(ball, -1, 0) | np.roll(ball, 1, 1) | np.roll(ball, -1, 1)
    )
    redness = frame.B.radiance[..., 0] / np.maximum(frame.B.radiance[..., 1], 1e-6)
    # next to each other they tinge each other
    assert np.mean(np.abs(redness[inner] / (0.6 / 0.2) - 1) < 0.2) > 0.9
    assert np.mean(np.abs(redness[outer] / (0.3 / 0.25) - 1) < 0.05) > 0.85


def test_b_is_sharp_where_a_has_depth_of_field():
    views = [camera("M0", f_stop=0.0), camera("M1", f_stop=0.5, focal_mm=3.4, focus_m=0.2)]
    views = [view | {"sensor_mm": [0.5, 0.3125]} for view in views]
    scene = make_scene(views, lights=[{"kind": "point", "position": [0, 0, 0.5]}])
    renderer = FrameRenderer(scene, "cpu", parts=ground_and_ball())
    # the keys of the random numbers hold the camera: give both the same noise
    sharp = renderer.render(POSE, scene.vehicle.cameras[0], "ABCD", spp=64, spp_b=16, layers=("direct",))
    lens = scene.vehicle.cameras[1].model_copy(update={"id": "M0"})
    blurred = renderer.render(POSE, lens, "ABCD", spp=64, spp_b=16, layers=("direct",))
    assert sharp.B.radiance.tobytes() == blurred.B.radiance.tobytes()
    assert sharp.C.normal.tobytes() == blurred.C.normal.tobytes()
    assert sharp.D.depth.tobytes() == blurred.D.depth.tobytes()
    assert not np.array_equal(sharp.A.radiance, blurred.A.radiance)


def test_depth_of_field_blurs_what_is_out_of_focus_and_only_that():
    """A white square on black, seen with a wide lens: its edge is as sharp as a pinhole's in focus, wide out of it."""
    square = trimesh.Trimesh([[-9, 2, -9], [0, 2, -9], [0, 2, 9], [-9, 2, 9]], [[0, 1, 2], [0, 2, 3]])
    parts = [Part("square", np.asarray(square.vertices), np.asarray(square.faces, np.int32), Diffuse())]
    view = {"resolution": [32, 8], "sensor_mm": [2.0, 0.5], "focal_mm": 100.0, "rotation_euler_deg": [0, 0, 0]}
    widths = {}
    lenses = {"pinhole": {}, "in focus": {"f_stop": 2.0, "focus_m": 2.0}, "near": {"f_stop": 2.0, "focus_m": 1.0}}
    for name, lens in lenses.items():
        scene = make_scene([camera(**view | lens)], lights=[{"kind": "point", "position": [0, 0, 0.5]}])
        image = FrameRenderer(scene, "cpu", parts=parts).render(np.eye(4), outputs="A", spp=512, layers=("direct",)).A
        profile = image.radiance[..., 0].mean(axis=0)
        widths[name] = np.count_nonzero((profile > 0.02 * profile.max()) & (profile < 0.98 * profile.max()))
    assert widths["pinhole"] <= 2
    assert widths["in focus"] <= 2
    # circle of confusion: the lens of 50 mm, seen over the plane of focus: 50 mm at 2 m is 40 of 32 pixels
    assert widths["near"] > 20


# ------------------------------------------------------------------------------------------------- what is asked for


@pytest.mark.parametrize("outputs", ["A", "BD", "C", ["D", "A"]])
def test_only_the_outputs_asked_for_are_there(renderer, outputs):
    frame = renderer.render(POSE, outputs=outputs, spp=1, spp_b=1)
    assert {name for name in "ABCD" if getattr(frame, name) is not None} == set(outputs)


def test_an_unknown_camera_or_device_is_bad_input(renderer):
    with pytest.raises(InputError, match="M7"):
        renderer.render(POSE, camera="M7")
    for device in ("gpu", "cuda:99", "", "CPU"):
        with pytest.raises(InputError, match="device"):
            FrameRenderer(make_scene(), device, parts=[])


# --------------------------------------------------------------------------------------------------------------- GPU


@pytest.fixture(scope="module")
def gpu():
    return FrameRenderer(make_scene(), "cuda:0", parts=ground_and_ball())


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=pytest.mark.gpu)])
def test_threads_that_take_part_after_part_give_the_same_bytes(monkeypatch, device):
    """As on a GPU that holds few threads and little memory; on a CPU the queue is for one thread alone."""
    renderer = FrameRenderer(make_scene(), device, parts=ground_and_ball(), threads=1)
    expected = renderer.render(POSE, outputs="A", spp=12)
    monkeypatch.setattr(renderer.films, "_resident", 50)
    monkeypatch.setitem(MOST_BATCHES, kind_of(device), 500)
    assert_same_bytes(renderer.render(POSE, outputs="A", spp=12), expected)


def test_of_an_image_to_be_denoised_later_only_what_that_takes_is_kept(renderer):
    """A run on a CPU denoises beside the next frame: the rest would fill memory."""
    whole, kept = (renderer.render(POSE, outputs="AB", spp=4, copied=copied) for copied in (None, ["denoised"]))
    for one, other in ((whole.A, kept.A), (whole.B, kept.B)):
        assert other.layers == {}
        assert other.block_error is None
        for method in ("nlm", available_method("oidn")):
            np.testing.assert_array_equal(denoise_image(other, method), denoise_image(one, method))


@pytest.mark.gpu
def test_a_gpu_gives_the_same_bytes_twice(gpu):
    again = FrameRenderer(make_scene(), "cuda:0", parts=ground_and_ball())
    for how in ({"spp": 7}, {"spp": 64, "seed": 3}):
        expected = gpu.render(POSE, **how)
        gpu.render(np.eye(4), spp=5)
        assert_same_bytes(gpu.render(POSE, **how), expected)
        assert_same_bytes(again.render(POSE, **how), expected)


@pytest.mark.gpu
@pytest.mark.parametrize(
    "how", [{}, {"denoise": "oidn", "denoise_b": "oidn", "copied": ["denoised"]}, {"integrator": "path"}]
)
def test_frames_under_way_side_by_side_on_a_gpu_have_the_bytes_of_each_by_itself(gpu, how, monkeypatch):
    """They have films and lamps of their own, wherever one goes on while the other waits."""
    poses = [POSE, POSE @ np.array([[1.0, 0, 0, 0.3], [0, 1, 0, -0.2], [0, 0, 1, 0], [0, 0, 0, 1]])]
    alone = [gpu.render(pose, spp=40, frame=k, **how) for k, pose in enumerate(poses)]
    aside, waits = gpu.launcher.aside, []

    @contextmanager
    def long_aside():
        with aside():
            waits.append(threading.current_thread())
            time.sleep(0.01)
            yield

    monkeypatch.setattr(gpu.launcher, "aside", long_aside)
    frames = list(at_once("cuda:0", lambda pose, k: gpu.render(pose, spp=40, frame=k, **how), poses, range(2)))
    assert sum(one != other for one, other in pairwise(waits)) > 1  # they took turns
    for frame, expected in zip(frames, alone, strict=True):
        assert_same_bytes(frame, expected)


@pytest.mark.gpu
def test_a_gpu_and_the_cpu_agree_within_standard_errors(renderer, gpu):
    """From different seeds, so that their errors are independent: standard scores of blocks of 4 x 4 pixels."""

    def blocks(x):
        return x.astype(float).reshape(5, 4, 8, 4, 3).mean(axis=(1, 3))

    paths = {"outputs": "A", "spp": 512, "integrator": "path"}
    for how in (paths, paths | {"layers": ("direct", "single")}, {"outputs": "B", "spp_b": 512}):
        frames = renderer.render(POSE, seed=1, **how), gpu.render(POSE, seed=2, **how)
        one, two = (getattr(frame, how["outputs"]) for frame in frames)
        variance = blocks(one.stderr.astype(float) ** 2 + two.stderr.astype(float) ** 2) / 16
        off = blocks(one.radiance) - blocks(two.radiance)
        noisy = variance > 0
        assert np.abs(off[~noisy]).max(initial=0.0) < 1e-6
        assert_plausible(two_sided(off[noisy] / np.sqrt(variance[noisy])))


@pytest.mark.gpu
def test_a_gpu_draws_the_same_random_numbers_as_the_cpu(renderer, gpu):
    """From one seed most paths are the same but for rounding: the images differ by far less than their noise."""
    one, two = (r.render(POSE, seed=1, spp=64, spp_b=16) for r in (renderer, gpu))
    for name in ("direct", "single"):
        off = np.abs(one.A.layers[name].astype(float) - two.A.layers[name])
        assert np.median(off / np.maximum(one.A.layers[name], 1e-12)) < 1e-5
    off = np.abs(one.A.radiance.astype(float) - two.A.radiance)
    assert np.median(off / one.A.stderr) < 0.3
    np.testing.assert_allclose(one.D.depth, two.D.depth, rtol=1e-5)
    np.testing.assert_allclose(one.C.normal, two.C.normal, atol=1e-4)


@pytest.mark.gpu
def test_a_gpu_takes_any_number_of_samples_for_one_pixel():
    """A pixel's samples are split among threads; their numbers must not overflow.

    The error is that of the spread of eight images: `stderr` of a single pixel is one difference of two halves.
    """
    renderer = FrameRenderer(make_scene([camera(resolution=[1, 1])]), "cuda:0", parts=ground_and_ball())
    few, many = (
        np.array([renderer.render(POSE, outputs="A", seed=seed, spp=spp).A.radiance[0, 0] for seed in range(8)], float)
        for spp in (1000, 200_000)
    )
    error = np.sqrt((few.var(axis=0, ddof=1) + many.var(axis=0, ddof=1)) / 8)
    assert np.all(np.abs(few.mean(axis=0) - many.mean(axis=0)) < 6 * error)
    assert np.all(many.std(axis=0, ddof=1) < 0.5 * few.std(axis=0, ddof=1))


def test_kernels_are_loaded_once_and_before_the_launch():
    """A binary for another block size would be compiled again inside the first launch, and its time not be counted."""
    scene = one_ray_scene(VAROS_LAMPS, WATER["coefficients"], pixels=2)
    renderer = FrameRenderer(scene, "cpu", parts=[floor(2.0, 0.5)])
    renderer.render(np.eye(4), spp=1)
    for kernel in renderer.launcher._loaded:
        assert {block for _, block in kernel.module.execs} == {1}, kernel.key
