"""Shutters: blur, rows of instants and strobes against closed forms and against images of instants."""

import numpy as np
import pytest
import warp as wp
from rig import TURBID, spot
from scipy.spatial.transform import Rotation
from scipy.stats import norm
from scipy.stats import t as student
from test_lens import rectangle

from tests.chance import ALPHA
from varos_warp.kernels.transport.moments import Moments, instant_of_row
from varos_warp.kernels.world.camera import Camera
from varos_warp.render.field import open_water
from varos_warp.render.moments import poses_of_rows
from varos_warp.render.renderer import FrameRenderer, NextFrame
from varos_warp.scene.description import Scene
from varos_warp.scene.description.lights import Strobe
from varos_warp.scene.frames import transform
from varos_warp.scene.optics.shutter import instants, on_share, open_ns, row_offsets_s

pytestmark = pytest.mark.subject("camera")

SIZE = (48, 32)
FOCAL = 3.4 / 4.416 * SIZE[0]
"""[pixels]"""
LAMPS = [spot((x, 0.2, 0.1), (-x, -0.1, 1)) for x in (-0.4, 0.4)]


def scene_of(shutter=None, lights=None, water="none", **more):
    view = {"resolution": list(SIZE), "sensor_mm": [4.416, 4.416 * SIZE[1] / SIZE[0]], "focal_mm": 3.4}
    view |= {"exposure": shutter} if shutter else {}
    return Scene(
        water=water,
        vehicle={"cameras": [view], "lights": lights or LAMPS},
        trajectory={"poses": [{"position": [0, 0, 0]}]},
        **more,
    )


def steady(velocity=(0, 0, 0), turn=(0, 0, 0)):
    """Motion of constant velocity [m/s] and turning [rad/s] in vehicle axes."""

    def poses(offset_ns):
        t = 1e-9 * np.asarray(offset_ns)[:, None]
        R = Rotation.from_rotvec(t * np.asarray(turn, float)).as_matrix()
        return np.array([transform(*pose) for pose in zip(R, t * np.asarray(velocity, float), strict=True)])

    return poses


def room():
    """A wall with a plate before it, and a floor."""
    return [
        rectangle((-9, 1.5, -9), (18, 0, 0), (0, 0, 18), 0.1, "wall"),
        rectangle((-0.3, 0.9, -0.2), (0.4, 0, 0.1), (0, 0, 0.5), 0.9, "plate"),
        rectangle((-9, -1, -0.5), (18, 0, 0), (0, 9, 0.3), 0.3, "floor"),
    ]


# ---------------------------------------------------------------------------------------------------------------- blur


def test_a_streak_is_as_long_as_speed_times_exposure(truth):
    """A black plate's edge, 2 m away, that crosses the image: B is the share of the time that it is not there."""
    speed, exposure, depth = 1.2, 0.25, 2.0
    renderer = FrameRenderer(
        scene_of({"time_s": exposure}),
        "cpu",
        parts=[rectangle((-9, depth, -9), (9, 0, 0), (0, 0, 18), 0.0, "black")],
    )
    B = renderer.render(np.eye(4), outputs="B", spp_b=256, motion=steady((speed, 0, 0))).B
    streak = FOCAL * speed * exposure / depth
    # the edge moves to the left over the streak; a pixel is the mean over itself
    at = np.arange(SIZE[0] + 1.0) - SIZE[0] / 2
    inside = np.clip(at + streak / 2, 0.0, streak)
    free = inside**2 / (2 * streak) + np.maximum(at - streak / 2, 0.0)  # integral of the share from the left
    truth(
        "B across a streak",
        source="speed x exposure x f / Z",
        expected=np.diff(free),
        got=B.radiance[..., 1].mean(0),
        stderr=B.radiance[..., 1].std(0, ddof=1) / np.sqrt(SIZE[1]),
        reason="spread of the rows, and one part in 512 of an exposure",
    )


ALL = ("direct", "single", "multiple")


DISKS = [lamp | {"radius_m": 0.1} for lamp in LAMPS]


@pytest.mark.parametrize(
    ("integrator", "layers", "lights"),
    [("path", ALL[:2], LAMPS), ("path", ALL, LAMPS), ("field", ALL, LAMPS), ("reference", ALL, LAMPS)]
    + [("field", ALL, DISKS)],
)
def test_a_blurred_image_is_the_mean_of_instants(any_field, monkeypatch, integrator, layers, lights):
    """64 of them, of a rig that moves and turns, in water; pixel by pixel, in blocks, and as a whole.

    All have the same tables along their rays, of few nodes; of light scattered once none is right in this water.
    """
    monkeypatch.setattr(open_water, "SINGLE", open_water.SINGLE._replace(counts=(96, 24, 41)))
    monkeypatch.setattr(open_water, "MULTIPLE", open_water.MULTIPLE._replace(counts=(32, 10, 17)))
    exposure, motion = 0.4, steady((0.6, 0.1, -0.3), (0.1, -0.2, 0.9))
    blurred = scene_of({"time_s": exposure}, lights, water={"coefficients": TURBID})
    renderer = FrameRenderer(blurred, "cpu", parts=room())
    how = {"outputs": "A", "integrator": integrator, "denoise": "none", "layers": layers}
    spp = 256 if integrator == "reference" else 64
    A = renderer.render(np.eye(4), spp=spp, motion=motion, **how).A
    offset = np.rint(1e9 * exposure * ((np.arange(64) + 0.5) / 64 - 0.5)).astype(np.int64)
    made = [renderer.render(T, spp=spp // 32, frame=k + 1, **how).A for k, T in enumerate(motion(offset))]
    mean = np.mean([image.radiance for image in made], axis=0)
    variance = A.stderr**2 + np.mean([image.stderr**2 for image in made], axis=0) / len(made)
    limit = norm.isf(ALPHA / 2 / 72) * 1.1  # 72 values; what blocks share of their error, and the stderr's own error
    assert worst_block(A.radiance - mean, variance) < limit
    assert ((A.radiance - mean) / np.sqrt(variance)).std() < 1.1  # stratified samples: less than 1
    if layers != ALL:  # other light is too noisy here to tell a sharp image from a blurred one
        still = renderer.render(np.eye(4), spp=spp, **how).A
        assert worst_block(still.radiance - mean, variance) > 3 * limit


def worst_block(difference, variance):
    """Largest standard score of a block of 8 x 8 pixels."""
    blocks = [values.reshape(4, 8, 6, 8, 3).sum((1, 3)) for values in (difference, variance)]
    return np.abs(blocks[0] / np.sqrt(blocks[1])).max()


def test_a_still_vehicle_is_not_blurred_and_a_plain_camera_never():
    plain, open_ = (FrameRenderer(scene_of(shutter), "cpu", parts=room()) for shutter in (None, {"time_s": 0.1}))
    how = {"outputs": "ABCDS", "spp": 2, "spp_b": 2, "integrator": "path"}
    sharp = plain.render(np.eye(4), **how)
    for frame in (plain.render(np.eye(4), motion=steady((1, 0, 0)), **how), open_.render(np.eye(4), **how)):
        assert np.array_equal(frame.A.radiance, sharp.A.radiance)
        assert np.array_equal(frame.B.radiance, sharp.B.radiance)
    moving = open_.render(np.eye(4), motion=steady((1, 0, 0)), **how | {"outputs": "CDSP"})
    assert np.array_equal(moving.P.radiance, sharp.A.radiance)
    assert np.array_equal(moving.D.depth, sharp.D.depth)


# -------------------------------------------------------------------------------------------------------- rolling rows


@pytest.mark.parametrize("integrator", ["path", "reference"])
def test_a_rolling_shutter_without_exposure_is_rows_of_instants(integrator):
    """Byte for byte; light of more events than one has virtual point lights of 32 parts of the time."""
    rolling = scene_of({"readout_s": 0.05}, water={"coefficients": TURBID})
    renderer, motion = FrameRenderer(rolling, "cpu", parts=room()), steady((2.0, 0.5, 1.0), (0.2, 1.0, -2.0))
    layers = ALL[:2] if integrator == "path" else ALL
    how = {"outputs": "ABCDS", "integrator": integrator, "layers": layers, "spp": 2, "spp_b": 2}
    frame = renderer.render(np.eye(4), motion=motion, **how)
    for row, T in enumerate(poses_of_rows(rolling.vehicle.cameras[0], np.eye(4), motion)):
        instant = renderer.render(T, **how)
        for image, name in (
            ("A", "radiance"),
            ("B", "radiance"),
            ("C", "normal"),
            ("D", "depth"),
            ("D", "range"),
            ("S", "instance"),
        ):
            of_row, of_instant = (getattr(getattr(made, image), name)[row] for made in (frame, instant))
            assert np.array_equal(of_row, of_instant), (image, row)


def test_rows_are_exposed_one_after_another_about_the_time_stamp():
    """Over one exposure each, with stretches of time that begin where a row's exposure does."""
    camera = scene_of({"time_s": 0.011, "readout_s": 0.02}).vehicle.cameras[0]
    when = instants(camera)
    line = 0.02 / SIZE[1]
    starts = (np.arange(SIZE[1]) + 0.5 - SIZE[1] / 2) * line - 0.0055
    first = np.floor(np.arange(SIZE[1]) * when.per_row + 1e-3).astype(int)
    np.testing.assert_allclose(when.offset_s[first] - when.length_s / 2, starts, atol=1e-12)
    assert when.open * when.length_s == pytest.approx(0.011)
    assert len(when.offset_s) == int(np.ceil(first[-1] + when.open))
    assert when.length_s <= max(0.011 / 512, 0.031 / 4096)


@wp.kernel(enable_backward=False)
def number_instants(moments: Moments, shares: wp.array(dtype=float), number: wp.array2d(dtype=int)):
    row, k = wp.tid()
    number[row, k] = instant_of_row(moments, row, shares[k])


@pytest.mark.parametrize(
    ("exposure", "readout", "rows"),
    [(0.02, 0.02, 720), (0.04, 0.01, 720), (0.011, 0.02, 32), (1e-4, 0.03, 480), (1e-6, 0.02, 16384), (0.0, 0.02, 720)],
)
def test_every_row_is_exposed_about_its_own_time(exposure, readout, rows):
    """The mean over its samples, whether an instant stands for more or less than a row takes; and none is too late."""
    view = {"resolution": [1, rows], "exposure": {"time_s": exposure, "readout_s": readout}}
    camera = Scene(vehicle={"cameras": [view]}, trajectory={"poses": [{"position": [0, 0, 0]}]}).vehicle.cameras[0]
    when, moments = instants(camera), Moments()
    moments.cameras = wp.zeros(len(when.offset_s), dtype=Camera, device="cpu")
    moments.per_row, moments.open = when.per_row, when.open
    count = min(4096, (1 << 23) // rows)
    shares = wp.array((np.arange(count) + 0.5) / count, dtype=float, device="cpu")
    number = wp.zeros((rows, count), dtype=int, device="cpu")
    wp.launch(number_instants, number.shape, [moments, shares], [number], device="cpu")
    late = when.offset_s[number.numpy()].mean(axis=1) - row_offsets_s(camera)
    # of a part that is exposed by a share s, the middle is off by (1 - s) / 2; and shares are so many
    assert np.abs(late).max() <= when.length_s / 8 / max(when.open, 1.0) + exposure / (2 * count) + 1e-12
    assert np.rint(1e9 * when.offset_s.max()) <= open_ns([camera])


def test_a_row_that_is_open_for_less_than_a_part_sees_a_flash_or_not():
    """Rows of 0.6 ms, open for 1 us: a flash as long lights one row, or none if it falls between two."""
    camera = scene_of({"time_s": 1e-6, "readout_s": 0.02}).vehicle.cameras[0]
    when, line = instants(camera), 0.02 / SIZE[1]
    for delay, lit in ((0.5 * line, [1.0]), (0.0, []), (0.5 * line + 0.5e-6, [0.5])):
        share = on_share(Strobe(on_s=1e-6, delay_s=delay), when)
        np.testing.assert_allclose(share[share > 1e-9], lit, rtol=1e-6)


@pytest.mark.parametrize("speed", [(0.9, 0.0), (0.0, 0.6), (0.5, -0.8)])
def test_the_flow_between_rolling_shutters_is_that_of_a_point_seen_when_its_row_is(truth, speed):
    """Before a wall at 3 m: f v dt / Z, with dt from the row where a point is to the row where it comes to be."""
    readout, frame_ns, depth = 0.06, 100_000_000, 3.0
    velocity = np.array([speed[0], 0.0, speed[1]])
    around = steady(velocity)
    renderer = FrameRenderer(
        scene_of({"readout_s": readout}),
        "cpu",
        parts=[rectangle((-30, depth, -30), (60, 0, 0), (0, 0, 60), 0.5, "wall")],
    )
    F = renderer.render(
        np.eye(4),
        outputs="F",
        motion=around,
        following=NextFrame(around(np.array([frame_ns]))[0], motion=lambda ns: around(ns + frame_ns)),
    ).F
    image_speed = FOCAL * np.array([-speed[0], speed[1]]) / depth
    dt = 1e-9 * frame_ns / (1.0 - image_speed[1] * readout / SIZE[1])
    inside = slice(8, -8)  # beyond the image, rows are those of its borders
    got = F.flow[inside]
    truth(
        f"flow between rolling shutters [px], {speed} m/s",
        source="v dt f / Z, dt by row",
        tolerance=2e-4,
        expected=np.broadcast_to(image_speed * dt, got.shape),
        got=got,
        reason="float32 rounding of D",
    )
    assert not F.occluded[inside].any()


def test_a_camera_in_the_world_sees_no_flow_through_a_rolling_shutter():
    """Nor between it and one like it on the vehicle, but that of the pair."""
    scene, motion = scene_of({"readout_s": 0.05}), steady((2.0, 0.0, 1.0))
    rig = scene.vehicle.cameras[0]
    world = rig.model_copy(update={"mount": "world"})
    renderer = FrameRenderer(scene, "cpu", parts=room())
    how, there = {"outputs": "F", "motion": motion}, NextFrame(np.eye(4), motion=motion)
    assert not np.abs(renderer.render(np.eye(4), world, following=there, **how).F.flow).max() > 1e-4
    pair = renderer.render(np.eye(4), rig, following=there._replace(camera=world), **how).F
    # after which the vehicle stands still
    still = renderer.render(np.eye(4), rig, following=NextFrame(np.eye(4)), **how).F
    np.testing.assert_array_equal(pair.flow, still.flow)
    # nor does it matter what else is asked for
    beside = renderer.render(np.eye(4), rig, following=NextFrame(np.eye(4)), **how | {"outputs": "FS"}).F
    np.testing.assert_array_equal(beside.flow, still.flow)


def test_flow_is_not_told_where_the_image_moves_as_fast_as_rows_are_read():
    """Up by 1.4 rows while one is read: where a point will be is not found, and not made up."""
    around = steady((0.0, 0.0, -60.0))
    renderer = FrameRenderer(
        scene_of({"readout_s": 0.06}), "cpu", parts=[rectangle((-30, 3, -30), (60, 0, 0), (0, 0, 60), 0.5, "wall")]
    )
    F = renderer.render(
        np.eye(4),
        outputs="F",
        motion=around,
        following=NextFrame(around(np.array([10_000_000]))[0], motion=lambda ns: around(ns + 10_000_000)),
    ).F
    assert np.isnan(F.flow[8:-8]).all()
    assert not F.occluded[8:-8].any()


# ------------------------------------------------------------------------------------------------------------- strobes


def strobed(**strobe):
    return [LAMPS[0] | {"strobe": strobe}, LAMPS[1]]


def test_a_strobe_lights_its_share_of_an_exposure():
    """A quarter of it; and two strobes that flash apart are as bright as each alone."""

    def A(lights, spp=64):
        scene = scene_of({"time_s": 0.02}, lights)
        renderer = FrameRenderer(scene, "cpu", parts=room())
        image = renderer.render(np.eye(4), outputs="A", spp=spp, integrator="path", layers=("direct",)).A
        return image.radiance.mean((0, 1)), np.sqrt((image.stderr**2).mean((0, 1)) / np.prod(SIZE))

    one, other = ([lamp] for lamp in LAMPS)
    flash = {"on_s": 0.005}
    whole, _ = A(one, 256)
    got, error = A([one[0] | {"strobe": flash}])
    np.testing.assert_allclose(got, whole / 4, atol=4 * error.max())
    apart = [one[0] | {"strobe": flash | {"delay_s": -0.005}}, other[0] | {"strobe": flash | {"delay_s": 0.004}}]
    got, error = A(apart)
    np.testing.assert_allclose(got, (whole + A(other, 256)[0]) / 4, atol=4 * error.max())


def test_a_strobe_and_a_rolling_shutter_make_a_band():
    """Rows whose exposure meets the flash are lit, by the share of it that they see."""
    exposure, readout, flash = 0.01, 0.05, {"on_s": 0.006, "delay_s": 0.004}
    scene = scene_of({"time_s": exposure, "readout_s": readout}, strobed(**flash)[:1])
    when = instants(scene.vehicle.cameras[0])
    share = on_share(scene.vehicle.lights[0].strobe, when)
    middle = ((np.arange(SIZE[1]) + 0.5) / SIZE[1] - 0.5) * readout
    seen = np.minimum(middle + exposure / 2, 0.007) - np.maximum(middle - exposure / 2, 0.001)
    expected = np.clip(seen, 0.0, None) / exposure
    renderer = FrameRenderer(scene, "cpu", parts=room()[:1])
    how = {"outputs": "A", "spp": 256, "integrator": "path", "layers": ("direct",)}
    A = renderer.render(np.eye(4), **how).A
    plain = FrameRenderer(scene_of(None, LAMPS[:1]), "cpu", parts=room()[:1]).render(np.eye(4), **how).A
    lit, error = A.radiance[..., 1].sum(1), np.sqrt((A.stderr[..., 1] ** 2).sum(1))
    np.testing.assert_allclose(lit, expected * plain.radiance[..., 1].sum(1), atol=4.5 * error.max())
    assert not lit[expected == 0.0].any()
    assert share.max() == pytest.approx(1.0)


def test_light_of_two_reflections_flashes_with_its_rows():
    """By the same share, where few instants of all are lit; by 8 images each, for pixels share virtual point lights."""
    exposure, readout, on, delay, images = 0.01, 0.05, 0.004, 0.003, 8
    middle = ((np.arange(SIZE[1]) + 0.5) / SIZE[1] - 0.5) * readout
    seen = np.minimum(middle + exposure / 2, delay + on / 2) - np.maximum(middle - exposure / 2, delay - on / 2)
    expected = np.clip(seen, 0.0, None) / exposure

    def rows(shutter, lights):
        renderer = FrameRenderer(scene_of(shutter, lights), "cpu", parts=room())
        found = [
            renderer.render(np.eye(4), outputs="A", spp=16, integrator="path", layers=("multiple",), seed=seed)
            .A.radiance[..., 1]
            .mean(1)
            for seed in range(images)
        ]
        return np.array(found)

    flash = rows({"time_s": exposure, "readout_s": readout}, strobed(on_s=on, delay_s=delay)[:1])
    assert not flash[:, expected == 0.0].any()
    steadily = expected * rows(None, LAMPS[:1])
    lit = expected > 0.0
    for one, other in ((flash[:, lit], steadily[:, lit]), (flash.sum(1)[:, None], steadily.sum(1)[:, None])):
        z = (one.mean(0) - other.mean(0)) / np.sqrt((one.var(0, ddof=1) + other.var(0, ddof=1)) / images)
        assert np.abs(z).max() < student.isf(ALPHA / 2 / z.size, images - 1)
    assert flash.sum(1).std() < 0.1 * flash.sum(1).mean()  # enough to see that a tenth of all rows is missing


@pytest.mark.parametrize("readout", [0.0, 0.004])
def test_a_short_flash_is_as_noisy_as_a_lamp_that_shines_all_the_time(readout):
    """Of a tenth of the power; with as many samples in the dark as there is dark, RMS differences were 130 %."""

    def A(lamp):
        scene = scene_of({"time_s": 0.02, "readout_s": readout}, [lamp])
        renderer = FrameRenderer(scene, "cpu", parts=room())
        return renderer.render(
            np.eye(4), outputs="A", spp=4, integrator="path", layers=("direct",), motion=steady()
        ).A.radiance

    weak = LAMPS[0] | {"intensity": (np.array(LAMPS[0]["intensity"]) / 10).tolist()}
    flash, steadily = A(LAMPS[0] | {"strobe": {"on_s": 0.002, "delay_s": 0.001}}), A(weak)
    assert steadily.mean() > 0.0
    np.testing.assert_allclose(flash.mean(), steadily.mean(), rtol=0.01)
    assert np.sqrt(np.mean((flash - steadily) ** 2)) < 0.15 * np.sqrt(np.mean(steadily**2))


def test_flashes_do_not_sharpen_an_image_in_ambient_light():
    """B is of the whole exposure, and so are its guides, whatever flashes in A."""

    def B(lights):
        renderer = FrameRenderer(scene_of({"time_s": 0.4}, lights), "cpu", parts=room())
        return renderer.render(np.eye(4), outputs="B", spp_b=4, denoise_b="oidn", motion=steady((0.3, 0, 0))).B

    flashed, steadily = B(strobed(on_s=0.1)[:1]), B(LAMPS[:1])
    np.testing.assert_array_equal(flashed.radiance, steadily.radiance)
    np.testing.assert_array_equal(flashed.denoised, steadily.denoised)


def test_guides_of_a_blurred_b_have_no_noise():
    renderer = FrameRenderer(scene_of({"time_s": 0.4}), "cpu", parts=room())
    how = {"outputs": "B", "spp_b": 4, "denoise_b": "oidn", "motion": steady((0.3, 0, 0))}
    one, two = (renderer.render(np.eye(4), seed=seed, **how).B for seed in (1, 2))
    assert not np.array_equal(one.radiance, two.radiance)
    assert np.array_equal(one.albedo, two.albedo)


def test_a_sharp_twin_lit_by_strobes_is_not_the_blurred_image():
    """Of a camera with nothing but a shutter; whether or not A is rendered with it."""
    renderer = FrameRenderer(scene_of({"time_s": 0.4}, strobed(on_s=0.1)), "cpu", parts=room())
    how = {"spp": 2, "integrator": "path", "layers": ("direct",)}
    moving = renderer.render(np.eye(4), outputs="AP", motion=steady((1, 0, 0)), **how)
    still = renderer.render(np.eye(4), outputs="AP", **how)
    assert np.array_equal(moving.P.radiance, still.A.radiance)
    assert np.array_equal(still.P.radiance, still.A.radiance)
    assert not np.array_equal(moving.P.radiance, moving.A.radiance)


def test_the_field_is_not_for_strobes():
    scene = scene_of({"time_s": 0.02}, strobed(on_s=0.005), {"coefficients": TURBID})
    with pytest.raises(Exception, match="strobe"):
        FrameRenderer(scene, "cpu", parts=room()).render(np.eye(4), outputs="A", spp=2, integrator="field")


@pytest.mark.gpu
@pytest.mark.parametrize("shutter", [{"time_s": 0.2}, {"time_s": 0.02, "readout_s": 0.1}])
def test_a_gpu_exposes_as_a_cpu_does(shutter):
    """Both lamps disks, one a strobe: the same random numbers, so that rounding alone differs, but at edges."""
    lights = [LAMPS[0] | {"radius_m": 0.05, "strobe": {"on_s": 0.1}}, LAMPS[1] | {"radius_m": 0.02}]
    scene = scene_of(shutter, lights, {"coefficients": TURBID})
    motion = steady((0.6, 0.1, -0.3), (0.1, -0.2, 0.9))
    how = {
        "outputs": "ABDF",
        "spp": 6,
        "spp_b": 6,
        "integrator": "path",
        "layers": ALL[:2],
        "denoise": "none",
        "denoise_b": "none",
        "motion": motion,
        "following": NextFrame(np.eye(4), motion=motion),
    }
    cpu, gpu = (FrameRenderer(scene, device, parts=room()).render(np.eye(4), **how) for device in ("cpu", "cuda:0"))
    for letter in "AB":
        of_cpu, of_gpu = (getattr(frame, letter).radiance for frame in (cpu, gpu))
        off = np.abs(of_gpu - of_cpu) > 1e-3 * of_cpu.mean()
        assert off.mean() < 0.01
    assert (np.abs(gpu.D.range - cpu.D.range) > 1e-4).mean() < 0.005
    assert np.nanmedian(np.abs(gpu.F.flow - cpu.F.flow)) < 1e-3
