"""The paper's stream file (4.1.2 and table 7, after the LiU format): messages of all sensors in the order of time.

A message is ``SBST``, uint32 id, uint32 length of the payload, and the payload. The paper leaves byte order, ids and
payloads open: all numbers are little-endian here, and every payload begins with the time, int64 nanoseconds. Images lie
beside the file; their messages hold the path from its folder. docs/exports.md has the layout and a reader.
"""

import heapq
import json
import struct
from collections.abc import Iterator
from operator import itemgetter

import numpy as np

from varos_warp.dataset import files
from varos_warp.dataset.export.shared.job import Clocked, Job
from varos_warp.dataset.layout import READINGS, STATES
from varos_warp.products.images.registry import OUTPUTS
from varos_warp.products.sensors.registry import SENSORS as ALL
from varos_warp.scene.description.image_types import SEGMENTS

IMAGES = "".join(OUTPUTS)
NAME = "stream.sbst"
VERSION = 1
"""Raised when an id or a payload changes its meaning."""
START = b"SBST"
DESCRIPTION, STATE, POSE, IMAGE, END = 1, 50, 51, 60, 99
SENSOR_IDS = {sensor.id: sensor.stream_id for sensor in ALL}
"""Ids of readings as the sensor gives them. If they have noise, those without it have the next id, and biases the one
after it. Messages of one time are in the order of their ids."""
SENSORS = tuple(SENSOR_IDS)
FIELDS = {
    DESCRIPTION: "JSON: this, and dataset.json",
    **{sensor.stream_id: sensor.stream_fields for sensor in ALL},
    STATE: "float64[19]: position x y z [m], velocity x y z [m/s], acceleration x y z [m/s^2], world axes; quaternion "
    "w x y z, vehicle to world; angular velocity x y z [rad/s], angular acceleration x y z [rad/s^2], vehicle "
    "axes; all true",
    POSE: "uint32: number in `sources`; float64[12]: rows of its true pose, 3 x 4, to the world",
    IMAGE: "uint32: frame; uint8: number of the camera in dataset.json; uint8: ASCII letter of the image type; path",
    END: "nothing: the stream is whole",
}
"""What follows the time in a payload, by the id of its message."""

Message = tuple[int, int, bytes]
"""Time [ns], id, and what follows the time."""


def write(job: Job) -> None:
    """Write the stream, and link the images of all types to ``images/cam<id>/<type>``, with what numbers of S mean."""
    if SEGMENTS in job.data.outputs:
        files.write_json(job.out / job.data.layout.segments.name, files.read_json(job.data.layout.segments))
    cameras = job.cameras if job.data.frames else ()
    sources = [*job.data.recorded, *cameras, *(job.data.moving if cameras else ())]
    streams = [
        *_readings(job.data),
        *(_poses(job.data, i, name) for i, name in enumerate(sources)),
        *(_images(job, camera) for camera in cameras),
    ]
    if "vehicle" in job.data.recorded:
        streams.append(_rows(STATE, job.data.states(), STATES))
    last_ns = job.data.start_ns
    about = json.dumps(_description(job, sources), ensure_ascii=False).encode()
    with files.atomic(job.out / NAME) as temp, temp.open("wb") as file:
        file.write(_encoded((last_ns, DESCRIPTION, about)))
        for message in heapq.merge(*streams, key=itemgetter(0, 1)):
            file.write(_encoded(message))
            last_ns = message[0]
        file.write(_encoded((last_ns, END, b"")))


def _encoded(message: Message) -> bytes:
    time_ns, number, rest = message
    return struct.pack("<4sIIq", START, number, 8 + len(rest), time_ns) + rest


def _description(job: Job, sources: list[str]) -> dict:
    """What the first message says."""
    fields = dict(FIELDS)
    for number in SENSOR_IDS.values():
        fields[number + 1] = f"{fields[number]}; without noise"
        fields[number + 2] = f"{fields[number]}; the bias in it"
    return {
        "format": "varos_warp stream",
        "version": VERSION,
        "byte_order": "little-endian",
        "messages": {str(number): f"int64: time [ns]; {fields[number]}" for number in sorted(fields)},
        "sources": sources,
        "start_ns": job.data.start_ns,
        "dataset": job.data.meta,
    }


def _poses(data: Clocked, number: int, name: str) -> Iterator[Message]:
    time_ns, T = data.poses(name)
    return _rows(POSE, {"time_ns": time_ns, "T": T[:, :3].reshape(-1, 12)}, ["T"], struct.pack("<I", number))


def _readings(data: Clocked) -> Iterator[Iterator[Message]]:
    """Readings of each sensor; of those with noise also the true ones and the bias, if there is one."""
    for name, number in SENSOR_IDS.items():
        if name in data.recorded:
            yield _rows(number, data.readings(name), READINGS[name])
            if data.has_noise(name):
                yield _rows(number + 1, data.readings(name, truth=True), READINGS[name])
            if (bias := data.bias(name)) is not None:
                yield _rows(number + 2, bias, READINGS[name])


def _rows(number: int, table: dict[str, np.ndarray], columns, before: bytes = b"") -> Iterator[Message]:
    """A message for each row of a table by quantity; ``before``: what stands before its numbers."""
    values = np.column_stack([table[quantity] for quantity in columns])
    content, size = values.astype("<f8").tobytes(), 8 * values.shape[1]
    for i, time_ns in enumerate(table["time_ns"].tolist()):
        yield time_ns, number, before + content[i * size : (i + 1) * size]


def _images(job: Job, camera: str) -> Iterator[Message]:
    """Links the images of a camera, and points to them."""
    layout, number = job.data.layout, job.data.cameras.index(camera)
    for time_ns, frame in zip(job.data.views(camera)[0].tolist(), job.data.frames, strict=True):
        for letter in job.data.outputs:
            source = layout.image(camera, letter, frame)
            path = f"images/cam{camera}/{letter}/{source.name}"
            files.link(source, job.out / path)
            yield time_ns, IMAGE, struct.pack("<IBB", frame, number, ord(letter)) + path.encode()
