"""What newcomers type wrong: one message that names what they gave and what to give instead, status 2, no traceback."""

import shutil

import pytest
import standins
import trimesh
import yaml
from test_cli import call, refused
from typer.testing import CliRunner

from varos_warp import cli
from varos_warp.dataset.run.produce import produce


@pytest.fixture(autouse=True)
def stand_ins(monkeypatch):
    standins.install(monkeypatch)


@pytest.fixture
def scene_file(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(standins.scene_dict()))
    return path


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A dataset of A; read it, do not change it."""
    out = tmp_path_factory.mktemp("made") / "data"
    with pytest.MonkeyPatch.context() as patch:
        standins.install(patch)
        produce(standins.make_scene({"outputs": ["A"]}), out, quiet=True)
    return out


@pytest.fixture
def dataset(made, tmp_path):
    return shutil.copytree(made, tmp_path / "data")


@pytest.fixture
def mesh(tmp_path):
    trimesh.creation.icosphere(2).export(tmp_path / "mesh.ply")
    return tmp_path / "mesh.ply"


# ------------------------------------------------------------------------------------------------------------- scenes


@pytest.mark.parametrize(
    ("given", "key"),
    [
        ("--spp 0", "render.spp = 0"),
        ("--spp 0.1", "render.spp = 0.1"),
        ("--set render.spp=0.0", "render.spp = 0.0"),
        ("--tolerance 2", "render.tolerance = 2"),
        ("--outputs AX", "render.outputs.1 = 'X'"),
        ("--layers direct,all", "render.layers.1 = 'all'"),
        ("--integrator magic", "render.integrator = 'magic'"),
        ("--max-scatterings -1", "render.max_scatterings = -1"),
        ("--max-bounces -2", "render.max_bounces = -2"),
        ("--seed -1", "seed = -1"),
        ("--denoise magic", "render.denoise = 'magic'"),
    ],
)
def test_a_refused_option_is_named_as_it_was_given(scene_file, tmp_path, given, key):
    said = refused("run", scene_file, "-o", tmp_path / "out", "--device", "cpu", *given.split())
    assert said.startswith(f"varos-warp: {given}: {key}: ")


def test_an_option_is_blamed_for_itself_also_beside_set(scene_file, tmp_path):
    said = refused("run", scene_file, "-o", tmp_path / "out", "--spp", "0", "--set", "render.spp=8")
    assert said.startswith("varos-warp: --spp 0: render.spp = 0: ")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("--frames 50", "--frames = '50:51': names no frame. The sequence has frames 0 to 9."),
        ("--frames 5:2", "--frames = '5:2': names no frame."),
        ("--device cuda:7", "--device = 'cuda:7': no such device"),
        ("--workers 0", "--workers = 0: must be at least 1. Such as 2."),
        ("--workers 2 --shard 0/2", "--workers = 2: cannot be given with --shard. Leave one of them out."),
    ],
)
def test_an_option_that_the_scene_cannot_serve_is_named_as_an_option(scene_file, tmp_path, given, said):
    assert said in refused("run", scene_file, "-o", tmp_path / "out", "--device", "cpu", "-q", *given.split())


def test_what_is_no_option_is_not_named_as_one():
    """The verb's argument is KEY."""
    assert refused("schema", "key").startswith("varos-warp: key: no key 'key'.")


def test_an_empty_option_is_seen_in_the_message(scene_file, tmp_path):
    said = refused("run", scene_file, "-o", tmp_path / "out", "--outputs", "")
    assert said.startswith("varos-warp: --outputs '': render.outputs: should be a list of ")


@pytest.mark.parametrize("outputs", ["A,B", "A, B", "A B", "AB"])
def test_image_types_are_taken_with_commas_and_blanks_or_without(outputs):
    assert cli.options.Choices(outputs=outputs).overrides()[0][0] == "render.outputs=[A,B]"


def test_the_description_of_a_dataset_is_no_scene_file(dataset):
    said = refused("info", dataset / "dataset.json")
    assert "dataset.json: describes a dataset, it is no scene file. Give the scene file that it was made of" in said


@pytest.mark.parametrize("path", [r"C:\Users\me\rock.obj", r"parts\map.obj"])
def test_a_backslash_within_set_is_told_of(scene_file, path):
    said = refused("info", scene_file, "--set", f'objects=[{{file: "{path}"}}]')
    assert "is not valid YAML" in said
    assert "Write / instead of \\ in paths" in said


@pytest.mark.parametrize("verb", ["run", "simulate", "render"])
def test_a_file_in_the_place_of_the_datasets_folder_is_not_taken_for_a_full_disk(scene_file, verb):
    said = refused(verb, scene_file, "-o", scene_file)
    assert "cannot be written: " in said
    assert "A file is where a folder is needed, or a folder where a file is: choose another" in said
    assert "space" not in said


# ----------------------------------------------------------------------------------------------------------- datasets


@pytest.mark.parametrize("verb", ["validate", "report", "view", "export --to tum -o E", "noise --profile ideal -o N"])
def test_what_is_no_dataset_is_told_for_what_it_is(dataset, verb):
    name, *options = verb.split()
    assert "nowhere: there is no such folder. Give the folder that" in refused(name, dataset / "../nowhere", *options)
    assert f"is a file, and a dataset is a folder. Give {dataset}, the dataset that it lies in." in refused(
        name, dataset / "dataset.json", *options
    )
    assert f"it is not a dataset. Give {dataset}, the dataset that it lies in." in refused(
        name, dataset / "vehicle0", *options
    )


def test_an_export_is_no_dataset(dataset, tmp_path):
    assert call("export", dataset, "--to", "euroc", "-o", tmp_path / "euroc").exit_code == 0
    assert "there is no dataset.json in it, so it is not a dataset" in refused("validate", tmp_path / "euroc")


def test_an_incomplete_dataset_is_read_without_a_traceback(dataset, tmp_path):
    """`validate` tells all that is wrong, the other verbs the first file that they miss, and what to do."""
    for path in (dataset / "vehicle0/cam0/camL0_poses").iterdir():
        path.unlink()
    done = call("validate", dataset, "-q")
    assert done.exit_code == 2
    assert "problem: vehicle0/cam0/camL0_poses/camL0_poses_euler.csv: there is no such file" in done.output
    for verb in ("report", "export --to stream -o E", "export --to colmap -o E -q"):
        name, *options = verb.replace("E", str(tmp_path / "E")).split()
        assert "transformation_matrix.csv: there is no such file. `run` again to make it anew." in refused(
            name, dataset, *options
        )


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("--to EuRoC", "--to = 'EuRoC': is no format. Did you mean 'euroc'?"),
        ("--to ros2", "--to = 'ros2': is no format. There are: euroc, tum, kitti, colmap, nerfstudio, mcap, "),
        ("--to tum --images B", "--images = 'B': are no colour images of this dataset. It has: A."),
        ("--to tum --images a", "--images = 'a': are no colour images of this dataset. It has: A."),
        ("--to tum --camera X", "--camera = 'X': no such camera. There are: L0, R0."),
        ("--to tum --camera L0,X", "--camera = 'X': no such camera. There are: L0, R0."),
        ("--to tum --start-ns -5", "--start-ns = -5: is no time that every format has. Give nanoseconds since 1970"),
        ("--to tum --raw", "--raw = True: is for mcap only. Leave it out."),
    ],
)
def test_a_wrong_option_of_an_export_is_named_as_an_option(dataset, tmp_path, given, said):
    assert said in refused("export", dataset, "-o", tmp_path / "out", *given.split())
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("page", "--out = 'page': is no name of an HTML file. Such as page/report.html."),
        ("page.pdf", "is no name of an HTML file. Such as page.html."),
        (".", "--out = '.': is a folder. Such as report.html"),
        ("nowhere/page.html", "--out = 'nowhere': there is no such folder. Make it, or name another one."),
    ],
)
def test_a_report_is_an_html_file_in_a_folder_that_is_there(dataset, tmp_path, given, said, monkeypatch):
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    assert said in refused("report", dataset, "-o", given)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("given", [["L0,R0"], ["L0", "R0"], ["L0, R0", "L0"]])
def test_cameras_of_an_export_are_taken_with_commas_or_one_by_one_and_each_once(dataset, tmp_path, given):
    options = [word for each in given for word in ("--camera", each)]
    done = call("export", dataset, "--to", "colmap", "-o", tmp_path / "out", *options)
    assert done.stdout.endswith("10 frames of L0, R0 as colmap\n")


# --------------------------------------------------------------------------------------------------------- preprocess


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("-o x.obj", "--out = 'x.obj': is no name of a PLY file, and only those are written. Such as x.ply."),
        ("-o x", "--out = 'x': is no name of a PLY file"),
        ("-o .", "--out = '.': is no name of a PLY file"),
        ("-o x.ply --scale 0", "--scale = 0.0: is not above 0."),
        ("-o x.ply --scale -1", "--scale = -1.0: is not above 0."),
        ("-o x.ply --scale nan", "--scale = nan: is not above"),
        (
            "-o x.ply --region 0,0,1",
            "--region = '0,0,1': is not XMIN,YMIN,XMAX,YMAX with the lower end first. For example",
        ),
        ("-o x.ply --region 1,1,0,0", "--region = '1,1,0,0': is not XMIN"),
        ("-o x.ply --region nan,0,1,1", "--region = 'nan,0,1,1': is not XMIN"),
        ("-o x.ply --region 50,50,60,60", "--region = [50.0, 50.0, 60.0, 60.0]: lies beside the terrain. The "),
        ("-o x.ply --merge-tolerance 0.5", "--merge-tolerance = 0.5: is more than half the mesh's median edge"),
    ],
)
def test_a_wrong_option_of_preprocess_is_named_as_an_option(mesh, given, said, monkeypatch):
    monkeypatch.chdir(mesh.parent)
    assert said in refused("preprocess", mesh, "-q", *given.split())
    assert sorted(path.name for path in mesh.parent.iterdir()) == ["mesh.ply"]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("unit=mm", "survey.unit = 'mm': is not one of the choices. Known here: m, ft, us_ft."),
        ("foo=3", "survey.foo: unknown key. Known here: "),
        ("classes=3", "survey.classes = 3: should be a list of whole numbers"),
        ("region=3", "survey.region = 3: should be a list of 4 numbers"),
    ],
)
def test_a_wrong_key_of_a_survey_is_told_as_in_a_scene(tmp_path, given, said):
    (tmp_path / "a.xyz").write_text("0 0 1\n1 0 2\n0 1 2\n1 1 2\n")
    assert said in refused("preprocess", tmp_path / "a.xyz", "-q", "-o", tmp_path / "x.ply", "--survey", given)


def test_preprocess_does_not_write_over_its_meshes_nor_read_folders(mesh, tmp_path):
    before = mesh.read_bytes()
    assert "--out = " in (said := refused("preprocess", mesh, "-o", mesh))
    assert "is one of the meshes. Name another file." in said
    assert mesh.read_bytes() == before
    said = refused("preprocess", tmp_path, "-o", tmp_path / "x.ply")
    assert "there is no such mesh file: this is a folder. Give the path of a mesh file." in said


def test_preprocess_that_cannot_wrap_speaks_of_its_options(tmp_path):
    """A board that stands upright."""
    trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]], [[0, 1, 2], [0, 2, 3]]).export(tmp_path / "board.ply")
    said = refused("preprocess", tmp_path / "board.ply", "-o", tmp_path / "x.ply", "-q")
    assert "--shrinkwrap = 'auto': nothing is seen from above." in said
    assert said.endswith("check --up-axis.\n")


@pytest.mark.parametrize(
    "verb",
    [
        "run",
        "render",
        "simulate",
        "plan",
        "info",
        "preview",
        "validate",
        "report",
        "view",
        "export",
        "noise",
        "preprocess",
    ],
)
def test_a_verb_without_its_arguments_tells_how_it_is_used(verb):
    done = CliRunner().invoke(cli.app, [verb])
    assert done.exit_code == 2
    assert "Missing argument" in done.stderr
    assert "Traceback" not in done.stderr
