"""Objects that move along paths: images, blur, flow and what hides, against still objects and closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from chance import assert_plausible, two_sided
from rig import TURBID
from test_lens import rectangle
from test_shutters import FOCAL, SIZE, scene_of, steady

from varos_warp.render.renderer import FrameRenderer, NextFrame
from varos_warp.scene import device
from varos_warp.scene.description.placed import Stop
from varos_warp.scene.description.world import Rust
from varos_warp.scene.frames import transform
from varos_warp.scene.geometry.parts import Instances, Moving
from varos_warp.scene.geometry.query import Solids, ranges
from varos_warp.scene.optics.shutter import in_ns, row_offsets_s
from varos_warp.sim.poses import poses_along

pytestmark = pytest.mark.subject("camera")

SECOND = 1_000_000_000


def moving(part, velocity, turn_deg=(0, 0, 0)):
    """A part that moves and turns so much in its first second."""
    stops = tuple(
        Stop(
            time_s=t,
            position=tuple(t * np.array(velocity, float)),
            rotation_euler_deg=tuple(t * np.array(turn_deg, float)),
        )
        for t in (0.0, 1.0)
    )
    return Moving.of(part, np.eye(3), stops)


def plate(x=-0.3, y=1.2):
    return rectangle((x, y, -0.2), (0.4, 0, 0), (0, 0, 0.5), 0.9, "plate")


def wall():
    return rectangle((-9, 2, -9), (18, 0, 0), (0, 0, 18), 0.1, "wall")


def placed(part, T):
    """A part that stands where a pose takes it."""
    return replace(part, vertices=part.vertices @ T[:3, :3].T + T[:3, 3])


@pytest.mark.parametrize("time_ns", [0, 370_000_000, SECOND])
def test_an_object_looks_as_if_it_stood_where_it_is(time_ns):
    """C, D and S to a rounding, A and B but where an edge falls on the other side of a sample."""
    one = moving(plate(), (0.3, 0.2, -0.1), (0, 0, 30))
    scene = scene_of(water={"coefficients": TURBID})
    how = {"outputs": "ABCDS", "spp": 4, "spp_b": 4, "integrator": "path", "time_ns": time_ns}
    T = poses_along(one.path, np.array([time_ns]))[0]
    got, still = (
        FrameRenderer(scene, "cpu", parts=parts).render(np.eye(4), **how)
        for parts in ([one, wall()], [placed(plate(), T), wall()])
    )
    same = got.S.instance == still.S.instance
    assert same.mean() > 0.998
    assert (got.S.instance == 1).sum() > 100  # numbered in the scene's order, whatever moves
    np.testing.assert_allclose(got.D.range[same], still.D.range[same], atol=2e-6)
    np.testing.assert_allclose(got.C.normal[same], still.C.normal[same], atol=1e-6)
    for letter in "AB":
        mine, theirs = getattr(got, letter).radiance, getattr(still, letter).radiance
        off = (np.abs(mine - theirs) > 1e-3 * theirs.mean()).any(-1)
        assert off.mean() < 0.02


def test_copies_beside_it_may_join_the_mesh(monkeypatch):
    """As on a GPU: numbers, normals and colours are those of copies that do not."""
    shape, T = rectangle((0, 0, 0), (0.2, 0, 0.05), (0, 0.1, 0.2), 0.6, "scatter.0"), np.tile(np.eye(4), (4, 1, 1))
    T[:, :3, 3] = np.column_stack([np.linspace(-0.7, 0.5, 4), np.full(4, 1.0), np.full(4, 0.15)])
    copies = Instances(shape.name, shape.vertices, shape.faces, shape.material, T_w_o=T)
    made = []
    for most in (0, 1 << 23):
        monkeypatch.setitem(device.MOST_JOINED_FACES, "cpu", most)
        renderer = FrameRenderer(scene_of(), "cpu", parts=[moving(plate(), (0.3, 0, 0), (0, 20, 0)), wall(), copies])
        made.append(renderer.render(np.eye(4), outputs="BCDS", spp_b=2, time_ns=SECOND // 2))
    apart, joined = made
    assert set(np.unique(apart.S.instance)) == {1, 2, 3, 4, 5, 6}
    same = apart.S.instance == joined.S.instance
    assert same.mean() > 0.998
    np.testing.assert_allclose(joined.C.normal[same], apart.C.normal[same], atol=1e-6)
    np.testing.assert_allclose(joined.D.range[same], apart.D.range[same], atol=2e-6)
    assert (np.abs(joined.B.radiance - apart.B.radiance) > 1e-3).any(-1).mean() < 0.02


def test_a_pattern_moves_with_its_object():
    """A camera that moves and turns as a rusty plate does sees the same."""
    one = moving(replace(plate(), material=Rust(kind="rust", amount=0.5)), (0.7, 0.4, 0.3), (20, 0, 50))
    renderer = FrameRenderer(scene_of(), "cpu", parts=[one])
    T = poses_along(one.path, np.array([SECOND]))[0]
    before = renderer.render(np.eye(4), outputs="B", spp_b=4).B.radiance
    after = renderer.render(T, outputs="B", spp_b=4, time_ns=SECOND).B.radiance
    stays = renderer.render(T, outputs="B", spp_b=4).B.radiance
    off = np.abs(after - before).max(-1)
    assert before.std() > 0.05
    assert np.quantile(off, 0.98) < 2e-3
    assert np.abs(stays - before).max(-1).mean() > 0.02


# ---------------------------------------------------------------------------------------------------------------- blur


def black(velocity=None):
    """A half plane 2 m away, with an edge through the middle of the image."""
    part = rectangle((-9, 2.0, -9), (9, 0, 0), (0, 0, 18), 0.0, "black")
    return part if velocity is None else moving(part, velocity)


def test_a_moving_edge_before_a_still_camera_is_a_ramp(truth):
    """B is the share of the exposure in which the plate is not there; so it is if the camera moves instead."""
    speed, exposure = 1.2, 0.25
    scene = scene_of({"time_s": exposure})
    T_0 = transform(position=(-0.5 * speed, 0, 0))  # the plate's edge is before the camera after half a second
    how = {"outputs": "B", "spp_b": 256}
    by_plate = (
        FrameRenderer(scene, "cpu", parts=[black((-speed, 0, 0))])
        .render(T_0, motion=lambda ns: np.repeat(T_0[None], len(ns), axis=0), time_ns=SECOND // 2, **how)
        .B
    )
    by_camera = FrameRenderer(scene, "cpu", parts=[black()]).render(np.eye(4), motion=steady((speed, 0, 0)), **how).B
    streak = FOCAL * speed * exposure / 2.0
    at = np.arange(SIZE[0] + 1.0) - SIZE[0] / 2
    inside = np.clip(at + streak / 2, 0.0, streak)
    free = inside**2 / (2 * streak) + np.maximum(at - streak / 2, 0.0)
    truth(
        "B across a moving edge",
        source="speed x exposure x f / Z",
        expected=np.diff(free),
        got=by_plate.radiance[..., 1].mean(0),
        stderr=by_plate.radiance[..., 1].std(0, ddof=1) / np.sqrt(SIZE[1]),
        reason="noise, and one part in 512 of an exposure",
    )
    # the same samples: one falls on the other side of the edge by rounding now and then
    assert np.abs(by_plate.radiance - by_camera.radiance).max() <= 2.01 / 256


@pytest.mark.parametrize(("roughness", "turn_deg"), [(0.0, 0.0), (0.9, 25.0)])
def test_light_off_a_plate_that_comes_closer_is_the_mean_over_instants(truth, roughness, turn_deg):
    """A plate beside the camera is lit, comes 0.3 m closer, and lights the wall, which sees nothing else.

    The water scatters next to nothing: kernels without water would be compiled for this alone.
    """
    clear = {"coefficients": {"sigma_s": [1e-6] * 3, "sigma_a": [0.0] * 3}}
    lamp = {"kind": "spot", "position": [-0.9, 0.6, 0], "direction": [-1, 0, 0], "cone_deg": 70, "intensity": [9, 9, 9]}
    reflector = rectangle((-1.75, 0.2, -0.4), (0, 0.8, 0), (0, 0, 0.8), 0.8, "reflector")
    scene = scene_of({"time_s": 0.3}, [lamp], clear)
    reflector = replace(reflector, material=reflector.material.model_copy(update={"diffuse_roughness": roughness}))
    one = moving(reflector, (1.0, 0, 0), (0.0, 0.0, turn_deg))
    how = {"outputs": "A", "spp": 16, "integrator": "path", "max_bounces": 2, "denoise": "none"}
    renderer = FrameRenderer(scene, "cpu", parts=[one, wall()])
    blurred = [
        renderer.render(np.eye(4), motion=steady(), time_ns=SECOND // 2, seed=k, **how).A.radiance.mean()
        for k in range(12)
    ]
    still = FrameRenderer(scene_of(None, [lamp], clear), "cpu", parts=[one, wall()])
    times = 0.5 + 0.3 * ((np.arange(12) + 0.5) / 12 - 0.5)  # of a smooth course; the step's error is below 1e-4
    instants = [
        still.render(np.eye(4), time_ns=round(SECOND * t), seed=k, **how).A.radiance.mean() for k, t in enumerate(times)
    ]
    trend = np.polyval(np.polyfit(times, instants, 2), times)  # without which their spread is noise
    error = np.hypot(np.std(blurred, ddof=1), np.std(instants - trend, ddof=3)) / np.sqrt(12)
    truth(
        f"light off a moving plate, roughness {roughness}, which turns by {turn_deg} degrees a second",
        source="mean over instants",
        expected=np.mean(instants),
        got=np.mean(blurred),
        stderr=error,
        reason="noise of 12 images of each",
    )


def test_without_motion_objects_are_not_blurred_either():
    scene, parts = scene_of({"time_s": 0.25}), [moving(plate(), (1, 0, 0)), wall()]
    plain = FrameRenderer(scene_of(), "cpu", parts=parts)
    how = {"outputs": "ABD", "spp": 2, "spp_b": 2, "integrator": "path", "layers": ("direct",), "time_ns": SECOND // 3}
    still, sharp = FrameRenderer(scene, "cpu", parts=parts).render(np.eye(4), **how), plain.render(np.eye(4), **how)
    assert np.array_equal(still.A.radiance, sharp.A.radiance)
    assert np.array_equal(still.B.radiance, sharp.B.radiance)


def test_rows_of_a_rolling_shutter_have_the_object_at_their_times():
    scene = scene_of({"readout_s": 0.2}, water={"coefficients": TURBID})
    renderer = FrameRenderer(scene, "cpu", parts=[moving(plate(), (1.5, 0.2, 0.5), (0, 90, 0)), wall()])
    how = {"outputs": "ACDS", "integrator": "path", "layers": ("direct", "single"), "spp": 2}
    frame = renderer.render(np.eye(4), motion=steady(), time_ns=SECOND // 2, **how)
    offset_ns = in_ns(row_offsets_s(scene.vehicle.cameras[0]))
    for row in range(0, SIZE[1], 5):
        instant = renderer.render(np.eye(4), time_ns=SECOND // 2 + int(offset_ns[row]), **how)
        for image, name in (("A", "radiance"), ("C", "normal"), ("D", "range"), ("S", "instance")):
            of_row, of_instant = (getattr(getattr(made, image), name)[row] for made in (frame, instant))
            assert np.array_equal(of_row, of_instant), (image, row)


# ---------------------------------------------------------------------------------------------------------------- flow


def test_flow_follows_the_object_and_what_it_comes_to_hide(truth):
    """A plate at 1.2 m that moves by 0.1 m: f v / Z; ahead of it a band of the wall hides, behind it none does."""
    parts = [moving(plate(), (1.0, 0, 0)), wall()]
    frame = FrameRenderer(scene_of(), "cpu", parts=parts).render(
        np.eye(4), outputs="FS", time_ns=SECOND // 10, following=NextFrame(np.eye(4), time_ns=SECOND // 5)
    )
    on_plate, step = frame.S.instance == 1, FOCAL * 0.1 / 1.2
    expected = np.where(on_plate[..., None], [step, 0.0], 0.0)
    truth(
        "flow of a moving plate [px]",
        source="f v dt / Z",
        tolerance=2e-4,
        expected=expected,
        got=frame.F.flow,
        reason="float32 rounding of D",
    )
    np.testing.assert_allclose(frame.F.motion[on_plate], np.broadcast_to([0.1, 0, 0], (on_plate.sum(), 3)), atol=1e-5)
    assert not frame.F.occluded[on_plate].any()
    # the wall's points that the plate is before in the next frame, and not in this one
    edges = SIZE[0] / 2 + FOCAL * np.array([-0.3, 0.1]) / 1.2 + step  # where its edges were at 0, and are at 0.1 s
    u = np.arange(SIZE[0]) + 0.5
    rows = np.flatnonzero(on_plate.any(axis=1))[1:-1]
    hidden = (u > edges[0] + step) & (u < edges[1] + step)
    assert np.array_equal(frame.F.occluded[rows], np.broadcast_to(hidden, (len(rows), SIZE[0])) & ~on_plate[rows])
    assert frame.F.occluded[rows].sum(axis=1).min() >= int(step)


def test_flow_between_rolling_shutters_follows_the_object(truth):
    """As of the camera that moves the other way: f v dt / Z, dt from a point's row to that where it comes to be."""
    readout, depth, velocity = 0.06, 3.0, np.array([0.4, 0.0, -0.7])
    board = rectangle((-30, depth, -30), (60, 0, 0), (0, 0, 60), 0.5, "board")
    F = (
        FrameRenderer(scene_of({"readout_s": readout}), "cpu", parts=[moving(board, velocity)])
        .render(
            np.eye(4),
            outputs="F",
            motion=steady(),
            time_ns=SECOND // 2,
            following=NextFrame(np.eye(4), motion=steady(), time_ns=SECOND // 2 + 100_000_000),
        )
        .F
    )
    image_speed = FOCAL * np.array([velocity[0], -velocity[2]]) / depth
    dt = 0.1 / (1.0 - image_speed[1] * readout / SIZE[1])
    got = F.flow[8:-8]
    truth(
        "flow of an object between rolling shutters [px]",
        source="v dt f / Z, dt by row",
        tolerance=2e-4,
        expected=np.broadcast_to(image_speed * dt, got.shape),
        got=got,
        reason="float32 rounding of D",
    )
    assert not F.occluded[8:-8].any()


# --------------------------------------------------------------------------------------------------------------- sonar


def test_beams_meet_an_object_where_it_is_at_their_times():
    one, times = moving(plate(), (1.0, 0.5, 0.0), (0, 0, 20)), np.array([0, SECOND // 2, SECOND])
    start, ahead = np.array([[0.0, 0, 0], [0.3, 0, 0], [0.5, 0, 0]]), np.tile([0.0, 1.0, 0.0], (3, 1))
    T = poses_along(one.path, times)
    got, *_ = Solids([wall(), one]).first_met(start, ahead, 30.0, {"plate": T})
    alone = [
        ranges([wall(), placed(plate(), pose)], start[i : i + 1], ahead[i : i + 1], 30.0)[0] for i, pose in enumerate(T)
    ]
    np.testing.assert_allclose(got, alone, atol=1e-6)
    assert (got < 1.99).all()


@pytest.mark.gpu
def test_a_gpu_sees_what_moves_as_a_cpu_does():
    """With all that a path kernel can have: the same random numbers, so that most pixels differ by rounding alone.

    And by the field, whose kernels a CPU would compile for minutes, within the standard errors of 4 x 4 parts.
    """
    one = moving(replace(plate(), material=Rust(kind="rust", amount=0.5, roughness=0.4)), (0.6, 0.1, 0.2), (0, 40, 0))
    scene, motion = scene_of({"time_s": 0.2}, water={"coefficients": TURBID}), steady((0.3, 0.1, 0), (0, 0, 0.2))
    how = {"spp_b": 8, "integrator": "path", "motion": motion, "time_ns": SECOND // 2}
    cpu, gpu = (FrameRenderer(scene, device, parts=[one, wall()]) for device in ("cpu", "cuda:0"))
    on_cpu, on_gpu = (renderer.render(np.eye(4), outputs="ABDS", spp=16, **how) for renderer in (cpu, gpu))
    assert np.median(np.abs(on_gpu.A.radiance - on_cpu.A.radiance) / on_cpu.A.stderr) < 0.3
    assert np.median(np.abs(on_gpu.B.radiance - on_cpu.B.radiance)) < 1e-4
    same = on_gpu.S.instance == on_cpu.S.instance
    assert same.mean() > 0.995
    np.testing.assert_allclose(on_gpu.D.range[same], on_cpu.D.range[same], atol=1e-5)

    two = [
        gpu.render(np.eye(4), outputs="A", spp=1024, seed=k, **how | {"integrator": name}).A
        for k, name in enumerate(("path", "field"))
    ]
    height, width = (side // 4 for side in SIZE[::-1])
    off, variance = (
        image[: 4 * height, : 4 * width].astype(float).reshape(4, height, 4, width, 3).sum((1, 3))
        for image in (two[1].radiance - two[0].radiance, sum(image.stderr**2 for image in two))
    )
    assert_plausible(two_sided(off / np.sqrt(variance)))
