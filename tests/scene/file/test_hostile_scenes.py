"""Scene files from elsewhere: one message, at once, and never a traceback."""

import os
import sys

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from varos_warp.cli import app
from varos_warp.errors import InputError
from varos_warp.scene.file.load import load_scene
from varos_warp.scene.geometry.mesh_files import load_mesh
from varos_warp.scene.materials.textures import read_image

BASE = "trajectory: {poses: [{position: [0, 0, 0]}]}\n"
LAUGHS = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{new}: &{new} [{', '.join([f'*{old}'] * 9)}]\n" for old, new in zip("abcdefgh", "bcdefghi", strict=True)
)


@pytest.mark.parametrize(
    "text",
    [
        LAUGHS,
        "name: !!bool x",
        "seed: !!int ''",
        "name: !!timestamp x",
        "name: !!python/object:os.x {}",
        "? [1, 2]\n: 3",
        'name: "\\ud800"',
        'name: "\\0"',
        f"name: {'[' * 100_000}",
        f"name: {'9' * 5000}",
        "name: !!set {x}",
        "seed: 1e400",
        "materials: &m {*m : 1}",
        "<<: &x {a: *x}",
    ],
    ids=lambda text: text[:24],
)
def test_yaml_that_explodes_or_makes_more_than_values_is_refused(tmp_path, text):
    (tmp_path / "scene.yaml").write_text(text)
    result = CliRunner().invoke(app, ["info", str(tmp_path / "scene.yaml")])
    assert result.exit_code == 2, result.exception
    assert "scene.yaml" in result.output


@pytest.mark.parametrize("value", ['"\\ud800"', "!!bool x", "{[1]: 2}", "&a [*a]"])
def test_values_of_options_are_held_to_the_same(tmp_path, value):
    (tmp_path / "scene.yaml").write_text(BASE)
    with pytest.raises(InputError, match="--set name="):
        load_scene(tmp_path / "scene.yaml", [f"name={value}"])


def test_a_file_larger_than_the_limit_is_refused_unread(tmp_path, monkeypatch):
    (tmp_path / "scene.yaml").write_text(BASE)
    monkeypatch.setenv("VAROS_WARP_MAX_TEXT_BYTES", "10")
    with pytest.raises(InputError, match="more than the limit of 10"):
        load_scene(tmp_path / "scene.yaml")


@pytest.mark.skipif(sys.platform == "win32", reason="pipes, devices and symbolic links")
@pytest.mark.parametrize("name", ["/dev/zero", "fifo.ply", "loop.ply", "x" * 300 + ".ply", "~nobody/x.ply", "/", ""])
@pytest.mark.parametrize("key", ["objects: [{{file: '{}'}}]", "terrain: {{file: '{}'}}"])
@pytest.mark.parametrize("verb", ["info", "run"])
def test_paths_at_which_there_is_no_file_are_refused(tmp_path, name, key, verb):
    os.mkfifo(tmp_path / "fifo.ply")
    (tmp_path / "loop.ply").symlink_to(tmp_path / "loop.ply")
    (tmp_path / "scene.yaml").write_text(BASE + key.format(name))
    out = ["-o", str(tmp_path / "out")] if verb == "run" else []
    result = CliRunner().invoke(app, [verb, str(tmp_path / "scene.yaml"), *out])
    assert result.exit_code == 2, result.exception
    assert "there is no such" in result.output or "unknown mesh format" in result.output


@pytest.mark.parametrize(
    "override",
    [
        "vehicle.mass_kg=5e-324",
        "vehicle.mass_kg=1e30",
        "vehicle.cameras=[{shutter: {exposure_s: 5e-324}}]",
        "render.frame_rate_hz=1e-300",
        "trajectory.duration_s=1e12",
        "vehicle.cameras=[{resolution: [1000000000000, 2]}]",
        "gravity=1e300",
        "trajectory.speed=5e-324",
        "water={principled: {density: 1e308, color: [1, 1, 1], absorption_color: [0, 0, 0]}}",
        "current={velocity: [1e300, 0, 0]}",
        "vehicle.net_buoyancy=-1e308",
        "surface_depth_m=1e999",
        "trajectory={waypoints: [{position: [0, 0, 0]}, {position: [1e9, 1e9, 0]}]}",
    ],
    ids=str,
)
def test_numbers_of_no_vehicle_camera_or_water_are_refused(tmp_path, override):
    (tmp_path / "scene.yaml").write_text("trajectory: {waypoints: [{position: [0, 0, 0]}, {position: [0, 1, 0]}]}\n")
    result = CliRunner().invoke(app, ["info", str(tmp_path / "scene.yaml"), "--set", override])
    assert result.exit_code == 2, result.exception


def test_an_image_with_more_pixels_than_the_limit_is_refused_before_it_is_unpacked(tmp_path):
    """A small file: nothing compresses like one colour."""
    Image.fromarray(np.zeros((13000, 13000), bool)).save(tmp_path / "x.png")
    with pytest.raises(InputError, match="169000000 texture pixels are more than the limit"):
        read_image(tmp_path / "x.png")


NODE = '<node id="n{0}"><instance_node url="#n{1}"/><instance_node url="#n{1}"/></node>'


def nested(depth: int) -> str:
    """A DAE of one triangle in 2^depth places."""
    nodes = "".join(NODE.format(i, i - 1) for i in range(1, depth + 1))
    return f"""<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><up_axis>Z_UP</up_axis></asset><library_geometries><geometry id="g"><mesh><source id="p"><float_array id="pa"
count="9">0 0 0 1 0 0 0 1 0</float_array><technique_common><accessor source="#pa" count="3" stride="3"><param name="X"
type="float"/><param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices><triangles count="1"><input semantic="VERTEX"
source="#v" offset="0"/><p>0 1 2</p></triangles></mesh></geometry></library_geometries><library_nodes><node id="n0">
<instance_geometry url="#g"/></node>{nodes}</library_nodes><library_visual_scenes><visual_scene id="s"><node>
<instance_node url="#n{depth}"/></node></visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/>
</scene></COLLADA>"""


def test_copies_of_copies_count_as_triangles(tmp_path, monkeypatch):
    (tmp_path / "x.dae").write_text(nested(3))
    monkeypatch.setenv("VAROS_WARP_MAX_TRIANGLES", "8")
    load_mesh(tmp_path / "x.dae")
    (tmp_path / "x.dae").write_text(nested(60))
    with pytest.raises(InputError, match="triangles are more than the limit of 8"):
        load_mesh(tmp_path / "x.dae")
    monkeypatch.delenv("VAROS_WARP_MAX_TRIANGLES")
    (tmp_path / "x.dae").write_text(nested(60).replace('<instance_geometry url="#g"/>', ""))
    with pytest.raises(InputError, match="copies are more than the limit of 100000"):
        load_mesh(tmp_path / "x.dae")


def test_a_header_that_promises_more_than_the_file_holds_is_refused(tmp_path):
    (tmp_path / "x.ply").write_bytes(
        b"ply\nformat binary_little_endian 1.0\nelement vertex 1000000000000\n"
        b"property float x\nproperty float y\nproperty float z\nend_header\n"
    )
    (tmp_path / "x.stl").write_bytes(b"\0" * 80 + (2**32 - 1).to_bytes(4, "little") + b"\0" * 50)
    for name in ("x.ply", "x.stl"):
        with pytest.raises(InputError):
            load_mesh(tmp_path / name)
