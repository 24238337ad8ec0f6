"""Validation of what the simulation makes where differences and integrations are at their limits: it stays sound."""

import pytest

from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.validate import validate
from varos_warp.scene.file.load import scene_from_dict

FAR = (569_000.0, 7_034_000.0, -20.0)
"""UTM coordinates, where a float64 is good to a nanometre."""
NOISE = {
    "gyroscope_noise_density": 1.7e-4,
    "gyroscope_random_walk": 2e-5,
    "accelerometer_noise_density": 2e-3,
    "accelerometer_random_walk": 3e-3,
    "accelerometer_turn_on_bias": 0.1,
}


def course(**changes):
    vehicle = {
        "imu": {"position": [0.3, 0.2, -0.3], "rotation_euler_deg": [10, 20, 90]},
        "depth_gauge": {},
        "cameras": [{"id": "M0", "resolution": [64, 36]}],
    }
    return scene_from_dict(
        {"name": "course", "water": "none", "vehicle": vehicle, "render": {"outputs": ["D"]}} | changes
    )


def corners(**trajectory):
    """Exact poses that end at full speed."""
    poses = [
        {"time_s": 0, "position": [0, 0, 0]},
        {"time_s": 1, "position": [1, 0, 0], "rotation_euler_deg": [0, 0, 90]},
        {"time_s": 3, "position": [1, 3, 0], "rotation_euler_deg": [90, 0, 90]},
        {"time_s": 4, "position": [0, 3, 1]},
    ]
    return course(trajectory={"poses": poses, **trajectory})


def corners_and_a_stop():
    return corners(duration_s=7.0)


def far_away_with_noise():
    scene = standing_still().model_dump(mode="json")
    scene["vehicle"]["imu"] |= {"rate_hz": 100, "noise": NOISE}
    scene["vehicle"]["depth_gauge"] |= {"rate_hz": 40}
    x, y, z = FAR
    scene["trajectory"] = {
        "waypoints": [
            {"position": [x, y, z]},
            {"position": [x + 1, y + 1, z], "rotation_euler_deg": [0, 0, 90]},
            {"position": [x, y + 2, z - 1], "rotation_euler_deg": [-30, 0, 180]},
        ]
    }
    return scene_from_dict(scene)


def standing_still():
    return course(trajectory={"poses": [{"position": [0, 0, 0], "rotation_euler_deg": [90, 0, 0]}], "duration_s": 3.0})


def a_single_moment():
    return course(trajectory={"poses": [{"position": [0, 0, 0]}], "duration_s": 0.005})


@pytest.mark.parametrize("make", [corners, corners_and_a_stop, far_away_with_noise, standing_still, a_single_moment])
def test_a_simulated_course_is_sound(make, tmp_path):
    produce(make(), tmp_path / "out", images=False, quiet=True)
    result = validate(tmp_path / "out", quiet=True)
    assert result.problems == []
    integrated = [m for m in result.measures if "integrated" in m["name"]]
    assert bool(integrated) == (make is not a_single_moment)
