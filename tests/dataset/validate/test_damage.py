"""Every kind of damage is named: by the checksums, and, without them, by what the rest of the dataset says.

The scene has hills, so that C and D tell one frame from another; the camera moves 5 cm from frame to frame.
"""

import json
import shutil

import numpy as np
import pytest
import yaml
from hills import hills_scene

from varos_warp.dataset import files
from varos_warp.dataset.layout import READINGS
from varos_warp.dataset.noise_pass import add_noise
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.validate import Validation, completeness, validate, views
from varos_warp.dataset.write import checksums, tables
from varos_warp.dataset.write import texts as writers
from varos_warp.errors import InputError
from varos_warp.scene.file.noise_profiles import load_profile


@pytest.fixture
def copy(hilly, tmp_path):
    return shutil.copytree(hilly, tmp_path / "copy")


@pytest.fixture
def copy_of_d(hills, tmp_path):
    """Of tables and D alone, which is quicker."""
    return shutil.copytree(hills("D"), tmp_path / "copy")


def test_hills_are_sound(hilly):
    result = validate(hilly, quiet=True)
    assert result.problems == []
    assert result.files_hashed == len(checksums.listed_files(hilly))
    assert result.files_read == 10 * (2 + 2 + 1 + 2 + 1)  # PNG and EXR of A, B and D, C, S


# ------------------------------------------------------------------------------------------------------------- damages


def png(root, letter, frame):
    return Dataset(root).layout.image("M0", letter, frame)


def exr(root, letter, frame):
    return Dataset(root).layout.exr("M0", letter, frame)


def swap(one, other):
    kept = one.read_bytes()
    one.write_bytes(other.read_bytes())
    other.write_bytes(kept)


def drop_depth_exr(root):
    """So that nothing but the other frames tells of D."""
    shutil.rmtree(exr(root, "D", 0).parent)
    change_meta(root, lambda meta: meta["scene"]["render"].update(depth_exr=False))


def change_meta(root, change):
    meta = json.loads((root / "dataset.json").read_text())
    change(meta)
    files.write_json(root / "dataset.json", meta)


def cell(path, row, column, change):
    """Change one cell of a table."""
    table = files.read_csv(path)
    name = column if isinstance(column, str) else list(table)[column]
    values = table[name].tolist()
    values[row] = change(values[row])
    files.write_csv(path, list(table), *[values if n == name else c.tolist() for n, c in table.items()])


def layout(root):
    return Dataset(root).layout


def missing_frame(root):
    png(root, "A", 4).unlink()


def missing_exr(root):
    exr(root, "B", 4).unlink()


def swapped_a(root):
    swap(png(root, "A", 3), png(root, "A", 4))


def swapped_a_exr(root):
    swap(exr(root, "A", 3), exr(root, "A", 4))


def swapped_b_altogether(root):
    swap(png(root, "B", 3), png(root, "B", 5))
    swap(exr(root, "B", 3), exr(root, "B", 5))


def swapped_c(root):
    swap(png(root, "C", 3), png(root, "C", 5))


def swapped_s(root):
    swap(png(root, "S", 3), png(root, "S", 5))


def swapped_d(root):
    drop_depth_exr(root)
    swap(png(root, "D", 6), png(root, "D", 8))


def d_of_the_frame_before(root):
    drop_depth_exr(root)
    png(root, "D", 6).write_bytes(png(root, "D", 5).read_bytes())


def d_not_its_exr(root):
    swap(png(root, "D", 3), png(root, "D", 4))


def truncated_png(root):
    png(root, "C", 4).write_bytes(png(root, "C", 4).read_bytes()[:-30])


def truncated_exr(root):
    exr(root, "A", 4).write_bytes(exr(root, "A", 4).read_bytes()[:-30])


def damaged_inside(root):
    """Its end is there, its middle is not."""
    data = bytearray(png(root, "D", 4).read_bytes())
    data[len(data) // 2 : len(data) // 2 + 64] = bytes(64)
    png(root, "D", 4).write_bytes(bytes(data))


def exr_of_another_frame(root):
    exr(root, "A", 7).write_bytes(exr(root, "A", 2).read_bytes())


def flipped_c(root):
    files.write_png(png(root, "C", 4), files.read_png(png(root, "C", 4))[:, ::-1])


def flipped_c_everywhere(root):
    for frame in range(10):
        files.write_png(png(root, "C", frame), files.read_png(png(root, "C", frame))[:, ::-1])


def normals_into_the_ground(root):
    for frame in range(10):
        files.write_png(png(root, "C", frame), 255 - files.read_png(png(root, "C", frame)))


def deleted_sensor_file(root):
    layout(root).sensor("imu0").unlink()


def stray_file(root):
    shutil.copy(png(root, "A", 1), png(root, "A", 1).with_name("copy.png"))


def edited_imu(root):
    cell(layout(root).sensor("imu0"), 57, 3, lambda x: x + 0.05)


def edited_first_imu_row(root):
    cell(layout(root).sensor("imu0"), 0, 5, lambda x: x + 1e-4)


def edited_imu_time(root):
    cell(layout(root).sensor("imu0"), 57, 0, lambda t: t + 2_000_000)


def edited_depth_gauge(root):
    cell(layout(root).sensor("depth0"), 57, 1, lambda x: x + 0.001)


def edited_matrix(root):
    cell(layout(root).poses("M0", "transformation_matrix"), 4, 4, lambda x: x + 0.001)


def edited_euler(root):
    cell(layout(root).poses("vehicle", "euler"), 57, 6, lambda x: x + 1e-6)


def edited_quaternion(root):
    cell(layout(root).poses("imu0", "quaternion"), 57, 1, lambda x: x + 1e-6)


def edited_states(root):
    cell(layout(root).states, 57, 4, lambda x: x + 0.01)


def edited_lights(root):
    cell(layout(root).lights, 5, 3, lambda x: x + 0.001)


def exposures(root):
    return layout(root).camera_file("M0", "_exposure_A.csv")


def edited_gain(root):
    cell(exposures(root), 4, "gain", lambda x: 1.01 * x)


def edited_statistics(root):
    cell(exposures(root), 4, "log_average", lambda x: 1.01 * x)


def shortened_exposures(root):
    exposures(root).write_text("".join(exposures(root).read_text().splitlines(keepends=True)[:-2]))


def edited_timestamps(root):
    cell(layout(root).camera_file("M0", "_timestamps.csv"), 5, 0, lambda t: t + 1)


def edited_pose_time(root):
    for form in ("euler", "transformation_matrix", "quaternion"):
        cell(layout(root).poses("M0", form), 5, 0, lambda t: t + 5_000_000)


def edited_file_name(root):
    cell(layout(root).camera_file("M0", "_timestamps.csv"), 5, "C", lambda name: name.replace("05", "06"))


def changed_k(root):
    change_meta(root, lambda meta: meta["cameras"][0]["K_center_half"][0].__setitem__(0, 100.0))


def changed_focal_length_everywhere(root):
    """K, YAML and scene say the same wrong focal length."""
    meta = json.loads((root / "dataset.json").read_text())
    meta["scene"]["vehicle"]["cameras"][0]["focal_mm"] *= 1.15
    from varos_warp.scene.file.load import scene_from_dict

    about = writers.describe_camera(layout(root), scene_from_dict(meta["scene"]).vehicle.cameras[0])
    meta["cameras"] = json.loads(json.dumps([about]))
    files.write_json(root / "dataset.json", meta)
    layout(root).camera_file("M0", ".yaml").write_text(yaml.safe_dump(meta["cameras"][0]))


def wrong_depth_scale_everywhere(root):
    drop_depth_exr(root)

    def change(meta):
        meta["depth"]["range_m"][1] = meta["scene"]["render"]["depth_range_m"][1] = 30.0
        meta["depth"]["scale_m"] = 30.0 / 65535

    change_meta(root, change)


def edited_camera_yaml(root):
    path = layout(root).camera_file("M0", ".yaml")
    path.write_text(path.read_text().replace("focal_length: 3.4", "focal_length: 3.5"))


def edited_water(root):
    change_meta(root, lambda meta: meta["water"]["sigma_a"].__setitem__(0, 0.2))


def not_a_number_in_an_exr(root):
    path = exr(root, "A", 4)
    channels = {name: values.copy() for name, values in files.read_exr(path).items()}
    channels["G"][3, 3] = np.nan
    path.unlink()
    files.write_exr(path, channels)


BY_IMAGES = {
    "D": {
        swapped_d: [
            "D-00000006.png: does not fit the frames about it",
            "D-00000008.png: does not fit the frames about it",
        ],
        d_of_the_frame_before: ["D-00000006.png: does not fit the frames about it"],
        d_not_its_exr: ["D-00000003.png: is not its EXR", "D-00000004.png: is not its EXR"],
        damaged_inside: ["D-00000004.png: cannot be read"],
        deleted_sensor_file: ["imu0_data.csv: there is no such file"],
        edited_imu: [
            "vehicle0/imu0/imu0_data.csv:59: a_RS_S_z = ",
            ": is not what vehicle0_states.csv makes it",
            "imu0_data.csv:59: a_RS_S_z = ",
            ": its specific force is not that of the poses",
        ],
        edited_first_imu_row: [
            "vehicle0/imu0/imu0_data.csv:2: w_RS_S_y = ",
            ": is not what vehicle0_states.csv makes it",
        ],
        edited_imu_time: ["imu0: poses and readings have different time stamps"],
        edited_depth_gauge: ["vehicle0/depth0/depth0_data.csv:59: d_v_w = ", ": its depth is not that of the poses"],
        edited_matrix: [
            "camM0_poses/camM0_poses_transformation_matrix.csv:6: s_x_vw = ",
            ": is not the pose that the other two files",
        ],
        edited_euler: ["vehicle0_poses_euler.csv:59: theta_z_vw = ", ": is not the pose that the other two files"],
        edited_quaternion: ["imu0_poses_quaternion.csv:59: s_x_vw = ", ": is not the pose that the other two files"],
        edited_states: ["vehicle0_states.csv:59: v_wv_x = ", ": its velocity is not that of the poses"],
        edited_lights: ["lights: against the vehicle's poses"],
        edited_timestamps: ["vehicle0/cam0/camM0_timestamps.csv:7: timestamp = 500000001: is not 500000000 ns"],
        edited_pose_time: ["camM0_poses_euler.csv:7: timestamp = 505000000: is not 500000000 ns"],
        changed_k: ["dataset.json: cameras.0.K_center_half.0.0 is 100.0, but its scene makes it"],
        changed_focal_length_everywhere: ["M0: D of frames 9 apart, median"],
        wrong_depth_scale_everywhere: ["M0: D of frames 9 apart, median"],
        edited_camera_yaml: ["camM0.yaml: focal_length is 3.5, in dataset.json 3.4"],
        edited_water: ["dataset.json: water.sigma_a.0 is 0.2, but its scene makes it 0.1"],
    },
    "CDS": {
        swapped_c: [
            "C-00000003.png: does not fit the frames about it",
            "C-00000005.png: does not fit the frames about it",
        ],
        swapped_s: [
            "S-00000003.png: does not fit the frames about it",
            "S-00000005.png: does not fit the frames about it",
        ],
        truncated_png: ["C-00000004.png: cannot be read: it is not a whole PNG"],
        flipped_c: ["C-00000004.png: does not fit the frames about it"],
        flipped_c_everywhere: ["C against the slopes of D"],
        normals_into_the_ground: ["of its normals point away from the camera"],
        edited_file_name: ["camM0_timestamps.csv:7: C = seq01_veh0_camM0_C-00000006.png: is not seq01_"],
    },
    "A": {
        missing_frame: ["A-00000004.png: there is no such file"],
        swapped_a: [
            "A-00000003.png: is not its EXR with the gain of the exposure table; it is that of frame 4",
            "A-00000004.png: is not its EXR with the gain of the exposure table; it is that of frame 3",
        ],
        swapped_a_exr: [
            "A-00000003.exr: is not the image that was exposed: neither its PNG nor its row of the "
            "exposure table; it is that of frame 4",
            "A-00000004.exr: is not the image that was exposed",
        ],
        truncated_exr: ["A-00000004.exr: cannot be read: it is not a whole EXR"],
        exr_of_another_frame: [
            "A-00000007.exr: is not the image that was exposed: neither its PNG nor its row of the "
            "exposure table; it is that of frame 2"
        ],
        stray_file: ["A/copy.png: dataset.json does not account for it"],
        edited_gain: ["vehicle0/cam0/camM0_exposure_A.csv:6: gain = ", ": the gain of frame 4 does not follow"],
        edited_statistics: [
            "vehicle0/cam0/camM0_exposure_A.csv:6: log_average = ",
            ": log_average and highlight of frame 4 are not those of its EXR",
        ],
        shortened_exposures: ["camM0_exposure_A.csv: 8 rows, not 10"],
        not_a_number_in_an_exr: ["A-00000004.exr: has values that are not finite"],
    },
    "BD": {
        missing_exr: ["B-00000004.exr: there is no such file"],
        swapped_b_altogether: [
            "B-00000003.png and seq01_veh0_camM0_B-00000003.exr: are not those of the exposure "
            "table; it is that of frame 5",
            "B-00000005.png: does not fit the frames about it",
        ],
    },
}
"""Problems that a damage makes, by the images of the dataset: as few as tell."""
DAMAGE = [(images, damage) for images, damages in BY_IMAGES.items() for damage in damages]


@pytest.mark.parametrize(("images", "damage"), DAMAGE, ids=[damage.__name__ for _, damage in DAMAGE])
def test_damage_is_named(hills, tmp_path, images, damage):
    copy = shutil.copytree(hills(images), tmp_path / "copy")
    before = {path: path.read_bytes() for path in checksums.listed_files(copy)}
    damage(copy)
    found = Validation(copy)
    completeness.check_checksums(Dataset(copy), found, completeness.Pending())
    for path in set(before) | set(checksums.listed_files(copy)):
        name = path.relative_to(copy).as_posix()
        same = path.is_file() and before.get(path) == path.read_bytes()
        assert same != any(problem.startswith(f"{name}: ") for problem in found.problems), name
    (copy / "checksums").unlink()
    text = "\n".join(validate(copy, quiet=True).problems)
    for problem in BY_IMAGES[images][damage]:
        assert problem in text


def test_the_limit_beside_a_measure_of_neighbours_is_the_one_that_is_used(hilly):
    """A tenth of the points (S: a hundredth) or five times the median, not the share among independent pixels."""
    measures = {measure["name"]: measure for measure in validate(hilly, quiet=True).measures}
    for letter in "CSB":
        found = measures[f"M0: {letter} against neighbours, points that differ"]
        assert found["limit"] == pytest.approx(min(53.8, max(views.LEAST[letter] * 100, 5 * found["value"]))), letter


@pytest.mark.parametrize(("damage", "most"), [(edited_imu, 3), (edited_first_imu_row, 1), (edited_depth_gauge, 1)])
def test_one_changed_cell_is_not_many_problems(copy_of_d, damage, most):
    (copy_of_d / "checksums").unlink()
    damage(copy_of_d)
    assert len(validate(copy_of_d, quiet=True).problems) <= most


@pytest.mark.parametrize(
    ("column", "entry", "problem"),
    [
        (3, "x1", "vehicle0/imu0/imu0_data.csv:59: a_RS_S_z = 'x1': is not a number"),
        (0, "0.5", "vehicle0/imu0/imu0_data.csv:59: timestamp = 0.5: is not a whole number"),
        (3, "1,2", "vehicle0/imu0/imu0_data.csv:59: cannot be read: a row of 8 entries, not 7"),
    ],
)
def test_an_entry_that_is_no_number_is_named_with_its_line(copy_of_d, column, entry, problem):
    path = layout(copy_of_d).sensor("imu0")
    lines = path.read_text().splitlines()
    cells = lines[58].split(",")
    lines[58] = ",".join([*cells[:column], entry, *cells[column + 1 :]])
    path.write_text("\n".join(lines) + "\n")
    assert any(found.startswith(problem) for found in validate(copy_of_d, quiet=True).problems)


def test_a_damaged_list_of_checksums_hides_no_missing_image(copy):
    (copy / "checksums").write_text("not a list\n")
    missing_frame(copy)
    text = "\n".join(validate(copy, quiet=True).problems)
    assert "checksums: is not a list of SHA-256 sums" in text
    assert "A-00000004.png: there is no such file" in text


def test_only_the_damaged_frames_are_named(copy):
    (copy / "checksums").unlink()
    for damage in (swapped_a, swapped_c, swapped_d):
        damage(copy)
    problems = validate(copy, quiet=True).problems
    named = {
        (letter, frame)
        for letter in "ABCD"
        for frame in range(10)
        if any(f"{letter}-{frame:08d}.png" in problem for problem in problems)
    }
    assert named == {("A", 3), ("A", 4), ("C", 3), ("C", 5), ("D", 6), ("D", 8)}


# --------------------------------------------------------------------------------------------- what only one check sees


def test_a_small_bias_of_the_accelerometer_is_seen_by_integration(copy_of_d):
    """Half the limit of the differences; the states are left out, which would tell at once."""
    path = layout(copy_of_d).sensor("imu0")
    table = files.read_csv(path)
    name = list(table)[1]
    files.write_csv(path, list(table), *[c + 5e-4 if n == name else c for n, c in table.items()])
    text = "\n".join(p for p in validate(copy_of_d, quiet=True).problems if "states" not in p and "checksum" not in p)
    assert "position against poses" in text
    assert "differences" not in text
    assert "specific force" not in text


def test_an_a_that_was_replaced_altogether_is_seen_by_checksums_only(copy):
    """Nothing else knows what A shows: PNG, EXR and exposure row of one frame are those of the next."""
    table = files.read_csv(exposures(copy))
    for name in ("gain", "log_average", "highlight"):
        cell(exposures(copy), 4, name, lambda _, name=name: table[name].tolist()[5])
    for path in (png, exr):
        path(copy, "A", 4).write_bytes(path(copy, "A", 5).read_bytes())
    change_meta(copy, lambda m: [b["exposure"].update(A=1.0) for b in (m["color"], m["scene"]["render"])])
    assert any("A-00000004.png: is not as it was written" in problem for problem in validate(copy, quiet=True).problems)
    (copy / "checksums").unlink()
    rest = [problem for problem in validate(copy, quiet=True).problems if "exposure 1.0" not in problem]
    assert rest == []


def test_sensors_that_are_all_gone_are_missed_by_checksums_only(copy_of_d):
    for path in layout(copy_of_d).vehicle_dir.glob("[!c]*"):
        if path.name != "lights0":
            shutil.rmtree(path)
    assert any(
        "imu0_data.csv: there is no such file" in problem for problem in validate(copy_of_d, quiet=True).problems
    )
    (copy_of_d / "checksums").unlink()
    assert validate(copy_of_d, quiet=True).problems == []


# --------------------------------------------------------------------------------------------------------- with noise


@pytest.fixture
def noisy(hilly, tmp_path):
    return add_noise(hilly, load_profile("low_light_rov"), tmp_path / "noisy", seed=3, quiet=True)


@pytest.fixture
def noisy_sensors(hills, tmp_path):
    """With A alone, whose noise a profile has beside that of sensors."""
    return add_noise(hills("A"), load_profile("low_light_rov"), tmp_path / "noisy", seed=3, quiet=True)


def test_a_dataset_with_noise_is_sound(noisy):
    result = validate(noisy.root, quiet=True)
    assert result.problems == []
    assert {"imu0: white noise of the gyroscope, off by", "depth0: reading off truth and bias, at most"} <= {
        measure["name"] for measure in result.measures
    }


def unlinked(path):
    """A file of its own, not one shared with the dataset without noise."""
    data = path.read_bytes()
    path.unlink()
    path.write_bytes(data)
    return path


def test_damage_to_noise_and_to_truth_is_told_apart(noisy):
    (noisy.root / "checksums").unlink()
    cell(noisy.layout.sensor("imu0"), 57, 1, lambda x: x + 1.0)
    cell(noisy.layout.sensor("imu0"), 90, 7, lambda x: x + 0.05)
    swap(noisy.layout.image("M0", "A", 3), noisy.layout.image("M0", "A", 4))
    for frame in (6, 7):
        unlinked(noisy.layout.clean("M0", frame))
    swap(noisy.layout.clean("M0", 6), noisy.layout.clean("M0", 7))
    text = "\n".join(validate(noisy.root, quiet=True).problems)
    for problem in (
        "imu0_data.csv:59: a_RS_S_x = ",
        ": its acceleration is off by more than noise can be",
        "imu0_data.csv:92: ",
        ": is not what vehicle0_states.csv makes it",
        "A-00000003.png: is not its EXR with the noise of dataset.json",
        "A_clean/seq01_veh0_camM0_A-00000006.png: is not its EXR with the gain of the exposure table; "
        "it is that of frame 7",
    ):
        assert problem in text


def rewrite(noisy, name, white=1.0, bias=1.0):
    """A sensor's readings with a part of their noise, and the bias that is then in them."""
    read, truth, bias_in = noisy.readings(name), noisy.readings(name, truth=True), noisy.bias(name)
    part = {key: bias * bias_in[key] for key in READINGS[name]}
    made = {key: truth[key] + white * (read[key] - truth[key] - bias_in[key]) + part[key] for key in READINGS[name]}
    tables.write_readings(noisy.layout, name, read | made, truth, part)


@pytest.mark.parametrize(
    ("damage", "problem"),
    [
        (lambda noisy: rewrite(noisy, "imu0", bias=0.0), "imu0: readings against profile and seed"),
        (lambda noisy: rewrite(noisy, "imu0", white=0.0), "imu0: white noise of the accelerometer"),
        (lambda noisy: rewrite(noisy, "depth0", bias=0.0), "depth0: readings against profile and seed"),
        (lambda noisy: rewrite(noisy, "depth0", white=0.0), "depth0: readings against profile and seed"),
        (
            lambda noisy: change_meta(
                noisy.root, lambda meta: meta["sensors"]["imu0"]["noise"].update(gyroscope_random_walk=0.5)
            ),
            "sensors.imu0.noise.gyroscope_random_walk is 0.5",
        ),
    ],
)
def test_noise_that_is_not_that_of_profile_and_seed_is_found(noisy_sensors, damage, problem):
    noisy = noisy_sensors
    (noisy.root / "checksums").unlink()
    damage(noisy)
    assert problem in "\n".join(validate(noisy.root, quiet=True).problems)


def test_no_run_goes_on_in_a_dataset_with_noise(noisy):
    with pytest.raises(InputError, match=r"noise was added.*made of"):
        produce(hills_scene(), noisy.root, quiet=True)


# -------------------------------------------------------------------------------------------------------- steep camera


@pytest.mark.parametrize("off", [0.0, 1e-9, 3e-8, 1e-7, 3e-7, 1e-6, 1e-5])
def test_a_pitch_of_nearly_ninety_degrees_is_sound(copy_of_d, off):
    """Euler angles lose digits within 1e-7 rad of it."""
    from scipy.spatial.transform import Rotation

    from varos_warp.dataset.validate.motion import check_poses

    data = Dataset(copy_of_d)
    time_ns, T = data.poses("M0")
    T[:, :3, :3] = Rotation.from_euler("xyz", [[0.3, np.pi / 2 - off, 0.7]]).as_matrix()
    tables.write_poses(data.layout, "M0", time_ns, T)
    found = Validation(copy_of_d)
    check_poses(Dataset(copy_of_d), found)
    assert found.problems == []
