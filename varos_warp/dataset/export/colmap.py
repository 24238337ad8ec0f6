"""COLMAP: the text model sparse/0 with the exact cameras and poses, points from D, the images, and a database of them.

(https://colmap.github.io/format.html) A point lies on the surface that one pixel saw, and that pixel is its track.
The database (https://colmap.github.io/database.html) has the cameras and images of the model under the same numbers, so
features that are found with it can be triangulated from the exact poses. A port follows the parameters of its camera as
COLMAP Underwater writes it (src/colmap/sensor/models_refrac.h and Reconstruction::WriteCamerasText there).
"""

import sqlite3
from collections.abc import Iterable
from contextlib import closing

import numpy as np

from varos_warp.dataset import files
from varos_warp.dataset.export.shared.job import Job, lens_of, numbers, quaternion
from varos_warp.dataset.export.shared.seed import seeds
from varos_warp.scene.description.image_types import DEPTH, WATER
from varos_warp.scene.frames import inverse
from varos_warp.scene.optics.camera import GREEN
from varos_warp.scene.optics.ports import FlatPort

IMAGES = WATER + DEPTH


def write(job: Job) -> None:
    """Write cameras.txt, images.txt and points3D.txt, the images under ``images/cam<id>``, and database.db.

    COLMAP has no ports, so there is no database where a camera is behind one.
    """
    models = [_model(job, camera) for camera in job.cameras]
    ports = [_port(job, camera) for camera in job.cameras]
    names = " ".join(dict.fromkeys(PARAMETERS[model] for model, _ in models))
    cameras = [f"# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[] ({names})"]
    cameras += ["# OPTIONAL[REFRAC_MODEL REFRAC_PARAMS[]] (COLMAP Underwater; lengths in m)"] * any(ports)
    images = ["# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME", "# POINTS2D[] as (X, Y, POINT3D_ID)"]
    points = ["# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)"]
    known: list[tuple[int, str, int]] = []
    image_id = point_id = 1
    for number, (camera, (model, parameters), port) in enumerate(zip(job.cameras, models, ports, strict=True), start=1):
        facts = job.data.camera(camera)
        cameras.append(f"{number} {model} {facts['width']} {facts['height']} {numbers(parameters)}{port}")
        for (name, pose), seed in zip(_images(job, camera), seeds(job, camera), strict=True):
            track = list(enumerate(zip(seed.xyz, seed.rgb.tolist(), seed.uv.tolist(), strict=True)))
            images += [
                f"{image_id} {pose} {number} {name}",
                " ".join(f"{u} {v} {point_id + i}" for i, (_, _, (u, v)) in track),
            ]
            points += [
                f"{point_id + i} {numbers(xyz)} {r} {g} {b} 0.0 {image_id} {i}" for i, (xyz, (r, g, b), _) in track
            ]
            known.append((image_id, name, number))
            image_id, point_id = image_id + 1, point_id + len(seed.xyz)
    for name, lines in (("cameras", cameras), ("images", images), ("points3D", points)):
        job.text(f"sparse/0/{name}.txt", lines)
    if not any(ports):
        files.write_bytes(job.out / "database.db", database(_camera_rows(job, models), known))


PARAMETERS = {
    "PINHOLE": "fx fy cx cy",
    "FULL_OPENCV": "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6",
    "OPENCV_FISHEYE": "fx fy cx cy k1 k2 k3 k4",
}
NUMBERS = {"PINHOLE": 1, "OPENCV_FISHEYE": 5, "FULL_OPENCV": 6}
"""What COLMAP's database calls its camera models (src/colmap/sensor/models.h there)."""
TABLES = """
CREATE TABLE cameras (camera_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, model INTEGER NOT NULL,
    width INTEGER NOT NULL, height INTEGER NOT NULL, params BLOB, prior_focal_length INTEGER NOT NULL);
CREATE TABLE rigs (rig_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, ref_sensor_id INTEGER NOT NULL,
    ref_sensor_type INTEGER NOT NULL);
CREATE UNIQUE INDEX rig_ref_sensor_assignment ON rigs(ref_sensor_id, ref_sensor_type);
CREATE TABLE frames (frame_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, rig_id INTEGER NOT NULL,
    FOREIGN KEY(rig_id) REFERENCES rigs(rig_id) ON DELETE CASCADE);
CREATE TABLE frame_data (frame_id INTEGER NOT NULL, data_id INTEGER NOT NULL, sensor_id INTEGER NOT NULL,
    sensor_type INTEGER NOT NULL, FOREIGN KEY(frame_id) REFERENCES frames(frame_id) ON DELETE CASCADE);
CREATE UNIQUE INDEX frame_sensor_assignment ON frame_data(data_id, sensor_type);
CREATE TABLE images (image_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, name TEXT NOT NULL UNIQUE,
    camera_id INTEGER NOT NULL, CONSTRAINT image_id_check CHECK(image_id >= 0 and image_id < 2147483647),
    FOREIGN KEY(camera_id) REFERENCES cameras(camera_id));
CREATE UNIQUE INDEX index_name ON images(name);
"""
"""Tables of cameras and images as COLMAP 3.12 and later make them; the others it makes when it opens the database."""


def database(cameras: Iterable[tuple], images: list[tuple[int, str, int]]) -> bytes:
    """A database of COLMAP without features, of the cameras' numbers, models, sizes and parameters, and images.

    Each camera, whose parameters are float64, little-endian, is a rig and each image (number, name, camera) a frame of
    it, with the same numbers: that is what COLMAP takes a model without rigs.txt and frames.txt for.
    """
    with closing(sqlite3.connect(":memory:")) as tables:
        tables.executescript(TABLES)
        for number, *about in cameras:  # 1: its focal length is known; 0: the sensor is a camera
            tables.execute("INSERT INTO cameras VALUES (?, ?, ?, ?, ?, 1)", (number, *about))
            tables.execute("INSERT INTO rigs VALUES (?, ?, 0)", (number, number))
        for image, name, camera in images:
            tables.execute("INSERT INTO images VALUES (?, ?, ?)", (image, name, camera))
            tables.execute("INSERT INTO frames VALUES (?, ?)", (image, camera))
            tables.execute("INSERT INTO frame_data VALUES (?, ?, ?, 0)", (image, image, camera))
        tables.commit()
        return tables.serialize()


def _camera_rows(job: Job, models: list[tuple[str, list[float]]]) -> Iterable[tuple]:
    for number, (camera, (model, parameters)) in enumerate(zip(job.cameras, models, strict=True), start=1):
        facts = job.data.camera(camera)
        yield number, NUMBERS[model], facts["width"], facts["height"], np.array(parameters, "<f8").tobytes()


def _model(job: Job, camera: str) -> tuple[str, list[float]]:
    """COLMAP's name of a camera's model, and its parameters."""
    lens, k = lens_of(job, camera, "COLMAP", "brown_conrady", "rational", "kannala_brandt", "port")
    K = job.fx_fy_cx_cy(camera, "center_half")
    if lens in ("brown_conrady", "rational"):
        return "FULL_OPENCV", [*K, *k, *[0.0] * (8 - len(k))]
    return ("OPENCV_FISHEYE" if k else "PINHOLE"), [*K, *k]


def _port(job: Job, camera: str) -> str:
    """A camera's port and the index of the water for green, or nothing."""
    model = job.data.camera_model(camera)
    if model.port is None:
        return ""
    port, indices = model.port, (1.0, model.port.n_glass, model.n_water[GREEN])
    if isinstance(port, FlatPort):
        return f" FLATPORT {numbers([*port.normal, port.distance_m, port.thickness_m, *indices])}"
    return f" DOMEPORT {numbers([*port.centre, port.radius_m - port.thickness_m, port.thickness_m, *indices])}"


def _images(job: Job, camera: str) -> Iterable[tuple[str, str]]:
    """Name and pose of each image: world to camera, scalar first."""
    T_c_w = np.array([inverse(T) for T in job.data.views(camera)[1]])
    rows = np.column_stack([quaternion(T_c_w, scalar_first=True), T_c_w[:, :3, 3]])
    names = [f"cam{camera}/{name}" for name in job.names(camera)]
    job.link_images(camera, (f"images/{name}" for name in names))
    return zip(names, map(numbers, rows), strict=True)
