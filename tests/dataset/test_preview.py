"""A preview shows the frame, follows every save with no more work than it takes, and survives a broken one."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image
from typer.testing import CliRunner

from varos_warp.cli import app
from varos_warp.dataset import preview as module
from varos_warp.dataset.preview import Viewpoint, added, developed, preview, refined
from varos_warp.dataset.screens import FolderScreen, RerunScreen
from varos_warp.errors import InputError
from varos_warp.products.images.radiance import RadianceImage, decode_color
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.description.optics import resized
from varos_warp.scene.file.load import load_scene
from varos_warp.sim.trajectory import simulate

GAIN = 0.125
LAMP = {"kind": "spot", "position": [0.2, 0, 0], "direction": [0, 1, -0.6], "cone_deg": 90, "intensity": [20, 20, 20]}


@pytest.fixture
def stand_ins():
    """None: here the simulation and the renderer are the real ones."""


@pytest.fixture
def scene_file(tmp_path):
    data = {
        "terrain": {"kind": "procedural", "size_m": 10, "resolution": 17, "relief_m": 0.5},
        "objects": [{"file": "box.obj", "position": [0, 2, 0.3]}],
        "water": {"coefficients": {"sigma_s": [0.02, 0.05, 0.1], "sigma_a": [0.1, 0.04, 0.02]}},
        "vehicle": {
            "lights": [LAMP],
            "cameras": [
                {"id": name, "position": [x, 0, 0], "rotation_euler_deg": [-25, 0, 0], "resolution": [96, 54]}
                for name, x in (("L0", -0.1), ("R0", 0.1))
            ],
        },
        "trajectory": {"poses": [{"position": [0, 0, 1]}, {"time_s": 1.0, "position": [0, 0.5, 1]}]},
        "render": {"exposure": {"A": GAIN}, "denoise": "none"},
    }
    write_box(tmp_path / "box.obj", 0.3)
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(data))
    return path


def write_box(path: Path, height: float) -> None:
    """An open tent: two triangles."""
    corners = [(-0.5, 0, 0), (0.5, 0, 0), (0.5, 0.3, height), (-0.5, 0.3, height)]
    path.write_text("".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "f 1 2 3\nf 1 3 4\n")


def edit(path: Path, **changes) -> None:
    """Replace blocks of a scene file, or of its vehicle."""
    data = yaml.safe_load(path.read_text())
    for key, value in changes.items():
        (data["vehicle"] if key in ("lights", "cameras") else data)[key] = value
    path.write_text(yaml.safe_dump(data))


class Screen(FolderScreen):
    """A folder whose user does something after each image: one step of ``script``, and then interrupts."""

    def __init__(self, folder: Path, *script):
        super().__init__(folder)
        self.script, self.images, self.told = [*script], [], []

    def show(self, letter, pixels):
        super().show(letter, pixels)
        self.images.append(pixels)
        self.go_on()

    def tell(self, words):
        self.told.append(words)
        self.go_on()

    def go_on(self):
        if not self.script:
            raise KeyboardInterrupt
        self.script.pop(0)()


def watch(path: Path, *script, **how) -> Screen:
    """A preview of one sample, in which each step of the script follows an image or a message."""
    screen = Screen(path.parent / "out", *script)
    with pytest.raises(KeyboardInterrupt):
        preview(path, screen, spp=1, device="cpu", quiet=True, **how)
    return screen


def call(*arguments):
    return CliRunner().invoke(app, ["preview", *map(str, arguments)])


@pytest.fixture
def counted(monkeypatch):
    """How often the scene was built, and the vehicle simulated."""
    counts = {"built": 0, "simulated": 0}

    class Counting(FrameRenderer):
        def __init__(self, *args, **how):
            counts["built"] += 1
            super().__init__(*args, **how)

    def simulated(*args):
        counts["simulated"] += 1
        return simulate(args[0])

    monkeypatch.setattr(module, "FrameRenderer", Counting)
    monkeypatch.setattr(module, "simulated", simulated)
    return counts


def fresh(path: Path, width: int = 48, frame: int = 0) -> np.ndarray:
    """The first image that a new renderer makes of a scene file."""
    scene = load_scene(path)
    cameras = [resized(camera, width, width * 9 // 16) for camera in scene.vehicle.cameras]
    scene = scene.model_copy(update={"vehicle": scene.vehicle.model_copy(update={"cameras": cameras})})
    simulation = simulate(scene)
    T_w_v, time_ns = simulation.frames.T_w_v(frame), int(simulation.frames.time_ns[frame])
    image = (
        FrameRenderer(scene, "cpu")
        .render(T_w_v, None, "A", spp=1, integrator="path", time_ns=time_ns, motion=simulation.motion(time_ns))
        .A
    )
    return developed("A", image.radiance, scene, cameras[0])[0]


def test_a_shutter_blurs_it_also_one_that_comes_at_the_last_frame(scene_file):
    cameras = yaml.safe_load(scene_file.read_text())["vehicle"]["cameras"]
    cameras[0]["exposure"] = {"time_s": 0.09, "readout_s": 0.05}
    screen = watch(scene_file, lambda: edit(scene_file, cameras=cameras), viewpoint=Viewpoint(frame=10, width=48))
    sharp, blurred = screen.images
    assert np.array_equal(blurred, fresh(scene_file, frame=10))
    assert not np.array_equal(blurred, sharp)
    result = call(scene_file, "-o", scene_file.parent / "end", "--time", 1.06, "--spp", 1, "--once")
    assert "--time" in result.stderr
    assert "lasts 1 s" in result.stderr


@pytest.mark.parametrize("where", [("--frame", 5), ("--time", 0.5)])
def test_the_picture_is_the_frame(scene_file, tmp_path, where):
    """Blocks of 8 x 8 pixels are within five standard errors of other samples of the same pose and camera."""
    spp = 32
    result = call(scene_file, "-o", tmp_path / "out", *where, "--camera", "R0", "--width", 48, "--spp", spp, "--once")
    assert result.exit_code == 0, result.output
    assert f"camera R0, 48 x 27: 1 sample per pixel, exposure gain {GAIN:g}" in result.stderr
    assert f"{spp} samples per pixel" in result.stderr.splitlines()[-1]
    pixels = np.array(Image.open(tmp_path / "out" / "preview.png"))
    scene = load_scene(scene_file, ["vehicle.cameras.1.resolution=[48, 27]"])
    T_w_v = simulate(scene).trajectory.T_w_v(100)  # of 5 ms
    frame = FrameRenderer(scene, "cpu").render(T_w_v, "R0", "A", spp=spp, integrator="path", frame=1000).A
    shown, step = decode_color(pixels, GAIN), np.diff(decode_color(np.arange(256), GAIN)).max()
    assert pixels.max() < 255
    apart = np.abs(blocks(shown) - blocks(frame.radiance))
    assert (apart < 5.0 * np.sqrt(2.0) * frame.block_error[:3] + step / np.sqrt(12 * 64) * 5.0).all()
    assert frame.block_error.max() < 0.2 * frame.radiance.mean()


def blocks(image: np.ndarray) -> np.ndarray:
    """Means of the whole blocks of 8 x 8 pixels."""
    rows, columns = (side // 8 for side in image.shape[:2])
    return image[: 8 * rows, : 8 * columns].reshape(rows, 8, columns, 8, 3).mean((1, 3))


CHANGES = {
    "lights": ([LAMP | {"position": [-0.4, 0, 0], "cone_deg": 60}], 1, 1),
    "water": ({"jerlov": {"type": "3C"}}, 1, 1),
    "cameras": ([{"id": "L0", "rotation_euler_deg": [-40, 0, 0], "resolution": [96, 54]}], 1, 1),
    "trajectory": ({"poses": [{"position": [0.3, 0, 1.5]}]}, 1, 2),
    "objects": ([], 2, 1),
}


@pytest.mark.parametrize("key", CHANGES)
def test_a_save_is_followed_with_no_more_work_than_it_takes(scene_file, counted, key):
    """The picture is that of a new renderer, bit by bit; what the change does not touch is not made again."""
    value, built, simulated = CHANGES[key]
    before = fresh(scene_file)
    screen = watch(scene_file, lambda: edit(scene_file, **{key: value}), viewpoint=Viewpoint(width=48))
    np.testing.assert_array_equal(screen.images[0], before)
    np.testing.assert_array_equal(screen.images[1], fresh(scene_file))
    assert (screen.images[1] != before).any()
    assert counted == {"built": built, "simulated": simulated}


def test_a_course_that_leaves_the_origin_gets_a_nearer_one(scene_file, counted):
    """Without ground to hold it: at 10 000 km single precision has steps of a metre."""
    far = {"poses": [{"position": [1e7, 0, 1]}]}
    edit(scene_file, terrain=None, objects=[])
    screen = watch(scene_file, lambda: edit(scene_file, trajectory=far), viewpoint=Viewpoint(width=48))
    np.testing.assert_array_equal(screen.images[1], fresh(scene_file))
    assert counted == {"built": 2, "simulated": 2}


def test_no_kernel_is_loaded_again_for_other_lights_or_water(scene_file):
    scene = load_scene(scene_file)
    renderer = FrameRenderer(scene, "cpu")
    T_w_v, how = simulate(scene).trajectory.T_w_v(0), {"spp": 1, "integrator": "path"}
    first = renderer.render(T_w_v, None, "A", **how).A.radiance
    loaded = renderer.compile_seconds
    edit(scene_file, lights=[LAMP] * 2, water={"jerlov": {"type": "1C"}})
    other = renderer.relit(load_scene(scene_file)).render(T_w_v, None, "A", **how).A.radiance
    assert renderer.compile_seconds == loaded
    np.testing.assert_array_equal(renderer.render(T_w_v, None, "A", **how).A.radiance, first)
    assert not np.allclose(other, first)


def test_a_mesh_that_is_saved_is_a_change_too(scene_file, counted):
    mesh = scene_file.with_name("box.obj")
    screen = watch(scene_file, lambda: write_box(mesh, 1.2), viewpoint=Viewpoint(width=48))
    assert (screen.images[0] != screen.images[1]).any()
    np.testing.assert_array_equal(screen.images[1], fresh(scene_file))
    assert counted == {"built": 2, "simulated": 1}


def test_a_calibration_that_is_saved_is_a_change_too(scene_file, counted):
    """A broken one keeps the picture, and the next good one goes on."""
    file = scene_file.with_name("chain.yaml")

    def calibrate(f: int):
        file.write_text(
            f"cam0: {{camera_model: pinhole, intrinsics: [{f}, 70, 47.5, 26.5], distortion_model: none, "
            "resolution: [96, 54]}"
        )

    calibrate(70)
    edit(scene_file, cameras=[{"id": "L0", "rotation_euler_deg": [-25, 0, 0], "calibration": "chain.yaml"}])
    screen = watch(scene_file, lambda: file.write_text("cam0: {"), lambda: calibrate(35), viewpoint=Viewpoint(width=48))
    assert len(screen.images) == 2
    assert (screen.images[0] != screen.images[1]).any()
    np.testing.assert_array_equal(screen.images[1], fresh(scene_file))
    assert counted == {"built": 1, "simulated": 1}


def test_a_broken_save_keeps_the_picture_and_says_why(scene_file, counted, capsys):
    """A key that is unknown, YAML that is none, a mesh that is missing; the next good save goes on."""
    good, mesh = scene_file.read_text(), scene_file.with_name("box.obj")
    pictures = []

    def after(*steps):
        def run():
            pictures.append((scene_file.parent / "out" / "preview.png").read_bytes())
            for step in steps:
                step()

        return run

    screen = watch(
        scene_file,
        after(lambda: scene_file.write_text(good.replace("cone_deg", "cone"))),
        after(lambda: scene_file.write_text(good + "\n  ]")),
        after(lambda: scene_file.write_text(good), lambda: mesh.rename(mesh.with_suffix(".old"))),
        after(lambda: mesh.with_suffix(".old").rename(mesh)),
        viewpoint=Viewpoint(width=48),
    )
    assert len(set(pictures)) == 1
    assert len(screen.images) == 2
    unknown, yaml_error, missing = screen.told
    assert "scene.yaml" in unknown
    assert "vehicle.lights.0.spot.cone" in unknown or "vehicle.lights.0.cone" in unknown
    assert "Did you mean 'cone_deg'?" in unknown
    assert "is not valid YAML" in yaml_error
    assert "box.obj" in missing
    assert [f"varos-warp: {words}" for words in screen.told] == capsys.readouterr().err.strip().splitlines()
    assert counted == {"built": 2, "simulated": 1}  # the second failed for want of the mesh, the first served again


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--frame", 11], "--frame = 11: there is no such frame. The sequence has frames 0 to 10."),
        (["--time", 60], "--time = 60.0: is not on the course."),
        (["--time", "nan"], "--time = nan: is not on the course."),
        (["--time", 0.5, "--frame", 1], "--frame and --time: cannot be given together."),
        (["--camera", "X9"], "--camera = 'X9': no such camera. There are: L0, R0."),
        (["--set", "vehicle.lights.0.cone_deg=-1"], "vehicle.lights.0.cone_deg = -1"),
    ],
)
def test_what_cannot_be_shown_at_first_ends_it_with_status_2(scene_file, tmp_path, arguments, words):
    result = call(scene_file, "-o", tmp_path / "out", "--device", "cpu", *arguments)
    assert result.exit_code == 2
    assert words in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_dataset_is_no_folder_for_it(scene_file, tmp_path):
    (tmp_path / "dataset.json").write_text("{}")
    result = call(scene_file, "-o", tmp_path)
    assert result.exit_code == 2
    assert "is a dataset" in result.stderr


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_an_interruption_is_status_130_and_leaves_whole_files_only(scene_file, tmp_path):
    code = (
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
        "from varos_warp.cli import main; main()"
    )
    out = tmp_path / "out"
    process = subprocess.Popen(
        [sys.executable, "-c", code, "preview", scene_file, "-o", out, "--width", "48"],
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )
    deadline = time.monotonic() + 60
    while not (out / "preview.png").exists() and time.monotonic() < deadline and process.poll() is None:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, text = process.communicate(timeout=30)
    assert process.returncode == 130, text
    assert "Traceback" not in text
    assert [path.name for path in out.iterdir()] == ["preview.png"]
    assert Image.open(out / "preview.png").convert("RGB").size == (48, 27)


# --------------------------------------------------------------------------------------------------------- refinement


def image_of(samples: np.ndarray) -> RadianceImage:
    """An image of samples [n, H, W, 3]."""
    variance = samples.var(axis=0, ddof=1) / len(samples) if len(samples) > 1 else np.full_like(samples[0], np.inf)
    mean = samples.mean(axis=0)
    return RadianceImage(mean, np.sqrt(variance), correction=0.5 * mean, base_variance=variance, spp=len(samples))


def test_images_are_added_by_their_samples():
    """The mean is that of all samples; the variance is expected to be that of one, over their number."""
    rng = np.random.default_rng(1)
    samples = rng.gamma(2.0, 1.5, (32, 40, 40, 3)).astype(np.float32)
    both = added(image_of(samples[:8]), image_of(samples[8:]))
    np.testing.assert_allclose(both.radiance, samples.mean(axis=0), rtol=1e-6)
    np.testing.assert_allclose(both.correction, 0.5 * samples.mean(axis=0), rtol=1e-6)
    assert both.spp == 32
    for variance in (both.stderr**2, both.base_variance):
        each = variance - 2.0 * 1.5**2 / 32
        assert abs(each.mean()) < 4.0 * each.std() / np.sqrt(each.size)


@pytest.mark.parametrize(("most", "totals"), [(1, [1]), (2, [1, 2]), (16, [1, 2, 4, 8, 16]), (11, [1, 2, 4, 8, 11])])
def test_samples_double(most, totals):
    rng = np.random.default_rng(2)
    images = refined(lambda spp, frame: image_of(rng.random((spp, 2, 2, 3), np.float32)), most)
    assert [image.spp for image in images] == totals


def test_slow_samples_come_in_steps_of_two_seconds(monkeypatch):
    """One takes 0.3 s of a clock that only rendering moves; and no frame's random numbers are used twice."""
    clock, asked = [0.0], []
    monkeypatch.setattr(module.time, "monotonic", lambda: clock[0])

    def render(spp, frame):
        clock[0] += 0.3 * spp
        asked.append((frame, spp))
        return image_of(np.ones((spp, 2, 2, 3), np.float32))

    assert [image.spp for image in refined(render, 20)] == [1, 2, 4, 8, 14, 20]
    assert asked == [(0, 1), (1, 2), (2, 2), (3, 4), (4, 6), (5, 6)]


def test_an_image_that_is_known_is_not_refined(scene_file):
    edit(scene_file, lights=[])
    screen = Screen(scene_file.parent / "out", lambda: None)
    preview(scene_file, screen, device="cpu", quiet=True, once=True)
    assert len(screen.images) == 1
    assert not screen.images[0].any()


# -------------------------------------------------------------------------------------------------------------- Rerun


def test_the_viewer_gets_every_save_as_a_step(scene_file, tmp_path):
    if not os.environ.get("CI"):
        pytest.importorskip("rerun.dataframe")
    import rerun
    from rerun.dataframe import load_recording

    stream = rerun.RecordingStream("test")
    stream.save(tmp_path / "test.rrd")
    screen = RerunScreen(stream)
    preview(scene_file, screen, Viewpoint(width=48), spp=1, device="cpu", quiet=True, once=True)
    before = fresh(scene_file)
    edit(scene_file, water="none")
    preview(scene_file, screen, Viewpoint(width=48), spp=1, device="cpu", quiet=True, once=True)
    stream.disconnect()
    recording = load_recording(tmp_path / "test.rrd")
    shown = [
        row
        for row in recording.view(index="save", contents="/world/camera/A").select().read_all().to_pylist()
        if row["save"] is not None
    ]
    assert [row["save"] for row in shown] == [0, 1]
    for row, pixels in zip(shown, (before, fresh(scene_file)), strict=True):
        buffer = next(value for name, value in row.items() if name.endswith("buffer"))
        np.testing.assert_array_equal(np.frombuffer(bytes(buffer[0]), np.uint8), pixels.ravel())
    course = recording.view(index="save", contents="/world/course").select().read_all()
    assert len(course) == 2
    assert len(recording.view(index="save", contents="/world/camera/B").select().read_all()) == 2


def test_without_rerun_and_folder_there_is_one_clear_message(scene_file, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    result = call(scene_file)
    assert result.exit_code == 2
    assert "varos_warp[view]" in result.stderr
    assert "-o FOLDER" in result.stderr


def test_a_folder_that_cannot_be_written_ends_it(scene_file, tmp_path):
    (tmp_path / "out").write_text("a file")
    with pytest.raises(InputError, match="cannot be written"):
        preview(scene_file, FolderScreen(tmp_path / "out"), Viewpoint(width=48), spp=1, device="cpu", quiet=True)


def test_a_course_along_an_object_is_driven_anew_when_the_object_moves(scene_file, counted):
    along = {
        "kind": "hull_following",
        "surface": "objects.0",
        "distance_m": 1.0,
        "through": [[-0.1, 0, 0.3], [0.1, 0, 0.3]],
    }
    edit(scene_file, trajectory={"pattern": along})
    moved = [{"file": "box.obj", "position": [0, 2.3, 0.3]}]
    screen = watch(scene_file, lambda: edit(scene_file, objects=moved), viewpoint=Viewpoint(width=48))
    np.testing.assert_array_equal(screen.images[1], fresh(scene_file))
    assert counted == {"built": 2, "simulated": 2}


@pytest.mark.parametrize("change", ["file", "camera"])
def test_a_recorded_course_is_followed_anew_when_its_file_or_the_camera_that_it_is_of_changes(
    scene_file, counted, change
):
    def write(height):
        scene_file.with_name("course.txt").write_text(f"0 0 0 {height} 0 0 0 1\n1 0 0.5 {height} 0 0 0 1\n")

    write(1.0)
    cameras = yaml.safe_load(scene_file.read_text())["vehicle"]["cameras"]
    edit(scene_file, trajectory={"file": "course.txt", "of": "R0"})
    moved = [cameras[0], cameras[1] | {"position": [0.4, 0, 0], "rotation_euler_deg": [0, 0, 0]}]
    save = {"file": lambda: write(1.3), "camera": lambda: edit(scene_file, cameras=moved)}[change]
    screen = watch(scene_file, save, viewpoint=Viewpoint(width=48))
    np.testing.assert_array_equal(screen.images[1], fresh(scene_file))
    assert (screen.images[0] != screen.images[1]).any()
    assert counted == {"built": 1, "simulated": 2}
