"""Damage that no checksum is needed for: one image, all images of a kind, or calibration and poses consistently wrong.

With `test_damage.py` this is the list of docs/validate.md.
"""

import json
import shutil

import numpy as np
import pytest
import standins
import yaml
from hills import SIDES, HillsRenderer, SidesRenderer, hills_scene

from varos_warp.dataset import files
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.validate import Validation, surfaces, validate
from varos_warp.dataset.write import tables
from varos_warp.dataset.write import texts as writers
from varos_warp.products.images.radiance import encode_color, to_half
from varos_warp.render.image import exposure
from varos_warp.scene.file.load import scene_from_dict

FRAMES = range(10)


def images(letter, change, frames=FRAMES):
    """Damage that changes the pixels of some images."""

    def damage(root):
        drop_depth_exr(root)
        for frame in frames:
            path = Dataset(root).layout.image("M0", letter, frame)
            files.write_png(path, np.ascontiguousarray(change(files.read_png(path).copy())))

    return damage


def radiance(letter, change, frames=FRAMES):
    """Damage that changes EXR, PNG and row of the exposure table of an image alike."""

    def damage(root):
        data = Dataset(root)
        path = data.layout.exposures("M0", letter)
        table = files.read_csv(path)
        for frame in frames:
            linear = to_half(change(data.linear(letter, frame)))[0].astype(np.float32)
            exr = data.layout.exr("M0", letter, frame)
            exr.unlink()
            files.write_exr(exr, {c: np.ascontiguousarray(linear[..., i], np.float16) for i, c in enumerate("RGB")})
            known = exposure.statistics(linear)
            table["log_average"][frame], table["highlight"][frame] = known.log_average, known.highlight
            pixels = encode_color(linear, data.gain(letter, frame))
            files.write_png(data.layout.image("M0", letter, frame), pixels)
        files.write_csv(path, list(table), *[c.tolist() for c in table.values()])

    return damage


def drop_depth_exr(root):
    shutil.rmtree(Dataset(root).layout.exr("M0", "D", 0).parent, ignore_errors=True)
    change_json(root, lambda meta: meta["scene"]["render"].update(depth_exr=False))


def change_json(root, change, name="dataset.json"):
    content = json.loads((root / name).read_text())
    change(content)
    files.write_json(root / name, content)


def meta(change):
    return lambda root: change_json(root, change)


def segments(change):
    return lambda root: change_json(root, lambda content: change(content["segments"]), "segments.json")


def text(name, change):
    """Damage to the text of a file."""

    def damage(root):
        path = next(root.rglob(name))
        path.write_text(change(path.read_text()))

    return damage


def table(name, change):
    """Damage to the columns of a table, by number."""

    def damage(root):
        path = next(root.rglob(name))
        content = files.read_csv(path)
        columns = [column.copy() for column in content.values()]
        change(columns)
        files.write_csv(path, list(content), *[c.tolist() for c in columns])

    return damage


def camera(change, T_c_c=None):
    """Damage to a camera in the scene, with everything that follows from it: dataset.json, YAML and poses."""

    def damage(root):
        data, content = Dataset(root), json.loads((root / "dataset.json").read_text())
        before = np.array(content["cameras"][0]["T_v_c"])
        change(content["scene"]["vehicle"]["cameras"][0])
        about = writers.describe_camera(data.layout, scene_from_dict(content["scene"]).vehicle.cameras[0])
        content["cameras"] = json.loads(json.dumps([about]))
        files.write_json(root / "dataset.json", content)
        data.layout.camera_file("M0", ".yaml").write_text(yaml.safe_dump(content["cameras"][0]))
        time_ns, T_w_c = data.poses("M0")
        tables.write_poses(data.layout, "M0", time_ns, T_w_c @ np.linalg.inv(before) @ np.array(about["T_v_c"]))
        vehicle_time, T_w_v = data.poses("vehicle")
        at = T_w_v[np.searchsorted(vehicle_time, time_ns)]
        tables.write_poses(data.layout, "M0", time_ns, at @ np.array(about["T_v_c"]))

    return damage


def moved(axis, metres):
    return camera(lambda about: about["position"].__setitem__(axis, about["position"][axis] + metres))


def turned(axis, degrees):
    return camera(
        lambda about: about["rotation_euler_deg"].__setitem__(axis, about["rotation_euler_deg"][axis] + degrees)
    )


def put(value, where=np.s_[30:36, 60:66]):
    def change(pixels):
        pixels[where] = value
        return pixels

    return change


def flip(axis):
    def change(pixels):
        pixels[..., axis] = 255 - pixels[..., axis]
        return pixels

    return change


def negate(first, last):
    def change(columns):
        for i in range(first, last):
            columns[i] = -columns[i]

    return change


def add(column, value, row=slice(None)):
    def change(columns):
        columns[column][row] += value

    return change


def lines(change):
    return lambda content: "\n".join(change(content.splitlines())) + "\n"


def swap_numbers(pixels):
    return np.where(pixels > 0, 3 - pixels, 0).astype(pixels.dtype)


def swap_ids(rows):
    rows[0]["id"], rows[1]["id"] = rows[1]["id"], rows[0]["id"]


def swap_materials(rows):
    for key in ("material", "material_id"):
        rows[0][key], rows[1][key] = rows[1][key], rows[0][key]


TABLES = {
    "k_in_dataset_json": (meta(lambda m: m["cameras"][0]["K_opencv"][0].__setitem__(2, 70.0)), "K_opencv.0.2 is 70.0"),
    "k_in_yaml": (
        text("camM0.yaml", lambda t: t.replace("width: 144", "width: 145")),
        "camM0.yaml: width is 145, in dataset.json 144",
    ),
    "mount_in_dataset_json": (meta(lambda m: m["cameras"][0]["T_v_c"][0].__setitem__(3, 0.002)), "T_v_c.0.3 is 0.002"),
    "no_distortion_said_otherwise": (
        meta(lambda m: m["cameras"][0].update(distortion="radtan")),
        "camM0.yaml: distortion is 'none', in dataset.json 'radtan'",
    ),
    "w_negative": (table("camM0_poses_quaternion.csv", negate(4, 8)), "camM0_poses_quaternion.csv:2: q_w = -"),
    "w_negative_in_one_row": (
        table("vehicle0_poses_quaternion.csv", lambda c: [x.__setitem__(9, -x[9]) for x in c[4:8]]),
        "vehicle0_poses_quaternion.csv:11: q_w = -",
    ),
    "quaternion_not_of_length_1": (
        table("imu0_poses_quaternion.csv", lambda c: [x.__setitem__(9, 2 * x[9]) for x in c[4:8]]),
        "imu0_poses_quaternion.csv:11: q_w = ",
    ),
    "one_pose_file_later": (
        table("camM0_poses_euler.csv", add(0, 5_000_000)),
        "camM0_poses_euler.csv:2: timestamp = 5000000: is not the time of that row",
    ),
    "one_pose_file_shorter": (
        text("vehicle0_poses_euler.csv", lines(lambda x: x[:-1])),
        "vehicle0_poses_euler.csv: has 200 rows, not 201 as vehicle0_poses_transformation",
    ),
    "empty_table": (text("camM0_poses_euler.csv", lambda _: ""), "camM0_poses_euler.csv: cannot be read: it is empty"),
    "empty_imu": (text("imu0_data.csv", lambda _: ""), "imu0_data.csv: cannot be read: it is empty"),
    "gyroscope_negative": (table("imu0_data.csv", negate(4, 7)), "imu0_data.csv:2: w_RS_S_z = -0.39"),
    "depth_gauge_upwards": (table("depth0_data.csv", negate(1, 2)), "depth0_data.csv:2: d_v_w = -79.8: its depth"),
    "not_a_number_in_imu": (
        text("imu0_data.csv", lines(lambda x: [*x[:9], "nan" + x[9][x[9].index(",") :], *x[10:]])),
        "imu0_data.csv:10: ",
    ),
}
"""Of calibration, poses and sensors."""
GEOMETRY = {
    "d_shifted_1_px_right": (images("D", lambda p: np.roll(p, 1, 1)), "C against the slopes of D, shift"),
    "d_shifted_1_px_down": (images("D", lambda p: np.roll(p, 1, 0)), "C against the slopes of D, shift"),
    "d_mirrored": (images("D", lambda p: p[:, ::-1]), "borders of S at jumps of D, across"),
    "d_8_bit": (images("D", lambda p: p // 256 * 256), "D-00000000.png: holds only one level in 256"),
    "d_8_bit_stretched": (images("D", lambda p: p // 256 * 257), "D-00000000.png: holds only one level in 257"),
    "hole_in_one_d": (images("D", put(65535), [4]), "D-00000004.png: has holes"),
    "hole_in_all_d": (images("D", put(65535)), "D-00000000.png: has holes"),
    "zeros_in_one_d": (images("D", put(0), [4]), "D-00000004.png: is 0 m in 36 pixels"),
    "one_zero_in_one_d": (images("D", put(0, np.s_[30, 60]), [4]), "D-00000004.png: is 0 m in 1 pixels"),
    "d_of_one_value": (images("D", lambda p: np.full_like(p, 9000), [4]), "D-00000004.png: does not fit"),
    "x_of_normals_flipped": (images("C", flip(0)), "C against the slopes of D, x"),
    "y_of_normals_flipped": (images("C", flip(1)), "C against the slopes of D, y"),
    "x_of_one_c_flipped": (images("C", flip(0), [4]), "C-00000004.png: does not fit"),
    "x_and_y_of_normals_swapped": (images("C", lambda p: p[..., [1, 0, 2]]), "C against the slopes of D, x"),
    "c_in_bgr": (images("C", lambda p: p[..., ::-1]), "C against the slopes of D, z"),
    "c_shifted_1_px": (images("C", lambda p: np.roll(p, 1, 1)), "C against the slopes of D, shift"),
    "hole_in_c": (images("C", put(0), [4]), "C-00000004.png: has no surface where D has one"),
    "c_of_one_value": (images("C", lambda p: np.full_like(p, 128)), "C against the slopes of D, y"),
    "ids_of_segments_swapped": (segments(swap_ids), "segments.json: segments.0.id is 2"),
    "materials_of_segments_swapped": (segments(swap_materials), "segments.json: segments.0.material is 'light'"),
    "a_row_of_segments_missing": (
        segments(lambda rows: rows.pop()),
        "segments.json: lists 1 objects, but the scene has 2",
    ),
    "hole_in_s": (images("S", put(0), [4]), "S-00000004.png: has nothing where D has a surface"),
    "unknown_number_in_s": (images("S", put(9), [4]), "segments.json does not list [9]"),
    "s_mirrored": (images("S", lambda p: p[:, ::-1]), "borders of S at jumps of D, across"),
    "numbers_of_one_s_swapped": (images("S", swap_numbers, [4]), "S-00000004.png: does not fit"),
    "numbers_of_objects_around_each_other_swapped": (images("S", swap_numbers), None),
}
"""Of D, C, and S with its table."""
LIGHT = {
    "mount_1_cm_x": (moved(0, 0.01), "systematic shift"),
    "mount_turned_0.1_deg": (turned(0, 0.1), "systematic shift"),
    "mount_rolled_0.2_deg": (turned(1, 0.2), "systematic shift"),
    "focal_length_2_percent": (
        camera(lambda about: about.update(focal_mm=about["focal_mm"] * 0.98)),
        "systematic shift",
    ),
    "d_scaled_by_0.5_percent": (images("D", lambda p: np.rint(p * 1.005).astype(p.dtype)), "systematic shift"),
    "d_off_by_3_cm": (images("D", lambda p: p + p.dtype.type(80)), "systematic shift"),
    "b_shifted_1_px": (radiance("B", lambda x: np.roll(x, 1, 1)), "systematic shift"),
    "one_b_shifted_2_px": (radiance("B", lambda x: np.roll(x, 2, 1), [4]), "B-00000004.png: does not fit"),
    "b_mirrored": (radiance("B", lambda x: x[:, ::-1]), "B against neighbours, points that differ"),
}
"""What only B tells of, changed in PNG, EXR and table alike: also calibration, poses and D, consistently wrong."""
REPLACED = {"a_replaced": (radiance("A", lambda x: x[::-1]), None)}
"""Of A, whatever else there is."""
EVERYWHERE = {
    name: (images, *damage)
    for images, damages in (("D", TABLES), ("CDS", GEOMETRY), ("BD", LIGHT), ("ABCDS", REPLACED))
    for name, damage in damages.items()
}
"""By name: the images of the dataset that is damaged, as few as tell, the damage, and the problem that it makes."""


SHARP = {
    "mount_2_mm_x": (moved(0, 0.002), "systematic shift"),
    "mount_2_mm_y": (moved(1, 0.002), "systematic shift"),
    "focal_length_0.2_percent": (
        camera(lambda about: about.update(focal_mm=about["focal_mm"] * 1.002)),
        "systematic shift",
    ),
}
"""What moves images by a hundredth of a pixel takes a few more pixels."""


def problems_after(damage, dataset, tmp_path):
    """What is found, without checksums, in a damaged copy."""
    root = shutil.copytree(dataset, tmp_path / "copy")
    (root / "checksums").unlink()
    damage(root)
    return validate(root, quiet=True).problems


@pytest.fixture(scope="module")
def sharp(tmp_path_factory):
    """B and D of the hills through a longer lens, at 320x180: 490 pixels a radian in place of 110."""
    out = tmp_path_factory.mktemp("sharp")
    with pytest.MonkeyPatch.context() as patch:
        standins.install(patch)
        scene = hills_scene("BD", resolution=[320, 180], focal_mm=6.8)
        produce(scene, out, quiet=True, renderer=HillsRenderer(scene))
    return out


def test_a_sharp_dataset_is_sound(sharp):
    assert validate(sharp, quiet=True).problems == []


@pytest.mark.parametrize("name", SHARP)
def test_a_tenth_of_a_pixel_is_found(sharp, tmp_path, name):
    damage, problem = SHARP[name]
    assert problem in "\n".join(problems_after(damage, sharp, tmp_path))


def test_numbers_of_two_objects_swapped_everywhere_are_found(tmp_path):
    """Objects of which neither lies in the box of the other: D and the poses tell where each is."""
    scene = hills_scene("DS", objects=SIDES)
    produce(scene, tmp_path / "sides", quiet=True, renderer=SidesRenderer(scene))
    assert validate(tmp_path / "sides", quiet=True).problems == []
    problems = problems_after(images("S", swap_numbers), tmp_path / "sides", tmp_path)
    assert [problem.partition("% of ")[2] for problem in problems] == [
        f"the points of number {n} (objects.{n - 1}) do not lie where the scene has it; "
        f"they lie where number {3 - n} (objects.{2 - n}) is"
        for n in (1, 2)
    ]


@pytest.mark.parametrize("name", ["x_of_normals_flipped", "c_shifted_1_px", "d_shifted_1_px_down"])
def test_bands_of_large_images_tell_as_much(hills, tmp_path, monkeypatch, name):
    """Slopes are looked at in bands of rows only, here two of 24 of the 80."""
    monkeypatch.setattr(surfaces, "MOST_PIXELS", 7000)
    assert surfaces.bands(80, 144) == [slice(18, 42), slice(37, 61)]
    assert validate(hills("CDS"), quiet=True).problems == []
    damage, problem = GEOMETRY[name]
    assert problem in "\n".join(problems_after(damage, hills("CDS"), tmp_path))


@pytest.mark.parametrize("name", EVERYWHERE)
def test_damage_is_found_without_checksums(hills, tmp_path, name):
    images, damage, problem = EVERYWHERE[name]
    problems = problems_after(damage, hills(images), tmp_path)
    assert (problem in "\n".join(problems)) if problem else not problems


def test_more_like_these_counts_only_what_is_new(tmp_path):
    """Files that cannot be read are told of by every check that reads them."""
    found = Validation(tmp_path)
    found.add_all([f"{i}.png: is damaged" for i in range(20)], "images")
    found.add_all([f"{i}.png: is damaged" for i in range(20)] + ["20.png: is damaged"] * 2, "images")
    assert found.problems == [f"{i}.png: is damaged" for i in range(21)]
    found.add_all([f"{i}.png: is damaged" for i in range(29)] + ["19.png: is damaged"], "images")
    assert len(found.problems) == 29


def test_more_than_97_percent_of_the_list_is_found():
    """Of 80 kinds of damage at least 78: what is not is in docs/validate.md."""
    from test_damage import DAMAGE

    missed = [name for name, (*_, problem) in EVERYWHERE.items() if problem is None]
    assert 1 + len(DAMAGE) + len(SHARP) + len(EVERYWHERE) == 94  # one has a test of its own
    assert len(missed) <= 2
