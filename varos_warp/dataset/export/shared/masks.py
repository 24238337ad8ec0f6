"""Masks as the places of their pixels: boxes, run lengths, images."""

import numpy as np

CHARACTERS = 7
"""Most characters of a run length of 32 bits."""


def box_of(pixels: np.ndarray, width: int) -> list[int]:
    """The box x, y, width, height [px] about pixels, int64 [N] places in a flattened image of a width, N > 0."""
    row, col = np.divmod(pixels, width)
    x, y = int(col.min()), int(row.min())
    return [x, y, int(col.max()) - x + 1, int(row.max()) - y + 1]


def image_of(pixels: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """A mask uint8 [H, W], 255 where it is, for ``size`` = (H, W)."""
    image = np.zeros(size[0] * size[1], np.uint8)
    image[pixels] = 255
    return image.reshape(size)


def run_lengths(pixels: np.ndarray, size: tuple[int, int]) -> dict:
    """COCO's compressed run lengths of a mask: ``size`` [H, W] and the text ``counts``.

    Runs go down the columns, in turn of what is not of the mask and of what is (cocoapi, common/maskApi.c).
    """
    height, width = size
    row, col = np.divmod(pixels, width)
    down = np.sort(col * height + row)
    starts = down[np.diff(down, prepend=-2) != 1]
    ends = down[np.diff(down, append=height * width + 1) != 1] + 1
    edges = np.concatenate([[0], np.stack([starts, ends], 1).ravel(), [height * width]])
    counts = np.diff(edges)
    return {"size": [height, width], "counts": as_text(counts if counts[-1] or len(counts) == 1 else counts[:-1])}


def as_text(counts: np.ndarray) -> str:
    """Run lengths int64 [N] as COCO writes them: five bits a character, from the fourth on less those two before."""
    values = counts.astype(np.int64)
    values[3:] -= counts[1:-2]
    rest = values[:, None] >> (5 * np.arange(CHARACTERS + 1))  # the sign goes on for ever
    bits = rest[:, :-1] & 0x1F
    more = np.where(bits & 0x10, rest[:, 1:] != -1, rest[:, 1:] != 0)
    used = np.concatenate([np.ones((len(values), 1), bool), np.logical_and.accumulate(more, axis=1)[:, :-1]], axis=1)
    return bytes((bits + 32 * more + 48)[used].astype(np.uint8).tolist()).decode()
