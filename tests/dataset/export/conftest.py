"""Every format, exported once from a dataset without noise, and some from one with noise."""

import importlib
import os
import warnings
from types import SimpleNamespace

import pytest

from varos_warp.dataset.export import FORMATS, LABELS, export
from varos_warp.dataset.noise_pass import add_noise
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.scene.description.noise_profile import NoiseProfile

PROFILE = {
    "name": "test",
    "imu": {
        "accelerometer_noise_density": 4e-3,
        "gyroscope_noise_density": 2e-4,
        "gyroscope_random_walk": 3e-5,
        "accelerometer_bias": [0.3, 0.0, -0.1],
    },
    "depth_gauge": {"noise_density": 0.01},
    "camera": {"electrons_per_dn": 2.0, "read_noise_electrons": 4.0},
}


@pytest.fixture(scope="session")
def data(written):
    return Dataset(written)


@pytest.fixture(scope="session")
def out(written, tmp_path_factory):
    """An export in each format but those of labels and of boards, by name."""
    root = tmp_path_factory.mktemp("exports")
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "tum holds one camera")
        for name in [name for name in FORMATS if name not in (*LABELS, "corners")]:
            export(written, name, root / name)
    return root


@pytest.fixture(scope="session")
def noisy(written, tmp_path_factory):
    """The dataset with the noise of a profile of all sensors."""
    return add_noise(written, NoiseProfile(**PROFILE), tmp_path_factory.mktemp("noisy") / "data", seed=5, quiet=True)


@pytest.fixture(scope="session")
def nerfbaselines():
    """Its loaders of COLMAP and nerfstudio, by ``load(path, *features, split)``.

    It asks for numpy < 2, for some of its methods, so `make test` installs it without its dependencies.
    """
    if not os.environ.get("CI"):
        pytest.importorskip("nerfbaselines.datasets")
    module = importlib.import_module("nerfbaselines.datasets")
    return SimpleNamespace(
        load=lambda path, *features, split="train": module.load_dataset(str(path), split, features=frozenset(features))
    )


@pytest.fixture(scope="session")
def labelled(tmp_path_factory):
    """A dataset of things that hide each other, seen by three unlike cameras."""
    from silhouette_truth import SCENE

    from varos_warp.dataset.run.produce import produce
    from varos_warp.scene.file.load import scene_from_dict

    out = tmp_path_factory.mktemp("labelled") / "data"
    produce(scene_from_dict(SCENE), out, device="cpu", quiet=True)
    return Dataset(out)


@pytest.fixture(scope="session")
def labels_out(labelled, tmp_path_factory):
    """Exports of it in the formats of labels, by name; BOP has the straight cameras only."""
    root = tmp_path_factory.mktemp("labels")
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "the format knows no rolling shutter")
        for name in LABELS:
            export(labelled.root, name, root / name, "B", ["M0", "R0"] if name == "bop" else None)
    return root
