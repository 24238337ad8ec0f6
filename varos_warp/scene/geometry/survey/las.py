"""Points of LAS and LAZ files (ASPRS LAS 1.0 to 1.4), through laspy and lazrs."""

import numpy as np

from varos_warp.errors import InputError
from varos_warp.limits import check_limit
from varos_warp.scene.geometry.survey.content import Cloud, Reference, Request
from varos_warp.scene.geometry.survey.crs import geokeys, of_geokeys, of_wkt

NOISE = (7, 18)
"""Classes of low and of high noise."""
CHUNK = 1_000_000


def read_las(request: Request) -> Cloud:
    """Read the points of the asked classes, all returns; those that are marked as withheld are left out.

    Raises:
        InputError: laspy is not installed, the file is damaged, its coordinates are degrees, or no point is left.
    """
    try:
        import laspy
    except ImportError:
        raise request.error("LAS and LAZ files need one more package", 'Install it: pip install "varos_warp[survey]".'
                            ) from None
    try:
        with laspy.open(request.path) as file:
            header = file.header
            check_limit("HEIGHTS", header.point_count, file=request.path, key=f"{request.key}.file")
            kept, noise, count = [], 0, 0
            for chunk in file.chunk_iterator(CHUNK):
                points, dropped = _chosen(chunk, request)
                kept.append(points)
                noise += dropped
                count += len(chunk)
            vlrs = [*header.vlrs, *(file.evlrs or ())]
    except InputError:
        raise
    except Exception as error:  # laspy and lazrs raise many kinds
        raise _unread(error, request) from error
    if count != header.point_count:
        raise request.error(f"its header says {header.point_count} points, but there are {count}",
                            "The transfer may have broken off; copy it again.")
    points = np.concatenate([*kept, np.zeros((0, 3))])
    if len(points) == 0:
        raise request.error("there are no such points in it" if request.asked.classes else "there are no points in it",
                            "Look at its classes.", "classes" if request.asked.classes else "file",
                            request.asked.classes)
    notes = [f"{noise} of its {count} points are noise or withheld, and left out"] * bool(noise)
    return Cloud(points, _reference(vlrs, points, request), notes)


def _chosen(chunk, request) -> tuple[np.ndarray, int]:
    """Return the points [N, 3] of a chunk, and how many are left out as noise."""
    kind = np.asarray(chunk.classification)
    bad = np.asarray(chunk.withheld, bool)
    bad |= np.isin(kind, NOISE) if request.asked.classes is None else False
    wanted = ~bad if request.asked.classes is None else ~bad & np.isin(kind, request.asked.classes)
    points = np.column_stack([np.asarray(axis, float)[wanted] for axis in (chunk.x, chunk.y, chunk.z)])
    return points, int(bad.sum())


def _unread(error: Exception, request: Request) -> InputError:
    if "azBackend" in str(error) or "lazrs" in str(error).lower():
        return request.error("LAZ files need one more package", 'Install it: pip install "varos_warp[survey]".')
    return request.error(f"cannot be read as a LAS file: {str(error).strip() or type(error).__name__}",
                         "The file may be damaged; copy or export it again.")


def _reference(vlrs, points, request) -> Reference:
    """Tell what the records of the projection say: well-known text, or keys as those of GeoTIFF."""
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    records = {vlr.record_id: vlr.record_data_bytes() for vlr in vlrs if vlr.user_id == "LASF_Projection"}
    if wkt := records.get(2112, b"").decode("utf-8", "replace").strip("\0 \n"):
        return of_wkt(wkt, request, (middle[0], middle[1]))
    numbers = records.get(34736, b"")
    keys = geokeys(_words(records.get(34735, b""), "<u2"), _words(numbers, "<f8"), records.get(34737, b"").decode(
        "latin-1"))
    return of_geokeys(keys, request, (middle[0], middle[1])) if keys else Reference()


def _words(data: bytes, kind: str) -> list:
    size = np.dtype(kind).itemsize
    return np.frombuffer(data[:len(data) // size * size], kind).tolist()
