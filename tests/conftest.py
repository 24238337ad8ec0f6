"""For all tests: those that need a GPU are skipped where there is none, and numpy's global generator is seeded."""

import gc
import os
import sys
from functools import cache
from pathlib import Path

# tests run side by side: threads that multiply small matrices would only wait for each other
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# what is compiled is kept: by workers the tests, by the processes that tests start the package
os.environ["PYTHONDONTWRITEBYTECODE"] = ""

import numpy as np
import pytest

sys.dont_write_bytecode = False

pytest_plugins = ["truths", "readers", "pytester"]


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """What is collected stays: to search it for garbage again and again takes a second of each worker."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()


def pytest_collection_finish():
    """Thousands of tests live to the end: the search for garbage leaves them out, and is as rare as in commands."""
    from varos_warp.cli import SEARCHED

    gc.collect()
    gc.freeze()
    gc.set_threshold(*SEARCHED)


@cache
def has_cuda() -> bool:
    import warp as wp

    return wp.is_cuda_available()


def pytest_collection_modifyitems(items):
    """Skip what is marked ``gpu`` where Warp finds no CUDA device; Warp is loaded only if there is such a test."""
    for item in items:
        if item.get_closest_marker("gpu") and not has_cuda():
            item.add_marker(pytest.mark.skip(reason="no CUDA device"))


@pytest.fixture(autouse=True)
def seeded():
    """A test that draws from the global generator does so alike in every order and selection of tests."""
    np.random.seed(1)  # noqa: NPY002


WHOLE_FIELD = {"physics", "field", "test_media_limits.py", "test_lamp_limits.py", "test_plan.py"}
"""Folders and files of tests that hold the field against what is known otherwise."""
ANY_FIELD = {
    "dataset",
    "test_end_to_end.py",
    "test_examples.py",
    "test_notebooks.py",
    "test_publish_example.py",
    "test_unlike_scenes.py",
}
"""Folders and files of tests to which its values do not matter."""
TESTS = Path(__file__).parent


@pytest.fixture(autouse=True, scope="module")
def small_field(request):
    """Elsewhere the field has fewer nodes (fields.py)."""
    parts = {*request.path.relative_to(TESTS).parts}
    if parts & WHOLE_FIELD:
        yield
        return
    from fields import SMALL_FIELD, TINY_FIELD, with_fewer_nodes

    with pytest.MonkeyPatch.context() as patch:
        with_fewer_nodes(patch, TINY_FIELD if parts & ANY_FIELD else SMALL_FIELD)
        yield


@pytest.fixture
def few_nodes(monkeypatch):
    """The same for one test of these."""
    from fields import with_fewer_nodes

    with_fewer_nodes(monkeypatch)


@pytest.fixture
def any_field(monkeypatch):
    """Fields of next to no nodes, for a test to which their values do not matter."""
    from fields import TINY_FIELD, with_fewer_nodes

    with_fewer_nodes(monkeypatch, TINY_FIELD)


@pytest.fixture
def few_bodies(monkeypatch, cache_of_its_own):
    """How many bodies find room in clumps is found by next to none, for a test to which how many grow does not matter.

    What grows is kept in a cache that all such tests share, apart: others are not to find it.
    """
    from varos_warp.scene.geometry.growth import room

    monkeypatch.setattr(room, "BODIES", 1000)
    monkeypatch.setenv("VAROS_WARP_CACHE", str(cache_of_its_own.with_name("cache_of_few_bodies")))
    for found in (room.filling, room.left_of):
        found.cache_clear()
    yield
    for found in (room.filling, room.left_of):
        found.cache_clear()


@pytest.fixture(autouse=True, scope="session")
def cache_of_its_own(tmp_path_factory):
    """Fields are solved for this run, once for all its processes, not found where a user or another run left them."""
    base = tmp_path_factory.getbasetemp()
    run = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("VAROS_WARP_CACHE", str(run / "cache"))
        yield run / "cache"
