"""Cases of colour."""

import math
import re

import numpy as np
import trimesh
from made_meshes import (
    BOARD,
    BOUND,
    QUARTERS,
    SAMPLER,
    TWO,
    UV,
    VERTEX,
    Gltf,
    colour_at,
    dae,
    dae_effect,
    dae_places,
    dae_source,
    picture,
    ply,
    rows,
)

from mesh_cases.geometry import upright
from mesh_cases.table import (
    QUAD,
    RING,
    VT,
    XYZ,
    V,
    case,
    dae_file,
    is_colour,
    is_grey,
    is_quarters,
    obj,
    off,
    ply_file,
    repeats_twice,
)
from varos_warp.scene.images import srgb_to_linear

# ------------------------------------------------------------------------------------------------------------- colours


def dae_board(folder, diffuse, params="", extra="", uv=UV, bind="", colours=None, second=None):
    """A board with a material, coordinates and perhaps colours."""
    inputs, geometry, index = VERTEX, dae_places(), [[0, 1, 2, 0, 2, 3]]
    for semantic, name, values, letters, number in (
        ("TEXCOORD", "t", uv, "ST", 0),
        ("TEXCOORD", "w", second, "ST", 1),
        ("COLOR", "c", colours, "RGB", 0),
    ):
        if values is not None:
            geometry = dae_source(name, values, letters) + geometry
            inputs += f'<input semantic="{semantic}" source="#{name}" offset="{len(index)}" set="{number}"/>'
            index.append(index[0])
    p = " ".join(map(str, np.array(index).T.ravel()))
    geometry += f'<triangles material="x" count="2">{inputs}<p>{p}</p></triangles>'
    return dae_file(folder, dae(geometry, before=dae_effect(diffuse, params, extra), materials=BOUND.format(bind)))


TEXTURE = '<texture texture="a" texcoord="U"/>'


@case("one colour for a material", "glTF", "OBJ", "DAE")
def plain(folder, kind):
    if kind == "glTF":
        gltf = Gltf()
        gltf.mesh(material=gltf.add("materials", {"pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.1, 0.2, 1]}}))
        return gltf.save(folder / "m.glb"), is_colour([0.8, 0.1, 0.2])
    if kind == "OBJ":
        return obj(folder, V + "usemtl a\nf 1 2 3 4\n", "newmtl a\nKd 0.8 0.1 0.2\n"), is_colour([0.8, 0.1, 0.2])
    return dae_board(folder, "<color>0.8 0.1 0.2 1</color>"), is_colour([0.8, 0.1, 0.2])


@case("one colour for a material", "OBJ")
def some_with_a_map(folder):
    text = V + VT + "v 3 -1 0\nv 5 -1 0\nv 5 1 0\nusemtl a\n" + QUAD + "usemtl b\nf 5/1 6/2 7/3\n"
    return obj(folder, text, "newmtl a\nmap_Kd q.png\nnewmtl b\nKd 0 0.8 0\n"), lambda mesh: (
        is_quarters(mesh),
        is_colour([0, 0.8, 0], 4.5, 0.0)(mesh),
    )


@case("one colour for a material", "glTF")
def specular_glossiness(folder):
    gltf = Gltf().uses("KHR_materials_pbrSpecularGlossiness")
    gltf.mesh(
        material=gltf.add(
            "materials",
            {"extensions": {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [0.25, 0.5, 1.0, 1.0]}}},
        )
    )
    return gltf.save(folder / "m.glb"), is_colour([0.25, 0.5, 1.0])


@case("one colour for a material", "glTF")
def white_by_default(folder):
    gltf = Gltf()
    gltf.mesh(material=gltf.add("materials", {}))
    return gltf.save(folder / "m.glb"), is_colour([1.0, 1.0, 1.0])


def textured(folder, kind, *, data=None, uv=UV, name="q.png"):
    """The board with a picture on it."""
    data = picture() if data is None else data
    if kind == "glTF":
        gltf = Gltf()
        gltf.mesh(material=gltf.textured(data), attributes={"TEXCOORD_0": gltf.uv(uv)})
        return gltf.save(folder / "m.glb")
    if kind == "OBJ":
        vt = "".join(f"vt {u} {v}\n" for u, v in uv)
        path = obj(folder, V + vt + "usemtl a\n" + QUAD, f"newmtl a\nmap_Kd {name}\n")
    elif kind == "PLY":
        path = ply_file(
            folder,
            ply(
                f"{XYZ},float s,float t",
                rows(np.column_stack([BOARD, uv])),
                RING,
                "4 0 1 2 3",
                comments=f"comment TextureFile {name}\n",
            ),
        )
    else:
        path = dae_board(folder, TEXTURE, SAMPLER.format(""), uv=np.asarray(uv))
        path.write_text(path.read_text().replace("q.png", name))
    (folder / name).write_bytes(data)
    return path


@case("a texture", "glTF", "OBJ", "PLY", "DAE")
def texture(folder, kind):
    return textured(folder, kind), is_quarters


@case("a texture", "PLY")
def texture_of_faces(folder):
    text = ply(
        XYZ,
        rows(BOARD),
        f"{RING},list uchar float texcoord,int texnumber",
        "4 0 1 2 3 8 0 0 1 0 1 1 0 1 1",
        comments="comment TextureFile a.png\ncomment TextureFile my q.png\n",
    )
    (folder / "my q.png").write_bytes(picture())
    return ply_file(folder, text), is_quarters


@case("a texture", "glTF")
def texture_beside(folder):
    gltf = Gltf(
        images=[{"uri": "my%20q.png"}],
        textures=[{"source": 0}],
        materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
    )
    gltf.mesh(material=0, attributes={"TEXCOORD_0": gltf.uv()})
    (folder / "my q.png").write_bytes(picture())
    return gltf.save(folder / "m.glb"), is_quarters


@case("a texture and a factor", "glTF", "OBJ")
def factor(folder, kind):
    expected = is_colour([0.0, 0.5, 0.0], 0.5, 0.5)
    if kind == "OBJ":
        return obj(folder, V + VT + "usemtl a\n" + QUAD, "newmtl a\nKd 1 0.5 0.25\nmap_Kd q.png\n"), expected
    gltf = Gltf()
    gltf.mesh(
        material=gltf.textured(pbrMetallicRoughness={"baseColorFactor": [1, 0.5, 0.25, 1]}),
        attributes={"TEXCOORD_0": gltf.uv()},
    )
    gltf.mesh(
        BOARD + [3, 0, 0],
        material=gltf.textured(pbrMetallicRoughness={"baseColorFactor": [1, 1, 1, 1]}),
        attributes={"TEXCOORD_0": gltf.uv()},
    )
    return gltf.save(folder / "m.glb"), lambda mesh: (expected(mesh), is_colour([0.0, 1.0, 0.0], 3.5, 0.5)(mesh))


@case("several textures that repeat", "glTF", "OBJ", "PLY", "DAE")
def several(folder, kind):
    grey = picture(np.full((1, 1, 3), 188))
    (folder / "g.png").write_bytes(grey)
    both = np.concatenate([BOARD, BOARD + [3, 0, 0]])

    def look(mesh):
        repeats_twice(mesh)
        is_colour([srgb_to_linear(188 / 255.0)] * 3, 3.3, 0.1)(mesh)

    if kind == "glTF":
        gltf = Gltf()
        gltf.mesh(material=gltf.textured(), attributes={"TEXCOORD_0": gltf.uv(2 * UV)})
        gltf.mesh(BOARD + [3, 0, 0], material=gltf.textured(grey), attributes={"TEXCOORD_0": gltf.uv(2 * UV)})
        return gltf.save(folder / "m.glb"), look
    if kind == "OBJ":
        text = "".join(f"v {x} {y} {z}\n" for x, y, z in both) + "".join(f"vt {u} {v}\n" for u, v in 2 * UV)
        text += "usemtl a\nf 1/1 2/2 3/3 4/4\nusemtl b\nf 5/1 6/2 7/3 8/4\n"
        return obj(folder, text, "newmtl a\nmap_Kd q.png\nnewmtl b\nmap_Kd g.png\n"), look
    if kind == "PLY":
        (folder / "q.png").write_bytes(picture())
        text = ply(
            XYZ,
            rows(both),
            f"{RING},list uchar float texcoord,uchar texnumber",
            "4 0 1 2 3 8 0 0 2 0 2 2 0 2 0\n4 4 5 6 7 8 0 0 2 0 2 2 0 2 1",
            comments="comment TextureFile q.png\ncomment TextureFile g.png\n",
        )
        return ply_file(folder, text), look
    path = dae_board(folder, TEXTURE, SAMPLER.format(""), uv=2 * UV)
    text, second = path.read_text(), dae_effect(TEXTURE, SAMPLER.format("")).replace("q.png", "g.png")
    for name in ("i", "e", "m"):
        second = second.replace(f'id="{name}"', f'id="{name}2"').replace(f'"#{name}"', f'"#{name}2"')
    second = second.replace("<init_from>i<", "<init_from>i2<")
    geometry = re.search(r"<geometry .*</geometry>", text, re.S)[0].replace('id="g"', 'id="h"')
    for name in ("p", "pa", "t", "ta", "v"):
        geometry = geometry.replace(f'id="{name}"', f'id="{name}2"').replace(f'"#{name}"', f'"#{name}2"')
    node = (
        '<node id="o"><translate>3 0 0</translate><instance_geometry url="#h">'
        + BOUND.format("").replace("#m", "#m2")
        + "</instance_geometry></node></visual_scene>"
    )
    text = text.replace("<library_geometries>", second + "<library_geometries>").replace("</visual_scene>", node)
    return dae_file(folder, text.replace("</library_geometries>", geometry + "</library_geometries>")), look


@case("coordinates moved, scaled, turned", "glTF", "OBJ")
def transformed(folder, kind):
    if kind == "OBJ":
        text = V + VT + "usemtl a\n" + QUAD
        return obj(folder, text, "newmtl a\nmap_Kd -s 2 2 1 -o 1 -3 0 q.png\n"), repeats_twice
    gltf = Gltf().uses("KHR_texture_transform")
    info = {"extensions": {"KHR_texture_transform": {"scale": [2, 2], "offset": [3, -1]}}}
    gltf.mesh(material=gltf.textured(info=info), attributes={"TEXCOORD_0": gltf.uv()})
    return gltf.save(folder / "m.glb"), repeats_twice


@case("coordinates moved, scaled, turned", "glTF")
def turned(folder):
    """By a quarter: where u, v (v down) were 0.25, 0.25 they are 0.25, 0.75 after the offset (issue 1563 of glTF)."""
    gltf = Gltf().uses("KHR_texture_transform")
    info = {"extensions": {"KHR_texture_transform": {"rotation": math.pi / 2, "offset": [0, 1], "texCoord": 1}}}
    gltf.mesh(material=gltf.textured(info=info), attributes={"TEXCOORD_0": gltf.uv(0 * UV), "TEXCOORD_1": gltf.uv()})
    return gltf.save(folder / "m.glb"), lambda mesh: (
        is_colour([0, 0, 1.0], -0.5, 0.5)(mesh),
        is_colour([1.0, 0, 0], 0.5, 0.5)(mesh),
    )


@case("a second set of coordinates", "glTF", "DAE")
def second_set(folder, kind):
    if kind == "DAE":
        bind = '<bind_vertex_input semantic="U" input_semantic="TEXCOORD" input_set="1"/>'
        return dae_board(folder, TEXTURE, SAMPLER.format(""), uv=0 * UV, second=UV, bind=bind), is_quarters
    gltf = Gltf()
    gltf.mesh(
        material=gltf.textured(info={"texCoord": 1}),
        attributes={"TEXCOORD_0": gltf.uv(0 * UV), "TEXCOORD_1": gltf.uv()},
    )
    return gltf.save(folder / "m.glb"), is_quarters


@case("textures that clamp or mirror", "glTF", "OBJ", "DAE")
def clamps(folder, kind):
    clamped = 4.0 * UV - 1.5  # the picture fills the middle 1/16 of the board
    if kind == "OBJ":
        vt = "".join(f"vt {u} {v}\n" for u, v in clamped)
        return obj(folder, V + vt + "usemtl a\n" + QUAD, "newmtl a\nmap_Kd -clamp on q.png\n"), is_quarters
    if kind == "DAE":
        return dae_board(
            folder, TEXTURE, SAMPLER.format("<wrap_s>CLAMP</wrap_s><wrap_t>CLAMP</wrap_t>"), uv=clamped
        ), is_quarters
    gltf = Gltf()
    gltf.mesh(
        material=gltf.textured(sampler={"wrapS": 33648, "wrapT": 33071}),
        attributes={"TEXCOORD_0": gltf.uv(np.column_stack([2 * UV[:, 0], clamped[:, 1]]))},
    )

    def look(mesh):  # mirrored along u: red, green, green, red
        for x, expected in ((-0.75, [1, 0, 0]), (-0.25, [0, 1, 0]), (0.25, [0, 1, 0]), (0.75, [1, 0, 0])):
            is_colour(expected, x, 0.5)(mesh)

    return gltf.save(folder / "m.glb"), look


@case("UDIM tiles", "OBJ")
def udim(folder):
    for number, colour in ((1001, [255, 0, 0]), (1002, [0, 255, 0]), (1011, [0, 0, 255])):
        (folder / f"t.{number}.png").write_bytes(picture(np.full((1, 1, 3), colour)))
    places = np.concatenate([BOARD, BOARD + [3, 0, 0], BOARD + [6, 0, 0]])
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in places)
    text += "".join(f"vt {u} {v}\n" for u, v in np.concatenate([UV, UV + [1, 0], UV + [0, 1]]))
    text += "usemtl a\n" + "".join(
        "f " + " ".join(f"{4 * k + i}/{4 * k + i}" for i in range(1, 5)) + "\n" for k in range(3)
    )
    return obj(folder, text, "newmtl a\nmap_Kd t.<UDIM>.png\n"), lambda mesh: (
        is_colour([1, 0, 0])(mesh),
        is_colour([0, 1, 0], 3.1)(mesh),
        is_colour([0, 0, 1], 6.1)(mesh),
    )


HALF = np.tile([0.5, 0.25, 0.0], (4, 1))
SHADES = np.array([188, 137, 0]) / 255.0


@case("colours of vertices, 8 bits", "glTF", "PLY", "OFF")
def bytes_of_vertices(folder, kind):
    expected = srgb_to_linear(SHADES)
    if kind == "OFF":
        return off(folder, BOARD, [[0, 1, 2, 3]], "COFF", " 188 137 0 255"), is_colour(expected)
    if kind == "PLY":
        return ply_file(
            folder,
            ply(
                f"{XYZ},uchar red,uchar green,uchar blue",
                rows(np.column_stack([BOARD, np.tile([188, 137, 0], (4, 1))]).astype(object)),
                RING,
                "4 0 1 2 3",
            ).replace("188.0 137.0 0.0", "188 137 0"),
        ), is_colour(expected)
    gltf = Gltf()  # linear, whatever the type
    gltf.mesh(attributes={"COLOR_0": gltf.accessor(np.tile([128, 64, 0, 255], (4, 1)), "u1", normalized=True)})
    return gltf.save(folder / "m.glb"), is_colour(np.array([128, 64, 0]) / 255.0)


@case("colours of vertices, 16 bits", "glTF", "PLY")
def words_of_vertices(folder, kind):
    if kind == "PLY":
        row = np.rint(65535 * SHADES).astype(int)
        text = ply(
            f"{XYZ},ushort diffuse_red,ushort diffuse_green,ushort diffuse_blue",
            "\n".join(f"{x} {y} {z} {row[0]} {row[1]} {row[2]}" for x, y, z in BOARD),
            RING,
            "4 0 1 2 3",
        )
        return ply_file(folder, text), lambda mesh: np.testing.assert_allclose(
            colour_at(mesh, 0.3, 0.1), srgb_to_linear(SHADES), atol=2e-5
        )
    gltf = Gltf()
    gltf.mesh(attributes={"COLOR_0": gltf.accessor(np.rint(65535 * HALF), "u2", normalized=True)})
    return gltf.save(folder / "m.glb"), lambda mesh: np.testing.assert_allclose(
        colour_at(mesh, 0.3, 0.1), HALF[0], atol=2e-5
    )


@case("colours of vertices, real numbers", "glTF", "OBJ", "PLY", "DAE", "OFF")
def reals_of_vertices(folder, kind):
    linear = is_colour(HALF[0])
    if kind == "glTF":
        gltf = Gltf()
        gltf.mesh(
            material=gltf.add("materials", {"pbrMetallicRoughness": {"baseColorFactor": [1, 0.5, 1, 1]}}),
            attributes={"COLOR_0": gltf.accessor(HALF)},
        )
        return gltf.save(folder / "m.glb"), is_colour([0.5, 0.125, 0.0])
    if kind == "OBJ":  # as MeshLab and Meshroom write bytes of sRGB
        text = "".join(f"v {x} {y} {z} {SHADES[0]!r} {SHADES[1]!r} 0\n" for x, y, z in BOARD).replace("np.float64(", "")
        return obj(folder, text.replace(")", "") + "f 1 2 3 4\n", image=False), is_colour(srgb_to_linear(SHADES))
    if kind == "PLY":
        return ply_file(
            folder, ply(f"{XYZ},float r,float g,float b", rows(np.column_stack([BOARD, HALF])), RING, "4 0 1 2 3")
        ), linear
    if kind == "DAE":
        return dae_board(folder, "<color>1 1 1 1</color>", uv=None, colours=HALF), linear
    return off(folder, BOARD, [[0, 1, 2, 3]], "COFF", " 0.5 0.25 0.0 1.0"), linear


@case("colours of faces", "PLY", "STL", "OFF")
def of_faces(folder, kind):
    both, quads = np.concatenate([BOARD, BOARD + [3, 0, 0]]), [[0, 1, 2, 3], [4, 5, 6, 7]]
    if kind == "STL":
        path = folder / "m.stl"
        trimesh.Trimesh(BOARD, TWO, process=False).export(path)
        data = bytearray(path.read_bytes())
        data[84 + 48 : 84 + 50] = b"\xff\xff"
        path.write_bytes(data)
        return path, upright(4.0)
    if kind == "OFF":
        path = off(folder, both, quads)
        path.write_text(
            path.read_text().replace("4 0 1 2 3", "4 0 1 2 3 255 0 0").replace("4 4 5 6 7", "4 4 5 6 7 0 255 0")
        )
    else:
        path = ply_file(
            folder,
            ply(XYZ, rows(both), f"{RING},uchar red,uchar green,uchar blue", "4 0 1 2 3 255 0 0\n4 4 5 6 7 0 255 0"),
        )
    return path, lambda mesh: (is_colour([1, 0, 0])(mesh), is_colour([0, 1, 0], 3.1)(mesh), upright(8.0)(mesh))


@case("colours of vertices on a texture", "glTF", "OBJ", "PLY", "DAE")
def tinted(folder, kind):
    """Only glTF says that they multiply; elsewhere the texture is seen."""
    if kind == "glTF":
        gltf = Gltf()
        gltf.mesh(material=gltf.textured(), attributes={"COLOR_0": gltf.accessor(HALF), "TEXCOORD_0": gltf.uv()})
        return gltf.save(folder / "m.glb"), is_colour([0.0, 0.25, 0.0], 0.5, 0.5)
    if kind == "OBJ":
        text = "".join(f"v {x} {y} {z} 0.5 0.25 0\n" for x, y, z in BOARD) + VT + "usemtl a\n" + QUAD
        return obj(folder, text, "newmtl a\nmap_Kd q.png\n"), is_quarters
    if kind == "PLY":
        (folder / "q.png").write_bytes(picture())
        return ply_file(
            folder,
            ply(
                f"{XYZ},float s,float t,float red,float green,float blue",
                rows(np.column_stack([BOARD, UV, HALF])),
                RING,
                "4 0 1 2 3",
                comments="comment TextureFile q.png\n",
            ),
        ), is_quarters
    return dae_board(folder, TEXTURE, SAMPLER.format(""), colours=HALF), is_quarters


@case("colours of vertices and one of the material", "glTF", "OBJ", "DAE")
def coloured_twice(folder, kind):
    """Only glTF says that they multiply; elsewhere those of the vertices are seen."""
    if kind == "glTF":
        gltf = Gltf()
        material = gltf.add("materials", {"pbrMetallicRoughness": {"baseColorFactor": [0.5, 1, 1, 1]}})
        gltf.mesh(material=material, attributes={"COLOR_0": gltf.accessor(HALF)})
        return gltf.save(folder / "m.glb"), is_colour([0.25, 0.25, 0.0])
    if kind == "OBJ":
        text = "".join(f"v {x} {y} {z} 1 0 0\n" for x, y, z in BOARD) + "usemtl a\nf 1 2 3 4\n"
        return obj(folder, text, "newmtl a\nKd 0.5 0.5 0.5\n", image=False), is_colour([1, 0, 0])
    return dae_board(folder, "<color>0.5 1 1 1</color>", uv=None, colours=HALF), is_colour(HALF[0])


def masked_picture():
    """QUARTERS whose red quarter is transparent."""
    alpha = np.full((2, 2, 1), 255)
    alpha[0, 0] = 0
    return np.concatenate([QUARTERS, alpha], axis=2)


@case("masks", "glTF", "OBJ")
def masks(folder, kind):
    def look(mesh):
        assert mesh.skin.has_holes
        assert mesh.skin.pages[0].alpha[4, 4] == 0
        assert mesh.skin.pages[0].alpha[-4, 4] == 255
        is_colour([0.0, 1.0, 0.0], 0.5, 0.5)(mesh)

    if kind == "OBJ":
        (folder / "d.png").write_bytes(picture(np.array([[[0] * 3, [255] * 3], [[255] * 3, [255] * 3]])))
        return obj(folder, V + VT + "usemtl a\n" + QUAD, "newmtl a\nmap_Kd q.png\nmap_d d.png\n"), look
    gltf = Gltf()
    gltf.mesh(material=gltf.textured(picture(masked_picture()), alphaMode="MASK"), attributes={"TEXCOORD_0": gltf.uv()})
    return gltf.save(folder / "m.glb"), look


@case("masks", "glTF")
def mask_by_factor(folder):
    """Nothing is left of a mesh whose alpha is below the cutoff, and all of one whose alpha is not."""
    gltf = Gltf()
    for k, alpha in enumerate((0.4, 0.6)):
        gltf.mesh(
            BOARD + [3 * k, 0, 0],
            material=gltf.add(
                "materials", {"alphaMode": "MASK", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, alpha]}}
            ),
        )
    return gltf.save(folder / "m.glb"), lambda mesh: (upright(4.0)(mesh), is_colour([1, 1, 1], 3.1)(mesh))


@case("transparency", "glTF", "OBJ", "DAE")
def transparency(folder, kind):
    if kind == "glTF":
        gltf = Gltf()
        gltf.mesh(material=gltf.add("materials", {"alphaMode": "BLEND"}))
        return gltf.save(folder / "m.glb"), upright(4.0)
    if kind == "OBJ":
        return obj(folder, V + "usemtl a\nf 1 2 3 4\n", "newmtl a\nKd 1 1 1\nd 0.5\n"), upright(4.0)
    return dae_board(
        folder, "<color>1 1 1 1</color>", extra="<transparency><float>0.5</float></transparency>"
    ), upright(4.0)


@case("metal, bumps, emission", "glTF", "OBJ", "DAE", says="not modelled")
def not_modelled(folder, kind):
    if kind == "DAE":
        glow = "<emission><color>1 0 0 1</color></emission>"
        return dae_board(folder, "<color>1 1 1 1</color>", extra=glow), upright(4.0)
    if kind == "OBJ":
        return obj(folder, V + "usemtl a\nf 1 2 3 4\n", "newmtl a\nKd 1 1 1\nmap_Bump q.png\nnorm q.png\n"), upright(
            4.0
        )
    gltf = Gltf()
    gltf.mesh(
        material=gltf.add(
            "materials",
            {
                "pbrMetallicRoughness": {"metallicFactor": 1.0},
                "normalTexture": {"index": 0},
                "emissiveTexture": {"index": 0},
            },
        )
    )
    return gltf.save(folder / "m.glb"), upright(4.0)


@case("several material libraries", "OBJ")
def libraries(folder):
    (folder / "my b.mtl").write_text("newmtl b\nKd 0 1 0\n")
    (folder / "c.mtl").write_text("newmtl c\nKd 0 0 1\n")
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in np.concatenate([BOARD, BOARD + [3, 0, 0], BOARD + [6, 0, 0]]))
    text = (
        "mtllib my b.mtl\n"
        + text
        + "usemtl a\nf 1 2 3 4\nusemtl b\nf 5 6 7 8\nmtllib x.mtl c.mtl\nusemtl c\nf 9 10 11 12\n"
    )
    (folder / "x.mtl").write_text("")
    return obj(folder, text, "newmtl a\nKd 1 0 0\n"), lambda mesh: (
        is_colour([1, 0, 0])(mesh),
        is_colour([0, 1, 0], 3.1)(mesh),
        is_colour([0, 0, 1], 6.1)(mesh),
    )


@case("coordinates without a texture", "glTF", "OBJ", "PLY", "DAE")
def bare_uv(folder, kind):
    if kind == "glTF":
        gltf = Gltf()
        gltf.mesh(attributes={"TEXCOORD_0": gltf.uv()})
        return gltf.save(folder / "m.glb"), is_grey
    if kind == "OBJ":
        return obj(folder, V + VT + QUAD, image=False), is_grey
    if kind == "PLY":
        return ply_file(
            folder, ply(f"{XYZ},float s,float t", rows(np.column_stack([BOARD, UV])), RING, "4 0 1 2 3")
        ), is_grey
    return dae_board(folder, "<color>0.5 0.5 0.5 1</color>"), is_grey


@case("a texture without coordinates", "glTF", "OBJ", "PLY", "DAE")
def bare_texture(folder, kind):
    if kind == "glTF":
        gltf = Gltf()
        gltf.mesh(material=gltf.textured())
        return gltf.save(folder / "m.glb"), upright(4.0)
    if kind == "OBJ":
        return obj(folder, V + "usemtl a\nf 1 2 3 4\n", "newmtl a\nmap_Kd q.png\n"), is_grey
    if kind == "PLY":
        return ply_file(
            folder, ply(XYZ, rows(BOARD), RING, "4 0 1 2 3", comments="comment TextureFile q.png\n")
        ), is_grey
    return dae_board(folder, TEXTURE, SAMPLER.format(""), uv=None), is_grey


@case("a texture file that is not there", "glTF", "OBJ", "PLY", "DAE", says=r"is not there \(gone.png\)")
def gone(folder, kind):
    if kind == "glTF":
        gltf = Gltf(
            images=[{"uri": "gone.png"}],
            textures=[{"source": 0}],
            materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        )
        gltf.mesh(material=0, attributes={"TEXCOORD_0": gltf.uv()})
        return gltf.save(folder / "m.glb"), is_grey
    path = textured(folder, kind, name="gone.png")
    (folder / "gone.png").unlink()
    return path, is_grey


@case("a material library that is not there", "OBJ", says="gone.mtl, which is not there")
def gone_library(folder):
    return obj(folder, "mtllib gone.mtl\n" + V + VT + "usemtl a\n" + QUAD, image=False), is_grey


@case("a picture over the limit", "glTF", "OBJ", "PLY", "DAE", says="texture pixels are more than the limit")
def too_large(folder, kind):
    return textured(folder, kind, data=picture(np.zeros((1, 1, 3)), side=200))


@case("a picture of an unknown kind", "glTF", "OBJ", "PLY", "DAE", says="cannot be read as an image|32 bits a channel")
def odd_picture(folder, kind):
    return textured(folder, kind, data=b"no picture at all")


@case("a picture of an unknown kind", "OBJ", "PLY", "DAE", says="32 bits a channel")
def real_picture(folder, kind):
    import io

    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(np.full((4, 4), 0.5, np.float32)).save(file, "TIFF")
    return textured(folder, kind, data=file.getvalue())


@case("WebP pictures", "glTF", "OBJ", "PLY", "DAE")
def webp(folder, kind):
    data = picture(kind="WEBP", lossless=True)
    if kind != "glTF":
        return textured(folder, kind, data=data, name="q.webp"), is_quarters
    gltf = Gltf().uses("EXT_texture_webp")
    material = gltf.textured(data, mime="image/webp")
    gltf.document["textures"][0] = {"extensions": {"EXT_texture_webp": {"source": 0}}}
    gltf.mesh(material=material, attributes={"TEXCOORD_0": gltf.uv()})
    return gltf.save(folder / "m.glb"), is_quarters


@case("KTX2 pictures", "glTF", says="KHR_texture_basisu.*ktxdecompress")
def ktx2(folder):
    gltf = Gltf().uses("KHR_texture_basisu")
    gltf.mesh()
    return gltf.save(folder / "m.glb")
