"""What `info` expects of a scene: streaks of a course for which they are known."""

import numpy as np
import pytest

from varos_warp.dataset.run.expect import SAMPLE_S, USUAL_SPP, dataset_facts, exposure_facts
from varos_warp.render.planner.by_frame import FEWER, tried_frames
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.geometry.build import build_parts


@pytest.fixture
def scene():
    """A camera that looks down from 2 m and moves sideways by 0.5 m/s, one that stands, one without a shutter."""
    camera = {"resolution": [640, 360], "focal_mm": 3.4, "sensor_mm": [4.4, 2.475]}
    return scene_from_dict(
        {
            "terrain": {"kind": "procedural", "size_m": 10, "resolution": 33, "relief_m": 0.0},
            "vehicle": {
                "cameras": [
                    camera
                    | {
                        "id": "M0",
                        "rotation_euler_deg": [-90, 0, 0],
                        "exposure": {"time_s": 0.01, "readout_s": 0.03},
                    },
                    camera | {"id": "O0", "mount": "world", "position": [0, -3, 1], "exposure": {"time_s": 0.02}},
                    camera | {"id": "N0"},
                ]
            },
            "trajectory": {"poses": [{"time_s": 0, "position": [0, 0, 2]}, {"time_s": 1, "position": [0.5, 0, 2]}]},
            "render": {"frame_rate_hz": 5},
        }
    )


def test_the_longest_streak_is_speed_times_exposure_over_distance(scene, monkeypatch):
    monkeypatch.undo()  # the simulation itself
    from varos_warp.sim.trajectory import simulate

    simulation, parts = simulate(scene), build_parts(scene)
    speed = np.abs(simulation.frames.velocity[:, 0]).max()
    moving, standing = exposure_facts(scene, parts, simulation)
    focal = 3.4 / 4.4 * 640
    assert moving["streak_px"] == pytest.approx(focal * speed * 0.01 / 2.0, abs=0.02)
    assert moving["skew_px"] == pytest.approx(focal * speed * 0.03 / 2.0, abs=0.05)
    assert (moving["id"], moving["time_s"], moving["readout_s"]) == ("M0", 0.01, 0.03)
    assert standing == {"id": "O0", "time_s": 0.02, "readout_s": 0.0, "streak_px": 0.0, "skew_px": 0.0}


def test_planning_counts_the_views_that_are_tried_along_a_sequence():
    """Images of a small camera are tried whole, so that many frames differ from few by nothing else."""
    camera = {"id": "M0", "resolution": [320, 180]}
    lamp = {"kind": "spot", "position": [0, 0, 0.3], "intensity": [9, 9, 9]}
    vehicle = {"cameras": [camera], "lights": [lamp]}
    trajectory = {"poses": [{"position": [0, 0, 0]}]}
    scene = scene_from_dict({"vehicle": vehicle, "water": {"jerlov": {"type": "II"}}, "trajectory": trajectory})
    few, many = (dataset_facts(scene, frames) for frames in (20, 200))
    assert tried_frames(20, 1.0) == []
    samples = len(tried_frames(200, 1.0)) * 320 * 180 * USUAL_SPP * sum(1.0 / fewer for fewer in FEWER)
    seconds = samples * SAMPLE_S[few["device"]] / few["cores"]
    assert many["plan_seconds"] - few["plan_seconds"] == pytest.approx(seconds, rel=0.02)
