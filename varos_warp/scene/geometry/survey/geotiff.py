"""GeoTIFF (OGC 19-008r4): heights of one band, where they lie, and their unit; and TIFF files that say nothing of that.

tifffile decodes the pixels, with imagecodecs if it is installed, as it must be for LZW and Zstandard. A node
of the grid is the middle of a pixel, as GDAL has it: half a pixel from the corner that a tie point of RasterPixelIsArea
names.
"""

import contextlib
import logging
import math
import re
import zlib
from dataclasses import replace
from importlib.util import find_spec

import numpy as np

from varos_warp.errors import InputError, refused_as
from varos_warp.files import beside
from varos_warp.limits import check_limit
from varos_warp.scene.geometry.survey.content import Raster, Reference, Request
from varos_warp.scene.geometry.survey.crs import MOST_TEXT, geokeys, of_geokeys
from varos_warp.scene.geometry.survey.pictures import placed, to_heights
from varos_warp.scene.headers import LENGTHS

logging.getLogger("tifffile").addHandler(logging.NullHandler())  # what it logs of damaged files: not to stderr
logging.getLogger("tifffile").propagate = False

DEFLATE = (8, 32946)
PACKED = {1: "none", 5: "LZW", **dict.fromkeys(DEFLATE, "deflate"), 32773: "PackBits", 50000: "Zstandard"}
"""Ways of packing that lose nothing and unpack into bounded memory."""
TAGS = (33550, 33922, 34264, 34735, 34736, 34737, 42112, 42113)
"""ModelPixelScale, ModelTiepoint, ModelTransformation, the directory of geographic keys with their numbers and texts,
and GDAL's metadata and value for none."""
MOST_PAGES = 100
REWRITE = "Write it anew: gdal_translate -co COMPRESS=DEFLATE in.tif out.tif."


def read_geotiff(request: Request) -> Raster:
    """Read the heights of a TIFF file.

    Raises:
        InputError: It is no TIFF, is damaged, holds no single band of heights, lies in degrees, or does not say where
            it lies.
    """
    import tifffile

    with refused_as(lambda error: _unread(error, request)):  # tifffile raises many kinds
        with tifffile.TiffFile(request.path) as file:
            page, mask = _pages(file, request)
            tags = {number: page.tags.valueof(number) for number in TAGS}
            values = _pixels(page, request)
            mask = None if mask is None else _mask(mask, request)
        outside = beside(request.path, f"{request.path.suffix}.msk")
        if outside is not None:
            more = _mask_beside(replace(request, path=outside), values.shape)
            mask = more if mask is None else mask | more
        return _placed(values, mask, tags, request)


def _unread(error: Exception, request: Request) -> InputError:
    if "imagecodecs" in str(error) or isinstance(error, ImportError):
        return request.error(
            f"its pixels are packed in a way that needs one more package ({error})",
            'Install it: pip install "varos_warp[survey]".',
        )
    return request.error(
        f"cannot be read as a TIFF: {str(error).strip() or type(error).__name__}",
        "The file may be damaged; copy or export it again.",
    )


# -------------------------------------------------------------------------------------------------------------- pixels


def _pages(file, request):
    """The page with the heights, and the one with their mask or None; overviews are passed over."""
    page, mask, others = file.pages.first, None, 0
    for other in file.pages[1:MOST_PAGES]:
        kind = other.tags.valueof(254, 0)
        if kind & 4 and (other.imagewidth, other.imagelength) == (page.imagewidth, page.imagelength):
            mask = other
        others += not kind & 5
    if others:
        raise request.error(
            f"holds {others + 1} images", "Give one of them: gdal_translate GTIFF_DIR:1:in.tif out.tif."
        )
    return page, mask


def _pixels(page, request) -> np.ndarray:
    """The values of the one band, [rows, columns]."""
    _check_pixels(page, request)
    if page.samplesperpixel != 1 or page.imagedepth != 1 or page.photometric not in (0, 1):
        what = "a palette" if page.photometric == 3 else f"{page.samplesperpixel} bands"
        raise request.error(
            f"is a picture, not heights: it has {what}",
            "Give a file with one band of heights: gdal_translate -b 1 in.tif out.tif.",
        )
    white = page.photometric == 0 and request.asked.height_range_m is not None
    if white or page.tags.valueof(274, 1) != 1:
        raise request.error("is turned, or its zero is white", REWRITE)
    values = np.asarray(page.asarray(squeeze=True)).reshape(page.imagelength, page.imagewidth)
    if values.dtype.kind not in "iuf":
        raise request.error(f"its values are {values.dtype}, not numbers", REWRITE)
    return values


def _mask(page, request) -> np.ndarray:
    """Return whether a mask says that there is nothing, bool [rows, columns]."""
    if page.samplesperpixel != 1:
        raise request.error(f"its mask has {page.samplesperpixel} bands", REWRITE)
    _check_pixels(page, request)
    return np.asarray(page.asarray(squeeze=True)).reshape(page.imagelength, page.imagewidth) == 0


def _mask_beside(request: Request, shape: tuple[int, ...]) -> np.ndarray:
    """Return whether GDAL's mask in a file of its own says that there is nothing, bool [rows, columns]."""
    import tifffile

    with refused_as(lambda error: _unread(error, request)), tifffile.TiffFile(request.path) as file:
        mask = _mask(file.pages.first, request)
    if mask.shape != shape:
        raise request.error(
            "is a mask of another size than the heights beside it", "Write both anew: gdal_translate in.tif out.tif."
        )
    return mask


def _check_pixels(page, request) -> None:
    """Refuse what would not fit into memory, or is packed so that it might not."""
    check_limit("HEIGHTS", page.imagewidth * page.imagelength, file=request.path, key=f"{request.key}.file")
    if page.compression not in PACKED:
        raise request.error(f"its pixels are packed by {getattr(page.compression, 'name', page.compression)}", REWRITE)
    rows, columns = page.tile[-2:] if page.is_tiled else (min(page.rowsperstrip, page.imagelength), page.imagewidth)
    check_limit("HEIGHTS", rows * columns, file=request.path, key=f"{request.key}.file")
    most = rows * -(-columns * page.samplesperpixel * page.bitspersample // 8) + 1
    # imagecodecs unpacks no more than it is asked for; what tifffile has where that is not installed does
    unbounded = page.compression in DEFLATE and find_spec("imagecodecs") is None
    file = page.parent.filehandle
    if len(page.dataoffsets) < (1 if page.is_contiguous else math.prod(page.chunked)):
        raise request.error("it lacks blocks of its pixels", "The file is damaged.")
    for place, count in zip(page.dataoffsets, page.databytecounts, strict=True):
        if place + count > file.size:
            raise request.error("it ends before its last pixels", "The transfer may have broken off; copy it again.")
        if unbounded and count:
            file.seek(place)
            if len(zlib.decompressobj().decompress(file.read(count), most)) >= most:
                raise request.error("a block of its pixels unpacks to more than its size", "The file is damaged.")


def _nodata(text) -> float | None:
    """GDAL's value for none."""
    with contextlib.suppress(ValueError):
        return None if text is None else float(str(text).strip(" \0").replace(",", "."))
    return None


# --------------------------------------------------------------------------------------------------------------- place


def _placed(values, mask, tags, request) -> Raster:
    """Values as heights where the file says that they lie."""
    T, told = placed(values.shape, request, _transform(tags, request))
    keys = geokeys(*_directory(tags)) if tags[34735] else {}
    middle = tuple(T @ (0.5 * (values.shape[1] - 1), 0.5 * (values.shape[0] - 1), 1.0))
    reference = of_geokeys(keys, request, middle) if keys else Reference()
    if not told:  # pixel_m is in metres
        reference = replace(reference, unit_m=1.0, unknown_unit=None)
    items = _items(str(tags[42112] or ""))
    heights = to_heights(values, _nodata(tags[42113]), request, measured=told, mask=mask)
    return Raster(_scaled(heights, items, request), T, _with_unit_of_band(reference, items))


def _directory(tags):
    doubles = tags[34736] if tags[34736] is not None else ()
    doubles = doubles if isinstance(doubles, tuple) else (doubles,)
    text = tags[34737] or ""
    return tags[34735], doubles, text.decode("latin-1") if isinstance(text, bytes) else str(text)


def _numbers(value, count: int, request) -> np.ndarray | None:
    """The numbers of a tag, at least ``count`` of them; None if there is no such tag."""
    if value is None:
        return None
    numbers = np.atleast_1d(np.array(value, float))
    if numbers.size < count or not np.isfinite(numbers).all():
        raise request.error("the tags that say where it lies are damaged", "Export it again.")
    return numbers


def _transform(tags, request) -> np.ndarray | None:
    """The places of the middles of the pixels, [2, 3]; None if the file has none."""
    matrix, scale = _numbers(tags[34264], 16, request), _numbers(tags[33550], 2, request)
    tie = _numbers(tags[33922], 6, request)
    if matrix is not None:
        M = matrix[:16].reshape(4, 4)
        if M[:2, 2].any() or M[2, :2].any() or M[2, 2] not in (0.0, 1.0) or M[2, 3]:
            raise request.error("its ModelTransformation tilts or scales heights", REWRITE)
        T = M[:2][:, [0, 1, 3]]
    elif scale is not None and tie is not None:
        if (
            tie.size > 6
            or scale[0] <= 0.0
            or scale[1] <= 0.0
            or tie[2]
            or tie[5]
            or (scale.size > 2 and scale[2] not in (0.0, 1.0))
        ):
            raise request.error(
                "it has more than one tie point, or scales heights or rows backwards",
                "Write it anew: gdalwarp in.tif out.tif.",
            )
        (column, row), (x, y) = tie[:2], tie[3:5]
        T = np.array([[scale[0], 0.0, x - column * scale[0]], [0.0, -scale[1], y + row * scale[1]]])
    elif tie is not None:
        raise request.error("it has tie points alone, and no grid", "Lay it on one: gdalwarp in.tif out.tif.")
    else:
        return None
    point = 2 in (value for key, place, _, value in _rows(tags[34735]) if key == 1025 and place == 0)
    shift = 0.0 if point else 0.5
    T = np.column_stack([T[:, :2], T[:, 2] + T[:, :2] @ (shift, shift)])
    if not abs(np.linalg.det(T[:, :2])) > 0.0:
        raise request.error("the tags that say where it lies span no area", "Export it again.")
    return T


def _rows(directory):
    return zip(*[iter((directory or ())[4:])] * 4, strict=False)


# ------------------------------------------------------------------------------------------------ what GDAL writes down


def _items(metadata: str) -> dict[str, str]:
    """The entries of GDAL's metadata that have a role, such as the scale of the values, by their roles."""
    found = re.findall(r"<Item\b([^<>]{0,500})>([^<]*)<", metadata[:MOST_TEXT])
    roles = [(re.search(r"\brole=[\"'](\w+)[\"']", attributes), value.strip()) for attributes, value in found]
    return {role[1]: value for role, value in roles if role}


def _scaled(heights: np.ndarray, items: dict[str, str], request: Request) -> np.ndarray:
    """Values with the scale and the offset that GDAL writes down for the band."""
    try:
        scale, offset = float(items.get("scale", 1.0)), float(items.get("offset", 0.0))
    except ValueError:
        scale = offset = np.nan
    if not (np.isfinite([scale, offset]).all() and scale):
        raise request.error("the scale or offset of its band is no number", "Write it anew: gdal_translate -unscale.")
    return heights if (scale, offset) == (1.0, 0.0) else heights * scale + offset


def _with_unit_of_band(reference: Reference, items: dict[str, str]) -> Reference:
    """The reference with the unit that GDAL writes down for a band, which says more than a system."""
    name = items.get("unittype")
    if not name:
        return reference
    known = LENGTHS.get(name.lower())
    return replace(reference, height_unit_m=known, unknown_height_unit=None if known else f"the unit '{name}'")
