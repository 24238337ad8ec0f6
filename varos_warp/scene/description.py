"""What a scene file may say: one pydantic model per block. Names, units and defaults of the file format live here.

SI units; angles in degrees only in keys ending in ``_deg``. Frames: world and vehicle axes are z up; the vehicle is
x right, y forward, z up, so the identity attitude looks along +y. Unknown keys are errors.
"""

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, PrivateAttr, field_validator, model_validator

Vec3 = tuple[float, float, float]
Coordinate = Annotated[float, Field(ge=-1e9, le=1e9)]
"""[m]; float64 is finer than 0.2 micrometres up to there, and rays are no longer."""
Position = tuple[Coordinate, Coordinate, Coordinate]
Angle = Annotated[float, Field(ge=-1e6, le=1e6)]
"""[degrees]; of much larger ones whole turns would leave no digit."""
EulerAngles = tuple[Angle, Angle, Angle]
Positive = Annotated[float, Field(gt=0.0)]
NonNegative = Annotated[float, Field(ge=0.0)]
Unit = Annotated[float, Field(ge=0.0, le=1.0)]
UnitRgb = tuple[Unit, Unit, Unit]
NonNegativeRgb = tuple[NonNegative, NonNegative, NonNegative]


class Block(BaseModel):
    """Base of every block: unknown keys, NaN and infinity are errors, and a loaded block does not change."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)


# ---------------------------------------------------------------------------------------------------------- geometry


UpAxis = Literal["x", "y", "z"]


class Preprocess(Block):
    """Repair of a raw terrain mesh before use (paper 3.1.1)."""

    region: tuple[float, float, float, float] | None = None
    """Keep only xmin, ymin, xmax, ymax [m], in the axes of the file."""
    merge_tolerance_m: NonNegative = 0.001
    """Vertices nearer than this become one."""
    fill_holes_m: NonNegative | None = None
    """Holes up to this wide are filled; absent: up to ten median edges. A shrinkwrap closes all of them."""
    shrinkwrap_resolution: Annotated[int, Field(ge=2, le=10_000)] | Literal["auto"] | None = None
    """Vertices along the longer side of a new surface around the model; auto: twice as fine as the model."""
    close: Literal["skirt", "solid", "none"] = "skirt"
    """What closes a shrinkwrapped sheet along its outline: a skirt, a skirt and a bottom, or nothing."""
    target_vertices: Annotated[int, Field(ge=4)] | None = None
    """Decimate to about so many vertices."""

    @field_validator("region")
    @classmethod
    def _region_has_area(cls, value):
        if value is not None and not (value[0] < value[2] and value[1] < value[3]):
            raise ValueError("a region is [xmin, ymin, xmax, ymax] with xmin < xmax and ymin < ymax")
        return value


class Detail(Block):
    """Seeded fractal relief added to a terrain that was surveyed too coarsely for close views."""

    relief_m: Positive = 0.5
    """From the lowest to the highest point of what is added [m]."""
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
    """The sea floor: one mesh file or several that are joined."""

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


AnyTerrain = Annotated[Terrain | ProceduralTerrain, Field(discriminator="kind")]


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
    """An object that is made from its measures."""

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
Object = Annotated[MeshObject | ParametricObject, Field(discriminator="kind")]


class Scatter(Block):
    """Copies of one object strewn over the terrain, where chance and ``clearance_m`` put them."""

    object: Object
    """What is copied, its own scale and rotation applied first; it has no position."""
    count: Annotated[int, Field(ge=1, le=20000)]
    area: tuple[float, float, float, float] | None = None
    """xmin, ymin, xmax, ymax [m]; without ``area``, ``circle`` and ``polygon`` the whole terrain."""
    circle: tuple[float, float, Positive] | None = None
    """x, y and radius [m]."""
    polygon: Annotated[list[tuple[float, float]], Field(min_length=3)] | None = None
    """Corners x, y [m], in order."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 1
    """Of the places, together with the scene's; more copies keep the places of the first ones."""
    clearance_m: float = 0.0
    """Least gap between the circles around two copies, seen from above, and to any object; below zero they overlap."""
    sink_m: float = 0.0
    """How deep the lowest point lies under the ground [m, times the copy's scale]; negative: above it."""
    random_yaw: bool = True
    """Each copy turned about the vertical at random."""
    max_tilt_deg: Annotated[float, Field(ge=0.0, le=90.0)] = 0.0
    """Copies lean with the terrain, at most so far: 0 stands upright, 90 follows every slope."""
    max_slope_deg: Annotated[float, Field(gt=0.0, le=90.0)] = 90.0
    """Only where the terrain is no steeper than this."""
    scale_range: tuple[Positive, Positive] = (1.0, 1.0)
    """Smallest and largest scale; all between are equally likely."""

    @field_validator("object", mode="before")
    @classmethod
    def _file_is_mesh(cls, value: Any):
        return {"kind": "mesh", **value} if isinstance(value, dict) and "kind" not in value else value

    @model_validator(mode="after")
    def _one_area(self):
        if sum(region is not None for region in (self.area, self.circle, self.polygon)) > 1:
            raise ValueError("give at most one of area, circle, polygon")
        if self.area is not None and not (self.area[0] < self.area[2] and self.area[1] < self.area[3]):
            raise ValueError("an area is [xmin, ymin, xmax, ymax] with xmin < xmax and ymin < ymax")
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
    """Reflectance of what is between the patches."""
    amount: Unit = 0.5
    """Share of the surface that is rusty."""
    roughness: Unit | None = None
    """Of the bare metal between the patches, which then mirrors; absent: it is matte, as paint."""


class Dirt(Block):
    """A surface under a layer of silt, in patches; the pattern follows from the object's position (paper 3.1.2)."""

    kind: Literal["dirt"]
    base: UnitRgb = (0.45, 0.45, 0.47)
    """Reflectance of the clean surface."""
    amount: Unit = 0.5
    """Share of the surface that is covered."""
    silt: UnitRgb = (0.27, 0.24, 0.18)
    """Reflectance of the silt."""


Material = Annotated[Diffuse | SlopeBlend | Metal | Rust | Dirt, Field(discriminator="kind")]


# ------------------------------------------------------------------------------------------------------------- water


MeanCosine = Annotated[float, Field(ge=-0.99, le=0.999)]
"""Of a phase function; beyond, single precision does not hold the angles of its peak (docs/stability.md)."""


class HenyeyGreenstein(Block):
    """Phase function of Henyey and Greenstein (1941) with mean cosine ``g``."""

    kind: Literal["henyey_greenstein"] = "henyey_greenstein"
    g: MeanCosine = 0.0


class Principled(Block):
    """Blender's Principled Volume (paper, table 1)."""

    density: NonNegative
    color: NonNegativeRgb
    absorption_color: UnitRgb
    anisotropy: MeanCosine = 0.0


class Coefficients(Block):
    """Scattering and absorption coefficients [1/m] per channel."""

    sigma_s: NonNegativeRgb
    sigma_a: NonNegativeRgb
    phase: HenyeyGreenstein = HenyeyGreenstein()


class Jerlov(Block):
    """A Jerlov water type."""

    type: Literal["I", "IA", "IB", "II", "III", "1C", "3C", "5C", "7C", "9C", "IC"]
    phase: HenyeyGreenstein = HenyeyGreenstein(g=0.924)


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


# ----------------------------------------------------------------------------------------------------------- vehicle


def _is_representable(value: float) -> float:
    if 0.0 < value < 1e-20:
        raise ValueError("an intensity is 0 or at least 1e-20 W/sr")
    return value


Intensity = Annotated[float, Field(ge=0.0, le=1e20), AfterValidator(_is_representable)]
"""[W/sr]; beyond, single precision over- or underflows on the way of the light."""
IntensityRgb = tuple[Intensity, Intensity, Intensity]


class SpotLight(Block):
    """A spot light on the vehicle: ``intensity`` [W/sr] inside the cone, Blender's soft edge of width ``blend``."""

    kind: Literal["spot"] = "spot"
    position: Position = (0.0, 0.0, 0.0)
    direction: Vec3 = (0.0, 1.0, 0.0)
    cone_deg: Annotated[float, Field(ge=1.0, le=360.0)] = 65.0
    """Full angle of the cone; single precision does not hold the cosines of narrower ones."""
    blend: Unit = 0.0
    intensity: IntensityRgb = (100.0, 100.0, 100.0)

    @field_validator("cone_deg")
    @classmethod
    def _not_all_but_a_point(cls, value):
        if 359.9 < value < 360.0:
            raise ValueError("a cone is at most 359.9 degrees wide, or 360 for a light without one")
        return value

    @field_validator("direction")
    @classmethod
    def _has_length(cls, value):
        if np.linalg.norm(value) < 1e-6:  # float32 on the device squares it
            raise ValueError("the direction of a light must be at least 1e-6 long")
        return value


class PointLight(Block):
    """A light that shines equally in every direction, ``intensity`` [W/sr]."""

    kind: Literal["point"]
    position: Position = (0.0, 0.0, 0.0)
    intensity: IntensityRgb = (100.0, 100.0, 100.0)


Light = Annotated[SpotLight | PointLight, Field(discriminator="kind")]


def _check_look_at(block):
    """A direction to look in must be given once, and exist."""
    if block.look_at is None:
        return block
    if block.rotation_euler_deg not in (None, (0.0, 0.0, 0.0)):
        raise ValueError("give look_at or rotation_euler_deg, not both")
    if block.look_at == block.position:
        raise ValueError("look_at must differ from the position")
    return block


LensSize = Annotated[float, Field(ge=1e-3, le=1e6)]
"""[mm]; single precision holds every view that such sizes make."""


class Camera(Block):
    """A pinhole or thin-lens camera on the vehicle, or standing in the world (``mount: world``)."""

    id: Annotated[str, Field(pattern=r"^[0-9a-zA-Z]{2}$")] = "M0"
    """Type (M mono, L stereo left, R stereo right ...) and number, as in the file names (paper, table 5)."""
    mount: Literal["vehicle", "world"] = "vehicle"
    position: Position = (0.0, 0.0, 0.0)
    rotation_euler_deg: EulerAngles = (0.0, 0.0, 0.0)
    look_at: Position | None = None
    """Point to look at, in the axes of the mount; instead of ``rotation_euler_deg``."""
    resolution: tuple[Annotated[int, Field(ge=1)], Annotated[int, Field(ge=1)]] = (1280, 720)
    sensor_mm: tuple[LensSize, LensSize] = (4.416, 2.484)
    focal_mm: LensSize = 3.4
    f_stop: Annotated[float, Field(ge=0.0, le=1e6)] = 0.0
    """Focal length over aperture diameter, at least 0.001; 0 is a pinhole."""
    focus_m: Annotated[float, Field(ge=1e-3, le=1e9)] = 3.0

    @field_validator("f_stop")
    @classmethod
    def _open_no_wider_than_a_thousandth(cls, value):
        if 0.0 < value < 1e-3:
            raise ValueError("an f_stop is at least 0.001, or 0 for a pinhole")
        return value

    _looks_somewhere = model_validator(mode="after")(_check_look_at)


class Mounted(Block):
    """A sensor on the vehicle, in its axes."""

    position: Position = (0.0, 0.0, 0.0)
    rotation_euler_deg: EulerAngles = (0.0, 0.0, 0.0)
    rate_hz: Positive = 200.0


NoiseDensity = Annotated[float, Field(ge=0.0, le=1e6)]


class ImuNoise(Block):
    """White noise and bias of each axis; densities in Kalibr's units; all zero is no noise.

    The bias is the constant one, plus one drawn at random when the sensor is turned on, plus a random walk.
    """

    accelerometer_noise_density: NoiseDensity = 0.0
    """[m/s^2/sqrt(Hz)]"""
    accelerometer_random_walk: NoiseDensity = 0.0
    """[m/s^3/sqrt(Hz)]"""
    gyroscope_noise_density: NoiseDensity = 0.0
    """[rad/s/sqrt(Hz)]"""
    gyroscope_random_walk: NoiseDensity = 0.0
    """[rad/s^2/sqrt(Hz)]"""
    accelerometer_bias: Vec3 = (0.0, 0.0, 0.0)
    """Constant part, sensor axes [m/s^2]"""
    accelerometer_turn_on_bias: NoiseDensity = 0.0
    """Standard deviation of the part that is drawn once a sequence [m/s^2]"""
    gyroscope_bias: Vec3 = (0.0, 0.0, 0.0)
    """[rad/s]"""
    gyroscope_turn_on_bias: NoiseDensity = 0.0
    """[rad/s]"""


class Imu(Mounted):
    """An inertial measurement unit on the vehicle; without ``noise`` its readings are exact."""

    noise: ImuNoise | None = None


class Controller(Block):
    """Weights of the linear quadratic regulator and its feed-forward (paper 3.3.3)."""

    feed_forward: Literal["none", "velocity", "full"] = "full"
    translation_q: tuple[NonNegative, NonNegative] = (1.0, 0.5)
    rotation_q: tuple[NonNegative, NonNegative] = (6.0, 1.0)
    r: Positive = 1.0
    integral: NonNegative = 0.0
    """Weight of the integrated position error (LQI); needed to hold station in a current."""


class Current(Block):
    """Water current: a uniform drift plus seeded sinusoids of ``fluctuation`` [m/s RMS]."""

    velocity: Vec3 = (0.0, 0.0, 0.0)
    fluctuation: NonNegative = 0.0
    period_s: Positive = 20.0


class Vehicle(Block):
    """A neutrally buoyant sphere with thrusters; what is absent follows from its mass (between presets)."""

    id: Annotated[str, Field(pattern=r"^[0-9a-zA-Z]$")] = "0"
    mass_kg: Positive = 40.0
    linear_drag: NonNegative | None = None
    """d1 [N s/m]."""
    quadratic_drag: NonNegative | None = None
    """d2 [N s^2/m^2]."""
    linear_rotational_drag: NonNegative | None = None
    """r1 [N m s]."""
    quadratic_rotational_drag: NonNegative | None = None
    """r2 [N m s^2]."""
    actuator_frequency: Annotated[float, Field(ge=1e-6, le=1e9)] | None = None
    """wn [rad/s] of the second-order thruster."""
    actuator_damping: Annotated[float, Field(gt=0.0, le=1e6)] = 1.0
    max_force: Positive | None = None
    """[N]"""
    max_torque: Positive | None = None
    """[N m]"""
    actuator_frame: Literal["world", "body"] = "world"
    """Axes in which the thrusters lag: world keeps rotation and translation apart (paper 3.3.2), body is a real ROV."""
    net_buoyancy: float = 0.0
    """Buoyancy less weight [N]; 0 is neutral."""
    metacentric_height: NonNegative = 0.0
    """How far the centre of buoyancy lies above the centre of mass [m]; 0 is no righting moment."""
    controller: Controller = Controller()
    lights: list[Light] = []
    cameras: Annotated[list[Camera], Field(min_length=1)] = [Camera()]
    imu: Imu | None = Imu()
    depth_gauge: Mounted | None = Mounted()

    @field_validator("lights", mode="before")
    @classmethod
    def _spot_by_default(cls, lights: Any):
        if not isinstance(lights, list):
            return lights
        return [{"kind": "spot", **x} if isinstance(x, dict) and "kind" not in x else x for x in lights]

    @field_validator("cameras")
    @classmethod
    def _distinct_ids(cls, cameras):
        folded = [camera.id.lower() for camera in cameras]
        if len(set(folded)) < len(folded):
            raise ValueError("camera ids must differ, also when upper and lower case are taken for the same")
        return cameras


# -------------------------------------------------------------------------------------------------------- trajectory


class Waypoint(Block):
    """A pose to pass by; ``strict`` ones are reached exactly.

    Without ``look_at`` and ``rotation_euler_deg`` the attitude of the waypoint before it is kept, at first identity.
    """

    position: Position
    look_at: Position | None = None
    rotation_euler_deg: EulerAngles | None = None
    speed: Positive | None = None
    """Speed of the leg that ends here [m/s]."""
    strict: bool = False
    dwell_s: NonNegative | None = None
    """Rest at this waypoint [s]; absent: none, or that of the trajectory if strict."""

    _looks_somewhere = model_validator(mode="after")(_check_look_at)


class Pose(Block):
    """An exact pose at a time; no dynamics. Attitude as for a waypoint."""

    time_s: NonNegative = 0.0
    position: Position
    look_at: Position | None = None
    rotation_euler_deg: EulerAngles | None = None

    _looks_somewhere = model_validator(mode="after")(_check_look_at)


class Trajectory(Block):
    """One of: waypoints for the simulated vehicle to follow, or exact poses."""

    waypoints: list[Waypoint] | None = None
    poses: list[Pose] | None = None
    speed: Positive = 0.5
    """Leg speed where a waypoint names none [m/s]."""
    max_angular_speed_deg: Positive = 30.0
    max_acceleration: Positive = 0.25
    overlap: Annotated[float, Field(ge=0.0, le=0.5)] = 0.4
    """Share of a leg's time in which the next one already acts (hand-over, paper 3.3.2)."""
    handover_radius_m: Positive = 0.5
    handover_timeout_s: Positive = 30.0
    dwell_s: NonNegative = 0.25
    """Rest at a strict waypoint."""
    duration_s: Positive | None = None
    """Length of the sequence [s], frames in [0, duration_s); absent: up to and with the last waypoint or pose."""

    @model_validator(mode="after")
    def _one_form(self):
        if (self.waypoints is None) == (self.poses is None):
            raise ValueError("give exactly one of waypoints, poses")
        if not (self.waypoints if self.poses is None else self.poses):
            raise ValueError("at least one waypoint or pose is needed")
        return self


# ------------------------------------------------------------------------------------------------------------ render


class Exposure(Block):
    """Exposure correction before 8-bit output (paper 3.2.1)."""

    A: Literal["adaptive", "constant"] | Positive = "adaptive"
    B: Literal["adaptive", "constant"] | Positive = "constant"


class LevelOfDetail(Block):
    """Meshes with no more triangles than their images need; `varos-warp plan` shows what that keeps, and why."""

    tolerance_px: Positive = 0.5
    """How far a surface may move in an image, at the nearest approach of any camera (or lamp, for shadows) [pixels]."""
    depth_steps: Positive | None = 1.0
    """How far it may move up to 1 m from them, in steps of D, and beyond in proportion to the distance; null: no
    such limit, nor where D is not among the outputs."""


class Render(Block):
    """What is rendered and how well."""

    frame_rate_hz: Positive = 10.0
    outputs: list[Literal["A", "B", "C", "D", "S"]] = ["A", "B", "C", "D"]
    tolerance: Annotated[float, Field(gt=0.0, le=1.0)] = 0.02
    """Relative RMSE of an image A, in its worst channel, where ``spp`` is absent (docs/models.md)."""
    spp: Annotated[int, Field(ge=1)] | None = None
    """Samples per pixel of A; absent: the planner's choice."""
    spp_b: Annotated[int, Field(ge=1)] = 20
    """Samples per pixel of B (paper 3.2.1)."""
    max_scatterings: Annotated[int, Field(ge=0)] | None = None
    max_bounces: Annotated[int, Field(ge=0)] | None = None
    layers: list[Literal["direct", "single", "multiple"]] = ["direct", "single", "multiple"]
    integrator: Literal["auto", "tables", "path", "reference"] = "auto"
    """How the light of A is computed; ``reference``: a plain, slow path tracer, the judge of the others."""
    denoise: Literal["oidn", "nlm", "none"] = "oidn"
    denoise_b: Literal["oidn", "nlm", "none"] = "nlm"
    exposure: Exposure = Exposure()
    depth_kind: Literal["z", "range"] = "z"
    depth_range_m: tuple[NonNegative, Positive] = (0.0, 25.0)
    linear_exr: bool = False
    """Also write A before denoising and exposure as float32 EXR, with its standard error."""
    depth_exr: bool = False
    """Also write planar depth and range as float32 EXR (channels Z and range)."""
    level_of_detail: LevelOfDetail | None = None
    """Absent: every triangle of every mesh is kept, and the ground truth is that of the files; ``{}``: by need."""

    @field_validator("depth_range_m")
    @classmethod
    def _depth_ends_after_its_start(cls, value):
        if not value[1] > value[0]:
            raise ValueError("the end of the depth range must lie beyond its start")
        return value

    @field_validator("outputs", "layers")
    @classmethod
    def _some(cls, value):
        if not value or len(set(value)) < len(value):
            raise ValueError("name at least one, each once")
        return value


class Scene(Block):
    """A whole scene file."""

    name: str = "scene"
    sequence: Annotated[str, Field(pattern=r"^[0-9a-zA-Z]{2}$")] = "01"
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 1
    terrain: AnyTerrain | None = None
    objects: list[Object] = []
    scatter: list[Scatter] = []
    materials: dict[str, Material] = {}
    water: Water | Literal["none"] = "none"
    surface_depth_m: Coordinate = 0.0
    """Depth of world z = 0 below the sea surface [m]."""
    gravity: Positive = 9.81
    """[m/s^2]; ORB-SLAM3 uses the same number."""
    current: Current = Current()
    vehicle: Vehicle = Vehicle()
    trajectory: Trajectory
    render: Render = Render()

    _base_dir: Path = PrivateAttr(default=Path("."))
    """Folder of the scene file: relative paths are relative to it."""

    @field_validator("terrain", mode="before")
    @classmethod
    def _terrain_is_a_file(cls, terrain: Any):
        """``{file: x.dae}`` is short for ``{kind: file, file: x.dae}``."""
        return {"kind": "file", **terrain} if isinstance(terrain, dict) and "kind" not in terrain else terrain

    @field_validator("objects", mode="before")
    @classmethod
    def _files_are_meshes(cls, objects: Any):
        """``{file: x.dae}`` is short for ``{kind: mesh, file: x.dae}``."""
        if not isinstance(objects, list):
            return objects
        return [{"kind": "mesh", **o} if isinstance(o, dict) and "kind" not in o else o for o in objects]

    @field_validator("materials", mode="before")
    @classmethod
    def _diffuse_by_default(cls, materials: Any):
        if not isinstance(materials, dict):
            return materials
        return {k: {"kind": "diffuse", **m} if isinstance(m, dict) and "kind" not in m else m
                for k, m in materials.items()}

    @model_validator(mode="after")
    def _scatter_has_ground(self):
        if self.scatter and self.terrain is None:
            raise ValueError("scatter.0: there is no terrain to scatter anything on")
        return self

    @model_validator(mode="after")
    def _materials_exist(self):
        blocks = [("terrain", self.terrain), *((f"objects.{i}", o) for i, o in enumerate(self.objects)),
                  *((f"scatter.{i}.object", s.object) for i, s in enumerate(self.scatter))]
        for key, placed in blocks:
            if placed is not None and placed.material is not None and placed.material not in self.materials:
                known = ", ".join(sorted(self.materials)) or "none"
                raise ValueError(f"{key}.material: no material named '{placed.material}' (there are: {known})")
        return self

    def resolve(self, file: str) -> Path:
        """Path of a file that the scene names."""
        return (self._base_dir / Path(file).expanduser()).resolve()
