"""The pictures of docs/snow.md: the starter scene with the presets of marine snow, and four frames of a moving camera.

    python -m benchmarks.snow_sheet [-o docs/images]

Takes minutes on two CPU cores.
"""

import argparse
from pathlib import Path

import numpy as np
from PIL import Image

from varos_warp.products.images.radiance import srgb_oetf
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.file.load import load_scene
from varos_warp.scene.frames import transform

ROOT = Path(__file__).parents[1]
STARTER = ROOT / "varos_warp" / "data" / "starter.yaml"
PRESETS = {"clear": "IB", "coast": "1C", "bloom": "3C"}
"""Presets, and the water that each is shown in."""
PANEL, STRIP = (426, 280), (320, 200)
"""Width and height of a panel [pixels]."""
FRAMES, STEP_S, OPEN_S, SPEED = 4, 0.1, 0.03, np.array([0.5, 0.0, 0.0])
"""Of the strip: how many, the time between two [s], that of an exposure [s], and the camera's velocity [m/s]."""
EYE = np.array([-0.7, 2.2, 0.95])
"""Where the vehicle is in the first frame [m]."""
SAMPLES = 12
PERCENTILE, LEVEL = 98.5, 0.8
"""Which value a percentile of a picture's brightest channel gets."""


def renderer_of(preset: str, size: tuple[int, int], *more: str) -> FrameRenderer:
    """Of the starter scene with a preset's snow, in its water, at a size."""
    width, height = size
    return FrameRenderer(load_scene(STARTER, [
        f"particles=[{{preset: {preset}}}]", f"water.jerlov.type={PRESETS[preset]}",
        f"vehicle.cameras.0.resolution=[{width}, {height}]",
        f"vehicle.cameras.0.sensor_mm=[4.416, {4.416 * height / width}]", *more]))


def picture(renderer: FrameRenderer, gain: float | None = None, time_s: float = 0.0, moves: bool = False):
    """8 bit RGB [H, W, 3] of A, and the gain that it was exposed with."""
    def T_w_v(t):
        return transform(np.eye(3), EYE + np.multiply.outer(t, SPEED))

    def around(offset_ns):
        return T_w_v(time_s + 1e-9 * np.asarray(offset_ns, float))

    linear = renderer.render(T_w_v(time_s), outputs="A", spp=SAMPLES, denoise="nlm", time_ns=round(1e9 * time_s),
                             motion=around if moves else None).A.denoised
    gain = gain or LEVEL / np.percentile(linear.max(-1), PERCENTILE)
    return np.round(255.0 * srgb_oetf(np.clip(gain * linear, 0.0, 1.0))).astype(np.uint8), gain


def main():
    """Write both pictures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "docs" / "images")
    out = parser.parse_args().out
    presets = [picture(renderer_of(preset, PANEL))[0] for preset in PRESETS]
    Image.fromarray(np.hstack(presets)).save(out / "snow.png", optimize=True)
    renderer = renderer_of("coast", STRIP, f"vehicle.cameras.0.shutter={{exposure_s: {OPEN_S}}}")
    frames, gain = [], None
    for k in range(FRAMES):
        frame, gain = picture(renderer, gain, k * STEP_S, moves=True)
        frames.append(frame)
    Image.fromarray(np.hstack(frames)).save(out / "snow_strip.png", optimize=True)


if __name__ == "__main__":
    main()
