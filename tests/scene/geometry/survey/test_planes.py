"""A plane z = ax + by + c at UTM coordinates stays one, to the rounding of float64, in every format."""

import numpy as np
import pytest
import surveys
from surveys import EAST, NORTH, plane, plane_grid, points_of

from varos_warp.scene.description.survey import Heights
from varos_warp.scene.geometry.survey import read_survey

ROUNDING = 8 * np.spacing(surveys.NORTH)
"""A few roundings of the largest coordinate; slopes are below 1."""


def read(path, **keys):
    return read_survey(Heights(kind="heights", file=str(path), **keys))


def jittered():
    """Points without a grid, rounded as a LAS file rounds them."""
    x, y = np.random.default_rng(5).uniform(0.0, 3.0, (2, 400)).round(3)
    return np.column_stack([EAST + x, NORTH + y, plane(EAST + x, NORTH + y)])


WRITERS = {
    "tif": lambda path: surveys.write_geotiff(path, plane_grid()),
    "tiff": lambda path: surveys.write_geotiff(
        path, plane_grid(), place="matrix", compression="deflate", tile=(16, 16)
    ),
    "asc": lambda path: surveys.write_asc(path, plane_grid()),
    "xyz": lambda path: surveys.write_text(path, points_of(plane_grid())),
    "csv": lambda path: surveys.write_text(path, points_of(plane_grid()), delimiter=",", header="x,y,z"),
    "txt": lambda path: surveys.write_text(path, jittered(), delimiter=";", comma=True),
    "tsv": lambda path: surveys.write_text(path, jittered(), delimiter="\t"),
    "las": lambda path: surveys.write_las(path, points_of(plane_grid())),
    "laz": lambda path: surveys.write_las(path, jittered()),
}


@pytest.mark.parametrize("ending", WRITERS)
def test_a_plane_stays_a_plane(tmp_path, ending):
    path = tmp_path / f"survey.{ending}"
    WRITERS[ending](path)
    survey = read(path)
    x, y, z = survey.vertices.T
    step = 0.5e-6 if ending in ("las", "laz") else 0.0  # half a step of the file's own heights
    assert np.abs(z - plane(x, y)).max() <= ROUNDING + step
    normals = np.cross(*(survey.vertices[survey.faces[:, i]] - survey.vertices[survey.faces[:, 0]] for i in (1, 2)))
    assert (normals[:, 2] > 0.0).all()  # counter-clockwise seen from above
    assert survey.warnings == []


@pytest.mark.parametrize("ending", ["tif", "tiff", "asc", "xyz", "csv", "las"])
def test_the_nodes_of_a_grid_are_where_its_file_has_them(tmp_path, ending):
    path = tmp_path / f"survey.{ending}"
    WRITERS[ending](path)
    survey = read(path)
    there = survey.vertices[np.lexsort((survey.vertices[:, 0], -survey.vertices[:, 1]))]
    assert np.abs(there[:, :2] - points_of(plane_grid())[:, :2]).max() <= ROUNDING
    assert len(survey.faces) == 2 * (surveys.SHAPE[0] - 1) * (surveys.SHAPE[1] - 1)
    assert survey.facts["size"] == list(surveys.SHAPE)
    np.testing.assert_allclose(survey.facts["spacing_m"], surveys.STEP, rtol=1e-9)


@pytest.mark.parametrize("name", ["x.png", "x.npy"])
def test_a_plane_in_a_grid_without_place_lies_about_the_origin(tmp_path, name):
    z = np.arange(5)[:, None] * 3 + np.arange(7)
    if name == "x.npy":
        np.save(tmp_path / name, z.astype(float))
        survey = read(tmp_path / name, pixel_m=0.5, first_row="north")
    else:
        from PIL import Image

        Image.fromarray(z.astype(np.uint16)).save(tmp_path / name)
        survey = read(tmp_path / name, pixel_m=0.5, height_scale=1.0)
    x, y, height = survey.vertices.T
    np.testing.assert_allclose(height, 2.0 * (x + 1.5) - 6.0 * (y - 1.0), atol=1e-12)
    assert survey.facts["extent_m"] == [-1.5, -1.0, 1.5, 1.0]


@pytest.mark.parametrize("ending", ["tif", "xyz", "laz"])
def test_block_means_of_a_plane_lie_on_it(tmp_path, ending):
    path = tmp_path / f"survey.{ending}"
    WRITERS[ending](path)
    x, y, z = read(path, resolution_m=1.0).vertices.T
    assert np.abs(z - plane(x, y)).max() <= ROUNDING + 0.5e-6 * (ending == "laz")
