"""Textured models render as they are: each texel in its place, decoded, and the scene file's material goes first."""

import base64
import io
import json

import made_meshes
import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual import ColorVisuals, TextureVisuals
from trimesh.visual.material import PBRMaterial

from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene import device
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.geometry.mesh_files import load_mesh
from varos_warp.scene.images import srgb_to_linear

QUADRANTS = np.array([[[200, 40, 10], [20, 180, 60]], [[30, 60, 220], [240, 240, 120]]], np.uint8)
"""Colours of an image's quarters, rows from the top."""
SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
FACES = np.array([[0, 1, 2], [0, 2, 3]])
UV = 0.5 * (SQUARE[:, :2] + 1.0)
LINEAR = srgb_to_linear(QUADRANTS / 255.0)


def image(quadrants=QUADRANTS):
    return Image.fromarray(quadrants.repeat(32, axis=0).repeat(32, axis=1))


def glb(path, uv=UV, faces=FACES, picture=None, **material):
    picture = image() if picture is None else picture
    visual = TextureVisuals(uv=uv, material=PBRMaterial(baseColorTexture=picture, **material))
    trimesh.Trimesh(SQUARE, faces, visual=visual, process=False).export(path)
    return path


def gltf(path):
    """By hand, as section 3.8 of glTF 2.0 has it: the origin of coordinates is the image's top left corner."""
    buffer = io.BytesIO()
    image().save(buffer, "PNG")
    chunks = [
        SQUARE.astype("<f4").tobytes(),
        np.column_stack([UV[:, 0], 1 - UV[:, 1]]).astype("<f4").tobytes(),
        FACES.astype("<u2").tobytes(),
        buffer.getvalue(),
    ]
    starts = np.cumsum([0] + [len(chunk) for chunk in chunks]).tolist()
    accessors = [
        {"bufferView": i, "componentType": code, "count": count, "type": kind}
        for i, (code, count, kind) in enumerate([(5126, 4, "VEC3"), (5126, 4, "VEC2"), (5123, 6, "SCALAR")])
    ]
    accessors[0] |= {"min": SQUARE.min(axis=0).tolist(), "max": SQUARE.max(axis=0).tolist()}
    data = base64.b64encode(b"".join(chunks)).decode()
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        "images": [{"bufferView": 3, "mimeType": "image/png"}],
        "accessors": accessors,
        "bufferViews": [
            {"buffer": 0, "byteOffset": a, "byteLength": len(c)} for a, c in zip(starts[:-1], chunks, strict=True)
        ],
        "buffers": [{"byteLength": starts[-1], "uri": f"data:application/octet-stream;base64,{data}"}],
    }
    path.write_text(json.dumps(document))
    return path


def obj(path):
    image().save(path.with_suffix(".png"))
    path.with_suffix(".mtl").write_text(f"newmtl skin\nKd 1 1 1\nmap_Kd {path.stem}.png\n")
    lines = [f"mtllib {path.stem}.mtl", "usemtl skin"]
    lines += ["v {} {} {}".format(*v) for v in SQUARE] + ["vt {} {}".format(*t) for t in UV]
    path.write_text("\n".join([*lines, "f 1/1 2/2 3/3", "f 1/1 3/3 4/4", ""]))
    return path


def ply(path):
    colours = QUADRANTS[[1, 1, 0, 0], [0, 1, 1, 0]]  # of the square's corners
    mesh = trimesh.Trimesh(SQUARE, FACES, process=False)
    mesh.visual = ColorVisuals(mesh, vertex_colors=colours)
    mesh.export(path)
    return path


def scene_of(path, **block):
    camera = {"resolution": [32, 32], "sensor_mm": [2.0, 2.0], "focal_mm": 2.0}
    return scene_from_dict(
        {
            "objects": [{"file": path.name, "up_axis": "z", **block}],
            "vehicle": {"cameras": [camera]},
            "materials": {"gray": {"reflectance": [0.3, 0.3, 0.3]}},
            "trajectory": {"poses": [{"position": [0, 0, 2]}]},
        },
        path.parent,
    )


DOWN = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 2], [0, 0, 0, 1]])
"""Vehicle 2 m above the square, which fills the image; forward is down, the top of the image is +y."""
DOWN[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
DOWN[:3, 3] = [0, 0, 2]


def seen_from_above(scene, spp=4):
    return FrameRenderer(scene, device="cpu").render(DOWN, outputs="B", spp_b=spp).B.radiance


def centres_of_quarters(picture):
    return picture[8::16, 8::16]


@pytest.mark.parametrize("make", [glb, gltf, obj])
def test_every_texel_of_a_map_is_seen_in_its_place_upright_and_decoded(tmp_path, make):
    path = make(tmp_path / f"square.{make.__name__}")
    seen = centres_of_quarters(seen_from_above(scene_of(path)))
    np.testing.assert_allclose(seen, LINEAR, atol=2e-3)  # 10 bits of blue


def test_a_map_can_be_on_the_terrain_and_on_copies(tmp_path):
    path = glb(tmp_path / "square.glb")
    skin = load_mesh(path).skin
    block = {
        "terrain": {"kind": "file", "file": "square.glb", "up_axis": "z", "scale": 2.0},
        "trajectory": {"poses": [{"position": [0, 0, 2]}]},
        "scatter": [{"object": {"file": "square.glb"}, "count": 1}],
    }
    parts = build_parts(scene_from_dict(block, tmp_path))
    for part in parts:
        np.testing.assert_array_equal(part.skin.pages[0].texels, skin.pages[0].texels)
        np.testing.assert_array_equal(part.skin.corners, skin.corners)


def test_coordinates_outside_of_the_unit_square_repeat_the_map(tmp_path):
    path = glb(tmp_path / "square.glb", uv=2.0 * UV - 1.0)
    seen = seen_from_above(scene_of(path), 16)
    assert seen[4, 4] == pytest.approx(LINEAR[0, 0], abs=2e-3)
    np.testing.assert_allclose(seen[:16, :16], seen[16:, 16:], atol=0.15)
    np.testing.assert_allclose(seen.mean(axis=(0, 1)), LINEAR.mean(axis=(0, 1)), rtol=0.05)


def test_the_materials_factor_multiplies_the_map(tmp_path):
    path = glb(tmp_path / "square.glb", baseColorFactor=[0.5, 1.0, 0.25, 1.0])
    seen = centres_of_quarters(seen_from_above(scene_of(path)))
    np.testing.assert_allclose(seen, LINEAR * [128 / 255, 1.0, 64 / 255], atol=3e-3)


def test_several_maps_keep_their_colours(tmp_path):
    other = QUADRANTS[::-1, ::-1].copy()
    world = trimesh.Scene()
    for i, picture in enumerate((image(), image(other))):
        visual = TextureVisuals(uv=UV, material=PBRMaterial(baseColorTexture=picture))
        half = trimesh.Trimesh(SQUARE * [0.5, 1, 1] + [i - 0.5, 0, 0], FACES, visual=visual, process=False)
        world.add_geometry(half)
    world.export(tmp_path / "two.glb")
    seen = seen_from_above(scene_of(tmp_path / "two.glb"))
    left, right = seen[8::16, [4, 12]], seen[8::16, [20, 28]]
    np.testing.assert_allclose(left, LINEAR, atol=6e-3)
    np.testing.assert_allclose(right, LINEAR[::-1, ::-1], atol=6e-3)


def test_colours_of_vertices_are_interpolated(tmp_path):
    seen = seen_from_above(scene_of(ply(tmp_path / "square.ply")), 64)
    corners = seen[[0, 0, -1, -1], [0, -1, 0, -1]]
    np.testing.assert_allclose(corners, LINEAR.reshape(4, 3), atol=0.05)
    diagonal = 0.5 * (LINEAR[1, 0] + LINEAR[0, 1])  # the edge between the two triangles
    np.testing.assert_allclose(seen[15:17, 15:17].mean(axis=(0, 1)), diagonal, atol=0.02)


def test_a_material_of_the_scene_file_goes_first(tmp_path):
    seen = seen_from_above(scene_of(glb(tmp_path / "square.glb"), material="gray"))
    np.testing.assert_allclose(seen, 0.3, atol=1e-5)


def test_a_mirrored_model_keeps_its_texels_on_their_corners(tmp_path):
    visual = TextureVisuals(uv=UV, material=PBRMaterial(baseColorTexture=image()))
    square = trimesh.Trimesh(SQUARE, FACES, visual=visual, process=False)
    world = trimesh.Scene()
    world.add_geometry(square, transform=np.diag([-1.0, 1, 1, 1]))
    world.export(tmp_path / "mirrored.glb")
    seen = centres_of_quarters(seen_from_above(scene_of(tmp_path / "mirrored.glb")))
    np.testing.assert_allclose(seen, LINEAR[:, ::-1], atol=2e-3)


def test_triangles_without_area_take_their_coordinates_with_them(tmp_path):
    path = glb(tmp_path / "square.glb", faces=np.array([[0, 0, 1], [0, 1, 2], [1, 1, 3], [0, 2, 3]]))
    _, faces, skin, _ = load_mesh(path)
    assert len(faces) == len(skin.corners) == 2
    np.testing.assert_allclose(skin.corners, UV[FACES])
    np.testing.assert_array_equal(load_mesh(path, with_skin=False)[1], faces)


def test_meshes_without_colours_have_no_skin(tmp_path):
    for suffix in ("ply", "obj", "glb", "stl"):
        path = tmp_path / f"plain.{suffix}"
        trimesh.Trimesh(SQUARE, FACES, process=False).export(path)
        assert load_mesh(path)[2] is None


WRAPS = {"repeat": 10497, "clamp": 33071, "mirror": 33648}


@pytest.mark.parametrize("how", list(WRAPS))
def test_kernels_see_what_pages_wraps_factors_and_tints_say(tmp_path, how):
    """Four boards, each with a page, colours or both, against the colours worked out here, away from texels' edges."""
    gltf, texels = made_meshes.Gltf(), np.random.default_rng(4).integers(0, 256, (2, 2, 3))
    colours, sampler = np.random.default_rng(5).random((4, 4)), {"wrapS": WRAPS[how], "wrapT": WRAPS[how]}
    uv = np.array([[-0.8, -1.3], [2.1, -1.3], [2.1, 1.6], [-0.8, 1.6]])
    for k, corner in enumerate([(-1, 1), (1, 1), (-1, -1), (1, -1)]):
        given, places = {}, 0.5 * (made_meshes.BOARD + [*corner, 0])
        if k != 2:
            given["TEXCOORD_0"] = gltf.uv(uv)
        if k in (1, 2):
            given["COLOR_0"] = gltf.accessor(colours)
        factor = {"pbrMetallicRoughness": {"baseColorFactor": [0.9, 0.5, 0.7, 1.0]}}
        material = gltf.textured(made_meshes.picture(np.roll(texels, k, 0)), sampler=sampler, **(factor if k else {}))
        gltf.mesh(places, material=material if k != 2 else gltf.add("materials", factor), attributes=given)
    gltf.save(tmp_path / "four.glb")
    data = scene_of(tmp_path / "four.glb").model_dump(mode="json")
    data["vehicle"]["cameras"][0]["resolution"] = [256, 256]
    seen, mesh = seen_from_above(scene_from_dict(data, tmp_path)), load_mesh(tmp_path / "four.glb", up_axis="z")
    right = 0
    for row, col in np.random.default_rng(6).integers(3, 253, (150, 2)):
        x, y = (col + 0.5) / 128 - 1.0, 1.0 - (row + 0.5) / 128
        if min(abs(x), abs(y)) < 0.02:
            continue
        around = [made_meshes.colour_at(mesh, x + i / 128, y + j / 128) for i in (-2, -1, 0, 1, 2) for j in (-2, 0, 2)]
        if np.ptp(around, axis=0).max() < 0.05:  # no edge between texels
            np.testing.assert_allclose(seen[row, col], around[7], atol=0.02)
            right += 1
    assert right > 60


def test_copies_of_every_size_have_the_colours_of_faces_without_texture(tmp_path, monkeypatch):
    """A mesh with a textured and a plain primitive: its copies, twice as large, are as bright as in one mesh."""
    gltf = made_meshes.Gltf()
    gltf.mesh(0.2 * made_meshes.BOARD, material=gltf.textured(), attributes={"TEXCOORD_0": gltf.uv()})
    plain = {"pbrMetallicRoughness": {"baseColorFactor": [0.1, 0.2, 0.8, 1.0]}}
    gltf.mesh(0.2 * made_meshes.BOARD + [0, 0, 0.1], material=gltf.add("materials", plain))
    gltf.save(tmp_path / "two.glb")
    data = {
        "terrain": {"kind": "procedural", "size_m": 3, "resolution": 3, "relief_m": 0, "position": [0, 0, -0.2]},
        "scatter": [{"object": {"file": "two.glb", "up": "z"}, "count": 3, "scale_range": [2, 2]}],
        "vehicle": {"cameras": [{"resolution": [64, 64], "sensor_mm": [2.0, 2.0], "focal_mm": 2.0}]},
        "trajectory": {"poses": [{"position": [0, 0, 2]}]},
    }
    images = []
    for most in (0, 1 << 20):
        monkeypatch.setitem(device.MOST_JOINED_FACES, "cpu", most)
        images.append(seen_from_above(scene_from_dict(data, tmp_path), 4))
    blue = (images[1][..., 2] > 0.5) & (images[1][..., 0] < 0.2)
    assert np.count_nonzero(blue) > 50
    assert np.mean(np.abs(images[0][blue] - images[1][blue]).max(axis=-1) < 0.01) > 0.98  # but for edges


def test_a_clamped_picture_far_away_does_not_show_its_other_side(tmp_path):
    """Half red, half blue, 40 m away, where one texel covers many of the finest: borders stay red and blue."""
    gltf = made_meshes.Gltf()
    halves = made_meshes.picture(np.array([[[255, 0, 0], [0, 0, 255]]]), side=128)
    uv = 3.0 * made_meshes.UV - 1.0
    material = gltf.textured(halves, sampler={"wrapS": WRAPS["clamp"], "wrapT": WRAPS["clamp"]})
    gltf.mesh(20.0 * made_meshes.BOARD, material=material, attributes={"TEXCOORD_0": gltf.uv(uv)})
    gltf.save(tmp_path / "far.glb")
    data = scene_of(tmp_path / "far.glb").model_dump(mode="json")
    data["vehicle"]["cameras"][0]["resolution"] = [32, 32]
    far = DOWN.copy()
    far[2, 3] = 40.0
    seen = FrameRenderer(scene_from_dict(data, tmp_path), device="cpu").render(far, outputs="B", spp_b=4).B.radiance
    np.testing.assert_allclose(seen[16, 9:13], np.broadcast_to([1.0, 0, 0], (4, 3)), atol=2e-3)
    np.testing.assert_allclose(seen[16, 19:23], np.broadcast_to([0, 0, 1.0], (4, 3)), atol=2e-3)


def test_records_of_pages_and_tints_are_there_once_and_where_they_are_needed(tmp_path):
    """Of many copies the pages are uploaded once, and colours of vertices only for the faces that have them."""
    gltf = made_meshes.Gltf()
    gltf.mesh(material=gltf.textured(), attributes={"TEXCOORD_0": gltf.uv(), "COLOR_0": gltf.accessor(np.ones((4, 3)))})
    gltf.save(tmp_path / "one.glb")
    data = {
        "terrain": {"kind": "procedural", "size_m": 30, "resolution": 33, "relief_m": 0},
        "scatter": [{"object": {"file": "one.glb", "up": "z"}, "count": 20}],
        "trajectory": {"poses": [{"position": [0, 0, 2]}]},
    }
    scene = scene_from_dict(data, tmp_path)
    world = device.DeviceScene(scene, build_parts(scene), "cpu")
    assert world.data.corner_tints.shape[0] == 3 * 2
    assert world.data.face_tint.shape[0] == 2 * 32 * 32 + 2
    assert len(world.textures.by_id) == 1
