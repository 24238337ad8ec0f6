"""The table of ids in the segmentation image S."""

from varos_warp.scene.description import Scene


def segment_table(scene: Scene, part_names: list[str]) -> list[dict]:
    """A row for each terrain, object and copy, in the order of their ids.

    Args:
        scene: The scene.
        part_names: Keys in the scene file: ``terrain``, ``objects.3``, ``scatter.0.17``; ``vehicles.ID`` of a body.

    Returns:
        Rows of ``id`` (from 1; 0 is nothing), ``key``, ``kind`` (``terrain``, ``mesh``, ``pipe`` ...), ``material`` and
        ``material_id`` (its place among the scene file's materials, from 1; 0: none).
    """
    materials = list(scene.materials)
    rows = []
    for number, key in enumerate(part_names, start=1):
        block = _block(scene, key)
        kind = "terrain" if key == "terrain" else getattr(block, "kind", "")
        name = getattr(block, "material", None)
        material_id = materials.index(name) + 1 if name in materials else 0
        rows.append({"id": number, "key": key, "kind": kind, "material": name, "material_id": material_id})
    return rows


def _block(scene: Scene, key: str):
    """The block that a key names; None for parts from elsewhere than the scene file."""
    group, *numbers = key.split(".")
    if group == "terrain":
        return scene.terrain
    if group == "vehicles":
        return next((vehicle.body for vehicle in scene.vehicles or () if vehicle.key == key), None)
    blocks = {"objects": scene.objects, "scatter": [block.object for block in scene.scatter]}.get(group, [])
    known = bool(numbers) and numbers[0].isdigit() and int(numbers[0]) < len(blocks)
    return blocks[int(numbers[0])] if known else None
