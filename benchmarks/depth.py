"""Image D of one scene with meshes of several levels of detail: error against triangles and time."""

from collections.abc import Callable

from benchmarks import level_of_detail
from benchmarks.machine import Budget
from benchmarks.scenes import BenchScene
from benchmarks.store import Store

LEVELS = ((0.5, 1.0), (4.0, None), (1.0, None), (2.0, None), (8.0, None), (0.5, None), (0.25, None), (4.0, 1.0))
"""tolerance_px and depth_steps, the ones that tell most first."""


def compare(bench: BenchScene, device: str, seconds: float, store: Store, tell: Callable[[str], None],
            quick: bool = False) -> None:
    """Reduce the meshes of a scene level by level until the time is up, and store a row for each."""
    clock, last, poses = Budget(device), 0.0, [bench.T_w_v]
    store.add("D", _row(bench, level_of_detail.exact_level(bench.scene, bench.parts, poses, device, bench.T_w_v)))
    for pixels, steps in LEVELS[:2] if quick else LEVELS:
        if clock.seconds + last > seconds:
            tell(f"{bench.name}: no time was left for more levels of detail")
            return
        before = clock.seconds
        found = level_of_detail.level(bench.with_changes, bench.parts, poses, device, pixels, steps, bench.T_w_v)
        last = clock.seconds - before
        row = _row(bench, found)
        store.add("D", row)
        tell(f"{bench.name}: {pixels:g} px, {row['triangles']} triangles, D is {row['rms_mm']:.3g} mm off (rms)")


def _row(bench: BenchScene, found: dict) -> dict:
    """A flat row; errors of the exact meshes are zero."""
    depth, normal, seconds = found.get("depth", {}), found.get("normal_deg", {}), found["seconds"]
    return {"scene": bench.name, "tolerance_px": found["tolerance_px"], "depth_steps": found.get("depth_steps"),
            "triangles": found["triangles"], "memory_mb": found["memory_mb"],
            **{key: depth.get(key, 0.0) for key in ("rms_mm", "p95_mm", "rms_steps", "p95_steps", "outline_share")},
            "normal_rms_deg": normal.get("rms", 0.0), "seconds_cd": seconds["CD"], "seconds_a": seconds["A"],
            "reducing_cpu_seconds": found.get("reducing_cpu_seconds", 0.0)}
