"""ESRI ASCII grids, XYZ lists and tables are read as they are written, or refused by name."""

import time

import numpy as np
import pytest
import rasterio
import surveys
from surveys import EAST, NORTH, plane_grid, points_of, write_asc, write_text

from varos_warp.errors import InputError
from varos_warp.scene.description.survey import Heights
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.geometry.files.named import mesh_textures
from varos_warp.scene.geometry.survey import asc, columns, read_survey
from varos_warp.scene.geometry.survey.content import Request

ROUNDING = 8 * np.spacing(NORTH)
UTM_WKT = """PROJCS["WGS 84 / UTM zone 32N",GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],
PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],UNIT["{unit}",{size}]{epsg}]"""
DEGREES_WKT = """GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],PRIMEM["Greenwich",0],
UNIT["degree",0.0174532925199433]]"""


def request(path, **keys):
    return Request(path, Heights(kind="heights", file=str(path), **keys), "terrain")


def read(path, **keys):
    return read_survey(Heights(kind="heights", file=str(path), **keys))


def refusal(path, **keys):
    with pytest.raises(InputError) as caught:
        read(path, **keys)
    return caught.value


def holed():
    z = np.arange(35.0).reshape(5, 7) ** 1.5
    z[1, 2] = np.nan
    return z


# ---------------------------------------------------------------------------------------------------- ESRI ASCII grids


@pytest.mark.parametrize("corner", [True, False], ids=["corner", "center"])
def test_an_ascii_grid_lies_where_gdal_has_it(tmp_path, corner):
    path = write_asc(tmp_path / "a.asc", holed(), corner=corner)
    found = asc.read_asc(request(path))
    with rasterio.Env(AAIGRID_DATATYPE="Float64"), rasterio.open(path) as file:
        np.testing.assert_allclose(found.values, file.read(1, masked=True).filled(np.nan), rtol=1e-15)
        first = np.array([file.transform.c + 0.5 * file.transform.a, file.transform.f + 0.5 * file.transform.e])
        np.testing.assert_allclose(found.T[:, 2], first, rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(found.T[:, :2], [[file.transform.a, 0], [0, file.transform.e]], rtol=1e-12)


def test_the_header_may_be_in_capitals_with_different_spacings_and_lines_of_any_length(tmp_path):
    (tmp_path / "a.asc").write_text("NCOLS 3\nNROWS 2\nXLLCENTER 10\nYLLCORNER 20\nDX 2\nDY 4\n1 2\n3 4 5\n6\n")
    found = asc.read_asc(request(tmp_path / "a.asc"))
    assert found.values.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert found.T.tolist() == [[2, 0, 10], [0, -4, 26]]


def test_minus_9999_stands_for_none_where_the_header_does_not_say(tmp_path):
    (tmp_path / "a.asc").write_text("ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 -9999\n3 4\n")
    assert np.isnan(asc.read_asc(request(tmp_path / "a.asc")).values).tolist() == [[False, True], [False, False]]


def test_a_first_height_that_is_nan_is_no_word_of_the_header(tmp_path):
    (tmp_path / "a.asc").write_text("ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\nnan 2\n3 4\n")
    assert np.isnan(asc.read_asc(request(tmp_path / "a.asc")).values).tolist() == [[True, False], [False, False]]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("ncols 7", "ncols 8"), "5 x 8 heights, but 35 are there"),
        (("nrows 5", "nrows 4"), "more follow"),
        (("ncols 7", "ncols 7.5"), "ncols is 7.5"),
        (("cellsize 0.5", "cellsize -0.5"), "not positive and finite"),
        (("cellsize 0.5\n", ""), "lacks cellsize"),
        (("xllcorner", "xll"), "'xll'"),
        (("1 ", "1x "), "not all can be read"),
        (("nrows 5", "nrows 1e12"), "nrows is 1e+12"),
        (("ncols 7", "ncols seven"), "no name and number"),
    ],
)
def test_an_ascii_grid_that_does_not_hold_what_it_says_is_refused(tmp_path, change, said):
    path = write_asc(tmp_path / "a.asc", np.arange(35.0).reshape(5, 7), digits=6)
    assert change[0] in path.read_text()
    path.write_text(path.read_text().replace(*change, 1))
    assert said in refusal(path).message


@pytest.mark.parametrize(
    ("text", "metres"),
    [
        (UTM_WKT.format(unit="metre", size=1, epsg=',AUTHORITY["EPSG","32632"]'), 1.0),
        (UTM_WKT.format(unit="Foot_US", size=0.3048006096012192, epsg=""), 0.3048006096012192),
        ("Projection UTM\nZone 32\nDatum WGS84\nUnits METERS\n", 1.0),
        ("Projection STATEPLANE\nUnits FEET\n", 0.3048),
    ],
)
def test_the_prj_file_beside_it_tells_the_unit(tmp_path, text, metres):
    path = write_asc(tmp_path / "a.asc", plane_grid())
    (tmp_path / "a.prj").write_text(text)
    survey = read(path, height_unit="m")
    np.testing.assert_allclose(survey.facts["extent_m"][:2], [metres * EAST, metres * NORTH], rtol=1e-12)
    assert survey.facts["crs"] in ("EPSG:32632", "WGS 84 / UTM zone 32N", "UTM", "STATEPLANE")


@pytest.mark.parametrize("name", ["a.prj", "a.PRJ"])
def test_the_prj_file_is_one_of_those_that_a_plan_follows_from(tmp_path, name):
    write_asc(tmp_path / "a.asc", plane_grid())
    (tmp_path / name).write_text("Projection UTM\nUnits METERS\n")
    course = {"poses": [{"position": [0, 0, 0]}]}
    scene = scene_from_dict({"terrain": {"file": "a.asc"}, "trajectory": course}, tmp_path)
    assert [path.name.lower() for path in mesh_textures(scene)] == ["a.prj"]


@pytest.mark.parametrize(
    ("units", "zunits", "plan", "up"),
    [
        ("METERS", "FEET", 1.0, 0.3048),
        ("FEET", "METERS", 0.3048, 1.0),
        ("METERS", "NO", 1.0, 1.0),
        ("METERS", "NONE", 1.0, 1.0),
        ("FEET", "feet", 0.3048, 0.3048),
        ("4", "100", 0.25, 0.01),
    ],
)
def test_the_older_lines_of_a_prj_file_tell_the_unit_of_the_heights_too(tmp_path, units, zunits, plan, up):
    """A number is how many of the unit make a metre (Esri, technical article 30566)."""
    path = write_asc(tmp_path / "a.asc", plane_grid())
    (tmp_path / "a.prj").write_text(f"Projection    UTM\nZunits        {zunits}\nUnits         {units}\n")
    facts = read(path).facts
    np.testing.assert_allclose(facts["extent_m"][:2], [plan * EAST, plan * NORTH], rtol=1e-12)
    np.testing.assert_allclose(facts["heights_m"], [up * plane_grid().min(), up * plane_grid().max()], rtol=1e-12)


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("Units METERS\nZunits CUBITS\n", "terrain.height_unit"),
        ("Units FEET\nZunits NO\n", "terrain.height_unit"),
        ("Units METERS\nZunits 0\n", "terrain.height_unit"),
        ("Units CUBITS\nZunits FEET\n", "terrain.unit"),
    ],
)
def test_older_lines_of_a_prj_file_with_a_unit_that_is_not_known_are_asked_about(tmp_path, text, key):
    path = write_asc(tmp_path / "a.asc", plane_grid())
    (tmp_path / "a.prj").write_text(f"Projection UTM\n{text}")
    assert refusal(path).key == key


@pytest.mark.parametrize("text", [DEGREES_WKT, "Projection GEOGRAPHIC\nUnits DD\n"])
@pytest.mark.parametrize("name", ["a.prj", "a.PRJ"])
def test_a_prj_file_of_degrees_is_refused(tmp_path, text, name):
    path = write_asc(tmp_path / "a.asc", plane_grid())
    (tmp_path / name).write_text(text)
    assert "are degrees" in refusal(path).message


# -------------------------------------------------------------------------------------------------- lists and tables


@pytest.mark.parametrize(
    ("delimiter", "header", "comma"),
    [
        (" ", None, False),
        ("\t", "x\ty\tz", False),
        (",", None, False),
        (", ", "Easting, Northing, Elevation", False),
        (";", "E [m];N [m];H [m]", True),
        (" ", None, True),
        ("\t", None, True),
        (",", '"x","y","z"', False),
    ],
)
def test_tables_are_read_whatever_stands_between_their_numbers(tmp_path, delimiter, header, comma):
    points = points_of(holed())[~np.isnan(holed().ravel())]
    path = write_text(tmp_path / "a.csv", points, delimiter=delimiter, header=header, comma=comma)
    np.testing.assert_array_equal(columns.read_points(request(path)).points, points)


def test_comments_blank_lines_a_byte_order_mark_and_further_columns_are_passed_over(tmp_path):
    (tmp_path / "a.xyz").write_bytes(
        b"\xef\xbb\xbf# made by a sonar\n\n// x y z i\n1 2 3 99\n\n4 5 6 98\n# end\n7 8 9 97"
    )
    assert columns.read_points(request(tmp_path / "a.xyz")).points.tolist() == [[1, 2, 3], [4, 5, 6], [7, 8, 9]]


@pytest.mark.parametrize(
    ("given", "expected"),
    [(["Rechts", "Hoch", "Kote"], [2, 3, 4]), ([2, 3, 4], [2, 3, 4]), (["hoch", "RECHTS", 1], [3, 2, 1])],
)
def test_columns_are_named_or_numbered_from_one(tmp_path, given, expected):
    (tmp_path / "a.csv").write_text("Nr,Rechts,Hoch,Kote\n1,2,3,4\n")
    assert columns.read_points(request(tmp_path / "a.csv", columns=given)).points.tolist() == [expected]


def test_points_without_a_height_are_left_out_and_told(tmp_path):
    (tmp_path / "a.csv").write_text("x,y,z\n0,0,1\n1,0,nan\n0,1,-32768\n1,1,2\n2,1,3\n")
    cloud = columns.read_points(request(tmp_path / "a.csv", nodata=-32768))
    assert cloud.points[:, 2].tolist() == [1, 2, 3]
    assert cloud.notes == ["2 of its 5 points have no height"]


@pytest.mark.parametrize(
    ("text", "key", "said"),
    [
        ("a,b,c\n1,2,3\n", "terrain.columns", "does not tell which columns"),
        ("x,y,depth\n1,2,3\n", "terrain.positive", "called depth"),
        ("lon,lat,z\n10,63,-3\n", "terrain.file", "are degrees (a column is called lon)"),
        ("x (ft),y (ft),z (ft)\n1,2,3\n", "terrain.unit", "x (ft)"),
        ("x,y,z_ft\n1,2,3\n", "terrain.unit", "z_ft"),
        ("1 2 3\n4 5\n", "terrain.file", "a line cannot be read"),
        ("1 2 3\n4 5 x\n", "terrain.file", "'x'"),
        ("1 2\n3 4\n", "terrain.file", "a line cannot be read"),
        ("1,5, 2,5, 3,5\n", "terrain.file", "decimal commas"),
        ("# nothing\n", "terrain.file", "no points in it"),
        ("", "terrain.file", "0 bytes"),
        ("x y z\n", "terrain.file", "no points in it"),
    ],
)
def test_tables_that_can_be_read_in_two_ways_or_none_are_refused(tmp_path, text, key, said):
    (tmp_path / "a.csv").write_text(text)
    error = refusal(tmp_path / "a.csv")
    assert error.key == key
    assert said in error.message


@pytest.mark.parametrize("columns", [["east", "north", "depth_cm"], [2, 3, 4]])
def test_a_column_of_depths_that_is_chosen_does_not_tell_its_sign_either(tmp_path, columns):
    (tmp_path / "a.csv").write_text("nr,east,north,depth_cm\n1,2,3,4\n")
    assert refusal(tmp_path / "a.csv", columns=columns).key == "terrain.positive"


def test_a_column_that_is_not_there_is_refused(tmp_path):
    (tmp_path / "a.csv").write_text("a,b,c\n1,2,3\n")
    error = refusal(tmp_path / "a.csv", columns=["a", "b", "height"])
    assert error.key == "terrain.columns.2"
    assert "there are: a, b, c" in error.message
    assert "line" in refusal(tmp_path / "a.csv", columns=[1, 2, 9]).message


def test_more_points_than_the_limit_are_refused(tmp_path, monkeypatch):
    monkeypatch.setenv("VAROS_WARP_MAX_HEIGHTS", "34")
    path = write_text(tmp_path / "a.xyz", points_of(plane_grid()))
    assert "35 heights are more than the limit" in refusal(path).message


@pytest.mark.parametrize("positive", ["up", "down"])
def test_a_column_of_depths_has_the_sign_that_is_given(tmp_path, positive):
    points = surveys.points_of(plane_grid())
    path = write_text(tmp_path / "a.csv", points, delimiter=",", header="x,y,depth")
    sign = 1.0 if positive == "up" else -1.0
    expected = sorted([sign * points[:, 2].min(), sign * points[:, 2].max()])
    assert read(path, positive=positive).facts["heights_m"] == expected


@pytest.mark.parametrize(
    "text",
    [
        " " * 90_000 + "[",
        '"' * 90_001,
        "a" * 90_000,
        "[a" * 45_000,
        "PROJCS[" * 12_000,
        "PROJCS[]",
        'PROJCS["x",UNIT["m",nan]]',
        'PROJCS["x",UNIT["m"]]',
    ],
)
def test_projections_that_say_nothing_are_asked_for_in_little_time(tmp_path, text):
    path = write_asc(tmp_path / "a.asc", plane_grid())
    (tmp_path / "a.prj").write_text(text)
    start = time.process_time()
    assert refusal(path).key == "terrain.unit"
    assert time.process_time() - start < 5.0
    assert read(path, unit="m").facts["extent_m"][:2] == [EAST, NORTH]


def test_a_prj_file_of_the_mercator_projection_of_maps_is_refused(tmp_path):
    path = write_asc(tmp_path / "a.asc", plane_grid())
    (tmp_path / "a.prj").write_text(
        'PROJCS["WGS_1984_Web_Mercator_Auxiliary_Sphere",GEOGCS["GCS_WGS_1984"],PROJECTION["Mercator_Auxiliary_Sphere"],'
        'UNIT["Meter",1.0]]'
    )
    factor = np.cosh(NORTH / 6378137.0)
    assert f"{factor:.3g} times too long" in refusal(path).message


def test_a_mask_beside_a_grid_that_is_no_geotiff_is_told_of(tmp_path):
    path = write_asc(tmp_path / "a.asc", plane_grid())
    (tmp_path / "a.asc.msk").write_bytes(b"")
    assert any("a.asc.msk is a mask" in words for words in read(path).warnings)
