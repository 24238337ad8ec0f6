"""What a sweep will take, before any image of it is made, by what others took (`varos_warp.dataset.run.expect`)."""

from typing import Any

from varos_warp.dataset.run.expect import dataset_facts
from varos_warp.dataset.run.shared import Shared
from varos_warp.dataset.run.steps import simulated
from varos_warp.dataset.sweep.run import Sweep
from varos_warp.scene.description import Scene
from varos_warp.sim.clock import select


def costs(sweep: Sweep, quiet: bool = False) -> list[dict[str, Any]]:
    """What is made for each dataset of a sweep, what it has from others, and how long that takes.

    For each, in the order of the work: ``folder``, ``overrides``, ``state``, ``renders`` and ``from``, letters of
    images that are rendered in all frames, and by the folder that they come from; the number of ``images`` that are
    rendered, ``seconds`` on the device at hand.
    """
    told, shared = [], Shared()
    for unit in sweep.units:
        if sweep.manifest.is_complete(unit):
            told.append(_entry(sweep, unit, "complete", [], {}, 0, 0.0))
            continue
        scene = shared.suited(unit.scene)
        if shared.simulation is None:
            shared.simulation = simulated(scene, quiet)
        count = len(select(sweep.manifest.frames, len(shared.simulation.frames)))
        donors = sweep.donors(unit)
        renders = [letter for letter in scene.render.outputs if letter not in donors]
        took: dict[str, list[str]] = {}
        for letter, donor in donors.items():
            took.setdefault(sweep.manifest.folder_of(donor), []).append(letter)
        views = len(scene.vehicle.cameras)
        told.append(
            _entry(
                sweep,
                unit,
                "begun" if unit.layout.metadata.exists() else "missing",
                renders,
                took,
                views * (count * len(renders) + len(donors)),
                _seconds(scene, renders, count, bool(donors)),
            )
        )
    return told


def _entry(sweep: Sweep, unit, state: str, renders: list[str], took: dict, images: int, seconds: float) -> dict:
    return {
        "folder": sweep.manifest.folder_of(unit),
        "overrides": unit.version.overrides,
        "state": state,
        "renders": renders,
        "from": took,
        "images": images,
        "seconds": round(seconds, 1),
    }


def _seconds(scene: Scene, letters: list[str], frames: int, loaded: bool) -> float:
    """Seconds to make these images; where something is there from before, nothing is compiled."""
    if not letters:
        return 0.0
    facts = dataset_facts(
        scene.model_copy(update={"render": scene.render.model_copy(update={"outputs": letters})}), frames
    )
    return facts["seconds"] - loaded * facts["compile_seconds"]
