"""Tests that need a package of the extra ``readers``: skipped where it is not installed, unless all are asked for.

`make test` asks for all with ``--readers``, so that nothing is left out there without a word.
"""

import pytest

PACKAGES = {
    "DracoPy",
    "allantools",
    "axe_playwright_python",
    "collada",
    "colour",
    "cv2",
    "evo",
    "gtsam",
    "gymnasium",
    "imagecodecs",
    "ipykernel",
    "laspy",
    "lazrs",
    "mcap",
    "mcap_ros2",
    "meshio",
    "mitsuba",
    "mkdocs",
    "mkdocstrings",
    "mlcroissant",
    "nbclient",
    "nerfbaselines",
    "pandas",
    "playwright",
    "pycocotools",
    "pycolmap",
    "pygltflib",
    "pykitti",
    "rasterio",
    "rerun",
    "rosbags",
    "tqdm",
}


def pytest_addoption(parser):
    parser.addoption("--readers", action="store_true", help="a missing package of the extra readers is an error")


def missing_package(error: BaseException | None) -> str | None:
    """The reader that is not installed, if that is what an error comes from."""
    while error is not None:
        if isinstance(error, ModuleNotFoundError) and error.name and error.name.partition(".")[0] in PACKAGES:
            return error.name
        error = error.__cause__ or error.__context__
    return None


class Module(pytest.Module):
    """A file of tests that may import a reader."""

    def _getobj(self):
        try:
            return super()._getobj()
        except Exception as error:
            if name := missing_package(error):
                pytest.skip(f"{name} is not installed", allow_module_level=True)
            raise


def pytest_pycollect_makemodule(module_path, parent):
    return None if parent.config.getoption("--readers") else Module.from_parent(parent, path=module_path)


def _or_skipped(item):
    """Wraps a phase of a test: a reader that is missing there skips it."""
    try:
        return (yield)
    except Exception as error:
        name = None if item.config.getoption("--readers") else missing_package(error)
        if name is None:
            raise
        pytest.skip(f"{name} is not installed")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item):
    return (yield from _or_skipped(item))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    return (yield from _or_skipped(item))
