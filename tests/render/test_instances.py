"""Copies of a mesh: traced as instances they are what they are as meshes of their own."""

from dataclasses import replace

import numpy as np
import pytest
from chance import assert_plausible, two_sided
from scipy.ndimage import binary_erosion
from scipy.spatial.transform import Rotation

from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene import device
from varos_warp.scene.description.world import Diffuse, Nut, Rust
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.frames import camera_pose, intrinsics
from varos_warp.scene.geometry.assets import make_asset
from varos_warp.scene.geometry.parts import Instances, Part

SCENE = {
    "water": {"coefficients": {"sigma_s": [0.01, 0.02, 0.04], "sigma_a": [0.1, 0.04, 0.0], "phase": {"g": 0.6}}},
    "vehicle": {
        "lights": [{"kind": "point", "position": [0.3, 0, 0.2], "intensity": [4, 4, 4]}],
        "cameras": [{"id": "M0", "resolution": [64, 48], "rotation_euler_deg": [-35, 0, 0]}],
    },
    "render": {"frame_rate_hz": 10, "integrator": "path"},
    "trajectory": {"poses": [{"position": [0, 0, 0]}]},
}
POSE = np.array([[1, 0, 0, 0], [0, 1, 0, -1.2], [0, 0, 1, 1.0], [0, 0, 0, 1]], float)


def nuts(count=60):
    """Large nuts of all sizes and attitudes, strewn over a square of 2 m."""
    rng = np.random.default_rng(4)
    T = np.tile(np.eye(4), (count, 1, 1))
    T[:, :3, :3] = Rotation.random(count, random_state=4).as_matrix() * rng.uniform(2, 6, (count, 1, 1))
    T[:, :3, 3] = np.column_stack([rng.uniform(-1, 1, (count, 2)), rng.uniform(0.0, 0.3, count)])
    mesh = make_asset(Nut(kind="nut", size="M24"))
    return Instances("scatter.0", *mesh, Diffuse(reflectance=(0.7, 0.4, 0.2)), T, smooth_shading=True)


def ground():
    corners = np.array([[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]], float)
    return Part("terrain", corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), Diffuse(reflectance=(0.4, 0.4, 0.4)))


def render(parts, outputs="ABCDS", **how):
    return FrameRenderer(scene_from_dict(SCENE), "cpu", parts=parts).render(POSE, outputs=outputs, **how)


@pytest.fixture(scope="module")
def pair():
    copies = nuts()
    return [render(parts, spp=40, spp_b=24) for parts in ([ground(), copies], [ground(), *copies.parts()])]


def test_depth_normals_and_numbers_are_those_of_separate_meshes(pair):
    """To the rounding of float32, but for a pixel on an edge."""
    instanced, separate = pair
    assert len(np.unique(instanced.S.instance)) > 30
    same = instanced.S.instance == separate.S.instance
    assert same.mean() > 0.999
    hit = same & np.isfinite(separate.D.depth)
    np.testing.assert_allclose(instanced.D.depth[hit], separate.D.depth[hit], rtol=1e-5)
    # barycentric weights are known to rounding over the size of a bevel, 1e-4 m
    np.testing.assert_allclose(instanced.C.normal[hit], separate.C.normal[hit], atol=5e-3)


def test_copies_that_join_the_mesh_are_those_of_separate_meshes(monkeypatch, pair):
    """What a GPU does, on the CPU."""
    monkeypatch.setitem(device.MOST_JOINED_FACES, "cpu", 1 << 24)
    joined = render([ground(), nuts()], spp=4, spp_b=4)
    separate = render([ground(), *nuts().parts()], spp=4, spp_b=4)
    for name in ("instance", "material"):
        assert np.array_equal(getattr(joined.S, name), getattr(separate.S, name))
    assert np.array_equal(joined.D.depth, separate.D.depth)
    np.testing.assert_allclose(joined.C.normal, separate.C.normal, atol=1e-6)  # turned, or made from turned corners
    np.testing.assert_allclose(joined.A.radiance, separate.A.radiance, rtol=1e-3, atol=1e-4 * joined.A.radiance.mean())


def test_a_joined_copy_has_the_pattern_of_an_instance(monkeypatch):
    """Rust is laid by the box of a copy, in both."""
    copies = replace(nuts(8), material=Rust(kind="rust", amount=0.5))
    alone = render([copies], "BS", spp_b=16)
    monkeypatch.setitem(device.MOST_JOINED_FACES, "cpu", 1 << 24)
    joined = render([copies], "BS", spp_b=16)
    same = binary_erosion(alone.S.instance == joined.S.instance, iterations=2)
    np.testing.assert_allclose(joined.B.radiance[same], alone.B.radiance[same], atol=2e-3)


@pytest.mark.parametrize("letter", ["A", "B"])
def test_radiance_is_that_of_separate_meshes(pair, letter):
    """Shadows, interreflection and scattered light: means over the image and over its quarters."""
    one, other = (getattr(frame, letter) for frame in pair)
    difference = (one.radiance - other.radiance).astype(float)
    variance = one.stderr.astype(float) ** 2 + other.stderr.astype(float) ** 2
    scores = [
        difference[rows, columns].sum((0, 1)) / np.sqrt(variance[rows, columns].sum((0, 1)))
        for rows in (slice(0, 24), slice(24, 48))
        for columns in (slice(0, 32), slice(32, 64))
    ]
    assert_plausible(two_sided(np.array(scores)))
    assert np.all(variance.sum((0, 1)) ** 0.5 < 0.01 * other.radiance.sum((0, 1)))


def test_a_copy_throws_a_shadow():
    """A plate in the air, as an instance: direct light is missing exactly where the plate hides the lamp."""
    half, height, lamp = 0.3, 0.5, POSE[:3, 3] + (0.3, 0, 0.2)
    corners = half * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
    T = np.eye(4)
    T[:3, 3] = 0.1, -0.5, height
    plate = Instances("scatter.0", corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), Diffuse(), T[None])
    frame = render([ground(), plate], "ADS", spp=4)
    camera = scene_from_dict(SCENE).vehicle.cameras[0]
    T_w_c, (u, v) = camera_pose(camera, POSE), np.meshgrid(np.arange(64) + 0.5, np.arange(48) + 0.5)
    rays = np.stack([u, v, np.ones_like(u)], -1) @ np.linalg.inv(intrinsics(camera)).T
    on_ground = binary_erosion(frame.S.instance == 1, np.ones((3, 3)))  # pixels that the plate's edge does not reach
    p = (frame.D.depth[on_ground][:, None] * rays[on_ground]) @ T_w_c[:3, :3].T + T_w_c[:3, 3]
    crossing = p + (height / lamp[2]) * (lamp - p) - T[:3, 3]
    reach = np.abs(crossing[:, :2]).max(axis=1)
    clear = np.abs(reach - half) > 0.06  # a pixel is up to that long there
    dark = (frame.A.layers["direct"][on_ground] == 0.0).all(axis=1)
    assert dark.sum() > 50
    assert np.array_equal(dark[clear], reach[clear] < half)


def test_copies_alone_and_far_from_the_origin():
    """No mesh stands there once; coordinates of 1e6 m move with the local origin."""
    away = np.array([1e6, -2e6, 0.0])
    copies = nuts(20)
    far = replace(copies, T_w_o=copies.T_w_o + np.pad(away[:, None], ((0, 1), (3, 0)))[None])
    pose = POSE.copy()
    pose[:3, 3] += away
    scene = scene_from_dict(SCENE | {"trajectory": {"poses": [{"position": [1e6, -2e6, 0]}]}})
    near_depth = render([copies], "D").D.depth
    far_depth = FrameRenderer(scene, "cpu", parts=[far]).render(pose, outputs="D").D.depth
    hit = np.isfinite(near_depth) & np.isfinite(far_depth)
    assert hit.sum() > 200
    assert (np.isfinite(near_depth) == np.isfinite(far_depth)).mean() > 0.999
    np.testing.assert_allclose(far_depth[hit], near_depth[hit], rtol=1e-5, atol=1e-5)


@pytest.mark.gpu
@pytest.mark.parametrize("letter", ["A", "B"])
def test_a_gpu_agrees_on_copies_textures_and_metal(letter):
    """Means over 4 x 4 parts of the image, within the standard errors of both."""
    materials = {"floor": {"kind": "slope_blend", "flat": {"texture": "sand", "size_m": 0.5}}}
    scene = scene_from_dict(SCENE | {"terrain": {"kind": "procedural", "material": "floor"}, "materials": materials})
    copies = replace(nuts(), material=Rust(kind="rust", amount=0.4, roughness=0.4))
    parts = [replace(ground(), material=scene.materials["floor"]), copies]
    how = {"outputs": letter, "spp": 256, "spp_b": 256}
    frames = [
        FrameRenderer(scene, device, parts=parts).render(POSE, seed=seed, **how)
        for seed, device in enumerate(("cpu", "cuda:0"))
    ]
    images = [getattr(frame, letter) for frame in frames]
    difference = (images[1].radiance - images[0].radiance).astype(float).reshape(4, 12, 4, 16, 3).sum((1, 3))
    variance = sum(image.stderr.astype(float) ** 2 for image in images).reshape(4, 12, 4, 16, 3).sum((1, 3))
    assert_plausible(two_sided(difference / np.sqrt(variance)))
    assert np.all(np.sqrt(variance.sum((0, 1))) < 0.005 * images[0].radiance.sum((0, 1)))
