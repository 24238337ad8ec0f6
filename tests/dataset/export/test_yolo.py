"""The YOLO export, read as the format's page says (docs.ultralytics.com/datasets/detect)."""

import csv

import numpy as np
import pytest
import yaml
from PIL import Image

from varos_warp.dataset.export import export
from varos_warp.dataset.run.produce import produce
from varos_warp.errors import InputError
from varos_warp.scene.file.load import scene_from_dict


def load(folder, labels="labels"):
    """Images with their lines, as Ultralytics finds and checks them: all files below ``train`` of data.yaml, each with
    the text of its name where the last ``images`` of its path is ``labels``.
    """
    about = yaml.safe_load((folder / "data.yaml").read_text())
    assert sorted(about["names"]) == list(range(len(about["names"])))
    for image in sorted((folder / about["train"]).rglob("*.*")):
        before, after = str(image).rsplit("/images/", 1)
        text = f"{before}/{labels}/{after.rsplit('.', 1)[0]}.txt"
        with open(text) as file:
            rows = np.array([line.split() for line in file.read().strip().splitlines() if line], np.float32)
        rows = rows.reshape(-1, 5)
        assert (rows[:, 1:] >= 0).all()
        assert (rows[:, 1:] <= 1).all()
        assert set(rows[:, 0]) <= set(about["names"])
        assert len(np.unique(rows, axis=0)) == len(rows)
        yield image, about["names"], rows


def corners(rows, size):
    """Boxes left, top, right, bottom [px] of lines."""
    x, y, w, h = rows[:, 1:].astype(float).T * np.array([*size, *size], float)[:, None]
    return np.column_stack([x - w / 2, y - h / 2, x + w / 2, y + h / 2])


@pytest.fixture(scope="module")
def folder(labels_out):
    return labels_out / "yolo"


def test_boxes_are_those_of_the_pixels_of_S(folder, labelled):
    found = list(load(folder))
    assert len(found) == 9
    for image, names, rows in found:
        assert names == {0: "rock", 1: "pipe", 2: "boulder"}
        camera, frame = image.parent.name[3:], int(image.stem[-8:])
        S = labelled.image("S", frame, camera)
        numbers = np.setdiff1d(np.unique(S), [0, 1])
        with Image.open(image) as opened:
            boxes = corners(rows, opened.size)
        assert len(boxes) == len(numbers)
        for number, box in zip(numbers, boxes, strict=True):
            row, col = np.nonzero(S == number)
            # float32, as Ultralytics reads them
            np.testing.assert_allclose(box, [col.min(), row.min(), col.max() + 1, row.max() + 1], atol=1e-4)


def test_boxes_about_all_of_each_object_enclose_those_about_what_is_seen(folder):
    seen, whole = list(load(folder)), list(load(folder, "labels_amodal"))
    with (folder / "labels.csv").open() as file:
        table = list(csv.DictReader(file))
    assert len(table) == sum(len(rows) for *_, rows in whole) > sum(len(rows) for *_, rows in seen)
    for (image, _, rows), (_, _, more) in zip(seen, whole, strict=True):
        of = [entry for entry in table if entry["image"] == f"images/{image.parent.name}/{image.name}"]
        there = [int(entry["visible_pixels"]) > 0 for entry in of]
        inner, outer = corners(rows, (1, 1)), corners(more[there], (1, 1))
        assert (rows[:, 0] == more[there][:, 0]).all()
        assert (outer[:, :2] <= inner[:, :2] + 1e-6).all()
        assert (outer[:, 2:] >= inner[:, 2:] - 1e-6).all()
        for entry in of:
            assert float(entry["visible_share"]) == int(entry["visible_pixels"]) / int(entry["amodal_pixels"])


@pytest.mark.parametrize("to", ["yolo", "bop"])
def test_a_scene_of_terrain_alone_has_nothing_to_label(tmp_path, to):
    scene = {
        "terrain": {"kind": "procedural", "resolution": 9},
        "vehicle": {"cameras": [{"id": "M0", "resolution": [16, 9]}]},
        "trajectory": {"poses": [{"position": [0, 0, 3]}], "duration_s": 0.1},
        "render": {"frame_rate_hz": 10, "outputs": ["B", "S"], "spp_b": 1, "denoise_b": "none"},
    }
    produce(scene_from_dict(scene), tmp_path / "data", device="cpu", quiet=True)
    with pytest.raises(InputError, match=r"nothing .* but the terrain"):
        export(tmp_path / "data", to, tmp_path / "out", "B")
    assert [path.name for path in tmp_path.iterdir()] == ["data"]
