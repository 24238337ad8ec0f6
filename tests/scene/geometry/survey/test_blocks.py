"""A scene's terrain from survey files: its keys, what is told of it, and what is refused."""

import json
import warnings

import numpy as np
import pytest
import surveys
from surveys import (
    EAST,
    NORTH,
    STEP,
    axes,
    plane,
    plane_grid,
    points_of,
    rough,
    write_asc,
    write_geotiff,
    write_las,
    write_text,
)
from typer.testing import CliRunner

from varos_warp.cli import app
from varos_warp.errors import InputError
from varos_warp.scene.checks import check_scene
from varos_warp.scene.description.survey import ENDINGS, FOR
from varos_warp.scene.file.load import load_scene, scene_from_dict, scene_to_dict
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.geometry.foreign import REMEDIES
from varos_warp.scene.geometry.mesh_files import FORMATS, write_ply
from varos_warp.scene.geometry.terrain import mesh_facts
from varos_warp.scene.info import scene_info


def scene(folder, **terrain):
    return scene_from_dict(
        {
            "terrain": terrain,
            "trajectory": {
                "poses": [{"position": [EAST + 1.5, NORTH + 1.0, -20.0], "rotation_euler_deg": [-90, 0, 0]}]
            },
        },
        folder,
    )


def refusal(folder, **terrain):
    with pytest.raises(InputError) as caught:
        build_parts(scene(folder, **terrain))
    return caught.value


def vertices(folder, **terrain):
    return build_parts(scene(folder, **terrain))[0].vertices


def test_a_file_whose_name_says_so_is_a_survey_without_a_kind(tmp_path):
    write_asc(tmp_path / "a.ASC", plane_grid())
    loaded = scene(tmp_path, file="a.ASC")
    assert loaded.terrain.kind == "heights"
    assert (build_parts(loaded)[0].vertices == vertices(tmp_path, kind="heights", file="a.ASC")).all()


def test_keys_that_are_absent_are_not_written_and_what_is_written_reads_the_same(tmp_path):
    loaded = scene(tmp_path, file="a.tif", positive="down", height_scale=0.1)
    written = scene_to_dict(loaded)["terrain"]
    assert written["positive"] == "down"
    assert not {"nodata", "columns", "origin", "pixel_m"} & written.keys()
    assert scene_from_dict(scene_to_dict(loaded)).terrain == loaded.terrain
    assert "origin" not in scene_to_dict(scene(tmp_path, file="a.ply"))["terrain"]


def test_depths_are_turned_over_scaled_and_moved(tmp_path):
    write_geotiff(tmp_path / "a.tif", plane_grid())
    z = vertices(tmp_path, file="a.tif", positive="down", height_scale=0.1, height_offset_m=2.5)[:, 2]
    np.testing.assert_allclose(np.sort(z), np.sort(2.5 - 0.1 * plane_grid().ravel()), atol=1e-12)


@pytest.mark.parametrize("name", ["a.tif", "a.ply"])
def test_the_origin_is_subtracted_in_double(tmp_path, name):
    xyz = points_of(plane_grid())
    if name == "a.tif":
        write_geotiff(tmp_path / name, plane_grid())
    else:
        write_ply(tmp_path / name, xyz, np.array([[0, 7, 1], [1, 7, 8]]))
    origin = [EAST + 0.3, NORTH - 0.7, -30.1]
    here, there = vertices(tmp_path, file=name), vertices(tmp_path, file=name, origin=origin)
    assert (there == here - origin).all()
    moved = vertices(tmp_path, file=name, origin=origin, position=[1, 2, 3], scale=2.0)
    np.testing.assert_allclose(moved, (here - origin) * 2.0 + [1, 2, 3], rtol=1e-15)


def test_a_region_and_a_resolution_cut_and_thin(tmp_path):
    write_geotiff(tmp_path / "a.tif", plane_grid((21, 31)))
    region = [EAST + 2.0, NORTH + 1.0, EAST + 8.0, NORTH + 6.0]
    x, y, _ = vertices(tmp_path, file="a.tif", region=region).T
    assert (x.min(), y.min(), x.max(), y.max()) == tuple(region)
    assert len(vertices(tmp_path, file="a.tif", region=region, resolution_m=1.0)) == 6 * 5
    error = refusal(tmp_path, file="a.tif", region=[0, 0, 1, 1])
    assert (error.key, error.value) == ("terrain.region", [0, 0, 1, 1])


def test_points_of_a_region_are_cut_before_they_are_joined(tmp_path):
    write_las(tmp_path / "a.laz", points_of(plane_grid((21, 31)), (21, 31)))
    x, y, _ = vertices(tmp_path, file="a.laz", region=[EAST + 2.0, NORTH + 1.0, EAST + 8.0, NORTH + 6.0]).T
    np.testing.assert_allclose([x.min(), y.max()], [EAST + 2.0, NORTH + 6.0], atol=1e-8)


@pytest.mark.parametrize("ending", ["tif", "asc", "xyz"])
def test_tiles_are_joined_without_a_gap(tmp_path, ending):
    z = plane_grid((10, 12))
    whole = points_of(z, (10, 12))
    for name, columns in (("west", slice(0, 5)), ("east", slice(5, 12))):
        part = z[:, columns]
        if ending == "xyz":
            kept = (whole[:, 0] - EAST) / STEP
            write_text(tmp_path / f"{name}.xyz", whole[(kept >= columns.start) & (kept < columns.stop)])
        elif ending == "tif":
            corner = (EAST + (columns.start - 0.5) * STEP, NORTH + (10 - 0.5) * STEP)
            write_geotiff(tmp_path / f"{name}.tif", part, corner=corner)
        else:
            path = write_asc(tmp_path / f"{name}.asc", part)
            path.write_text(
                path.read_text().replace(
                    f"xllcorner {EAST - 0.25!r}", f"xllcorner {EAST + columns.start * STEP - 0.25!r}"
                )
            )
    part = build_parts(scene(tmp_path, file=[f"west.{ending}", f"east.{ending}"]))[0]
    assert len(part.faces) == 2 * 9 * 11
    x, y, z = part.vertices.T
    np.testing.assert_allclose(z, plane(x, y), atol=1e-8)


def test_grids_and_points_are_not_joined(tmp_path):
    write_geotiff(tmp_path / "a.tif", plane_grid())
    write_text(tmp_path / "a.xyz", points_of(plane_grid()))
    assert "cannot be joined" in refusal(tmp_path, file=["a.tif", "a.xyz"]).message
    write_geotiff(tmp_path / "b.tif", plane_grid(), keys={1024: 1, 3072: 32633, 3076: 9001})
    assert "EPSG:32632, EPSG:32633" in refusal(tmp_path, file=["a.tif", "b.tif"]).message


def test_preprocess_and_detail_follow_as_for_a_mesh(tmp_path):
    x, y = axes((41, 41))
    write_geotiff(tmp_path / "a.tif", rough(x, y[:, None]))
    few = build_parts(scene(tmp_path, file="a.tif", preprocess={"target_vertices": 100}))[0]
    assert 98 <= len(few.vertices) <= 100
    relief = vertices(tmp_path, file="a.tif", detail={"relief_m": 0.1, "feature_m": 5})
    off = relief[:, 2] - rough(*relief[:, :2].T)
    assert 0.05 < np.ptp(off) <= 0.1


# ---------------------------------------------------------------------------------------------------------------- told


def test_info_tells_size_place_system_heights_and_holes(tmp_path):
    z = plane_grid((12, 14))
    z[5, 6] = z[0, 0] = -9999
    write_geotiff(tmp_path / "a.tif", z, nodata=-9999)
    (tmp_path / "s.yaml").write_text(
        "terrain: {file: a.tif}\ntrajectory: {poses: [{position: [400003, 6100003, -20]}]}\n"
    )
    result = CliRunner().invoke(app, ["info", str(tmp_path / "s.yaml")])
    assert result.exit_code == 0, result.output
    assert "survey a.tif: 12 x 14 nodes, 0.5 x 0.5 m apart; EPSG:32632" in result.output
    assert "x 400000.000 to 400006.500 m, y 6100000.000 to 6100005.500 m" in result.output
    assert "1 hole of 1 m2 in all, 2 nodes without height" in result.output
    assert "warning: terrain: 1 hole without heights, 1 m2 in all; they are left open" in result.output
    facts = json.loads(CliRunner().invoke(app, ["info", str(tmp_path / "s.yaml"), "--json"]).output)["survey"]
    assert facts["crs"] == "EPSG:32632"
    assert facts["heights_m"] == [z[z > -100].min(), z.max()]


def test_info_tells_of_points_without_a_grid(tmp_path):
    write_text(tmp_path / "a.xyz", points_of(plane_grid())[::2])
    (tmp_path / "s.yaml").write_text(
        "terrain: {file: a.xyz}\ntrajectory: {poses: [{position: [400001, 6100001, -20]}]}\n"
    )
    result = CliRunner().invoke(app, ["info", str(tmp_path / "s.yaml")])
    assert result.exit_code == 0, result.output
    assert "survey a.xyz: 18 points, median edge" in result.output
    assert "coordinate system not told" in result.output
    assert "no holes" in result.output


def test_the_holes_that_are_told_are_filled_where_preprocess_is_asked_to(tmp_path):
    z = plane_grid((12, 14))
    z[5, 6] = np.nan
    write_geotiff(tmp_path / "a.tif", z)
    made = build_parts(scene(tmp_path, file="a.tif", preprocess={"fill_holes_m": 3.0}))
    assert any("preprocess fills those" in doubt for doubt in made[0].doubts)
    assert mesh_facts(made[0].vertices, made[0].faces)["boundary_edges"] == 2 * (11 + 13)  # the outline alone
    assert "they are left open" in " ".join(build_parts(scene(tmp_path, file="a.tif"))[0].doubts)


def test_a_scene_without_a_survey_says_nothing_of_one(tmp_path):
    made = scene_from_dict(
        {"terrain": {"kind": "procedural", "resolution": 9}, "trajectory": {"poses": [{"position": [0, 0, 5]}]}}
    )
    assert "survey" not in scene_info(made, build_parts(made))


@pytest.mark.parametrize(("values", "words"), [(-9999.0, "give nodata: -9999"), (-32768.0, "give nodata: -32768")])
def test_values_that_look_as_if_they_stood_for_none_are_warned_of(tmp_path, values, words):
    z = plane_grid()
    z[2, 3] = values
    write_geotiff(tmp_path / "a.tif", z)
    made = scene(tmp_path, file="a.tif")
    assert any(words in warning for warning in check_scene(made, build_parts(made)))
    assert not any("nodata" in each for each in build_parts(scene(tmp_path, file="a.tif", nodata=values))[0].doubts)


def test_heights_that_are_no_heights_are_refused(tmp_path):
    z = plane_grid()
    z[2, 3] = -3.4e38
    write_geotiff(tmp_path / "a.tif", z)
    assert refusal(tmp_path, file="a.tif").key == "terrain.nodata"


def test_coordinates_that_may_be_degrees_are_warned_of(tmp_path):
    points = points_of(plane_grid()) - [EAST, NORTH, 0.0]
    write_text(tmp_path / "a.xyz", points * [1e-3, 1e-3, 1.0] + [10.0, 63.0, 0.0])
    assert any("may be degrees" in each for each in build_parts(scene(tmp_path, file="a.xyz"))[0].doubts)


def test_a_mesh_that_was_rounded_to_single_precision_far_away_is_warned_of(tmp_path):
    rng = np.random.default_rng(1)
    exact = rng.random((200, 3)) * [50.0, 50.0, 1.0] + [EAST, NORTH, -30.0]
    faces = rng.permutation(200)[:198].reshape(-1, 3)

    def doubts(points):
        write_ply(tmp_path / "a.ply", points, faces)
        return build_parts(scene(tmp_path, file="a.ply"))[0].doubts

    assert doubts(exact) == ()
    assert "rounded to 0.5 m, as single precision" in doubts(exact.astype(np.float32))[0]
    whole = np.column_stack([np.arange(200) % 20 * 0.5 + EAST, np.arange(200) // 20 * 0.5 + NORTH, exact[:, 2]])
    assert doubts(whole.astype(np.float32)) == ()  # nodes half a metre apart are exact
    assert doubts((exact - [EAST, NORTH, 0.0]).astype(np.float32)) == ()


# ------------------------------------------------------------------------------------------------------------- refused


@pytest.mark.parametrize("key", FOR)
def test_keys_that_mean_nothing_to_a_file_are_refused(tmp_path, key):
    other = next(ending for ending in ENDINGS if ending not in FOR[key])
    value = {
        "pixel_m": 1.0,
        "first_row": "north",
        "height_range_m": [0, 1],
        "columns": [1, 2, 3],
        "classes": [2],
        "longest_edge_m": 1.0,
        "nodata": 0.0,
    }[key]
    with pytest.raises(InputError, match=key) as caught:
        scene(tmp_path, file=f"a{other}", **{key: value})
    assert "leave it out" in caught.value.message


@pytest.mark.parametrize("ending", [ending for ending in REMEDIES if ending not in FORMATS])
def test_formats_that_are_not_read_name_the_way_to_one_that_is(tmp_path, ending):
    (tmp_path / f"a{ending}").write_bytes(b"x" * 100)
    for block in ({"kind": "file"}, {"kind": "heights"}) if ending not in ENDINGS else ({"kind": "file"},):
        error = refusal(tmp_path, file=f"a{ending}", **block)
        assert "unknown" in error.problem
        assert error.remedy.startswith(REMEDIES[ending])


def test_a_mesh_of_kind_heights_and_a_missing_file_are_refused(tmp_path):
    write_ply(tmp_path / "a.ply", np.eye(3), np.array([[0, 1, 2]]))
    assert "leave out kind" in refusal(tmp_path, kind="heights", file="a.ply").remedy
    assert "there is no such survey file" in refusal(tmp_path, file="b.tif").message


def test_a_refusal_names_the_line_of_the_scene(tmp_path):
    (tmp_path / "a.tif").write_bytes(b"II*\0no tiff")
    (tmp_path / "s.yaml").write_text("name: x\nterrain:\n  file: a.tif\ntrajectory: {poses: [{position: [0, 0, 0]}]}\n")
    result = CliRunner().invoke(app, ["info", str(tmp_path / "s.yaml")])
    assert result.exit_code == 2
    assert "s.yaml:3: terrain.file = 'a.tif'" in result.output + result.stderr


def test_names_of_other_programs_lead_to_ours(tmp_path):
    (tmp_path / "s.yaml").write_text(
        "terrain: {file: a.tif, depth: true}\ntrajectory: {poses: [{position: [0, 0, 0]}]}\n"
    )
    with pytest.raises(InputError, match="Here it is positive"):
        load_scene(tmp_path / "s.yaml")


# ---------------------------------------------------------------------------------------------------------- preprocess


def test_preprocess_takes_surveys_with_their_keys(tmp_path):
    write_geotiff(tmp_path / "a.tif", -plane_grid((31, 31)))
    command = [
        "preprocess",
        str(tmp_path / "a.tif"),
        "-o",
        str(tmp_path / "floor.ply"),
        "--shrinkwrap",
        "none",
        "--survey",
        "positive=down",
        "--survey",
        "height_offset_m=1.5",
    ]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 0, result.output
    assert "survey a.tif: 31 x 31 nodes" in result.output
    report = json.loads((tmp_path / "floor.json").read_text())
    assert report["survey"]["crs"] == "EPSG:32632"
    x, y, z = build_parts(scene(tmp_path, file="floor.ply"))[0].vertices.T
    assert np.abs(z - plane(x, y) - 1.5).max() < 1e-6


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["a.npy"], "survey.pixel_m"),
        (["a.npy", "--survey", "pixel_m"], "not of the form KEY=VALUE"),
        (["a.npy", "--survey", "pixel=1"], "survey.pixel"),
        (["a.npy", "--survey", "pixel_m=-1"], "survey.pixel_m"),
        (["a.ply", "--survey", "pixel_m=1"], "is for survey files"),
        (["a.npy", "--survey", "pixel_m=1", "--survey", "origin=[1, 2, 3]"], "survey.origin: does not tell how"),
        (["a.npy", "--survey", "pixel_m=1", "--survey", "scale=2"], "survey.scale: does not tell how"),
    ],
)
def test_preprocess_refuses_keys_that_are_none(tmp_path, monkeypatch, arguments, said):
    monkeypatch.chdir(tmp_path)
    np.save("a.npy", np.zeros((4, 4)))
    write_ply("a.ply", np.eye(3), np.array([[0, 1, 2]]))
    first_row = ["--survey", "first_row=north"] if arguments[0] == "a.npy" else []
    result = CliRunner().invoke(app, ["preprocess", *arguments, *first_row, "-o", "out.ply"])
    assert result.exit_code == 2
    assert said in result.output + result.stderr


def test_reading_warns_of_nothing_by_itself(tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name, write in (
            ("a.tif", lambda p: write_geotiff(p, plane_grid())),
            ("a.asc", lambda p: write_asc(p, plane_grid())),
            ("a.laz", lambda p: write_las(p, points_of(plane_grid()))),
            ("a.xyz", lambda p: write_text(p, points_of(plane_grid()))),
        ):
            write(tmp_path / name)
            vertices(tmp_path, file=name)
    assert surveys.SHAPE == plane_grid().shape


# ---------------------------------------------------------------------------------------------- what keys mean together


def test_the_distance_of_pixels_is_in_metres_whatever_the_unit(tmp_path):
    with pytest.raises(InputError, match="unit: has no meaning beside pixel_m"):
        scene(tmp_path, file="a.npy", pixel_m=1.0, first_row="north", unit="ft")
    write_geotiff(tmp_path / "a.tif", plane_grid(), place="none", keys={1024: 1, 3072: 2225, 3076: 9003, 4099: 9003})
    part = build_parts(scene(tmp_path, file="a.tif", pixel_m=1.0))[0]
    assert part.survey["extent_m"] == [-3.0, -2.0, 3.0, 2.0]
    np.testing.assert_allclose(part.survey["heights_m"][0], plane_grid().min() * 1200 / 3937)


def test_points_above_each_other_are_told(tmp_path):
    points = points_of(plane_grid())[::2]
    write_text(tmp_path / "a.xyz", np.vstack([points, points[:3] + [0, 0, 1]]))
    assert any(
        each.startswith("3 points above or below others")
        for each in build_parts(scene(tmp_path, file="a.xyz"))[0].doubts
    )


def test_a_resolution_that_leaves_one_row_is_refused_by_name(tmp_path):
    write_geotiff(tmp_path / "a.tif", plane_grid())
    error = refusal(tmp_path, file="a.tif", resolution_m=50)
    assert error.key == "terrain.resolution_m"
    assert "1 x 1 nodes after it was thinned" in error.message
