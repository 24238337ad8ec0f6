"""What the sweeps of light transport share: estimates of one ray, and how far they are from the truth."""

from collections.abc import Callable
from functools import cache

import numpy as np
import warp as wp

from benchmarks.stability.entry import Series
from tests.physics.rig import radiance, single_scattering
from varos_warp.errors import InputError

INTEGRATORS = ("field", "path", "reference")


def by_each(error: Callable, *arguments, integrators=INTEGRATORS) -> Series:
    """A series for each integrator: ``error(value, *arguments, integrator)``."""
    return {name: lambda value, by=name: error(value, *arguments, by) for name in integrators}


def estimate(scene, parts=(), layer=None, **how) -> tuple[np.ndarray, np.ndarray]:
    """Mean radiance [3] of the pixels and its standard error, the field's of few samples; nan where it is refused."""
    how["spp"] = min(how["spp"], 2) if how["integrator"] == "field" else how["spp"]
    try:
        return radiance(scene, parts, layer, **how)
    except InputError:
        return np.full(3, np.nan), np.full(3, np.nan)


def off(mean, truth) -> float:
    """Largest relative error over the channels; nan stays nan."""
    return float(np.max(np.abs(np.asarray(mean, float) - truth) / np.abs(truth)))


truth_of = cache(single_scattering)
"""Single scattering by adaptive quadrature in float64, each case once."""


def run(kernel, inputs, shape, dtype=float) -> np.ndarray:
    """What a kernel with one output writes, on the CPU; inputs that are numpy arrays become arrays of floats."""
    inputs = [wp.array(x, dtype=float, device="cpu") if isinstance(x, np.ndarray) else x for x in inputs]
    result = wp.zeros(shape, dtype=dtype, device="cpu")
    wp.launch(kernel, dim=shape, inputs=inputs, outputs=[result], device="cpu")
    return result.numpy()
