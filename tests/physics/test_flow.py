"""F: closed forms of optical flow, what hides, and B of the next frame warped to this one."""

import cv2
import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation
from test_lens import rectangle
from test_ports_in_images import CAMERAS, scene_of

from varos_warp.errors import InputError
from varos_warp.render.renderer import FrameRenderer, NextFrame
from varos_warp.scene.description import Scene
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.frames import R_V_C, transform
from varos_warp.scene.optics.camera import camera_model, pixel_centres

pytestmark = pytest.mark.subject("camera")

MOVED = transform(Rotation.from_rotvec([0.02, -0.03, 0.05]).as_matrix(), [0.04, 0.06, -0.03])
WALL_M = 3.0


def wall(y=WALL_M, x=(-30, 30), name="wall"):
    """A plate across the view, at ``y`` from the vehicle."""
    return rectangle((x[0], y, -30), (x[1] - x[0], 0, 0), (0, 0, 60), 0.5, name)


def flow_of(T_next, *parts, **camera):
    renderer = FrameRenderer(scene_of(camera), "cpu", parts=list(parts) or [wall()])
    return renderer.render(np.eye(4), outputs="F", following=NextFrame(T_next)).F


def test_a_translation_along_a_wall_moves_all_by_its_share_of_the_distance(truth):
    """By f t / Z pixels, against the motion; what moves towards the wall spreads from the centre."""
    K = camera_model(scene_of({}).vehicle.cameras[0]).K
    F = flow_of(transform(position=[0.05, 0, -0.02]))
    expected = -np.array([K[0, 0] * 0.05, K[1, 1] * 0.02]) / WALL_M
    truth(
        "flow of a translation [px]",
        source="f t / Z",
        expected=np.broadcast_to(expected, F.flow.shape),
        got=F.flow,
        tolerance=1e-4,
        reason="float32 rounding of Z",
    )
    np.testing.assert_allclose(F.motion, np.broadcast_to([-0.05, -0.02, 0], F.motion.shape), atol=1e-6)
    nearer = flow_of(transform(position=[0, 0.3, 0]))
    points = pixel_centres(64, 36)
    truth(
        "flow of an approach [px]",
        source="(x - c) d / (Z - d)",
        expected=(points - K[:2, 2]) * 0.3 / 2.7,
        got=nearer.flow,
        tolerance=1e-4,
        reason="float32 rounding of Z",
    )
    assert F.valid.all()
    assert not F.occluded.any()


def test_a_roll_turns_the_image_whatever_the_distance(truth):
    """About the axis of the camera, the vehicle's y: the image turns the other way, and nothing hides."""
    angle = np.radians(5)
    roll = transform(Rotation.from_rotvec([0, angle, 0]).as_matrix())
    F = flow_of(roll, wall(), wall(2.0, (0.1, 30), "plate"))
    from_centre = pixel_centres(64, 36) - [32, 18]
    c, s = np.cos(angle), np.sin(angle)
    expected = from_centre @ np.array([[c, s], [-s, c]]).T - from_centre
    truth(
        "flow of a roll [px]",
        source="rotation about the centre",
        expected=expected,
        got=F.flow,
        tolerance=1e-4,
        reason="float32 rounding",
    )
    assert not F.occluded.any()


def test_to_the_other_camera_of_a_pair_it_is_the_disparity(truth):
    """By f b / Z of the left camera; the right one does not see the wall just left of a plate."""
    left, right = (
        {"resolution": [256, 16], "sensor_mm": [4.416, 0.276], "focal_mm": 3.4, "id": name, "position": [x, 0, 0]}
        for name, x in (("L0", -0.1), ("R0", 0.1))
    )
    scene = Scene(water="none", vehicle={"cameras": [left, right]}, trajectory={"poses": [{"position": [0, 0, 0]}]})
    renderer = FrameRenderer(scene, "cpu", parts=[wall(), wall(1.5, (0.05, 30), "plate")])
    frame = renderer.render(np.eye(4), "L0", "DF", following=NextFrame(np.eye(4), "R0"))
    f = 256 / 4.416 * 3.4
    truth(
        "disparity [px]",
        source="f b / Z",
        expected=f * 0.2 / frame.D.depth,
        got=-frame.F.flow[..., 0],
        tolerance=1e-4,
        reason="float32 of the flow",
    )
    np.testing.assert_allclose(frame.F.flow[..., 1], 0, atol=1e-9)
    # the ray to the right camera crosses the plate's plane, half way to the wall
    x = 0.1 + ((np.arange(256) + 0.5 - 128) / f * 3.0 - 0.2) / 2
    hidden = (frame.D.depth > 2) & (x > 0.05)
    assert hidden.sum(axis=1).min() > 10
    assert np.array_equal(frame.F.occluded, hidden)


@pytest.mark.parametrize("camera", CAMERAS)
def test_it_is_where_points_of_the_world_are_seen_next(truth, camera):
    """Through every lens and port: `project` from the next pose of what `rays` and D see now."""
    scene = scene_of(CAMERAS[camera])
    renderer = FrameRenderer(scene, "cpu", parts=[rectangle((-30, -6, -30), (60, 18, 0), (0, 0, 60), 0.5, "plane")])
    frame = renderer.render(np.eye(4), outputs="DF", following=NextFrame(MOVED))
    hit = np.isfinite(frame.D.depth)
    rays = renderer.rays(np.eye(4))
    points = rays.origin[hit] + frame.D.range[hit][:, None] * rays.direction[hit]
    seen = renderer.project(points, MOVED)
    known = np.isfinite(seen).all(-1)
    assert np.array_equal(frame.F.valid[hit], known)
    assert known.mean() > 0.9
    assert not frame.F.valid[~hit].any()
    expected = (seen - pixel_centres(64, 36)[hit])[known]
    truth(
        f"flow [px], {camera}",
        source="project of the same points",
        expected=expected,
        got=frame.F.flow[hit][known],
        tolerance=1e-4,
        reason="float32 of the flow",
    )
    motion = (points - MOVED[:3, 3]) @ MOVED[:3, :3] @ R_V_C - points @ R_V_C
    truth(
        f"scene flow [m], {camera}",
        source="the same points in both cameras' axes",
        expected=motion,
        got=frame.F.motion[hit],
        tolerance=1e-5,
        reason="float32 of the motion",
    )


@pytest.mark.parametrize("camera", ["none", "flat", "dome and barrel"])
def test_a_plate_before_a_wall_hides_a_band(camera):
    """The camera moves to the left: of the wall it hides what sends its light to the next place through the plate.

    Behind a port that light ends on the glass: to end at the lens would be wrong by some pixels here.
    """
    (width, height), near, edge, step = (2048, 4), 0.5, 0.05, 0.08
    scene = scene_of(CAMERAS.get(camera, {}) | {"resolution": [width, height], "sensor_mm": [4.416, 0.0087]})
    renderer = FrameRenderer(scene, "cpu", parts=[wall(), wall(near, (-30, edge), "plate")])
    T_next = transform(position=[-step, 0, 0])
    frame = renderer.render(np.eye(4), outputs="DF", following=NextFrame(T_next))
    rays = renderer.rays(np.eye(4))
    points = rays.origin + frame.D.range[..., None] * rays.direction
    on_wall = points[..., 1] > 2.5
    # light to the next place crosses the plate's plane at x
    ends = renderer.rays(T_next, points=pixel_centres(width, height) + frame.F.flow).origin
    share = (near - ends[..., 1]) / (points[..., 1] - ends[..., 1])
    x = ends[..., 0] + share * (points[..., 0] - ends[..., 0])
    sure = np.abs(x - edge) > 1e-5
    assert np.array_equal(frame.F.occluded[sure & on_wall], (x < edge)[sure & on_wall])
    assert not frame.F.occluded[~on_wall].any()
    band = frame.F.occluded.sum(axis=1)
    assert band.min() > 100
    if camera == "none":  # from the edge's shadow now to that from the next place
        hidden_m = (edge + step) / near * WALL_M - step - edge / near * WALL_M
        assert np.abs(band - hidden_m * width / 4.416 * 3.4 / WALL_M).max() <= 1


def test_what_hides_is_what_the_next_d_has_something_nearer_of():
    """Of a wall with posts, from D of the next frame: in all pixels but at edges."""
    scene = scene_of({"resolution": [320, 180]})
    posts = [wall(y, (x, x + 0.15), f"post {x}") for x, y in ((-0.8, 2.0), (-0.2, 1.4), (0.3, 1.8))]
    renderer = FrameRenderer(scene, "cpu", parts=[wall(), *posts])
    frame = renderer.render(np.eye(4), outputs="DF", following=NextFrame(MOVED))
    there = renderer.render(MOVED, outputs="D").D.depth
    to = pixel_centres(320, 180) + frame.F.flow
    inside = ((to > 1) & (to < [319, 179])).all(-1)
    col, row = np.moveaxis(np.floor(to[inside]).astype(int), -1, 0)
    z = frame.D.depth[inside] + frame.F.motion[inside][:, 2]
    around = np.stack([there[row + i, col + j] for i in (-1, 0, 1) for j in (-1, 0, 1)])
    alike = np.ptp(around, axis=0) < 0.1  # not at an edge
    assert alike.mean() > 0.9
    hidden = frame.F.occluded[inside]
    assert 300 < hidden[alike].sum()
    assert np.array_equal(hidden[alike], (around[4] < z - 0.2)[alike])


def test_nothing_moves_or_hides_where_the_camera_stands_still():
    still = flow_of(np.eye(4), wall(), wall(2.0, (0.1, 30), "plate"))
    fixed = flow_of(MOVED, wall(y=-WALL_M), mount="world", rotation_euler_deg=[0, 0, 180])
    for F in (still, fixed):
        assert F.valid.all()
        assert np.abs(F.flow).max() < 1e-9
        assert np.abs(F.motion).max() < 1e-12
        assert not F.occluded.any()


def test_what_is_behind_the_next_camera_or_nowhere_has_no_flow():
    """A wall that the camera passes through moves still, but is not seen."""
    passed = flow_of(transform(position=[0, 4, 0]))
    assert not passed.valid.any()
    assert not passed.occluded.any()
    np.testing.assert_allclose(passed.motion[..., 2], -4.0, rtol=1e-6)
    nothing = flow_of(MOVED, wall(y=-WALL_M))
    assert np.isnan(nothing.flow).all()
    assert np.isnan(nothing.motion).all()
    assert not nothing.occluded.any()


def test_without_the_next_pose_it_is_refused():
    renderer = FrameRenderer(scene_of({}), "cpu", parts=[wall()])
    with pytest.raises(InputError, match="F, the flow to the next frame, needs the vehicle's pose there"):
        renderer.render(np.eye(4), outputs="F")


# ------------------------------------------------------------------------------------------------------------- warping


SIZE = (128, 96)


def textured_scene(folder, camera):
    """A sea floor with a smooth random texture, whose spots are about 8 pixels wide."""
    noise = gaussian_filter(np.random.default_rng(5).standard_normal((128, 128)), 3, mode="wrap")
    tones = np.clip(128 + 45 * noise / noise.std(), 0, 255).astype(np.uint8)
    Image.fromarray(np.repeat(tones[..., None], 3, -1)).save(folder / "spots.png")
    texture = {"texture": str(folder / "spots.png"), "size_m": 2.0}
    view = {"resolution": list(SIZE), "sensor_mm": [4.8, 3.6], "rotation_euler_deg": [-60, 0, 0]}
    return scene_from_dict(
        {
            "terrain": {
                "kind": "procedural",
                "size_m": 30,
                "resolution": 65,
                "relief_m": 0.5,
                "position": [0, 0, -2.5],
                "material": "spots",
            },
            "materials": {"spots": {"kind": "slope_blend", "flat": texture, "steep": texture}},
            "water": "none",
            "vehicle": {"cameras": [view | camera], "lights": []},
            "trajectory": {"poses": [{"position": [0, 0, 0]}]},
            "render": {"outputs": ["B", "F"]},
        }
    )


@pytest.mark.parametrize("camera", ["none", "flat"])
def test_it_warps_the_next_b_to_this_one(truth, tmp_path, camera):
    """By Lucas and Kanade of OpenCV: in textured places less than 0.05 px are left, of 5."""
    scene, (width, height) = textured_scene(tmp_path, CAMERAS.get(camera, {})), SIZE
    renderer, how = FrameRenderer(scene, "cpu"), {"spp_b": 64, "denoise_b": "none"}
    here = renderer.render(np.eye(4), outputs="BF", following=NextFrame(MOVED), **how)
    there = renderer.render(MOVED, outputs="B", frame=1, **how)
    this, following = (np.clip(f.B.radiance.mean(-1) * 300, 0, 255).astype(np.uint8) for f in (here, there))
    to = (pixel_centres(width, height) - 0.5 + here.F.flow).astype(np.float32)  # OpenCV counts from the first centre
    warped = cv2.remap(following, to, None, cv2.INTER_CUBIC)
    inside = here.F.valid & ~here.F.occluded & ((to > 2) & (to < [width - 3, height - 3])).all(-1)
    places = cv2.erode(inside.astype(np.uint8), np.ones((23, 23)))
    points = cv2.goodFeaturesToTrack(this, 300, 0.05, 5, mask=places)
    ends, found, _ = cv2.calcOpticalFlowPyrLK(this, warped, points, None, winSize=(21, 21), maxLevel=0)
    left = (ends - points)[found.astype(bool)]
    assert len(left) > 50
    truth(
        f"what the warped B has left to move [px], {camera}",
        source="nothing",
        expected=0.0,
        got=np.median(np.linalg.norm(left, axis=-1)),
        tolerance=0.05,
        reason="asked for",
    )
