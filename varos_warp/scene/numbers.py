"""Numbers of everything solid: in S, and as kernels know them."""

import numpy as np

from varos_warp.scene.description import Scene
from varos_warp.scene.geometry.parts import Grown, Instances, Part


def part_names(scene: Scene, parts: list[Part | Instances]) -> list[str]:
    """Names of all that has a number, in its order; among them the observer's own body, which nobody sees here."""
    names = [part.name for part in parts if isinstance(part, Part)]
    groups = [group for group in parts if isinstance(group, Instances) and _has_numbers(scene, group)]
    for block in dict.fromkeys(group.name for group in groups):
        numbers = np.concatenate([group.numbers for group in groups if group.name == block])
        names += [f"{block}.{i}" for i in np.sort(numbers)]
    if own := scene.own_body:
        names.insert(scene.number_of(own) - 1, own)
    return names


def _has_numbers(scene: Scene, group: Instances) -> bool:
    """Return whether S has a number for each copy; else each has that of its host."""
    return not isinstance(group, Grown) or scene.render.segments == "fine"


def numbered(scene: Scene, parts: list[Part | Instances], names: list[str]) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Numbers of parts as kernels know them, which materials go by, and the numbers in S that they stand for.

    Copies on one host that have its number share one of their own beyond those of ``names`` (`part_names`), as their
    material is not the host's.

    Returns:
        The number of each part, or of each copy of a group, int32 [N], by its name or that of its first copy; and
        the numbers in S, int32 [M + 1], by one more than those of the kernels; 0 stands for itself.
    """
    by_name = {name: number for number, name in enumerate(names)}
    numbers, hosts = {}, [np.arange(len(by_name) + 1, dtype=np.int32)]
    count = len(by_name)
    for part in parts:
        if isinstance(part, Part):
            numbers[part.name] = np.array([by_name[part.name]], np.int32)
        elif _has_numbers(scene, part):
            numbers[part.first_name] = np.array([by_name[name] for name in part.names], np.int32)
        else:
            used, of = np.unique(part.host, return_inverse=True)
            numbers[part.first_name] = (count + of).astype(np.int32)
            hosts.append(np.array([by_name[part.hosts[k]] + 1 for k in used], np.int32))
            count += len(used)
    return numbers, np.concatenate(hosts)
