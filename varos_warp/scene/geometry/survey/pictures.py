"""Grids that do not say where they lie: PNG pictures and NumPy arrays; and what grey means as heights."""

import numpy as np

from varos_warp.errors import refused_as
from varos_warp.files import beside
from varos_warp.limits import check_limit
from varos_warp.scene.geometry.survey.content import Raster, Request
from varos_warp.scene.images import open_image


def read_picture(request: Request) -> Raster:
    """Read the heights of a grey PNG of 8 or 16 bits.

    Raises:
        InputError: It is damaged or coloured, or its keys do not say what grey means and how far apart pixels are.
    """
    again = "The file may be damaged; export it again."
    opened = open_image(request.path, f"{request.key}.file", limit="HEIGHTS", formats=("PNG",))
    with refused_as(lambda error: request.error(f"cannot be read as a PNG: {error}", again)), opened as image:
        if image.mode not in ("L", "I;16", "I;16B", "I"):
            raise request.error(
                f"is a coloured picture (mode {image.mode}), not heights",
                "Give a grey PNG of 8 or 16 bits, a GeoTIFF or an NPY file.",
            )
        values = np.asarray(image)
        clear = image.info.get("transparency")  # of the chunk tRNS: the grey that is not there
    if values.dtype.kind == "i":  # Pillow keeps 16 bits in 32
        values = values.astype(np.uint16)
    mask = None if clear is None else values == clear
    return Raster(to_heights(values, None, request, measured=False, mask=mask), placed(values.shape, request)[0])


def read_array(request: Request) -> Raster:
    """Read the heights of a two-dimensional NumPy array, ``z[row, column]``.

    Raises:
        InputError: It is no such array, or its keys do not say how far apart its nodes are and which row is north.
    """
    try:
        values = np.load(request.path, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # its header is Python's own text
        raise request.error(f"cannot be read as an NPY file: {error}", "Write it with numpy.save.") from error
    if not isinstance(values, np.ndarray) or values.ndim != 2 or values.dtype.kind not in "iuf":
        what = (
            f"an array of shape {list(values.shape)} and type {values.dtype}"
            if isinstance(values, np.ndarray)
            else "an archive of arrays"
        )
        raise request.error(f"is {what}, not heights on a grid", "Save one array of numbers [rows, columns].")
    check_limit("HEIGHTS", values.size, file=request.path, key=f"{request.key}.file")
    if request.asked.first_row is None:
        raise request.error(
            "an NPY file does not say which of its rows is north",
            "Give north, or south if y grows with the row.",
            "first_row",
        )
    T = centred(values.shape, request)
    return Raster(to_heights(np.asarray(values), None, request, measured=True), T)


def placed(shape: tuple[int, ...], request: Request, told: np.ndarray | None = None) -> tuple[np.ndarray, bool]:
    """The places of the nodes [rows, columns] of a picture, float64 [2, 3], and whether its files tell them.

    Args:
        told: The places by the picture itself; None if it has none, so that a world file may tell them.
    """
    T = world_file(request) if told is None else told
    if T is None:
        return centred(shape, request), False
    for key in ("pixel_m", "first_row"):
        if getattr(request.asked, key) is not None:
            raise request.error("the file says itself where it lies", "Leave it out.", key, getattr(request.asked, key))
    return T, True


def world_file(request: Request) -> np.ndarray | None:
    """The places of the middles of the pixels by the world file beside a picture, [2, 3]; None without one.

    It has six numbers: what x and y grow by along a row, what they grow by down a column, and the middle of the first
    pixel.
    """
    suffix = request.path.suffix
    for path in (beside(request.path, name) for name in (f".{suffix[1]}{suffix[-1]}w", f"{suffix}w", ".wld")):
        if path is None:
            continue
        try:
            a, d, b, e, c, f = map(float, path.read_text(encoding="ascii").split()[:6])
            T = np.array([[a, b, c], [d, e, f]])
            if not (np.isfinite(T).all() and abs(np.linalg.det(T[:, :2])) > 0.0):
                raise ValueError
        except ValueError:
            raise request.error(
                f"its world file {path.name} does not hold six numbers that span an area",
                "Mend it, or take it away and give pixel_m.",
            ) from None
        return T
    return None


def centred(shape: tuple[int, ...], request: Request) -> np.ndarray:
    """The places of nodes about the middle of their grid, float64 [2, 3], as the keys of the block say."""
    asked = request.asked
    if asked.pixel_m is None:
        raise request.error(
            "the file does not say where it lies",
            "Give the distance of neighbouring nodes in metres, "
            "such as 0.25; the middle of the grid is then the origin.",
            "pixel_m",
        )
    dx, dy = asked.pixel_m if isinstance(asked.pixel_m, tuple) else (asked.pixel_m,) * 2
    down = 1.0 if asked.first_row == "south" else -1.0
    rows, columns = shape
    return np.array([[dx, 0.0, -0.5 * dx * (columns - 1)], [0.0, down * dy, -0.5 * down * dy * (rows - 1)]])


def to_heights(
    values: np.ndarray, nodata: float | None, request: Request, *, measured: bool, mask: np.ndarray | None = None
) -> np.ndarray:
    """Values [rows, columns] as float64, NaN for those that stand for none, and grey by ``height_range_m``.

    Args:
        nodata: What stands for none by the file; the block's own counts before it.
        measured: Whether whole numbers of more than 8 bits are heights; those of pictures only mean some.
        mask: Where there are none, bool [rows, columns].
    """
    asked = request.asked
    nodata = asked.nodata if asked.nodata is not None else nodata
    whole = values.dtype.kind in "iu"
    if (
        whole
        and (not measured or values.dtype.itemsize == 1)
        and (asked.height_scale is None and asked.height_range_m is None)
    ):
        raise request.error(
            f"its values are whole numbers of {8 * values.dtype.itemsize} bits, which may be grey or heights",
            "Give height_range_m: [LOW, HIGH] for the heights of black and white, or "
            "height_scale for metres in a step (1 if they are heights).",
            "height_scale",
        )
    if asked.height_range_m is not None and (values.dtype.kind != "u" or values.dtype.itemsize > 2):
        raise request.error(
            f"is for pictures of 8 or 16 bits; these values are {values.dtype}",
            "Leave it out; height_scale multiplies.",
            "height_range_m",
        )
    heights = values.astype(np.float64)
    none = ~np.isfinite(heights)
    if nodata is not None and not np.isnan(nodata):
        none |= _equal(values, nodata)
    if mask is not None:
        none |= mask.reshape(values.shape)
    if asked.height_range_m is not None:
        low, high = asked.height_range_m
        heights = low + heights * ((high - low) / np.iinfo(values.dtype).max)
    heights[none] = np.nan
    return heights


def _equal(values: np.ndarray, nodata: float) -> np.ndarray:
    """Tell where values are that number as their type holds it: -3.4028235e38 is written with too few digits."""
    if values.dtype.kind != "f":
        return values == nodata
    with np.errstate(over="ignore"):
        return values == values.dtype.type(nodata)
