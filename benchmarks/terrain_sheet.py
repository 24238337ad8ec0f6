"""The Munkholmen sea floor as surveyed, wrapped and decimated; and the example's plot with its added relief.

    python -m benchmarks.terrain_sheet [--device cpu] [--width 640] [-o docs/images/terrain.png]

Normals from image C, seen from above and shaded by a low sun; each label gives the size of the mesh and its error.
"""

import argparse
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from varos_warp.products.images.radiance import srgb_oetf
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.file.load import load_scene
from varos_warp.scene.frames import pose_matrix
from varos_warp.scene.geometry import procedural, terrain
from varos_warp.scene.geometry.mesh_files import load_mesh
from varos_warp.scene.geometry.parts import Part

EXAMPLE = Path(__file__).parents[1] / "examples" / "munkholmen" / "scene.yaml"
SUN = np.array([-0.6, 0.3, 0.45]) / np.linalg.norm([-0.6, 0.3, 0.45])
"""Direction to it; low, so that slopes show."""


def stages(scene):
    """(label, vertices, faces) of each step."""
    block = scene.terrain
    surveyed = load_mesh(scene.resolve(block.file))[:2]
    wrapped = terrain.preprocess(*surveyed, shrinkwrap_resolution=513)
    decimated = terrain.preprocess(*surveyed, shrinkwrap_resolution=513, target_vertices=5000)
    off = [terrain.compare(surveyed, mesh)["distance_to_result_m"]["rms"] for mesh in (wrapped, decimated)]
    plot = terrain.preprocess(*surveyed, **block.preprocess.model_dump())
    relief = procedural.add_detail(plot[0], **block.detail.model_dump())
    return (
        (f"survey: {len(surveyed[0])} vertices", *surveyed),
        (f"wrapped: {len(wrapped[0])} vertices, {100 * off[0]:.0f} cm rms off", *wrapped),
        (f"decimated: {len(decimated[0])} vertices, {100 * off[1]:.0f} cm rms off", *decimated),
        ("the 80 m of the example, with its relief", relief, plot[1]),
    )


def picture(label, vertices, faces, width, device):
    """One tile of the sheet."""
    scene = load_scene(EXAMPLE, [f"vehicle.cameras.0.resolution=[{width},{width * 9 // 16}]"])
    part = Part("terrain", vertices, faces, Diffuse(), smooth_angle=0.0)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    middle, size = (low + high) / 2, float(np.ptp(vertices[:, :2], axis=0).max())
    pose = pose_matrix(
        scene.trajectory.waypoints[0].model_copy(
            update={"position": tuple(middle + size * np.array([0.0, -0.75, 0.6])), "look_at": tuple(middle)}
        )
    )
    normal = FrameRenderer(scene, device, parts=[part]).render(pose, outputs="C").C.normal
    shade = np.where(normal.any(axis=-1), 0.15 + 0.85 * np.clip(normal @ SUN, 0.0, 1.0), 1.0)
    image = Image.fromarray((255 * srgb_oetf(shade[..., None] * [0.9, 0.85, 0.75])).astype(np.uint8))
    ImageDraw.Draw(image).text((8, 6), label, fill="white", stroke_width=2, stroke_fill="black")
    return image


def main():
    """Render all steps side by side."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", default="auto")
    parser.add_argument("--width", type=int, default=640)
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/images/terrain.png"))
    arguments = parser.parse_args()
    tiles = [picture(*stage, arguments.width, arguments.device) for stage in stages(load_scene(EXAMPLE))]
    width, height = tiles[0].size
    sheet = Image.new("RGB", (2 * width + 4, 2 * height + 4), "white")
    for i, tile in enumerate(tiles):
        sheet.paste(tile, (i % 2 * (width + 4), i // 2 * (height + 4)))
    sheet.save(arguments.output)


if __name__ == "__main__":
    main()
