"""PNG files: as OpenCV and Pillow have them."""

import struct
import threading
import zlib

import cv2
import numpy as np
import pytest
from PIL import Image

from varos_warp.dataset import files, png
from varos_warp.errors import InputError

PIXELS = np.random.default_rng(3).integers(0, 65536, (9, 14, 3)).astype(np.uint16)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("shape", [(9, 14, 3), (9, 14), (1, 1, 3), (1, 1), (1, 7), (7, 1, 3)])
def test_all_readers_find_the_pixels_that_were_written(tmp_path, shape, dtype):
    pixels = np.random.default_rng(3).integers(0, np.iinfo(dtype).max + 1, shape).astype(dtype)
    path = tmp_path / "f.png"
    files.write_png(path, pixels)
    assert files.is_complete(path)
    found = [files.read_png(path), cv2.imread(str(path), cv2.IMREAD_UNCHANGED)]
    if len(shape) == 3:
        found[1] = found[1][..., ::-1]
    if shape[2:] != (3,) or dtype == np.uint8:  # Pillow cuts the others to 8 bits
        found.append(np.asarray(Image.open(path)))
    for read in found:
        assert np.array_equal(read, pixels)
        assert read.dtype == dtype


def test_a_file_does_not_depend_on_the_thread_that_packs_it():
    """Threads that live at once have stacks of their own, whose addresses ISA-L by itself mixes into what it finds."""
    rng, count, found = np.random.default_rng(1), 600, []
    images = [
        (rng.integers(0, 9, (9, 1, 3)) + np.arange(16)[:, None] // rng.integers(1, 9)).astype(np.uint8)
        for _ in range(30)
    ]
    together = threading.Barrier(count)

    def pack():
        together.wait()
        found.append(tuple(png.encode(image) for image in images))
        together.wait()

    before = threading.stack_size(256 * 1024)
    try:
        threads = [threading.Thread(target=pack) for _ in range(count)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        threading.stack_size(before)
    assert len(found) == count
    assert len(set(found)) == 1


def test_how_pixels_lie_in_memory_does_not_matter():
    turned = PIXELS[::-1, 1::2].transpose(1, 0, 2)
    assert png.encode(turned) == png.encode(turned.copy()) == png.encode(turned.astype(">u2"))


@pytest.mark.parametrize(
    ("shape", "dtype"),
    [
        ((5, 7, 4), np.uint8),
        ((5, 7, 1), np.uint8),
        ((1, 5, 7, 3), np.uint8),
        ((5, 7), np.int16),
        ((5, 7), bool),
        ((5, 7), np.float16),
        ((5, 7, 3), np.float32),
        ((0, 7), np.uint8),
        ((5, 0, 3), np.uint16),
        ((5,), np.uint8),
    ],
)
def test_other_arrays_are_refused(shape, dtype):
    with pytest.raises(ValueError, match="a PNG holds"):
        png.encode(np.ones(shape, dtype))


def test_files_of_older_versions_are_read(tmp_path):
    """Their rows differ from those above."""
    rows = np.ascontiguousarray(PIXELS, ">u2").view(np.uint8).reshape(9, 84)
    up = np.insert(np.diff(rows, axis=0, prepend=np.zeros((1, 84), np.uint8)), 0, 2, axis=1)
    path = tmp_path / "f.png"
    path.write_bytes(rewritten(png.encode(PIXELS), up.tobytes()))
    assert np.array_equal(files.read_png(path), PIXELS)
    assert np.array_equal(cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[..., ::-1], PIXELS)


def rewritten(data, rows):
    """The file with other rows, whole and with the right checksums."""
    at = data.index(b"IDAT") - 4
    (length,) = struct.unpack(">I", data[at : at + 4])
    packed = b"IDAT" + zlib.compress(rows)
    chunk = struct.pack(">I", len(packed) - 4) + packed + struct.pack(">I", zlib.crc32(packed))
    return data[:at] + chunk + data[at + 12 + length :]


@pytest.mark.parametrize(
    ("damage", "problem"),
    [
        (lambda data: data[:60] + bytes([data[60] ^ 1]) + data[61:], "a checksum of it is wrong"),
        (lambda data: data[:-30] + data[-12:], "cannot be read"),
        (lambda data: rewritten(data, bytes(9 * 85 - 1)), "does not hold its pixels"),
        (lambda data: rewritten(data, bytes(1 << 26)), "does not hold its pixels"),
        (lambda data: rewritten(data, bytes(9 * 85)), "filtered otherwise"),
        (lambda data: data[:16] + struct.pack(">II", 1 << 20, 1 << 20) + data[24:], "cannot be read"),
    ],
)
def test_damage_is_one_message(tmp_path, damage, problem):
    path = tmp_path / "f.png"
    files.write_png(path, PIXELS)
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(InputError, match=problem):
        files.read_png(path)
