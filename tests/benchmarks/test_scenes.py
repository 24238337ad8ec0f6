"""The references that come with the checkout belong to the scenes as they are."""

import json

import numpy as np
import pytest

from benchmarks.scenes import REFERENCES, SCENES, _depends_on, references


@pytest.mark.parametrize("name", [name for name in SCENES if name != "ref1"])
def test_the_reference_that_comes_along_is_that_of_the_scene(name):
    """If this fails, a scene or its meshes changed: `python -m benchmarks.scenes NAME --device cuda:0`."""
    with np.load(REFERENCES / f"{name}_full.npz") as file:
        assert json.loads(str(file["depends_on"])) == _depends_on(SCENES[name])
        assert np.isfinite(file["mean"]).all()
        assert file["mean"].shape == file["stderr"].shape == (90, 160, 3)


def test_ref1_has_both_references():
    known = references(SCENES["ref1"], "cpu")
    assert set(known) == {"full", "single"}
    # what direct light and single scattering leave out is a fifth, and more than the noise of both
    ratio = known["single"].mean.mean(axis=(0, 1)) / known["full"].mean.mean(axis=(0, 1))
    np.testing.assert_allclose(ratio, [0.945, 0.880, 0.804], atol=0.005)
