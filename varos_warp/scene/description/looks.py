"""Keys of a scene from which only looks follow: how bright and in what colours things are seen, not what is where.

They are named one by one: a key that is not named here, such as one that is new, may decide anything. What is made
without regard to some of them states which (`varos_warp.products.images.protocol.ImageProduct.beside`);
tests/dataset/sweep renders every one of them both ways.
"""

from collections.abc import Iterable
from typing import Any

GAINS = tuple(
    f"{place}.cameras.*.exposure.{key}" for place in ("vehicle", "vehicles.*") for key in ("gain", "white_balance")
)
"""Keys of the gains of single cameras; ``*`` is any item."""
LOOKS_OF_WATER = (
    *GAINS,
    "name",
    "water",
    "particles",
    "vehicle.lights",
    "vehicles.*.lights",
    "render.tolerance",
    "render.max_seconds_per_frame",
    "render.spp",
    "render.max_scatterings",
    "render.max_bounces",
    "render.layers",
    "render.integrator",
    "render.denoise",
    "render.exposure.A",
    "render.exposure.white_balance",
    "render.noise",
    "render.linear_exr",
)
"""Keys from which only light in water follows, and the name, from which nothing does."""
LOOKS = (*LOOKS_OF_WATER, "render.spp_b", "render.denoise_b", "render.exposure.B", "render.dither")
"""The keys of `LOOKS_OF_WATER`, and those from which only light without water follows."""


def without(described: dict[str, Any], keys: Iterable[str]) -> dict[str, Any]:
    """A scene as plain data, such as ``scene_to_dict`` gives, without some keys."""
    found = described
    for key in keys:
        found = _without(found, key.split("."))
    return found


def _without(block: Any, path: list[str]) -> Any:
    """A copy of a block, or list of blocks, without the key at a path; itself if there is none.

    A block within another goes with the last of its keys.
    """
    first, *rest = path
    if first == "*" and isinstance(block, list):
        return [_without(item, rest) for item in block]
    if not isinstance(block, dict) or first not in block:
        return block
    left = _without(block[first], rest) if rest else {}
    if left == {}:
        return {key: value for key, value in block.items() if key != first}
    return block | {first: left}
