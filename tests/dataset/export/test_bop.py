"""The BOP export, read as bop_toolkit does (docs/bop_datasets_format.md, scripts/calc_gt_info.py there)."""

import json

import meshio
import numpy as np
import pytest
from PIL import Image
from scipy.spatial import distance
from silhouette_truth import NEAR, distances

from varos_warp.dataset.export import export
from varos_warp.errors import InputError

CAMERAS = ("M0", "R0")


@pytest.fixture(scope="module")
def folder(labels_out):
    return labels_out / "bop"


def load(path):
    with path.open() as file:
        return {int(key): value for key, value in json.load(file).items()}


def pixels(path):
    with Image.open(path) as image:
        return np.array(image)


def scene(folder, number):
    at = folder / f"train/{number:06d}"
    return at, *(load(at / f"{name}.json") for name in ("scene_camera", "scene_gt", "scene_gt_info"))


def model(folder, number):
    """Vertices [mm] and faces."""
    mesh = meshio.read(folder / f"models/obj_{number:06d}.ply")
    assert {"nx", "ny", "nz"} <= mesh.point_data.keys()
    return mesh.points.astype(float), mesh.cells_dict["triangle"]


def silhouette(entry, about, mesh, size, aside):
    """Which pixels of the image and of as many around it the rays hit, [3 H, 3 W], by poses and K as the format has
    them: p_i = K (R p_m + t), the centre of the top left pixel at (0, 0).
    """
    R, t = np.reshape(entry["cam_R_m2c"], (3, 3)), np.array(entry["cam_t_m2c"])
    K = np.reshape(about["cam_K"], (3, 3))
    row, col = np.indices((3 * size[0], 3 * size[1])) - np.reshape(size, (2, 1, 1))
    d = np.stack([col + aside[0], row + aside[1], np.ones_like(col, float)], -1).reshape(-1, 3) @ np.linalg.inv(K).T
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    return np.isfinite(distances(mesh[0] @ R.T + t, mesh[1], np.zeros_like(d), d)).reshape(3 * size[0], -1)


def test_poses_models_and_K_make_the_masks(folder, labelled):
    """What surely is, and what may be; a model has none of the growth on objects.0."""
    at, cameras, gt, infos = scene(folder, 0)
    size, frame = (36, 64), 2
    for i, (entry, info) in enumerate(zip(gt[frame], infos[frame], strict=True)):
        mesh = model(folder, entry["obj_id"])
        hit = [
            silhouette(entry, cameras[frame], mesh, size, aside)
            for aside in 10 * NEAR * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
        ]  # models are float32
        surely, perhaps = np.all(hit, 0), np.any(hit, 0)
        here = np.s_[size[0] : 2 * size[0], size[1] : 2 * size[1]]
        mask, seen = (pixels(at / kind / f"{frame:06d}_{i:06d}.png") for kind in ("mask", "mask_visib"))
        assert set(np.unique(mask)) <= {0, 255}
        assert mask[seen > 0].all()
        assert mask[surely[here]].all()
        grown = entry["obj_id"] == gt[frame][0]["obj_id"]
        assert grown or not mask[~perhaps[here]].any()
        assert surely.sum() <= info["px_count_all"]
        assert grown or info["px_count_all"] <= perhaps.sum()
        assert info["px_count_visib"] == np.count_nonzero(seen)
        assert info["visib_fract"] == info["px_count_visib"] / info["px_count_all"]
        assert info["px_count_valid"] == np.count_nonzero(pixels(at / f"depth/{frame:06d}.png")[mask > 0])
        if info["px_count_visib"] and not grown and (surely == perhaps).all():
            row, col = np.nonzero(surely)
            assert info["bbox_obj"] == [col.min() - 64, row.min() - 36, np.ptp(col), np.ptp(row)]
        elif not info["px_count_visib"]:
            assert info["bbox_obj"] == info["bbox_visib"] == [-1] * 4


def test_depth_lies_on_the_models_where_they_are_seen(folder, labelled):
    """Each pixel of mask_visib, at its depth, on the model at its pose: to half a step of depth, and what z may be
    within `NEAR`.
    """
    at, cameras, gt, _ = scene(folder, 0)
    for frame, entries in gt.items():
        K, scale = np.reshape(cameras[frame]["cam_K"], (3, 3)), cameras[frame]["depth_scale"]
        depth = scale * pixels(at / f"depth/{frame:06d}.png").astype(float)
        np.testing.assert_allclose(1e-3 * depth[depth > 0], labelled.depth(frame, "M0")[depth > 0], atol=1e-6)
        for i, entry in enumerate(entries[1:], 1):  # the first has growth
            row, col = np.nonzero(pixels(at / f"mask_visib/{frame:06d}_{i:06d}.png"))
            vertices, faces = model(folder, entry["obj_id"])
            R, t = np.reshape(entry["cam_R_m2c"], (3, 3)), np.array(entry["cam_t_m2c"])
            z = []
            for aside in 10 * NEAR * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]]):
                d = np.column_stack([col + aside[0], row + aside[1], np.ones(len(row))]) @ np.linalg.inv(K).T
                length = np.linalg.norm(d, axis=1)
                z.append(distances(vertices @ R.T + t, faces, np.zeros_like(d), d / length[:, None]) / length)
            near, far, known = np.min(z, 0), np.max(z, 0), depth[row, col]
            slack = scale / 2 + 1e-3  # half a step, and float32 of metres
            assert (known >= near - slack).all()
            assert (known <= far + slack).all()


def test_poses_of_the_camera_and_of_objects_agree_with_the_dataset(folder, labelled):
    _, cameras, gt, _ = scene(folder, 0)
    for i, frame in enumerate(labelled.frames):
        T = np.linalg.inv(labelled.T_w_c(frame, "M0"))
        np.testing.assert_allclose(np.reshape(cameras[frame]["cam_R_w2c"], (3, 3)), T[:3, :3], atol=1e-12)
        np.testing.assert_allclose(cameras[frame]["cam_t_w2c"], 1000 * T[:3, 3], atol=1e-9)
        expected = T @ labelled.poses("objects.3")[1][i]
        assert any(
            np.allclose(entry["cam_t_m2c"], 1000 * expected[:3, 3], atol=1e-9)
            and np.allclose(entry["cam_R_m2c"], expected[:3, :3].ravel(), atol=1e-12)
            for entry in gt[frame]
        )


def test_models_have_their_measures_and_those_that_are_alike_are_one(folder):
    infos = load(folder / "models/models_info.json")
    for number, info in infos.items():
        vertices, _ = model(folder, number)
        assert info["diameter"] == pytest.approx(distance.pdist(vertices).max(), abs=1e-2)
        for k, axis in enumerate("xyz"):
            assert info[f"min_{axis}"] == pytest.approx(vertices[:, k].min(), abs=1e-3)
            assert info[f"size_{axis}"] == pytest.approx(np.ptp(vertices[:, k]), abs=1e-3)
    assert infos[2]["size_z"] == pytest.approx(1600, abs=1e-3)  # the pipe, in its own axes
    assert infos[2]["class"] == "pipe"


def test_each_camera_is_a_scene_with_its_images(folder, labelled):
    for number, camera in enumerate(CAMERAS):
        at, cameras, gt, infos = scene(folder, number)
        assert list(cameras) == list(gt) == list(infos) == labelled.frames
        for frame in labelled.frames:
            assert np.array_equal(pixels(at / f"rgb/{frame:06d}.png"), labelled.pixels("B", frame, camera))
            assert len(list((at / "mask").glob(f"{frame:06d}_*.png"))) == len(gt[frame])
            S = labelled.image("S", frame, camera)
            seen = sorted(np.bincount(S.ravel())[2:][np.bincount(S.ravel())[2:] > 0])
            assert sorted(info["px_count_visib"] for info in infos[frame] if info["px_count_visib"]) == seen


def test_a_camera_with_a_lens_or_a_port_is_refused(labelled, tmp_path):
    with pytest.raises(InputError, match=r"BOP cannot state a port.*it can state M0, R0: choose with --camera M0"):
        export(labelled.root, "bop", tmp_path / "out", "B")
    assert list(tmp_path.iterdir()) == []
