"""PNG of three channels of 16 bits, as KITTI has optical flow.

Pillow has none of them, and cuts those that it reads to 8 bits; OpenCV has, and is 60 MB. Here rows differ from the one
above (filter 2, Up) throughout, and only such files are read, as `encode` makes them.
"""

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from varos_warp.limits import check_limit

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_KIND = bytes([16, 2, 0, 0, 0])
"""Bits, RGB, and the only ways of compression, filtering and order."""
_UP = 2


def encode(pixels: np.ndarray) -> bytes:
    """The file of uint16 [H, W, 3]."""
    height, width, _ = pixels.shape
    rows = np.ascontiguousarray(pixels, ">u2").view(np.uint8).reshape(height, 6 * width)
    filtered = np.full((height, 1 + 6 * width), _UP, np.uint8)
    filtered[:, 1:] = np.diff(rows, axis=0, prepend=np.zeros((1, 6 * width), np.uint8))
    header = struct.pack(">II", width, height) + _KIND
    return _SIGNATURE + b"".join(_chunk(name, data) for name, data in (
        (b"IHDR", header), (b"IDAT", zlib.compress(filtered, 1)), (b"IEND", b"")))


def _chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def is_one(path: Path) -> bool:
    """Whether a file begins as a PNG of three channels of 16 bits."""
    with path.open("rb") as file:
        head = file.read(29)
    return head.startswith(_SIGNATURE) and head[24:] == _KIND


def decode(path: Path) -> np.ndarray:
    """Pixels uint16 [H, W, 3] of a file.

    Raises:
        ValueError: If it is damaged, or filtered otherwise.
        InputError: If it has more pixels than the limit.
    """
    chunks = list(_chunks(path.read_bytes()))
    width, height = struct.unpack(">II", chunks[0][1][:8])
    check_limit("TEXTURE_PIXELS", width * height, file=path)
    size = height * (1 + 6 * width)
    unpacked = zlib.decompressobj().decompress(b"".join(data for name, data in chunks if name == b"IDAT"), size + 1)
    if len(unpacked) != size:
        raise ValueError("it does not hold its pixels")
    filtered = np.frombuffer(unpacked, np.uint8).reshape(height, 1 + 6 * width)
    if (filtered[:, 0] != _UP).any():
        raise ValueError("its rows are filtered otherwise than here; OpenCV reads it")
    rows = np.cumsum(filtered[:, 1:], axis=0, dtype=np.uint8)  # modulo 256, as the filter has it
    return rows.view(">u2").reshape(height, width, 3).astype(np.uint16)


def _chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    at = len(_SIGNATURE)
    while at < len(data):
        length, = struct.unpack(">I", data[at:at + 4])
        name, content = data[at + 4:at + 8], data[at + 8:at + 8 + length]
        check, = struct.unpack(">I", data[at + 8 + length:at + 12 + length])
        if check != zlib.crc32(name + content):
            raise ValueError("a checksum of it is wrong")
        yield name, content
        at += 12 + length
