"""Colours that mesh files bring along: base colour maps and their coordinates (GLB, OBJ), colours of vertices."""

import numpy as np
import trimesh
from trimesh.visual.material import PBRMaterial, pack

from varos_warp.scene.geometry.parts import Skin
from varos_warp.scene.images import decode_image, srgb_to_linear


def join_skins(meshes: list[tuple[trimesh.Trimesh, bool]]) -> Skin | None:
    """Skin of several meshes joined; None if none of them has colours.

    Beside meshes with maps, one without has its plain colour. Several maps are packed into one.

    Args:
        meshes: Each mesh, and whether its triangles were turned over.
    """
    if any(_has_map(mesh) for mesh, _ in meshes):
        return _mapped([mesh for mesh, _ in meshes], [turned for _, turned in meshes])
    colours = [_corner_colours(mesh, turned) for mesh, turned in meshes]
    if all(c is None for c in colours):
        return None
    plain = [np.full((len(mesh.faces), 3, 3), 0.5, np.float32) for mesh, _ in meshes]
    return Skin(np.concatenate([p if c is None else c for c, p in zip(colours, plain, strict=True)]))


def _image(mesh):
    """Base colour map of a mesh, or None."""
    material = getattr(mesh.visual, "material", None)
    return getattr(material, "baseColorTexture", None) or getattr(material, "image", None)


def _has_map(mesh):
    return _image(mesh) is not None and getattr(mesh.visual, "uv", None) is not None


def _factor(mesh):
    """Linear base colour [3] that multiplies the map of a glTF material."""
    factor = getattr(getattr(mesh.visual, "material", None), "baseColorFactor", None)
    return None if factor is None else np.asarray(factor, np.float32)[:3] / 255.0


def _mapped(meshes, turned):
    """One texture map for all meshes."""
    distinct = {id(_image(mesh)) for mesh in meshes if _has_map(mesh)}
    factors = {tuple(_factor(mesh)) for mesh in meshes if _factor(mesh) is not None}
    if len(distinct) == 1 and len(factors) <= 1 and all(map(_has_map, meshes)):
        uvs = [np.asarray(mesh.visual.uv) for mesh in meshes]
        image = decode_image(_image(meshes[0]))
        image = image * np.array(factors.pop(), np.float32) if factors else image
    else:
        materials = [mesh.visual.material if _has_map(mesh) else PBRMaterial(baseColorFactor=_plain(mesh))
                     for mesh in meshes]
        uvs = [mesh.visual.uv if _has_map(mesh) else np.full((len(mesh.vertices), 2), 0.5) for mesh in meshes]
        material, packed = pack(materials, uvs)
        image = decode_image(getattr(material, "image", None) or material.baseColorTexture)
        uvs = np.split(packed, np.cumsum([len(uv) for uv in uvs])[:-1])
    corners = [_turn(uv[mesh.faces], over) for uv, mesh, over in zip(uvs, meshes, turned, strict=True)]
    return Skin(np.concatenate(corners).astype(np.float32), image)


def _plain(mesh):
    """Colour of a mesh without a map, RGBA [4] of 8 bits."""
    factor = _factor(mesh)
    return [128, 128, 128, 255] if factor is None else [*np.rint(255 * factor).astype(int), 255]


def _corner_colours(mesh, turned):
    """Linear reflectances float32 [F, 3, 3] of a mesh's vertices, its faces or its material; None without any."""
    kind = getattr(mesh.visual, "kind", None)
    if kind == "vertex":
        return _turn(_decode(mesh.visual.vertex_colors)[mesh.faces], turned)
    if kind == "face":
        return np.repeat(_decode(mesh.visual.face_colors)[:, None], 3, axis=1)
    factor = _factor(mesh)
    return None if factor is None else np.broadcast_to(factor, (len(mesh.faces), 3, 3)).astype(np.float32)


def _decode(colours):
    """Linear reflectances float32 [N, 3] of colours as files store them: sRGB of 8 bits."""
    return srgb_to_linear(np.asarray(colours)[:, :3] / 255.0).astype(np.float32)


def _turn(corners, over):
    return corners[:, ::-1] if over else corners
