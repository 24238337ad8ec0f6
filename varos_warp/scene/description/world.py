"""The world: terrain, objects, scattered copies and materials."""

from typing import Annotated, Literal

from pydantic import ConfigDict, Field, model_validator

from varos_warp.scene.block import (
    Block,
    NonNegative,
    Position,
    Positive,
    Rectangle,
    Unit,
    UnitRgb,
    kind_by_default,
    unwritten_if_absent,
    written_otherwise,
)
from varos_warp.scene.description.fittings import Anode, ConcreteBlock, FlangeJoint, HandWheel
from varos_warp.scene.description.placed import Measure, Movable, Parametric, Placed
from varos_warp.scene.description.structures import HullSection, MooringChain, QuayWall, Rov, WellheadPanel
from varos_warp.scene.description.surfaces import Layered

# ---------------------------------------------------------------------------------------------------------- geometry


UpAxis = Literal["x", "y", "z"]


def _up_for_short(block):
    """``up`` is short for ``up_axis``."""
    if not isinstance(block, dict) or "up" not in block:
        return block
    if block.get("up_axis") is not None:
        raise ValueError("give up or up_axis, not both: they mean the same")
    return {("up_axis" if key == "up" else key): value for key, value in block.items()}


def _up_in_schema(schema):
    """The JSON Schema knows ``up`` too."""
    schema["properties"]["up"] = schema["properties"]["up_axis"] | {"title": "Up"}


class Preprocess(Block):
    """Repair of a raw terrain mesh before use (paper 3.1.1)."""

    region: Rectangle | None = Field(default=None, examples=[[850, 270, 930, 350]])
    """Keep only xmin, ymin, xmax, ymax, in the axes of the file [m]. Absent: all."""
    merge_tolerance_m: NonNegative | None = Field(default=None, examples=[0.001])
    """Vertices nearer than this become one [m]; absent: 1 mm, or a quarter of the median edge if that is less."""
    fill_holes_m: NonNegative | None = Field(default=None, examples=[0.5])
    """Holes up to this wide are filled [m]; absent: up to ten median edges. A shrinkwrap closes all of them."""
    smoothing_rounds: Annotated[int, Field(ge=0, le=1000)] = 0
    """Rounds of Taubin's smoothing, for rough surveys; 10 halve what is shorter than about 6 edges."""
    shrinkwrap_resolution: Annotated[int, Field(ge=2, le=10_000)] | Literal["auto"] | None = Field(
        default=None, examples=[513]
    )
    """Vertices along the longer side of a new surface around the model; auto: twice as fine as the model. Absent: the
    model's own surface."""
    close: Literal["skirt", "solid", "none"] = "skirt"
    """What closes a shrinkwrapped sheet along its outline: a skirt, a skirt and a bottom, or nothing."""
    target_vertices: Annotated[int, Field(ge=4)] | None = Field(default=None, examples=[250000])
    """Decimate to this many vertices, skirt and bottom included, or hardly fewer. Absent: all are kept."""


class Detail(Block):
    """Seeded fractal relief for a terrain that was surveyed too coarsely for close views."""

    relief_m: Positive = 0.5
    """Height from the lowest to the highest point of the added relief [m]."""
    feature_m: Positive = 25.0
    """Size of the widest forms [m]."""
    rockiness: Unit = 0.4
    """Share of the area that is rock; the rest is smooth, as sand."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 1
    """Seed of the shape."""


class Ground(Placed):
    """What every sea floor may have."""

    around_objects: bool | None = Field(default=None, examples=[True])
    """Whether drifts and moats lie where objects and copies stand in it; its material must be ``layered``. Absent:
    no."""


class Terrain(Ground):
    """The sea floor: one mesh file, or several to join."""

    model_config = ConfigDict(json_schema_extra=_up_in_schema)

    kind: Literal["file"] = "file"
    file: str | Annotated[list[str], Field(min_length=1)] = Field(examples=["seabed.obj"])
    """Mesh file, or a list of files to join: DAE, OBJ, PLY, STL, GLB, GLTF or OFF, relative to the scene file."""
    up_axis: UpAxis | None = None
    """Which axis of the file points up, also written ``up``; absent: as the file says (DAE, glTF), else z."""
    preprocess: Preprocess | None = None
    """Repair of a raw survey before use (docs/terrain.md). Absent: the mesh is used as it is."""
    detail: Detail | None = None
    """Seeded relief added to a terrain that was surveyed too coarsely for close views. Absent: none."""
    shading: Literal["flat", "smooth"] = "smooth"
    """Normals that A and B are lit with, of the triangles or smoothed; C always has the smoothed ones."""
    origin: Position | None = Field(default=None, examples=[[400000, 6100000, 0]])
    """Place in the axes of the file that becomes 0, 0, 0, before scale, rotation and position [m]. Absent: coordinates
    stay as they are."""

    _written = unwritten_if_absent("origin", "class_", "around_objects")

    _up = model_validator(mode="before")(_up_for_short)


class ProceduralTerrain(Ground):
    """A sea floor made from a seed: sand flats with rocky outcrops, centred at its origin."""

    kind: Literal["procedural"]
    size_m: Positive = 60.0
    """Side of the square [m]."""
    resolution: Annotated[int, Field(ge=2, le=4097)] = 257
    """Vertices along a side."""
    relief_m: NonNegative = 2.0
    """Height from the lowest to the highest point [m]."""
    feature_m: Positive = 25.0
    """Size of the widest forms [m]."""
    rockiness: Unit = 0.4
    """Share of the area that is rock; the rest is smooth, as sand."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 1
    """Seed of the shape."""
    shading: Literal["flat", "smooth"] = "smooth"
    """Normals that A and B are lit with, of the triangles or smoothed; C always has the smoothed ones."""

    _written = unwritten_if_absent("class_", "around_objects")


class MeshObject(Movable):
    """An object from a mesh file."""

    model_config = ConfigDict(json_schema_extra=_up_in_schema)

    kind: Literal["mesh"] = "mesh"
    file: str = Field(examples=["panel.dae"])
    """Mesh file: DAE, OBJ, PLY, STL, GLB, GLTF or OFF, relative to the scene file."""
    up_axis: UpAxis | None = None
    """Which axis of the file points up, also written ``up``; absent: as the file says (DAE, glTF), else z."""
    shading: Literal["flat", "smooth"] = "flat"
    """Normals that A and B are lit with, of the triangles or smoothed; C always has the smoothed ones."""

    _up = model_validator(mode="before")(_up_for_short)


class Pipe(Parametric):
    """A straight pipe along its own z axis, centred at its origin."""

    kind: Literal["pipe"]
    radius: Measure = Field(examples=[0.15])
    """Outer radius [m]."""
    length: Measure = Field(examples=[3.0])
    """Length along its own z axis [m]."""
    wall: Measure | None = Field(default=None, examples=[0.012])
    """Wall thickness [m]; absent: 8 % of the radius. The radius or more makes a solid rod."""


class Elbow(Parametric):
    """A pipe bend in its own xz plane, from the origin along +z towards +x."""

    kind: Literal["elbow"]
    radius: Measure = Field(examples=[0.15])
    """Outer radius of the pipe [m]."""
    bend_radius: Measure = Field(examples=[0.4])
    """Radius of the bend, to the pipe's axis [m]."""
    angle_deg: Annotated[float, Field(ge=0.1, le=360.0)] = 90.0
    """Angle of the bend [degrees]; 360 is a closed ring."""
    wall: Measure | None = Field(default=None, examples=[0.012])
    """Wall thickness [m]; absent: 8 % of the radius. The radius or more makes a solid rod."""


class Flange(Parametric):
    """A plate flange (EN 1092-1, PN 16) for a pipe of ``radius`` along its own z axis, from z = 0 up."""

    kind: Literal["flange"]
    radius: Measure = Field(examples=[0.15])
    """Outer radius of the pipe [m]; between the standard's sizes the nearest one, scaled."""


class PipeSupport(Parametric):
    """A saddle that carries a pipe of ``radius`` along its own y axis; its origin is on the pipe's axis."""

    kind: Literal["pipe_support"]
    radius: Measure = Field(examples=[0.15])
    """Outer radius of the pipe [m]."""
    height: Measure | None = Field(default=None, examples=[0.6])
    """Height from the foot up to the pipe's axis [m]; absent: twice the radius."""
    cradle_deg: Annotated[float, Field(ge=60.0, le=165.0)] | None = Field(default=None, examples=[120])
    """Angle over which the groove holds the pipe [degrees]: with 120 the block ends well below the pipe's axis.
    Absent: 157, up to the axis."""
    length: Measure | None = Field(default=None, examples=[0.5])
    """Length along the pipe at its top [m]; absent: 1.2 times the radius."""
    batter_deg: Annotated[float, Field(ge=0.0, le=40.0)] | None = Field(default=None, examples=[12])
    """How far its four faces lean, wider at the foot [degrees]. Absent: two upright ends, and sides that lean a
    little."""

    _written = unwritten_if_absent("path", "class_", "max_edge_m", "length", "batter_deg")


class Bolt(Parametric):
    """A hexagon bolt (ISO 4014) along its own z axis, head down at the origin."""

    kind: Literal["bolt"]
    size: Annotated[str, Field(pattern=r"^M\d+(\.\d+)?$")] = Field(examples=["M24"])
    """Metric size, M3 to M64."""
    length: Measure | None = Field(default=None, examples=[0.1])
    """Length of the shank [m]; absent: four diameters."""


class Nut(Parametric):
    """A hexagon nut (ISO 4032) around its own z axis, centred."""

    kind: Literal["nut"]
    size: Annotated[str, Field(pattern=r"^M\d+(\.\d+)?$")] = Field(examples=["M24"])
    """Metric size, M3 to M64."""


class Valve(Parametric):
    """A flanged valve on a pipe of ``radius`` along its own y axis, its hand wheel above (+z)."""

    kind: Literal["valve"]
    radius: Measure = Field(examples=[0.15])
    """Outer radius of the pipe [m]."""
    bolted: bool = False
    """Whether its flanges are bolted to two of the pipe."""


class Boulder(Parametric):
    """A rock, about ``diameter`` wide, centred at its origin; its shape follows from ``seed``."""

    kind: Literal["boulder"]
    diameter: Measure = 0.6
    """Width of the boulder, about [m]."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 1
    """Seed of the boulder's shape."""
    form: Literal["rounded", "joints"] | None = Field(default=None, examples=["joints"])
    """``rounded``: as weather and water leave a stone; ``joints``: a block between three sets of joints, with chipped
    corners, as broken rock lies at the foot of a slope. Absent: rounded."""

    _written = unwritten_if_absent("path", "class_", "form")


class CalibrationBoard(Movable):
    """A checkerboard or an AprilGrid in its own xz plane that faces -y, centred at its origin.

    Unrotated, it stands upright before a camera that looks along +y. Without ``material`` it is black and white.
    """

    kind: Literal["calibration_board"]
    pattern: Literal["checkerboard", "aprilgrid"] = "checkerboard"
    """What is printed on it: squares, with a margin of one square; or tags with a black border of two of their cells
    and black squares between their corners, as Kalibr prints them."""
    rows: Annotated[int, Field(ge=2, le=100)] = 6
    """Count along the board's height: of a checkerboard its inner corners, as OpenCV and Kalibr count them, one less
    than squares; of an AprilGrid its tags."""
    columns: Annotated[int, Field(ge=2, le=100)] = 9
    """Count along the board's width, of the same things as ``rows``."""
    square_m: Measure | None = Field(default=None, examples=[0.05])
    """Side of a square of a checkerboard [m]; a checkerboard needs it."""
    family: Literal["36h11"] | None = Field(default=None, examples=["36h11"])
    """Family of the tags of an AprilGrid; absent: 36h11. It has 587 tags, so rows times columns are at most that."""
    tag_m: Measure | None = Field(default=None, examples=[0.088])
    """Side of a tag of an AprilGrid with its border [m], Kalibr's tagSize; an AprilGrid needs it."""
    spacing: Annotated[Positive, Field(le=1.0)] | None = Field(default=None, examples=[0.3])
    """Gap between tags of an AprilGrid over ``tag_m``, Kalibr's tagSpacing; absent: 0.3."""
    thickness_m: Measure = 0.005
    """Thickness of the board, behind the pattern [m]."""
    shading: Literal["flat", "smooth"] = "flat"
    """Normals that A and B are lit with, of the triangles or smoothed; C always has the smoothed ones."""

    _written = unwritten_if_absent("path", "class_", "square_m", "family", "tag_m", "spacing")

    @model_validator(mode="after")
    def _has_what_its_pattern_needs(self):
        needs, foreign = {
            "checkerboard": ("square_m", ("family", "tag_m", "spacing")),
            "aprilgrid": ("tag_m", ("square_m",)),
        }[self.pattern]
        for key in foreign:
            if getattr(self, key) is not None:
                raise ValueError(f"{key}: is not a key of a board with pattern {self.pattern}; leave it out")
        if getattr(self, needs) is None:
            raise ValueError(f"{needs}: is missing; a board with pattern {self.pattern} needs it")
        if self.pattern == "aprilgrid" and self.rows * self.columns > 587:
            raise ValueError(f"rows times columns: {self.rows * self.columns} is more than the 587 tags of 36h11")
        return self


class ColorChart(Movable):
    """The 24 patches of the ColorChecker on a black board, in its own xz plane that faces -y, centred at its origin.

    Unrotated, it stands upright before a camera that looks along +y, dark skin at the upper left and black at the lower
    right. In water by wavelength, patches reflect as measured (docs/spectra.md); else as their colours under D65.
    """

    kind: Literal["color_chart"]
    size_m: tuple[Measure, Measure] = (0.279, 0.216)
    """Width and height of the board [m]."""
    patch_m: Measure = 0.04
    """Side of a patch [m]; the 6 columns and 4 rows are in the middle of the board."""
    gap_m: Measure = 0.006
    """Gap between patches [m]."""
    thickness_m: Measure = 0.003
    """Thickness of the board, behind the patches [m]."""
    shading: Literal["flat", "smooth"] = "flat"
    """Normals that A and B are lit with, of the triangles or smoothed; C always has the smoothed ones."""

    @model_validator(mode="after")
    def _patches_lie_on_it(self):
        for size, side, count in zip(self.size_m, ("wide", "high"), (6, 4), strict=True):
            needed = count * self.patch_m + (count - 1) * self.gap_m
            if size < needed + 2e-4:
                raise ValueError(
                    f"size_m: {count} patches of {self.patch_m:g} m with gaps of {self.gap_m:g} m "
                    f"are {needed:g} m {side}, and the board is {size:g} m; make it 0.2 mm larger, "
                    "or patch_m smaller"
                )
        return self


ParametricObject = (
    Pipe
    | Elbow
    | Flange
    | PipeSupport
    | Bolt
    | Nut
    | Valve
    | Boulder
    | HullSection
    | MooringChain
    | QuayWall
    | WellheadPanel
    | Rov
    | Anode
    | FlangeJoint
    | HandWheel
    | ConcreteBlock
)
Object = Annotated[
    MeshObject | ParametricObject | CalibrationBoard | ColorChart, Field(discriminator="kind"), kind_by_default("mesh")
]


class Scatter(Block):
    """Copies of one object strewn over the terrain, where chance and ``clearance_m`` put them."""

    object: Object
    """The object to copy, its own scale and rotation applied first; it has no position."""
    count: Annotated[int, Field(ge=1, le=20000)] = Field(examples=[200])
    """Number of copies."""
    area: Rectangle | None = Field(default=None, examples=[[-5, 0, 5, 10]])
    """Rectangle xmin, ymin, xmax, ymax to strew copies on [m]; without ``area``, ``circle`` and ``polygon`` the whole
    terrain."""
    circle: tuple[float, float, Positive] | None = Field(default=None, examples=[[0, 6, 4]])
    """Circle x, y, radius to strew copies on [m]."""
    polygon: Annotated[list[tuple[float, float]], Field(min_length=3)] | None = Field(
        default=None, examples=[[[0, 0], [5, 0], [0, 5]]]
    )
    """Corners x, y, in order, of a polygon to strew copies on [m]."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 1
    """Seed of the places, together with that of the scene; raising ``count`` keeps the places of the first copies."""
    clearance_m: float = 0.0
    """Least gap between the circles around two copies, seen from above, and to any object [m]; below zero they
    overlap."""
    sink_m: float = 0.0
    """Depth of the lowest point under the ground [m], times the copy's scale; negative: above it."""
    buried: tuple[Unit, Unit] | None = Field(default=None, examples=[[0.1, 0.5]])
    """Least and largest share of a copy's height that lies under the ground, beside ``sink_m``; chance decides. Absent:
    0.1 to 0.5 of boulders of a layered material, which stones on the sea floor are; 0 of all else."""
    random_yaw: bool = True
    """Whether each copy is turned about the vertical at random."""
    max_tilt_deg: Annotated[float, Field(ge=0.0, le=90.0)] = 0.0
    """Copies lean with the terrain by at most this angle [degrees]: 0 stands upright, 90 follows every slope."""
    max_slope_deg: Annotated[float, Field(gt=0.0, le=90.0)] = 90.0
    """Steepest slope of the terrain on which copies stand [degrees]."""
    scale_range: tuple[Positive, Positive] = (1.0, 1.0)
    """Smallest and largest scale; all between are equally likely, unless ``size_exponent`` says otherwise."""
    size_exponent: Annotated[float, Field(ge=0.0, le=10.0)] | None = Field(default=None, examples=[2.0])
    """The number of copies of more than a scale s falls as s to the minus this, within ``scale_range``: few are large,
    as of broken rock, whose exponent is 2 to 3. Absent: all scales are equally likely."""
    shapes: Annotated[int, Field(ge=1, le=64)] | None = Field(default=None, examples=[12])
    """Number of shapes of a boulder, of seeds that follow its own; copies have them in turn. Absent: 1."""

    _written = unwritten_if_absent("shapes", "buried", "size_exponent")

    @model_validator(mode="after")
    def _only_boulders_differ(self):
        if (self.shapes or 1) > 1 and not isinstance(self.object, Boulder):
            raise ValueError(
                f"shapes: the form of a {self.object.kind} does not follow from a seed; leave it out, or "
                "scatter a boulder"
            )
        return self

    @model_validator(mode="after")
    def _one_area(self):
        if sum(region is not None for region in (self.area, self.circle, self.polygon)) > 1:
            raise ValueError("give at most one of area, circle, polygon")
        if self.object.path is not None:
            raise ValueError("object.path: copies of a scatter stand still; give an object that moves among objects")
        if any(self.object.position):
            raise ValueError("the object of a scatter has no position; sink_m lowers the copies, or raises them")
        if self.scale_range[0] > self.scale_range[1]:
            raise ValueError("scale_range is [smallest, largest]")
        if self.buried is not None and self.buried[0] > self.buried[1]:
            raise ValueError(f"buried: {list(self.buried)} begins above its end; give [least, largest]")
        return self


# --------------------------------------------------------------------------------------------------------- materials


class Diffuse(Block):
    """Matte surface of one reflectance per channel."""

    kind: Literal["diffuse"] = "diffuse"
    reflectance: UnitRgb = (0.5, 0.5, 0.5)
    """Share of the light that is reflected, linear, for red, green and blue."""
    diffuse_roughness: Unit = 0.0
    """How rough it is below the size of a pixel: 0 is Lambert's law; sand is 0.5 (docs/surfaces.md)."""

    _written = written_otherwise(lambda block: [] if block.diffuse_roughness else ["diffuse_roughness"])


GROUND_TEXTURES = ("sand", "rock")
"""Names of the textures that ship; anything else is an image file."""


class Texture(Block):
    """A texture that covers the surface without end: its tile is ``size_m`` wide, or fits ``tiles`` times into it."""

    texture: Annotated[str, Field(min_length=1)] = Field(examples=["sand"])
    """``sand``, ``rock`` or an image file, relative to the scene file."""
    tiles: Positive = 50.0
    """Number of tiles along the surface's longer side."""
    size_m: Positive | None = Field(default=None, examples=[1.5])
    """Width of a tile [m], instead of ``tiles``; 1 to 2 m suit sand and rock."""


class SlopeBlend(Block):
    """One texture where the surface looks up, another where it is steep (paper 3.1.1)."""

    kind: Literal["slope_blend"]
    flat: Texture = Texture(texture="sand")
    """Texture where the surface looks up."""
    steep: Texture = Texture(texture="rock")
    """Texture where the surface is steep; the same as ``flat`` for one texture everywhere."""


class Metal(Block):
    """Bare metal: it mirrors as roughly as ``roughness`` says."""

    kind: Literal["metal"]
    base: UnitRgb = (0.56, 0.57, 0.58)
    """Reflectance at normal incidence, linear, for red, green and blue."""
    roughness: Unit = 0.3
    """How blurred reflections are: 0 is polished, 1 is dull."""


class Rust(Block):
    """Metal or paint with rust patches; the pattern follows from the object's position (paper 3.1.2)."""

    kind: Literal["rust"]
    base: UnitRgb = (0.45, 0.45, 0.47)
    """Reflectance between the patches, linear, for red, green and blue."""
    amount: Unit = 0.5
    """Share of the surface that is rusty."""
    roughness: Unit | None = Field(default=None, examples=[0.4])
    """Roughness of bare metal between the patches; absent: they are on matte paint."""


class Dirt(Block):
    """A surface under a layer of silt, in patches; the pattern follows from the object's position (paper 3.1.2)."""

    kind: Literal["dirt"]
    base: UnitRgb = (0.45, 0.45, 0.47)
    """Reflectance of the clean surface, linear, for red, green and blue."""
    amount: Unit = 0.5
    """Share of the surface that is covered."""
    silt: UnitRgb = (0.27, 0.24, 0.18)
    """Reflectance of the silt, linear, for red, green and blue."""


Material = Annotated[
    Diffuse | SlopeBlend | Metal | Rust | Dirt | Layered, Field(discriminator="kind"), kind_by_default("diffuse")
]
