"""Realistic synthetic underwater video with exact ground truth. Importing this compiles nothing."""

from importlib import import_module

__version__ = "0.3.0"

_HOMES = {
    "InputError": "varos_warp.errors",
    "Scene": "varos_warp.scene.description",
    "load_scene": "varos_warp.scene.load",
    "phase_function": "varos_warp.scene.water",
    "simulate": "varos_warp.sim.trajectory",
    "FrameRenderer": "varos_warp.render.renderer",
    "plan_render": "varos_warp.render.planner.plan",
    "Dataset": "varos_warp.dataset.reader.dataset",
}
__all__ = sorted(_HOMES)  # noqa: PLE0605


def __getattr__(name: str):
    """Fetch a public name from its module on first use, so that importing the package stays light."""
    if name not in _HOMES:
        raise AttributeError(f"module 'varos_warp' has no attribute '{name}'")
    return getattr(import_module(_HOMES[name]), name)
