"""Phase functions as sums of those that other renderers have.

Three are used: Henyey and Greenstein's, Fournier and Forand's, and Rayleigh's without depolarisation,
3 (1 + cos^2) / (16 pi). Cycles has all of them; Mitsuba has no Fournier-Forand.

Cycles' Fournier-Forand (kernel/closure/volume_util.h) is the same formula of 1999. Its IOR is the index of the
particles relative to the water, our n, not that of a material; it takes no mu, but the backscatter fraction B, and
inverts B(n, mu) = 1 - [1 - d^(nu+1) - (1 - d^nu)/2] / ((1 - d) d^nu), d = 2 / (3 (n-1)^2), nu = (3 - mu)/2, to
nu = -log(1 + 2 B (d - 1)) / log(d). So B of our n and mu recovers mu. B alone, our ``backscatter_fraction``, selects
from the family of Mobley, Sundman and Boss (2002), which Cycles does not know: there the same B with another IOR is
another function.
"""

from dataclasses import replace

from benchmarks.peers.view import FOURNIER_FORAND, HENYEY_GREENSTEIN, RAYLEIGH, Lobe
from varos_warp.errors import InputError
from varos_warp.scene.water.phase.fournier_forand import FournierForand
from varos_warp.scene.water.phase.henyey_greenstein import HenyeyGreenstein
from varos_warp.scene.water.phase.mixture import Mixture
from varos_warp.scene.water.phase.phase_function import PhaseFunction
from varos_warp.scene.water.phase.rayleigh import Rayleigh

RAYLEIGH_MOMENT = 0.1
"""Second Legendre moment of 3 (1 + cos^2) / (16 pi); that of a constant is 0."""
LEAST_EXCESS, MOST_BACKSCATTER = 1e-3, 0.499
"""Bounds to which Cycles clamps n - 1 and B without a word."""


def lobes_of(phase: PhaseFunction) -> tuple[Lobe, ...]:
    """A phase function as a sum of lobes, exactly; refuses a table, or parameters that Cycles would clamp."""
    if isinstance(phase, HenyeyGreenstein):
        return (Lobe(1.0, HENYEY_GREENSTEIN, g=phase.g),)
    if isinstance(phase, FournierForand):
        return (_fournier_forand(phase),)
    if isinstance(phase, Rayleigh):
        # 1 + a cos^2 with a < 1: depolarisation adds light that goes everywhere
        share = float(phase.moments(2)[2]) / RAYLEIGH_MOMENT
        return (Lobe(share, RAYLEIGH), Lobe(1.0 - share, HENYEY_GREENSTEIN))
    if isinstance(phase, Mixture):
        return tuple(
            replace(lobe, weight=weight * lobe.weight)
            for weight, part in phase.parts
            if weight > 0.0
            for lobe in lobes_of(part)
        )
    raise InputError(
        f"another renderer cannot be given the phase function {phase.kind}",
        key="water.phase",
        remedy="Henyey-Greenstein, Fournier-Forand, Rayleigh and mixtures of them compare.",
    )


def _fournier_forand(phase):
    n, backscatter = phase.n, phase.backscatter_fraction
    if n - 1.0 < LEAST_EXCESS or backscatter > MOST_BACKSCATTER:
        raise InputError(
            "Cycles takes no Fournier-Forand with n below 1.001 or B above 0.499",
            key="water.phase",
            value=f"n = {n:g}, B = {backscatter:g}",
            remedy="Use another n and mu.",
        )
    return Lobe(1.0, FOURNIER_FORAND, n=n, backscatter=backscatter)
