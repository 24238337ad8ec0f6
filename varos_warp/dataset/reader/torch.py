"""A dataset as PyTorch takes it. Only this module needs PyTorch."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from varos_warp.dataset.reader.frame import Frame
from varos_warp.errors import InputError, require_known
from varos_warp.products.images.registry import OUTPUTS
from varos_warp.scene.description.image_types import DEPTH

try:
    import torch
except ImportError as _error:
    raise InputError(
        "PyTorch is not installed",
        key="torch",
        remedy="Install it as https://pytorch.org says, for example `pip install torch`.",
    ) from _error


def _planes(image: np.ndarray, scale: float = 1.0) -> torch.Tensor:
    """[H, W, 3] as [3, H, W], [H, W] as [1, H, W]; float32."""
    planes = np.moveaxis(image, -1, 0) if image.ndim == 3 else image[None]
    return torch.from_numpy(np.ascontiguousarray(planes, np.float32) * np.float32(scale))


def _read(frame: Frame, output: str) -> torch.Tensor:
    """One image of a frame."""
    image = getattr(frame, output)
    if image.dtype == np.int32:
        return torch.from_numpy(image.astype(np.int64))
    return _planes(image, 1 / 255 if image.dtype == np.uint8 else 1.0)


IMAGES = (*OUTPUTS, *(f"{letter}_{part}" for letter, image in OUTPUTS.items() for part in image.parts))
"""What may be asked for."""


class TorchDataset(torch.utils.data.Dataset):
    """Frames as dicts of tensors; give it to a ``torch.utils.data.DataLoader`` with any number of workers.

    An item has, of what is asked for, ``A``, ``B`` and ``P`` float32 [3, H, W] in 0..1 (sRGB, after exposure), their
    ``A_radiance`` ... float32 [3, H, W] (linear, before exposure), ``C`` float32 [3, H, W] (unit world normals, zero
    where nothing was hit), ``D`` float32 [1, H, W] [m], ``S`` int64 [H, W], ``F`` float32 [2, H, W] [pixels] (NaN where
    it is not known), ``F_occluded`` float32 [1, H, W] of 0 and 1, ``F_motion`` float32 [3, H, W] [m], other types as
    planes of float32; and always ``T_w_c`` and ``T_w_v`` float64 [4, 4], ``K`` float64 [3, 3] (`Frame.K_center_half`,
    not OpenCV's), ``time_ns`` and ``frame`` int64 [].

    Args:
        data: A `Dataset`; `Dataset.torch` gives itself.
        outputs: Names of images: ``"ACD"``, or a sequence as ``("A_radiance", "D")``.
        camera: Its id; absent: the first.
        no_depth: What D has where the dataset has no distance (inf there); losses often take 0.
        transform: Called with each item; what it returns takes the item's place.

    Raises:
        InputError: If an image that is asked for is not in the dataset, or there is no such camera.
    """

    def __init__(
        self,
        data: Any,
        outputs: Sequence[str] = "ACD",
        camera: str | None = None,
        *,
        no_depth: float = float("inf"),
        transform: Callable | None = None,
    ):
        self.data, self.outputs, self.camera = data, tuple(outputs), camera
        self.no_depth, self.transform = no_depth, transform
        self.data.camera(camera)
        for output in self.outputs:
            there = [name for name in IMAGES if name[0] in self.data.outputs]
            require_known(output, there, "is not in the dataset", key="outputs")

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.data)

    def __getitem__(self, index: int) -> dict:
        """The item of a frame.

        Raises:
            InputError: If a file is missing or damaged; in a worker a ValueError with the same message, since a
                DataLoader makes its exceptions anew from their text.
        """
        try:
            item = self._item(index)
        except InputError as error:
            if torch.utils.data.get_worker_info() is None:
                raise
            raise ValueError(error.message) from None
        return item if self.transform is None else self.transform(item)

    def _item(self, index: int) -> dict[str, torch.Tensor]:
        frame = self.data[index, self.camera]
        item = {output: _read(frame, output) for output in self.outputs}
        if DEPTH in item:
            item[DEPTH][torch.isinf(item[DEPTH])] = self.no_depth
        item |= {name: torch.from_numpy(np.array(getattr(frame, name), np.float64)) for name in ("T_w_c", "T_w_v", "K")}
        return item | {"time_ns": torch.tensor(frame.time_ns), "frame": torch.tensor(frame.number)}
