"""A sound dataset passes, and every kind of damage is found and named."""

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from standins import make_scene

from varos_warp.dataset import files
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.validate import validate
from varos_warp.dataset.write import folder
from varos_warp.errors import InputError


@pytest.fixture
def copy(written, tmp_path):
    return shutil.copytree(written, tmp_path / "copy")


def problems(root):
    return "\n".join(validate(root, quiet=True).problems)


def edit(path, change):
    """Change the columns of a CSV and write it back."""
    table = files.read_csv(path)
    change(table)
    files.write_csv(path, list(table), *[c if c.dtype.kind != "U" else c.tolist() for c in table.values()])


def test_a_sound_dataset_has_no_problems_and_its_measures_are_far_below_their_limits(written):
    result = validate(written, quiet=True)
    assert result.problems == []
    assert result.files_read == 10 * 2 * 6
    for measure in result.measures:
        # the bound of the strapdown is that of its trapezoids, doubled: it is meant to be reached by half
        share = 0.51 if "integrated" in measure["name"] else 0.1
        assert measure["value"] < measure["limit"] * share, measure


def test_a_dataset_of_ranges_along_the_ray_is_sound_too(tmp_path):
    produce(make_scene(render={"depth_kind": "range", "outputs": ["C", "D"]}), tmp_path, quiet=True)
    assert problems(tmp_path) == ""


def test_a_dataset_is_sound_where_the_table_of_its_phase_function_is_not(tmp_path):
    """Only the scene's folder has the table; the rest of the water is compared all the same."""
    table = shutil.copy(Path(__file__).parents[3] / "examples" / "every_block" / "phase.csv", tmp_path)
    water = {"jerlov": {"type": "III", "phase": {"kind": "tabulated", "file": str(table)}}}
    produce(make_scene(water=water), tmp_path / "out", quiet=True, frames=slice(0, 2))
    Path(table).unlink()
    assert problems(tmp_path / "out") == ""
    meta = json.loads((tmp_path / "out" / "dataset.json").read_text())
    meta["water"]["sigma_a"][0] = 0.5
    files.write_json(tmp_path / "out" / "dataset.json", meta)
    assert "dataset.json: water.sigma_a.0 is 0.5, but its scene makes it" in problems(tmp_path / "out")


def test_frames_without_sensors_are_sound(tmp_path):
    produce(make_scene(), tmp_path, sensors=False, quiet=True, frames=slice(0, 3))
    assert problems(tmp_path) == ""


@pytest.mark.parametrize(
    "name",
    [
        "imu0_poses_euler.csv",
        "imu0_data.csv",
        "depth0_data.csv",
        "vehicle0_poses_quaternion.csv",
        "vehicle0_states.csv",
    ],
)
def test_a_missing_table_of_one_sensor_is_found_where_there_are_others(copy, name):
    next(copy.rglob(name)).unlink()
    assert f"{name}: there is no such file" in problems(copy)


@pytest.mark.parametrize(
    "damage", [lambda text: text[: len(text) // 2].rsplit("\n", 1)[0] + "\n", lambda text: text.replace("gain", "gian")]
)
def test_a_truncated_exposure_table_is_found(copy, damage):
    path = next(copy.rglob("camL0_exposure_A.csv"))
    path.write_text(damage(path.read_text()))
    assert "camL0_exposure_A.csv" in problems(copy)
    with pytest.raises(InputError, match=r"camL0_exposure_A.csv: .*gain"):
        Dataset(copy).gain("A", 9)


def test_a_dataset_without_images_is_sound(tmp_path):
    produce(make_scene(), tmp_path, images=False, quiet=True)
    assert problems(tmp_path) == ""


def test_noise_in_the_imu_is_allowed_for(tmp_path):
    noise = {"accelerometer_noise_density": 0.01}
    scene = make_scene()
    vehicle = scene.vehicle.model_dump() | {"imu": scene.vehicle.imu.model_dump() | {"noise": noise}}
    produce(make_scene(vehicle=vehicle), tmp_path, images=False, quiet=True)
    assert problems(tmp_path) == ""


def test_a_missing_image_is_found(copy):
    next(copy.rglob("*camL0_C-00000004.png")).unlink()
    assert "camL0_C-00000004.png: there is no such file" in problems(copy)


def test_a_damaged_image_is_found(copy):
    path = next(copy.rglob("*camL0_D-00000004.png"))
    path.write_bytes(path.read_bytes()[:-30])
    assert "camL0_D-00000004.png: cannot be read" in problems(copy)


def test_an_image_of_the_wrong_size_or_type_is_found(copy):
    files.write_png(next(copy.rglob("*camL0_D-00000004.png")), np.zeros((27, 48), np.uint8))
    files.write_png(next(copy.rglob("*camR0_C-00000004.png")), np.zeros((48, 27, 3), np.uint8))
    text = problems(copy)
    assert "camL0_D-00000004.png: is uint8 (27, 48), not uint16 (27, 48)" in text
    assert "camR0_C-00000004.png: is uint8 (48, 27, 3), not uint8 (27, 48, 3)" in text


def test_an_image_that_is_not_its_exr_is_found(copy):
    path = next(copy.rglob("*camL0_A-00000004.png"))
    pixels = files.read_png(path)
    pixels[3, 4, 1] ^= 1
    files.write_png(path, pixels)
    assert "camL0_A-00000004.png: is not its EXR with the gain" in problems(copy)


def test_an_image_of_another_frame_under_this_name_is_found(copy):
    data = Dataset(copy)
    shutil.copy(data.layout.image("L0", "A", 3), data.layout.image("L0", "A", 4))
    assert "camL0_A-00000004.png: is not its EXR" in problems(copy)


@pytest.fixture
def segmented(tmp_path):
    """A dataset with images D and S."""
    scene = make_scene(
        render={"outputs": ["D", "S"]},
        terrain={"kind": "procedural", "material": "checker"},
        materials={"checker": {"kind": "diffuse", "reflectance": [0.5, 0.5, 0.5]}},
    )
    produce(scene, tmp_path, quiet=True, frames=slice(0, 3))
    return tmp_path


def test_segmentation_is_written_with_a_table_of_its_numbers_and_is_sound(segmented):
    data = Dataset(segmented)
    assert data.segments()[0]["key"] == "terrain"
    image = data.image("S", 1)
    assert image.dtype == np.int32
    assert set(np.unique(image)) == {0, 1}
    assert files.read_csv(data.layout.camera_file("L0", "_timestamps.csv"))["S"][2].endswith("S-00000002.png")
    assert problems(segmented) == ""


def test_a_number_that_the_table_does_not_list_is_found(segmented):
    path = Dataset(segmented).layout.image("L0", "S", 1)
    files.write_png(path, files.read_png(path) * 7)
    assert f"{path.name}: segments.json does not list [7]" in problems(segmented)


def test_a_hole_in_the_segmentation_is_found(segmented):
    path = Dataset(segmented).layout.image("L0", "S", 1)
    files.write_png(path, files.read_png(path) * 0)
    assert f"{path.name}: has nothing where D has a surface" in problems(segmented)


def test_strays_and_remains_are_found(copy):
    folder = copy / "vehicle0/cam0/A"
    shutil.copy(folder / "seq01_veh0_camL0_A-00000004.png", folder / "seq01_veh0_camL0_A-00000099.png")
    (folder / ".x.png.host-1-2.tmp").write_bytes(b"")
    text = problems(copy)
    assert "A-00000099.png: dataset.json does not account for it" in text
    assert ".x.png.host-1-2.tmp: remains of an interrupted run" in text


def test_depth_of_a_wrong_scale_is_found_between_views(copy):
    """One view has no scale, but two at a known distance have: half a metre apart and half of it too much."""
    meta = json.loads((copy / "dataset.json").read_text())
    meta["depth"]["range_m"][1] *= 1.5
    (copy / "dataset.json").write_text(json.dumps(meta))
    text = problems(copy)
    assert "C against the slopes of D" not in text
    assert "D of frames 9 apart" in text


def test_camera_poses_of_another_frame_are_found(copy):
    data = Dataset(copy)

    def shift(table):
        for name in list(table)[1:]:
            table[name] = np.roll(table[name], 1)

    edit(data.layout.poses("L0", "transformation_matrix"), shift)
    text = problems(copy)
    assert "L0: attitude, three forms" in text
    assert "camL0_poses_transformation_matrix.csv:2: " in text
    assert "is not the vehicle's with its mounting" in text


def test_camera_axes_of_another_convention_are_found(copy):
    """OpenGL axes (y up, z back) in place of OpenCV's, in all three pose files and the calibration."""
    from varos_warp.dataset.write import tables

    data, flip = Dataset(copy), np.diag([1.0, -1.0, -1.0, 1.0])
    for i, camera in enumerate(data.cameras):
        time_ns, T = data.poses(camera)
        tables.write_poses(data.layout, camera, time_ns, T @ flip)
        data.meta["cameras"][i]["T_v_c"] = (np.array(data.meta["cameras"][i]["T_v_c"]) @ flip).tolist()
    files.write_json(copy / "dataset.json", data.meta)
    assert "of its normals point away from the camera" in problems(copy)


def test_an_accelerometer_with_the_sign_of_gravity_wrong_is_found(copy):
    def flip(table):
        for name in list(table)[1:4]:
            table[name] = -table[name]

    edit(Dataset(copy).layout.sensor("imu0"), flip)
    assert "imu0: specific force against poses" in problems(copy)


def test_a_gyroscope_in_degrees_is_found(copy):
    def degrees(table):
        for name in list(table)[4:]:
            table[name] = np.degrees(table[name])

    edit(Dataset(copy).layout.sensor("imu0"), degrees)
    assert "imu0: angular velocity against poses" in problems(copy)


def test_a_depth_gauge_that_is_off_by_a_millimetre_is_found(copy):
    edit(Dataset(copy).layout.sensor("depth0"), lambda t: t.update({"d_v_w [m]": t["d_v_w [m]"] + 1e-3}))
    assert "its depth is not that of the poses" in problems(copy)


def test_wrong_time_stamps_are_found(copy):
    def later(table):
        table["# timestamp [ns]"] = table["# timestamp [ns]"] + np.arange(10) // 5

    edit(Dataset(copy).layout.camera_file("R0", "_timestamps.csv"), later)
    assert "camR0_timestamps.csv:7: timestamp = 500000001: is not 500000000 ns" in problems(copy)


def test_an_imu_that_ends_before_the_last_frame_is_found(copy):
    data = Dataset(copy)
    for path in [
        data.layout.sensor("imu0"),
        *(data.layout.poses("imu0", f) for f in ("euler", "quaternion", "transformation_matrix")),
    ]:
        edit(path, lambda t: t.update({name: column[:100] for name, column in t.items()}))
    assert "the IMU has no sample after the last frame" in problems(copy)


def test_a_missing_table_is_one_problem_and_the_rest_is_still_checked(copy):
    Dataset(copy).layout.sensor("imu0").unlink()
    next(copy.rglob("*camL0_C-00000004.png")).unlink()
    text = problems(copy)
    assert "imu0_data.csv: there is no such file" in text
    assert "camL0_C-00000004.png: there is no such file" in text


def test_what_is_no_dataset_is_bad_input(tmp_path):
    with pytest.raises(InputError, match="not a dataset"):
        validate(tmp_path)


# ------------------------------------------------------------------------------------------------------- not complete


@pytest.fixture
def part(tmp_path):
    """Frames 0, 3, 6 and 9 of ten, as a run that was interrupted leaves them."""
    produce(make_scene(), tmp_path, quiet=True, shard=(0, 3))
    return tmp_path


NOT_COMPLETE = "not complete: 6 of 10 frames are missing images; "


def test_of_an_interrupted_dataset_one_line_tells(part):
    (part / "vehicle0/cam0/.x.png.host-1-2.tmp").write_bytes(b"")
    result = validate(part, quiet=True)
    assert result.problems == [NOT_COMPLETE + "the same `run` goes on"]
    assert not result.plain()["valid"]
    assert result.files_read == 4 * 2 * 2  # C and D


def test_a_run_that_is_at_it_is_named(part):
    with folder.claimed(part):
        assert problems(part) == NOT_COMPLETE + f"a run is writing there: process {os.getpid()} on {files.HOST}"


def test_what_a_second_run_adds_to_a_complete_dataset_is_not_damage(tmp_path):
    produce(make_scene(), tmp_path, quiet=True, frames=slice(0, 4))
    produce(make_scene(), tmp_path, quiet=True, shard=(0, 3))
    assert problems(tmp_path) == "not complete: 4 of 10 frames are missing images; the same `run` goes on"
    Dataset(tmp_path).layout.image("L0", "C", 2).unlink()
    assert "camL0_C-00000002.png: there is no such file" in problems(tmp_path)


def test_damage_to_what_is_there_is_named_beside_it(part):
    path = Dataset(part).layout.image("L0", "D", 3)
    path.write_bytes(path.read_bytes()[:-30])
    Dataset(part).layout.sensor("imu0").unlink()
    text = problems(part)
    assert text.startswith(NOT_COMPLETE)
    assert "camL0_D-00000003.png: cannot be read" in text
    assert "imu0_data.csv: there is no such file" in text


def test_images_that_are_not_exposed_yet_are_told_of(tmp_path):
    for index in range(2):
        produce(make_scene(), tmp_path, quiet=True, shard=(index, 2))
    for path in [
        tmp_path / "checksums",
        tmp_path / "contact_sheet.png",
        *tmp_path.rglob("*_exposure_A.csv"),
        *tmp_path.rglob("A/*.png"),
    ]:
        path.unlink()
    assert problems(tmp_path) == ("not complete: its images are rendered, but not all exposed; the same `run` goes on")
