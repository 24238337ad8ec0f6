"""The command line: exit statuses, messages without tracebacks, and the verbs that users rely on."""

import ast
import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
import warnings
from pathlib import Path

import pytest
import standins
import typer
import yaml
from test_examples import SMALL, with_little_on_it
from typer.testing import CliRunner

from varos_warp import cli
from varos_warp.cli import options
from varos_warp.cli.tables import print_plan
from varos_warp.dataset.export import FORMATS
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.errors import InputError, RunFailed
from varos_warp.render.decisions import Decision, Plan
from varos_warp.scene.file.load import load_scene


@pytest.fixture(autouse=True)
def stand_ins(monkeypatch):
    standins.install(monkeypatch)


@pytest.fixture
def scene_file(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(standins.scene_dict()))
    return path


def call(*arguments):
    return CliRunner().invoke(cli.app, [str(a) for a in arguments])


def refused(*arguments) -> str:
    """Message of a call that must end with status 2 and one line, no traceback."""
    result = call(*arguments)
    assert result.exit_code == 2, result.output
    assert "Traceback" not in result.stderr
    assert result.stderr.startswith("varos-warp: ")
    assert len(result.stderr.strip().splitlines()) == 1, result.stderr
    return result.stderr


def test_every_documented_verb_is_there_with_its_help():
    text = call("--help").output
    for name in "demo run sweep simulate render plan preprocess validate report info schema init".split():
        assert name in text
        assert call(name, "--help").exit_code == 0


def test_run_makes_a_valid_dataset_and_says_so(scene_file, tmp_path):
    out = tmp_path / "out"
    result = call("run", scene_file, "-o", out, "--device", "cpu", "-q")
    assert result.exit_code == 0, result.output
    assert "10 frames, 80 images rendered, 0 kept" in result.output
    assert call("validate", out, "-q").exit_code == 0
    again = call("run", scene_file, "-o", out, "--device", "cpu", "-q", "--json")
    assert json.loads(again.stdout)["kept"] == 80


def test_options_have_the_last_word_over_the_scene(scene_file, tmp_path):
    out = tmp_path / "out"
    result = call(
        "run",
        scene_file,
        "-o",
        out,
        "--device",
        "cpu",
        "--outputs",
        "A,D",
        "--spp",
        4,
        "--max-scatterings",
        2,
        "--max-bounces",
        3,
        "--layers",
        "direct,single",
        "--seed",
        9,
        "--denoise",
        "none",
        "--linear-exr",
        "--integrator",
        "reference",
        "--frames",
        "2:4",
        "--set",
        "render.depth_kind=range",
        "--set",
        "seed=5",
        "-q",
    )
    assert result.exit_code == 0, result.output
    data = Dataset(out)
    render = data.meta["scene"]["render"]
    assert (render["spp"], render["max_scatterings"], render["max_bounces"]) == (4, 2, 3)
    assert (render["layers"], render["denoise"], render["linear_exr"]) == (["direct", "single"], "none", True)
    assert (render["depth_kind"], data.meta["seed"], render["integrator"]) == ("range", 9, "reference")
    assert (data.frames, data.outputs) == ([2, 3], ["A", "D"])
    assert data.layout.linear("L0", 2).is_file()


def test_a_tolerance_replaces_the_scenes_samples():
    assert {change for change, _ in options.Choices(tolerance=0.1).overrides()} == {
        "render.tolerance=0.1",
        "render.spp=null",
    }


def test_shards_together_make_a_whole_dataset(scene_file, tmp_path):
    out = tmp_path / "out"
    first = call("run", scene_file, "-o", out, "--device", "cpu", "--shard", "0/2", "-q")
    assert first.exit_code == 0
    assert "not complete yet" in first.output
    assert call("run", scene_file, "-o", out, "--device", "cpu", "--shard", "1/2", "-q").exit_code == 0
    assert call("validate", out, "-q").exit_code == 0


def test_simulate_writes_sensors_only_and_render_frames_only(scene_file, tmp_path):
    assert call("simulate", scene_file, "-o", tmp_path / "s", "-q").exit_code == 0
    assert (tmp_path / "s/vehicle0/imu0/imu0_data.csv").is_file()
    assert not list((tmp_path / "s").rglob("*.png"))
    assert call("render", scene_file, "-o", tmp_path / "r", "--outputs", "C", "--device", "cpu", "-q").exit_code == 0
    assert list((tmp_path / "r").rglob("C/*.png"))
    assert not list((tmp_path / "r").rglob("imu0"))


def test_plan_prints_what_the_planner_says(scene_file):
    result = call("plan", scene_file, "--device", "cpu", "--json", "-q")
    found = json.loads(result.stdout)
    assert (found["spp"], found["max_scatterings"], found["reasons"]) == (8, None, ["spp 8: a test"])
    assert "a test" in call("plan", scene_file, "--device", "cpu", "-q").output


def test_an_error_that_is_none_and_one_that_is_not_predicted_are_told_apart_from_a_small_one(capsys):
    """Paths are right but for their noise, and that of samples that are given nobody predicts."""
    given = [Decision("integrator", "path", "given", (0.0, 0.0, 0.0)), Decision("spp", "2", "given")]
    print_plan({}, Plan(2, None, decisions=given))
    said = capsys.readouterr().out
    assert "0.00" not in said
    assert "relative RMSE of an image without the noise of the samples that are given\n" in said
    print_plan({}, Plan(2, None, decisions=[Decision("spp", "64", "", (0.02, 0.00004, 0.01))]))
    said = capsys.readouterr().out
    assert "0.00 " in said
    assert "relative RMSE of an image\n" in said


def test_plan_and_run_warn_of_what_info_warns_of(scene_file, tmp_path):
    change = ("--set", "surface_depth_m=-1", "--device", "cpu")
    (warning, *_) = json.loads(call("info", scene_file, *change[:2], "--json").stdout)["warnings"]
    assert warning.startswith("vehicle.lights.0: is above the sea surface")
    assert f"note: {warning}\n" in call("plan", scene_file, *change).stderr
    assert f"note: {warning}\n" in call("run", scene_file, "-o", tmp_path / "out", *change, "--frames", "0").stderr


COMMON = (
    "--device --frames --outputs --tolerance --spp --max-scatterings --layers --integrator --max-bounces --seed "
    "--denoise --set"
)
JOB = COMMON + " --linear-exr --shard --json --quiet"


def test_help_goes_from_a_scene_to_a_dataset_and_names_every_format():
    text = call("--help").output
    places = [text.index(words) for words in ("Scene files", "Make a dataset", "Use a dataset")]
    assert places == sorted(places)
    to = next(option for option in typer.main.get_command(cli.app).commands["export"].params if option.name == "to")
    assert all(name in to.help for name in FORMATS)


@pytest.mark.parametrize(
    ("verb", "options"),
    [
        ("run", JOB + " --workers"),
        ("render", JOB + " --workers"),
        ("demo", JOB),
        ("plan", COMMON + " --json --quiet"),
        ("simulate", "--seed --set --json --quiet"),
        ("info", "--set --json --quiet"),
        ("validate", "--json --quiet"),
        ("report", "--json --quiet"),
    ],
)
def test_every_verb_has_the_options_of_the_contract_that_mean_something_to_it(verb, options):
    command = typer.main.get_command(cli.app).commands[verb]
    assert set(options.split()) <= {name for parameter in command.params for name in parameter.opts}


def test_plan_looks_at_the_frames_asked_for(scene_file, monkeypatch):
    planned = []

    def plan_render(scene, renderer, poses, **options):
        planned.append((len(poses), scene.render.denoise))
        return standins.plan_render(scene, renderer, poses)

    monkeypatch.setattr("varos_warp.render.planner.plan.plan_render", plan_render)
    call("plan", scene_file, "--device", "cpu", "-q", "--frames", "2:5", "--denoise", "none")
    call("plan", scene_file, "--device", "cpu", "-q")
    assert planned == [(3, "none"), (10, "nlm")]
    assert "names no frame" in refused("plan", scene_file, "--device", "cpu", "-q", "--frames", "50:")


def test_a_report_tells_where_it_is_as_json_or_not_at_all(scene_file, tmp_path):
    call("run", scene_file, "-o", tmp_path / "out", "--device", "cpu", "-q", "--outputs", "C", "--frames", "0:1")
    page = str(tmp_path / "out" / "report.html")
    assert json.loads(call("report", tmp_path / "out", "--json").stdout) == {"report": page}
    assert call("report", tmp_path / "out", "-q").stdout == ""


def test_a_demo_in_shards_writes_its_report_when_it_is_whole(tmp_path):
    out = tmp_path / "demo"
    few = ("render.max_triangles=20000", "terrain.resolution=65", "growth=[]", "scatter=[]", "objects=[]")
    small = [word for change in (*few, "vehicle.cameras.0.resolution=[64,36]") for word in ("--set", change)]
    arguments = ("demo", "-o", out, "--device", "cpu", "-q", "--outputs", "C", "--tolerance", 0.5, *small)
    assert call(*arguments, "--shard", "0/2").exit_code == 0
    assert not (out / "report.html").exists()
    assert call(*arguments, "--shard", "1/2").exit_code == 0
    assert (out / "report.html").exists()
    assert Dataset(out).meta["scene"]["render"]["tolerance"] == 0.5


def test_report_writes_one_page(scene_file, tmp_path):
    call("run", scene_file, "-o", tmp_path / "out", "--device", "cpu", "-q", "--frames", "0:2")
    result = call("report", tmp_path / "out")
    assert result.exit_code == 0
    assert (tmp_path / "out/report.html").read_text().startswith("<!doctype html>")


def test_an_invalid_dataset_ends_with_status_2_and_names_the_problem(scene_file, tmp_path):
    out = tmp_path / "out"
    call("run", scene_file, "-o", out, "--device", "cpu", "-q", "--frames", "0:2", "--outputs", "D")
    next(out.rglob("*L0_D-00000001.png")).unlink()
    result = call("validate", out, "-q")
    assert result.exit_code == 2
    assert "problem: " in result.output
    assert "D-00000001.png: there is no such file" in result.output
    told = json.loads(call("validate", out, "-q", "--json").stdout)
    assert (told["valid"], told["dataset"], bool(told["problems"])) == (False, str(out), True)


def test_noise_makes_a_valid_dataset_of_another(scene_file, tmp_path):
    out, noisy = tmp_path / "out", tmp_path / "noisy"
    call("run", scene_file, "-o", out, "--device", "cpu", "-q", "--frames", "0:2", "--outputs", "A,D")
    result = call("noise", out, "--profile", "adis16448", "--profile", "bar30", "-o", noisy, "--seed", "7", "-q")
    assert result.exit_code == 0, result.output
    assert "noise of adis16448+bar30, seed 7" in result.output
    told = json.loads(call("validate", noisy, "-q", "--json").stdout)
    assert told["valid"], told["problems"]
    assert told["files_hashed"] > 0
    assert "Give a file, or one of: adis16448" in refused("noise", out, "--profile", "mpu", "-o", tmp_path / "x")
    assert "run` into the folder" in refused("run", scene_file, "-o", noisy, "--device", "cpu", "-q")


def test_info_shows_water_and_cameras_with_their_units(scene_file):
    text = call("info", scene_file).output
    assert "12.0 m in 34.0 s" in text
    assert "absorption a [1/m]" in text
    assert "mean free path [m]" in text
    assert "36.957" in text  # focal length in pixels
    assert re.search(r"L0 +the vehicle +\(.*\) +\(0, 0\.9\d+, -0\.2\d+\)", text)
    assert "stereo pair L0, R0: baseline " in text
    assert "camera R0: not given, so those of the paper's camera: sensor_mm, focal_mm" in text
    facts = json.loads(call("info", scene_file, "--json").stdout)
    assert facts["water"]["c"] == pytest.approx([0.11, 0.06, 0.04])
    assert facts["trajectory"]["length_m"] == 12.0
    assert "warnings" in facts


def test_info_says_what_a_calibration_gives_and_where_its_lens_ends(scene_file):
    (scene_file.parent / "chain.yaml").write_text(
        "cam0: {camera_model: pinhole, intrinsics: [50, 50, 23.5, 13], distortion_model: equidistant, "
        "distortion_coeffs: [-0.9, 0, 0, 0], resolution: [48, 27], T_cam_imu: [[1]]}"
    )
    text = call("info", scene_file, "--set", "vehicle.cameras=[{id: M0, calibration: chain.yaml#cam0}]").output
    assert "intrinsics, distortion and resolution are those of chain.yaml#cam0; where it is mounted is as the" in text
    assert re.search(r"M0: \d+ pixels \(\d+ %\) see nothing and are black: the lens ends 34\.9 degrees from its", text)
    assert "not given" not in text


def test_info_tells_by_how_much_a_measured_phase_function_was_normalised(scene_file):
    table = scene_file.parent / "vsf.csv"
    table.write_text("angle_deg,p\n0.1,3533\n1,143\n10,2.3\n90,0.0084\n170,0.006\n")
    phase = f"water.coefficients.phase={{kind: tabulated, file: {table}}}"
    text = call("info", scene_file, "--set", phase).output
    assert "phase function: tabulated, backscatter fraction 0.02482" in text
    assert "vsf.csv: integral over the sphere 1.8275, normalised to 1" in text
    facts = json.loads(call("info", scene_file, "--set", phase, "--json").stdout)["water"]["phase"]
    assert facts["integral"] == pytest.approx(1.8275, rel=1e-4)
    assert facts["g"] == pytest.approx(0.917, abs=1e-3)
    table.write_text("angle_deg,p\n0.1,5\n10,-1\n")
    said = refused("info", scene_file, "--set", phase)
    assert "vsf.csv:3: water.coefficients.phase.file = -1.0: p is negative" in said


def test_info_tells_frames_size_and_time_of_the_dataset(scene_file):
    """In proportion to what is rendered, whatever the factors."""
    changes = ("seed=3", "vehicle.cameras.1.resolution=[96,54]", "render.outputs=[A]")
    once, more, less = (
        json.loads(call("info", scene_file, "--json", "--set", change).stdout)["dataset"] for change in changes
    )
    assert (once["frames"], once["images"], once["spp"]) == (10, 10 * 2 * 4, 8)
    assert more["bytes"] == pytest.approx(once["bytes"] * (1 + 4) / 2, abs=1)
    assert more["seconds"] >= once["seconds"] >= less["seconds"] > 0.0
    assert less["bytes"] < once["bytes"]
    assert 0.0 < once["plan_seconds"] < once["seconds"]  # samples are given, the integrator is not
    given = call("info", scene_file, "--json", "--set", "render.integrator=path").stdout
    assert json.loads(given)["dataset"]["plan_seconds"] == 0.0
    text = call("info", scene_file).output
    assert "dataset: 10 frames through 2 cameras, 80 images, about " in text
    assert "with 8 samples per pixel of A; varos-warp plan measures it" in text
    planned = call("info", scene_file, "--set", "render.spp=null").output
    assert "with 4 samples per pixel of A (a plan may take more: many more in turbid water near a floor)" in planned
    assert " free core" in planned or "on a GPU" in planned


def test_info_expects_little_of_images_without_water_and_speaks_of_no_samples_of_a(scene_file):
    """Ten frames of 48 x 27 take less than a second, and what first hits need is compiled within a few."""
    told = json.loads(call("info", scene_file, "--json", "--set", "render.outputs=[C, D]").stdout)["dataset"]
    assert told["compile_seconds"] < told["seconds"] < told["compile_seconds"] + 2.0 < 10.0
    assert (told["spp"], told["spp_is_planned"], told["plan_seconds"]) == (None, False, 0.0)
    text = call("info", scene_file, "--set", "render.outputs=[B, C, D]").output
    assert "samples" not in text
    assert "of that, compiling: 5 seconds, the first time only" in text


@pytest.mark.parametrize("outputs", ["C", "S", "F", "B"])
def test_info_expects_more_of_more_pixels_whatever_the_image(scene_file, outputs):
    """A thousand times as many."""
    one, more = (
        json.loads(
            call(
                "info",
                scene_file,
                "--json",
                "--set",
                f"render.outputs=[{outputs}]",
                "--set",
                f"vehicle.cameras.0.resolution={size}",
            ).stdout
        )["dataset"]["seconds"]
        for size in ("[48,27]", "[1536,864]")
    )
    assert more > one


def test_info_and_run_refuse_missing_files_before_anything_is_made(scene_file, tmp_path):
    lost = "materials={wall: {kind: slope_blend, flat: {texture: lost.png}}}"
    for verb in (("info",), ("run", "-o", tmp_path / "out", "--device", "cpu")):
        said = refused(*verb, scene_file, "--set", lost, "-q")
        assert f"--set {lost}: materials.wall.flat.texture = 'lost.png': there is no such image file (/" in said
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("verb", [[], ["run"], ["noise"], ["cache"]])
def test_help_shows_no_type_for_flags(verb):
    assert "bool" not in call(*verb, "--help").output


def test_frames_may_have_a_step(scene_file, tmp_path):
    out = tmp_path / "out"
    assert (
        call("run", scene_file, "-o", out, "--device", "cpu", "-q", "--outputs", "C", "--frames", "1:9:3").exit_code
        == 0
    )
    assert Dataset(out).frames == [1, 4, 7]
    assert call("validate", out, "-q").exit_code == 0


@pytest.mark.parametrize("quiet", [True, False])
def test_what_is_made_once_is_told_but_not_when_quiet(scene_file, monkeypatch, quiet):
    from varos_warp import cache

    def scene_info(*_):
        cache.cached("x", {}, dict, tmp, "the field of a lamp")
        warnings.warn("nothing grows", stacklevel=1)
        raise InputError("enough")

    tmp = scene_file.parent / "kept"
    monkeypatch.setattr("varos_warp.scene.info.scene_info", scene_info)
    result = call("info", scene_file, *["-q"] * quiet)
    assert ("making the field of a lamp, once" in result.stderr) is not quiet
    assert ("note: nothing grows" in result.stderr) is not quiet
    assert result.stderr.splitlines()[-1] == "varos-warp: enough"


def test_a_machine_without_a_gpu_is_not_warned_of_by_the_driver():
    """Neither on stdout nor stderr, whoever loads Warp first."""
    code = "import varos_warp.device.devices as d; print(d.resolve_device('cpu'))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("cpu\n", "")


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("varos-warp val", "validate"),
        ("varos-warp run --work", "--workers"),
        ("varos-warp init --template hul", "hull"),
        ("varos-warp schema vehicle.cameras.foc", "vehicle.cameras.focus_m"),
    ],
)
def test_the_shell_completes_verbs_options_templates_and_keys(words, offered):
    words = words.split()
    environment = os.environ | {
        "_VAROS_WARP_COMPLETE": "complete_bash",
        "COMP_WORDS": " ".join(words),
        "COMP_CWORD": str(len(words) - 1),
    }
    code = "from varos_warp.cli import main; main()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
    assert offered in done.stdout.split()


def test_schema_is_json_schema():
    content = json.loads(call("schema").stdout)
    assert content["additionalProperties"] is False
    assert "water" in content["properties"]


def test_schema_explains_one_key_in_words_or_as_json():
    assert "  default: 3.0" in call("schema", "vehicle.cameras.focus_m").stdout
    (entry,) = json.loads(call("schema", "vehicle.cameras.focus_m", "--json").stdout)
    assert (entry["schema"]["x-unit"], entry["schema"]["minimum"], entry["required"]) == ("m", 0.001, False)
    assert "Did you mean 'cameras'?" in refused("schema", "vehicle.camera")


@pytest.mark.usefixtures("few_bodies")
def test_init_writes_a_scene_that_info_accepts_and_overwrites_nothing(tmp_path):
    path = tmp_path / "mine.yaml"
    assert call("init", path).exit_code == 0
    few = ("vehicle.cameras.0.resolution=[64,36]", *SMALL["starter"], *with_little_on_it(load_scene(path)))
    assert call("info", path, *(word for change in few for word in ("--set", change))).exit_code == 0
    before = path.read_text()
    assert "is there already" in refused("init", path)
    assert path.read_text() == before


def test_editors_find_the_schema_beside_a_new_scene_without_a_network(tmp_path):
    path = tmp_path / "mine.yaml"
    call("init", path)
    name = path.read_text().splitlines()[0].removeprefix("# yaml-language-server: $schema=")
    assert json.loads((tmp_path / name).read_text()) == json.loads(call("schema").stdout)


def test_init_begins_with_a_template_by_its_name(tmp_path):
    assert call("init", tmp_path / "a.yaml", "--template", "harbour-wall").exit_code == 0
    assert "name: harbour_wall" in (tmp_path / "a.yaml").read_text()
    assert "Did you mean 'hull'?" in refused("init", tmp_path / "b.yaml", "--template", "hul")
    assert not (tmp_path / "b.yaml").exists()
    listing = call("init", tmp_path / "b.yaml", "--list").stdout
    assert "stereo_survey" in listing
    assert not (tmp_path / "b.yaml").exists()


def test_preprocess_joins_and_decimates_and_states_its_error(tmp_path):
    import trimesh

    for i in range(2):
        ball = trimesh.creation.icosphere(subdivisions=3).apply_translation([3.0 * i, 0, 0])
        ball.export(tmp_path / f"{i}.ply")
    result = call(
        "preprocess", tmp_path / "0.ply", tmp_path / "1.ply", "-o", tmp_path / "out.ply", "--vertices", 300, "--json"
    )
    assert result.exit_code == 0, result.output
    facts = json.loads(result.stdout)
    assert facts["before"]["vertices"] == 2 * 642
    assert facts["after"]["vertices"] <= 330
    assert 0 < facts["distance_to_result_m"]["max"] < 0.1
    assert len(trimesh.load(tmp_path / "out.ply").vertices) == facts["after"]["vertices"]
    assert "from the original to the result" in call("preprocess", tmp_path / "0.ply", "-o", tmp_path / "b.ply").output


def test_the_cache_shows_what_it_holds_and_is_emptied(tmp_path, monkeypatch):
    monkeypatch.setenv("VAROS_WARP_CACHE", str(tmp_path))
    monkeypatch.setenv("VAROS_WARP_CACHE_MB", "50")
    entries = {f"field-{digit * 32}.npz": size for digit, size in (("a", 3_000_000), ("b", 500_000))}
    for name, size in entries.items():
        (tmp_path / name).write_bytes(bytes(size))
    (tmp_path / "mine.npz").write_text("not the cache's")
    told = json.loads(call("cache", "--json").stdout)
    assert (told["folder"], told["bytes"], told["limit_bytes"]) == (str(tmp_path), 3_500_000, 50_000_000)
    assert {entry["name"]: entry["bytes"] for entry in told["entries"]} == entries
    assert f"{tmp_path}: 2 entries, 3.5 of at most 50 MB" in call("cache").output
    assert f"{tmp_path}: 0 entries, 0.0 of at most 50 MB" in call("cache", "--clear").output
    assert [path.name for path in tmp_path.iterdir()] == ["mine.npz"]


def most_arguments(path) -> dict[str, int]:
    functions = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.FunctionDef)]
    return {f.name: len(f.args.posonlyargs + f.args.args + f.args.kwonlyargs) for f in functions}


def test_no_function_of_the_command_line_takes_more_than_ten_arguments():
    for path in Path(cli.__file__).parent.glob("*.py"):
        assert max(most_arguments(path).values(), default=0) <= 10, path.name


def test_shells_complete_the_verbs_and_options():
    """As bash asks, with the line so far in the environment."""

    def complete(line: str) -> list[str]:
        words = line.split(" ")
        asked = {"_VAROS_WARP_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1)}
        return CliRunner().invoke(cli.app, [], env=asked, prog_name="varos-warp").output.split()

    assert "preprocess" in complete("varos-warp pr")
    assert "--max-scatterings" in complete("varos-warp run --max")


# ---------------------------------------------------------------------------------------------------------- bad input


def test_a_missing_scene_is_refused(tmp_path):
    assert "there is no such scene file" in refused("run", tmp_path / "none.yaml", "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("watter: none", "watter: unknown key. Did you mean 'water'?"),
        ("seed: -1", "seed = -1"),
        ("trajectory: {waypoints: []}", "at least one waypoint"),
        ("vehicle: {cameras: []}", "vehicle.cameras = []: has too few items. Give at least 1."),
        ("vehicle: {lights: [{direction: [0, 1.0e-20, 0]}]}", "vehicle.lights.0.direction"),
    ],
)
def test_a_scene_that_says_something_wrong_is_refused_naming_file_and_key(tmp_path, line, message):
    path = tmp_path / "scene.yaml"
    data = standins.scene_dict()
    data.pop(line.split(":")[0], None)
    path.write_text(yaml.safe_dump(data) + line + "\n")
    text = refused("run", path, "-o", tmp_path / "out")
    assert "scene.yaml" in text
    assert message in text
    assert not (tmp_path / "out").exists()


NAN_MESH = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
nan 1 0
3 0 1 2
"""


@pytest.mark.parametrize("mesh", [None, "", NAN_MESH])
def test_a_mesh_that_is_missing_empty_or_nan_is_refused_and_nothing_is_written(scene_file, tmp_path, mesh):
    if mesh is not None:
        (tmp_path / "m.ply").write_text(mesh)
    text = refused(
        "run", scene_file, "-o", tmp_path / "out", "--device", "cpu", "-q", "--set", "objects=[{file: m.ply}]"
    )
    assert "m.ply" in text
    assert "objects.0" in text
    assert not (tmp_path / "out").exists()


def test_an_unknown_device_is_refused_with_those_that_exist(scene_file, tmp_path):
    text = refused("run", scene_file, "-o", tmp_path / "out", "--device", "cuda:99")
    assert "cuda:99" in text
    assert "cpu" in text
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "arguments",
    [
        "--frames a:b",
        "--frames 1:2:3:4",
        "--frames 0:9:0",
        "--frames 0:9:-1",
        "--frames -3:",
        "--frames 50:",
        "--shard 2/2",
        "--shard x",
        "--spp 0",
        "--spp 4 --tolerance 0.1",
        "--outputs AX",
        "--layers all",
        "--integrator magic",
        "--denoise magic",
        "--seed -1",
        "--tolerance 0",
        "--max-scatterings -1",
        "--set nonsense",
        "--set render.what=1",
    ],
)
def test_a_bad_option_is_refused(scene_file, tmp_path, arguments):
    refused("run", scene_file, "-o", tmp_path / "out", "--device", "cpu", "-q", *arguments.split())
    assert not (tmp_path / "out").exists()


def test_an_output_folder_of_another_scene_is_refused(scene_file, tmp_path):
    call("run", scene_file, "-o", tmp_path / "out", "--device", "cpu", "-q", "--frames", "0:1", "--outputs", "D")
    text = refused("run", scene_file, "-o", tmp_path / "out", "--device", "cpu", "-q", "--outputs", "D", "--spp", "99")
    assert "render.spp: the dataset in this folder was made with 8, not 99" in text


def test_wrong_usage_ends_with_status_2():
    assert call("run").exit_code == 2
    assert call("fly").exit_code == 2


@pytest.mark.parametrize("function", [options.parse_frames, options.parse_shard, options.parse_region])
def test_parsers_take_nothing_for_everything(function):
    expected = {"parse_frames": slice(None), "parse_shard": (0, 1), "parse_region": None}
    assert function(None) == expected[function.__name__]


def test_parsers_read_what_the_help_shows():
    assert options.parse_frames("3:8") == slice(3, 8)
    assert options.parse_frames("3:") == slice(3, None)
    assert options.parse_frames("7") == slice(7, 8)
    assert options.parse_shard("2/3") == (2, 3)
    assert options.parse_region("0,1,2.5,3") == (0.0, 1.0, 2.5, 3.0)
    with pytest.raises(InputError, match="XMIN"):
        options.parse_region("1,2,3")


def test_our_own_failure_is_not_hidden(scene_file, tmp_path, monkeypatch):
    monkeypatch.setattr("varos_warp.dataset.run.produce.produce", lambda *a, **k: 1 / 0)
    result = call("run", scene_file, "-o", tmp_path / "out")
    assert result.exit_code == 1
    assert isinstance(result.exception, ZeroDivisionError)


def test_images_that_could_not_be_made_are_one_line_and_status_1(scene_file, tmp_path, monkeypatch):
    def failed(*_, **__):
        raise RunFailed("frame 4, camera M0 could not be made: odd")

    monkeypatch.setattr("varos_warp.dataset.run.produce.produce", failed)
    result = call("run", scene_file, "-o", tmp_path / "out")
    assert result.exit_code == 1
    assert result.stderr == "varos-warp: frame 4, camera M0 could not be made: odd\n"


@pytest.mark.parametrize(
    ("verb", "called", "goes_on"), [("run", "run.produce.produce", True), ("validate", "validate.validate", False)]
)
def test_only_what_goes_on_says_so_when_it_is_interrupted(scene_file, tmp_path, monkeypatch, verb, called, goes_on):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(f"varos_warp.dataset.{called}", interrupted)
    result = call(verb, scene_file, *(("-o", tmp_path / "out") if verb == "run" else ()))
    assert result.exit_code == 130
    assert ("goes on from there" in result.stderr) == goes_on
    assert "varos-warp: interrupted" in result.stderr


def test_an_interruption_that_a_library_turns_into_an_error_of_its_own_is_one(scene_file, tmp_path, monkeypatch):
    came = threading.Event()

    def swallowed(*_, **__):
        with contextlib.suppress(KeyboardInterrupt):
            cli._interrupt(None, None)
        raise RuntimeError("expected other data")

    monkeypatch.setattr("varos_warp.dataset.validate.validate", swallowed)
    for module in (cli, sys.modules["varos_warp.cli.app"]):
        monkeypatch.setattr(module, "interrupted", came)
    result = call("validate", scene_file)
    assert result.exit_code == 130
    assert "varos-warp: interrupted" in result.stderr


def test_bad_input_ends_at_once_though_kernels_are_being_compiled(tmp_path):
    """Python waits for threads at its end; a kernel takes 5 to 20 s."""
    program = tmp_path / "program.py"
    program.write_text(
        "import time\n"
        "from types import SimpleNamespace\n"
        "from varos_warp.cli import main\n"
        "from varos_warp.device.compile import compiling\n"
        "long = SimpleNamespace(load=lambda *_, **__: time.sleep(600.0))\n"
        "with compiling([SimpleNamespace(module=long)], 'cpu'):\n"
        "    main()\n"
    )
    done = subprocess.run([sys.executable, program, "info", "missing.yaml"], capture_output=True, text=True, timeout=99)
    assert done.returncode == 2
    assert "missing.yaml" in done.stderr


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_a_run_that_is_asked_to_end_does_so_with_status_130_and_whole_files_only(scene_file, tmp_path):
    """A process of its own, whose frames take a while, gets SIGTERM in the middle.

    SIGINT is sent to `preview` and to a run with workers (tests/dataset).
    """
    program = tmp_path / "program.py"
    program.write_text(
        "import time, pytest, standins\n"
        "standins.install(pytest.MonkeyPatch())\n"
        "render = standins.FlatFloorRenderer.render\n"
        "standins.FlatFloorRenderer.render = lambda *a, **k: (time.sleep(0.5), render(*a, **k))[1]\n"
        "from varos_warp.cli import main\nmain()\n"
    )
    out = tmp_path / "out"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([os.path.dirname(standins.__file__), *sys.path])}
    run = ("run", scene_file, "-o", out, "--device", "cpu", "--outputs", "D")
    process = subprocess.Popen(
        [sys.executable, program, *run],
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
    )
    deadline = time.monotonic() + 60
    while not list(out.rglob("D/*.png")) and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(signal.SIGTERM)
    _, text = process.communicate(timeout=30)
    assert process.returncode == 130, text
    assert "interrupted" in text
    assert "Traceback" not in text
    assert not list(out.rglob(".*.tmp"))
    assert call(*run, "-q").exit_code == 0
    assert call("validate", out, "-q").exit_code == 0


@pytest.mark.parametrize(
    ("imu", "line"),
    [
        ("{}", "IMU: 200 Hz, no noise"),
        (
            "{rate_hz: 100, noise: {gyroscope_noise_density: 1.7e-4, gyroscope_random_walk: 2.0e-5, "
            "accelerometer_noise_density: 2.0e-3}}",
            "IMU: 100 Hz, accelerometer 0.002 m/s^2/sqrt(Hz), random walk 0 m/s^3/sqrt(Hz); "
            "gyroscope 0.00017 rad/s/sqrt(Hz), random walk 2e-05 rad/s^2/sqrt(Hz)",
        ),
    ],
)
def test_info_has_a_line_of_the_noise_of_the_imu(scene_file, imu, line):
    assert line in call("info", scene_file, "--set", f"vehicle.imu={imu}").output.splitlines()
