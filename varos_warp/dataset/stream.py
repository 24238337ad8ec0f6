"""Stream files after the Linkoping (LiU) format (paper 4.1.2, table 7): messages in the order of their times.

A message is ``SBST``, uint32 id, uint32 length of the payload, payload; the paper leaves byte order and payloads open:
here all numbers are little-endian and every payload begins with the time, int64 nanoseconds. At one time the sensors
come before the images. Images lie outside; their messages hold the path from the stream's folder. A reader passes over
messages whose id it does not know. Payloads have no checksum: damage within one that keeps its length goes unseen.
"""

import itertools
import json
import struct
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path

import numpy as np

from varos_warp.dataset import files
from varos_warp.errors import InputError

START = b"SBST"
HEAD = struct.Struct("<4sII")
DESCRIPTION, IMU, DEPTH_GAUGE, VEHICLE_POSE, IMAGE, END = 1, 2, 3, 4, 5, 6
"""Ids, in their order at one time."""
PAYLOADS = {DESCRIPTION: "<q", IMU: "<q6d", DEPTH_GAUGE: "<qd", VEHICLE_POSE: "<q7d", IMAGE: "<qIBB", END: "<q"}
"""What a payload begins with; UTF-8 text follows in a description (JSON) and an image (path)."""
FIELDS = {
    DESCRIPTION: "int64 time [ns]; JSON: what this stream holds",
    IMU: "int64 time [ns]; float64 specific force x y z [m/s^2]; float64 angular velocity x y z [rad/s], IMU axes",
    DEPTH_GAUGE: "int64 time [ns]; float64 depth below the surface [m]",
    VEHICLE_POSE: "int64 time [ns]; float64 position x y z [m]; float64 quaternion w x y z: vehicle in world",
    IMAGE: "int64 time [ns]; uint32 frame; uint8 number of the camera; uint8 image type, ASCII A B C D S; path",
    END: "int64 time [ns]; nothing follows",
}


@dataclass(frozen=True)
class Message:
    """One message: its id, time, numbers and text."""

    id: int
    time_ns: int
    values: tuple = ()
    """As `FIELDS` lists them after the time."""
    text: str = ""

    def encode(self) -> bytes:
        """Bytes in the file."""
        payload = struct.pack(PAYLOADS[self.id], self.time_ns, *self.values) + self.text.encode()
        return HEAD.pack(START, self.id, len(payload)) + payload

    @classmethod
    def decode(cls, id: int, payload: bytes) -> "Message":
        """Inverse of `encode`, of an id of `PAYLOADS`."""
        form = PAYLOADS[id]
        time_ns, *values = struct.unpack_from(form, payload)
        has_text = id in (DESCRIPTION, IMAGE)
        rest = payload[struct.calcsize(form):]
        if rest and not has_text:
            raise ValueError(f"a message {id} is {len(rest)} bytes too long")
        return cls(id, time_ns, tuple(values), rest.decode() if has_text else "")


def write_stream(path: Path, messages: Iterable[Message]) -> None:
    """Write messages in the order of their times and ids.

    Raises:
        InputError: If the file cannot be written.
    """
    with files.atomic(Path(path)) as temp, temp.open("wb") as file:
        for message in sorted(messages, key=attrgetter("time_ns", "id")):
            file.write(message.encode())


def read_stream(path: Path) -> Iterator[Message]:
    """Messages of a stream file with ids of `PAYLOADS`; others are passed over.

    After damage reading goes on at the next whole message, and a warning says so.

    Raises:
        InputError: If the file cannot be read, or ends within a message or before its last one.
    """
    path = Path(path)
    try:
        for id, payload in _with_end(split_messages(path.read_bytes())):
            try:
                if id in PAYLOADS:
                    yield Message.decode(id, payload)
            except (ValueError, struct.error) as error:
                warnings.warn(f"a damaged message {id} passed over: {error}", stacklevel=2)
    except (OSError, ValueError) as error:
        raise InputError(f"cannot be read: {error}", file=path, remedy="Export the dataset anew.") from error


def split_messages(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Ids and payloads; a message counts as whole if another one, or the end, follows it.

    Raises:
        ValueError: If the bytes end within a message.
    """
    at = 0
    while at < len(data):
        end = _end(data, at)
        if end is None:
            start, at = at, _next_whole(data, at + 1)
            if at is None:
                raise ValueError(f"it ends within the message at byte {start}")
            warnings.warn(f"{at - start} damaged bytes passed over at byte {start}", stacklevel=2)
            continue
        yield HEAD.unpack_from(data, at)[1], data[at + HEAD.size:end]
        at = end


def _with_end(messages: Iterator[tuple[int, bytes]]) -> Iterator[tuple[int, bytes]]:
    """The messages; where the first describes the stream, the last must end it, or it was cut between two of them."""
    first = last = None
    for id, payload in messages:
        first, last = first or id, id
        yield id, payload
    if first == DESCRIPTION and last != END:
        raise ValueError("it ends before its last message")


def _end(data: bytes, at: int) -> int | None:
    """Where the message ends; None if there is no whole one."""
    if data[at:at + 4] != START or at + HEAD.size > len(data):
        return None
    end = at + HEAD.size + HEAD.unpack_from(data, at)[2]
    return end if end == len(data) or data[end:end + 4] == START else None


def _next_whole(data: bytes, at: int) -> int | None:
    """Start of the first whole message from a byte on."""
    while (at := data.find(START, at)) >= 0:
        if _end(data, at) is not None:
            return at
        at += 1
    return None


def dataset_messages(data, images: Iterable[tuple[str, str, int, str]]) -> Iterator[Message]:
    """Messages of a dataset: what it is, its sensors and poses, and its images.

    Args:
        data: A `layout.Dataset`.
        images: Camera id, image type, frame and path of each image.
    """
    time_ns = {camera: dict(zip(data.frames, data.time_ns(camera).tolist(), strict=True)) for camera in data.cameras}
    sensors = [*_sensor_messages(data)]
    times = [m.time_ns for m in sensors] + [t for times in time_ns.values() for t in times.values()]
    yield Message(DESCRIPTION, min(times), (), json.dumps(description(data), ensure_ascii=False))
    yield from sensors
    for camera, letter, frame, path in images:
        yield Message(IMAGE, time_ns[camera][frame], (frame, data.cameras.index(camera), ord(letter)), path)
    yield Message(END, max(times))


def description(data) -> dict:
    """What the first message says: the messages, and what dataset.json says of cameras, sensors and conventions."""
    keys = ("name", "sequence", "vehicle", "conventions", "depth", "cameras", "sensors", "lights", "water", "gravity")
    return {"format": "varos_warp stream", "version": 1, "byte_order": "little-endian",
            "messages": {str(id): text for id, text in FIELDS.items()}, "noise": data.meta.get("noise")} | {
                key: data.meta[key] for key in keys}


def _sensor_messages(data) -> Iterator[Message]:
    """IMU, depth gauge and poses of the vehicle, as far as the dataset has them."""
    if "imu0" in data.recorded:
        imu = data.imu()
        yield from _rows(IMU, imu["time_ns"], np.column_stack([imu["acceleration"], imu["angular_velocity"]]))
    if "depth0" in data.recorded:
        gauge = data.depth_gauge()
        yield from _rows(DEPTH_GAUGE, gauge["time_ns"], gauge["depth"][:, None])
    if "vehicle" in data.recorded:
        states = data.states()
        yield from _rows(VEHICLE_POSE, states["time_ns"],
                         np.column_stack([states["position"], states["quaternion"]]))


def _rows(id: int, time_ns: np.ndarray, values: np.ndarray) -> Iterator[Message]:
    return itertools.starmap(lambda t, row: Message(id, t, tuple(row)),
                             zip(time_ns.tolist(), values.astype(float).tolist(), strict=True))
