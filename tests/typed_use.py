"""How the public API is used, for the type checker: never run. tests/test_types.py breaks it line by line."""

from pathlib import Path

import numpy as np

import varos_warp as vw


def scene_to_image(path: Path) -> np.ndarray:
    """What the README shows."""
    scene = vw.load_scene(path, ["render.spp=4"])
    spp: float | None = scene.render.spp
    simulation = vw.simulate(scene)
    renderer = vw.FrameRenderer(scene, device="cpu")
    T_w_v = simulation.trajectory.T_w_v(0)
    plan = vw.plan_render(scene, renderer, [T_w_v], motion=simulation.motion)
    frame = renderer.render(T_w_v, camera="M0", outputs="ABCD", spp=spp or plan.spp)
    assert frame.A is not None
    radiance = frame.A.radiance
    assert radiance is not None
    return radiance


def way_stepped(scene: vw.Scene, seconds: float) -> np.ndarray:
    """Places of a vehicle that is pushed ahead as long as its altitude is more than a metre [N, 3] [m]."""
    simulator = vw.Simulator(scene)
    states: list[vw.Step] = [simulator.state]
    while simulator.time_ns < 1e9 * seconds and not simulator.finished:
        dvl = states[-1].dvl
        near = dvl is not None and bool((dvl.altitude < 1.0).any())
        states.append(simulator.step() if near else simulator.step(force=(0.0, 5.0, 0.0)))
    return np.array([state.position for state in states])


def lowest(scene: vw.Scene) -> float:
    """Of what an altimeter reads at the start [m]."""
    altimeter = vw.Simulator(scene).state.altimeter
    return float("nan") if altimeter is None else float(np.nanmin(altimeter.range))


def disparity(renderer: vw.FrameRenderer, T_w_v: np.ndarray) -> np.ndarray | None:
    """Of a stereo pair [pixels]."""
    flow = renderer.render(T_w_v, "L0", "F", following=vw.NextFrame(T_w_v, camera="R0")).F
    return None if flow is None else -flow.flow[..., 0]


def dataset_to_arrays(path: Path) -> list[np.ndarray]:
    """Reading back."""
    data = vw.Dataset(path)
    first, several = data[0], data[2:4]
    number: int = first.number
    names: tuple[str, ...] = data.cameras
    assert number in data.frames
    assert names
    return [first.A, *(frame.D for frame in several)]


def scattering_ahead(scene: vw.Scene) -> float:
    """Of the phase function, straight on [1/sr]."""
    return float(vw.phase_function(scene).eval(np.array([1.0]))[0])


def refuse(error: vw.InputError) -> str:
    """What went wrong, in one line."""
    return error.message
