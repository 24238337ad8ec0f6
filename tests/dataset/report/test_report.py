"""What the report says of a dataset is what the dataset holds; it fits on a page, and names from outside stay text."""

import base64
import hashlib
import io
import json
import re
import shutil

import markupsafe
import numpy as np
import pytest
from PIL import Image
from standins import make_scene, tree
from typer.testing import CliRunner

from varos_warp.cli import app
from varos_warp.dataset import files
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.report import write_report
from varos_warp.dataset.report.course import SceneParts, course_pictures, ground_points, scene_parts
from varos_warp.dataset.report.curves import attenuation, curve, curves, envelope
from varos_warp.dataset.report.facts import headline, numbers, warnings
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.validate.outcome import Validation
from varos_warp.dataset.write.pictures import contact_sheet, filmstrip, preview, spread


@pytest.fixture(scope="module")
def data(written):
    return Dataset(written)


@pytest.fixture(scope="module")
def page(written, tmp_path_factory):
    return write_report(Dataset(written), tmp_path_factory.mktemp("report") / "report.html").read_text()


@pytest.fixture
def copy(written, tmp_path):
    return shutil.copytree(written, tmp_path / "copy")


def content(page: str) -> dict:
    """What the page's scripts read."""
    return json.loads(re.search(r'id="data">(.*?)</script>', page, re.DOTALL)[1])


# ---------------------------------------------------------------------------------------------------------- the page


def test_the_page_names_nothing_outside_itself(page):
    assert not re.findall(r'(?:src|href)\s*=\s*"(?!#|data:)[^"]', page)
    assert "http:" not in page
    assert "https:" not in page
    assert "default-src 'none'" in page


def test_every_section_is_on_the_page_and_every_word_filled_in(page):
    for title in ("Frames", "Course", "Sensors and exposure", "Water, cameras, sensors", "Plan", "Rendering"):
        assert f"<h2>{title}</h2>" in page
    assert not re.search(r"\{\{\w+\}\}", page)
    assert "a test" in page  # the planner's reason


def test_the_page_carries_every_image_of_a_short_dataset(page, data):
    shown = content(page)
    assert shown["frames"] == data.frames
    assert shown["times"] == (data.time_ns() * 1e-9).tolist()
    assert {camera: {o: len(strip) for o, strip in images.items()} for camera, images in shown["images"].items()} == {
        camera: dict.fromkeys("ABCD", 10) for camera in ("L0", "R0")
    }
    assert [plot["title"] for plot in shown["plots"]] == [
        "Specific force",
        "Angular velocity",
        "Depth gauge",
        "Speed",
        "Exposure gain",
        "Rendering",
    ]


@pytest.mark.parametrize("name", ["<script>alert(1)</script>", "</script><b>", "{{data}}", "$& \\1 {{nav}}"])
def test_names_from_the_scene_cannot_break_the_page(written, tmp_path, name, page):
    data = Dataset(written)
    data.meta["name"] = name
    found = write_report(data, tmp_path / "report.html").read_text()
    assert found.count("<script") == page.count("<script")
    assert found.count("</script>") == page.count("</script>")
    assert content(found)["frames"] == data.frames


def marked(content):
    """The same with a tag in every text and name that comes from outside."""
    if isinstance(content, dict):
        return {key: marked(value) for key, value in content.items()}
    if isinstance(content, list):
        return [marked(value) for value in content]
    return content + MARK if isinstance(content, str) else content


MARK = "<mark onclick='x'>&\""


def test_no_text_of_a_dataset_is_taken_for_html(copy, tmp_path):
    """Each text of dataset.json that it may have, and every one of the logs and of what validate found."""
    Validation(copy, ["a problem"]).keep()
    for path in [*(copy / "log").glob("*.json")]:
        files.write_json(path, marked(files.read_json(path)))
    meta = files.read_json(copy / "dataset.json")
    names = {key: meta[key] for key in ("sequence", "vehicle", "outputs", "depth", "cameras")}  # they name files
    denoisers = {key: meta["samples"][key] for key in ("denoise", "denoise_b")}  # which have a few names only
    integrator = {"integrator": meta["samples"]["plan"]["integrator"]}  # likewise
    samples = marked(meta["samples"]) | denoisers
    samples["plan"] |= integrator
    files.write_json(copy / "dataset.json", marked(meta) | names | {"samples": samples})
    data = Dataset(copy)
    data.meta["samples"] |= marked(denoisers)  # as if one of them got past the reader
    data.meta["sources"] = {MARK: MARK}
    data.meta["versions"][MARK] = MARK
    page = write_report(data, tmp_path / "report.html").read_text()
    assert "<mark" not in page
    for text in ("A denoised with ", "Given as ", "A problem", "device"):
        assert text.lower() in page.lower()
    assert f"denoised with nlm{markupsafe.escape(MARK)}" in page


def test_no_script_runs_that_is_not_the_pages_own(page):
    """Whatever came onto the page, the browser runs only what has this hash."""
    script = re.search(r"<script>(.*?)</script>", page, re.DOTALL)[1]
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'; " in page


def test_a_partial_dataset_is_shown_with_what_is_there_and_what_is_missing(copy, tmp_path):
    shutil.rmtree(copy / "vehicle0/cam0/A")
    shutil.rmtree(copy / "log")
    for path in copy.rglob("*_exposure_*.csv"):
        path.unlink()
    (copy / "log").mkdir()
    (copy / "log/20260101T000000_host_1.json").write_text('{"frames": [')  # a run that was cut short
    page = write_report(Dataset(copy), tmp_path / "report.html").read_text()
    assert "None yet." in page
    assert "camera L0: A of 10 of 10 frames is missing, the first of frame 0" in page
    assert "No run left a log." in page
    assert "Exposure gain" not in {plot["title"] for plot in content(page)["plots"]}


@pytest.mark.parametrize("options", [{"images": False}, {"sensors": False}])
def test_sensors_without_frames_and_frames_without_sensors_have_a_page(tmp_path, options):
    produce(make_scene(), tmp_path / "data", quiet=True, **options)
    shown = content(write_report(Dataset(tmp_path / "data"), tmp_path / "report.html").read_text())
    titles = {plot["title"] for plot in shown["plots"]}
    assert ("Specific force" in titles) == ("sensors" not in options)
    assert len(shown["frames"]) == (10 if "sensors" in options else 0)


# ------------------------------------------------------------------------------------------------------------ images


def test_a_strip_keeps_to_its_budget_with_fewer_and_smaller_images(data):
    whole = filmstrip(data)
    assert whole.frames == data.frames
    assert whole.width == 48
    size = sum(len(text) * 3 / 4 for outputs in whole.images.values() for strip in outputs.values() for text in strip)
    less = filmstrip(data, budget=int(size / 2.5))
    assert sum(len(t) * 3 / 4 for o in less.images.values() for strip in o.values() for t in strip) <= size / 2.5
    assert 2 <= len(less.frames) < 10
    assert set(less.frames) <= set(data.frames)


def test_depth_has_one_colour_for_one_distance_in_every_image(data):
    found: dict[tuple, list[tuple[float, int]]] = {}
    for frame in data.frames:
        image, depth = np.array(preview(data, "D", frame, "L0", 48, (1.0, 25.0))), data.depth(frame)
        assert (image[np.isinf(depth)] == 0).all()
        for color, metres in zip(image[np.isfinite(depth)].tolist(), depth[np.isfinite(depth)].tolist(), strict=True):
            found.setdefault(tuple(color), []).append((metres, frame))
    shared = [seen for seen in found.values() if len({frame for _, frame in seen}) > 1]
    assert len(shared) > 20
    for seen in shared:  # a step of the 256 colours of 1 to 25 m is 1.3 %; two neighbours may be alike in 8 bits
        assert max(seen)[0] / min(seen)[0] < 25 ** (2 / 256) * 1.001


def test_the_contact_sheet_has_a_row_for_each_camera_and_type(written, tmp_path):
    contact_sheet(Dataset(written), tmp_path / "sheet.png", columns=3, width=96)
    sheet = files.read_png(tmp_path / "sheet.png")
    assert sheet.shape == (2 * 4 * (54 + 2), 3 * 98, 3)
    rows = sheet.reshape(8, 56, -1)
    assert (np.ptp(rows, axis=(1, 2)) > 50).all()


@pytest.mark.parametrize(("count", "expected"), [(1, [5]), (2, [5, 14]), (4, [5, 8, 11, 14]), (50, list(range(5, 15)))])
def test_frames_are_spread_from_first_to_last(count, expected):
    assert spread(list(range(5, 15)), count) == expected


# ------------------------------------------------------------------------------------------------------------ curves


def test_no_peak_of_a_long_recording_is_lost():
    x = np.arange(94_260.0)
    y = np.sin(x / 1000)[:, None] * [1.0, 0.5]
    y[54_321, 0], y[12_345, 1] = 7.0, -9.0
    thin_x, thin_y = envelope(x, y)
    assert len(thin_x) == len(thin_y) == 2000
    assert (np.diff(thin_x) >= 0).all()
    np.testing.assert_array_equal(thin_y.max(axis=0), y.max(axis=0))
    np.testing.assert_array_equal(thin_y.min(axis=0), y.min(axis=0))
    assert abs(thin_x[thin_y[:, 0].argmax()] - 54_321) < 95
    np.testing.assert_array_equal(envelope(x[:2000], y[:2000])[1], y[:2000])


def test_curves_are_the_readings_to_six_digits(data):
    plots = {plot["title"]: plot for plot in curves(data, data.time_ns() * 1e-9)}
    np.testing.assert_allclose(plots["Specific force"]["y"], data.imu()["acceleration"].T, rtol=5e-6)
    np.testing.assert_allclose(plots["Depth gauge"]["y"][0], data.depth_gauge()["depth"], rtol=5e-6)
    np.testing.assert_allclose(plots["Exposure gain"]["y"][0], list(data.gains("A", "L0").values()), rtol=5e-6)
    assert plots["Exposure gain"]["names"] == ["L0 A", "L0 B", "R0 A", "R0 B"]


def test_what_the_page_states_for_a_frame_is_its_own_value_and_not_the_least_around_it():
    x = np.arange(0.0, 100.0, 0.005)
    plot = curve("Speed", "m/s", x, np.sin(x), ["speed"], np.array([0.0, 33.3, 70.0]))
    assert len(plot["x"]) == 2000
    np.testing.assert_allclose(plot["at_frames"], [np.sin(x[[0, 6660, 14000]])], rtol=5e-6)


def test_what_rounding_leaves_is_shown_as_0():
    plot = curve("Specific force", "m/s²", np.arange(3.0), np.array([-2.1e-18, 9.81, 3e-9]), ["x"], np.array([0.0]))
    assert plot["y"] == [[0.0, 9.81, 3e-9]]
    assert plot["at_frames"] == [[0.0]]
    assert numbers((0.1, -6.1e-17, 2.0), "m") == "0.1, 0, 2 m"


def test_waypoints_are_drawn_on_the_course(data):
    again = Dataset(data.root)
    course = again.poses("vehicle")[1][:, :3, 3]
    stops = [{"position": course[i].tolist()} for i in (0, 100, -1)]
    pictures = []
    for trajectory in ({"poses": []}, {"waypoints": stops[:1]}, {"waypoints": stops}):
        again.meta["scene"] = again.meta["scene"] | {"trajectory": trajectory}
        pictures.append(course_pictures(again, SceneParts())["from above"])
    without, first, every = (ink(picture) for picture in pictures)
    assert without < first < every  # also over the marks of start and end


def ink(picture: str) -> int:
    """Black points inside of the frame of a picture."""
    image = decoded(picture)[..., :3]
    return int((image[110:530, 130:800].max(axis=-1) < 20).sum())


def test_water_leaves_what_beer_and_lambert_say(data):
    plot = attenuation(data)
    at = plot["x"].index(10.0)
    expected = 100 * np.exp(-10 * np.add(data.meta["water"]["sigma_a"], data.meta["water"]["sigma_s"]))
    np.testing.assert_allclose([y[at] for y in plot["y"]], expected, rtol=5e-6)


# ------------------------------------------------------------------------------------------------------------- world


def test_the_course_is_drawn_with_the_ground_around_it(tmp_path):
    terrain = {"kind": "procedural", "size_m": 200.0, "resolution": 257}
    objects = [{"kind": "boulder", "position": [1, 4, 7]}, {"kind": "boulder", "position": [90, 90, 7]}]
    scatter = [{"object": {"kind": "boulder"}, "count": 50, "area": [-5, -5, 5, 5]}]
    produce(make_scene(terrain=terrain, objects=objects, scatter=scatter), tmp_path / "data", quiet=True, images=False)
    data = Dataset(tmp_path / "data")
    scene, course = scene_parts(data), data.states()["position"]
    points = ground_points(scene.parts, course)
    assert 500 < len(points) <= 20_000
    assert np.abs(points[:, :2]).max() < 20  # of the boulders that stand high, the near one
    high = points[points[:, 2] > 5.0]
    assert len(high)
    np.testing.assert_allclose(high.mean(axis=0)[:2], [1, 4], atol=0.5)
    pictures = [decoded(picture) for picture in course_pictures(data, scene).values()]
    bare = [decoded(picture) for picture in course_pictures(data, SceneParts()).values()]
    assert len(pictures) == len(bare) == 2
    for with_ground, without in zip(pictures, bare, strict=True):
        assert (with_ground != without).mean() > 0.02


def decoded(picture: str) -> np.ndarray:
    return np.array(Image.open(io.BytesIO(base64.b64decode(picture))))


def test_a_mesh_that_is_no_longer_what_it_was_is_not_drawn(data):
    assert scene_parts(data).missing is None
    again = Dataset(data.root)
    again.meta["scene"] = again.meta["scene"] | {"objects": [{"kind": "mesh", "file": "nowhere.obj"}]}
    assert "nowhere.obj" in scene_parts(again).missing


# ------------------------------------------------------------------------------------------------------------- facts


def test_the_headline_is_measured_on_the_dataset(data):
    tiles = {name: value for value, name in headline(data)}
    course = np.linalg.norm(np.diff(data.states()["position"], axis=0), axis=1).sum()
    assert tiles["frames"] == "10"
    assert tiles["at 10 Hz"] == "1 s"
    assert float(tiles["course"].split()[0]) == pytest.approx(course, rel=5e-3)
    assert tiles["pixels, 2 cameras"] == "48 × 27"


def test_what_runs_said_samples_and_findings_are_told(copy):
    path = next((copy / "log").glob("*.json"))
    log = files.read_json(path)
    log["messages"].append("something was said")
    log["frames"][3]["lost_samples"] = 5
    files.write_json(path, log)
    problem = "seq01: is <not> there"
    outcome = Validation(copy, [problem])
    outcome.measure("IMU against poses", float("nan"), 1e-6, "m/s^2")
    outcome.keep()
    found = warnings(Dataset(copy), ["the scene looks odd"])
    assert found[0] == "the scene looks odd"
    assert "5 samples in 1 frame were" in found[1]
    assert found[2] == f"validate: {problem}"
    page = write_report(Dataset(copy), copy / "report.html").read_text()
    assert "is &lt;not&gt; there" in page
    assert "IMU against poses" in page
    assert "<li>something was said</li>" in page
    assert ": 2 problems</h3>" in page


def test_what_validate_measured_is_in_the_report_and_does_not_change_the_dataset(copy):
    before = tree(copy)
    assert CliRunner().invoke(app, ["validate", str(copy), "-q"]).exit_code == 0
    assert tree(copy) == before
    page = write_report(Dataset(copy), copy.parent / "report.html").read_text()
    assert re.search(r"Validation, 20\d\d-\d\d-\d\d \d\d:\d\d: no problem", page)
    assert CliRunner().invoke(app, ["validate", str(copy), "-q"]).exit_code == 0  # what it left is no problem


def test_many_warnings_are_counted(data):
    found = warnings(data, [f"warning {i}" for i in range(100)])
    assert len(found) == 41
    assert found[-1] == "and 60 more"
