"""A dataset is read as public programs read the released VAROS sequence (zenodo.org/record/5567209), without a change.

What they ask for was read in their source, and is asked for here in the same way: a PyTorch dataset for depth from
several views (class VAROSMultiviewDataset), C++ of a direct odometry (functions motionPriorGT and depthGTMPReg), a
script that makes optical flow of depth and poses, one that makes velocities for an event camera, and one that plots
trajectories of ORB-SLAM3 over the vehicle's.
"""

import glob

import cv2
import numpy as np
import pandas as pd
import pytest
import standins
import yaml
from PIL import Image
from scipy.interpolate import interp1d

from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.produce import produce

HALF_STEP = 0.5 * 25.0 / 65535.0
"""Rounding of D [m]."""


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """A dataset with the camera that the released sequence has, M0, at its 10 Hz."""
    out = tmp_path_factory.mktemp("released") / "2021-08-17_SEQ1"
    blocks = standins.scene_dict()
    camera = blocks["vehicle"]["cameras"][0] | {"id": "M0"}
    with pytest.MonkeyPatch.context() as patch:
        standins.install(patch)
        produce(standins.make_scene(vehicle=blocks["vehicle"] | {"cameras": [camera]}), out, quiet=True)
    return Dataset(out)


@pytest.fixture(scope="module")
def folder(data):
    """The folder of the camera, with the slash that programs put names behind."""
    return f"{data.root}/vehicle0/cam0/"


def test_as_a_torch_dataset_reads_images_and_poses(data, folder):
    """Sorted names give the order; a pose is the row of the same stamp, its 12 numbers the rows of T_w_c."""
    listed = {letter: sorted(glob.glob(f"{folder}{letter}/*.png")) for letter in "ABCD"}
    stamps = pd.read_csv(folder + "camM0_timestamps.csv", sep=",", header=None, comment="#")
    table = pd.read_csv(folder + "camM0_poses/camM0_poses_transformation_matrix.csv", sep=",", header=None, comment="#")
    euler = pd.read_csv(folder + "camM0_poses/camM0_poses_euler.csv", sep=",", header=None, comment="#")
    assert {len(names) for names in listed.values()} == {len(stamps)} == {len(data.frames)}
    assert euler.shape == (len(table), 7)
    for frame in data.frames:
        row = table.loc[table[0] == stamps.at[frame, 0]].to_numpy()[0][1:]
        np.testing.assert_array_equal(np.vstack([row.reshape(3, 4), [0, 0, 0, 1]]), data.T_w_c(frame, "M0"))
        for letter in "AB":
            with Image.open(listed[letter][frame]) as image:
                np.testing.assert_array_equal(np.array(image.convert("RGB")), data.pixels(letter, frame, "M0"))
        with Image.open(listed["D"][frame]) as image:
            units = np.array(image)
        assert units.dtype.kind in "ui"
        assert units.shape == (27, 48)


def test_as_an_odometry_in_cpp_finds_stamp_pose_and_depth(data, folder):
    """The name of D stands in the fifth column, its number has eight digits; 65535 is 25 m along the camera's axis."""
    with open(folder + "camM0_timestamps.csv", encoding="utf-8") as file:
        stamps = [line.rstrip("\n").split(",") for line in file][1:]
    with open(folder + "camM0_poses/camM0_poses_transformation_matrix.csv", encoding="utf-8") as file:
        poses = [line.rstrip("\n").split(",") for line in file][1:]
    fx, fy, cx, cy = data.intrinsics("M0", "opencv")[[0, 1, 0, 1], [0, 1, 2, 2]]
    for number in data.frames:
        name = f"seq01_veh0_camM0_D-{number:08d}"
        (stamp,) = [int(row[0]) for row in stamps if row[4][: len(name)] == name]
        (numbers,) = [list(map(float, row[1:])) for row in poses if int(row[0]) == stamp]
        T = np.array(numbers).reshape(3, 4)
        metres = cv2.imread(f"{folder}D/{name}.png", cv2.IMREAD_ANYDEPTH) * 25.0 / 65535.0
        v, u = np.argwhere(metres < 25.0 - HALF_STEP).T
        z = metres[v, u]
        world = np.stack([(u - cx) / fx * z, (v - cy) / fy * z, z], -1) @ T[:, :3].T + T[:, 3]
        down = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones(len(u))], -1) @ T[2, :3]
        assert len(u) > 100
        assert (np.abs(world[:, 2] - standins.FLOOR_Z) <= (HALF_STEP + 25 * 2.0**-24) * np.abs(down) + 1e-9).all()


def test_as_a_script_for_flow_reads_calibration_and_times(data, folder):
    """Focal length and sensor in mm; the centre is half the size; pose rows are found by 10 Hz from 0."""
    with open(folder + "camM0.yaml", encoding="utf-8") as file:
        camera = yaml.safe_load(file)
    size = camera.get("resolution") or camera
    width, height = (size["width"], size["height"]) if isinstance(size, dict) else (camera["width"], camera["height"])
    K = np.array(
        [
            [camera["focal_length"] / camera["sensor_width"] * width, 0, width / 2],
            [0, camera["focal_length"] / camera["sensor_height"] * height, height / 2],
            [0, 0, 1],
        ]
    )
    np.testing.assert_allclose(K, data.intrinsics("M0"), rtol=1e-12)
    poses = pd.read_csv(folder + "camM0_poses/camM0_poses_transformation_matrix.csv", header=0)
    stamps = pd.read_csv(folder + "camM0_timestamps.csv", header=0).iloc[:, 0].to_numpy()
    assert np.abs(poses.iloc[:, 0].to_numpy()[:, None] - 100_000_000 * np.arange(len(stamps))).min(axis=0).max() == 0


def test_as_a_script_for_velocities_reads_columns_by_name(data, folder):
    """Angular velocity between readings of the IMU, and R_w_c by r11 to r33."""
    poses = pd.read_csv(folder + "camM0_poses/camM0_poses_transformation_matrix.csv")
    imu = pd.read_csv(f"{data.root}/vehicle0/imu0/imu0_data.csv")
    time_s, at_s = imu["# timestamp [ns]"].to_numpy() * 1e-9, poses["# timestamp [ns]"].to_numpy() * 1e-9
    w = imu[[f"w_RS_S_{axis} [rad s^-1]" for axis in "xyz"]].to_numpy()
    R = poses[[f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)]].to_numpy().reshape(-1, 3, 3)
    place = poses[["s_x_vw", "s_y_vw", "s_z_vw"]].to_numpy()
    time_ns, T_w_c = data.views("M0")
    np.testing.assert_array_equal(R, T_w_c[:, :3, :3])
    np.testing.assert_array_equal(place, T_w_c[:, :3, 3])
    truth = data.imu()
    rows = np.searchsorted(truth["time_ns"], time_ns)
    found = interp1d(time_s, w, axis=0, kind="linear", fill_value="extrapolate")(at_s)
    np.testing.assert_allclose(found, truth["angular_velocity"][rows], rtol=0, atol=1e-9)


def test_as_a_plot_reads_the_vehicles_course(data):
    course = pd.read_csv(f"{data.root}/vehicle0/ground_truth_vehicle0_poses/vehicle0_poses_euler.csv")
    found = np.stack([course[f"s_{axis}_vw"].to_numpy() for axis in "xyz"], -1)
    np.testing.assert_array_equal(found, data.poses("vehicle")[1][:, :3, 3])
