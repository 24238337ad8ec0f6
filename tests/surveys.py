"""Survey files for tests: a plane and a rough floor at UTM coordinates, written without the package."""

import numpy as np
import tifffile

EAST, NORTH = 400_000.0, 6_100_000.0
"""Where the surveys lie (UTM) [m]."""
SHAPE = (5, 7)
"""Rows and columns."""
STEP = 0.5
"""Distance of neighbouring nodes [m]."""
A, B, C = 0.25, -0.75, -30.0
"""Slopes and height of the plane, about the first east and north."""
UTM_32 = {1024: 1, 1025: 1, 3072: 32632, 3076: 9001}
"""Keys of a GeoTIFF: projected, pixels are areas, UTM zone 32 north, metres."""


def axes(shape=SHAPE, step=STEP):
    """Return x of the columns, and y of the rows from the north, at the middles of the pixels."""
    rows, columns = shape
    return EAST + step * np.arange(columns), NORTH + step * np.arange(rows)[::-1]


def plane(x, y):
    """Heights at x and y."""
    return A * (np.asarray(x) - EAST) + B * (np.asarray(y) - NORTH) + C


def plane_grid(shape=SHAPE, step=STEP):
    """Heights of the plane [rows, columns], the first row the northernmost."""
    x, y = axes(shape, step)
    return plane(x, y[:, None])


def rough(x, y):
    """Heights of a floor that has no symmetry."""
    return C + 0.3 * np.sin(x - EAST) + 0.2 * np.cos(1.7 * (np.asarray(y) - NORTH)) + 0.05 * (x - EAST) * (y - NORTH)


def geokeys(keys: dict, extra: str = "") -> list[tuple]:
    """The GeoKeyDirectory of keys, as extra tags for tifffile; a text goes to GeoAsciiParams."""
    rows, text, numbers = [], "", []
    for key, value in sorted(keys.items()):
        if isinstance(value, str):
            rows += [key, 34737, len(value) + 1, len(text)]
            text += value + "|"
        elif isinstance(value, float):
            rows += [key, 34736, 1, len(numbers)]
            numbers.append(value)
        else:
            rows += [key, 0, 1, value]
    tags = [(34735, "H", len(rows) + 4, (1, 1, 0, len(keys), *rows), True)] if keys else []
    tags += [(34736, "d", len(numbers), tuple(numbers), True)] if numbers else []
    return tags + ([(34737, "s", 0, text + extra, True)] if text else [])


def write_geotiff(path, values, *, corner=None, step=STEP, keys=UTM_32, nodata=None, tags=(), place="scale", **options):
    """A GeoTIFF whose first pixel has its north-west corner there; by default the middles are at `axes`.

    ``place``: scale (and tie point), matrix, or none.
    """
    height = np.asarray(values).shape[0]
    corner = (EAST - 0.5 * step, NORTH + (height - 0.5) * step) if corner is None else corner
    extra = geokeys(keys)
    if place == "scale":
        extra += [(33550, "d", 3, (step, step, 0.0), True), (33922, "d", 6, (0.0, 0.0, 0.0, *corner, 0.0), True)]
    elif place == "matrix":
        extra.append(
            (
                34264,
                "d",
                16,
                (step, 0.0, 0.0, corner[0], 0.0, -step, 0.0, corner[1], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0),
                True,
            )
        )
    if nodata is not None:
        extra.append((42113, "s", 0, str(nodata), True))
    tifffile.imwrite(path, values, photometric="minisblack", metadata=None, extratags=[*extra, *tags], **options)
    return path


def write_asc(path, values, *, corner=True, step=STEP, nodata=-9999, digits=17):
    """An ESRI ASCII grid of `axes`, by the corner of its south-western cell or by its middle."""
    rows, columns = values.shape
    half = 0.5 * step if corner else 0.0
    word = "corner" if corner else "center"
    lines = [
        f"ncols {columns}",
        f"nrows {rows}",
        f"xll{word} {EAST - half!r}",
        f"yll{word} {NORTH - half!r}",
        f"cellsize {step}",
        f"NODATA_value {nodata}",
    ]
    lines += [" ".join(f"{nodata if np.isnan(z) else z:.{digits}g}" for z in row) for row in values]
    path.write_text("\n".join(lines) + "\n")
    return path


def points_of(values, shape=SHAPE, step=STEP):
    """x, y, z of the nodes [N, 3], row after row from the north."""
    x, y = axes(shape, step)
    return np.column_stack([np.tile(x, len(y)), np.repeat(y, len(x)), np.asarray(values).ravel()])


def write_text(path, points, *, delimiter=" ", header=None, comma=False):
    """Lines of numbers with all their digits."""
    lines = [delimiter.join(repr(float(value)) for value in row) for row in points]
    text = "\n".join(lines) + "\n"
    path.write_text((header + "\n" if header else "") + (text.replace(".", ",") if comma else text), encoding="utf-8")
    return path


def write_las(path, points, classes=None, *, vlrs=(), scale=0.001, version="1.2", point_format=1):
    """A LAS file, or LAZ by its ending."""
    import laspy

    header = laspy.LasHeader(point_format=point_format, version=version)
    header.offsets, header.scales = [EAST, NORTH, 0.0], [scale, scale, 1e-6]
    header.vlrs.extend(vlrs)
    las = laspy.LasData(header)
    las.x, las.y, las.z = np.asarray(points, float).T
    if classes is not None:
        las.classification = np.asarray(classes, np.uint8)
    las.write(path)
    return path
