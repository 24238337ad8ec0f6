"""The level of detail of a sequence: meshes reduced by need, and what that changes in images C and D."""

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.ndimage import correlate1d, maximum_filter

from varos_warp.scene.description import LevelOfDetail, Scene
from varos_warp.scene.geometry.lod import Kept, depth_step, keep_parts, reduce_parts
from varos_warp.scene.geometry.parts import Instances, Part

PIXELS = 640 * 360
"""Most pixels of an image that is compared."""
EDGE = 0.05
"""Where 1 / z, which is linear on a plane, bends by more than this share of it from pixel to pixel is an outline: what
pixels hit there, before or behind, is decided by less than a pixel and tells nothing of the surface."""
BYTES = {False: 119, True: 165}
"""Device memory per triangle with its BVH, without and with normals for shading (measured: 524 288 triangles, CPU)."""


@dataclass(frozen=True)
class Detail:
    """What to render with."""

    parts: list[Part | Instances]
    meshes: dict[str, Any]
    """For the plan: ``level_of_detail`` (the block, or null), ``parts``, ``memory_mb``, ``depth_error`` ..."""


def choose_detail(scene: Scene, parts: Sequence[Part | Instances], poses: Sequence[np.ndarray], device: str = "cpu", *,
                  compare: bool = True, propose: bool = False, measure_cost: bool = False) -> Detail:
    """The parts to render with, as ``render.level_of_detail`` has it.

    Args:
        scene: The scene.
        parts: Its geometry, with every triangle.
        poses: T_w_v [4, 4] of every frame of the sequence.
        device: Where images are compared.
        compare: Whether to render C and D with both at a few frames, to measure the error made.
        propose: Where the level of detail is off, say what it would do; the parts are then those given, all the same.
        measure_cost: Also say how long rays take with both; nothing else depends on the machine.
    """
    detail = scene.render.level_of_detail
    if detail is None and not propose:
        return Detail(list(parts), _meshes(parts, parts, keep_parts(scene, parts, poses), None))
    made, kept = reduce_parts(scene, parts, poses, detail or LevelOfDetail())
    meshes = _meshes(parts, made, kept, detail)
    if compare and parts and any(part is not other for part, other in zip(parts, made, strict=True)):
        errors, seconds = compare_images(scene, parts, made, poses, device)
        meshes |= errors | ({"seconds_per_million_rays": seconds} if measure_cost else {})
    return Detail(made if detail is not None else list(parts), meshes)


def _meshes(given, made, kept: list[Kept], detail) -> dict[str, Any]:
    """What the plan says of the meshes."""
    state = {"level_of_detail": None if detail is None else detail.model_dump(),
             "triangles": sum(row.triangles for row in kept), "kept": sum(row.kept for row in kept),
             "memory_mb": {"given": _megabytes(given), "kept": _megabytes(made)}}
    return state | {"parts": [_rounded(asdict(row)) for row in kept]}


def _megabytes(parts) -> float:
    """Device memory of meshes [MB]."""
    smooth = any(part.smooth_shading for part in parts)
    return round(BYTES[smooth] * sum(len(part.faces) for part in parts) / 1e6, 2)


def _rounded(value):
    """Numbers to four digits, throughout."""
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(item) for item in value]
    return float(f"{value:.4g}") if isinstance(value, float) else value


# ------------------------------------------------------------------------------------------------------------- images


def compare_images(scene: Scene, given, made, poses, device: str) -> tuple[dict[str, Any], dict[str, float]]:
    """Errors of D and C at a few frames, through every camera, and seconds per million first hits.

    Returns:
        ``depth_error`` (``max_mm``, ``p95_mm``, ``rms_mm`` and the same in steps of D, ``step_mm``, the same again
        ``by_distance``, and the share of pixels at outlines, which do not count) and ``normal_error_deg`` (``rms``,
        ``p95``); and ``given`` and ``kept``.
    """
    from varos_warp.render.planner.pilot import pilot_camera, pilot_frames
    from varos_warp.render.renderer import FrameRenderer

    renderers = [FrameRenderer(scene, device, list(parts)) for parts in (given, made)]
    depths, turn, edges, rays, seconds = [], [], 0, 0, np.zeros(2)
    for frame in pilot_frames(len(poses)):
        for camera in scene.vehicle.cameras:
            view = pilot_camera(camera, PIXELS)
            images = []
            for which, renderer in enumerate(renderers):
                renderer.render(poses[frame], pilot_camera(camera, 64), "CD")  # compiles
                start = time.perf_counter()
                images.append(renderer.render(poses[frame], view, "CD"))
                seconds[which] += time.perf_counter() - start
            compared, outline = comparable(scene, *(image.D for image in images))
            depths.append(np.array([_depth(scene, image.D)[compared] for image in images], float))
            turn.append(_angles(*(image.C.normal[compared].astype(float) for image in images)))
            edges, rays = edges + np.count_nonzero(outline), rays + outline.size
    errors = {"depth_error": depth_error(*np.concatenate(depths, axis=1), depth_step(scene)) | {
        "outline_share": edges / rays, "frames": len(pilot_frames(len(poses)))}}
    turn = np.degrees(np.concatenate(turn))
    if len(turn):
        errors["normal_error_deg"] = {"rms": float(np.sqrt(np.mean(turn**2))), "p95": float(np.quantile(turn, 0.95))}
    given_s, kept_s = (1e6 * seconds / rays).tolist()
    return _rounded(errors), _rounded({"given": given_s, "kept": kept_s})


def depth_error(given: np.ndarray, made: np.ndarray, step: float) -> dict[str, Any]:
    """Largest, 95 % and RMS of differences between depths [N] [m], in mm and in steps of D; and by distance."""
    def statistics(chosen):
        shift = np.abs(made - given)[chosen]
        values = {"max": shift.max(), "p95": np.quantile(shift, 0.95), "rms": np.sqrt(np.mean(shift**2))}
        return {"pixels": len(shift)} | {f"{name}_mm": 1e3 * float(x) for name, x in values.items()} | {
            f"{name}_steps": float(x / step) for name, x in values.items()}

    if not len(given):
        return {"pixels": 0, "step_mm": 1e3 * step, "by_distance": []}
    octave = np.floor(np.log2(np.maximum(given, 1e-3))).astype(int)
    rows = [{"nearest_m": [2.0 ** float(k), 2.0 ** float(k + 1)]} | statistics(octave == k) for k in np.unique(octave)]
    return statistics(slice(None)) | {"step_mm": 1e3 * step, "by_distance": rows}


def comparable(scene: Scene, given, made) -> tuple[np.ndarray, np.ndarray]:
    """Pixels that hit the same surface within D's range in both images, and those at outlines, bool [H, W]."""
    far = scene.render.depth_range_m[1]
    outline = np.zeros(given.depth.shape, bool)
    for image in (given, made):
        inverse = 1.0 / image.depth
        bend = [np.abs(correlate1d(inverse, [1.0, -2.0, 1.0], axis)) for axis in (0, 1)]
        outline |= maximum_filter(np.maximum(*bend) > EDGE * inverse, 3)
    within = (_depth(scene, given) < far) & (_depth(scene, made) < far)
    return within & ~outline, within & outline


def _depth(scene, image):
    """What D holds."""
    return image.depth if scene.render.depth_kind == "z" else image.range


def _angles(n, m):
    """Angles [N] between unit vectors [N, 3]; well conditioned for small ones."""
    return 2.0 * np.arctan2(np.linalg.norm(n - m, axis=1), np.linalg.norm(n + m, axis=1))
