"""Classes of what a scene shows, as labels for detectors have them."""

import re
from collections.abc import Iterable

from varos_warp.errors import same_name
from varos_warp.scene.block import Block

TERRAIN_CLASS, WATER_CLASS = "terrain", "water"
"""Class of the sea floor, unless it has another, and class of places where nothing is hit."""
SURFACES = frozenset((TERRAIN_CLASS, WATER_CLASS))


def class_of(block: Block, is_terrain: bool = False) -> str:
    """The class of an object, of copies, or of the terrain.

    It is that of its key ``class``. Without, it is that of the terrain; the name of a mesh file without its ending, in
    lower case, with underscores for all that is neither letter nor digit; or the kind. One that would be that of the
    terrain or the water ends in ``_object`` then.
    """
    if given := getattr(block, "class_", None):
        return given
    if is_terrain:
        return TERRAIN_CLASS
    kind = getattr(block, "kind", "object")
    name = _stem(getattr(block, "file", "")) or kind if kind == "mesh" else kind
    return f"{name}_object" if name in SURFACES else name


def _stem(file: str) -> str:
    """The name of a file, as a class."""
    name = re.split(r"[/\\]", file)[-1].rpartition(".")[0].casefold()
    return re.sub(r"[\W_]+", "_", name).strip("_")


def spelling_problem(blocks: Iterable[tuple[str, Block | None]]) -> str | None:
    """What is wrong with the keys ``class`` of blocks, after the key that it is wrong with; None: nothing.

    Args:
        blocks: All that has one, by key; first the terrain, or None.
    """
    (_, ground), *others = blocks
    if ground is not None and same_name(class_of(ground, True), [WATER_CLASS]):
        return f"terrain.class: '{class_of(ground, True)}' is the class of where nothing is seen; give another name"
    surfaces = [WATER_CLASS, TERRAIN_CLASS if ground is None else class_of(ground, True)]
    known: dict[str, tuple[str, bool]] = {}
    for key, block in others:
        if block is None:
            continue
        name, own = class_of(block), getattr(block, "class_", None) is not None
        if surface := same_name(name, surfaces):
            whose = "of where nothing is seen" if surface == WATER_CLASS else "that of the terrain"
            place = f"{key}.class" if own else "terrain.class"
            return f"{place}: '{name}' is a class of {key}, and '{surface}' {whose}; give one of them another name"
        if other := same_name(name, known):
            first, given = known[other]
            if other != name and (own or given):
                place = key if own else first
                return (
                    f"{place}.class: '{name if own else other}' is '{other if own else name}' of "
                    f"{first if own else key} in another spelling; spell both alike"
                )
        if name not in known or own:
            known[name] = key, own
    return None
