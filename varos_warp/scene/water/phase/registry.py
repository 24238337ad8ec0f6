"""The phase functions of scene files, by kind."""

from collections.abc import Callable
from pathlib import Path

from varos_warp.scene.water.phase.fournier_forand import FournierForand
from varos_warp.scene.water.phase.henyey_greenstein import HenyeyGreenstein
from varos_warp.scene.water.phase.mixture import Mixture
from varos_warp.scene.water.phase.petzold import Petzold
from varos_warp.scene.water.phase.phase_function import PhaseFunction
from varos_warp.scene.water.phase.rayleigh import Rayleigh
from varos_warp.scene.water.phase.tabulated import Tabulated, read_table


def make_phase(block, resolve: Callable[[str], Path] = Path, key: str = "phase") -> PhaseFunction:
    """The phase function that a block of the scene file describes.

    Raises:
        InputError: A file that it names cannot be used.
    """
    return PHASE_FUNCTIONS[block.kind](block, resolve, key)


def _fournier_forand(block, resolve, key):
    if block.backscatter_fraction is not None:
        return FournierForand.from_backscatter_fraction(block.backscatter_fraction)
    return FournierForand(block.n, block.mu)


def _tabulated(block, resolve, key):
    path = resolve(block.file)
    return Tabulated(*read_table(path, f"{key}.file"), name=path.name)


def _mixture(block, resolve, key):
    return Mixture([(part.weight, make_phase(part, resolve, f"{key}.of.{i}")) for i, part in enumerate(block.of)])


PHASE_FUNCTIONS: dict[str, Callable[..., PhaseFunction]] = {
    HenyeyGreenstein.kind: lambda block, resolve, key: HenyeyGreenstein(block.g),
    FournierForand.kind: _fournier_forand,
    Petzold.kind: lambda block, resolve, key: Petzold(),
    Rayleigh.kind: lambda block, resolve, key: Rayleigh(),
    Tabulated.kind: _tabulated,
    Mixture.kind: _mixture,
}
"""What makes each kind of the arguments of `make_phase`."""
