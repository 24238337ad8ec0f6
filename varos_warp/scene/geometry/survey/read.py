"""A block of kind ``heights`` becomes a mesh, with what there is to tell of its survey."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from varos_warp.errors import InputError, counted
from varos_warp.files import require_file
from varos_warp.scene.description.survey import CLOUDS, GEOTIFFS, GRIDS, TEXTS, Heights, ending
from varos_warp.scene.geometry.foreign import REMEDIES
from varos_warp.scene.geometry.mesh_files import FORMATS
from varos_warp.scene.geometry.survey import grid, scattered
from varos_warp.scene.geometry.survey.asc import read_asc
from varos_warp.scene.geometry.survey.columns import read_points
from varos_warp.scene.geometry.survey.content import Cloud, Raster, Request
from varos_warp.scene.geometry.survey.crs import MOST_TEXT, UNITS
from varos_warp.scene.geometry.survey.geotiff import read_geotiff
from varos_warp.scene.geometry.survey.las import read_las
from varos_warp.scene.geometry.survey.pictures import read_array, read_picture

READERS: dict[str, Callable[[Request], Raster | Cloud]] = {
    **dict.fromkeys(GEOTIFFS, read_geotiff),
    ".asc": read_asc,
    ".png": read_picture,
    ".npy": read_array,
    **dict.fromkeys(TEXTS, read_points),
    **dict.fromkeys(CLOUDS, read_las),
}
FILLS = (-9999.0, -99999.0, -32768.0, -32767.0, 32767.0, 9999.0, 99999.0, 1e5, -1e5)
"""Numbers that many programs write where they know no height."""
MANY_ZEROS = 0.1
"""Share of values that are 0 from which they may well stand for none."""
STEEPEST = 2.0
"""Range of heights in widths of a survey, beyond which heights are rather in another unit."""
FARTHEST_M = 1e9
"""The largest coordinate or height; beyond, the unit or the value for none is wrong."""


@dataclass(frozen=True)
class Survey:
    """The surface of a survey, and what to tell of it."""

    vertices: np.ndarray
    """float64 [V, 3] [m], in the axes of the file."""
    faces: np.ndarray
    """int32 [F, 3], counter-clockwise seen from above."""
    facts: dict
    """``files``, ``crs``, ``size`` ([rows, columns] or the number of points), ``spacing_m``, ``extent_m``,
    ``heights_m``, ``missing`` nodes, ``holes`` and ``hole_area_m2``, as plain JSON types."""
    warnings: list[str]
    """What may be wrong, a sentence each."""


def read_survey(asked: Heights, resolve: Callable[[str], Path] = Path, key: str = "terrain") -> Survey:
    """Read the files of a block.

    Raises:
        InputError: A file cannot be read, or its heights or places are not what a sea floor is made of.
    """
    paths = [resolve(name) for name in asked.files]
    found = [_in_metres(_read(request), request) for request in (Request(path, asked, key) for path in paths)]
    whole, crs = _joined(found, paths, key)
    notes = [note for each in found for note in each.notes] + [note for path in paths for note in _unread(path)]
    make = _surface_of_grid if isinstance(whole, Raster) else _surface_of_points
    vertices, faces, facts = make(whole, asked, paths[0], key)
    facts = {"files": [path.name for path in paths], "crs": crs, **facts}
    return Survey(vertices, faces, facts, [*dict.fromkeys(notes), *_doubts(facts, asked)])


def _joined(found: list, paths: list[Path], key: str) -> tuple[Raster | Cloud, str | None]:
    """What files hold as one grid or as points, and the name of their system or None."""
    if len({type(each) for each in found}) > 1:
        raise InputError(
            "grids and points cannot be joined",
            file=paths[0],
            key=f"{key}.file",
            remedy="Name files of one kind, or join meshes with `varos-warp preprocess`.",
        )
    crs = list(dict.fromkeys(each.reference.name for each in found if each.reference.name))
    if len(crs) > 1:
        raise InputError(
            f"the files lie in different systems: {', '.join(crs)}",
            file=paths[0],
            key=f"{key}.file",
            remedy="Project them to one.",
        )
    system = crs[0] if crs else None
    if isinstance(found[0], Raster):
        return grid.mosaic(found, [str(path) for path in paths], key), system
    points = np.concatenate([each.points for each in found])
    return scattered.grid_of(points) or Cloud(points), system


def _read(request: Request) -> Raster | Cloud:
    require_file(
        request.path, "survey file", "Paths are relative to the scene file; correct the path.", f"{request.key}.file"
    )
    if request.path.stat().st_size == 0:
        raise request.error("the file is empty (0 bytes)", "Copy or export it again.")
    suffix = ending(request.path.name)
    if suffix in READERS:
        return READERS[suffix](request)
    remedy = (
        "A mesh needs no kind: leave out kind, or give kind: file"
        if suffix in FORMATS
        else REMEDIES.get(suffix, "Export it in another format")
    )
    raise request.error(
        f"unknown survey format '{request.path.suffix}'", f"{remedy}. Surveys are {', '.join(READERS)}."
    )


def _unread(path: Path) -> list[str]:
    """Warnings of what GDAL or ArcGIS wrote beside a grid, if it says more than the grid itself."""
    mask = path.with_name(f"{path.name}.msk")
    if ending(path.name) in GRIDS and ending(path.name) not in GEOTIFFS and mask.is_file():
        return [f"{mask.name} is a mask, which is read beside GeoTIFF only; gdal_translate to .tif writes it so"]
    beside = path.with_name(f"{path.name}.aux.xml")
    if ending(path.name) not in GRIDS or not beside.is_file():
        return []
    with beside.open("rb") as file:
        text = file.read(MOST_TEXT).decode("utf-8", "replace")
    words = ("SRS", "GeoTransform", "NoDataValue", "UnitType", "Scale", "Offset")
    said = ", ".join(word for word in words if f"<{word}" in text)
    return [f"{beside.name} has {said}, which is not read; gdal_translate writes it into the file"] if said else []


# --------------------------------------------------------------------------------------------------- metres, and which


def _in_metres(read: Raster | Cloud, request: Request) -> Raster | Cloud:
    """Coordinates and heights in metres, up, with the offset, in the region."""
    asked, (unit, height_unit) = request.asked, _units(read.reference, request)
    factor = height_unit * (1.0 if asked.height_scale is None else asked.height_scale)
    factor = -factor if _downwards(read.reference, request) else factor
    if isinstance(read, Raster):
        read = replace(read, T=read.T * unit)
    else:
        read = replace(read, points=read.points * (unit, unit, 1.0))
    read = _cut(read, asked.region) if asked.region else read
    heights = read.values if isinstance(read, Raster) else read.points[:, 2]
    if not heights.size or np.isnan(heights).all():
        where = " in the region" * (asked.region is not None)
        raise request.error(
            f"there are no heights{where}",
            "Look at its extent, and at the value that stands for none.",
            "region" if asked.region else "file",
            asked.region and list(asked.region),
        )
    common = [fill for fill in FILLS if fill in (float(np.nanmin(heights)), float(np.nanmax(heights)))]
    if common and asked.nodata is None:
        read.notes.append(f"values of {common[0]:g} look as if they stood for none; if so give nodata: {common[0]:g}")
    if isinstance(read, Raster):
        read.notes.extend([*_zeros(heights, asked), *_steep(read, factor, asked)])
    heights *= factor
    heights += asked.height_offset_m
    return _checked(read, heights, request)


def _zeros(heights: np.ndarray, asked: Heights) -> list[str]:
    """A note of many values that are 0 in a grid without any that stands for none."""
    black = asked.height_range_m[0] if asked.height_range_m else 0.0
    share = np.count_nonzero(heights == black) / heights.size
    if asked.nodata is not None or np.isnan(heights).any() or not MANY_ZEROS <= share < 1.0:
        return []
    return [f"{share:.0%} of its values are 0; if they stand for none give nodata: 0"]


def _steep(read: Raster, factor: float, asked: Heights) -> list[str]:
    """A note of whole numbers that differ by more metres than a sea floor does, as those in centimetres do."""
    low, high = np.nanmin(read.values), np.nanmax(read.values)
    wide = float(np.ptp(grid.extent(read).reshape(2, 2), axis=0).max())
    tall = abs(factor) * (high - low)
    given = asked.height_scale is not None or asked.height_range_m is not None
    if given or tall <= STEEPEST * wide or not (np.isnan(read.values) | (read.values % 1.0 == 0.0)).all():
        return []
    return [
        f"its heights are whole numbers and differ by {tall:.3g} m over {wide:.3g} m; if they are in cm give "
        "height_scale: 0.01"
    ]


def _cut(read: Raster | Cloud, region) -> Raster | Cloud:
    """What lies in a region xmin, ymin, xmax, ymax."""
    if isinstance(read, Raster):
        return grid.window(read, region)
    places = read.points[:, :2]
    inside = ((places >= region[:2]) & (places <= region[2:])).all(axis=1)
    return replace(read, points=read.points[inside])


def _checked(read, heights, request):
    """Return what was read, if all of it lies where a sea floor can; else refuse it."""
    far = float(np.nanmax(np.abs(heights)))
    if far > FARTHEST_M:
        raise request.error(f"a height is {far:.3g} m", "Give nodata if this stands for none, or the unit.", "nodata")
    extent = grid.extent(read) if isinstance(read, Raster) else read.points[:, :2]
    if not np.abs(extent).max() <= FARTHEST_M:
        raise request.error("lies more than a million kilometres from its origin", "Give the unit.", "unit")
    return read


def _units(reference, request) -> tuple[float, float]:
    """The metres in a unit of x and y, and in a unit of the heights."""
    asked = request.asked
    choices = "Give m, ft or us_ft."
    if asked.unit is not None:
        unit = UNITS[asked.unit]
    elif reference.unknown_unit:
        raise request.error(f"the unit of its coordinates is not known ({reference.unknown_unit})", choices, "unit")
    else:
        unit = 1.0 if reference.unit_m is None else reference.unit_m
    if asked.height_range_m is not None:
        return unit, 1.0
    if asked.height_unit is not None:
        return unit, UNITS[asked.height_unit]
    if reference.unknown_height_unit:
        raise request.error(
            f"the unit of its heights is not known ({reference.unknown_height_unit})", choices, "height_unit"
        )
    if reference.height_unit_m is not None:
        return unit, reference.height_unit_m
    if asked.unit is None and unit != 1.0:
        raise request.error(
            f"its coordinates are in units of {unit:.7g} m, and it does not say in which its heights are",
            choices,
            "height_unit",
        )
    return unit, unit


def _downwards(reference, request) -> bool:
    """Tell whether values grow downwards."""
    if reference.downwards and request.asked.positive is None:
        raise request.error(
            "its heights are depths by its coordinate system, but many programs write them negative",
            "Give down if they are positive below the surface, or up.",
            "positive",
        )
    return request.asked.positive == "down"


# ------------------------------------------------------------------------------------------------------------ surfaces


def _surface_of_grid(raster: Raster, asked: Heights, path: Path, key: str):
    """Vertices, faces and facts of a grid."""
    read, block = raster, (1, 1)
    if asked.resolution_m is not None:
        raster, block = grid.thinned(raster, asked.resolution_m)
    if min(raster.values.shape) < 2:
        size, thin = " x ".join(map(str, raster.values.shape)), " after it was thinned" * (block != (1, 1))
        raise InputError(
            f"has {size} nodes{thin}",
            file=path,
            key=f"{key}.{'resolution_m' if thin else 'file'}",
            remedy="A surface takes at least two rows and two columns.",
        )
    vertices, faces, holes = grid.mesh_of(raster, key)
    if len(faces) == 0:
        raise InputError(
            "no four neighbouring nodes have heights",
            file=path,
            key=f"{key}.file",
            remedy="Look at the value that stands for none.",
        )
    return (
        vertices,
        faces,
        _facts(vertices, holes)
        | {
            "grid": True,
            "size": list(read.values.shape),
            "spacing_m": list(grid.spacing(read.T)),
            "block": list(block),
            "missing": int(np.isnan(raster.values).sum()),
        },
    )


def _surface_of_points(cloud: Cloud, asked: Heights, path: Path, key: str):
    """Vertices, faces and facts of scattered points."""
    points = cloud.points if asked.resolution_m is None else scattered.block_means(cloud.points, asked.resolution_m)
    alone = scattered.merge_stacked(points)
    try:
        vertices, faces, holes, median = scattered.triangulate(alone, asked.longest_edge_m, key)
    except InputError as error:
        raise error.but(file=path) from None
    return (
        vertices,
        faces,
        _facts(vertices, holes)
        | {"grid": False, "size": len(cloud.points), "spacing_m": [median], "stacked": len(points) - len(alone)},
    )


def _facts(vertices, holes) -> dict:
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    return {
        "extent_m": [*low[:2].tolist(), *high[:2].tolist()],
        "heights_m": [float(low[2]), float(high[2])],
        "holes": holes.count,
        "hole_area_m2": holes.area_m2,
    }


def _doubts(facts: dict, asked: Heights) -> list[str]:
    """Warnings of what looks wrong."""
    found, (xmin, ymin, xmax, ymax), (low, high) = [], facts["extent_m"], facts["heights_m"]
    wide = max(xmax - xmin, ymax - ymin)
    if max(abs(xmin), abs(xmax)) <= 360.0 and max(abs(ymin), abs(ymax)) <= 90.0 and high - low > 5.0 * wide:
        found.append(
            f"its heights differ by {high - low:.3g} m over {wide:.3g} m: its coordinates may be degrees, "
            "which must be projected to metres, or its heights have another unit"
        )
    stated = asked.positive or asked.height_range_m or (asked.origin and asked.origin[2])
    if low > 0.0 and not stated:
        found.append(f"its heights are all above 0, {low:.3g} to {high:.3g} m; if they are depths, give positive: down")
    if facts["holes"]:
        what = "they are left open (preprocess: {fill_holes_m: WIDTH} fills them)"
        if asked.preprocess:
            what = "preprocess fills those that are narrow enough"
        count, area = counted(facts["holes"], "hole"), facts["hole_area_m2"]
        found.append(f"{count} without heights, {area:.4g} m2 in all; {what}")
    if stacked := facts.get("stacked"):
        found.append(f"{counted(stacked, 'point')} above or below others became one with them, at their mean height")
    if asked.longest_edge_m is not None and facts["grid"]:
        found.append("longest_edge_m: has no effect, for the points lie on a grid, whose missing nodes are holes")
    if asked.resolution_m is not None and facts["grid"] and facts["block"] == [1, 1]:
        found.append(f"resolution_m: {asked.resolution_m:g} m is no coarser than its own spacing: nothing is thinned")
    return found
