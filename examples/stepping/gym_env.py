"""A gymnasium environment: hold a waypoint in turbulent water, by the force of the thrusters, ten times per second.

After `pip install gymnasium` run it by `python examples/stepping/gym_env.py`.
"""

import sys

import numpy as np

import varos_warp as vw

try:
    import gymnasium
    from gymnasium.utils.env_checker import check_env
except ImportError:
    sys.exit("This example needs gymnasium: pip install gymnasium")

TICKS, MAX_FORCE, REACH_M = 20, 40.0, 5.0
SENSORS = {"cameras": [{"id": "M0"}], "imu": {"rate_hz": 200}, "depth_gauge": {"rate_hz": 10}}
SCENE = {
    "name": "hold_station",
    "current": {"velocity": [0.1, 0, 0], "turbulence": {"rms": [0.06, 0.06, 0.04]}},
    "vehicle": {"mass_kg": 12, "max_force": MAX_FORCE, **SENSORS},
    "surface_depth_m": 10,
    "trajectory": {"waypoints": [{"position": [0, 0, 0]}], "duration_s": 10},
}


class HoldStation(gymnasium.Env):
    """Action: a force [3] by the largest.

    Observation: way to the waypoint [m], velocity [m/s], specific force [m/s^2] of the IMU
    (its mean since the last one), all [3] in vehicle axes, and the depth that the gauge read last [m].
    """

    action_space = gymnasium.spaces.Box(-1.0, 1.0, (3,), np.float32)
    observation_space = gymnasium.spaces.Box(-100.0, 100.0, (10,), np.float32)

    def __init__(self, scene: vw.Scene):
        self.simulator = vw.Simulator(scene)

    def reset(self, *, seed=None, options=None):
        """Begin again, in other water each time."""
        super().reset(seed=seed)
        state = self.simulator.reset(seed=int(self.np_random.integers(2**31)))
        self.depth = state.depth_gauge.depth[-1]
        return self._observation([state]), {}

    def step(self, action):
        """Hold a force for a tenth of a second; the reward is the negative distance."""
        states = [self.simulator.step(force=MAX_FORCE * np.asarray(action, float)) for _ in range(TICKS)]
        distance = float(np.linalg.norm(states[-1].position - states[-1].reference_position))
        lost, over, info = distance > REACH_M, self.simulator.finished, {"T_w_v": self.simulator.pose}
        return self._observation(states), -distance, lost, over, info

    def _observation(self, states: list[vw.Step]) -> np.ndarray:
        last, R_v_w = states[-1], states[-1].T_w_v[:3, :3].T
        self.depth = np.append(self.depth, np.concatenate([state.depth_gauge.depth for state in states]))[-1]
        felt = np.concatenate([state.imu.acceleration for state in states]).mean(axis=0)
        way = R_v_w @ (last.reference_position - last.position)
        return np.float32([*way, *(R_v_w @ last.velocity), *felt, self.depth])


def main() -> int:
    """Check the environment, and hold the vehicle by a simple law; 0 if it stays within 10 cm on average."""
    env = HoldStation(vw.Scene(**SCENE))
    check_env(env, skip_render_check=True)
    (seen, _), done, rewards = env.reset(seed=1), False, []
    while not done:
        seen, reward, lost, over, _ = env.step(np.clip(2.0 * seen[:3] - 1.5 * seen[3:6], -1, 1))
        done, rewards = lost or over, [*rewards, reward]
    print(f"{len(rewards)} steps, {-np.mean(rewards):.3f} m from the waypoint on average")
    return 0 if -np.mean(rewards) < 0.1 else 1


if __name__ == "__main__":
    sys.exit(main())
