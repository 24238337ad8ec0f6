"""Points of LAS and LAZ files (ASPRS LAS 1.0 to 1.4), through laspy and lazrs."""

import struct
from collections import Counter

import numpy as np

from varos_warp.limits import check_limit
from varos_warp.scene.geometry.survey.content import Cloud, Reference, Request
from varos_warp.scene.geometry.survey.crs import geokeys, of_geokeys, of_wkt

NOISE = (7, 18)
"""Classes of low and of high noise."""
CHUNK = 1_000_000
MOST_RECORDS = 10_000
"""Most records of variable length, before and after the points."""
MOST_PACKED = 1000
"""Most points in a byte of a LAZ file; real surveys have less than one."""
INSTALL = 'Install it: pip install "varos_warp[survey]".'
DAMAGED = "The file may be damaged; copy or export it again."


def read_las(request: Request) -> Cloud:
    """Read the points of the asked classes, all returns; those that are marked as withheld are left out.

    Raises:
        InputError: laspy is not installed, the file is damaged, its coordinates are degrees, or no point is left.
    """
    try:
        import laspy
    except ImportError:
        raise request.error("LAS and LAZ files need one more package", INSTALL) from None
    if _check_sizes(request) and not laspy.LazBackend.Lazrs.is_available():
        raise request.error("LAZ files need one more package", INSTALL)
    try:
        points, told, counts, vlrs = _points(request)
    except BaseException as error:  # laspy and lazrs raise many kinds, and Rust's panics are no exceptions
        if not isinstance(error, Exception) and type(error).__name__ != "PanicException":
            raise
        raise request.error(
            f"cannot be read as a LAS file: {str(error).strip() or type(error).__name__}", DAMAGED
        ) from error
    if counts["read"] != told or not np.isfinite(points).all():
        raise request.error(
            f"its header says {told} points, but there are {counts['read']}, or some lie nowhere",
            "The transfer may have broken off; copy it again.",
        )
    if len(points) == 0:
        raise request.error(
            "there are no such points in it" if request.asked.classes else "there are no points in it",
            "Look at its classes.",
            "classes" if request.asked.classes else "file",
            request.asked.classes,
        )
    notes = [f"{counts['noise']} of its {told} points are noise or withheld, and left out"] * bool(counts["noise"])
    return Cloud(points, _reference(vlrs, points, request), notes)


def _points(request: Request) -> tuple[np.ndarray, int, Counter, list]:
    """The points [N, 3], how many the header tells, how many were read and are noise, and the other records."""
    import laspy

    kept, counts = [np.zeros((0, 3))], Counter()
    # one thread: a fault in one of many would end the process
    with laspy.open(request.path, laz_backend=laspy.LazBackend.Lazrs) as file:
        for chunk in file.chunk_iterator(CHUNK):
            points, noise = _chosen(chunk, request)
            kept.append(points)
            counts.update(read=len(chunk), noise=noise)
        return np.concatenate(kept), file.header.point_count, counts, [*file.header.vlrs, *(file.evlrs or ())]


def _check_sizes(request: Request) -> bool:
    """Tell whether a file is packed (LAZ), and refuse a header that asks for more memory than the file can fill.

    The libraries allocate it before they look whether the points are there.
    """
    size = request.path.stat().st_size
    with request.path.open("rb") as file:
        head = file.read(375)
        if head[:4] != b"LASF" or len(head) < 227 or (head[25] >= 4 and len(head) < 375):
            raise request.error("cannot be read as a LAS file: it does not begin as one", DAMAGED)
        start, records = struct.unpack_from("<II", head, 96)
        form, length, count = struct.unpack_from("<BHI", head, 104)
        more = 0
        if head[25] >= 4:
            more, count = struct.unpack_from("<IQ", head, 243)
        packed = bool(form & 0xC0)
        check_limit("HEIGHTS", count, file=request.path, key=f"{request.key}.file")
        whole = (
            start <= size
            and records + more <= MOST_RECORDS
            and (
                count <= MOST_PACKED * size and _chunks(file, start, size) <= count + 1
                if packed
                else start + count * length <= size
            )
        )
    if not whole:
        raise request.error("it is shorter than its header says", "The transfer may have broken off; copy it again.")
    return packed


def _chunks(file, start: int, size: int) -> int:
    """The number of chunks that the table of a LAZ file tells, whose place stands before the points."""
    file.seek(start)
    (place,) = struct.unpack("<q", file.read(8).ljust(8, b"\xff"))
    if place == -1:  # written in one go: it stands at the end
        file.seek(max(size - 8, 0))
        (place,) = struct.unpack("<q", file.read(8).ljust(8, b"\xff"))
    if not start < place <= size - 8:
        return size
    file.seek(place + 4)
    return struct.unpack("<I", file.read(4))[0]


def _chosen(chunk, request) -> tuple[np.ndarray, int]:
    """The points [N, 3] of a chunk, and how many are left out as noise."""
    kind = np.asarray(chunk.classification)
    bad = np.asarray(chunk.withheld, bool)
    bad |= np.isin(kind, NOISE) if request.asked.classes is None else False
    wanted = ~bad if request.asked.classes is None else ~bad & np.isin(kind, request.asked.classes)
    points = np.column_stack([np.asarray(axis, float)[wanted] for axis in (chunk.x, chunk.y, chunk.z)])
    return points, int(bad.sum())


def _reference(vlrs, points, request) -> Reference:
    """Tell what the records of the projection say: well-known text, or keys as those of GeoTIFF."""
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    records = {vlr.record_id: vlr.record_data_bytes() for vlr in vlrs if vlr.user_id == "LASF_Projection"}
    if wkt := records.get(2112, b"").decode("utf-8", "replace").strip("\0 \n"):
        return of_wkt(wkt, request, (middle[0], middle[1]))
    numbers = records.get(34736, b"")
    keys = geokeys(
        _words(records.get(34735, b""), "<u2"), _words(numbers, "<f8"), records.get(34737, b"").decode("latin-1")
    )
    return of_geokeys(keys, request, (middle[0], middle[1])) if keys else Reference()


def _words(data: bytes, kind: str) -> list:
    size = np.dtype(kind).itemsize
    return np.frombuffer(data[: len(data) // size * size], kind).tolist()
