"""Distances along rays and effective attenuation of a dataset's frames."""

import numpy as np
import pytest

from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.produce import produce
from varos_warp.errors import InputError
from varos_warp.scene.file.load import scene_from_dict

C = np.array([0.5, 0.2, 0.1])
RGB = {"water": {"coefficients": {"sigma_a": (0.9 * C).tolist(), "sigma_s": (0.1 * C).tolist()}}}
BANDS = {"water": {"spectral": {"jerlov": "IB"}}}
PORT = {"port": {"kind": "flat", "distance_m": 0.05, "thickness_m": 0.01, "n_glass": 1.49}}


@pytest.fixture(autouse=True)
def stand_ins():
    """None here: images are the package's own."""


def dataset(folder, water, camera=None, **render):
    """Of a sea floor from 1 m below to 30 m ahead, where D ends at 12 m; the upper rows see nothing."""
    spectral = "spectral" in water["water"]
    light = {"spectrum": "led_b4", "power_W": 80.0} if spectral else {"intensity": [50, 50, 50]}
    view = {"id": "M0", "resolution": [48, 27], **({"response": "nikon_5100"} if spectral else {})} | (camera or {})
    scene = scene_from_dict(
        {
            **water,
            "terrain": {"kind": "procedural", "size_m": 60, "resolution": 65, "relief_m": 0.3},
            "vehicle": {"lights": [light], "cameras": [view]},
            "trajectory": {"poses": [{"position": [0, 0, 1.2], "rotation_euler_deg": [-10, 0, 0]}]},
            "render": {"outputs": ["D", "T"], "depth_range_m": [0, 12]} | render,
        },
        folder,
    )
    produce(scene, folder / "out", device="cpu", quiet=True)
    return Dataset(folder / "out")[0]


@pytest.mark.parametrize("camera", [{}, PORT], ids=["pinhole", "port"])
@pytest.mark.parametrize("kind", ["z", "range"])
def test_in_three_channels_it_is_the_extinction_within_the_steps_of_d(tmp_path, camera, kind):
    frame = dataset(tmp_path, RGB, camera, depth_kind=kind)
    seen = np.isfinite(frame.D)
    assert 0.3 < seen.mean() < 0.95
    r = frame.range[seen][:, None]
    step = 12.0 / 65535 * (1.0 if kind == "range" else 1.5)  # rays at the edge are 1.3 times as long as their depth
    assert (np.abs(frame.effective_attenuation[seen] / C - 1.0) < 0.51 * step / r + 2e-6).all()
    assert np.isnan(frame.effective_attenuation[~seen]).all()
    assert np.isinf(frame.range[~seen]).all()


@pytest.mark.parametrize("camera", [{}, PORT], ids=["pinhole", "port"])
def test_with_distances_in_metres_it_is_exact_also_where_d_ends(tmp_path, camera):
    frame = dataset(tmp_path, RGB, camera, depth_exr=True)
    hit = (frame.T > 0.0).all(axis=-1)
    assert hit.sum() > np.isfinite(frame.D).sum()
    np.testing.assert_allclose(frame.effective_attenuation[hit], np.broadcast_to(C, (hit.sum(), 3)), rtol=3e-6)
    assert np.isnan(frame.effective_attenuation[~hit]).all()


def test_by_wavelength_it_falls_with_the_distance_in_every_channel(tmp_path):
    frame = dataset(tmp_path, BANDS, depth_exr=True)
    hit = (frame.T > 0.0).all(axis=-1)
    by_distance = frame.effective_attenuation[hit][np.argsort(frame.range[hit])]
    assert (np.diff(by_distance, axis=0) < 1e-6).all()
    assert (by_distance[-1] < [0.9, 0.99, 1.0] * by_distance[0]).all()


@pytest.mark.parametrize(("outputs", "lacks"), [(["D"], "no T"), (["T"], "no D"), (["S"], "no T and no D")])
def test_without_its_images_it_is_refused(tmp_path, outputs, lacks):
    frame = dataset(tmp_path, RGB, outputs=outputs)
    with pytest.raises(InputError, match=f"needs images T and D, and there is {lacks}.*render.outputs"):
        _ = frame.effective_attenuation
