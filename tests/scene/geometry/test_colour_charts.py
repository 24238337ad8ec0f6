"""The colour chart: its measures, its patches, and their colours."""

import colour
import numpy as np
import pytest
import trimesh

from varos_warp.errors import InputError
from varos_warp.scene.description.world import ColorChart
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.geometry.assets import boards
from varos_warp.scene.geometry.assets.boards import BLACK
from varos_warp.scene.spectra.spectrum import GRID
from varos_warp.scene.spectra.surfaces import PATCHES, chart_colours, chart_reflectances


def made(**keys):
    vertices, faces, skin = boards.chart(ColorChart(kind="color_chart", **keys))
    return trimesh.Trimesh(vertices, faces, process=False), skin


def patch_at(mesh, skin, x, z):
    """Number of the curve of the front's face at a place."""
    front = np.flatnonzero(mesh.triangles_center[:, 1] == 0.0)
    inside = trimesh.triangles.points_to_barycentric(mesh.triangles[front], np.tile([x, 0.0, z], (len(front), 1)))
    return skin.spectra.of_face[front[(inside >= -1e-9).all(axis=1)][0]]


def test_a_chart_is_a_closed_box_of_its_size():
    mesh, _ = made()
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(0.279 * 0.216 * 0.003, rel=1e-9)
    np.testing.assert_allclose(mesh.bounds, [[-0.1395, 0.0, -0.108], [0.1395, 0.003, 0.108]], atol=1e-12)


def test_patches_are_where_the_chart_has_them_row_by_row_from_the_upper_left():
    mesh, skin = made()
    for number, name in enumerate(PATCHES):
        row, column = divmod(number, 6)
        x, z = (column - 2.5) * 0.046, (1.5 - row) * 0.046
        for dx, dz in ((0.0, 0.001), (0.019, 0.0195), (-0.0195, -0.019)):
            assert patch_at(mesh, skin, x + dx, z + dz) == 1 + number, name
        assert patch_at(mesh, skin, x + 0.0225, z + 0.001) == 0
    assert PATCHES[0] == "dark_skin"
    assert PATCHES[-1] == "black"
    on_patches = skin.spectra.of_face > 0
    assert mesh.area_faces[on_patches].sum() == pytest.approx(24 * 0.04**2)
    assert (mesh.triangles_center[on_patches, 1] == 0.0).all()


def test_faces_have_the_spectra_and_the_colours_of_their_patches():
    _, skin = made()
    found = skin.spectra.at(GRID)
    for number, spectrum in enumerate(chart_reflectances().values(), 1):
        faces = skin.spectra.of_face == number
        np.testing.assert_allclose(found[faces], np.tile(spectrum.at(GRID), (2, 1)), rtol=1e-12)
        rgb = np.clip(chart_colours()[number - 1], 0.0, 1.0)
        np.testing.assert_allclose(skin.corners[faces], np.broadcast_to(rgb, (2, 3, 3)), rtol=1e-6)
    np.testing.assert_array_equal(found[skin.spectra.of_face == 0], BLACK)
    copies = skin.repeated(3).of_faces(np.arange(len(found), 2 * len(found)))
    np.testing.assert_array_equal(copies.spectra.of_face, skin.spectra.of_face)


def test_colours_are_those_that_colour_science_integrates():
    """By the nanometre; ours is by 5 nm, linear between."""
    nm = colour.SpectralShape(380, 780, 1)
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().trim(nm)
    illuminant = colour.SDS_ILLUMINANTS["D65"].copy().align(nm)
    for ours, spectrum in zip(chart_colours(), chart_reflectances().values(), strict=True):
        measured = colour.SpectralDistribution(spectrum.at(nm.wavelengths), nm.wavelengths)
        xyz = colour.sd_to_XYZ(measured, observer, illuminant, method="Integration") / 100.0
        theirs = colour.XYZ_to_RGB(xyz, "sRGB")
        np.testing.assert_allclose(ours, theirs, atol=2e-3)
    assert chart_colours()[PATCHES.index("cyan"), 0] == pytest.approx(-0.033, abs=2e-3)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"patch_m": 0.05}, "6 patches of 0.05 m with gaps of 0.006 m are 0.33 m wide"),
        ({"size_m": [0.3, 0.17]}, "are 0.178 m high"),
        ({"square_m": 0.1}, "square_m"),
        ({"gap_m": 0.0}, "gap_m"),
    ],
)
def test_measures_that_make_no_chart_are_refused_by_key(tmp_path, keys, message):
    with pytest.raises(InputError, match=r"objects\.0") as refused:
        scene_from_dict(
            {"objects": [{"kind": "color_chart", **keys}], "trajectory": {"poses": [{"position": [0, 0, 0]}]}}, tmp_path
        )
    assert message in str(refused.value)
