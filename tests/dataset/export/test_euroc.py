"""The EuRoC export comes back through evo, GTSAM, OpenCV and plain parsers as what the dataset has."""

import shutil

import cv2
import gtsam
import numpy as np
import yaml
from evo.tools import file_interface
from readback import ROUNDING, largest_ape, rows
from standins import make_scene, scene_dict

from varos_warp.dataset.export import export
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.produce import produce


def test_euroc_ground_truth_is_the_course_of_the_imu(data, out):
    path = out / "euroc/mav0/state_groundtruth_estimate0/data.csv"
    course = file_interface.read_euroc_csv_trajectory(path)
    time_ns, T_w_s = data.poses("imu0")
    assert largest_ape(course, time_ns, T_w_s) < ROUNDING
    assert [len(row) for row in rows(path, ",")] == [17] * len(time_ns)


def test_euroc_velocity_is_the_derivative_of_the_position(data, out):
    """Central differences over h = 5 ms are good to h^2/6 times the third derivative, which is below 4 m/s^3."""
    table = np.array(rows(out / "euroc/mav0/state_groundtruth_estimate0/data.csv", ","), float)
    difference = (table[2:, 1:4] - table[:-2, 1:4]) / 0.01
    assert np.abs(difference - table[1:-1, 8:11]).max() < 0.005**2 / 6 * 4
    without_lever = np.abs(difference - data.states()["velocity"][1:-1]).max()
    assert without_lever > 0.05  # so the lever arm counts


def test_euroc_imu_has_the_gyroscope_first_and_a_row_after_the_last_image(data, out):
    path = out / "euroc/mav0/imu0/data.csv"
    assert path.read_text().splitlines()[0] == (
        "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
        "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]"
    )
    table, imu = rows(path, ","), data.imu()
    assert [int(row[0]) for row in table] == imu["time_ns"].tolist()
    np.testing.assert_array_equal(np.array(table, float)[:, 1:4], imu["angular_velocity"])
    np.testing.assert_array_equal(np.array(table, float)[:, 4:], imu["acceleration"])
    images = [int(line) for line in (out / "euroc/times.txt").read_text().splitlines()]
    assert images == data.time_ns().tolist()
    assert int(table[0][0]) <= images[0]
    assert int(table[-1][0]) > images[-1]


def test_gtsam_comes_from_the_first_state_to_the_last_by_the_imu_alone(out):
    """Its preintegration has an error of order 2 in the step h, so 4/3 of that at h less 1/3 of that at 2 h is none.

    It holds a reading over a step in the axes of the step's beginning, so it is given the mean of two readings, turned
    back by half a step. What is left is of order 4: a hundredth of the error at h, of 3 um and 0.7 urad, is ample.
    """
    imu, states = (
        np.array(rows(out / f"euroc/mav0/{name}/data.csv", ","), float)
        for name in ("imu0", "state_groundtruth_estimate0")
    )
    one, two = (imu_drift(imu[::step], states[::step]) for step in (1, 2))
    assert 0 < np.linalg.norm(one[:3]) < 1e-5
    assert 0 < np.linalg.norm(one[6:]) < 1e-5
    for part in (slice(0, 3), slice(3, 6), slice(6, 9)):  # position, velocity, attitude
        assert np.linalg.norm((4 * one - two)[part] / 3) < 0.01 * np.linalg.norm(one[part])


def imu_drift(imu, states):
    """Position [m], velocity [m/s] and attitude [rad] that GTSAM integrates to, less the last state's."""
    no_bias = gtsam.imuBias.ConstantBias()
    first, last = (gtsam.NavState(gtsam.Rot3.Quaternion(*row[4:8]), row[1:4], row[8:11]) for row in states[[0, -1]])
    moved = gtsam.PreintegratedImuMeasurements(gtsam.PreintegrationParams.MakeSharedU(9.81), no_bias)
    for step, reading in zip(np.diff(imu[:, 0]) * 1e-9, (imu[1:, 1:] + imu[:-1, 1:]) / 2, strict=True):
        turned = gtsam.Rot3.Expmap(reading[:3] * step / 2).matrix() @ reading[3:]
        moved.integrateMeasurement(turned, reading[:3], step)
    found = moved.predict(first, no_bias)
    return np.concatenate(
        [
            found.position() - last.position(),
            found.velocity() - last.velocity(),
            last.attitude().logmap(found.attitude()),
        ]
    )


def test_orb_slam3_is_not_given_an_image_after_the_last_imu_row(written, tmp_path):
    copy = shutil.copytree(written, tmp_path / "copy")
    path = copy / "vehicle0/imu0/imu0_data.csv"
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(lines[:-20]))  # the last row is at 0.905 s now
    cut = [line.split(",")[0] for line in lines[:-20]][-1]
    export(copy, "euroc", tmp_path / "out")
    times = [int(line) for line in (tmp_path / "out/times.txt").read_text().splitlines()]
    assert times[-1] < int(cut)
    assert len(times) == sum(t < int(cut) for t in Dataset(copy).time_ns())


def test_t_bs_takes_camera_coordinates_to_the_body_and_its_pose_to_the_cameras(data, out):
    time_ns, T_w_b = data.poses("imu0")
    for number, camera in enumerate(data.cameras):
        sensor = yaml.safe_load((out / f"euroc/mav0/cam{number}/sensor.yaml").read_text())
        assert (sensor["T_BS"]["rows"], sensor["T_BS"]["cols"]) == (4, 4)
        T_b_c = np.reshape(sensor["T_BS"]["data"], (4, 4))
        at_frames = T_w_b[np.isin(time_ns, data.time_ns(camera))]
        np.testing.assert_allclose(at_frames @ T_b_c, data.poses(camera)[1], rtol=0, atol=ROUNDING)
        assert sensor["resolution"] == [48, 27]
        np.testing.assert_allclose(sensor["intrinsics"], [3.4 / 4.416 * 48, 3.4 / 2.484 * 27, 23.5, 13.0], rtol=1e-15)
        assert (sensor["sensor_type"], sensor["camera_model"]) == ("camera", "pinhole")
        assert (sensor["distortion_model"], sensor["distortion_coefficients"]) == ("radial-tangential", [0.0] * 4)
        kalibr = yaml.safe_load((out / "euroc/kalibr_camchain.yaml").read_text())[f"cam{number}"]
        np.testing.assert_allclose(kalibr["T_cam_imu"] @ T_b_c, np.eye(4), rtol=0, atol=ROUNDING)
        assert all(isinstance(x, float) for x in kalibr["intrinsics"])
    imu = yaml.safe_load((out / "euroc/mav0/imu0/sensor.yaml").read_text())
    np.testing.assert_array_equal(np.reshape(imu["T_BS"]["data"], (4, 4)), np.eye(4))
    assert imu["rate_hz"] == 200


def test_euroc_images_are_named_by_their_time_and_byte_for_byte_the_datasets(data, out):
    table = rows(out / "euroc/mav0/cam1/data.csv", ",")
    assert [(int(t), name) for t, name in table] == [(t, f"{t}.png") for t in data.time_ns("R0").tolist()]
    for frame, (_, name) in zip(data.frames, table, strict=True):
        assert (out / "euroc/mav0/cam1/data" / name).read_bytes() == data.layout.image("R0", "A", frame).read_bytes()


def test_opencv_sees_the_pixels_of_the_dataset(data, out):
    for frame, t in zip(data.frames, data.time_ns("R0").tolist(), strict=True):
        bgr = cv2.imread(str(out / f"euroc/mav0/cam1/data/{t}.png"), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(bgr[..., ::-1], data.pixels("A", frame, "R0"))


def test_the_folder_has_the_files_of_a_euroc_sequence_and_ours(out):
    found = {p.relative_to(out / "euroc").as_posix() for p in (out / "euroc").rglob("*") if p.suffix != ".png"}
    folders = ("cam0", "cam1", "imu0", "state_groundtruth_estimate0", "depth_gauge0")
    assert {path for path in found if path.startswith("mav0/") and not path.endswith("body.yaml") and "." in path} == {
        f"mav0/{folder}/{name}" for folder in folders for name in ("sensor.yaml", "data.csv")
    }
    for folder in folders:
        assert {"sensor_type", "comment", "T_BS"} <= set(
            yaml.safe_load((out / f"euroc/mav0/{folder}/sensor.yaml").read_text())
        )


def test_noise_that_the_scene_has_is_stated_and_its_bias_is_in_the_ground_truth(tmp_path):
    noise = {"gyroscope_noise_density": 2e-4, "gyroscope_random_walk": 3e-5, "accelerometer_noise_density": 4e-3}
    vehicle = scene_dict()["vehicle"]
    scene = make_scene(vehicle=vehicle | {"imu": vehicle["imu"] | {"noise": noise}}, render={"outputs": ["A"]})
    produce(scene, tmp_path / "data", quiet=True)
    export(tmp_path / "data", "euroc", tmp_path / "out")
    sensor = yaml.safe_load((tmp_path / "out/mav0/imu0/sensor.yaml").read_text())
    assert {key: sensor[key] for key in noise} == noise
    assert sensor["accelerometer_random_walk"] > 0  # Kalibr refuses zero
    assert "accelerometer_random_walk" in sensor["comment"]
    truth = np.array(rows(tmp_path / "out/mav0/state_groundtruth_estimate0/data.csv", ","), float)
    np.testing.assert_array_equal(truth[:, 14:], 0.3)
    np.testing.assert_array_equal(truth[:, 11:14], 0.0)


def test_readings_of_a_dataset_with_noise_have_it_and_the_files_say_so(noisy, tmp_path):
    job = export(noisy.root, "euroc", tmp_path / "out")
    table = np.array(rows(tmp_path / "out/mav0/imu0/data.csv", ","), float)
    np.testing.assert_array_equal(table[:, 4:], noisy.imu()["acceleration"])
    assert not np.array_equal(table[:, 4:], noisy.imu(truth=True)["acceleration"])
    gauge = np.array(rows(tmp_path / "out/mav0/depth_gauge0/data.csv", ","), float)[:, 1]
    np.testing.assert_array_equal(gauge, noisy.depth_gauge()["depth"])
    truth = np.array(rows(tmp_path / "out/mav0/state_groundtruth_estimate0/data.csv", ","), float)
    np.testing.assert_array_equal(truth[:, 14:], noisy.imu_bias()["acceleration"])
    t = noisy.time_ns("L0")[3]
    seen = cv2.imread(str(tmp_path / f"out/mav0/cam0/data/{t}.png"))[..., ::-1]
    np.testing.assert_array_equal(seen, noisy.pixels("A", noisy.frames[3], "L0"))
    assert not np.array_equal(seen, noisy.pixels("A", noisy.frames[3], "L0", truth=True))
    for folder in ("imu0", "depth_gauge0", "cam0"):
        comment = yaml.safe_load((tmp_path / f"out/mav0/{folder}/sensor.yaml").read_text())["comment"]
        assert "with the noise of profile test, seed 5" in comment
    assert set(job.noises.values()) == {"with the noise of profile test, seed 5"}
