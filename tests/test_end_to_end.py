"""The whole chain without stand-ins: a scene file in, a valid dataset out, the same bytes again."""

import numpy as np
import pytest
from standins import tree
from typer.testing import CliRunner

from varos_warp import cli
from varos_warp.dataset.files import read_exr
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.render.planner import pilot

SMALL = [
    "--device",
    "cpu",
    "--spp",
    "4",
    "-q",
    "--set",
    "trajectory.duration_s=0.2",
    "--set",
    "render.spp_b=4",
    "--set",
    "vehicle.cameras.0.resolution=[48, 27]",
    "--set",
    "terrain.resolution=65",
    "--set",
    "scatter=[{object: {kind: nut, size: M64}, count: 3, circle: [0, 4, 2]}]",
    "--set",
    "growth=[{on: [terrain], kind: pebble, per_m2: 9, cluster: 0, size_m: [0.1, 0.2], seed: 3}]",
    "--set",
    "render.max_triangles=20000",
    "--set",
    "water={jerlov: {type: IA}}",
    *(word for i in (0, 3, 4, 5) for word in ("--set", f"objects.{i}.chord_error_m=0.05")),
    *(word for i in range(6) for word in ("--set", f"objects.{i}.max_edge_m=0.2")),
]
"""With a few copies, and pebbles that are large enough to be placed: kernels for them, textures and the field are those
of tests/physics/test_field_integrator.py. In water that scatters little, for the field is coarse here. How full clumps
of growth are takes a second to find, so there are none."""


@pytest.fixture(autouse=True, scope="module")
def small_pilot():
    """The planner tries images of as many paths as those of the scene have; what it finds has tests of its own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pilot, "SMALL", 48 * 27)
        yield


def call(*arguments):
    result = CliRunner().invoke(cli.app, [str(a) for a in arguments])
    assert result.exit_code == 0, f"{result.output}\n{result.exception!r}"
    return result


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    call("init", folder / "scene.yaml")
    call("run", folder / "scene.yaml", "-o", folder / "out", *SMALL)
    return folder


def test_the_starter_scene_becomes_a_valid_dataset(made):
    """Lamps are beside the camera and water absorbs: A falls faster than the range's inverse square, fastest in red."""
    call("validate", made / "out", "-q")
    frame = Dataset(made / "out").frame(0)
    hit = np.isfinite(frame.range) & (frame.range > 0.0)
    assert hit.mean() > 0.9
    distance, light = np.log(frame.range[hit]), np.log(frame.A_radiance[hit])
    red, green, blue = np.polyfit(distance, light, 1)[0]
    assert -5.0 < red < green < blue < -2.0
    assert all(np.corrcoef(distance, channel)[0, 1] < -0.8 for channel in light.T)


def test_one_sample_a_pixel_is_a_sound_dataset(made):
    """Its standard errors are infinite."""
    how = [*SMALL, "--spp", "1", "--frames", "0:1", "--outputs", "A", "--linear-exr", "--integrator", "path"]
    call("run", made / "scene.yaml", "-o", made / "one", *how)
    call("validate", made / "one", "-q")


def test_two_shards_of_a_real_run_give_the_same_bytes(made, tmp_path):
    """With a given integrator: that a plan is the same each time is shown of the planner."""
    how = [*SMALL, "--integrator", "field"]
    for shard in (["--shard", "1/2"], ["--shard", "0/2"]):
        call("run", made / "scene.yaml", "-o", tmp_path / "shards", *shard, *how)
    call("run", made / "scene.yaml", "-o", tmp_path / "whole", *how)
    assert tree(tmp_path / "shards") == tree(tmp_path / "whole")


def test_the_reference_integrator_renders_the_same_scene_and_is_on_record(made, tmp_path):
    """Its image is the other's within their standard errors, and the plan says whose it is."""
    out, how = tmp_path / "out", [*SMALL, "--frames", "0:1", "--outputs", "A", "--spp", "96", "--linear-exr"]
    scene = made / "scene.yaml"
    for name in ("reference", "path"):
        call("render", scene, "-o", out / name, "--integrator", name, *how)
    data = {name: Dataset(out / name) for name in ("reference", "path")}
    words = {name: dataset.meta["samples"]["plan"]["models"]["A"] for name, dataset in data.items()}
    assert words["reference"].startswith("reference path tracer, ")
    assert words["path"].startswith("path tracer, ")
    one, two = (read_exr(dataset.layout.linear(dataset.layout.cameras[0], 0)) for dataset in data.values())
    for c in "RGB":
        assert not np.array_equal(one[c], two[c])
        error = np.sqrt(sum(np.sum(image[f"stderr.{c}"].astype(float) ** 2) for image in (one, two)))
        assert abs(np.sum(one[c].astype(float) - two[c])) < 4 * error < 0.2 * two[c].sum()
