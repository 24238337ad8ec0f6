"""What labels say is seen and hidden, against float64 rays that are counted one by one."""

import numpy as np
import pytest
from silhouette_truth import truth

from varos_warp.dataset.export.shared.job import Clocked, Job
from varos_warp.dataset.export.shared.labels import WATER_NUMBER, Labels, moved, within
from varos_warp.dataset.run.produce import produce
from varos_warp.scene.file.load import scene_from_dict


@pytest.fixture(scope="module")
def labels(labelled, tmp_path_factory):
    return Labels(Job(Clocked(labelled.root, 0), tmp_path_factory.mktemp("none"), "B", labelled.cameras))


def flat(pixels, shape):
    mask = np.zeros(np.prod(shape), bool)
    mask[pixels] = True
    return mask.reshape(shape)


@pytest.mark.parametrize("camera", ["M0", "M1", "R0"])
def test_what_is_seen_and_what_is_hidden_are_the_rays_that_hit(labels, labelled, camera):
    """Through a pinhole, a fisheye behind a dome, and a rolling shutter past what moves."""
    size = labelled.camera(camera)["height"], labelled.camera(camera)["width"]
    found = {label.thing.number: label for label in labels.of(2, camera)}
    known = truth(labelled, 2, camera)
    del known[1]  # the terrain
    doubt = 0
    for number, (seen, perhaps_seen, whole, perhaps) in known.items():
        if number not in found:
            assert not whole.any(), number
            continue
        label = found[number]
        for pixels, surely, possibly in ((label.visible, seen, perhaps_seen), (label.whole, whole, perhaps)):
            mask = flat(pixels, size)
            assert mask[surely].all(), number
            assert not mask[~possibly].any(), number
            doubt += np.count_nonzero(possibly & ~surely)
        assert seen.sum() / perhaps.sum() <= label.share <= perhaps_seen.sum() / whole.sum()
    assert doubt < 20  # or the test would say nothing
    assert found.keys() <= known.keys()


def test_things_are_half_hidden_wholly_hidden_off_screen_and_moving(labels):
    first, last = ({label.thing.key: label for label in labels.of(frame, "M0")} for frame in (0, 2))
    assert 0.1 < first["objects.0"].share < 0.9
    assert first["objects.1"].share == 1.0
    assert "objects.2" not in first
    assert first["objects.5"].share == 0.0
    assert len(first["objects.5"].visible) == 0 < len(first["objects.5"].whole)
    assert not np.array_equal(first["objects.3"].whole, last["objects.3"].whole)
    assert any(key.startswith("scatter.0.") for key in first)
    assert [label.thing.category for label in first.values()][:3] == ["rock", "pipe", "pipe"]


def test_a_margin_goes_beyond_the_image(labels, labelled):
    """The boulder that leaves the image has more pixels beyond it, and those within are the same."""
    size = labelled.camera("M0")["height"], labelled.camera("M0")["width"]
    inside, beyond = ({label.thing.key: label for label in labels.of(0, "M0", margin)} for margin in ((0, 0), size))
    assert inside.keys() == beyond.keys()
    for key, label in inside.items():
        larger = beyond[key].whole
        here = larger[within(larger, size, size)]
        np.testing.assert_array_equal(here, moved(label.whole, size, size))
    assert len(beyond["objects.4"].whole) > 1.2 * len(inside["objects.4"].whole)


def test_poses_put_each_object_where_its_pixels_are(labels, labelled):
    """The middle of a boulder that is seen whole projects into the box of its pixels; the moving pipe's too."""
    for frame in labelled.frames:
        for label in labels.of(frame, "M0"):
            if label.thing.key not in ("objects.1", "objects.3"):
                continue
            u, v = labelled.camera_model("M0").project(label.T_c_o[:3, 3])
            row, col = np.divmod(label.whole, 64)
            assert row.min() <= v <= row.max() + 1
            assert col.min() <= u <= col.max() + 1
    pose = next(label for label in labels.of(1, "M0") if label.thing.key == "objects.3").T_c_o
    expected = np.linalg.inv(labelled.T_w_c(1, "M0")) @ labelled.poses("objects.3")[1][1]
    np.testing.assert_allclose(pose, expected, rtol=0, atol=1e-12)


def test_pixels_that_hit_nothing_are_water_and_those_beyond_the_lens_nothing(labels, labelled):
    numbers, S = labels.numbers(0, "M0"), labelled.image("S", 0, "M0")
    assert (numbers[S == 0] == WATER_NUMBER).all()
    assert np.array_equal(numbers[S > 0], S[S > 0])
    assert (S == 0).any()


@pytest.fixture(scope="module")
def ended(tmp_path_factory):
    """Labels of open water about a boulder, through a lens that ends within the image."""
    out = tmp_path_factory.mktemp("ended") / "data"
    produce(
        scene_from_dict(
            {
                "objects": [{"kind": "boulder", "position": [0, 3, 0]}],
                "vehicle": {
                    "cameras": [
                        {
                            "id": "M0",
                            "resolution": [48, 36],
                            "sensor_mm": [4.8, 3.6],
                            "focal_mm": 1.2,
                            "distortion": {"model": "kannala_brandt", "k": [-0.2, 0, 0, 0]},
                        }
                    ]
                },
                "trajectory": {"poses": [{"position": [0, 0, 0]}], "duration_s": 0.1},
                "render": {"frame_rate_hz": 10, "outputs": ["B", "S"], "spp_b": 1, "denoise_b": "none"},
            }
        ),
        out,
        device="cpu",
        quiet=True,
    )
    return Labels(Job(Clocked(out, 0), out, "B", ("M0",)))


def test_beyond_the_end_of_a_lens_nothing_is_seen(ended):
    """Theta - 0.2 theta^3 grows up to theta = sqrt(1 / 0.6), where it is 0.8607: 10.33 px from the middle."""
    numbers = ended.numbers(0, "M0")
    row, col = np.indices(numbers.shape) + 0.5
    radius = np.hypot(row - 18, col - 24)
    end = 12 * np.sqrt(1 / 0.6) * (1 - 0.2 / 0.6)
    assert 0.1 < (radius < end).mean() < 0.9
    assert not numbers[radius > end].any()
    assert set(np.unique(numbers[radius < end])) == {1, WATER_NUMBER}
