"""A scene at UTM coordinates gives the depth and the normals of the same scene at the origin, whatever its terrain.

Heights, spacings and offsets are sums of few powers of two, so that both scenes have the same numbers to begin with.
"""

import numpy as np
import pytest
import surveys
import trimesh
from typer.testing import CliRunner

from varos_warp.cli import app
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.frames import pose_matrix
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.geometry.mesh_files import load_mesh, write_ply
from varos_warp.scene.geometry.procedural import grid_mesh

FAR = np.array([surveys.EAST, surveys.NORTH, 0.0])
X, Y = np.arange(0, 6, 0.125), np.arange(0, 4, 0.125)
Z = np.round((-30.0 + 0.3 * np.sin(X) + 0.2 * np.cos(2.0 * Y)[:, None]) * 256.0) / 256.0


def mesh(offset):
    return grid_mesh(X + offset[0], Y + offset[1], Z)


def write_obj(path, offset):
    vertices, faces = mesh(offset)
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()] + [f"f {a} {b} {c}" for a, b, c in faces + 1]
    path.write_text("\n".join(lines))


def write_tif(path, offset):
    corner = (offset[0] - 0.0625, offset[1] + Y[-1] + 0.0625)
    surveys.write_geotiff(path, Z[::-1], corner=corner, step=0.125)


def write_xyz(path, offset):
    surveys.write_text(path, mesh(offset)[0])


WRITERS = {
    "ply": lambda path, offset: write_ply(path, *mesh(offset)),
    "obj": write_obj,
    "tif": write_tif,
    "xyz": write_xyz,
}


def scene(folder, offset, terrain, **blocks):
    """The floor from 2.5 m above it, from the south."""
    camera = {"id": "M0", "resolution": [48, 27], "sensor_mm": [4.416, 2.484], "focal_mm": 3.4}
    pose = {"position": [3.0 + offset[0], 0.5 + offset[1], -27.5], "rotation_euler_deg": [-60, 0, 0]}
    return scene_from_dict(
        {
            "terrain": terrain,
            "vehicle": {"lights": [], "cameras": [camera]},
            "trajectory": {"poses": [pose]},
            "render": {"outputs": ["C", "D"]},
            **blocks,
        },
        folder,
    )


def seen(folder, offset, ending, terrain=None, blocks=None):
    """Depth and normals of the floor that a file of a format makes at an offset."""
    folder = folder / ("far" if offset.any() else "near")
    folder.mkdir()
    WRITERS[ending](folder / f"floor.{ending}", offset)
    made = scene(folder, offset, {"file": f"floor.{ending}", **(terrain or {})}, **(blocks(offset) if blocks else {}))
    frame = FrameRenderer(made, "cpu").render(pose_matrix(made.trajectory.poses[0]), outputs="CD")
    return frame.D.depth.astype(float), frame.C.normal.astype(float)


def assert_alike(one, other):
    """Depths to the rounding of coordinates within 8 m of the local origin, in float32; normals to 0.01 degrees."""
    (depth, normal), (far_depth, far_normal) = one, other
    hit = np.isfinite(depth)
    assert hit.mean() > 0.9
    assert (hit == np.isfinite(far_depth)).all()
    assert np.abs(depth[hit] - far_depth[hit]).max() <= 4 * np.spacing(np.float32(8.0))
    off = np.linalg.norm(np.cross(normal, far_normal), axis=-1)[hit]
    assert np.degrees(np.arcsin(off)).max() < 0.01
    assert ((normal * far_normal).sum(axis=-1)[hit] > 0.0).all()


@pytest.mark.parametrize("ending", WRITERS)
def test_files_of_every_kind_are_read_in_double(tmp_path, ending):
    assert_alike(seen(tmp_path, 0.0 * FAR, ending), seen(tmp_path, FAR, ending))


@pytest.mark.parametrize(
    "terrain",
    [
        {"preprocess": {"merge_tolerance_m": 0.001}},
        {"preprocess": {"target_vertices": 400}},
        {"preprocess": {"shrinkwrap_resolution": 33}},
        {"preprocess": {"shrinkwrap_resolution": 65, "target_vertices": 600}},
        {"preprocess": {"smoothing_rounds": 5}},
        {"detail": {"relief_m": 0.25, "feature_m": 2}},
    ],
    ids=str,
)
def test_steps_of_terrain_work_in_double(tmp_path, terrain):
    assert_alike(*(seen(tmp_path, offset, "ply", terrain) for offset in (0.0 * FAR, FAR)))


def test_a_region_is_cut_out_in_double(tmp_path):
    def terrain(offset):
        region = np.add([1.0, 0.5, 5.0, 3.5], np.tile(offset[:2], 2)).tolist()
        return {"preprocess": {"region": region, "shrinkwrap_resolution": 33, "target_vertices": 300}}

    assert_alike(*(seen(tmp_path, offset, "ply", terrain(offset)) for offset in (0.0 * FAR, FAR)))


def test_copies_stand_on_the_terrain_where_they_stand_at_the_origin(tmp_path):
    def strewn(offset):
        return {
            "scatter": [
                {
                    "object": {"kind": "boulder", "diameter": 0.3, "chord_error_m": 0.02},
                    "count": 12,
                    "circle": [3.0 + offset[0], 2.0 + offset[1], 1.5],
                    "max_tilt_deg": 45,
                }
            ]
        }

    assert_alike(*(seen(tmp_path, offset, "tif", blocks=strewn) for offset in (0.0 * FAR, FAR)))


@pytest.mark.parametrize("ending", ["ply", "tif"])
def test_what_preprocess_writes_is_in_double(tmp_path, ending):
    made = []
    for offset in (0.0 * FAR, FAR):
        WRITERS[ending](tmp_path / f"survey.{ending}", offset)
        arguments = ["preprocess", tmp_path / f"survey.{ending}", "-o", tmp_path / "floor.ply", "--vertices", "300"]
        result = CliRunner().invoke(app, list(map(str, [*arguments, "--device", "cpu", "-q"])))
        assert result.exit_code == 0, result.output
        made.append(load_mesh(tmp_path / "floor.ply")[0])
    assert np.abs(made[1] - FAR - made[0]).max() <= 4 * np.spacing(surveys.NORTH)


def test_a_mesh_in_single_precision_at_utm_coordinates_is_warned_of(tmp_path):
    """What the tutorial of former versions wrote: trimesh exports single precision, and the floor becomes stairs."""
    vertices, faces = grid_mesh(np.arange(0, 6, 0.1) + FAR[0], np.arange(0, 4, 0.1) + FAR[1], np.zeros((40, 60)) - 30.0)
    trimesh.Trimesh(vertices, faces, process=False).export(tmp_path / "floor.ply")
    part = build_parts(scene(tmp_path, FAR, {"file": "floor.ply"}))[0]
    assert "rounded to 0.5 m" in part.doubts[0]
