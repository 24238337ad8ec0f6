"""Code of the documents works: Python runs, scene files load, and the command line has what it is told."""

import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
import standins
import trimesh
import typer
import yaml
from PIL import Image

import varos_warp as vw
from varos_warp.cli import app
from varos_warp.dataset.run.produce import produce
from varos_warp.scene.description import Scene
from varos_warp.scene.description.noise_profile import NoiseProfile
from varos_warp.scene.description.optics import resized
from varos_warp.scene.description.vehicle import Camera, Vehicle
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.file.schema import find_key
from varos_warp.scene.file.templates import TEMPLATES
from varos_warp.scene.frames import camera_pose, euler_to_matrix
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.plain_yaml import parse

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
CAMERAS = [
    {"id": name, "position": [x, 0, 0], "resolution": [16, 9]} for name, x in (("M0", 0.0), ("L0", -0.1), ("R0", 0.1))
]
SCENE = standins.scene_dict(
    objects=[{"kind": "boulder", "diameter": 1.0, "chord_error_m": 0.1, "position": [0, 3, 0]}],
    materials={"seafloor": {}, "rusty": {"kind": "rust"}},
    trajectory={"waypoints": [{"position": [0, 0, 0]}, {"position": [0, 0.5, 0]}], "duration_s": 2.8},
    render={
        "frame_rate_hz": 4,
        "spp": 2,
        "spp_b": 2,
        "integrator": "path",
        "outputs": ["A", "B", "C", "D", "F"],
        "denoise": "none",
        "denoise_b": "none",
    },
)
SCENE["vehicle"]["cameras"] = CAMERAS
"""Three small cameras before a stone; documents change it by their blocks."""


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def as_parameters(pages) -> list:
    return [pytest.param(page, id=page.relative_to(ROOT).as_posix()) for page in pages]


def pages_with(language: str) -> list:
    return as_parameters(page for page in PAGES if blocks(page, language))


# ------------------------------------------------------------------------------------------------------------ Python


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Files that documents speak of: scenes, a dataset, a mesh, a photograph."""
    place = tmp_path_factory.mktemp("docs")
    for name in ("scene.yaml", "my.yaml", "examples/munkholmen/scene.yaml"):
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).write_text(yaml.safe_dump(SCENE))
    trimesh.creation.icosphere(2).export(place / "survey.ply")
    Image.fromarray(np.random.default_rng(1).integers(0, 255, (24, 32, 3), np.uint8)).save(place / "photo.png")
    produce(scene_from_dict(SCENE), place / "out", device="cpu", quiet=True)
    return place


@pytest.fixture(scope="module")
def names(folder):
    """What documents take for given."""
    scene = scene_from_dict(SCENE)
    frames = vw.simulate(scene).frames
    return {
        "vw": vw,
        "renderer": vw.FrameRenderer(scene, "cpu"),
        "T_w_v": frames.T_w_v(0),
        "T_w_v_next": frames.T_w_v(1),
        "width": 16,
        "height": 9,
        "cos_theta": np.array([0.5]),
        "u": np.array([0.5]),
    }


def runnable(code: str) -> str:
    """Code for a machine without PyTorch."""
    return re.sub(r"^data\.torch\(.*\n", "", code, flags=re.MULTILINE)


@pytest.mark.parametrize("page", pages_with("python"))
def test_python_of_a_page_runs(page, folder, names, monkeypatch):
    """Its blocks one after the other, as a reader would paste them, with a small scene in the place of each."""
    monkeypatch.chdir(folder)
    space = dict(names)
    for code in blocks(page, "python"):
        exec(compile(runnable(code), page.name, "exec"), space)


def test_the_survey_of_the_tutorial_becomes_the_floor_that_it_says(tmp_path, monkeypatch):
    """Its heights by the formula of the page, at the places of the cells, about the origin of its scene."""
    page = ROOT / "docs" / "tutorials" / "terrain.md"
    monkeypatch.chdir(tmp_path)
    exec(compile(next(code for code in blocks(page, "python") if "bathymetry.tif" in code), page.name, "exec"), {})
    terrain = next(block for text in blocks(page, "yaml") if "bathymetry.tif" in str(block := yaml.safe_load(text)))
    del terrain["terrain"]["preprocess"]
    part = build_parts(scene_from_dict(merged(terrain), tmp_path))[0]
    x, y, z = (part.vertices + terrain["terrain"]["origin"] - [400_000, 6_100_000, 0]).T
    assert (x.min(), y.min(), x.max(), y.max()) == (0.25, 0.25, 59.75, 39.75)
    assert np.abs(z + 30 - 1.5 * np.sin(x / 9) - np.cos(y / 7)).max() < 2 * np.spacing(np.float32(32.0))
    assert part.survey["crs"] == "EPSG:32632"
    assert (part.survey["holes"], part.survey["hole_area_m2"]) == (1, 5 * 6 * 0.25)
    assert len(part.vertices) == 80 * 120 - 4 * 5


def test_extrinsics_of_kalibr_put_a_camera_where_they_say():
    """As the page turns them, the camera of a scene sees points of the IMU where T_cam_imu has them."""
    space: dict = {}
    exec(compile(blocks(ROOT / "docs" / "cameras.md", "python")[0], "cameras.md", "exec"), space)
    camera = Camera(position=space["position"], rotation_euler_deg=space["rotation_euler_deg"])
    T_cam_imu = np.linalg.inv(camera_pose(camera, np.eye(4))) @ space["T_v_imu"]
    np.testing.assert_allclose(T_cam_imu, space["T_cam_imu"], rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("turned", "axes"),
    [
        ([0, 0, 90], np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])),
        ([-90, 0, 0], np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])),
    ],
)
def test_rotations_of_imus_are_those_that_the_page_says(turned, axes):
    """The columns are the IMU's axes in vehicle axes: x forward, y left, z up, and those of a camera."""
    np.testing.assert_allclose(euler_to_matrix(turned), axes, atol=1e-15)


def test_a_smaller_measured_camera_of_the_page_is_the_same_view():
    of_page = [
        Camera(**camera)
        for text in blocks(ROOT / "docs" / "cameras.md", "yaml")
        for camera in yaml.safe_load(text)["vehicle"]["cameras"]
        if camera["id"] == "R0"
    ]
    whole, small = of_page
    expected = resized(whole, *small.resolution)
    np.testing.assert_allclose([x for _, x in small.intrinsics], [x for _, x in expected.intrinsics], rtol=1e-12)
    assert small.distortion == whole.distortion


# ------------------------------------------------------------------------------------------------------- scene files


def merged(block: dict) -> dict:
    """The small scene with what a block of a document says, which may begin at the vehicle."""
    if "vehicles" in block:
        return {key: value for key, value in SCENE.items() if key not in ("vehicle", "trajectory")} | block
    if not block.keys() <= Scene.model_fields.keys():
        assert block.keys() <= Vehicle.model_fields.keys(), block
        block = {"vehicle": block}
    scene = SCENE | block
    scene["vehicle"] = SCENE["vehicle"] | block.get("vehicle", {})
    scene["render"] = {"outputs": ["A", "B"]} | block.get("render", {})
    scene["materials"] = SCENE["materials"] | block.get("materials", {})
    if "scatter" in block or "growth" in block:
        scene.setdefault("terrain", {"kind": "procedural"})
    return scene


@pytest.mark.parametrize("page", pages_with("yaml"))
def test_scene_files_of_a_page_load(page, tmp_path):
    """Each block on the small scene, with a camchain.yaml; one that is no part of a scene is a noise profile."""
    shutil.copy(ROOT / "examples/every_block/camchain.yml", tmp_path / "camchain.yaml")
    for text in blocks(page, "yaml"):
        block = parse(text)
        if "imu" in block and "vehicle" not in block and "name" in block:
            NoiseProfile(**block)
        else:
            scene_from_dict(merged(block), tmp_path)


# ------------------------------------------------------------------------------------------------------ command line


def commands(page: Path) -> list[list[str]]:
    """Arguments of each command in the page's code; what is a synopsis has `...` or alternatives."""
    lines = re.findall(r"^ {4,}varos-warp (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return [
        shlex.split(line.partition(" > ")[0], comments=True)
        for line in lines
        if "..." not in line and "|mcap" not in line
    ]


@pytest.mark.parametrize("page", as_parameters(page for page in PAGES if commands(page)))
def test_commands_of_a_page_exist(page):
    """Verb, options and the number of arguments; keys that are set and templates that are named."""
    group = typer.main.get_command(app)
    for verb, *arguments in commands(page):
        if verb.startswith("--"):
            continue
        context = group.commands[verb].make_context(verb, list(arguments))
        for change in context.params.get("set_") or ():
            assert find_key(change.partition("=")[0])
        if template := context.params.get("template"):
            assert template in TEMPLATES
