"""The world: terrain, objects, scattered copies, materials and water."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from varos_warp.scene.description.block import (
    Block,
    Coefficient,
    CoefficientRgb,
    EulerAngles,
    NonNegative,
    Position,
    Positive,
    Rectangle,
    Unit,
    UnitRgb,
    kind_by_default,
)
from varos_warp.scene.description.phase import FournierForand, HenyeyGreenstein, MeanCosine, Phase

# ---------------------------------------------------------------------------------------------------------- geometry


UpAxis = Literal["x", "y", "z"]


class Preprocess(Block):
    """Repair of a raw terrain mesh before use (paper 3.1.1)."""

    region: Rectangle | None = None
    """Keep only xmin, ymin, xmax, ymax [m], in the axes of the file."""
    merge_tolerance_m: NonNegative | None = None
    """Vertices nearer than this become one; absent: 1 mm, or a quarter of the median edge if that is less."""
    fill_holes_m: NonNegative | None = None
    """Holes up to this wide are filled; absent: up to ten median edges. A shrinkwrap closes all of them."""
    smoothing_rounds: Annotated[int, Field(ge=0, le=1000)] = 0
    """Rounds of Taubin's smoothing, for rough surveys."""
    shrinkwrap_resolution: Annotated[int, Field(ge=2, le=10_000)] | Literal["auto"] | None = None
    """Vertices along the longer side of a new surface around the model; auto: twice as fine as the model."""
    close: Literal["skirt", "solid", "none"] = "skirt"
    """What closes a shrinkwrapped sheet along its outline: a skirt, a skirt and a bottom, or nothing."""
    target_vertices: Annotated[int, Field(ge=4)] | None = None
    """Decimate to this many vertices, skirt and bottom included, or hardly fewer."""


class Detail(Block):
    """Seeded fractal relief for a terrain that was surveyed too coarsely for close views."""

    relief_m: Positive = 0.5
    """From the lowest to the highest point of the added relief [m]."""
    feature_m: Positive = 25.0
    """Size of the widest forms [m]."""
    rockiness: Unit = 0.4
    """Share of the area that is rock."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 1


class Placed(Block):
    """Anything that stands in the world: position [m], rotation (about fixed x, then y, then z) and scale."""

    position: Position = (0.0, 0.0, 0.0)
    rotation_euler_deg: EulerAngles = (0.0, 0.0, 0.0)
    scale: Positive | tuple[Positive, Positive, Positive] = 1.0
    material: str | None = None
    smooth_angle_deg: Annotated[float, Field(ge=0.0, le=180.0)] = 30.0
    """Edges at most this sharp get smooth normals (paper, image type C)."""


class Terrain(Placed):
    """The sea floor: one mesh file, or several to join."""

    kind: Literal["file"] = "file"
    file: str | Annotated[list[str], Field(min_length=1)]
    up_axis: UpAxis | None = None
    """Which axis of the file points up; absent: as the file says (DAE, GLB), else z."""
    preprocess: Preprocess | None = None
    detail: Detail | None = None
    shading: Literal["flat", "smooth"] = "smooth"
    """Normals that A and B are lit with; C always has the smoothed ones."""


class ProceduralTerrain(Placed):
    """A sea floor made from a seed: sand flats with rocky outcrops, centred at its origin."""

    kind: Literal["procedural"]
    size_m: Positive = 60.0
    """Side of the square [m]."""
    resolution: Annotated[int, Field(ge=2, le=4097)] = 257
    """Vertices along a side."""
    relief_m: NonNegative = 2.0
    """From the lowest to the highest point [m]."""
    feature_m: Positive = 25.0
    """Size of the widest forms [m]."""
    rockiness: Unit = 0.4
    """Share of the area that is rock."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 1
    shading: Literal["flat", "smooth"] = "smooth"


AnyTerrain = Annotated[Terrain | ProceduralTerrain, Field(discriminator="kind"), kind_by_default("file")]


class MeshObject(Placed):
    """An object from a mesh file."""

    kind: Literal["mesh"] = "mesh"
    file: str
    up_axis: UpAxis | None = None
    """Which axis of the file points up; absent: as the file says (DAE, GLB), else z."""
    shading: Literal["flat", "smooth"] = "flat"


Measure = Annotated[float, Field(ge=1e-4, le=100.0)]
"""Of an object made from its measures [m]; its triangles stay few enough to be made in seconds."""


class Parametric(Placed):
    """An object made from its measures."""

    chord_error_m: Annotated[float, Field(ge=1e-6)] | None = None
    """How far its triangles may lie from the true surface [m]; absent: a 500th of its radius, 0.05 to 0.38 mm."""
    shading: Literal["flat", "smooth"] = "smooth"


class Pipe(Parametric):
    """A straight pipe along its own z axis, centred at its origin."""

    kind: Literal["pipe"]
    radius: Measure
    """Outer radius [m]."""
    length: Measure
    wall: Measure | None = None
    """Wall thickness [m]; 8 % of the radius when absent, the radius or more for a solid rod."""


class Elbow(Parametric):
    """A pipe bend in its own xz plane, from the origin along +z towards +x."""

    kind: Literal["elbow"]
    radius: Measure
    bend_radius: Measure
    angle_deg: Annotated[float, Field(ge=0.1, le=360.0)] = 90.0
    wall: Measure | None = None
    """As for a pipe."""


class Flange(Parametric):
    """A plate flange (EN 1092-1, PN 16) for a pipe of ``radius`` along its own z axis, from z = 0 up."""

    kind: Literal["flange"]
    radius: Measure
    """Outer radius of the pipe [m]; between the standard's sizes the nearest one, scaled."""


class PipeSupport(Parametric):
    """A saddle that carries a pipe of ``radius`` along its own y axis; its origin is on the pipe's axis."""

    kind: Literal["pipe_support"]
    radius: Measure
    height: Measure | None = None
    """From the pipe's axis down to the foot [m]; twice the radius when absent."""


class Bolt(Parametric):
    """A hexagon bolt (ISO 4014) along its own z axis, head down at the origin."""

    kind: Literal["bolt"]
    size: Annotated[str, Field(pattern=r"^M\d+(\.\d+)?$")]
    length: Measure | None = None
    """Shank length [m]; four diameters when absent."""


class Nut(Parametric):
    """A hexagon nut (ISO 4032) around its own z axis, centred."""

    kind: Literal["nut"]
    size: Annotated[str, Field(pattern=r"^M\d+(\.\d+)?$")]


class Valve(Parametric):
    """A flanged valve on a pipe of ``radius`` along its own y axis, its hand wheel above (+z)."""

    kind: Literal["valve"]
    radius: Measure


class Boulder(Parametric):
    """A rock, about ``diameter`` wide, centred at its origin; its shape follows from ``seed``."""

    kind: Literal["boulder"]
    diameter: Measure = 0.6
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 1


ParametricObject = Pipe | Elbow | Flange | PipeSupport | Bolt | Nut | Valve | Boulder
Object = Annotated[MeshObject | ParametricObject, Field(discriminator="kind"), kind_by_default("mesh")]


class Scatter(Block):
    """Copies of one object strewn over the terrain, where chance and ``clearance_m`` put them."""

    object: Object
    """The object to copy, its own scale and rotation applied first; it has no position."""
    count: Annotated[int, Field(ge=1, le=20000)]
    area: Rectangle | None = None
    """xmin, ymin, xmax, ymax [m]; without ``area``, ``circle`` and ``polygon`` the whole terrain."""
    circle: tuple[float, float, Positive] | None = None
    """x, y and radius [m]."""
    polygon: Annotated[list[tuple[float, float]], Field(min_length=3)] | None = None
    """Corners x, y [m], in order."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 1
    """Of the places, together with the scene's; raising ``count`` keeps the places of the first copies."""
    clearance_m: float = 0.0
    """Least gap between the circles around two copies, seen from above, and to any object; below zero they overlap."""
    sink_m: float = 0.0
    """How deep the lowest point lies under the ground [m, times the copy's scale]; negative: above it."""
    random_yaw: bool = True
    """Each copy turned about the vertical at random."""
    max_tilt_deg: Annotated[float, Field(ge=0.0, le=90.0)] = 0.0
    """Copies lean with the terrain by at most this angle: 0 stands upright, 90 follows every slope."""
    max_slope_deg: Annotated[float, Field(gt=0.0, le=90.0)] = 90.0
    """Only where the terrain is no steeper than this."""
    scale_range: tuple[Positive, Positive] = (1.0, 1.0)
    """Smallest and largest scale; all between are equally likely."""

    @model_validator(mode="after")
    def _one_area(self):
        if sum(region is not None for region in (self.area, self.circle, self.polygon)) > 1:
            raise ValueError("give at most one of area, circle, polygon")
        if any(self.object.position):
            raise ValueError("the object of a scatter has no position; sink_m lowers the copies, or raises them")
        if self.scale_range[0] > self.scale_range[1]:
            raise ValueError("scale_range is [smallest, largest]")
        return self


# --------------------------------------------------------------------------------------------------------- materials


class Diffuse(Block):
    """Lambertian surface of one reflectance per channel."""

    kind: Literal["diffuse"] = "diffuse"
    reflectance: UnitRgb = (0.5, 0.5, 0.5)


GROUND_TEXTURES = ("sand", "rock")
"""Names of the textures that ship; anything else is an image file."""


class Texture(Block):
    """A texture that covers the surface without end: its tile is ``size_m`` wide, or fits ``tiles`` times into it."""

    texture: Annotated[str, Field(min_length=1)]
    """``sand``, ``rock`` or an image file, relative to the scene file."""
    tiles: Positive = 50.0
    size_m: Positive | None = None
    """Width of a tile [m], instead of ``tiles``; 1 to 2 m suit sand and rock."""


class SlopeBlend(Block):
    """One texture where the surface looks up, another where it is steep (paper 3.1.1)."""

    kind: Literal["slope_blend"]
    flat: Texture = Texture(texture="sand")
    steep: Texture = Texture(texture="rock")


class Metal(Block):
    """Bare metal: it mirrors as roughly as ``roughness`` says."""

    kind: Literal["metal"]
    base: UnitRgb = (0.56, 0.57, 0.58)
    """Reflectance at normal incidence."""
    roughness: Unit = 0.3


class Rust(Block):
    """Metal or paint with rust patches; the pattern follows from the object's position (paper 3.1.2)."""

    kind: Literal["rust"]
    base: UnitRgb = (0.45, 0.45, 0.47)
    """Reflectance between the patches."""
    amount: Unit = 0.5
    """Share of the surface that is rusty."""
    roughness: Unit | None = None
    """Of bare metal between the patches; absent: they are on matte paint."""


class Dirt(Block):
    """A surface under a layer of silt, in patches; the pattern follows from the object's position (paper 3.1.2)."""

    kind: Literal["dirt"]
    base: UnitRgb = (0.45, 0.45, 0.47)
    """Reflectance of the clean surface."""
    amount: Unit = 0.5
    """Share of the surface that is covered."""
    silt: UnitRgb = (0.27, 0.24, 0.18)
    """Reflectance of the silt."""


Material = Annotated[Diffuse | SlopeBlend | Metal | Rust | Dirt, Field(discriminator="kind"),
                     kind_by_default("diffuse")]


# ------------------------------------------------------------------------------------------------------------- water


class Principled(Block):
    """Blender's Principled Volume (paper, table 1)."""

    density: Coefficient
    color: CoefficientRgb
    absorption_color: UnitRgb
    anisotropy: MeanCosine = 0.0


class Coefficients(Block):
    """Scattering and absorption coefficients [1/m] per channel."""

    sigma_s: CoefficientRgb
    sigma_a: CoefficientRgb
    phase: Phase = HenyeyGreenstein()


class Jerlov(Block):
    """A Jerlov water type."""

    type: Literal["I", "IA", "IB", "II", "III", "1C", "3C", "5C", "7C", "9C", "IC"]
    phase: Phase = FournierForand(kind="fournier_forand", backscatter_fraction=0.0183)
    """Absent: Fournier and Forand's, with the backscatter fraction of Petzold's average particles."""


class Water(Block):
    """Exactly one of the three forms."""

    principled: Principled | None = None
    coefficients: Coefficients | None = None
    jerlov: Jerlov | None = None

    @model_validator(mode="after")
    def _one_form(self):
        if sum(form is not None for form in (self.principled, self.coefficients, self.jerlov)) != 1:
            raise ValueError("give exactly one of principled, coefficients, jerlov (or `water: none`)")
        return self
