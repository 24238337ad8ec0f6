"""Warnings point at the line of the user's that led to them, not at one inside the package."""

import warnings

import numpy as np
import pytest

from varos_warp.cache import cached
from varos_warp.products.images.radiance import to_half
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.description import Scene


def test_however_deep_the_reason_lies(tmp_path):
    (tmp_path / "file").write_text("not a folder")
    with pytest.warns(UserWarning, match="not kept") as told:
        cached("light", {}, lambda: {"a": np.zeros(1)}, tmp_path / "file" / "below")
    with pytest.warns(UserWarning, match="darker") as told_too:
        to_half(np.full((2, 2, 3), 1e-6))
    assert {warning.filename for warning in (*told, *told_too)} == {__file__}


def test_of_lost_samples_through_all_the_steps_of_a_frame():
    """A boulder under a light so strong, past the checks of a scene file, that its radiance is no number."""
    scene = Scene(
        trajectory={"poses": [{"position": [0, 0, 0]}]},
        vehicle={"lights": [{"kind": "point"}], "cameras": [{"resolution": [8, 8], "rotation_euler_deg": [-90, 0, 0]}]},
        objects=[{"kind": "boulder", "diameter": 0.4, "position": [0, 0, -0.4]}],
    )
    lights = [light.model_copy(update={"intensity": (3e38,) * 3}) for light in scene.vehicle.lights]
    scene = scene.model_copy(update={"vehicle": scene.vehicle.model_copy(update={"lights": lights})})
    renderer = FrameRenderer(scene, "cpu")
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        image = renderer.render(np.eye(4), outputs="A", spp=4).A
    told = [warning for warning in told if "count as black" in str(warning.message)]
    assert image.lost_samples
    assert [warning.filename for warning in told] == [__file__]
