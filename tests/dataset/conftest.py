"""The dataset is tested with stand-ins for what makes its contents."""

import shutil
from functools import cache

import pytest
import standins

from varos_warp.dataset.run.produce import produce


@pytest.fixture
def unchecked(tmp_path):
    """Makes a copy of a dataset without its checksums, so that only the checks of what it holds find a change."""

    def copy_of(dataset):
        copied = shutil.copytree(dataset, tmp_path / "copy")
        (copied / "checksums").unlink()
        return copied

    return copy_of


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
