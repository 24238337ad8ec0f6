"""Points of LAS and LAZ files are read as laspy has them, without noise, in the unit of their projection."""

import struct
import sys

import laspy
import numpy as np
import pytest
import surveys
from surveys import EAST, NORTH, plane_grid, points_of, write_las

from varos_warp.errors import InputError
from varos_warp.scene.description.survey import Heights
from varos_warp.scene.geometry.survey import read_survey
from varos_warp.scene.geometry.survey.content import Request
from varos_warp.scene.geometry.survey.las import read_las


def request(path, **keys):
    return Request(path, Heights(kind="heights", file=str(path), **keys), "terrain")


def read(path, **keys):
    return read_survey(Heights(kind="heights", file=str(path), **keys))


def refusal(path, **keys):
    with pytest.raises(InputError) as caught:
        read(path, **keys)
    return caught.value


def scattered_points(count=60):
    x, y, z = np.random.default_rng(7).uniform(0.0, 10.0, (3, count)).round(3)
    return np.column_stack([EAST + x, NORTH + y, -z])


def geokey_record(keys):
    rows = [1, 1, 0, len(keys), *(number for key, value in keys.items() for number in (key, 0, 1, value))]
    return laspy.VLR("LASF_Projection", 34735, "", struct.pack(f"<{len(rows)}H", *rows))


def wkt_record(text):
    return laspy.VLR("LASF_Projection", 2112, "", text.encode() + b"\0")


@pytest.mark.parametrize("name", ["a.las", "a.laz"])
@pytest.mark.parametrize(("version", "point_format"), [("1.2", 0), ("1.2", 3), ("1.4", 6)])
def test_points_are_those_of_laspy_in_double(tmp_path, name, version, point_format):
    points = scattered_points()
    path = write_las(tmp_path / name, points, version=version, point_format=point_format)
    found = read_las(request(path)).points
    assert np.abs(found - points).max() < 1e-6
    assert (found == np.asarray(laspy.read(path).xyz)).all()


def test_noise_and_withheld_points_are_left_out_and_told(tmp_path):
    classes = np.tile([2, 40, 7, 18, 0, 1], 10)
    path = write_las(tmp_path / "a.las", scattered_points(), classes, version="1.4", point_format=6)
    las = laspy.read(path)
    las.withheld = np.arange(60) == 0
    las.write(path)
    cloud = read_las(request(path))
    kept = ~np.isin(classes, (7, 18)) & (np.arange(60) != 0)
    assert (cloud.points == np.asarray(las.xyz)[kept]).all()
    assert cloud.notes == ["21 of its 60 points are noise or withheld, and left out"]


def test_classes_choose_points(tmp_path):
    classes = np.tile([2, 40, 7], 20)
    path = write_las(tmp_path / "a.las", scattered_points(), classes, version="1.4", point_format=6)
    assert len(read_las(request(path, classes=[40, 7])).points) == 40
    error = refusal(path, classes=[9])
    assert error.key == "terrain.classes"
    assert error.value == [9]


@pytest.mark.parametrize(
    ("records", "metres"),
    [
        ([geokey_record({1024: 1, 3072: 32632, 3076: 9001})], 1.0),
        ([geokey_record({1024: 1, 3072: 2225})], 1200 / 3937),
        ([wkt_record('PROJCS["x",GEOGCS["y"],UNIT["foot",0.3048]]')], 0.3048),
        ([wkt_record('COMPD_CS["z",PROJCS["x",UNIT["foot",0.3048]],VERT_CS["h",UNIT["metre",1]]]')], 0.3048),
        (
            [wkt_record('PROJCRS["x",BASEGEOGCRS["y"],CS[Cartesian,2],AXIS["e",east,ORDER[1],LENGTHUNIT["metre",1]]]')],
            1.0,
        ),
    ],
)
def test_coordinates_are_in_the_unit_of_the_projection(tmp_path, records, metres):
    path = write_las(tmp_path / "a.las", points_of(plane_grid()), vlrs=records)
    np.testing.assert_allclose(
        read(path, height_unit="m").facts["extent_m"][:2], [metres * EAST, metres * NORTH], rtol=1e-12
    )


@pytest.mark.parametrize(
    "record",
    [
        geokey_record({1024: 2, 2048: 4326}),
        wkt_record('GEOGCS["WGS 84",UNIT["degree",0.0174]]'),
        wkt_record('COMPOUNDCRS["c",GEOGCRS["WGS 84"],VERTCRS["v"]]'),
        wkt_record('GEOCCS["x"]'),
    ],
)
def test_degrees_and_geocentric_coordinates_are_refused(tmp_path, record):
    path = write_las(tmp_path / "a.las", points_of(plane_grid()), vlrs=[record])
    assert "degrees" in refusal(path).message


def test_a_depth_below_a_datum_asks_which_way_is_up(tmp_path):
    record = wkt_record('COMPD_CS["z",PROJCS["x",UNIT["m",1]],VERT_CS["h",UNIT["metre",1],AXIS["Depth",DOWN]]]')
    path = write_las(tmp_path / "a.las", points_of(plane_grid()), vlrs=[record])
    assert refusal(path).key == "terrain.positive"
    assert read(path, positive="down").facts["heights_m"][1] == pytest.approx(-plane_grid().min())


@pytest.mark.parametrize("name", ["a.las", "a.laz"])
def test_a_file_that_is_cut_off_or_none_is_refused(tmp_path, name):
    path = write_las(tmp_path / name, scattered_points(2000))
    path.write_bytes(path.read_bytes()[:-3000])
    assert refusal(path).key == "terrain.file"
    path.write_bytes(b"LASF and no more")
    assert "cannot be read as a LAS file" in refusal(path).message


def test_more_points_than_the_limit_are_refused(tmp_path, monkeypatch):
    monkeypatch.setenv("VAROS_WARP_MAX_HEIGHTS", "59")
    assert "VAROS_WARP_MAX_HEIGHTS=60" in refusal(write_las(tmp_path / "a.laz", scattered_points())).message


def test_without_laspy_the_message_names_what_to_install(tmp_path, monkeypatch):
    path = write_las(tmp_path / "a.las", scattered_points())
    monkeypatch.setitem(sys.modules, "laspy", None)
    assert 'pip install "varos_warp[survey]"' in refusal(path).remedy


def test_without_lazrs_laz_names_what_to_install_and_las_is_read(tmp_path, monkeypatch):
    paths = [write_las(tmp_path / name, surveys.points_of(plane_grid())) for name in ("a.las", "a.laz")]
    monkeypatch.setattr(laspy.LazBackend, "is_available", lambda self: False)
    assert 'pip install "varos_warp[survey]"' in refusal(paths[1]).remedy
    assert len(read(paths[0]).vertices) == 35
