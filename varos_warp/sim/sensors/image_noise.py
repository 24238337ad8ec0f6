"""A linear image sensor (EMVA 1288): radiance to photons, electrons, digital numbers, and back to linear values.

    electrons = min(Poisson(radiance * vignetting * electrons per radiance + dark current * exposure), full well)
    DN        = round(black level + (electrons + read noise + row noise) / electrons per DN), within 0 .. 2^bits - 1

so that where nothing is clipped, mean DN = black + electrons / e and variance = (electrons + read^2 + row^2) / e^2 +
1/12 with e electrons per DN: the photon transfer curve is a line of slope 1 / e.
"""

import numpy as np

from varos_warp.scene.description.noise_profile import CameraNoise

_CAMERA = 0x63616D


def frame_generator(seed: int, frame: int, camera: str) -> np.random.Generator:
    """Random numbers of one frame of one camera, whichever frames are made before it."""
    return np.random.default_rng([seed, _CAMERA, frame, *camera.encode()])


def levels(model: CameraNoise) -> int:
    """DN between black and white."""
    return 2**model.bits - 1 - model.black_level


def expose(
    model: CameraNoise,
    radiance: np.ndarray,
    gain: float,
    rng: np.random.Generator,
    share: np.ndarray | float = 1.0,
    exposure_s: float = 0.0,
) -> np.ndarray:
    """Digital numbers, int32 [H, W, channels], of linear radiance [H, W, channels]; radiance * gain = 1 is white.

    ``share`` [H, W] is of the light that reaches each pixel; dark current gathers for ``exposure_s`` [s].
    """
    per_dn, range_dn = model.electrons_per_dn, levels(model)
    white = model.electrons_per_radiance / gain if per_dn is None else per_dn * range_dn  # electrons
    signal = np.asarray(radiance, np.float64) * (gain * white) * np.asarray(share)[..., None]
    signal += (model.dark_current_electrons_per_s or 0.0) * exposure_s
    well = model.full_well_electrons or np.inf
    # Poisson numbers need a bound: so far above white and above the well, noise does not lead back
    signal = np.clip(signal, 0.0, 4.0 * min(well, white) + 1000.0)
    electrons = np.minimum(rng.poisson(signal) if model.shot_noise else signal, well)
    electrons += model.read_noise_electrons * rng.standard_normal(signal.shape)
    electrons += model.row_noise_electrons * rng.standard_normal((len(signal), 1, 1))
    number = np.rint(model.black_level + electrons * (range_dn / white))
    return np.clip(number, 0, 2**model.bits - 1).astype(np.int32)


def to_linear(model: CameraNoise, numbers: np.ndarray) -> np.ndarray:
    """Linear values of digital numbers: black 0, white 1; noise below black is negative."""
    return (numbers - model.black_level) / levels(model)
