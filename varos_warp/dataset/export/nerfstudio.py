"""nerfstudio: transforms.json with OpenGL camera poses, images, depth in millimetres and points to begin with.

(https://docs.nerf.studio/quickstart/data_conventions.html) The parser turns and scales poses unless told not to:
``nerfstudio-data --orientation-method none --center-method none --auto-scale-poses False``.
"""

import numpy as np

from varos_warp.dataset import files
from varos_warp.dataset.export.shared.job import Job, lens_of
from varos_warp.dataset.export.shared.seed import seeds
from varos_warp.errors import InputError
from varos_warp.scene.description.image_types import DEPTH, WATER

IMAGES = WATER + DEPTH
PER_METRE = 1000.0
T_OPENCV_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
"""An OpenGL camera has y up and z backwards."""


def write(job: Job) -> None:
    """Write transforms.json; intrinsics stand once where all cameras share them, else at every frame."""
    models = [_intrinsics(job, camera) for camera in job.cameras]
    kinds = {model.pop("camera_model") for model in models}
    if len(kinds) > 1:
        raise InputError(
            "nerfstudio cannot state cameras with and without fisheye in one file",
            file=job.data.root,
            key="cameras",
            remedy="Choose some with --camera.",
        )
    shared = all(model == models[0] for model in models)
    frames = []
    for camera, model in zip(job.cameras, models, strict=True):
        job.link_images(camera, (f"images/{name}" for name in job.names(camera)))
        for name, T in zip(job.names(camera), job.data.views(camera)[1], strict=True):
            frames.append(
                {"file_path": f"images/{name}"}
                | ({} if shared else model)
                | ({"depth_file_path": f"depths/{name}"} if job.has_depth else {})
                | {"transform_matrix": (T @ T_OPENCV_OPENGL).tolist()}
            )
    head = {"camera_model": kinds.pop()} | (models[0] if shared else {}) | (_depth(job) if job.has_depth else {})
    files.write_json(job.out / "transforms.json", head | {"frames": frames})


def _intrinsics(job: Job, camera: str) -> dict:
    facts, pinhole = (
        job.data.camera(camera),
        zip(("fl_x", "fl_y", "cx", "cy"), job.fx_fy_cx_cy(camera, "center_half"), strict=True),
    )
    lens, k = lens_of(job, camera, "nerfstudio", "brown_conrady", "kannala_brandt")
    names = ("k1", "k2", "k3", "k4") if lens == "kannala_brandt" else ("k1", "k2", "p1", "p2", "k3")[: len(k) or 4]
    return {
        "camera_model": "OPENCV_FISHEYE" if lens == "kannala_brandt" else "OPENCV",
        **dict(pinhole),
        "w": facts["width"],
        "h": facts["height"],
        **dict(zip(names, k or [0.0] * 4, strict=True)),
    }


def _depth(job: Job) -> dict:
    """Write depth images and points.ply; what transforms.json says of them.

    ``near`` and ``far`` [m] along the camera's z are ours: the parser passes over them, a user may want them.
    """
    import trimesh

    found = [job.depths(camera, (f"depths/{name}" for name in job.names(camera)), PER_METRE) for camera in job.cameras]
    points = [seed for camera in job.cameras for seed in seeds(job, camera)]
    head = {"depth_unit_scale_factor": 1 / PER_METRE}
    if not any(len(seed.xyz) for seed in points):
        return head
    cloud = trimesh.PointCloud(
        np.concatenate([seed.xyz for seed in points]), np.concatenate([seed.rgb for seed in points])
    )
    files.write_bytes(job.out / "points.ply", cloud.export(file_type="ply"))
    return head | {
        "near": min(near for near, _ in found),
        "far": max(far for _, far in found),
        "ply_file_path": "points.ply",
    }
