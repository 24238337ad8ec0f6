"""The TUM export comes back through evo and OpenCV."""

import cv2
import numpy as np
from evo.tools import file_interface
from readback import ROUNDING, largest_ape, rows


def test_tum_course_is_that_of_the_camera_and_its_lists_name_the_images(data, out):
    course = file_interface.read_tum_trajectory_file(out / "tum/groundtruth.txt")
    assert largest_ape(course, *data.poses("L0")) < ROUNDING
    for name in ("rgb", "depth"):
        table = rows(out / f"tum/{name}.txt")
        assert [round(float(t) * 1e9) for t, _ in table] == data.time_ns().tolist()
        assert all((out / "tum" / path).is_file() for _, path in table)
    text = (out / "tum/groundtruth.txt").read_text()
    assert not any(line != line.strip() for line in text.splitlines())
    first = rows(out / "tum/rgb.txt")[0][1]
    assert (out / "tum" / first).read_bytes() == data.layout.image("L0", "A", 0).read_bytes()


def test_tum_associations_pair_each_image_with_its_depth(data, out):
    table = rows(out / "tum/associations.txt")
    assert [[float(row[0]), float(row[2])] for row in table] == [[t / 1e9] * 2 for t in data.time_ns("L0").tolist()]
    for frame, (_, color, _, depth) in zip(data.frames, table, strict=True):
        bgr = cv2.imread(str(out / "tum" / color), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(bgr[..., ::-1], data.pixels("A", frame, "L0"))
        units = cv2.imread(str(out / "tum" / depth), cv2.IMREAD_UNCHANGED)
        truth = data.depth(frame, "L0")
        near = truth <= 65535 / 5000
        assert np.abs(units / 5000 - truth)[near].max() <= 0.5 / 5000 + 25 * 2.0**-24
        assert not units[~near].any()


def test_tum_accelerometer_is_the_imus(data, out):
    table = np.array(rows(out / "tum/accelerometer.txt"), float)
    np.testing.assert_array_equal(table[:, 1:], data.imu()["acceleration"])
    np.testing.assert_array_equal(np.rint(table[:, 0] * 1e9), data.imu()["time_ns"])
