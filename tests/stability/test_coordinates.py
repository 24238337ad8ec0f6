"""Places, angles and lenses from the smallest to the largest: what stays exact, and what is refused."""

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from varos_warp.errors import InputError
from varos_warp.products.images.depth import decode_depth, encode_depth
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.checks import check_scene
from varos_warp.scene.description.world import Diffuse, MeshObject
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.frames import intrinsics, look_at_matrix, transform
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.geometry.parts import Part
from varos_warp.sim.trajectory import simulate

TILT = 0.3
STEP_OF_D = 25.0 / 65535


def seen_from(*positions, camera=None, **blocks):
    """A scene that visits some places."""
    stops = [{"time_s": float(i), "position": tuple(map(float, p))} for i, p in enumerate(positions)]
    return scene_from_dict(
        {"trajectory": {"poses": stops}, "vehicle": {"cameras": [{"resolution": (32, 18)} | (camera or {})]}, **blocks}
    )


def wall(scale=1.0, width=10.0):
    """A wall 3 m in front, turned by atan(TILT)."""
    x = np.array([-width, width, width, -width])
    vertices = np.column_stack([x, 3.0 + TILT * x, [-width, -width, width, width]])
    return scale * vertices, np.array([[0, 1, 2], [0, 2, 3]], np.int32)


def depth_error(scene, at, *others, scale=1.0) -> float:
    """Largest error of D [m] of the wall in front of ``at`` against its closed form; walls stand at ``others``, too.

    The camera stands beside ``at`` by no round number: the wall's corners and it are not rounded alike.
    """
    vertices, faces = wall(scale)
    parts = [Part(f"objects.{i}", vertices + place, faces, Diffuse()) for i, place in enumerate((at, *others))]
    aside = scale * np.array([0.1237, 0.0541, 0.0])
    depth = FrameRenderer(scene, "cpu", parts).render(transform(position=at + aside), outputs="D").D.depth
    K, (width, _) = intrinsics(scene.vehicle.cameras[0]), scene.vehicle.cameras[0].resolution
    slope = (np.arange(width) + 0.5 - K[0, 2]) / K[0, 0]
    return float(np.abs(depth - (3.0 * scale + TILT * aside[0] - aside[1]) / (1.0 - TILT * slope)).max())


# ------------------------------------------------------------------------------------------------- far from the origin


@pytest.mark.parametrize("offset", [0.0, 1e5, 1e7, 1e9])
def test_depth_does_not_depend_on_where_in_the_world_the_scene_lies(offset):
    at = np.array([offset + 0.37, -offset + 0.21, 0.3]).clip(-1e9, 1e9)
    spacing = np.spacing(np.abs(at).max())  # of the wall's corners in float64, seen at up to 5 times their offset
    assert depth_error(seen_from(at), at) < 16 * 2.0**-24 * 3.0 + 5 * spacing


@pytest.mark.parametrize("span", [1e3, 1e5])
def test_depth_loses_digits_with_the_distance_from_the_middle_of_the_course(span):
    at = np.array([span / 2 + 0.371, 0.213, 0.331])
    error = depth_error(seen_from(-at, at), at, -at)
    assert error < 8 * 2.0**-24 * span
    if span >= 1e5:
        assert error > STEP_OF_D


@pytest.mark.parametrize(("half", "warns"), [(3000.0, False), (3500.0, True)])
def test_a_course_so_wide_that_depth_loses_its_step_is_reported(half, warns):
    scene = seen_from((-half, 0, 0), (half, 0, 0))
    parts = [Part("terrain", *wall(1000.0), Diffuse())]
    assert any("single precision" in warning for warning in check_scene(scene, parts)) == warns


@pytest.mark.parametrize(
    ("where", "key"),
    [
        ({"trajectory": {"poses": [{"position": (0, 1.1e9, 0)}]}}, "position"),
        ({"trajectory": {"waypoints": [{"position": (0, 0, 0), "look_at": (0, 1e200, 0)}]}}, "look_at"),
        ({"vehicle": {"cameras": [{"position": (1e300, 0, 0)}]}}, "position"),
        ({"vehicle": {"lights": [{"kind": "point", "position": (0, -1e300, 0)}]}}, "position"),
        ({"vehicle": {"imu": {"position": (1e300, 0, 0)}}}, "position"),
        ({"objects": [{"kind": "bolt", "size": "M24", "position": (1e300, 0, 0)}]}, "position"),
        ({"surface_depth_m": 1e300}, "surface_depth_m"),
    ],
)
def test_coordinates_of_more_than_a_million_kilometres_are_refused(where, key):
    with pytest.raises(InputError) as caught:
        scene_from_dict({"trajectory": {"poses": [{"position": (0, 0, 0)}]}} | where)
    assert key in caught.value.key
    assert "1e+09" in caught.value.remedy


def test_a_course_a_million_kilometres_away_is_driven_to_the_micrometre():
    def positions(offset):
        stops = [{"position": (offset, 0.0, 0.0)}, {"position": (offset, 1.0, 0.0)}]
        return simulate(scene_from_dict({"trajectory": {"waypoints": stops}})).trajectory.position - [offset, 0.0, 0.0]

    assert np.abs(positions(1e9) - positions(0.0)).max() <= np.spacing(1e9)


# ------------------------------------------------------------------------------------------------------------- attitude


@pytest.mark.parametrize("reach", [1e-300, 1e-200, 1e-9, 1.0, 1e9])
@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 1.0, -0.5)])
def test_a_direction_to_look_in_does_not_depend_on_its_length(reach, direction):
    R = look_at_matrix((0.0, 0.0, 0.0), reach * np.array(direction))
    np.testing.assert_allclose(R, look_at_matrix((0.0, 0.0, 0.0), direction), atol=1e-15)
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-15)


@pytest.mark.parametrize("off", [1e-3, 1e-8, 1e-10, 0.0])
def test_looking_almost_straight_down_is_an_attitude_whatever_is_left_of_the_heading(off):
    R = look_at_matrix((0.0, 0.0, 0.0), (off, 0.0, -1.0))
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(R[:, 1], np.array([off, 0.0, -1.0]) / np.hypot(off, 1.0), atol=1e-15)
    assert abs(R[2, 0]) < 1e-9  # x stays horizontal


@pytest.mark.parametrize("turns", [0, 1, -2, 2777])
def test_whole_turns_change_nothing_but_the_rounding_of_the_angle(turns):
    angles = np.array([10.0, 20.0, 30.0])
    attitude, expected = (Rotation.from_euler("xyz", a, degrees=True) for a in (angles + 360.0 * turns, angles))
    assert (expected.inv() * attitude).magnitude() < 4 * np.radians(np.spacing(360.0 * max(1, abs(turns))))


def test_angles_of_which_no_digit_counts_are_refused():
    def turned(angle):
        return {"trajectory": {"waypoints": [{"position": (0, 0, 0), "rotation_euler_deg": (angle, 0, 0)}]}}

    scene_from_dict(turned(1e6))
    with pytest.raises(InputError, match="rotation_euler_deg"):
        scene_from_dict(turned(1.001e6))


# -------------------------------------------------------------------------------------------------- meshes of any size


@pytest.mark.parametrize("scale", [1e-9, 1e-6, 1.0, 1e6, 1e8])
def test_depth_is_as_exact_at_any_scale(scale):
    assert depth_error(seen_from((0, 0, 0)), np.zeros(3), scale=scale) < 16 * 2.0**-24 * 3.0 * scale


@pytest.mark.parametrize(("scale", "works"), [(1e-12, False), (1e-8, True), (1e7, True), (1e10, False), (1e300, False)])
def test_objects_of_sizes_that_rays_cannot_resolve_are_refused(tmp_path, scale, works):
    (tmp_path / "wall.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    scene = scene_from_dict(
        {"trajectory": {"poses": [{"position": (0, 0, 0)}]}, "objects": [{"file": "wall.obj", "scale": scale}]},
        tmp_path,
    )
    if works:
        assert np.ptp(build_parts(scene)[0].vertices, axis=0).max() == pytest.approx(scale)
        return
    with pytest.raises(InputError) as caught:
        build_parts(scene)
    assert caught.value.key == "objects.0"
    assert "scale" in caught.value.remedy


def test_a_block_of_an_object_takes_any_positive_scale_and_the_mesh_decides(tmp_path):
    assert MeshObject(file="x.obj", scale=1e-300).scale == 1e-300
    with pytest.raises(ValidationError):
        MeshObject(file="x.obj", scale=0.0)


# -------------------------------------------------------------------------------------------------------------- cameras


@pytest.mark.parametrize("focal", [1e-3, 3.4, 1e3, 1e6])
def test_depth_is_the_plane_at_any_focal_length(focal):
    scene = seen_from((0, 0, 0), camera={"focal_mm": focal})
    width = max(20.0, 30.0 / focal)  # somewhat wider than the view
    vertices = np.array([[-width, 3, -width], [width, 3, -width], [width, 3, width], [-width, 3, width]])
    renderer = FrameRenderer(scene, "cpu", [Part("terrain", vertices, wall()[1], Diffuse())])
    depth = renderer.render(np.eye(4), outputs="D").D.depth
    # z = t cos, and the view sees a triangle from its foot to its end: some roundings of each
    np.testing.assert_allclose(depth, 3.0, rtol=64 * 2.0**-24)


@pytest.mark.parametrize(
    ("key", "good", "bad"),
    [
        ("focal_mm", 1e-3, 1e-4),
        ("focal_mm", 1e6, 1e7),
        ("f_stop", 0.0, -1.0),
        ("f_stop", 1e-3, 1e-4),
        ("f_stop", 1e6, 1e7),
        ("focus_m", 1e-3, 1e-4),
        ("focus_m", 1e9, 1e10),
    ],
)
def test_lenses_that_single_precision_cannot_hold_are_refused(key, good, bad):
    seen_from((0, 0, 0), camera={key: good})
    with pytest.raises(InputError, match=key):
        seen_from((0, 0, 0), camera={key: bad})


def test_a_principal_point_of_its_own_is_no_key_of_a_camera():
    with pytest.raises(InputError, match="unknown key"):
        seen_from((0, 0, 0), camera={"principal_point": (-100.0, 0.0)})


# -------------------------------------------------------------------------------------------------------------- depth D


@pytest.mark.parametrize("end", [1e-3, 25.0, 1e6])
def test_depth_keeps_half_a_step_up_to_the_end_of_its_range_and_is_infinite_beyond(end):
    step = end / 65535
    depth = np.array([[0.0, 0.3 * end, end - 0.51 * step, end - 0.49 * step, end, 1.01 * end, np.inf]])
    back = decode_depth(encode_depth(depth, (0.0, end)), (0.0, end))[0]
    assert np.abs(back[:3] - depth[0, :3]).max() <= 0.5 * step * (1 + 1e-6) + np.spacing(np.float32(end))
    assert np.isinf(back[3:]).all()
