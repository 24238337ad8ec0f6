"""Sizes, shapes and numbers of triangles at their ends: what rays still see right, and what is refused in time."""

import numpy as np
import pytest

from varos_warp.errors import InputError
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.geometry import terrain
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.geometry.mesh_files import load_mesh
from varos_warp.scene.geometry.parts import Part
from varos_warp.scene.geometry.procedural import generate_terrain

TILT = 0.3
SHEET = generate_terrain(20.0, 17, 2.0, seed=3)


def scene(camera=None, **blocks):
    return scene_from_dict(
        {
            "trajectory": {"poses": [{"position": (0, 0, 0)}]},
            "vehicle": {"cameras": [{"resolution": (32, 18)} | (camera or {})]},
            **blocks,
        }
    )


def depths(vertices, faces, camera=None):
    """D of a mesh, from the origin."""
    parts = [Part("terrain", np.asarray(vertices, float), np.asarray(faces, np.int32), Diffuse())]
    return FrameRenderer(scene(camera), "cpu", parts).render(np.eye(4), outputs="D").D.depth


def on_the_wall(x, z):
    """Points of the wall y = 3 + TILT x."""
    return np.column_stack([x, 3.0 + TILT * np.asarray(x), z])


def truth(focal=3.4):
    slope = (np.arange(32) + 0.5 - 16.0) / (focal / 4.416 * 32)
    return np.tile(3.0 / (1.0 - TILT * slope), (18, 1))


# ------------------------------------------------------------------------------------------------------ odd triangles


@pytest.mark.parametrize("size", [10.0, 1e3, 1e5])
def test_the_depth_of_a_large_triangle_loses_digits_with_its_size(size):
    x, z = size * np.array([-1.0, 1.0, 1.0, -1.0]), size * np.array([-1.0, -1.0, 1.0, 1.0])
    error = np.abs(depths(on_the_wall(x, z), [[0, 1, 2], [0, 2, 3]]) - truth()).max()
    assert error < 4 * 2.0**-24 * max(size, 3.0)


@pytest.mark.parametrize("aspect", [1e1, 1e3, 1e5])
def test_needles_are_hit_where_they_are(aspect):
    """A fan of triangles 20 m long and 20 m / aspect wide fills the view of a lens that sees a fourth of one."""
    width = 20.0 / aspect
    focal = 3.4 if aspect < 100 else 3.0 * 4.416 / (0.25 * width)
    x = np.arange(-4, 5) * width + 0.371 * width
    vertices = on_the_wall(np.repeat(x, 2), np.tile([-10.0, 10.0], len(x)))
    low = 2 * np.arange(len(x) - 1)
    faces = np.concatenate([np.stack([low, low + 2, low + 3], -1), np.stack([low, low + 3, low + 1], -1)])
    depth = depths(vertices, faces, {"focal_mm": focal} if aspect >= 100 else {"focal_mm": 200.0})
    np.testing.assert_allclose(depth, truth(focal if aspect >= 100 else 200.0), atol=40 * 2.0**-24)


@pytest.mark.parametrize("fault", ["twice", "from both sides", "without area", "on one line"])
def test_faces_that_repeat_or_have_no_area_change_no_depth(fault):
    vertices = on_the_wall(np.array([-20.0, 20.0, 20.0, -20.0]), np.array([-20.0, -20.0, 20.0, 20.0]))
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    more = {
        "twice": faces,
        "from both sides": faces[:, ::-1],
        "without area": faces[:, [0, 1, 1]],
        "on one line": np.array([[0, 4, 2]]),
    }[fault]
    vertices = np.vstack([vertices, 0.5 * (vertices[0] + vertices[2])])
    # the same surface, by another triangle: the rounding of its corners, 20 m away
    np.testing.assert_allclose(
        depths(vertices, np.concatenate([faces, more])), depths(vertices, faces), atol=20 * 2.0**-24
    )


def test_one_triangle_is_a_world():
    depth = depths(on_the_wall([-50.0, 50.0, 0.0], [-50.0, -50.0, 80.0]), [[0, 1, 2]])
    np.testing.assert_allclose(depth, truth(), atol=80 * 2.0**-24)


def test_a_vertex_in_the_camera_is_no_depth_of_nan():
    depth = depths([[0.0, 0.0, 0.0], [1.0, 3.0, 1.0], [-1.0, 3.0, 1.0]], [[0, 1, 2]])
    assert not np.isnan(depth).any()


# ----------------------------------------------------------------------------------------------------------- refusals


@pytest.mark.parametrize(
    "block",
    [
        {"kind": "pipe", "radius": 1e-300, "length": 1.0},
        {"kind": "pipe", "radius": 0.1, "length": 1e-300},
        {"kind": "flange", "radius": 1e6},
        {"kind": "valve", "radius": 1e300},
        {"kind": "pipe_support", "radius": 1e-300},
        {"kind": "elbow", "radius": 1e300, "bend_radius": 2e300},
        {"kind": "boulder", "diameter": 1e300},
        {"kind": "elbow", "radius": 0.1, "bend_radius": 0.4, "angle_deg": 1e-12},
        {"kind": "bolt", "size": "M24", "length": 1e-300},
        {"kind": "pipe", "radius": 0.1, "length": 1, "wall": 1e-300},
        {"kind": "pipe", "radius": 0.1, "length": 1, "chord_error_m": 1e-300},
    ],
)
def test_measures_that_nothing_is_made_of_are_refused(block):
    with pytest.raises(InputError) as caught:
        scene(objects=[block])
    assert caught.value.key.startswith("objects.0.")
    assert caught.value.remedy


@pytest.mark.parametrize(
    "block",
    [
        {"kind": "valve", "radius": 1e-4},
        {"kind": "flange", "radius": 100.0},
        {"kind": "pipe", "radius": 1e-4, "length": 100.0},
        {"kind": "boulder", "diameter": 1e-4},
        {"kind": "pipe", "radius": 100.0, "length": 1e-4, "chord_error_m": 1e-6},
        {"kind": "elbow", "radius": 0.1, "bend_radius": 0.4, "angle_deg": 0.1},
        {"kind": "bolt", "size": "M64", "length": 100.0},
    ],
)
def test_the_smallest_and_largest_measures_make_sound_objects(block):
    (part,) = build_parts(scene(objects=[block]))
    assert np.isfinite(part.vertices).all()
    assert len(part.faces) < 4e6


@pytest.mark.parametrize("scale", [1e-9, 1e-6, 1.0, 1e6])
def test_a_terrain_of_any_unit_is_repaired_when_its_tolerance_has_the_same(scale):
    vertices, faces = terrain.preprocess(
        SHEET[0] * scale, SHEET[1], merge_tolerance_m=1e-3 * scale, shrinkwrap_resolution=17
    )
    np.testing.assert_allclose(np.ptp(vertices[:, :2], axis=0), 20.0 * scale, rtol=1e-6)
    assert len(faces) >= len(SHEET[1])


def test_a_tolerance_larger_than_the_terrain_is_refused():
    with pytest.raises(InputError, match="merge_tolerance_m"):
        terrain.preprocess(SHEET[0] * 1e-6, SHEET[1], merge_tolerance_m=0.001)


def test_coordinates_that_overflow_are_dropped_from_a_terrain_and_refused_in_an_object(tmp_path):
    vertices = SHEET[0].copy()
    vertices[5] = 1e300
    result, _ = terrain.preprocess(vertices, SHEET[1])
    assert np.abs(result).max() < 20.0
    (tmp_path / "far.obj").write_text("v 0 0 0\nv 1e300 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(InputError, match="vertices"):
        load_mesh(tmp_path / "far.obj")


def test_a_shrinkwrap_of_more_vertices_than_memory_is_refused():
    with pytest.raises(InputError, match="shrinkwrap_resolution"):
        scene(terrain={"file": "x.ply", "preprocess": {"shrinkwrap_resolution": 10_001}})
