"""The vehicle with its cameras and sensors, the current that it meets, and where it goes."""

from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field, PrivateAttr, field_validator, model_validator

from varos_warp.products.sensors.registry import ASKED_FOR, SensorBlocks
from varos_warp.scene.block import (
    Block,
    CameraId,
    EulerAngles,
    NonNegative,
    Position,
    Positive,
    Quaternion,
    Vec3,
    VehicleId,
    check_look_at,
    outside,
    unwritten_if_absent,
    written_otherwise,
)
from varos_warp.scene.description.body import RigidBody, Turbulence
from varos_warp.scene.description.exposure import CameraExposure, Shutter, with_shutter
from varos_warp.scene.description.lens import Distortion, MeasuredIntrinsics, Resolution, with_calibration
from varos_warp.scene.description.lights import Light
from varos_warp.scene.description.optics import (
    Port,
    Vignetting,
    WaterIndex,
    check_optics,
    unwritten_of_camera,
)
from varos_warp.scene.description.patterns import Pattern
from varos_warp.scene.description.recorded import KEYS, Columns, Of, Read, check_recorded

# ----------------------------------------------------------------------------------------------------------- vehicle


LensSize = Annotated[float, Field(ge=1e-3, le=1e6)]
"""A length in a camera [mm]; within these bounds every field of view is representable in single precision."""


def _invertible(matrix):
    """A colour matrix loses no channel, and makes neither grey dark nor colours infinite."""
    if not (np.abs(matrix).max() <= MOST_OF_MATRIX and np.sum(matrix, axis=1).min() > 0.0):
        raise ValueError(
            f"rows must add up to more than 0, or grey would be black, of numbers up to "
            f"{MOST_OF_MATRIX:g}: about 1 each, as white stays white then; give three rows of three "
            "numbers, such as [[1.6, -0.5, -0.1], [-0.2, 1.5, -0.3], [0.0, -0.6, 1.6]], or auto"
        )
    if not abs(np.linalg.det(matrix)) > LEAST_DETERMINANT:
        raise ValueError(
            "the rows are not independent, so that colours would be lost; give three rows of three "
            "numbers, such as [[1.6, -0.5, -0.1], [-0.2, 1.5, -0.3], [0.0, -0.6, 1.6]], or auto"
        )
    return matrix


LEAST_DETERMINANT = 1e-6
"""Least magnitude of the determinant of a colour matrix; those of cameras are about 1 to 5."""
MOST_OF_MATRIX = 1000.0
"""Largest number of a colour matrix, for its products are in single precision."""
ColorMatrix = Annotated[tuple[Vec3, Vec3, Vec3], AfterValidator(_invertible)]


class Camera(Block):
    """A pinhole or thin-lens camera on the vehicle, or standing in the world (``mount: world``).

    Without ``port`` it looks as if the lens were in the water and the focal length that in water.
    """

    id: CameraId = "M0"
    """Type (M mono, L stereo left, R stereo right ...) and number, as in the file names (paper, table 5)."""
    mount: Literal["vehicle", "world"] = "vehicle"
    """Whether the camera moves with the vehicle, or stands in the world."""
    position: Position = (0.0, 0.0, 0.0)
    """Position of the lens in the axes of the mount [m]."""
    rotation_euler_deg: EulerAngles = (0.0, 0.0, 0.0)
    """Rotation about the fixed axes x, then y, then z of the mount [degrees]; unrotated, the camera looks along +y, its
    image upright."""
    look_at: Position | None = Field(default=None, examples=[[0.0, 3.0, 0.5]])
    """Point to look at, in the axes of the mount [m]; instead of ``rotation_euler_deg``."""
    resolution: Resolution = (1280, 720)
    """Width and height of the image [pixels]."""
    sensor_mm: tuple[LensSize, LensSize] = (4.416, 2.484)
    """Width and height of the sensor [mm]; pixels are square if it has the shape of the resolution."""
    focal_mm: LensSize = 3.4
    """Focal length [mm]; without a port that in the water, which is 1.34 times that in air. Beside ``intrinsics`` or
    ``calibration`` only for the aperture of an ``f_stop``."""
    intrinsics: MeasuredIntrinsics | None = None
    """Measured focal lengths and principal point, instead of ``sensor_mm`` and ``focal_mm``. Absent: by those, with the
    principal point in the middle of the image."""
    calibration: str | None = Field(default=None, examples=["camchain.yaml#cam0"])
    """Calibration file of Kalibr, OpenCV or ROS that gives ``intrinsics``, ``distortion`` and ``resolution``, as
    ``FILE#camera``; the camera may be left out where the file has one (docs/cameras.md)."""
    f_stop: Annotated[
        float, Field(ge=0.0, le=1e6), outside(0.0, 1e-3, "an f_stop is at least 0.001, or 0 for a pinhole")
    ] = 0.0
    """Focal length over aperture diameter, at least 0.001; 0 is a pinhole, which is sharp everywhere."""
    focus_m: Annotated[float, Field(ge=1e-3, le=1e9)] = 3.0
    """Distance of the plane of focus [m]; in air, behind a port."""
    port: Port | None = None
    """The port of the camera's housing, ``flat`` or ``dome``. Absent: the camera looks as if the lens were in the water
    (docs/ports.md)."""
    n_water: WaterIndex | None = Field(default=None, examples=[1.34])
    """Refractive index of the water at the port: a number, one each for R, G and B, or a block of temperature and
    salinity. Absent: 1.34."""
    distortion: Distortion | None = None
    """Distortion of the lens: ``brown_conrady`` (radtan, plumb_bob), ``rational``, ``kannala_brandt`` (equidistant,
    fisheye) or ``double_sphere``. Where the lens ends within the image, pixels are black. Absent: none."""
    vignetting: Vignetting | None = None
    """Fall of A's light towards the corners; B, C, D, S and T have none. Absent: none."""
    response: str | None = Field(default=None, examples=["nikon_5100"])
    """Spectral response, in water by wavelength (docs/spectra.md): a name that comes with the package, or a CSV file
    with the columns wavelength_nm, r, g and b, of any scale."""
    color_matrix: ColorMatrix | Literal["auto"] | None = Field(default=None, examples=["auto"])
    """Three rows that make linear sRGB of the camera's own channels, for 8 bits of A, B and P; linear images stay as
    the channels have them. ``auto``: the least squares over the colour chart in the light of the first lamp, which
    leave white as it is (docs/spectra.md). Absent: none."""
    exposure: CameraExposure = CameraExposure()
    """Exposure time and readout, for motion blur and rolling shutters, and gain. Absent: each image is of one instant,
    with the gain of ``render.exposure``."""
    shutter: Annotated[
        Shutter | None, Field(exclude=True, deprecated="is read as exposure.time_s and exposure.readout_s")
    ] = None
    """What older files call ``exposure``: its ``exposure_s`` is ``time_s``."""

    _calibrated = model_validator(mode="before")(with_calibration)
    _looks_somewhere = model_validator(mode="after")(check_look_at)
    _fits_together = model_validator(mode="after")(check_optics)
    _exposed = model_validator(mode="after")(with_shutter)
    _written = written_otherwise(unwritten_of_camera)


class Controller(Block):
    """Weights of the linear quadratic regulator and its feed-forward (paper 3.3.3)."""

    feed_forward: Literal["none", "velocity", "full"] = "full"
    """What the controller knows of the course ahead of errors: nothing (paper), velocities, or forces, too."""
    translation_q: tuple[NonNegative, NonNegative] = (1.0, 0.5)
    """Weights of the errors of position and velocity."""
    rotation_q: tuple[NonNegative, NonNegative] = (6.0, 1.0)
    """Weights of the errors of attitude and angular velocity."""
    r: Positive = 1.0
    """Weight of the thrusters' effort; smaller is stiffer."""
    integral: NonNegative = 0.0
    """Weight of the integrated position error (LQI); needed to hold station in a current."""


class Current(Block):
    """Water current: a uniform drift plus seeded sinusoids of ``fluctuation`` [m/s RMS], and turbulence."""

    velocity: Vec3 = (0.0, 0.0, 0.0)
    """Uniform drift in world axes [m/s]."""
    fluctuation: NonNegative = 0.0
    """Root mean square of the sinusoids added to the drift [m/s]."""
    period_s: Positive = 20.0
    """Period of the sinusoids [s], each between half and twice as long."""
    turbulence: Turbulence | None = None
    """Seeded turbulence besides (docs/vehicle.md). Absent: none."""

    _written = unwritten_if_absent("turbulence")


class Carrier(Block):
    """What carries the sensors of a vehicle: its body, lights and cameras."""

    id: VehicleId = "0"
    """One letter or digit that names the vehicle in the dataset's file names."""
    mass_kg: Annotated[float, Field(ge=1e-3, le=1e9)] = 40.0
    """Mass [kg]; what the other keys leave absent follows from it."""
    linear_drag: NonNegative | None = Field(default=None, examples=[20])
    """Linear drag d1 [N s/m]; absent: by the mass."""
    quadratic_drag: NonNegative | None = Field(default=None, examples=[30])
    """Quadratic drag d2 [N s^2/m^2]; absent: by the mass."""
    linear_rotational_drag: NonNegative | None = Field(default=None, examples=[2])
    """Linear drag of rotation r1 [N m s]; absent: by the mass."""
    quadratic_rotational_drag: NonNegative | None = Field(default=None, examples=[3])
    """Quadratic drag of rotation r2 [N m s^2]; absent: by the mass."""
    actuator_frequency: Annotated[float, Field(ge=1e-6, le=1e9)] | None = Field(default=None, examples=[10])
    """Natural frequency wn of the second-order thrusters [rad/s]; absent: by the mass."""
    actuator_damping: Annotated[float, Field(gt=0.0, le=1e6)] = 1.0
    """Damping ratio of the second-order thrusters; 1 is critical."""
    max_force: Positive | None = Field(default=None, examples=[100])
    """Most force of the thrusters [N]; absent: by the mass."""
    max_torque: Positive | None = Field(default=None, examples=[30])
    """Most torque of the thrusters [N m]; absent: by the mass."""
    actuator_frame: Literal["world", "body"] = "world"
    """Axes in which the thrusters lag: world keeps rotation and translation apart (paper 3.3.2), body is a real ROV."""
    net_buoyancy: float = 0.0
    """Buoyancy less weight [N]; 0 is neutral."""
    metacentric_height: NonNegative = 0.0
    """How far the centre of buoyancy lies above the centre of mass [m]; 0 is no righting moment."""
    rigid_body: RigidBody | None = None
    """A body with six coupled degrees of freedom (docs/vehicle.md). Absent: the sphere."""
    controller: Controller = Controller()
    """Weights of the controller that follows the course."""
    lights: list[Light] = []
    """Lights on the vehicle; without any, images A are black."""
    cameras: Annotated[list[Camera], Field(min_length=1)] = [Camera()]
    """Cameras on the vehicle, or fixed in the world; for stereo two, with ids L0 and R0."""


class Vehicle(SensorBlocks, Carrier):
    """A sphere, or a rigid body, with thrusters. Absent values follow from the mass, between those of presets."""

    _written = unwritten_if_absent(*ASKED_FOR, "rigid_body")

    @model_validator(mode="after")
    def _one_limit(self):
        if self.rigid_body and self.rigid_body.thrusters and (self.max_force or self.max_torque):
            raise ValueError("give max_force and max_torque or rigid_body.thrusters, not both")
        return self

    @field_validator("cameras")
    @classmethod
    def _distinct_ids(cls, cameras):
        folded = [camera.id.lower() for camera in cameras]
        if len(set(folded)) < len(folded):
            raise ValueError("camera ids must differ, also when upper and lower case are taken for the same")
        return cameras

    def cannot_be_followed(self, of: str | None) -> str | None:
        """Why the vehicle's course cannot be told by the poses ``of`` something, in words; None: it can."""
        if of in (None, "vehicle"):
            return None
        if of == "imu":
            return "the vehicle has no imu" if self.imu is None else None
        mounts = {camera.id: camera.mount for camera in self.cameras}
        if of not in mounts:
            return f"no camera has the id '{of}' (there are: {', '.join(mounts)}; or vehicle, imu)"
        return "the camera stands in the world, not on the vehicle" if mounts[of] == "world" else None


# -------------------------------------------------------------------------------------------------------- trajectory


class Waypoint(Block):
    """A pose to pass; ``strict`` ones are reached exactly.

    Without ``look_at``, ``rotation_euler_deg`` and ``quaternion`` the attitude of the waypoint before it is kept, at
    first identity.
    """

    position: Position = Field(examples=[[0.5, 2.5, 1.0]])
    """Position of the vehicle at this waypoint, in world axes [m]."""
    look_at: Position | None = Field(default=None, examples=[[0.3, 5.0, 0.2]])
    """Point that the vehicle faces here, in world axes [m]; instead of ``rotation_euler_deg``."""
    rotation_euler_deg: EulerAngles | None = Field(default=None, examples=[[-10, 0, 5]])
    """Rotation of the vehicle about the world's fixed axes x, then y, then z [degrees]; without any of the three the
    attitude stays that of the waypoint before."""
    quaternion: Quaternion | None = Field(default=None, examples=[[0.966, 0.0, 0.0, 0.259]])
    """Rotation as a Hamilton quaternion w, x, y, z, vehicle to world; instead of ``rotation_euler_deg``."""
    speed: Positive | None = Field(default=None, examples=[0.3])
    """Speed of the leg that ends here [m/s]; absent: that of the trajectory."""
    strict: bool = False
    """Whether this waypoint is reached exactly, with a rest, before the next one is headed for."""
    dwell_s: NonNegative | None = Field(default=None, examples=[0.5])
    """Rest at this waypoint [s]; absent: none, or that of the trajectory if strict."""

    _looks_somewhere = model_validator(mode="after")(check_look_at)
    _written = unwritten_if_absent("quaternion")


class Pose(Block):
    """An exact pose at a time; no dynamics. Attitude as for a waypoint."""

    time_s: NonNegative = 0.0
    """Time at which the vehicle is here, from the start of the sequence [s]."""
    position: Position = Field(examples=[[0.5, 2.5, 1.0]])
    """Position of the vehicle, in world axes [m]."""
    look_at: Position | None = Field(default=None, examples=[[0.3, 5.0, 0.2]])
    """Point that the vehicle faces here, in world axes [m]; instead of ``rotation_euler_deg``."""
    rotation_euler_deg: EulerAngles | None = Field(default=None, examples=[[-10, 0, 5]])
    """Rotation of the vehicle about the world's fixed axes x, then y, then z [degrees]; without any of the three the
    attitude stays that of the pose before."""
    quaternion: Quaternion | None = Field(default=None, examples=[[0.966, 0.0, 0.0, 0.259]])
    """Rotation as a Hamilton quaternion w, x, y, z, vehicle to world; instead of ``rotation_euler_deg``."""

    _looks_somewhere = model_validator(mode="after")(check_look_at)
    _written = unwritten_if_absent("quaternion")


class Trajectory(Block):
    """One of: waypoints for the simulated vehicle to follow, a pattern of them, exact poses, or a file of them."""

    waypoints: list[Waypoint] | None = None
    """Waypoints for the simulated vehicle to follow, from rest at the first one."""
    poses: list[Pose] | None = None
    """Exact poses at times, without dynamics. Splines pass through them. After the last the vehicle brakes, and is at
    rest 2 s later; likewise before the first it comes from rest. The acceleration is continuous throughout."""
    pattern: Pattern | None = None
    """Stands for waypoints: ``lawn_mower``, ``orbit``, ``spiral``, ``there_and_back``, ``hull_following``."""
    file: str | None = Field(default=None, examples=["course.txt"])
    """A recorded course (docs/trajectories.md): exact poses in a text file, relative to the scene file, of TUM, of
    EuRoC, of our own datasets, or any table with ``columns``. Splines pass through them as through ``poses``."""
    columns: Columns | None = None
    """Which columns of ``file`` hold what. Absent: as its format, or the usual names in its header, say."""
    frame: Literal["enu", "ned"] | None = None
    """World axes of ``file``: enu, x east, y north, z up, as ours; ned, x north, y east, z down. Absent: enu."""
    of: Of | None = Field(default=None, examples=["M0"])
    """Whose poses ``file`` has: ``vehicle``, ``imu`` in its own axes, or a camera's by its id, in OpenCV's optical
    axes; the vehicle's follow from where it is mounted. Absent: vehicle."""
    body: Literal["rfu", "flu", "frd"] | None = None
    """Axes x, y, z of the vehicle whose attitudes ``file`` has: right, forward, up, which are ours; forward, left, up;
    forward, right, down. Absent: flu where ``frame`` is enu, frd where it is ned, rfu of our own datasets."""
    attitude: Literal["recorded", "along_path", "unrotated"] | None = None
    """Attitude of the vehicle: that of ``file``, or that it looks where it goes, level across, or straight north all
    the time. Absent: recorded, and a file without attitudes is refused."""
    origin: Position | None = Field(default=None, examples=[[569000.0, 7033000.0, 0.0]])
    """Position of the scene's origin in the coordinates of ``file``, along their axes [m]. Absent: their own origin."""
    start_s: NonNegative | None = Field(default=None, examples=[12.0])
    """Time at which the sequence begins, from the first pose of ``file`` [s]. Absent: it begins with that pose."""
    smoothing_s: Positive | None = Field(default=None, examples=[0.5])
    """Takes the noise out of the poses of ``file``: of an oscillation of this period [s] half is left, of one of twice
    the period 94 %. Absent: the course passes through the poses."""
    speed: Positive = 0.5
    """Leg speed where a waypoint names none [m/s]."""
    constant_speed: bool | None = None
    """Keep the speed past waypoints, but for strict ones and those with ``dwell_s``; false: legs begin and end at rest
    and overlap (paper 3.3.2). Absent: true for a pattern, false for waypoints."""
    max_angular_speed_deg: Positive = 30.0
    """How fast the vehicle turns at most [degrees/s]."""
    max_acceleration: Positive = 0.25
    """Most acceleration along the course [m/s^2]."""
    overlap: Annotated[float, Field(ge=0.0, le=0.5)] = 0.4
    """Share of a leg's time in which the next one already acts (hand-over, paper 3.3.2); not at constant speed."""
    handover_radius_m: Positive = 0.5
    """A waypoint that is not strict counts as passed within this distance [m]."""
    handover_timeout_s: Positive = 30.0
    """Time after which the vehicle leaves a waypoint that it cannot reach for the next one [s]."""
    dwell_s: NonNegative = 0.25
    """Rest at a strict waypoint [s]."""
    duration_s: Positive | None = Field(default=None, examples=[12.0])
    """Length of the sequence [s], frames in [0, duration_s); absent: up to and with the last waypoint or pose. The
    vehicle begins at rest and is slow at first: ``constant_speed`` and more ``max_acceleration`` help."""

    _read: Read = PrivateAttr(default_factory=Read)
    """Poses of the file, once they were read by `scene.courses`."""
    _written = unwritten_if_absent("pattern", "constant_speed", "file", *KEYS)

    @field_validator("poses", mode="before")
    @classmethod
    def _is_no_file(cls, poses):
        if isinstance(poses, str):
            raise ValueError("should be a list of poses; a file of them is a recorded course, trajectory.file")
        return poses

    @model_validator(mode="after")
    def _one_form(self):
        if sum(form is not None for form in (self.waypoints, self.poses, self.pattern, self.file)) != 1:
            raise ValueError("give exactly one of waypoints, poses, pattern, file")
        if self.is_listed and not (self.waypoints or self.poses):
            raise ValueError("at least one waypoint or pose is needed")
        if self.is_exact and self.constant_speed is not None:
            raise ValueError("constant_speed is for waypoints; poses say when they are passed")
        check_recorded(self)
        return self

    @property
    def is_listed(self) -> bool:
        """Whether its stops stand in the scene file."""
        return self.waypoints is not None or self.poses is not None

    @property
    def is_exact(self) -> bool:
        """Whether it has poses at times, listed or in a file, instead of waypoints for the dynamics."""
        return self.poses is not None or self.file is not None

    @property
    def stops(self) -> Sequence[Waypoint | Pose]:
        """The waypoints, given or of the pattern, or the poses."""
        if self.pattern is not None:
            return [Waypoint(**stop) for stop in self.pattern.waypoints()]
        if self.file is not None:
            return self._read.poses()
        return self.poses or self.waypoints or []

    @property
    def keeps_speed(self) -> bool:
        """Whether the speed stays the same past waypoints."""
        return self.pattern is not None if self.constant_speed is None else self.constant_speed

    def key(self, stop: int) -> str:
        """Key of the scene file that says where a stop is."""
        if not self.is_listed:
            return f"trajectory.{'file' if self.pattern is None else 'pattern'}"
        return f"trajectory.{'waypoints' if self.poses is None else 'poses'}.{stop}"
