"""The dataset is tested with stand-ins for what makes its contents."""

import shutil
from functools import cache
from multiprocessing import get_all_start_methods, get_context

import pytest
import standins

from varos_warp.dataset.run import workers
from varos_warp.dataset.run.produce import produce

READY = [
    "pytest",
    "varos_warp.dataset.sweep.run",
    "varos_warp.dataset.report",
    "varos_warp.render.renderer",
    "varos_warp.render.planner.plan",
    "varos_warp.sim.trajectory",
    "benchmarks.soak",
    "PIL.PngImagePlugin",
    "standins",
]
"""What processes that share nothing with others have imported when they start."""


@pytest.fixture
def unchecked(tmp_path):
    """Makes a copy of a dataset without its checksums, so that only the checks of what it holds find a change."""

    def copy_of(dataset):
        copied = shutil.copytree(dataset, tmp_path / "copy")
        (copied / "checksums").unlink()
        return copied

    return copy_of


@pytest.fixture(scope="session")
def processes():
    """Makes processes that share nothing with other ones; they are forks of one that imports, once, and does no more.

    They do not see what tests change in the environment.
    """
    context = get_context("forkserver" if "forkserver" in get_all_start_methods() else "spawn")
    if context.get_start_method() == "forkserver":
        context.set_forkserver_preload(READY)
    return context


@pytest.fixture
def ready_workers(monkeypatch, processes):
    """Workers of a run start in a tenth of a second, not after three of imports, as those of users do.

    That these start at all is for tests of the command line and of tables.
    """
    monkeypatch.setattr(workers, "_context", processes)


@pytest.fixture(autouse=True)
def stand_ins(monkeypatch):
    """Flat floor, exact course: see standins.py."""
    standins.install(monkeypatch)


@pytest.fixture(scope="session")
def written(tmp_path_factory):
    """A complete dataset; read it, do not change it."""
    out = tmp_path_factory.mktemp("dataset")
    with pytest.MonkeyPatch.context() as patch:
        standins.install(patch)
        produce(standins.make_scene(), out, quiet=True)
    return out


@pytest.fixture(scope="session")
def hills(tmp_path_factory):
    """Complete datasets of one camera over hills, by their images; read them, do not change them."""
    from hills import HillsRenderer, hills_scene

    @cache
    def of(images):
        out = tmp_path_factory.mktemp("hills")
        with pytest.MonkeyPatch.context() as patch:
            standins.install(patch)
            scene = hills_scene(images)
            produce(scene, out, quiet=True, renderer=HillsRenderer(scene))
        return out

    return of


@pytest.fixture(scope="session")
def hilly(hills):
    """The one with A to D and S."""
    return hills("ABCDS")
