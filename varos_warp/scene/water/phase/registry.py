"""The phase functions of scene files, by kind."""

from collections.abc import Callable
from pathlib import Path

from varos_warp.scene.water.phase.fournier_forand import FournierForand
from varos_warp.scene.water.phase.henyey_greenstein import HenyeyGreenstein
from varos_warp.scene.water.phase.mixture import Mixture
from varos_warp.scene.water.phase.petzold import Petzold
from varos_warp.scene.water.phase.phase_function import Origin, PhaseFunction
from varos_warp.scene.water.phase.rayleigh import Rayleigh
from varos_warp.scene.water.phase.tabulated import Tabulated

PHASE_FUNCTIONS: dict[str, type[PhaseFunction]] = {made.kind: made for made in (
    HenyeyGreenstein,
    FournierForand,
    Petzold,
    Rayleigh,
    Tabulated,
    Mixture,
)}


def make_phase(block, resolve: Callable[[str], Path] = Path, key: str = "phase") -> PhaseFunction:
    """The phase function that a block of the scene file describes.

    Args:
        block: One of scene/description/phase.py.
        resolve: Finds a file that the block names.
        key: Where the block stands, for messages.

    Raises:
        InputError: A file that it names cannot be used.
    """
    return _make(block, Origin(key, resolve, _make))


def _make(block, origin: Origin) -> PhaseFunction:
    return PHASE_FUNCTIONS[block.kind].from_block(block, origin)
