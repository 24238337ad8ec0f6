"""Materials of a scene file as the device's Material records."""

import zlib
from collections.abc import Sequence

import numpy as np
import warp as wp
from scipy.special import ndtri

from varos_warp.kernels.world import texture
from varos_warp.kernels.world.tiling import PERIOD
from varos_warp.scene.description import Scene
from varos_warp.scene.description.surfaces import GRAIN, Layered
from varos_warp.scene.description.world import Diffuse, Dirt, Material, Metal, Rust, SlopeBlend
from varos_warp.scene.geometry.parts import Instances, Part
from varos_warp.scene.geometry.placed import may_have_colours, may_have_images
from varos_warp.scene.materials.lobe import has_lobe
from varos_warp.scene.materials.textures import Textures


def device_material(part: Part, scene: Scene, local_origin: np.ndarray, textures: Textures) -> texture.Material:
    """Record of a part's material.

    Args:
        part: The part, or a box around it: its lowest corner anchors the pattern.
        local_origin: float64 [3], origin of the device's world.

    Raises:
        InputError: An image of the material is missing or damaged.
    """
    record = texture.Material()
    low = part.vertices.min(axis=0)
    record.offset = wp.vec3(*(local_origin - low))
    # by the place, so that no two look alike (paper 3.1.2)
    record.seed = wp.uint32(zlib.crc32(np.asarray(part.origin, np.float64).tobytes(), scene.seed))
    material = part.material
    record.diffuse_roughness, record.grain = diffuse_roughness(material), grain(material)
    if part.skin is not None:
        _set_skin(record, part, textures)
    elif isinstance(material, SlopeBlend):
        _set_ground(record, part, local_origin - low, textures, scene)
    elif isinstance(material, Rust | Dirt):
        _set_layer(record, part)
    elif isinstance(material, Metal):
        record.kind = int(texture.METAL)
        record.base, record.roughness = wp.vec3(*material.base), material.roughness
    else:
        record.kind = int(texture.DIFFUSE)
        record.base = wp.vec3(*material.reflectance)
    return record


def is_textured(part: Part | Instances) -> bool:
    """Return whether its material is more than one constant reflectance."""
    return part.skin is not None or not isinstance(part.material, Diffuse)


def features(parts: Sequence[Part | Instances]) -> dict[str, bool]:
    """What kernels are compiled for, of the materials of parts: fields of a `SceneSpec` by name."""
    bare = [part.material for part in parts if part.skin is None]
    return {
        "textures": any(map(is_textured, parts)),
        "patterns": any(part.skin.pages for part in parts if part.skin is not None) or any(map(_has_pattern, bare)),
        "metals": any(map(has_lobe, bare)),
        "grain": any(grain(part.material) > 0.0 for part in parts),
        "rough": any(diffuse_roughness(part.material) > 0.0 for part in parts),
    }


def foretold_features(scene: Scene) -> dict[str, bool]:
    """`features`, by the scene file alone: as if each mesh file that may have colours of its own had images.

    Wrong where it has none, or nothing grows though something is to.
    """
    blocks = [scene.terrain, *scene.objects, *(block.object for block in scene.scatter), *scene.moving.values()]
    named = [scene.materials[block.material] for block in blocks if block is not None and block.material is not None]
    bring = [block for block in blocks if block is not None and block.material is None and may_have_colours(block)]
    return {
        "textures": bool(scene.growth or bring) or any(not isinstance(material, Diffuse) for material in named),
        "patterns": any(map(may_have_images, bring)) or any(map(_has_pattern, named)),
        "metals": any(map(has_lobe, named)),
        "grain": bool(scene.growth) or any(grain(material) > 0.0 for material in named),
        "rough": bool(scene.growth) or any(diffuse_roughness(material) > 0.0 for material in named),
    }


def diffuse_roughness(material: Material) -> float:
    """Roughness of the diffuse part, 0 to 1; 0: Lambertian."""
    return material.diffuse_roughness if isinstance(material, Diffuse | Layered) else 0.0


def grain(material: Material) -> float:
    """How much a surface's tone varies from grain to grain, 0 to 1."""
    if not isinstance(material, Layered):
        return 0.0
    return GRAIN.get(material.relief, 0.0) if material.grain is None else material.grain


def _has_pattern(material: Material) -> bool:
    """Whether a material has images, or patches."""
    return isinstance(material, SlopeBlend | Rust | Dirt)


WRAPS = {"repeat": int(texture.REPEAT), "clamp": int(texture.CLAMP), "mirror": int(texture.MIRROR)}


def _set_skin(record, part, textures):
    """The mesh file's own colours."""
    record.kind = int(texture.MAPPED if part.skin.pages else texture.COLOURED)
    record.has_holes = int(part.skin.has_holes)
    if part.skin.pages:
        record.layers = textures.pages(part.skin, lambda: [_page_layer(page, textures) for page in part.skin.pages])


def _page_layer(page, textures):
    layer = texture.Layer()
    layer.image = textures.map(page)
    layer.factor = wp.vec3(*page.factor)
    layer.wrap_u, layer.wrap_v = (WRAPS[how] for how in page.wrap)
    if page.masks:
        layer.alpha, layer.cutoff = textures.alpha(page.alpha), page.cutoff
    return layer


def _set_ground(record, part, offset, textures, scene):
    """Tiles for flat and steep ground, or one for both."""
    material = part.material
    record.kind = int(texture.GROUND)
    key = next((f"materials.{name}" for name, m in scene.materials.items() if m is material), "material")
    extent, layers = float(np.ptp(part.vertices[:, :2], axis=0).max()), []
    for name in ("flat",) if material.flat == material.steep else ("flat", "steep"):
        block = getattr(material, name)
        layer = texture.Layer()
        layer.size = block.size_m or max(extent / block.tiles, 1e-6)
        layer.image = textures.tile(block.texture, f"{key}.{name}.texture", layer.size)
        layer.offset = wp.vec3(*np.remainder(offset, float(PERIOD) * layer.size))
        if name == "flat" and block.texture == "sand":
            layer.ripple = float(np.clip(0.11 * layer.size, 0.06, 0.3))
        layers.append(layer)
    record.layers = textures.layers(layers)


def _set_layer(record, part):
    """Rust or dirt over something; its patches are of the size of the part's features."""
    material = part.material
    extent = float(np.ptp(part.vertices, axis=0).max())
    record.cycles = float(np.clip(4.0 / max(extent, 1e-6), 6.0, 60.0))
    record.base = wp.vec3(*material.base)
    deviation = float(texture.NOISE_DEVIATION)
    if isinstance(material, Rust):
        record.kind = int(texture.RUST)
        record.metallic = int(material.roughness is not None)
        record.roughness = material.roughness or 0.0
        record.layer_dark, record.layer_pale = wp.vec3(0.20, 0.075, 0.03), wp.vec3(0.33, 0.15, 0.06)
    else:
        record.kind = int(texture.DIRT)
        record.layer_dark, record.layer_pale = wp.vec3(*(0.85 * np.array(material.silt))), wp.vec3(*material.silt)
        deviation = float(np.hypot(deviation, 0.5 / np.sqrt(3.0)))  # and half the slope, over a whole sphere
    record.threshold = float(np.clip(-deviation * ndtri(material.amount), -10.0, 10.0))


def corner_values(parts: list[Part | Instances]) -> np.ndarray:
    """What ``texture.material_at`` reads per face corner of all parts, float32 [3 F, 3]; empty if no part has a skin.

    Of textures u, v and their units per metre before the scale of instances, of colours the reflectances.
    """
    if not any(part.skin is not None for part in parts):
        return np.zeros((0, 3), np.float32)
    return np.concatenate([_part_values(part).reshape(-1, 3) for part in parts])


def tints_of(parts: list[Part | Instances]) -> tuple[np.ndarray, np.ndarray]:
    """Colours and alpha that multiply textures.

    Returns:
        Of each face of all parts, where its corners are, in threes, int32 [F] (-1: nowhere); and the corners of the
        parts that have any, float32 [3 T, 4]. Both are empty if none has.
    """
    tints, places, count = [np.zeros((0, 4), np.float32)], [np.zeros(0, np.int32)], 0
    for part in parts:
        own = None if part.skin is None else part.skin.tints
        if own is None:
            places.append(np.full(len(part.faces), -1, np.int32))
        else:
            places.append(np.arange(count, count + len(own), dtype=np.int32))
            tints.append(own.reshape(-1, 4))
            count += len(own)
    return np.concatenate(places if count else places[:1]), np.concatenate(tints)


def face_pages(parts: list[Part | Instances]) -> np.ndarray:
    """Page of each face of all parts, -1 for colours, int32 [F]; empty if there is no choice."""
    if not any(part.skin is not None and part.skin.page is not None for part in parts):
        return np.zeros(0, np.int32)
    return np.concatenate(
        [
            np.zeros(len(part.faces), np.int32) if part.skin is None or part.skin.page is None else part.skin.page
            for part in parts
        ]
    )


def _part_values(part):
    values = np.zeros((len(part.faces), 3, 3), np.float32)
    if part.skin is None:
        return values
    corners = part.skin.corners
    if corners.shape == values.shape and not part.skin.pages:
        return corners
    values[..., : corners.shape[-1]] = corners
    if part.skin.pages:
        a, b, c = np.moveaxis(part.vertices[part.faces], 1, 0)
        on_surface = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        uv = corners[..., :2]
        u, v = uv[:, 1].astype(float) - uv[:, 0], uv[:, 2].astype(float) - uv[:, 0]
        on_map = np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
        density = np.sqrt(on_map / np.maximum(on_surface, 1e-30))
        has_page = slice(None) if part.skin.page is None else part.skin.page >= 0
        values[has_page, :, 2] = density[has_page, None]
    return values
