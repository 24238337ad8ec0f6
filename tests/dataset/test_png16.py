"""PNG of three channels of 16 bits: as OpenCV has them."""

import struct
import zlib

import cv2
import numpy as np
import pytest

from varos_warp.dataset import files
from varos_warp.errors import InputError

PIXELS = np.random.default_rng(3).integers(0, 65536, (9, 14, 3)).astype(np.uint16)


def test_opencv_reads_what_is_written(tmp_path):
    files.write_png(tmp_path / "f.png", PIXELS)
    read = cv2.imread(str(tmp_path / "f.png"), cv2.IMREAD_UNCHANGED)
    assert read.dtype == np.uint16
    assert np.array_equal(read[..., ::-1], PIXELS)
    assert np.array_equal(files.read_png(tmp_path / "f.png"), PIXELS)


def test_others_are_read_as_before(tmp_path):
    for name, pixels in (("rgb", (PIXELS >> 8).astype(np.uint8)), ("grey", PIXELS[..., 0])):
        files.write_png(tmp_path / f"{name}.png", pixels)
        assert np.array_equal(files.read_png(tmp_path / f"{name}.png"), pixels)


def rewritten(data, rows):
    """The file with other rows, whole and with the right checksums."""
    at = data.index(b"IDAT") - 4
    length, = struct.unpack(">I", data[at:at + 4])
    packed = b"IDAT" + zlib.compress(rows)
    chunk = struct.pack(">I", len(packed) - 4) + packed + struct.pack(">I", zlib.crc32(packed))
    return data[:at] + chunk + data[at + 12 + length:]


@pytest.mark.parametrize(("damage", "problem"), [
    (lambda data: data[:60] + bytes([data[60] ^ 1]) + data[61:], "a checksum of it is wrong"),
    (lambda data: data[:-30] + data[-12:], "cannot be read"),
    (lambda data: rewritten(data, bytes(9 * 85 - 1)), "does not hold its pixels"),
    (lambda data: rewritten(data, bytes(1 << 26)), "does not hold its pixels"),
    (lambda data: rewritten(data, bytes(9 * 85)), "filtered otherwise"),
    (lambda data: data[:16] + struct.pack(">II", 1 << 20, 1 << 20) + data[24:], "cannot be read"),
])
def test_damage_is_one_message(tmp_path, damage, problem):
    path = tmp_path / "f.png"
    files.write_png(path, PIXELS)
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(InputError, match=problem):
        files.read_png(path)
