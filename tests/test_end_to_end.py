"""The whole chain without stand-ins: a scene file in, a valid dataset out, the same bytes again."""

import json

import numpy as np
import pytest
from standins import tree
from typer.testing import CliRunner

from varos_warp import cli
from varos_warp.dataset.files import read_exr
from varos_warp.dataset.reader.dataset import Dataset

SMALL = ["--device", "cpu", "--spp", "4", "--frames", "0:3", "-q", "--set", "vehicle.cameras.0.resolution=[48, 27]",
         "--set", "render.spp_b=4", "--set", "terrain.resolution=65"]


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
    call("validate", made / "out", "-q")
    assert Dataset(made / "out").linear("A", 0).max() > 0


def test_two_shards_of_a_real_run_give_the_same_bytes(made, tmp_path):
    for shard in ("1/2", "0/2"):
        call("run", made / "scene.yaml", "-o", tmp_path, "--shard", shard, *SMALL)
    assert tree(tmp_path) == tree(made / "out")


def test_shards_of_a_run_with_less_detail_give_the_same_bytes_and_say_what_was_kept(made, tmp_path):
    """The meshes follow from the whole sequence, whichever frames a shard renders."""
    less = [*SMALL, "--set", "render.level_of_detail={tolerance_px: 1.0}"]
    call("run", made / "scene.yaml", "-o", tmp_path / "plain", *less)
    for shard in ("1/2", "0/2"):
        call("run", made / "scene.yaml", "-o", tmp_path / "shards", "--shard", shard, *less)
    assert tree(tmp_path / "shards") == tree(tmp_path / "plain")
    meshes = Dataset(tmp_path / "plain").meta["samples"]["plan"]["meshes"]
    assert meshes["kept"] < 0.8 * meshes["triangles"]
    assert meshes["depth_error"]["rms_mm"] > 0.0
    every = Dataset(made / "out").meta["samples"]["plan"]["meshes"]
    assert every["kept"] == every["triangles"]
    assert tree(tmp_path / "plain").keys() == tree(made / "out").keys()


def test_the_reference_integrator_renders_the_same_scene_and_is_on_record(made, tmp_path):
    """Its image is the other's within their standard errors, and the plan says whose it is."""
    out, how = tmp_path / "out", [*SMALL, "--frames", "0:1", "--outputs", "A", "--spp", "64", "--linear-exr"]
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


def test_a_plan_says_what_less_detail_would_keep(made):
    meshes = json.loads(call("plan", made / "scene.yaml", "--json", *SMALL).stdout)["meshes"]
    assert meshes["level_of_detail"] is None
    text = call("plan", made / "scene.yaml", *SMALL).output
    assert (f"all {meshes['triangles']} triangles are kept; with render.level_of_detail={{}} it would be "
            f"{meshes['kept']}, and D moves by") in text
    text = call("plan", made / "scene.yaml", *SMALL, "--set", "render.level_of_detail={}").output
    assert "never in view: 4 times the tolerance" in text
    assert "error of D at [m]" in text
    assert f"in all {meshes['kept']} of {meshes['triangles']} triangles" in text
