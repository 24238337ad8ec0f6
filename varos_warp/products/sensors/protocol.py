"""What a sensor is to the rest of the package (`SensorProduct`), and what the rest is to a sensor.

A sensor knows nothing of the simulation, of datasets and of exports. It is handed the vehicle's motion, what is around
it (`Surroundings`), a dataset to check (`Evidence`) and makers of ROS messages (`RosMessages`), and knows these by
protocols only. So its block of the scene file, what it measures, how that is written, checked and drawn can stand in
one file, below all rooms that ask for it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Protocol, TypeVar

import numpy as np
from pydantic import Field

from varos_warp.scene.block import Block, EulerAngles, Position, Positive
from varos_warp.scene.frames import pose_matrix
from varos_warp.sim.motion import Trajectory

Samples = Mapping[str, np.ndarray]
"""``time_ns`` int64 [N] and quantities by their names, [N] or [N, k]."""
Vec3 = tuple[float, float, float]
NoiseDensity = Annotated[float, Field(ge=0.0, le=1e6)]


class Mounted(Block):
    """A sensor on the vehicle, in its axes."""

    position: Position = (0.0, 0.0, 0.0)
    """Position of the sensor in vehicle axes [m]."""
    rotation_euler_deg: EulerAngles = (0.0, 0.0, 0.0)
    """Rotation of the sensor about the vehicle's fixed axes x, then y, then z [degrees]."""
    rate_hz: Positive = 200.0
    """Readings per second [Hz]."""


def xyz(name: str, unit: str) -> list[str]:
    """Headers of the three components of a vector."""
    return [f"{name}_{axis} [{unit}]" for axis in "xyz"]


@dataclass(frozen=True)
class Curve:
    """How a quantity of the readings is drawn over time."""

    quantity: str
    title: str
    """Title in the report."""
    unit: str
    names: Sequence[str]
    """Names of the curves, one for each column."""
    scale: float = 1.0
    """What SI units are multiplied by for `unit`."""
    down: bool = False
    """True if the axis points downwards."""
    viewed: str = ""
    """Title in the viewer, where it is drawn in SI units; empty: it is not drawn there."""


# ------------------------------------------------------------------------------------------- what a sensor is handed


class Surroundings(Protocol):
    """What is around the vehicle."""

    @property
    def gravity(self) -> float:
        """Acceleration by gravity [m/s^2], along -z of the world."""

    @property
    def surface_depth_m(self) -> float:
        """Depth of world z = 0 below the surface [m]."""

    def met_by_beams(
        self, time_ns: np.ndarray, T_w_s: np.ndarray, beams: np.ndarray, range_m: Sequence[float]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Distance [M, k] along beams to what is there at the times int64 [M], and its velocity along them.

        NaN where nothing is met within ``range_m``, least and most; ``beams`` are unit vectors [k, 3] in axes of the
        sensor.
        """


class Evidence(Protocol):
    """The readings of a sensor in a dataset, and what they are held against; problems are noted in the validation."""

    @property
    def meta(self) -> dict[str, Any]:
        """Contents of dataset.json."""

    @property
    def about(self) -> dict[str, Any]:
        """Entry of the sensor in dataset.json."""

    @property
    def T(self) -> np.ndarray:
        """Poses of the sensor [N, 4, 4] at its readings, from files of their own."""

    @property
    def truth(self) -> Samples:
        """Readings without noise."""

    @property
    def read(self) -> Samples:
        """Readings with the noise that they may have."""

    @property
    def bias(self) -> Samples:
        """The bias in them, of a sensor that has one."""

    @property
    def motion(self) -> Trajectory:
        """The vehicle's motion at the readings, from its states."""

    @property
    def states(self) -> str:
        """Name of the file of these states."""

    def met_by_beams(self, beams: np.ndarray, range_m: Sequence[float]) -> tuple[np.ndarray, np.ndarray] | None:
        """Result of `Surroundings.met_by_beams` at the readings; None where the meshes of the scene are not at hand."""

    @property
    def anything_moves(self) -> bool:
        """True if beams may meet something that moves."""

    def agree(self, name: str, expected: Samples, limit: float, unit: str, problem: str, noisy: bool = False) -> None:
        """Readings are as expected within a limit, NaN where that is NaN; what is not is told of by row as ``problem``.

        ``name`` says what is held against what; ``expected`` has some or all quantities of the readings, as the columns
        of the table begin; ``noisy`` readings are meant, or those without noise.
        """

    def apart(self, found: Samples, expected: Samples) -> np.ndarray:
        """How far quantities are apart [N, k]: 0 where neither has a number, infinite where one has none."""

    def rows(self, problem: str, wrong: np.ndarray, off: np.ndarray, columns: slice, noisy: bool = False) -> bool:
        """Tell of rows that are ``wrong``, bool [N], by their cell that is farthest off, and whether there are any.

        ``columns`` are the places of the columns of ``off`` [N, k] among those of the readings.
        """

    def measure(self, name: str, value: float, limit: float, unit: str) -> None:
        """Note a quantity, which above its limit is a problem."""

    def guard(self, check: Callable[..., None], *args: Any) -> None:
        """Run a part of the check; if its files cannot be read, that is noted, and the other parts go on."""

    def repeated(self, limit: float, unit: str) -> None:
        """Readings and bias are those of the noise profile and its seed, where these are known."""


class RosMessages(Protocol):
    """Makes ROS messages of classes by their names, and what is inside them."""

    def __getitem__(self, name: str) -> Any: ...
    def header(self, time_ns: int, frame_id: str) -> Any:
        """Stamp and frame."""

    def vector(self, values: np.ndarray) -> Any:
        """A Vector3."""

    def rotation(self, q: Sequence[float]) -> Any:
        """A Quaternion of (w, x, y, z)."""


# ------------------------------------------------------------------------------------------------------- the sensor

BlockT_contra = TypeVar("BlockT_contra", bound=Block, contravariant=True)
NoiseT = TypeVar("NoiseT", bound=Block)
ReadingsT = TypeVar("ReadingsT")


class SensorProduct(Protocol[BlockT_contra, NoiseT, ReadingsT]):
    """A sensor: its block of the scene file, what it measures, and how that is written, read, checked and drawn.

    The readings are a frozen dataclass of arrays with ``time_ns`` int64 [M] and the quantities of `columns`.
    """

    key: str
    """Key of its block under ``vehicle``, of its noise in a profile, and its name among the readings of a step."""
    id: str
    """Names its folder, its files and its topics; what `Dataset.readings` is asked for."""
    label: str
    """What it is called in messages."""
    noise: type[NoiseT]
    """Type of its block of a noise profile."""
    columns: dict[str, list[str]]
    """Headers of the columns of the CSV after the time, by quantity."""
    curves: tuple[Curve, ...]
    stream_id: int
    """Id of its messages in the stream format: the next one is that of readings without noise, then that of biases."""
    stream_fields: str
    """What a message of that holds after the time."""
    convention: str
    """What dataset.json says of its readings."""
    chapter: str
    """Chapter of README.txt on it; words in braces are those of data/dataset_readme.txt."""
    is_standard: bool = False
    """True if notes tell of it in every dataset, as of the sensors of the released sequence."""
    needs_solids: bool = False
    """True if it meets what is solid in the scene, which then is built for the simulation."""
    has_bias: bool = True
    """True if noise has a slowly varying part that is written down."""
    bias_apart: bool = False
    """True if that is a file of its own, not columns after those without noise."""
    facts: dict[str, Any] = {}
    """Kinds of the entries that `describe` gives, by which they are checked when a dataset is read."""
    ros_types: dict[str, str] = {}
    """Messages of its topics in a ROS bag, by what follows the sensor's name in the topic's, such as ``/pressure``."""

    @property
    def ros_frame(self) -> str:
        """Name of the frame of its axes in ROS."""
        return f"{self.key}_link"

    def mounting(self, sensor: BlockT_contra) -> np.ndarray:
        """T_v_s [4, 4] of the sensor on the vehicle."""
        return pose_matrix(sensor)

    def measure(self, there: Trajectory, sensor: BlockT_contra, around: Surroundings) -> ReadingsT:
        """Readings without noise at the instants of a motion's rows."""
        ...

    def doubt(self, sensor: BlockT_contra, read: Any) -> str:
        """What a person should know about the readings of a whole run, after the sensor's key; empty: nothing."""
        return ""

    def errors(self, sensor: BlockT_contra, count: int, seed: int) -> Callable[[ReadingsT], ReadingsT] | None:
        """What adds the noise that the scene itself asks for to one piece of readings after the other; None: none is.

        ``count`` is how many readings the scene's sequence has.
        """
        return None

    def describe(self, sensor: BlockT_contra) -> dict[str, Any]:
        """What dataset.json says of it besides rate, mounting and noise."""
        return {}

    def noisy(self, truth: Samples, about: dict[str, Any], model: NoiseT, seed: int) -> tuple[Samples, Samples | None]:
        """Readings with the noise of a profile, of those without it, and the bias in them.

        ``about`` is what dataset.json says of the sensor, ``model`` its block of the profile.
        """
        ...

    def check(self, found: Evidence) -> None:
        """Hold the readings of a dataset against the true motion; where they have noise, that as well."""

    def ros(self, make: RosMessages, topic: str, time_ns: int, row: Samples, meta: dict[str, Any]) -> Any:
        """The ROS message of one reading; None: the topic has none of it.

        ``topic`` is a key of `ros_types`, ``meta`` what dataset.json says, ``meta["sensors"]`` of the sensor.
        """
        return None
