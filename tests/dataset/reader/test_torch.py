"""PyTorch gets the frames of a dataset as tensors, in as many worker processes as it likes, and only if it is there."""

import shutil
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.errors import InputError


@pytest.fixture
def imported_anew():
    """The adapter is imported by the test, and forgotten after it."""
    before = sys.modules.pop("varos_warp.dataset.reader.torch", None)
    yield
    sys.modules.pop("varos_warp.dataset.reader.torch", None)
    if before is not None:
        sys.modules["varos_warp.dataset.reader.torch"] = before


@pytest.fixture
def torch():
    return pytest.importorskip("torch")


def test_without_pytorch_there_is_one_clear_message(written, monkeypatch, imported_anew):
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(InputError, match=r"PyTorch is not installed.*pip install torch"):
        Dataset(written).torch()


def test_the_adapter_asks_no_more_of_pytorch_than_it_says(written, monkeypatch, imported_anew):
    """Runs where there is no PyTorch: NumPy stands in for its tensors."""
    stand_in = ModuleType("torch")
    stand_in.utils = SimpleNamespace(data=SimpleNamespace(Dataset=object))
    stand_in.Tensor, stand_in.from_numpy, stand_in.tensor, stand_in.isinf = np.ndarray, np.asarray, np.array, np.isinf
    monkeypatch.setitem(sys.modules, "torch", stand_in)
    item, frame = Dataset(written).torch("ACD", "R0", no_depth=-1.0)[3], Dataset(written)[3, "R0"]
    np.testing.assert_array_equal(np.rint(item["A"] * 255), np.moveaxis(frame.A, -1, 0))
    np.testing.assert_array_equal(item["D"], np.where(np.isinf(frame.D), -1.0, frame.D)[None])
    np.testing.assert_array_equal(item["T_w_c"], frame.T_w_c)
    assert item["time_ns"] == frame.time_ns


def test_an_item_has_the_images_as_planes_and_where_they_were_taken(torch, written):
    data = Dataset(written)
    item, frame = data.torch(("A", "B", "C", "D", "A_radiance"), "R0")[3], data[3, "R0"]
    shapes = {name: tuple(item[name].shape) for name in ("A", "B", "C", "D", "A_radiance")}
    assert shapes == dict.fromkeys(("A", "B", "C", "A_radiance"), (3, 27, 48)) | {"D": (1, 27, 48)}
    assert all(item[name].dtype == torch.float32 for name in shapes)
    np.testing.assert_array_equal(np.rint(item["A"].numpy() * 255), np.moveaxis(frame.A, -1, 0))
    np.testing.assert_array_equal(item["C"].numpy(), np.moveaxis(frame.C, -1, 0))
    np.testing.assert_array_equal(item["D"][0].numpy(), frame.D)
    np.testing.assert_array_equal(item["A_radiance"].numpy(), np.moveaxis(frame.A_radiance, -1, 0))
    for name in ("T_w_c", "T_w_v", "K"):
        np.testing.assert_array_equal(item[name].numpy(), getattr(frame, name))
    assert (item["time_ns"].item(), item["frame"].item()) == (frame.time_ns, 3)


def test_what_has_no_depth_may_be_given_a_number(torch, written):
    data = Dataset(written)
    plain, filled = data.torch("D")[0]["D"], data.torch("D", no_depth=0.0)[0]["D"]
    beyond = torch.isinf(plain)
    assert 0 < beyond.float().mean() < 1
    assert (filled[beyond] == 0).all()
    assert torch.equal(filled[~beyond], plain[~beyond])


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_two_workers_give_what_one_process_gives(torch, written, method):
    frames = Dataset(written).torch("AD")
    loader = torch.utils.data.DataLoader(frames, batch_size=4, num_workers=2, multiprocessing_context=method)
    batches = list(loader)
    assert [len(batch["frame"]) for batch in batches] == [4, 4, 2]
    for name in ("A", "D", "T_w_c", "time_ns"):
        together = torch.cat([batch[name] for batch in batches])
        assert torch.equal(together, torch.stack([frames[i][name] for i in range(10)])), name


def test_a_transform_has_the_last_word(torch, written):
    frames = Dataset(written).torch("D", transform=lambda item: item["D"].shape)
    assert frames[-1] == (1, 27, 48)
    with pytest.raises(IndexError):
        frames[10]


@pytest.mark.parametrize("outputs", ["AQ", "S", ("D_radiance",)])
def test_images_that_the_dataset_has_not_are_bad_input(torch, written, outputs):
    with pytest.raises(InputError, match=r"is not in the dataset.*A, B, C, D, A_radiance, B_radiance"):
        Dataset(written).torch(outputs)


def test_a_damaged_image_is_named_by_the_worker_that_met_it(torch, written, tmp_path):
    data = Dataset(shutil.copytree(written, tmp_path / "copy"))
    path = data.layout.image("L0", "A", 4)
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(ValueError, match=path.name):
        list(torch.utils.data.DataLoader(data.torch("A"), num_workers=2))
    with pytest.raises(InputError, match=path.name):
        list(torch.utils.data.DataLoader(data.torch("A")))
