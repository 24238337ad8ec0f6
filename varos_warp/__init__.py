"""Realistic synthetic underwater video with exact ground truth. Importing this compiles nothing."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # what __getattr__ fetches, for type checkers and editors
    from varos_warp.dataset.reader.dataset import Dataset as Dataset
    from varos_warp.errors import InputError as InputError
    from varos_warp.render.moments import NextFrame as NextFrame
    from varos_warp.render.planner.plan import plan_render as plan_render
    from varos_warp.render.renderer import FrameRenderer as FrameRenderer
    from varos_warp.scene.description import Scene as Scene
    from varos_warp.scene.file.load import load_scene as load_scene
    from varos_warp.scene.water import phase_function as phase_function
    from varos_warp.sim.simulator import Simulator as Simulator
    from varos_warp.sim.simulator import Step as Step
    from varos_warp.sim.trajectory import simulate as simulate

__version__ = "0.8.0"

_HOMES = {
    "InputError": "varos_warp.errors",
    "Scene": "varos_warp.scene.description",
    "load_scene": "varos_warp.scene.file.load",
    "phase_function": "varos_warp.scene.water",
    "simulate": "varos_warp.sim.trajectory",
    "Simulator": "varos_warp.sim.simulator",
    "Step": "varos_warp.sim.simulator",
    "FrameRenderer": "varos_warp.render.renderer",
    "NextFrame": "varos_warp.render.moments",
    "plan_render": "varos_warp.render.planner.plan",
    "Dataset": "varos_warp.dataset.reader.dataset",
}
__all__ = sorted(_HOMES)  # noqa: PLE0605


def __getattr__(name: str) -> Any:
    """Fetch a public name from its module on first use, so that importing the package stays light."""
    if name not in _HOMES:
        raise AttributeError(f"module 'varos_warp' has no attribute '{name}'")
    return getattr(import_module(_HOMES[name]), name)
