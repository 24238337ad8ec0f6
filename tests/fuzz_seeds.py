"""A good file of each kind that the package reads, for the fuzzer to change."""

import io
import re
import tempfile
from functools import cache
from pathlib import Path

import imagecodecs  # noqa: F401 - tifffile packs by it
import numpy as np
import surveys
import trimesh
from ies_by_hand import ies_text, measured
from made_meshes import (
    BOARD,
    BOUND,
    QUARTERS,
    SAMPLER,
    UV,
    VERTEX,
    Gltf,
    dae,
    dae_effect,
    dae_places,
    dae_source,
    picture,
    ply,
)
from PIL import Image

from varos_warp.scene.file.templates import template_text


def quick(scene: str) -> str:
    """The starter with a coarse floor, coarse objects and stones of two shapes: surfaces take most of the time."""
    for fine, coarse in (("resolution: 193", "resolution: 49"), ("shapes: 6", "shapes: 2"), ("shapes: 4", "shapes: 2")):
        assert scene.count(fine) == 1
        scene = scene.replace(fine, coarse)
    scene = re.sub(r"{kind: (pipe|pipe_support|valve|boulder),", r"{kind: \1, chord_error_m: 0.05,", scene)
    return scene.replace("{on: ", '{"on": ')  # YAML 1.1, with which entries are changed, has on for true


def nodes_dae() -> bytes:
    """Triangles and a polygon under nodes, one of which stands in two places, in COLLADA."""
    return b"""<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="1"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh><source id="p">
<float_array id="pa" count="9">0 0 0 1 0 0 0 1 0</float_array><technique_common>
<accessor source="#pa" count="3" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles>
<polylist count="1"><input semantic="VERTEX" source="#v" offset="0"/><vcount>3</vcount><p>0 1 2</p></polylist>
</mesh></geometry></library_geometries>
<library_nodes><node id="n"><scale>1 2 1</scale><instance_geometry url="#g"/></node>
<node id="m"><instance_node url="#n"/><instance_node url="#n"/></node></library_nodes>
<library_visual_scenes><visual_scene id="s"><node><translate>1 2 3</translate><rotate>0 0 1 90</rotate>
<instance_geometry url="#g"/><instance_node url="#m"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


CAMCHAIN = """
cam0: {camera_model: pinhole, intrinsics: [500, 501.5, 320.25, 240], distortion_model: radtan,
  distortion_coeffs: [-0.2, 0.1, 1.0e-3, -0.002], resolution: [640, 480], T_cam_imu: [[1, 0, 0, 0], [0, 1, 0, 0]]}
"""
FILE_STORAGE = """<?xml version="1.0"?>
<opencv_storage><image_width>640</image_width><image_height>480</image_height>
<camera_matrix type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt>
<data>500. 0. 320.25 0. 501.5 240. 0. 0. 1.</data></camera_matrix>
<distortion_coefficients type_id="opencv-matrix"><rows>1</rows><cols>8</cols><dt>d</dt>
<data>4.1 2.7 0.0001 -0.0002 0.1 4.5 4.0 0.9</data></distortion_coefficients></opencv_storage>
"""


QUADS = (
    "mtllib quads.mtl\n"
    + "".join(f"v {x} {y} 0 1 0 0\n" for x, y, _ in BOARD)
    + ("vt 0 0\nvt 1 0\nvt 1 1\nusemtl a\nf 1/1 2/2 3/3 4/1\ng b\nf -4 -3 -2\n")
)


def board() -> Gltf:
    """Much of what glTF has: a picture that masks, colours, sparse values, copies, a skin, morphs, a transform."""
    made = Gltf(scenes=[{"nodes": [0]}], scene=0).uses("KHR_texture_transform").uses("EXT_mesh_gpu_instancing")
    pixels = np.concatenate([QUARTERS, np.full((2, 2, 1), 200)], axis=2)
    material = made.textured(
        picture(pixels, side=1),
        alphaMode="MASK",
        info={"extensions": {"KHR_texture_transform": {"scale": [2, 2], "rotation": 0.5}}},
    )
    sparse = {
        "count": 1,
        "indices": {"bufferView": made.view(b"\2\0"), "componentType": 5123},
        "values": {"bufferView": made.view(BOARD[2].astype("<f4").tobytes())},
    }
    places = made.accessor(BOARD, sparse=sparse, min=[-1, -1, 0], max=[1, 1, 0])
    made.mesh(
        places,
        material=material,
        node=False,
        targets=[{"POSITION": made.accessor(BOARD)}],
        attributes={
            "TEXCOORD_0": made.uv(),
            "COLOR_0": made.accessor(np.full((4, 4), 200), "u1", normalized=True),
            "JOINTS_0": made.accessor([[0, 0, 0, 0]] * 4, "u1"),
            "WEIGHTS_0": made.accessor([[1, 0, 0, 0]] * 4),
        },
    )
    made.document["meshes"][0]["weights"] = [0.5]
    made.node(children=[1, 2])
    made.node(mesh=0, skin=0)
    made.node(
        mesh=0,
        matrix=np.eye(4).ravel().tolist(),
        extensions={
            "EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": made.accessor([[0.0, 0, 1], [0, 0, 2]])}}
        },
    )
    made.document["skins"] = [{"joints": [0], "inverseBindMatrices": made.accessor([np.eye(4).ravel()])}]
    return made


def polygons_dae() -> str:
    """Polygons with a hole, fans, coordinates, colours and a material."""
    places = dae_places(np.concatenate([BOARD, 0.5 * BOARD[::-1]]))
    uv = dae_source("t", UV, "ST") + dae_source("c", np.full((1, 3), 0.5), "RGB")
    inputs = VERTEX + (
        '<input semantic="TEXCOORD" source="#t" offset="1" set="0"/><input semantic="COLOR" source="#c" offset="2"/>'
    )
    rings = [" ".join(f"{i} {i % 4} 0" for i in ring) for ring in (range(4), range(4, 8))]
    cut = f"<ph><p>{rings[0]}</p><h>{rings[1]}</h></ph>"
    geometry = (
        uv
        + places
        + (
            f'<polygons material="x" count="1">{inputs}{cut}</polygons>'
            f'<trifans count="1">{VERTEX}<p>0 1 2 3</p></trifans>'
        )
    )
    return dae(
        geometry,
        before=dae_effect('<texture texture="a" texcoord="U"/>', SAMPLER.format("")),
        materials=BOUND.format(""),
    )


def strips_ply() -> str:
    """Colours, texture coordinates, polygons and strips in text."""
    return (
        ply(
            "float x,float y,float z,uchar red,uchar green,uchar blue,float s,float t",
            "\n".join(f"{x} {y} 0 9 99 200 0 1" for x, y, _ in BOARD),
            "list uchar int vertex_indices",
            "4 0 1 2 3\n3 0 1 2",
            more="element tristrips 1\nproperty list int int vertex_indices\n",
            comments="comment TextureFile q.png\n",
        )
        + "5 0 1 -1 2 3\n"
    )


def binary_ply() -> bytes:
    """Quads and triangles with coordinates of their corners, big end first."""
    head = (
        "ply\nformat binary_big_endian 1.0\nelement vertex 4\n"
        + "".join(f"property double {x}\n" for x in "xyz")
        + "element face 2\nproperty list uchar uint vertex_index\nproperty list uchar float texcoord\nend_header\n"
    )
    body = BOARD.astype(">f8").tobytes()
    for ring in ([0, 1, 2, 3], [0, 1, 2]):
        body += bytes([len(ring)]) + np.array(ring, ">u4").tobytes()
        body += bytes([2 * len(ring)]) + np.zeros(2 * len(ring), ">f4").tobytes()
    return head.encode() + body


SURVEYS = {
    "a.tif": {},
    "packed.tif": {},
    "a.asc": {},
    "a.xyz": {},
    "a.csv": {},
    "a.las": {},
    "a.laz": {},
    "heights.png": {"pixel_m": 1.0, "height_range_m": [-5, 0]},
    "a.npy": {"pixel_m": 1.0, "first_row": "north"},
}
"""Keys that a survey file is read with, by its name."""


@cache
def survey_files() -> dict[str, bytes]:
    """A good survey of each kind, by name."""
    grid, points = surveys.plane_grid((12, 14)), surveys.points_of(surveys.plane_grid())
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        surveys.write_geotiff(place / "a.tif", grid, nodata=-9999)
        surveys.write_geotiff(
            place / "packed.tif",
            grid.astype(np.float32),
            place="matrix",
            compression="deflate",
            tile=(16, 16),
            predictor=True,
        )
        surveys.write_asc(place / "a.asc", grid, digits=6)
        surveys.write_text(place / "a.xyz", points)
        surveys.write_text(place / "a.csv", points[::2], delimiter=",", header="x,y,z")
        for name in ("a.las", "a.laz"):
            surveys.write_las(place / name, points)
        np.save(place / "a.npy", grid)
        Image.fromarray(np.arange(168, dtype=np.uint16).reshape(12, 14)).save(place / "heights.png")
        return {name: (place / name).read_bytes() for name in SURVEYS}


def lamps() -> dict[str, str]:
    """Files of lamps: IES of type C with symmetry and tilt, and of type B; CSV of two angles."""
    angles, tilt = np.arange(0.0, 91.0, 15.0), "TILT=INCLUDE\n1\n2\n0 90\n1 0.9"
    around = [f"{polar},{azimuth},{polar + azimuth}" for azimuth in (0, 90, 180, 270) for polar in (0, 40, 80)]
    return {
        "quadrants.ies": ies_text("C", angles, angles, measured("C", angles, angles), tilt=tilt),
        "flood.ies": ies_text("B", angles, angles, measured("B", angles, angles)),
        "around.csv": "\n".join(["polar_deg,azimuth_deg,intensity", *around]),
    }


def seeds() -> dict[str, bytes]:
    """A good file of each kind, by name."""
    ball = trimesh.creation.icosphere(subdivisions=1)
    made = {f"x.{kind}": ball.export(file_type=kind) for kind in ("obj", "ply", "stl", "glb")}
    made |= {
        "ascii.ply": ball.export(file_type="ply", encoding="ascii"),
        "ascii.stl": ball.export(file_type="stl_ascii"),
        "x.dae": nodes_dae(),
        "scene.yaml": quick(template_text()),
    }
    made |= {
        "board.gltf": board().text(),
        "board.glb": board().packed(),
        "polygons.dae": polygons_dae(),
        "polygons.off": "COFF\n4 2 0\n"
        + "".join(f"{x} {y} 0 255 0 0 255\n" for x, y, _ in BOARD)
        + "4 0 1 2 3 0.5 0.5 0.5\n3 0 1 2\n",
        "strips.ply": strips_ply(),
        "binary.ply": binary_ply(),
        "quads.obj": QUADS,
        "quads.mtl": "newmtl a\nKd 0.5 0.5 0.5\nmap_Kd -s 2 2 1 -clamp on q.png\n"
        "map_d -imfchan m quads.png\nd 0.5 # half\nKe 0 \\\n 0 0\n",
    }
    for kind in ("png", "jpeg", "tiff"):
        file = io.BytesIO()
        Image.effect_noise((16, 16), 50).convert("RGB").save(file, kind)
        made[f"x.{kind}"] = file.getvalue()
    made |= survey_files()
    made |= {"calibrated.yaml": CAMCHAIN, "calibrated.xml": FILE_STORAGE}
    made |= lamps()
    return {name: data if isinstance(data, bytes) else data.encode() for name, data in made.items()}
