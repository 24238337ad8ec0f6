"""A contact sheet of every object and material, in uniform light (B) and under water (A).

    python -m benchmarks.asset_sheet [-o docs/images/assets.png] [--device auto] [--spp 32] [--only valve,rust]

Takes minutes on two CPU cores. Every tile is its own scene, rendered larger than the sheet shows it.
"""

import argparse
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw
from scipy.spatial.transform import Rotation

from varos_warp.render.image.denoise import denoise_image
from varos_warp.render.image.exposure import statistics
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.frames import euler_angles, look_at_matrix, transform
from varos_warp.scene.geometry.assets import flange_measures, hex_measures

TILE = (320, 180)
RENDERED = (640, 360)
COLUMNS = 2
"""Of pairs: B, A."""
MATERIALS = {
    "seafloor": {
        "kind": "slope_blend",
        "flat": {"texture": "sand", "size_m": 1.5},
        "steep": {"texture": "rock", "size_m": 1.5},
    },
    "stone": {
        "kind": "slope_blend",
        "flat": {"texture": "rock", "size_m": 1.5},
        "steep": {"texture": "rock", "size_m": 1.5},
    },
    "paint": {"kind": "diffuse", "reflectance": [0.62, 0.42, 0.07]},
    "concrete": {"kind": "dirt", "base": [0.42, 0.4, 0.37], "amount": 0.3},
    "metal": {"kind": "metal", "roughness": 0.3},
    "rust": {"kind": "rust", "base": [0.4, 0.4, 0.42], "amount": 0.5},
    "rusty metal": {"kind": "rust", "base": [0.5, 0.5, 0.52], "amount": 0.4, "roughness": 0.35},
    "dirt": {"kind": "dirt", "base": [0.62, 0.42, 0.07], "amount": 0.5},
}


def turned(block, rotation, position=(0.0, 0.0, 0.0)):
    """A block moved as a whole, with its own place in the assembly kept."""
    own = Rotation.from_euler("xyz", block.get("rotation_euler_deg", (0.0, 0.0, 0.0)), degrees=True)
    place = rotation.apply(block.get("position", (0.0, 0.0, 0.0))) + position
    return {
        **block,
        "position": place.tolist(),
        "rotation_euler_deg": np.degrees(euler_angles(rotation * own)).tolist(),
    }


def joint(radius=0.162, size="M24"):
    """Two pipes with flanges, bolted, along z; DN 300 takes M24."""
    _, circle, _, count, thickness = flange_measures(radius)
    _, _, k, m = hex_measures(size)
    parts = [
        {"kind": "pipe", "radius": radius, "length": 1.0, "position": [0, 0, z], "material": "rust"}
        for z in (-0.502, 0.502)
    ]
    parts += [
        {"kind": "flange", "radius": radius, "material": "rust"},
        {"kind": "flange", "radius": radius, "rotation_euler_deg": [180, 0, 0], "material": "rust"},
    ]
    for angle in 2.0 * np.pi / count * (0.5 + np.arange(count)):
        x, y = circle * np.cos(angle), circle * np.sin(angle)
        parts += [
            {
                "kind": "bolt",
                "size": size,
                "length": 2 * thickness + m + 0.008,
                "material": "metal",
                "position": [x, y, -thickness - k],
            },
            {"kind": "nut", "size": size, "material": "metal", "position": [x, y, thickness + 0.5 * m]},
        ]
    return [turned(part, Rotation.from_euler("xyz", [0, 90, 30], degrees=True), [0, 0, 0.26]) for part in parts]


def elbow(material):
    """An elbow between two flanges, as a stage for a material."""
    ends = [
        {"kind": "flange", "radius": 0.15},
        {"kind": "flange", "radius": 0.15, "position": [0.4, 0, 0.4], "rotation_euler_deg": [0, -90, 0]},
    ]
    bend = [{"kind": "elbow", "radius": 0.15, "bend_radius": 0.4, "wall": 0.02}, *ends]
    return [turned({**part, "material": material}, Rotation.from_euler("z", 200, degrees=True)) for part in bend]


def tiles():
    """Title, objects, blocks of scatter, where the camera stands and where it looks."""
    pipe = [
        {
            "kind": "pipe",
            "radius": 0.15,
            "length": 3.0,
            "position": [0, 0, 0.25],
            "rotation_euler_deg": [0, 90, 0],
            "material": "paint",
        }
    ]
    pipe += [
        {
            "kind": "pipe_support",
            "radius": 0.15,
            "position": [x, 0, 0.25],
            "rotation_euler_deg": [0, 0, 90],
            "material": "concrete",
        }
        for x in (-0.9, 0.9)
    ]
    fasteners = [
        {"kind": "bolt", "size": "M24", "position": [-0.07, 0.03, 0.018], "rotation_euler_deg": [86, 0, 65]},
        {"kind": "bolt", "size": "M24", "position": [0.1, 0.05, 0.0], "length": 0.05},
        {"kind": "nut", "size": "M24", "position": [0.03, -0.04, 0.011], "rotation_euler_deg": [0, 0, 20]},
        {"kind": "nut", "size": "M24", "position": [-0.06, -0.05, 0.018], "rotation_euler_deg": [90, 0, 40]},
    ]
    fasteners = [{**part, "material": "metal"} for part in fasteners]
    sizes = [(0.9, -0.6, 0.3), (0.5, 0.4, 0.0), (0.3, 0.1, -0.6), (0.7, 1.0, 0.7)]
    boulders = [
        {"kind": "boulder", "diameter": d, "seed": seed, "position": [x, y, 0.2 * d], "material": "stone"}
        for seed, (d, x, y) in enumerate(sizes)
    ]
    strewn = [
        {
            "object": {"kind": "boulder", "diameter": 0.3, "seed": 5, "material": "stone"},
            "count": 60,
            "circle": [0, 1.0, 3.0],
            "scale_range": [0.3, 1.5],
            "sink_m": 0.08,
            "max_tilt_deg": 30,
        },
        {
            "object": {"kind": "nut", "size": "M64", "material": "rust"},
            "count": 60,
            "circle": [0, 0, 1.2],
            "max_tilt_deg": 90,
        },
    ]
    yield "pipe, pipe_support", pipe, [], (-1.1, -2.1, 1.0), (0, 0, 0.2)
    yield "flange, bolt, nut", joint(), [], (0.25, -0.85, 0.7), (0, 0, 0.24)
    yield "bolt, nut", fasteners, [], (0.02, -0.22, 0.16), (0.0, 0.0, 0.015)
    yield (
        "valve",
        [
            {
                "kind": "valve",
                "radius": 0.15,
                "position": [0, 0, 0.21],
                "rotation_euler_deg": [0, 0, 60],
                "material": "rusty metal",
            }
        ],
        [],
        (-0.7, -1.3, 0.95),
        (0, 0, 0.38),
    )
    yield "boulder", boulders, [], (-0.3, -2.2, 1.2), (0.15, 0, 0.2)
    yield "scatter", [], strewn, (0, -2.6, 1.3), (0, 0, 0)
    for material in ("paint", "metal", "rust", "rusty metal", "dirt", "stone"):
        kind = MATERIALS[material]["kind"] + (" of metal" if material == "rusty metal" else "")
        yield f"elbow: {kind}", elbow(material), [], (-0.85, -0.75, 0.75), (-0.15, 0.0, 0.25)


def scene_of(objects, scatter):
    """One tile's scene: sand, the objects, two lights, the paper's water."""
    lamps = [{"position": [x, -0.1, 0.0], "direction": [0, 1, 0], "cone_deg": 65, "blend": 0.15} for x in (-0.15, 0.15)]
    return scene_from_dict(
        {
            "terrain": {
                "kind": "procedural",
                "size_m": 16,
                "resolution": 257,
                "relief_m": 0.5 if scatter else 0.0,
                "rockiness": 0.1,
                "feature_m": 6,
                "seed": 3,
                "material": "seafloor",
            },
            "objects": objects,
            "scatter": scatter,
            "materials": MATERIALS,
            "surface_depth_m": 80.0,
            "water": {
                "principled": {
                    "density": 0.125,
                    "color": [0.014, 0.146, 0.345],
                    "absorption_color": [0.0, 0.394, 1.0],
                    "anisotropy": 0.8,
                }
            },
            "vehicle": {"lights": lamps, "cameras": [{"resolution": RENDERED}]},
            "trajectory": {"poses": [{"position": [0, 0, 1]}]},
        }
    )


def picture(image, gain):
    """8-bit sRGB of radiance, denoised, at the size of a tile."""
    linear = np.clip(gain * denoise_image(image, "oidn"), 0.0, 1.0)
    srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)
    return Image.fromarray(np.round(255.0 * srgb).astype(np.uint8)).resize(TILE, Image.Resampling.LANCZOS)


def render_tile(title, objects, scatter, position, target, device, spp):
    """B and A beside each other, with the title."""
    renderer = FrameRenderer(scene_of(objects, scatter), device)
    frame = renderer.render(transform(look_at_matrix(position, target), position), outputs="AB", spp=spp, spp_b=spp)
    pair = Image.new("RGB", (2 * TILE[0], TILE[1]))
    pair.paste(picture(frame.B, 1.0), (0, 0))
    pair.paste(picture(frame.A, statistics(frame.A.radiance).target_gain), (TILE[0], 0))
    ImageDraw.Draw(pair).text((8, 6), title, fill="white", stroke_width=2, stroke_fill="black", font_size=14)
    return pair


def main():
    """Render the tiles and put them together."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--out", type=Path, default=Path("docs/images/assets.png"))
    parser.add_argument("--device", default="auto")
    parser.add_argument("--spp", type=int, default=32)
    parser.add_argument("--only", help="titles that hold one of these words, with commas")
    args = parser.parse_args()
    pairs = []
    for tile in tiles():
        if args.only is None or any(word in tile[0] for word in args.only.split(",")):
            pairs.append(render_tile(*tile, args.device, args.spp))
            print(tile[0], flush=True)
    columns = min(COLUMNS, len(pairs))
    sheet = Image.new("RGB", (columns * 2 * TILE[0], -(-len(pairs) // columns) * TILE[1]))
    for i, pair in enumerate(pairs):
        sheet.paste(pair, (i % columns * 2 * TILE[0], i // columns * TILE[1]))
    sheet.save(args.out, optimize=True)


if __name__ == "__main__":
    main()
