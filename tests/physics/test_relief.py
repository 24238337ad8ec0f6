"""Surfaces with relief in images: D and C are those of their triangles, and no light is lost on them."""

from dataclasses import replace

import numpy as np
import pytest
from physics.rig import Z

from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.frames import camera_pose, intrinsics
from varos_warp.scene.geometry.build import build_parts

pytestmark = pytest.mark.subject("surfaces and lights")
CAMERA = {
    "id": "M0",
    "resolution": [96, 54],
    "sensor_mm": [4.8, 2.7],
    "focal_mm": 4.0,
    "rotation_euler_deg": [-25, 0, 0],
}
AT = np.eye(4)
AT[2, 3] = 1.1


@pytest.fixture(scope="module")
def scene():
    return scene_from_dict(
        {
            "terrain": {
                "kind": "procedural",
                "size_m": 8,
                "resolution": 21,
                "relief_m": 0.2,
                "material": "sand",
                "around_objects": True,
            },
            "objects": [
                {"kind": "boulder", "form": "joints", "diameter": 0.9, "position": [0.2, 2, 0.1], "material": "rock"},
                {
                    "kind": "pipe",
                    "radius": 0.15,
                    "length": 2,
                    "position": [0, 2.6, 0.35],
                    "rotation_euler_deg": [0, 90, 0],
                    "material": "steel",
                },
                {
                    "kind": "pipe_support",
                    "radius": 0.15,
                    "height": 0.5,
                    "position": [-0.8, 2.6, 0.35],
                    "rotation_euler_deg": [0, 0, 90],
                    "material": "concrete",
                },
            ],
            "materials": {kind: {"kind": "layered", "relief": kind} for kind in ("sand", "rock", "steel", "concrete")},
            "vehicle": {"cameras": [CAMERA]},
            "trajectory": {"poses": [{"position": [0, 0, 1.1]}]},
        }
    )


@pytest.fixture(scope="module")
def parts(scene):
    return build_parts(scene)


def first_hits(triangles, origin, direction):
    """Distance to the first of the triangles [F, 3, 3] and its number, in float64 (Moeller and Trumbore 1997)."""
    a, ab, ac = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    p = np.cross(direction, ac)
    determinant = np.einsum("ij,ij->i", ab, p)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = origin - a
        u = np.einsum("ij,ij->i", s, p) / determinant
        q = np.cross(s, ab)
        v, t = q @ direction / determinant, np.einsum("ij,ij->i", ac, q) / determinant
    t = np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0), t, np.inf)
    return t.min(), int(t.argmin()), u[t.argmin()], v[t.argmin()]


def test_d_and_c_are_those_of_the_triangles(scene, parts, truth):
    """Of 60 pixels, by an independent caster in float64: to 1e-5 m, and the normals of its corners between them."""
    seen = FrameRenderer(scene, "cpu", parts=parts).render(AT, outputs="CD")
    camera = scene.vehicle.cameras[0]
    T_w_c, K = camera_pose(camera, AT), intrinsics(camera)
    triangles = np.concatenate([part.vertices[part.faces] for part in parts])
    normals = np.concatenate([part.normals for part in parts])
    rng = np.random.default_rng(0)
    rows, cols = np.nonzero(np.isfinite(seen.D.depth))
    chosen = rng.choice(len(rows), 60, replace=False)
    off, turned = [], []
    for row, col in zip(rows[chosen], cols[chosen], strict=True):
        direction = T_w_c[:3, :3] @ np.linalg.solve(K, [col + 0.5, row + 0.5, 1.0])
        depth, face, u, v = first_hits(triangles, T_w_c[:3, 3], direction)
        off.append(depth - seen.D.depth[row, col])
        normal = normals[face].T @ [1.0 - u - v, u, v]
        turned.append(np.linalg.norm(normal / np.linalg.norm(normal) - seen.C.normal[row, col]))
    truth(
        "planar depth of displaced triangles [m]",
        source="Moeller and Trumbore in float64",
        expected=0.0,
        got=off,
        tolerance=1e-5,
        reason="rays in float32, 3 m away",
    )
    assert np.median(turned) < 1e-4


def test_white_surfaces_with_relief_vanish_in_uniform_light(scene, parts, truth):
    """Every form and layer with reflectance 1: the mean of the image is 1, to 1e-3."""
    white = [replace(part, skin=replace(part.skin, corners=np.ones_like(part.skin.corners))) for part in parts]
    image = FrameRenderer(scene, "cpu", parts=white).render(AT, outputs="B", spp_b=64, denoise_b="none").B
    error = image.radiance[..., 0].astype(float) - 1.0
    stderr = np.sqrt(np.square(image.stderr[..., 0].astype(float)).sum()) / error.size
    truth(
        "mean of B, reflectance 1 on rock, sand, steel and concrete with relief",
        source="furnace: radiance 1",
        expected=1.0,
        got=1.0 + error.mean(),
        stderr=stderr,
    )
    assert abs(error.mean()) < 1e-3
    assert Z * stderr < 2e-3
