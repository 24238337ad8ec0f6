"""Calibration files: what other programs write is read as they mean it, or refused by file and key."""

import warnings

import cv2
import numpy as np
import pytest
import yaml

from varos_warp.errors import InputError
from varos_warp.scene.calibration.read import read_calibration
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.file.load import load_scene, scene_from_dict, scene_to_dict

FX, FY, CX, CY = 543.3011, 542.3987, 318.2249, 271.9001
K = np.array([[FX, 0.0, CX], [0.0, FY, CY], [0.0, 0.0, 1.0]])
RADTAN, FIVE = [-0.11, 0.09, 0.001, 0.0004], [-0.11, 0.09, 0.001, 0.0004, -0.03]
EIGHT = [4.1, 2.7, 0.0001, -0.0002, 0.1, 4.5, 4.0, 0.9]
EQUI = [-0.0057, -0.0103, 0.0028, -0.0022]
BROWN = {"model": "brown_conrady", "k": [*RADTAN, 0.0]}
SIZE = (640, 512)

KALIBR = f"""\
cam0:
  T_cam_imu:
  - [1.0, 0.0, 0.0, 0.1]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: {RADTAN}
  distortion_model: radtan
  intrinsics: [{FX}, {FY}, {CX}, {CY}]
  resolution: [640, 512]
  rostopic: /cam0/image_raw
  timeshift_cam_imu: -0.002
cam1:
  T_cn_cnm1: [[1.0, 0.0, 0.0, -0.2], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
  camera_model: ds
  distortion_coeffs: []
  distortion_model: none
  intrinsics: [-0.1996, 0.5924, {FX}, {FY}, {CX}, {CY}]
  resolution: [640, 512]
cam2:
  camera_model: pinhole
  distortion_coeffs: {EQUI}
  distortion_model: equidistant
  intrinsics: [{FX}, {FY}, {CX}, {CY}]
  resolution: [640, 512]
cam3:
  camera_model: pinhole
  distortion_coeffs: []
  distortion_model: none
  intrinsics: [{FX}, {FY}, {CX}, {CY}]
  resolution: [640, 512]
"""
EUROC = f"""\
%YAML:1.0
sensor_type: camera
comment: VI-Sensor cam0
T_BS:
  cols: 4
  rows: 4
  data: [0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
rate_hz: 20
resolution: [640, 512]
camera_model: pinhole
intrinsics: [{FX}, {FY}, {CX}, {CY}]
distortion_model: radial-tangential
distortion_coefficients: {RADTAN}
"""
ROS = """\
image_width: 640
image_height: 512
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: {K}
distortion_model: {model}
distortion_coefficients:
  rows: 1
  cols: {count}
  data: {D}
rectification_matrix:
  rows: 3
  cols: 3
  data: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
projection_matrix:
  rows: 3
  cols: 4
  data: [500.0, 0.0, 320.0, 0.0, 0.0, 500.0, 256.0, 0.0, 0.0, 0.0, 1.0, 0.0]
"""


def ros(model, D):
    return ROS.format(K=K.ravel().tolist(), model=model, D=D, count=len(D))


ECHO = f"""\
header:
  stamp:
    sec: 1734051505
    nanosec: 363371767
  frame_id: camera
height: 512
width: 640
distortion_model: rational_polynomial
d:
{"".join(f"- {x}{chr(10)}" for x in EIGHT)}k:
{"".join(f"- {x}{chr(10)}" for x in K.ravel())}r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
binning_x: 0
binning_y: 0
roi:
  x_offset: 0
  y_offset: 0
  height: 0
  width: 0
  do_rectify: false
---
"""


def read(tmp_path, text, camera="", name="calibration.yaml"):
    (tmp_path / name).write_text(text)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return read_calibration(f"{name}#{camera}" if camera else name, tmp_path)


def storage(path, **entries):
    """A file of OpenCV's own writer."""
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in entries.items():
        file.write(name, value)
    file.release()
    return path.read_text()


@pytest.mark.parametrize(
    ("camera", "distortion"),
    [
        ("cam0", BROWN),
        ("cam1", {"model": "double_sphere", "xi": -0.1996, "alpha": 0.5924}),
        ("cam2", {"model": "kannala_brandt", "k": EQUI}),
        ("cam3", None),
    ],
)
@pytest.mark.parametrize("head", ["", "%YAML:1.0\n", "%YAML:1.0\n---\n"])
def test_kalibr(tmp_path, camera, distortion, head):
    found = read(tmp_path, head + KALIBR, camera)
    assert found == ((FX, FY, CX, CY), distortion, SIZE)


def test_euroc(tmp_path):
    assert read(tmp_path, EUROC) == ((FX, FY, CX, CY), BROWN, SIZE)


@pytest.mark.parametrize(
    ("model", "D", "distortion"),
    [
        ("plumb_bob", FIVE, {"model": "brown_conrady", "k": FIVE}),
        ("plumb_bob", [0.0] * 5, None),
        ("rational_polynomial", EIGHT, {"model": "rational", "k": EIGHT}),
        ("rational_polynomial", [*EIGHT, 0.0, 0.0, 0.0, 0.0], {"model": "rational", "k": EIGHT}),
        ("rational_polynomial", [*FIVE, 0.0, 0.0, 0.0], {"model": "brown_conrady", "k": FIVE}),
        ("equidistant", EQUI, {"model": "kannala_brandt", "k": EQUI}),
        ("fisheye", EQUI, {"model": "kannala_brandt", "k": EQUI}),
        ("equidistant", [0.0] * 4, {"model": "kannala_brandt", "k": [0.0] * 4}),
    ],
)
def test_ros(tmp_path, model, D, distortion):
    assert read(tmp_path, ros(model, D)) == ((FX, FY, CX, CY), distortion, SIZE)


def test_a_message_of_ros_as_it_is_printed(tmp_path):
    assert read(tmp_path, ECHO) == ((FX, FY, CX, CY), {"model": "rational", "k": EIGHT}, SIZE)


def test_a_region_that_is_the_whole_image_cuts_nothing(tmp_path):
    whole = matrix(roi={"x_offset": 0, "y_offset": 0, "width": 640, "height": 512, "do_rectify": False})
    assert read(tmp_path, whole) == read(tmp_path, matrix())


def test_the_name_that_ros_gives_a_camera_may_be_asked_for(tmp_path):
    text = ros("plumb_bob", FIVE)
    assert read(tmp_path, text, "narrow_stereo") == read(tmp_path, text)


@pytest.mark.parametrize("suffix", ["yaml", "yml", "xml", "json"])
@pytest.mark.parametrize(
    ("D", "more", "distortion"),
    [
        (FIVE, {}, {"model": "brown_conrady", "k": FIVE}),
        (EIGHT, {}, {"model": "rational", "k": EIGHT}),
        ([*EIGHT, *[0.0] * 6], {}, {"model": "rational", "k": EIGHT}),
        (RADTAN, {"fisheye_model": 0}, BROWN),
        (EQUI, {"fisheye_model": 1}, {"model": "kannala_brandt", "k": EQUI}),
        (EQUI, {"distortion_model": "equidistant"}, {"model": "kannala_brandt", "k": EQUI}),
    ],
)
def test_opencv(tmp_path, suffix, D, more, distortion):
    """As OpenCV's own calibration sample names things, in each form that its writer has."""
    name = f"camera.{suffix}"
    text = storage(
        tmp_path / name,
        image_width=640,
        image_height=512,
        **more,
        camera_matrix=K,
        distortion_coefficients=np.array([D]).T,
    )
    assert read(tmp_path, text, name=name) == ((FX, FY, CX, CY), distortion, SIZE)


@pytest.mark.parametrize(
    ("k", "d"),
    [
        ("K", "D"),
        ("cameraMatrix", "distCoeffs"),
        ("M", "D"),
        ("Camera_Matrix", "Distortion_Coefficients"),
        ("camera_matrix", "dist_coeffs"),
    ],
)
def test_other_names_of_matrices(tmp_path, k, d):
    text = storage(tmp_path / "a.yaml", **{k: K, d: np.array([FIVE]), "image_size": np.array([[640, 512]])})
    assert read(tmp_path, text) == ((FX, FY, CX, CY), {"model": "brown_conrady", "k": FIVE}, SIZE)


@pytest.mark.parametrize("suffix", ["yml", "xml"])
def test_the_two_cameras_of_opencvs_stereo_sample(tmp_path, suffix):
    """Its file says no size."""
    name = f"intrinsics.{suffix}"
    text = storage(
        tmp_path / name, M1=K, D1=np.array([FIVE]), M2=2.0 * K - np.diag([0.0, 0.0, 1.0]), D2=np.array([EIGHT])
    )
    assert read(tmp_path, text, "1", name) == ((FX, FY, CX, CY), {"model": "brown_conrady", "k": FIVE}, None)
    second = read(tmp_path, text, "2", name)
    assert second.intrinsics == (2.0 * FX, 2.0 * FY, 2.0 * CX, 2.0 * CY)
    assert second.distortion == {"model": "rational", "k": EIGHT}


def test_opencvs_first_line_and_an_old_exponent(tmp_path):
    """OpenCV before 5, and numbers that YAML 1.1 takes for text."""
    text = (
        f'%YAML:1.0\n---\ncalibration_time: "Thu 01 Jan 2026"\nimage_width: 640\nimage_height: 512\n'
        f"camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: {K.ravel().tolist()}\n"
        "distortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n"
        "   data: [ -1.1e-001, 9e-2, 1e-3, 4e-4, 0. ]\n"
    )
    assert read(tmp_path, text).distortion == BROWN


def test_four_coefficients_of_no_model_are_taken_for_radtan_with_a_warning(tmp_path):
    storage(tmp_path / "a.yaml", camera_matrix=K, dist_coeffs=np.array([RADTAN]), image_size=np.array([[640, 512]]))
    with pytest.warns(UserWarning, match=r"a\.yaml: dist_coeffs has four .* add distortion_model: equidistant"):
        assert read_calibration("a.yaml", tmp_path).distortion == BROWN


@pytest.mark.parametrize("suffix", ["yaml", "xml", "json"])
def test_arrays_of_one_dimension(tmp_path, suffix):
    """OpenCV 5 writes them as matrices with sizes."""
    name = f"a.{suffix}"
    text = storage(tmp_path / name, K=K, D=np.array(FIVE), image_size=np.array([640, 512]))
    assert "sizes" in text
    assert read(tmp_path, text, name=name) == ((FX, FY, CX, CY), {"model": "brown_conrady", "k": FIVE}, SIZE)


# ----------------------------------------------------------------------------------------------------------- refusals


def kalibr(**changes):
    """The first camera of `KALIBR` alone, changed."""
    entry = yaml.safe_load(KALIBR)["cam0"] | changes
    return yaml.safe_dump({"cam0": {key: value for key, value in entry.items() if value is not None}})


def matrix(K=K, D=FIVE, **more):
    return yaml.safe_dump(
        {"image_width": 640, "image_height": 512, "camera_matrix": np.asarray(K).tolist(), "dist_coeffs": D} | more
    )


SKEWED = K + [[0.0, 0.4, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
BAD = {
    "omni": (kalibr(camera_model="omni"), "cam0.camera_model = 'omni': is no camera model that is had here"),
    "eucm": (kalibr(camera_model="eucm"), "cam0.camera_model = 'eucm'"),
    "fov": (kalibr(distortion_model="fov", distortion_coeffs=[0.9]), "cam0.distortion_model = 'fov': is no model"),
    "distorted sphere": (
        kalibr(camera_model="ds", intrinsics=[0.1, 0.6, 1, 1, 1, 1]),
        "cam0.distortion_model = 'radtan': is a distortion beside a double sphere",
    ),
    "few intrinsics": (kalibr(intrinsics=[500, 320, 240]), "cam0.intrinsics: has 3 numbers"),
    "few coefficients": (kalibr(distortion_coeffs=[0.1, 0.2, 0.3]), "cam0.distortion_coeffs: has 3 coefficients, but"),
    "no coefficients": (kalibr(distortion_coeffs=None), "cam0: has no distortion_coeffs"),
    "no model": (kalibr(distortion_model=None), "cam0: has no distortion_model"),
    "not a number": (kalibr(intrinsics=[500, "x", 320, 240]), "cam0.intrinsics: has 'x', which is no finite number"),
    "nan": (kalibr(distortion_coeffs=[0.1, float("nan"), 0, 0]), "is no finite number"),
    "halves of pixels": (kalibr(resolution=[640.5, 480]), "cam0.resolution: should be width and height"),
    "skew": (matrix(SKEWED), "camera_matrix: has a skew of 0.4"),
    "no matrix of intrinsics": (matrix(2.0 * K), "is not of the form [[fx, 0, cx]"),
    "thin prism": (matrix(D=[*EIGHT, 0.01, 0.0, 0.0, 0.0]), "dist_coeffs: has coefficients s1 to s4 of a thin prism"),
    "tilted": (matrix(D=[*EIGHT, 0.0, 0.0, 0.0, 0.0, 0.02, 0.0]), "has angles of a tilted sensor"),
    "six": (matrix(D=[*FIVE, 0.1]), "dist_coeffs: has 6 coefficients, but OpenCV's models have 4 or 5 or 8"),
    "two names": (matrix() + f"K: {K.tolist()}\n", "K: stands beside camera_matrix"),
    "no distortion": (yaml.safe_dump({"camera_matrix": K.tolist()}), "has camera_matrix but no coefficients"),
    "two sizes": (matrix(image_size=[512, 640]), "has the sizes (640, 512) and (512, 640)"),
    "contradiction": (matrix(D=EQUI, fisheye_model=1, distortion_model="plumb_bob"), "fisheye_model = 1: contra"),
    "fisheye of five": (matrix(fisheye_model=1), "dist_coeffs: has 5 coefficients, but kannala_brandt has 4"),
    "unknown model": (ros("thin_prism", FIVE), "distortion_model = 'thin_prism': is no model of distortion"),
    "plumb_bob of eight": (ros("plumb_bob", EIGHT), "has 8 coefficients, but plumb_bob has 4 or 5"),
    "binned": (matrix(binning_x=2), "binning_x = 2: bins pixels"),
    "cropped": (matrix(roi={"x_offset": 4, "y_offset": 0}), "roi.x_offset = 4: cuts a region"),
    "cropped at its corner": (
        matrix(roi={"x_offset": 0, "y_offset": 0, "width": 320, "height": 512}),
        "roi.width = 320: cuts a region",
    ),
    "cropped below": (matrix(roi={"width": 640, "height": 256}), "roi.height = 256: cuts a region"),
    "rows and columns": (ros("plumb_bob", FIVE).replace("cols: 3", "cols: 4", 1), "has 9 numbers, but rows"),
    "none of these": ("a: 1\n", "holds no camera of a form that is read here"),
    "text": ("just words\n", "holds no camera of a form that is read here"),
    "empty": ("", "holds no camera of a form that is read here"),
    "orb_slam3": ('%YAML:1.0\nCamera.type: "PinHole"\nCamera1.fx: 500.0\n', "holds no camera"),
    "twice": ("camera_matrix: [1]\ncamera_matrix: [2]\n", ":2: camera_matrix: is given twice"),
    "no yaml": ("a: [1\n", "is not valid YAML"),
    "object": ("a: !!python/object:os.system []\n", "is not valid YAML"),
    "no xml": ("<opencv_storage><a>1</a>", "is not valid XML"),
    "entities": (
        '<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a "aaaa">]><opencv_storage>&a;</opencv_storage>',
        "declares a document type or entities",
    ),
    "twice in xml": ("<opencv_storage><K>1</K><K>1</K></opencv_storage>", "K: is given twice"),
    "deep xml": ("<a>" * 50 + "</a>" * 50, "more than 20 elements"),
    "too long": (matrix(D=[0.1] * 2000), "has more than 1000 numbers"),
    "channels": (
        'K: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: "2d"\n   data: [1.0]\nD: [0.0]\n',
        "K.dt = '2d': is a matrix of several channels",
    ),
}


@pytest.mark.parametrize("what", BAD)
def test_what_is_not_had_here_is_refused_by_file_and_key(tmp_path, what):
    text, says = BAD[what]
    with pytest.raises(InputError) as error:
        read(tmp_path, text)
    assert says in str(error.value)
    assert str(tmp_path / "calibration.yaml") in str(error.value)


def test_a_camera_is_chosen_by_name(tmp_path):
    with pytest.raises(InputError, match=r"several cameras: cam0, cam1, cam2, cam3\. .* calibration\.yaml#cam0"):
        read(tmp_path, KALIBR)
    with pytest.raises(InputError, match=r"holds no camera 'cam9'\. Did you mean 'cam\d'"):
        read(tmp_path, KALIBR, "cam9")
    with pytest.raises(InputError, match=r"holds no camera 'left'\. There is: one without a name"):
        read(tmp_path, EUROC, "left")


def test_a_file_may_have_a_hash_in_its_name(tmp_path):
    assert read(tmp_path, EUROC, name="cam#1.yaml").resolution == SIZE


def test_there_must_be_such_a_file(tmp_path):
    (tmp_path / "camchain.yaml").write_text(KALIBR)
    with pytest.raises(InputError, match=r"camchian\.yaml: there is no such .* Did you mean 'camchain\.yaml'"):
        read_calibration("camchian.yaml#cam0", tmp_path)


# ------------------------------------------------------------------------------------------------------------- scenes


def scene(folder, **camera):
    poses = [{"position": [0, 0, 0]}]
    return scene_from_dict({"vehicle": {"cameras": [camera]}, "trajectory": {"poses": poses}}, folder)


def test_a_scene_has_the_camera_of_the_file(tmp_path):
    (tmp_path / "camchain.yaml").write_text(KALIBR)
    camera = scene(tmp_path, calibration="camchain.yaml#cam1").vehicle.cameras[0]
    alone = Camera(
        resolution=SIZE,
        intrinsics={"fx": FX, "fy": FY, "cx": CX, "cy": CY},
        distortion={"model": "double_sphere", "xi": -0.1996, "alpha": 0.5924},
    )
    assert camera.model_copy(update={"calibration": None}) == alone


def test_a_scene_that_is_written_down_needs_the_file_no_more(tmp_path):
    (tmp_path / "camchain.yaml").write_text(KALIBR)
    loaded = scene(tmp_path, calibration="camchain.yaml#cam0", f_stop=2.0, focal_mm=4.0)
    written = scene_to_dict(loaded)
    assert "calibration" not in written["vehicle"]["cameras"][0]
    again = scene_from_dict(written)
    assert scene_to_dict(again) == written
    assert again.vehicle.cameras[0].intrinsics == loaded.vehicle.cameras[0].intrinsics


def test_files_of_a_scene_are_relative_to_it(tmp_path, monkeypatch):
    """Also where the scene's own path is relative."""
    (tmp_path / "calibrations").mkdir()
    (tmp_path / "calibrations" / "a.yaml").write_text(EUROC)
    (tmp_path / "scene.yaml").write_text(
        "vehicle: {cameras: [{calibration: calibrations/a.yaml}]}\ntrajectory: {poses: [{position: [0, 0, 0]}]}\n"
    )
    monkeypatch.chdir(tmp_path.parent)
    loaded = load_scene(f"{tmp_path.name}/scene.yaml")
    assert loaded.vehicle.cameras[0].resolution == SIZE
    assert loaded.calibrations == ["calibrations/a.yaml"]


NO_SIZE = yaml.safe_dump({"K": K.tolist(), "D": FIVE})


@pytest.mark.parametrize(
    ("text", "keys", "says"),
    [
        (
            KALIBR,
            {"calibration": "a.yaml#cam0", "resolution": [640, 480]},
            "resolution: is not that of the calibration",
        ),
        (
            KALIBR,
            {"calibration": "a.yaml#cam0", "intrinsics": {"fx": 1, "fy": 1, "cx": 1, "cy": 1}},
            "intrinsics: stands beside calibration",
        ),
        (
            KALIBR,
            {"calibration": "a.yaml#cam0", "distortion": {"model": "radtan", "k": RADTAN}},
            "distortion: stands beside calibration",
        ),
        (KALIBR, {"calibration": "a.yaml#cam0", "focal_mm": 3.0}, "focal_mm: stands beside calibration"),
        (KALIBR, {"calibration": "a.yaml#cam0", "sensor_mm": [4.0, 3.0]}, "sensor_mm: stands beside calibration"),
        (
            KALIBR,
            {"calibration": "a.yaml#cam0", "f_stop": 2.0},
            "f_stop: beside calibration, in pixels, it needs focal_mm",
        ),
        (KALIBR, {"calibration": "a.yaml"}, "calibration: "),
        (KALIBR, {"calibration": 3}, "calibration = 3: "),
        (NO_SIZE, {"calibration": "a.yaml"}, "calibration: the file does not say of what resolution it is"),
        (kalibr(intrinsics=[-1.0, 500.0, 320.0, 240.0]), {"calibration": "a.yaml"}, "a.yaml: intrinsics.fx = -1.0"),
        (
            kalibr(distortion_coeffs=[1e9, 0.0, 0.0, 0.0]),
            {"calibration": "a.yaml"},
            "a.yaml: distortion.0 = 1000000000.0",
        ),
        (kalibr(resolution=[0, 480]), {"calibration": "a.yaml"}, "a.yaml: resolution.0 = 0"),
    ],
)
def test_what_a_scene_says_beside_a_calibration_must_not_contradict_it(tmp_path, text, keys, says):
    (tmp_path / "a.yaml").write_text(text)
    with pytest.raises(InputError) as error:
        scene(tmp_path, **keys)
    assert says in str(error.value)
    assert str(error.value).startswith("vehicle.cameras.0.")


def test_the_resolution_may_stand_beside_a_calibration(tmp_path):
    (tmp_path / "a.yaml").write_text(EUROC)
    assert scene(tmp_path, calibration="a.yaml", resolution=[640, 512]).vehicle.cameras[0].resolution == SIZE
    (tmp_path / "a.yaml").write_text(NO_SIZE)
    assert scene(tmp_path, calibration="a.yaml", resolution=[800, 600]).vehicle.cameras[0].resolution == (800, 600)
