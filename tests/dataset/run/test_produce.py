"""However a dataset is made, in one go, in shards or after interruptions, the same bytes end up on the disk."""

import json
import os
import shutil
import time

import numpy as np
import pytest
from standins import FlatFloorRenderer, install, make_scene, scene_dict, tree

from varos_warp.dataset import files
from varos_warp.dataset.progress import Console, Progress
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.timing import BESIDE, MAIN
from varos_warp.dataset.write.folder import claimed
from varos_warp.errors import InputError
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.sim.clock import select


def run(out, render=None, *, stop_after=None, scene=None, **options):
    """Produce with a renderer whose calls are counted."""
    scene = scene or make_scene(render=render)
    renderer = FlatFloorRenderer(scene)
    renderer.stop_after = stop_after
    summary = produce(scene, out, quiet=True, renderer=renderer, **options)
    return summary, renderer.calls


def times(root):
    return {p: p.stat().st_mtime_ns for p in root.rglob("*") if p.is_file()}


def test_a_plain_run_makes_every_image_of_every_camera(written):
    data = Dataset(written)
    for camera in data.cameras:
        for output in "ABCD":
            assert len(list((data.layout.camera_dir(camera) / output).glob("*.png"))) == 10
    assert (written / "contact_sheet.png").is_file()
    assert not list(written.rglob(".*"))


@pytest.mark.parametrize(("cameras", "unit"), [(1, "frames"), (2, "views")])
def test_progress_counts_frames_or_each_view_of_several_cameras(tmp_path, monkeypatch, cameras, unit):
    made = []
    monkeypatch.setattr(Console, "progress", lambda self, *what: made.append(what) or Progress(*what, quiet=True))
    data = scene_dict()
    data["vehicle"]["cameras"] = data["vehicle"]["cameras"][:cameras]
    data["render"]["outputs"] = ["D"]
    run(tmp_path, scene=scene_from_dict(data), frames=slice(0, 3))
    assert made[-1] == ("rendering", 3 * cameras, unit)


def test_running_twice_changes_nothing_and_renders_nothing(written, tmp_path):
    out = shutil.copytree(written, tmp_path / "copy")
    before = times(out)
    summary, calls = run(out)
    assert calls == []
    assert times(out) == before
    assert (summary.rendered, summary.kept, summary.complete) == (0, 80, True)


@pytest.mark.parametrize("count", [2, 3])
def test_shards_in_any_order_give_the_bytes_of_a_plain_run(written, tmp_path, count):
    for index in reversed(range(count)):
        summary, calls = run(tmp_path, shard=(index, count))
        assert summary.complete == (index == 0)
        assert {frame for frame, _, _ in calls} == set(range(index, 10, count))
    assert tree(tmp_path) == tree(written)


def test_an_unfinished_shard_writes_no_adaptive_image_and_says_what_is_missing(tmp_path):
    summary, _ = run(tmp_path, shard=(0, 2))
    assert "40 images belong to other shards" in summary.messages[-1]
    assert not list(tmp_path.rglob("A/*.png"))
    assert not (tmp_path / "contact_sheet.png").exists()


@pytest.mark.parametrize("stop_after", [0, 1, 7, 19])
def test_an_interrupted_run_leaves_only_whole_files_and_resumes_to_the_same_bytes(written, tmp_path, stop_after):
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path, stop_after=stop_after)
    assert not list(tmp_path.rglob(".*"))
    assert all(files.is_complete(p) for p in tmp_path.rglob("*") if p.suffix in (".png", ".exr"))
    _, calls = run(tmp_path)
    assert len(calls) == 20 - stop_after
    assert tree(tmp_path) == tree(written)


def test_frames_rendered_range_by_range_give_the_bytes_of_a_plain_run(written, tmp_path):
    """The gains of the first frames follow from more frames later, so their images are exposed anew."""
    run(tmp_path, frames=slice(0, 4))
    assert len(Dataset(tmp_path)) == 4
    assert len(list(tmp_path.rglob("A/*.png"))) == 8
    _, calls = run(tmp_path, frames=slice(2, None))
    assert {frame for frame, _, _ in calls} == set(range(4, 10))
    assert tree(tmp_path) == tree(written)


def test_a_smaller_range_after_an_interrupted_run_is_finished_by_itself(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path, stop_after=4)
    summary, calls = run(tmp_path, frames=slice(0, 3))
    assert summary.complete
    assert len(calls) == 2
    assert len(list(tmp_path.rglob("cam0/A/*.png"))) == 3


@pytest.mark.parametrize(("first", "others"), [("D", "ABC"), ("A", "BCD")])
def test_outputs_can_be_added_later_without_rendering_the_others_again(written, tmp_path, first, others):
    run(tmp_path, {"outputs": [first]})
    assert {path.parent.name[0] for path in tmp_path.rglob("*-0*")} == {first}
    _, calls = run(tmp_path)
    assert {letters for _, _, letters in calls} == {others}
    ours, theirs = tree(tmp_path), tree(written)
    assert ours == theirs


def test_a_new_exposure_is_made_from_what_is_rendered(written, tmp_path):
    out = shutil.copytree(written, tmp_path / "copy")
    before = Dataset(out).pixels("A", 3)
    _, calls = run(out, {"exposure": {"A": 0.01, "B": 2.0}})
    assert calls == []
    after = Dataset(out)
    assert after.gain("A", 3) == 0.01
    assert after.pixels("A", 3).mean() < before.mean()
    assert after.gain("B", 3) == 2.0
    run(out)
    assert tree(out) == tree(written)


@pytest.mark.parametrize("suffix", ["D-00000002.png", "C-00000002.png", "A-00000002.exr", "B-00000002.png"])
def test_a_truncated_image_is_made_again(written, tmp_path, suffix):
    out = shutil.copytree(written, tmp_path / "copy")
    path = next(p for p in out.rglob(f"*camR0_{suffix}"))
    path.write_bytes(path.read_bytes()[:-20])
    _, calls = run(out)
    expected = [] if suffix.startswith("B") else [(2, "R0", suffix[0])]
    assert calls == expected
    assert tree(out) == tree(written)


def test_a_damaged_table_is_written_again(written, tmp_path):
    out = shutil.copytree(written, tmp_path / "copy")
    for name in ("camL0_exposure_A.csv", "camL0_timestamps.csv", "imu0_data.csv", "camL0.yaml"):
        path = next(out.rglob(name))
        path.write_bytes(path.read_bytes()[:-25])
    _, calls = run(out)
    assert calls == []
    assert tree(out) == tree(written)


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"render": {"spp": 16}}, "render.spp: .*made with 8, not 16"),
        ({"render": {"denoise": "none"}}, "render.denoise"),
        ({"seed": 4}, "seed: .*made with 3, not 4"),
        ({"surface_depth_m": 81.0}, "surface_depth_m"),
        ({"objects": [{"kind": "bolt", "size": "M24"}]}, "objects"),
    ],
)
def test_a_dataset_of_another_scene_is_refused_naming_the_key(written, change, key):
    before = times(written)
    with pytest.raises(InputError, match=key + ".*Give the same scene and options, another folder"):
        run(written, scene=make_scene(**change))
    assert times(written) == before


def test_a_mesh_file_that_changed_is_refused(tmp_path):
    mesh = tmp_path / "m.ply"
    mesh.write_text("one")
    scene = make_scene(objects=[{"file": str(mesh)}], render={"outputs": ["D"]})
    run(tmp_path / "out", scene=scene)
    mesh.write_text("two")
    with pytest.raises(InputError, match=r"contents of.*m\.ply"):
        run(tmp_path / "out", scene=scene)


def test_a_folder_of_something_else_is_refused_and_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("words")
    with pytest.raises(InputError, match="not empty and holds no dataset"):
        run(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]


def test_a_run_is_refused_while_another_one_is_at_the_folder_and_writes_nothing(tmp_path):
    with claimed(tmp_path):
        with pytest.raises(InputError, match=r"another run is writing to this folder.*Wait for it"):
            run(tmp_path)
        assert [path.suffix for path in tmp_path.iterdir()] == [".lock"]
    assert run(tmp_path, {"outputs": ["D"]})[0].complete


def test_an_output_path_that_is_a_file_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        run(tmp_path / "file")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission_is_refused(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="Permission denied"):
        run(tmp_path / "out")


def test_a_disk_that_fills_up_ends_with_a_message_and_only_whole_files(tmp_path, monkeypatch):
    """The tenth image finds no space."""
    written = []

    def full(path, data, original=files.write_bytes):
        written.append(path)
        if len([p for p in written if p.suffix == ".png"]) > 10:
            with files.atomic(path) as temp:
                temp.write_bytes(data[:10])
                raise OSError(28, os.strerror(28))
        return original(path, data)

    monkeypatch.setattr(files, "write_bytes", full)
    with pytest.raises(InputError, match=r"No space left on device.*Free some space"):
        run(tmp_path)
    assert not list(tmp_path.rglob(".*.tmp"))
    assert all(files.is_complete(p) for p in tmp_path.rglob("*.png"))


def test_a_corrupt_dataset_json_is_refused(written, tmp_path):
    out = shutil.copytree(written, tmp_path / "copy")
    (out / "dataset.json").write_text("{")
    with pytest.raises(InputError, match=r"dataset.json: cannot be read.*Make the dataset anew"):
        run(out)
    (out / "dataset.json").write_text('{"schema_version": 1}')
    with pytest.raises(InputError, match=r"dataset.json.*missing or damaged"):
        run(out)


def test_simulating_first_and_rendering_later_gives_the_same_dataset(written, tmp_path):
    run(tmp_path, images=False)
    assert not list(tmp_path.rglob("*.png"))
    assert (tmp_path / "vehicle0" / "imu0" / "imu0_data.csv").is_file()
    run(tmp_path)
    assert tree(tmp_path) == tree(written)


def test_frames_only_leaves_the_sensors_out(tmp_path):
    run(tmp_path, {"outputs": ["C"]}, sensors=False)
    assert list(tmp_path.rglob("C/*.png"))
    assert not list(tmp_path.rglob("imu0"))


def test_standard_errors_that_were_not_kept_are_asked_for_with_a_remedy(written):
    with pytest.raises(InputError, match="standard errors were not kept"):
        _ = Dataset(written)[0].A_stderr


def test_the_raw_estimate_is_kept_with_its_error_and_layers_when_asked_for(tmp_path):
    scene = make_scene(render={"linear_exr": True, "depth_exr": True})
    run(tmp_path, scene=scene, frames=slice(0, 1))
    data = Dataset(tmp_path)
    channels = files.read_exr(data.layout.linear("L0", 0))
    image = FlatFloorRenderer(scene).render(
        np.eye(4), "L0", "AD", spp=8, max_scatterings=None, max_bounces=None, layers=(), frame=0
    )
    assert channels["G"].dtype == np.float32
    np.testing.assert_array_equal(data[0, "L0"].A_stderr[..., 2], channels["stderr.B"])
    assert {"direct.R", "single.B", "stderr.G"} <= set(channels)
    depth = files.read_exr(data.layout.exr("L0", "D", 0))
    assert set(depth) == {"Z", "range"}
    assert np.isinf(depth["Z"]).sum() == np.isinf(image.D.depth).sum() > 0


def test_a_nan_from_the_renderer_is_our_failure_and_names_the_frame(tmp_path):
    class Broken(FlatFloorRenderer):
        def render(self, *args, **options):
            image = super().render(*args, **options)
            image.A.radiance[3, 4, 1] = np.nan
            return image

    scene = make_scene(render={"denoise": "none"})
    with pytest.raises(RuntimeError, match=r"frame 1, camera L0, image A: .* NaN"):  # the third job
        produce(scene, tmp_path, quiet=True, renderer=Broken(scene))


def test_light_beyond_half_floats_is_cut_and_counted(tmp_path):
    class Bright(FlatFloorRenderer):
        def render(self, *args, **options):
            image = super().render(*args, **options)
            image.A.radiance[3, 4:6, 1] = 1e6
            return image

    scene = make_scene(render={"denoise": "none", "outputs": ["A"]})
    summary = produce(scene, tmp_path, quiet=True, renderer=Bright(scene), frames=slice(0, 3))
    assert any("12 values of A above 65504" in m for m in summary.messages)


def test_values_that_were_cut_are_counted_whichever_thread_cut_them(tmp_path, monkeypatch):
    class Slow(int):
        def __radd__(self, other):
            time.sleep(0.05)
            return int(self) + other

    monkeypatch.setattr("varos_warp.dataset.write.images.to_half", lambda image: (image.astype(np.float16), Slow(1)))
    summary, _ = run(tmp_path, {"denoise": "none", "outputs": ["A"]}, frames=slice(0, 3))
    assert any(m.startswith("6 values of A above") for m in summary.messages), summary.messages


@pytest.mark.parametrize("up", [True, False])
def test_a_camera_that_looks_into_open_water_is_named_at_the_end(tmp_path, up):
    data = scene_dict()
    camera = data["vehicle"]["cameras"][1]
    camera["rotation_euler_deg"] = [90 if up else -90, 0, 0]
    data["render"]["outputs"] = ["C", "D"]
    summary, _ = run(tmp_path, scene=scene_from_dict(data), frames=slice(0, 3))
    told = [m for m in summary.messages if "no surface in sight" in m]
    words = f"camera {camera['id']} has no surface in sight in 3 frames (0, 1, 2): C, D hold nothing there"
    assert told == [words] * up


def test_the_denoiser_that_was_really_used_is_recorded_and_not_mixed_with_another(tmp_path, monkeypatch):
    monkeypatch.setattr("varos_warp.dataset.run.steps.available_method", lambda method: "nlm")
    run(tmp_path, {"denoise": "oidn"}, frames=slice(0, 1))
    assert Dataset(tmp_path).meta["samples"]["denoise"] == "nlm"
    assert Dataset(tmp_path).meta["scene"]["render"]["denoise"] == "oidn"
    monkeypatch.setattr("varos_warp.dataset.run.steps.available_method", lambda method: method)
    run(tmp_path, {"denoise": "oidn"}, frames=slice(0, 1))  # nothing is left to denoise
    before = times(tmp_path)
    with pytest.raises(InputError, match=r"samples.denoise: .*denoised with 'nlm', .*'oidn'"):
        run(tmp_path, {"denoise": "oidn"}, frames=slice(0, 2))
    assert times(tmp_path) == before


def test_a_denoiser_is_recorded_when_it_is_first_used(tmp_path):
    run(tmp_path, {"outputs": ["D"]})
    assert Dataset(tmp_path).meta["samples"]["denoise"] is None
    run(tmp_path)
    assert Dataset(tmp_path).meta["samples"]["denoise"] == "nlm"


def test_going_on_on_another_device_is_said_and_the_first_one_stays_on_record(tmp_path):
    class Other(FlatFloorRenderer):
        device, device_name = "cuda:0", "a GPU"

    scene = make_scene(render={"outputs": ["C"]})
    run(tmp_path, scene=scene, frames=slice(0, 1))
    summary = produce(scene, tmp_path, quiet=True, renderer=Other(scene), frames=slice(0, 2))
    assert any("cpu (numpy)" in m and "cuda:0 (a GPU)" in m and "rounding" in m for m in summary.messages)
    assert Dataset(tmp_path).meta["device"] == {"name": "cpu", "model": "numpy"}
    again, _ = run(tmp_path, scene=scene, frames=slice(0, 3))
    assert not any("rounding" in m for m in again.messages)


def test_the_log_tells_how_long_each_frame_took(written):
    logs = list((written / "log").glob("*.json"))
    assert len(logs) == 1
    content = json.loads(logs[0].read_text())
    assert len(content["frames"]) == 20
    assert all(frame["seconds"] >= 0 for frame in content["frames"])


def test_the_log_and_the_summary_tell_where_the_time_went(tmp_path, capsys):
    """The stages one after the other make up the whole, but for the texts."""
    summary = produce(make_scene(), tmp_path)
    logged = json.loads(next((tmp_path / "log").glob("*.json")).read_text())["stages"]
    assert logged == summary.stages
    assert set(logged) == {*MAIN, *BESIDE}
    assert 0.5 * summary.seconds < sum(logged[stage] for stage in MAIN) <= summary.seconds
    assert logged["denoise"] > 0 < logged["encode"]
    assert "time: " in (text := capsys.readouterr().err)
    assert "; beside it, in all threads: denoise" in text


@pytest.mark.parametrize("frames", [slice(10, None), slice(3, 3)])
def test_an_empty_choice_of_frames_is_bad_input(frames):
    with pytest.raises(InputError, match=r"names no frame.*0 to 9"):
        select(frames, 10)


@pytest.mark.parametrize(("frames", "told"), [(slice(2, 11), True), (slice(2, 10), False), (slice(2, None), False)])
def test_frames_beyond_the_end_are_told_of(tmp_path, frames, told):
    scene = make_scene()
    summary = produce(scene, tmp_path, frames=frames, quiet=True, images=False)
    assert any("the sequence ends with frame 9" in message for message in summary.messages) == told, summary.messages


def test_warnings_of_a_scene_are_told_before_what_keeps_it_from_being_loaded(tmp_path, monkeypatch, capsys):
    class Full(FlatFloorRenderer):
        def __init__(self, *_):
            raise InputError("out of memory")

    install(monkeypatch)
    monkeypatch.setattr("varos_warp.render.renderer.FrameRenderer", Full)
    monkeypatch.setattr("varos_warp.scene.checks.check_scene", lambda *_: ["terrain: 2000 km across"])
    with pytest.raises(InputError, match="out of memory"):
        produce(make_scene(), tmp_path / "out", device="cpu")
    assert "note: terrain: 2000 km across" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
