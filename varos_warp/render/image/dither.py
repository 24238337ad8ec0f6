"""Dither: noise that is added before an image is rounded to 8 bits, so that slow gradients have no bands.

With the sum of two independent uniform numbers of one step (triangular probability density, TPDF), the error of
rounding has a mean of 0 and a variance of 1/4 step^2, whatever is rounded (Lipshitz, Wannamaker and Vanderkooy 1992,
"Quantization and Dither: A Theoretical Survey", J. Audio Eng. Soc. 40). Within half a step of the ends, where the sum
would leave the range and be clipped, one of the numbers is added: the mean of the error stays 0, black and white stay.
"""

from dataclasses import dataclass

import numpy as np

from varos_warp.scene.description import Scene

_DITHER = 0x646974
"""Tells these random numbers from others."""
STEPS = np.float32(2.0**15)
"""Values that a random number has."""


@dataclass(frozen=True)
class Dither:
    """Noise of the images of a scene: that of a pixel and channel follows from its place, frame, camera and seed."""

    seed: int

    @classmethod
    def of(cls, scene: Scene) -> "Dither | None":
        """What a scene asks for."""
        return cls(scene.seed) if scene.render.dither == "tpdf" else None

    def rounded(self, levels: np.ndarray, camera: str, letter: str, frame: int) -> np.ndarray:
        """uint8 [H, W, 3] of values from 0 to 255, float32 [H, W, 3], of one image."""
        one, other = self._uniforms(levels.shape, camera, letter, frame)
        other[(levels < 0.5) | (levels > 254.5)] = 0.0
        one += other
        one += levels
        return np.clip(np.rint(one, out=one), 0.0, 255.0).astype(np.uint8)

    def _uniforms(self, shape: tuple[int, ...], camera: str, letter: str, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Two numbers in (-1/2, 1/2) for each value, float32.

        The words of Philox are a function of key and counter, which NumPy promises to keep (NEP 19).
        """
        key = np.random.SeedSequence([self.seed, _DITHER, frame, *letter.encode(), *camera.encode()])
        words = np.random.Philox(key).random_raw(int(np.prod(shape))).reshape(shape)
        # middles of 2^15 steps, which float32 holds beside 255
        one, other = (((words >> np.uint64(shift)) & np.uint64(0x7FFF)).astype(np.float32) for shift in (49, 34))
        return (one - STEPS / 2 + 0.5) / STEPS, (other - STEPS / 2 + 0.5) / STEPS
