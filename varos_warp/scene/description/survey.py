"""Sea floors from survey files: heights on a grid, and points."""

from pathlib import PurePath
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from varos_warp.scene.block import Coordinate, Position, Positive, Rectangle, unwritten_if_absent
from varos_warp.scene.description.world import Detail, Ground, Preprocess, ProceduralTerrain, Terrain

GEOTIFFS = (".tif", ".tiff")
ARRAYS = (".png", ".npy")
"""Endings of grids that never say where they lie."""
GRIDS = (*GEOTIFFS, ".asc", *ARRAYS)
TEXTS = (".xyz", ".csv", ".txt", ".tsv")
CLOUDS = (".las", ".laz")
ENDINGS = (*GRIDS, *TEXTS, *CLOUDS)
"""Endings of files that hold heights, for which a terrain needs no ``kind``."""

BESIDE = (".prj", ".tfw", ".tifw", ".tiffw", ".pgw", ".pngw", ".wld", ".tif.msk", ".TIF.msk", ".tiff.msk", ".TIFF.msk")
"""Endings of files beside a survey that tell where it lies, and where it has heights (GDAL's masks)."""

LengthUnit = Literal["m", "ft", "us_ft"]
Column = str | Annotated[int, Field(ge=1)]
FOR = {
    "pixel_m": (*GEOTIFFS, *ARRAYS),
    "first_row": (*GEOTIFFS, *ARRAYS),
    "height_range_m": (*GEOTIFFS, ".png"),
    "columns": TEXTS,
    "classes": CLOUDS,
    "longest_edge_m": (*TEXTS, *CLOUDS),
    "nodata": (*GRIDS, *TEXTS),
}
"""Endings of the files that a key is for, where it is not for all."""


class Heights(Ground):
    """The sea floor from survey files: heights on a grid (GeoTIFF, ESRI ASCII, PNG, NPY), or points (XYZ, CSV, LAS)."""

    kind: Literal["heights"]
    file: str | Annotated[list[str], Field(min_length=1)] = Field(examples=["bathymetry.tif"])
    """Survey file, or a list of tiles of one survey to join, relative to the scene file: TIF, ASC, PNG, NPY, XYZ, CSV,
    TSV, TXT, LAS or LAZ."""
    positive: Literal["up", "down"] | None = Field(default=None, examples=["down"])
    """Direction in which values grow: up for heights, down for depths. Absent: up, and files that speak of depth are
    refused."""
    unit: LengthUnit | None = Field(default=None, examples=["us_ft"])
    """Unit of the file's coordinates and heights: metre, international or US survey foot. Absent: as the file says,
    else metres."""
    height_unit: LengthUnit | None = Field(default=None, examples=["m"])
    """Unit of the heights, where they have another. Absent: as the file says, else as ``unit``."""
    height_scale: Positive | None = Field(default=None, examples=[0.01])
    """What the values are multiplied by to be heights in their unit. Absent: 1; pictures need it, or
    ``height_range_m``."""
    height_range_m: tuple[Coordinate, Coordinate] | None = Field(default=None, examples=[[-40, -20]])
    """Heights of black and of white in a picture of 8 or 16 bits [m], before the offset."""
    height_offset_m: Coordinate = 0.0
    """Offset that is added to the heights, such as from chart datum to mean sea level [m]."""
    nodata: float | None = Field(default=None, examples=[-9999])
    """Value that stands for no height. Absent: as the file says."""
    region: Rectangle | None = Field(default=None, examples=[[400000, 6100000, 400200, 6100100]])
    """Read only what lies in xmin, ymin, xmax, ymax, in the axes of the file [m]. Absent: all."""
    resolution_m: Positive | None = Field(default=None, examples=[2.0])
    """Thin to this spacing: of a grid means of whole blocks of nodes, of points their mean in each square of this
    side [m]. Absent: all are kept."""
    longest_edge_m: Positive | None = Field(default=None, examples=[5.0])
    """Scattered points are joined by edges up to this long, seen from above [m], so that holes stay holes. Absent:
    five median edges."""
    columns: tuple[Column, Column, Column] | None = Field(default=None, examples=[["easting", "northing", "z"]])
    """Columns of a text file that hold x, y and height: names of its header, or numbers from 1. Absent: by the header,
    else the first three."""
    classes: Annotated[list[Annotated[int, Field(ge=0, le=255)]], Field(min_length=1)] | None = Field(
        default=None, examples=[[2, 40]]
    )
    """Classes of LAS points to read: 2 is ground, 40 the bottom of water. Absent: all but noise (7 and 18)."""
    pixel_m: Positive | tuple[Positive, Positive] | None = Field(default=None, examples=[0.25])
    """Distance of neighbouring nodes of a grid that does not say where it lies, or both along x and y [m]; its middle
    is the origin."""
    first_row: Literal["north", "south"] | None = Field(default=None, examples=["south"])
    """Side of the first row of a grid that does not say where it lies: north, as of pictures, or south, where y grows
    with the row. Absent: north; NPY files need it."""
    origin: Position | None = Field(default=None, examples=[[400000, 6100000, 0]])
    """Place in the axes of the file that becomes 0, 0, 0, before scale, rotation and position [m]. Absent: coordinates
    stay as they are."""
    preprocess: Preprocess | None = None
    """Repair of a raw survey before use (docs/terrain.md). Absent: the surface is used as it is."""
    detail: Detail | None = None
    """Seeded relief added to a terrain that was surveyed too coarsely for close views. Absent: none."""
    shading: Literal["flat", "smooth"] = "smooth"
    """Normals that A and B are lit with, of the triangles or smoothed; C always has the smoothed ones."""

    _written = unwritten_if_absent(
        "positive",
        "unit",
        "height_unit",
        "height_scale",
        "height_range_m",
        "nodata",
        "region",
        "resolution_m",
        "longest_edge_m",
        "columns",
        "classes",
        "pixel_m",
        "first_row",
        "origin",
        "class_",
        "around_objects",
    )

    @property
    def files(self) -> list[str]:
        """The names of its files."""
        return [self.file] if isinstance(self.file, str) else self.file

    @model_validator(mode="after")
    def _keys_suit_the_files(self):
        for key, endings in FOR.items():
            if getattr(self, key) is not None and (
                other := [name for name in self.files if ending(name) not in endings]
            ):
                raise ValueError(f"{key}: is for {', '.join(endings)}, not for {other[0]}; leave it out")
        if self.pixel_m is not None and self.unit is not None:
            raise ValueError("unit: has no meaning beside pixel_m, which is in metres; height_unit is that of heights")
        if self.height_range_m is not None:
            for key in ("height_scale", "height_unit", "positive"):
                if getattr(self, key) is not None:
                    raise ValueError(
                        f"{key}: has no meaning beside height_range_m, which gives heights in metres; "
                        "leave one of them out"
                    )
            if self.height_range_m[0] == self.height_range_m[1]:
                raise ValueError("height_range_m: is two different heights, of black and of white")
        return self


def ending(name: str) -> str:
    """The ending of a file's name, in small letters, with its dot."""
    return PurePath(name).suffix.lower()


def _with_kind(block: Any) -> Any:
    """Give a block without ``kind`` the kind that the names of its files tell: heights or a mesh."""
    if not isinstance(block, dict) or "kind" in block:
        return block
    names = block.get("file")
    names = names if isinstance(names, list) else [names]
    heights = bool(names) and all(isinstance(name, str) and ending(name) in ENDINGS for name in names)
    return {"kind": "heights" if heights else "file", **block}


AnyTerrain = Annotated[Terrain | Heights | ProceduralTerrain, Field(discriminator="kind"), BeforeValidator(_with_kind)]
