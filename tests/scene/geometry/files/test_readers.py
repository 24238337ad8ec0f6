"""What readers of mesh files do beside the table of docs/meshes.md: memory, mixtures, bounds."""

import numpy as np
import pytest
from made_meshes import BOARD, UV, Gltf, picture
from PIL import Image

from varos_warp.errors import InputError
from varos_warp.scene.geometry.mesh_files import load_mesh, read_mesh
from varos_warp.scene.images import srgb_to_linear

V = "".join(f"v {x} {y} {z}\n" for x, y, z in BOARD)


def test_materials_share_the_vertices_of_their_file(tmp_path):
    """Fifty materials on 4 vertices are 4 vertices, not 200."""
    path = tmp_path / "m.obj"
    path.write_text(V + "".join(f"usemtl m{k}\nf 1 2 3\nf 1 3 4\n" for k in range(50)))
    vertices, faces = read_mesh(path)
    assert vertices.shape == (4, 3)
    assert faces.shape == (100, 3)


def test_vertices_with_and_without_colours_may_stand_in_one_obj(tmp_path):
    """As of exporters that write colours for the objects that have them, however late the first one comes."""
    path, plain = tmp_path / "m.obj", "v 9 9 0\n" * 1200
    path.write_text(
        plain + "".join(f"v {x} {y} {z} 1 0.5 0\n" for x, y, z in BOARD) + "v 3 0 0\nv 4 0 0\nv 4 1 0\n"
        "f 1201 1202 1203\nf 1205 1206 1207\n"
    )
    with pytest.warns(UserWarning, match="some of its vertices have no colour: they are grey"):
        skin = load_mesh(path).skin
    np.testing.assert_allclose(skin.corners[0, 0], srgb_to_linear(np.array([1.0, 0.5, 0.0])), rtol=1e-6)
    np.testing.assert_allclose(skin.corners[1], 0.5)


def test_a_mask_of_16_bits_is_read_whole(tmp_path):
    (tmp_path / "q.png").write_bytes(picture())
    Image.fromarray(np.array([[10000, 20000], [40000, 65535]], np.uint16)).save(tmp_path / "d.png")
    (tmp_path / "m.mtl").write_text("newmtl a\nmap_Kd q.png\nmap_d d.png\n")
    vt = "".join(f"vt {u} {v}\n" for u, v in UV)
    (tmp_path / "m.obj").write_text("mtllib m.mtl\n" + V + vt + "usemtl a\nf 1/1 2/2 3/3 4/4\n")
    with pytest.warns(UserWarning, match="mask"):
        alpha = load_mesh(tmp_path / "m.obj").skin.pages[0].alpha
    np.testing.assert_allclose(alpha, np.array([[10000, 20000], [40000, 65535]]) / 257.0, atol=1.0)


def test_a_small_file_may_not_ask_for_gigabytes(tmp_path):
    """Accessors without bytes of their own are zeros, as many as they say."""
    gltf = Gltf()
    sparse = {
        "count": 1,
        "indices": {"bufferView": gltf.view(b"\0\0\0\0"), "componentType": 5125},
        "values": {"bufferView": gltf.view(np.ones(3, "<f4").tobytes())},
    }
    places = gltf.accessor(BOARD, bufferView=None, sparse=sparse)
    gltf.document["accessors"][places]["count"] = 60_000_000
    gltf.mesh(places)
    with pytest.raises(InputError, match="60000000 elements without bytes"):
        load_mesh(gltf.save(tmp_path / "m.glb"))
