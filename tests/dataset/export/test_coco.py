"""The COCO export comes back through pycocotools; panoptic segments by the words of the format's page."""

import json

import numpy as np
import pytest
import trimesh
from PIL import Image
from pycocotools import mask as cocomask
from pycocotools.coco import COCO

from varos_warp.dataset.export import export
from varos_warp.dataset.export.shared.masks import box_of, run_lengths
from varos_warp.dataset.run.produce import produce
from varos_warp.errors import InputError
from varos_warp.scene.file.load import scene_from_dict

pytestmark = pytest.mark.filterwarnings("ignore:__array__ implementation doesn't accept a copy keyword")


@pytest.fixture(scope="module")
def folder(labels_out):
    return labels_out / "coco"


def test_masks_boxes_and_areas_of_what_is_seen_are_those_of_S(folder, labelled):
    coco = COCO(folder / "annotations/instances.json")
    assert len(coco.imgs) == 9
    for entry in coco.imgs.values():
        S = labelled.image("S", entry["frame"], entry["camera"])
        found = coco.imgToAnns[entry["id"]]
        assert {one["object"] for one in found} == set(np.unique(S).tolist()) - {0, 1}
        for one in found:
            mask = coco.annToMask(one).astype(bool)
            np.testing.assert_array_equal(mask, S == one["object"])
            assert one["area"] == mask.sum() == cocomask.area(one["segmentation"])
            assert one["bbox"] == cocomask.toBbox(one["segmentation"]).tolist()
            assert one["iscrowd"] == 0
        with Image.open(folder / "images" / entry["file_name"]) as image:
            assert image.size == (entry["width"], entry["height"])


def test_all_of_an_object_has_what_is_seen_of_it_under_the_same_number(folder):
    seen, whole = (COCO(folder / f"annotations/{name}.json") for name in ("instances", "amodal"))
    assert seen.anns.keys() < whole.anns.keys()
    for number, entry in whole.anns.items():
        mask = whole.annToMask(entry).astype(bool)
        assert entry["area"] == mask.sum() > 0
        assert entry["bbox"] == cocomask.toBbox(entry["segmentation"]).tolist()
        if number not in seen.anns:
            assert entry["visible_share"] == 0.0
            assert entry["visible_bbox"] is None
            continue
        one = seen.anns[number]
        assert mask[seen.annToMask(one).astype(bool)].all()
        assert one["visible_share"] == entry["visible_share"] == one["area"] / entry["area"]
        assert (one["amodal_bbox"], entry["visible_bbox"]) == (entry["bbox"], one["bbox"])
        assert one["T_c_o"] == entry["T_c_o"]


def test_categories_are_the_classes_of_the_scene(folder):
    coco = COCO(folder / "annotations/instances.json")
    assert [entry["name"] for entry in coco.dataset["categories"]] == ["rock", "pipe", "boulder"]
    by_key = {entry["key"]: coco.cats[entry["category_id"]]["name"] for entry in coco.anns.values()}
    assert by_key["objects.0"] == "rock"  # its class
    assert by_key["objects.3"] == "pipe"  # its kind
    assert {name for key, name in by_key.items() if key.startswith("scatter")} == {"boulder"}


def test_panoptic_segments_cover_the_image(folder, labelled):
    """cocodataset.org/#format-data: id = R + 256 G + 256^2 B; 0 is nothing; each id of the PNG is in the JSON."""
    content = json.loads((folder / "annotations/panoptic.json").read_text())
    kinds = {entry["id"]: entry for entry in content["categories"]}
    assert [entry["name"] for entry in kinds.values() if not entry["isthing"]] == ["terrain", "water"]
    images = {entry["id"]: entry for entry in content["images"]}
    for entry in content["annotations"]:
        with Image.open(folder / "annotations/panoptic" / entry["file_name"]) as image:
            rgb = np.array(image, np.uint32)
        ids, of = rgb @ [1, 256, 256**2], images[entry["image_id"]]
        S = labelled.image("S", of["frame"], of["camera"])
        assert {segment["id"] for segment in entry["segments_info"]} == set(np.unique(ids).tolist()) - {0}
        for segment in entry["segments_info"]:
            mask, name = ids == segment["id"], kinds[segment["category_id"]]["name"]
            assert segment["area"] == mask.sum()
            assert segment["bbox"] == box_of(np.flatnonzero(mask), mask.shape[1])
            assert set(np.unique(S[mask]).tolist()) == {0 if name == "water" else segment["id"]}
            assert (name == "terrain") == (segment["id"] == 1)


@pytest.mark.parametrize("kind", ["chance", "full", "first", "last", "one", "stripes", "large"])
def test_run_lengths_are_those_of_pycocotools(kind):
    rng = np.random.default_rng(4)
    mask = {
        "chance": rng.random((37, 53)) < 0.4,
        "full": np.ones((5, 7), bool),
        "first": np.eye(6, 9, dtype=bool),
        "last": np.eye(6, 9, dtype=bool)[::-1, ::-1],
        "one": np.ones((1, 1), bool),
        "stripes": np.arange(40)[None] % 7 < np.full((31, 1), 3),
        "large": np.pad(np.ones((700, 1200), bool), ((10, 10), (2000, 40))),
    }[kind]
    known = cocomask.encode(np.asfortranarray(mask.astype(np.uint8)))
    assert run_lengths(np.flatnonzero(mask), mask.shape)["counts"] == known["counts"].decode()


def test_without_the_files_of_the_scene_what_is_seen_is_exported_alone(labelled, tmp_path, monkeypatch):
    """A dataset from elsewhere: its meshes are not at hand."""
    from varos_warp.dataset.export.shared import labels

    def lost(*_):
        raise InputError("mesh.ply is not at hand, or not as it was")

    monkeypatch.setattr(labels, "rebuilt", lost)
    with pytest.warns(UserWarning, match=r"amodal boxes and visible shares: mesh\.ply is not at hand"):
        export(labelled.root, "coco", tmp_path / "coco", "B", ["M0"])
    assert not (tmp_path / "coco/annotations/amodal.json").exists()
    coco = COCO(tmp_path / "coco/annotations/instances.json")
    assert not any("amodal_bbox" in entry or "visible_share" in entry for entry in coco.anns.values())
    assert any(entry["key"] == "objects.3" and entry["T_c_o"] for entry in coco.anns.values())
    with pytest.raises(InputError, match=r"what is hidden of objects cannot be known: mesh\.ply.*coco and yolo"):
        export(labelled.root, "bop", tmp_path / "bop", "B", ["M0"])
    assert [path.name for path in tmp_path.iterdir()] == ["coco"]


@pytest.mark.parametrize("to", ["coco", "yolo", "bop"])
def test_a_dataset_without_S_is_refused(written, tmp_path, to):
    with pytest.raises(InputError, match=rf"to = '{to}': needs image S.*Add S to render.outputs"):
        export(written, to, tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def of_meshes(tmp_path_factory):
    """Two boxes of a mesh file, one before the other; beside the scene, and in a folder with another of its name."""
    root = tmp_path_factory.mktemp("of_meshes")
    for name, height in (("scenes", 1.0), ("elsewhere", 2.0)):
        (root / name).mkdir()
        trimesh.creation.box([1, 1, height]).export(root / name / "box.ply")
    scene = scene_from_dict(
        {
            "objects": [{"file": "box.ply", "position": [0, 4, 0]}, {"file": "box.ply", "position": [0.4, 2.5, 0]}],
            "vehicle": {"cameras": [{"id": "M0", "resolution": [32, 18]}]},
            "trajectory": {"poses": [{"position": [0, 0, 0]}], "duration_s": 0.1},
            "render": {"frame_rate_hz": 10, "outputs": ["B", "S"], "spp_b": 1, "denoise_b": "none"},
        },
        root / "scenes",
    )
    produce(scene, root / "data", device="cpu", quiet=True)
    return root


def test_meshes_are_found_beside_the_scene_file(of_meshes, tmp_path, monkeypatch):
    """They are relative to it, wherever the export is made; another mesh of their name is not taken for them."""
    monkeypatch.chdir(of_meshes / "elsewhere")
    export(of_meshes / "data", "coco", tmp_path / "found", "B", scene_dir=of_meshes / "scenes")
    coco = COCO(tmp_path / "found/annotations/instances.json")
    shares = {entry["key"]: entry["visible_share"] for entry in coco.anns.values()}
    assert shares["objects.1"] == 1.0 > shares["objects.0"] > 0.0
    with pytest.warns(UserWarning, match=r"box\.ply is not at hand, or not as it was\. .*--scene-dir"):
        export(of_meshes / "data", "coco", tmp_path / "lost", "B")
    with pytest.raises(InputError, match=r"scene_dir = .*no such folder"):
        export(of_meshes / "data", "coco", tmp_path / "none", "B", scene_dir=tmp_path / "nowhere")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["found", "lost"]


def test_alike_meshes_are_one_model(of_meshes, tmp_path):
    export(of_meshes / "data", "bop", tmp_path / "bop", "B", scene_dir=of_meshes / "scenes")
    gt = json.loads((tmp_path / "bop/train/000000/scene_gt.json").read_text())
    assert [entry["obj_id"] for entry in gt["0"]] == [1, 1]
    assert [path.name for path in (tmp_path / "bop/models").glob("*.ply")] == ["obj_000001.ply"]
    assert not (tmp_path / "bop/train/000000/depth").exists()
