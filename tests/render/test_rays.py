"""`FrameRenderer.rays` and `project`: the rays that the images follow, and back."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from varos_warp.errors import InputError
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.frames import camera_pose, transform

T_W_V = transform(Rotation.from_rotvec([0.1, -0.2, 0.7]).as_matrix(), [3.0, -2.0, 1.0])
CAMERAS = [
    {"id": "P0", "resolution": [40, 24], "rotation_euler_deg": [-60, 0, 0]},
    {
        "id": "F0",
        "resolution": [40, 24],
        "rotation_euler_deg": [-60, 0, 0],
        "n_water": [1.338, 1.342, 1.347],
        "port": {"kind": "flat", "distance_m": 0.02, "thickness_m": 0.008, "normal": [0.1, 0.0, 1.0]},
        "distortion": {"model": "brown_conrady", "k": [-0.2, 0.05, 0.001, -0.002, 0.0]},
    },
]


@pytest.fixture(scope="module")
def renderer():
    return FrameRenderer(
        scene_from_dict(
            {
                "terrain": {
                    "kind": "procedural",
                    "size_m": 60,
                    "resolution": 3,
                    "relief_m": 0.0,
                    "position": [0, 0, -2],
                },
                "vehicle": {"cameras": CAMERAS},
                "trajectory": {"poses": [{"position": [0, 0, 0]}]},
            }
        ),
        "cpu",
    )


@pytest.mark.parametrize("camera", ["P0", "F0"])
def test_pixels_see_what_their_rays_meet(renderer, camera):
    """D along the ray leads from the origin to the ground."""
    D = renderer.render(T_W_V, camera, "D").D
    rays = renderer.rays(T_W_V, camera)
    assert rays.origin.shape == rays.direction.shape == (24, 40, 3)
    assert rays.weight.shape == (24, 40)
    place = rays.origin + D.range[..., None] * rays.direction
    T_w_c = camera_pose(renderer._camera(camera), T_W_V)
    forward = (place - T_w_c[:3, 3]) @ T_w_c[:3, 2]
    assert np.isfinite(D.depth).all()
    np.testing.assert_allclose(forward, D.depth, atol=3e-6, rtol=0)
    image = renderer.project(place, T_W_V, camera)
    row, col = np.indices((24, 40))
    np.testing.assert_allclose(image, np.stack([col, row], -1) + 0.5, atol=1e-9, rtol=0)


def test_channels_have_rays_of_their_own(renderer):
    red, blue = (renderer.rays(T_W_V, "F0", [2.0, 3.0], channel) for channel in ("red", "blue"))
    normal = camera_pose(renderer._camera("F0"), T_W_V)[:3, :3] @ [0.1, 0.0, 1.0] / np.hypot(0.1, 1.0)
    sine_red, sine_blue = (np.linalg.norm(np.cross(normal, ray.direction)) for ray in (red, blue))
    assert sine_red * 1.338 == pytest.approx(sine_blue * 1.347, rel=1e-12)  # Snell
    point = red.origin + 3.0 * red.direction
    np.testing.assert_allclose(renderer.project(point, T_W_V, "F0", "red"), [2.0, 3.0], atol=1e-9)
    assert np.abs(renderer.project(point, T_W_V, "F0", "blue") - [2.0, 3.0]).max() > 0.01


def test_behind_the_camera_is_nan(renderer):
    T_w_c = camera_pose(renderer._camera("P0"), T_W_V)
    for camera in ("P0", "F0"):
        assert np.isnan(renderer.project(T_w_c[:3, 3] - T_w_c[:3, 2], T_W_V, camera)).all()


def test_unknown_cameras_and_channels_are_named(renderer):
    with pytest.raises(InputError, match="no such camera"):
        renderer.rays(T_W_V, "X0")
    with pytest.raises(InputError, match="red, green, blue"):
        renderer.project([0, 0, 0], T_W_V, channel="cyan")
