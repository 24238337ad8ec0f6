"""What the fits beside this file share: their arguments, what dataset.json says, and tables of corners.

Keep it in the folder of the script that you run.
"""

import argparse
import csv
import json
import math


def arguments(description, noise_px):
    """A parser of a dataset, a table of corners, and the noise that is added to them."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("dataset")
    parser.add_argument("corners", help="a table of corners, cam<ID>.csv")
    parser.add_argument("--noise", type=float, default=noise_px, help="standard deviation of corners [pixels]")
    parser.add_argument("--seed", type=int, default=0, help="of the noise")
    return parser


def camera_of(parser, given):
    """What dataset.json says, and its entry of the camera that a table is of; else an end with what is wrong."""
    if not 0.0 <= given.noise < math.inf or given.seed < 0:
        parser.error("--noise is at least 0, and so is --seed")
    try:
        with open(f"{given.dataset}/dataset.json", encoding="utf-8") as file:
            about = json.load(file)
        cameras = {f"cam{camera['id']}.csv": camera for camera in about["cameras"]}
    except (OSError, ValueError, KeyError, TypeError) as error:
        parser.error(f"{given.dataset} is no dataset: {error}")
    name = given.corners.replace("\\", "/").rpartition("/")[2]
    if name not in cameras:
        parser.error(f"{given.corners} is no table of this dataset's cameras: {', '.join(cameras)}")
    camera = cameras[name]
    if camera.get("distortion", "none") != "none":
        parser.error(f"{name} is of a camera with distortion: K is not all")
    if (camera.get("exposure") or camera.get("shutter") or {}).get("readout_s"):
        parser.error(f"{name} is of a rolling shutter: its rows are of other instants than the stamps")
    return about, camera


def frames_of(path, *columns):
    """Rows of a table, of each frame a list; those of ``columns`` are numbers, and there is their ``state``.

    Raises:
        ValueError: If it is no table of corners, or an empty one.
    """
    frames = {}
    try:
        with open(path, encoding="utf-8") as file:
            for row in csv.DictReader(file):
                numbers = {key: float(row[key]) for key in columns}
                frames.setdefault(row["frame"], []).append({"state": row["state"], **numbers})
    except (OSError, KeyError, TypeError, ValueError, csv.Error) as error:
        raise ValueError(f"{path} is no table that `varos-warp export --to corners` wrote: {error}") from None
    if not frames:
        raise ValueError(f"{path} has no corners")
    return list(frames.values())
