"""GeoTIFF files are read as GDAL reads them (through rasterio), or refused by name."""

import contextlib
import re
import tracemalloc
import zlib

import imagecodecs
import numpy as np
import pytest
import rasterio
import tifffile
from rasterio.transform import Affine
from surveys import EAST, NORTH, UTM_32, plane_grid, write_geotiff

from varos_warp.errors import InputError
from varos_warp.scene.description.survey import Heights
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.geometry.files.named import mesh_textures
from varos_warp.scene.geometry.survey import crs, geotiff, read_survey
from varos_warp.scene.geometry.survey.content import Request

ROUNDING = 8 * np.spacing(NORTH)


def read(path, **keys):
    return read_survey(Heights(kind="heights", file=str(path), **keys))


def refusal(path, **keys):
    with pytest.raises(InputError) as caught:
        read(path, **keys)
    return caught.value


def raster(path, **keys):
    return geotiff.read_geotiff(Request(path, Heights(kind="heights", file=str(path), **keys), "terrain"))


def by_gdal(path):
    """x, y, height [m] of every pixel by GDAL, [rows, columns, 3], NaN where there is none."""
    with rasterio.open(path) as file:
        z = file.read(1, masked=True).astype(float) * file.scales[0] + file.offsets[0]
        row, column = np.mgrid[: file.height, : file.width]
        a, b, c, d, e, f = file.transform[:6]
        column, row = column + 0.5, row + 0.5
        x, y = a * column + b * row + c, d * column + e * row + f
        return np.dstack([x, y, z.filled(np.nan)])


def ours(path, **keys):
    found = raster(path, **keys)
    row, column = np.mgrid[: found.values.shape[0], : found.values.shape[1]]
    x, y = np.moveaxis(found.T @ np.stack([column, row, np.ones_like(row)]).reshape(3, -1), 0, 0).reshape(2, *row.shape)
    return np.dstack([x, y, found.values])


def asymmetric(dtype=np.float32, holes=True):
    """Heights that no turn or mirror leaves alike, with one missing."""
    z = (np.arange(35).reshape(5, 7) ** 1.5).astype(dtype)
    if holes:
        z[1, 2] = -9999
    return z


def write_by_gdal(path, values, transform=None, crs="EPSG:32632", nodata=-9999, tags=None, **options):
    transform = transform or Affine(0.5, 0, EAST, 0, -0.25, NORTH)
    height, width = values.shape
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        width=width,
        height=height,
        count=1,
        dtype=values.dtype.name,
        crs=crs,
        transform=transform,
        nodata=nodata,
        **options,
    ) as file:
        file.write(values, 1)
        for key, value in (tags or {}).items():
            setattr(file, key, value)
    return path


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"compress": "deflate"},
        {"compress": "deflate", "predictor": 3},
        {"compress": "lzw"},
        {"compress": "lzw", "predictor": 3, "tiled": True, "blockxsize": 16, "blockysize": 16},
        {"compress": "zstd"},
        {"compress": "packbits"},
        {"tiled": True, "blockxsize": 16, "blockysize": 32},
        {"BIGTIFF": "YES"},
        {"blockysize": 1},
        {"ENDIANNESS": "BIG"},
        {"SPARSE_OK": True},
    ],
    ids=str,
)
def test_pixels_are_those_of_gdal_however_they_are_packed(tmp_path, options):
    path = write_by_gdal(tmp_path / "a.tif", asymmetric(), **options)
    np.testing.assert_allclose(ours(path), by_gdal(path), rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("dtype", ["float32", "float64", "int16", "int32", "uint16", "uint32", "int8"])
def test_numbers_of_every_type_are_heights(tmp_path, dtype):
    nodata = {"uint16": 65535, "uint32": 2**32 - 1, "int8": -128}.get(dtype, -9999)
    values = asymmetric(dtype, holes=False)
    if dtype == "int8":
        values = np.arange(35, dtype=np.int8).reshape(5, 7)
    values[1, 2] = nodata
    path = write_by_gdal(tmp_path / "a.tif", values, nodata=nodata)
    keys = {"height_scale": 1.0} if dtype == "int8" else {}
    np.testing.assert_allclose(ours(path, **keys), by_gdal(path), rtol=0, atol=ROUNDING)
    assert np.isnan(ours(path, **keys)[1, 2, 2])


@pytest.mark.parametrize("nodata", [-3.4028234663852886e38, np.nan, -32768.0, 0.0])
def test_what_stands_for_none_is_no_height(tmp_path, nodata):
    values = asymmetric(holes=False) + np.float32(1.0)
    values[1, 2] = nodata
    path = write_by_gdal(tmp_path / "a.tif", values, nodata=nodata)
    assert np.argwhere(np.isnan(ours(path)[..., 2])).tolist() == [[1, 2]]


def test_the_float_that_gdal_writes_with_fewer_digits_stands_for_none(tmp_path):
    values = asymmetric(holes=False)
    values[1, 2] = np.float32(-3.4028235e38)
    path = write_geotiff(tmp_path / "a.tif", values, nodata="-3.40282346638529e+38")
    assert np.argwhere(np.isnan(ours(path)[..., 2])).tolist() == [[1, 2]]


def test_a_mask_inside_the_file_tells_where_there_is_nothing(tmp_path):
    path = tmp_path / "a.tif"
    values = asymmetric(holes=False)
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True):
        with rasterio.open(
            path,
            "w",
            driver="GTiff",
            width=7,
            height=5,
            count=1,
            dtype="float32",
            crs="EPSG:32632",
            transform=Affine(0.5, 0, EAST, 0, -0.5, NORTH),
        ) as file:
            file.write(values, 1)
            mask = np.full(values.shape, 255, np.uint8)
            mask[3, 4] = 0
            file.write_mask(mask)
    assert np.argwhere(np.isnan(by_gdal(path)[..., 2])).tolist() == [[3, 4]]
    np.testing.assert_allclose(ours(path), by_gdal(path), rtol=0, atol=ROUNDING)


def test_overviews_are_passed_over(tmp_path):
    path = write_by_gdal(tmp_path / "a.tif", np.tile(asymmetric(), (20, 20)))
    with rasterio.open(path, "r+") as file:
        file.build_overviews([2, 4])
    with tifffile.TiffFile(path) as file:
        assert len(file.pages) == 3
    np.testing.assert_allclose(ours(path), by_gdal(path), rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("point", [False, True], ids=["area", "point"])
@pytest.mark.parametrize("place", ["scale", "matrix"])
def test_a_tie_point_is_the_corner_of_a_pixel_that_is_an_area_and_the_middle_of_one_that_is_a_point(
    tmp_path, point, place
):
    path = write_geotiff(
        tmp_path / "a.tif",
        asymmetric(),
        corner=(EAST, NORTH),
        step=2.0,
        place=place,
        keys={**UTM_32, 1025: 2 if point else 1},
    )
    shift = 0.0 if point else 1.0
    assert ours(path)[0, 0, :2].tolist() == [EAST + shift, NORTH - shift]
    np.testing.assert_allclose(ours(path)[..., :2], by_gdal(path)[..., :2], rtol=0, atol=ROUNDING)


def test_a_tie_point_may_be_any_pixel(tmp_path):
    tags = [(33550, "d", 3, (2.0, 3.0, 0.0), True), (33922, "d", 6, (4.0, 2.0, 0.0, EAST, NORTH, 0.0), True)]
    path = write_geotiff(tmp_path / "a.tif", asymmetric(), place="none", tags=tags)
    assert ours(path)[2, 4, :2].tolist() == [EAST + 1.0, NORTH - 1.5]
    np.testing.assert_allclose(ours(path)[..., :2], by_gdal(path)[..., :2], rtol=0, atol=ROUNDING)


@pytest.mark.parametrize(
    "transform",
    [
        Affine(0.433, 0.125, EAST, 0.25, -0.2165, NORTH),
        Affine(0.5, 0.1, EAST, 0.0, -0.25, NORTH),
        Affine(0.5, 0, EAST, 0, 0.25, NORTH),
    ],
    ids=["turned", "sheared", "from the south"],
)
def test_grids_lie_as_turned_as_in_gdal_with_faces_up(tmp_path, transform):
    path = write_by_gdal(tmp_path / "a.tif", asymmetric(holes=False), transform)
    np.testing.assert_allclose(ours(path), by_gdal(path), rtol=0, atol=ROUNDING)
    survey = read(path)
    corners = survey.vertices[survey.faces]
    assert (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0.0).all()
    np.testing.assert_allclose(
        sorted(survey.vertices.tolist()), sorted(by_gdal(path).reshape(-1, 3).tolist()), rtol=0, atol=ROUNDING
    )


def test_a_world_file_beside_a_plain_tiff_tells_where_it_lies(tmp_path):
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, asymmetric(), metadata=None)
    (tmp_path / "a.tfw").write_text("0.5\n0.1\n0.2\n-0.25\n400000.25\n6100000.5\n")
    assert ours(path)[0, 0, :2].tolist() == [400000.25, 6100000.5]
    np.testing.assert_allclose(ours(path)[..., :2], by_gdal(path)[..., :2], rtol=0, atol=ROUNDING)


def test_scale_and_offset_of_the_band_make_heights_of_values(tmp_path):
    path = write_by_gdal(
        tmp_path / "a.tif", np.arange(35, dtype=np.int16).reshape(5, 7), tags={"scales": (0.01,), "offsets": (-50.0,)}
    )
    assert by_gdal(path)[0, 3, 2] == pytest.approx(-49.97)
    np.testing.assert_allclose(ours(path), by_gdal(path), rtol=0, atol=ROUNDING)


# --------------------------------------------------------------------------------------------------------------- units


def test_units_of_systems_are_those_of_proj():
    """Every 31st projected and vertical system of the EPSG registry as rasterio's PROJ has it."""
    from rasterio.crs import CRS
    from rasterio.errors import CRSError

    checked = 0
    for code in range(2000, 32768, 31):
        try:
            system = CRS.from_epsg(code)
        except CRSError:
            continue
        if system.is_projected:
            assert crs.unit_of_system(code) == pytest.approx(system.linear_units_factor[1], rel=1e-12), code
            checked += 1
    assert checked > 100
    assert crs.unit_of_system(1999) is None
    assert crs.unit_of_system(32767) is None


@pytest.mark.parametrize("code", crs.DEPTHS[::3])
def test_systems_of_depth_are_those_that_proj_lets_grow_downwards(code):
    from rasterio.crs import CRS

    assert re.search(r"depth|Down", CRS.from_epsg(code).to_wkt(), re.IGNORECASE)


@pytest.mark.parametrize(("crs", "metres"), [("EPSG:32632", 1.0), ("EPSG:2225", 1200 / 3937), ("EPSG:2222", 0.3048)])
def test_coordinates_are_in_the_unit_of_their_system(tmp_path, crs, metres):
    path = write_by_gdal(tmp_path / "a.tif", asymmetric(holes=False), crs=crs)
    with rasterio.open(path) as file:
        assert file.crs.linear_units_factor[1] == pytest.approx(metres)
    survey = read(path, height_unit="m")
    expected = metres * by_gdal(path)[..., 0]
    np.testing.assert_allclose(sorted(survey.vertices[:, 0]), sorted(expected.ravel()), rtol=1e-12)
    assert survey.facts["crs"] == crs


@pytest.mark.parametrize(("vertical", "metres"), [("5703", 1.0), ("6360", 1200 / 3937), ("8228", 0.3048)])
def test_heights_are_in_the_unit_of_their_vertical_system(tmp_path, vertical, metres):
    path = write_by_gdal(tmp_path / "a.tif", asymmetric(holes=False), crs=f"EPSG:2225+{vertical}")
    np.testing.assert_allclose(read(path).facts["heights_m"][1], metres * 34**1.5, rtol=1e-6)


def test_the_unit_that_gdal_writes_for_the_band_is_that_of_the_heights(tmp_path):
    path = write_by_gdal(tmp_path / "a.tif", asymmetric(holes=False), tags={"units": ("ft",)})
    np.testing.assert_allclose(read(path).facts["heights_m"][1], 0.3048 * 34**1.5, rtol=1e-6)


def test_a_key_of_the_scene_has_the_last_word_on_units(tmp_path):
    path = write_geotiff(tmp_path / "a.tif", plane_grid(), keys={1024: 1, 3072: 2225, 3076: 9003, 4099: 9003})
    survey = read(path, unit="m", height_unit="m")
    assert survey.facts["extent_m"][:2] == [EAST, NORTH]
    assert survey.vertices[:, 2].min() == plane_grid().min()


@pytest.mark.parametrize(
    ("keys", "key", "said"),
    [
        ({1024: 1, 3072: 1999}, "terrain.unit", "EPSG:1999"),
        ({1024: 1, 3072: 32632, 3076: 9005}, "terrain.unit", "the unit EPSG:9005"),
        ({1024: 1, 3072: 32767, 1026: "my own plane"}, "terrain.unit", "my own plane"),
        ({1024: 1, 3072: 2225, 3076: 9003}, "terrain.height_unit", "does not say in which its heights"),
        ({**UTM_32, 4096: 4999}, "terrain.height_unit", "EPSG:4999"),
        ({**UTM_32, 4096: 5715, 4099: 9001}, "terrain.positive", "depths"),
        ({**UTM_32, 4097: "LAT depth", 4099: 9001}, "terrain.positive", "depths"),
        ({1024: 2, 2048: 4326}, "terrain.file", "degrees (EPSG:4326)"),
        ({2048: 4258}, "terrain.file", "degrees (EPSG:4258)"),
        ({1024: 3, 2048: 4978}, "terrain.file", "geocentric"),
    ],
)
def test_units_that_are_left_open_are_asked_for(tmp_path, keys, key, said):
    error = refusal(write_geotiff(tmp_path / "a.tif", plane_grid(), keys=keys))
    assert error.key == key
    assert said in error.message
    assert error.remedy


def test_degrees_are_refused_with_the_zone_to_project_to(tmp_path):
    path = write_by_gdal(tmp_path / "a.tif", asymmetric(), Affine(1e-4, 0, 10.39, 0, -1e-4, 63.45), crs="EPSG:4326")
    assert "gdalwarp -t_srs EPSG:32632 a.tif utm.tif" in refusal(path).message
    path = write_by_gdal(tmp_path / "b.tif", asymmetric(), Affine(1e-4, 0, 151.2, 0, -1e-4, -33.8), crs="EPSG:4326")
    assert "EPSG:32756 for UTM zone 56 south" in refusal(path).message


# ------------------------------------------------------------------------------------------------------------ refusals


def test_pictures_several_images_and_lossy_files_are_refused(tmp_path):
    tifffile.imwrite(tmp_path / "rgb.tif", np.zeros((5, 7, 3), np.uint8), photometric="rgb")
    assert "3 bands" in refusal(tmp_path / "rgb.tif", pixel_m=1.0).message
    tifffile.imwrite(tmp_path / "two.tif", np.zeros((2, 5, 7), np.float32), photometric="minisblack", metadata=None)
    assert "holds 2 images" in refusal(tmp_path / "two.tif", pixel_m=1.0).message
    tifffile.imwrite(tmp_path / "complex.tif", np.zeros((5, 7), np.complex64))
    assert "complex64" in refusal(tmp_path / "complex.tif", pixel_m=1.0).message
    write_by_gdal(tmp_path / "jpeg.tif", np.zeros((16, 16), np.uint8), nodata=None, compress="jpeg")
    assert "COMPRESS=DEFLATE" in refusal(tmp_path / "jpeg.tif").remedy


def test_a_plain_tiff_needs_the_distance_of_its_pixels_and_a_georeferenced_one_takes_none(tmp_path):
    tifffile.imwrite(tmp_path / "plain.tif", asymmetric(), metadata=None)
    assert refusal(tmp_path / "plain.tif").key == "terrain.pixel_m"
    assert read(tmp_path / "plain.tif", pixel_m=2.0).facts["extent_m"] == [-6.0, -4.0, 6.0, 4.0]
    path = write_geotiff(tmp_path / "geo.tif", asymmetric())
    assert refusal(path, pixel_m=2.0).key == "terrain.pixel_m"


@pytest.mark.parametrize(
    "tags",
    [
        [(33550, "d", 3, (0.0, 0.5, 0.0), True), (33922, "d", 6, (0.0, 0.0, 0.0, EAST, NORTH, 0.0), True)],
        [(33550, "d", 3, (0.5, -0.5, 0.0), True), (33922, "d", 6, (0.0, 0.0, 0.0, EAST, NORTH, 0.0), True)],
        [(33550, "d", 3, (np.nan, 0.5, 0.0), True), (33922, "d", 6, (0.0, 0.0, 0.0, EAST, NORTH, 0.0), True)],
        [(33550, "d", 3, (0.5, 0.5, 0.1), True), (33922, "d", 6, (0.0, 0.0, 0.0, EAST, NORTH, 0.0), True)],
        [(33922, "d", 18, (0.0, 0.0, 0.0, EAST, NORTH, 0.0) * 3, True)],
        [(34264, "d", 16, (0.0,) * 16, True)],
    ],
)
def test_places_that_are_none_are_refused(tmp_path, tags):
    error = refusal(write_geotiff(tmp_path / "a.tif", asymmetric(), place="none", tags=tags))
    assert error.key == "terrain.file"


def test_a_file_that_ends_too_early_is_refused(tmp_path):
    path = write_geotiff(tmp_path / "a.tif", np.zeros((100, 100)), keys=UTM_32)
    path.write_bytes(path.read_bytes()[:-20_000])
    assert "copy" in refusal(path).remedy


@pytest.mark.parametrize(("installed", "said"), [(True, "cannot be read as a TIFF"), (False, "more than its size")])
def test_a_block_that_unpacks_to_more_than_its_size_is_refused(tmp_path, monkeypatch, installed, said):
    """Imagecodecs keeps to the size itself; without it blocks are looked at before they are unpacked."""
    if not installed:
        monkeypatch.setattr(geotiff, "find_spec", lambda name: None)
    path = write_geotiff(tmp_path / "a.tif", np.random.default_rng(1).random((100, 100)), compression="deflate")
    with tifffile.TiffFile(path) as file:
        place, count = file.pages[0].dataoffsets[0], file.pages[0].databytecounts[0]
    bomb = zlib.compress(bytes(50_000_000))
    data = bytearray(path.read_bytes())
    data[place : place + count] = bomb[:count].ljust(count, b"\0")
    path.write_bytes(data)
    tracemalloc.start()
    assert said in refusal(path).message
    assert tracemalloc.get_traced_memory()[1] < 20_000_000
    tracemalloc.stop()


@pytest.mark.parametrize("compression", ["lzw", "zstd"])
def test_blocks_of_other_kinds_that_unpack_to_more_than_their_size_take_no_more_memory(tmp_path, compression):
    path = write_geotiff(tmp_path / "a.tif", np.random.default_rng(1).random((100, 100)), compression=compression)
    with tifffile.TiffFile(path) as file:
        place, count = file.pages[0].dataoffsets[0], file.pages[0].databytecounts[0]
    bomb = getattr(imagecodecs, f"{compression}_encode")(bytes(30_000_000))
    data = bytearray(path.read_bytes())
    data[place : place + count] = bomb[:count].ljust(count, b"\0")
    path.write_bytes(data)
    tracemalloc.start()
    with contextlib.suppress(InputError):
        read(path, region=[EAST, NORTH, EAST + 2, NORTH + 2])
    assert tracemalloc.get_traced_memory()[1] < 20_000_000
    tracemalloc.stop()


def test_more_pixels_than_the_limit_are_refused(tmp_path, monkeypatch):
    monkeypatch.setenv("VAROS_WARP_MAX_HEIGHTS", "34")
    assert "VAROS_WARP_MAX_HEIGHTS=35" in refusal(write_geotiff(tmp_path / "a.tif", asymmetric())).message


def test_without_imagecodecs_the_message_names_what_to_install(tmp_path, monkeypatch):
    path = write_by_gdal(tmp_path / "a.tif", asymmetric(), compress="lzw")

    def missing(*_, **__):
        raise ValueError("<COMPRESSION.LZW: 5> requires the 'imagecodecs' package")

    monkeypatch.setattr(tifffile.TiffPage, "asarray", missing)
    assert 'pip install "varos_warp[survey]"' in refusal(path).remedy


def test_what_gdal_wrote_beside_the_file_is_warned_of_unless_it_is_statistics(tmp_path):
    path = write_geotiff(tmp_path / "a.tif", asymmetric(holes=False))
    beside = tmp_path / "a.tif.aux.xml"
    beside.write_text(
        '<PAMDataset><PAMRasterBand band="1"><Metadata><MDI key="STATISTICS_MEAN">1</MDI></Metadata>'
        "</PAMRasterBand></PAMDataset>"
    )
    assert read(path).warnings == []
    beside.write_text('<PAMDataset><PAMRasterBand band="1"><NoDataValue>0</NoDataValue></PAMRasterBand></PAMDataset>')
    assert "NoDataValue, which is not read" in read(path).warnings[0]


@pytest.mark.parametrize("name", ["a.tif", "a.TIF", "a.tiff"])
def test_a_mask_beside_the_file_tells_where_there_is_nothing(tmp_path, name):
    path = tmp_path / name
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=False):
        with rasterio.open(
            path,
            "w",
            driver="GTiff",
            width=7,
            height=5,
            count=1,
            dtype="float32",
            crs="EPSG:32632",
            transform=Affine(0.5, 0, EAST, 0, -0.5, NORTH),
        ) as file:
            file.write(asymmetric(holes=False), 1)
            mask = np.full((5, 7), 255, np.uint8)
            mask[3, 4] = 0
            file.write_mask(mask)
    assert (tmp_path / f"{name}.msk").is_file()
    assert np.argwhere(np.isnan(by_gdal(path)[..., 2])).tolist() == [[3, 4]]
    np.testing.assert_allclose(ours(path), by_gdal(path), rtol=0, atol=ROUNDING)
    course = {"poses": [{"position": [0, 0, 0]}]}
    scene = scene_from_dict({"terrain": {"file": name}, "trajectory": course}, tmp_path)
    assert tmp_path / f"{name}.msk" in mesh_textures(scene)


def test_a_mask_of_another_size_beside_the_file_is_refused(tmp_path):
    path = write_by_gdal(tmp_path / "a.tif", asymmetric())
    tifffile.imwrite(tmp_path / "a.tif.msk", np.zeros((4, 7), np.uint8), metadata=None)
    assert "a.tif.msk: terrain.file: is a mask of another size" in refusal(path).message
    (tmp_path / "a.tif.msk").write_bytes(b"no mask")
    assert "a.tif.msk: terrain.file: cannot be read as a TIFF" in refusal(path).message


@pytest.mark.parametrize("crs", ["EPSG:3857", "EPSG:3395", "ESRI:102100"])
def test_mercator_is_refused_with_the_factor_by_which_it_is_wrong(tmp_path, crs):
    """At 60 degrees the cosine is a half; y = R arsinh(tan(60 degrees))."""
    y = 6378137.0 * np.arcsinh(np.sqrt(3.0))
    path = write_by_gdal(tmp_path / "a.tif", asymmetric(), Affine(1, 0, 1.1e6, 0, -1, y), crs=crs)
    error = refusal(path)
    assert "2 times too long at its latitude of 60.0 degrees" in error.message
    assert "EPSG:32632" in error.remedy


@pytest.mark.parametrize(
    ("step", "keys", "told"),
    [(100, {}, True), (100, {"height_scale": 1}, False), (100, {"height_scale": 0.01}, False), (0.2, {}, False)],
)
def test_whole_numbers_that_look_like_centimetres_are_told_of(tmp_path, step, keys, told):
    """Heights that fall by 34 steps over the 3 m of the grid."""
    path = write_by_gdal(tmp_path / "a.tif", -(step * np.arange(35).reshape(5, 7)).astype(np.int16) - 1)
    found = [words for words in read(path, **keys).warnings if "height_scale: 0.01" in words]
    assert len(found) == told
