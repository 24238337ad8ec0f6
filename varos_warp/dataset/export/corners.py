"""Corners of calibration boards: where each is, and where every camera sees it by the whole model of the camera.

``cam<ID>.csv`` has a row for each frame, board and corner, ``targets`` the boards as Kalibr has them. No image is
needed: a dataset of `varos-warp simulate` will do.
"""

import warnings
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from varos_warp.dataset import files
from varos_warp.dataset.export.estimators import write_yaml
from varos_warp.dataset.export.shared.job import Job
from varos_warp.dataset.export.shared.labels import AT_HAND
from varos_warp.dataset.geometry import rebuilt
from varos_warp.dataset.reader.points import project
from varos_warp.dataset.reader.rows import offsets_ns, sight
from varos_warp.errors import InputError
from varos_warp.products.sensors.protocol import xyz
from varos_warp.render.image.flow import CONVERGED, MOST_TRIES, at_row
from varos_warp.scene.description.world import CalibrationBoard
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.frames import pose_matrix
from varos_warp.scene.geometry.assets.boards import SPACING, corners
from varos_warp.scene.geometry.query import Solids
from varos_warp.sim.clock import frame_time_ns
from varos_warp.sim.companions import motions

IMAGES = ""
SENSORS = ()
HEADER = "frame,timestamp [ns],board,corner,u [px],v [px],state".split(",") + xyz("board", "m") + xyz("world", "m")
VISIBLE, HIDDEN, OUTSIDE, UNSEEN = "visible", "hidden", "outside", "unseen"
"""States of a corner: something is before it, or the board shows its back; its image point lies beyond the image's
edges; it has no image point: it is behind the camera, or lens and port let no light through from there."""


@dataclass(frozen=True)
class Board:
    """A board of the scene."""

    key: str
    block: CalibrationBoard

    @cached_property
    def corners(self) -> np.ndarray:
        """Corners in the board's own axes, its scale applied [N, 3] [m]."""
        return corners(self.block) * self.block.scale


@dataclass(frozen=True)
class Sighting:
    """The corners of a board in an image, N of them."""

    uv: np.ndarray
    """Image points [N, 2] [pixels], the centre of the top left pixel at (0.5, 0.5); NaN: none."""
    state: np.ndarray
    """str [N]."""
    world: np.ndarray
    """Places [N, 3] [m], at the time at which each is seen."""


def write(job: Job) -> None:
    """Write a table of corners for each camera, and a target for each board."""
    boards = boards_of(job)
    scene = Corners(job, boards)
    for camera in job.cameras:
        seen = job.each(f"corners {camera}", lambda frame, camera=camera: scene.of(frame, camera))
        files.write_csv(job.out / f"cam{camera}.csv", HEADER, *_columns(job, camera, boards, seen))
    for board in boards:
        if target := _target(board):
            write_yaml(job, f"targets/{board.key}.yaml", target)


def boards_of(job: Job) -> list[Board]:
    """The boards among the objects of a dataset's scene, or an `InputError` where there is none."""
    scene = scene_from_dict(job.data.meta["scene"])
    boards = [
        Board(f"objects.{i}", block) for i, block in enumerate(scene.objects) if isinstance(block, CalibrationBoard)
    ]
    if not boards:
        raise InputError(
            "the scene has no calibration board among its objects",
            file=job.data.root,
            key="to",
            value="corners",
            remedy="Add one, such as {kind: calibration_board, square_m: 0.05}: docs/howto/calibration.md.",
        )
    for i, block in enumerate(scene.scatter):
        if isinstance(block.object, CalibrationBoard):
            warnings.warn(f"scatter.{i}: corners of boards that are strewn are left out", stacklevel=4)
    return boards


class Corners:
    """Finds where the cameras of a dataset see the corners of boards; refuses one whose scene's files are gone."""

    def __init__(self, job: Job, boards: list[Board]):
        self.data, self.boards = job.data, boards
        try:
            scene, parts = rebuilt(job.data, job.scene_dir)
        except InputError as error:
            raise InputError(
                f"what hides corners cannot be known: {error.problem}", file=job.data.root, remedy=AT_HAND
            ) from None
        self.motions = motions(scene)
        # its own mesh hides a corner from behind only, which needs no rays, whose rounding is that of the mesh
        self.others = {
            board.key: Solids([part for part in parts if part.name != board.key], grown=True) for board in boards
        }

    def of(self, frame: int, camera: str) -> list[Sighting]:
        """The corners of every board, through a camera at a frame, by its number."""
        return [self._of(board, frame, camera) for board in self.boards]

    def _of(self, board: Board, frame: int, camera: str) -> Sighting:
        T_w_c, time_ns = sight(self.data, frame, camera), self._times(frame, camera)
        uv, when, T_w_o = self._project(board, T_w_c, time_ns, camera)
        world = np.einsum("nij,nj->ni", T_w_o[:, :3, :3], board.corners) + T_w_o[:, :3, 3]
        about, seen = self.data.camera(camera), np.isfinite(uv).all(axis=1)
        inside = seen & (uv >= 0.0).all(axis=1) & (uv <= [about["width"], about["height"]]).all(axis=1)
        state = np.where(seen, OUTSIDE, UNSEEN).astype("<U8")
        chosen = np.flatnonzero(inside)
        free = self._is_free(board, camera, T_w_c, uv[chosen], when[chosen], world[chosen], T_w_o[chosen])
        state[chosen] = np.where(free, VISIBLE, HIDDEN)
        return Sighting(uv, state, world)

    def _times(self, frame: int, camera: str) -> np.ndarray:
        """Middle of the exposure of each row, int64 [H] [ns]."""
        return frame_time_ns(frame, self.data.meta["frames"]["rate_hz"]) + offsets_ns(self.data.camera(camera))

    def _poses(self, board: Board, when: np.ndarray) -> np.ndarray:
        """Return poses of a board at times int64 [N], [N, 4, 4]."""
        if board.key in self.motions:
            return self.motions[board.key](when)
        return np.tile(pose_matrix(board.block), (len(when), 1, 1))

    def _project(
        self, board: Board, T_w_c: np.ndarray, time_ns: np.ndarray, camera: str
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Image points [N, 2], times int64 [N] and poses of the board then [N, 4, 4]: the row tells the time."""
        model, middles = self.data.camera_model(camera), np.arange(len(time_ns)) + 0.5
        row = np.full(len(board.corners), 0.5 * len(time_ns))

        def seen_at(row: np.ndarray) -> np.ndarray:
            return np.rint(np.interp(row, middles, time_ns - time_ns[0])).astype(np.int64) + time_ns[0]

        for _ in range(MOST_TRIES):
            T_w_o = self._poses(board, seen_at(row))
            world = np.einsum("nij,nj->ni", T_w_o[:, :3, :3], board.corners) + T_w_o[:, :3, 3]
            u, v, z = project(world, model, T_w_c).T
            v = np.where(z > 0.0, v, np.nan) if model.is_pinhole else v
            before, row = row, np.where(np.isfinite(v), v.clip(0.0, len(time_ns)), row)
            if board.key not in self.motions or np.abs(row - before).max() < CONVERGED:
                break
        return np.stack([np.where(np.isfinite(v), u, np.nan), v], axis=-1), seen_at(row), T_w_o

    def _is_free(self, board, camera, T_w_c, uv, when, world, T_w_o) -> np.ndarray:
        """Return whether nothing is between the camera and corners, bool [N], by the rays of their image points."""
        rays = self.data.camera_model(camera).rays(uv)
        T = at_row(T_w_c, uv[:, 1]) if T_w_c.ndim == 3 else np.tile(T_w_c, (len(uv), 1, 1))
        start, d = (np.einsum("nij,nj->ni", T[:, :3, :3], x) for x in rays[:2])
        start += T[:, :3, 3]
        others = {key: course(when) for key, course in self.motions.items() if key != board.key}
        away = ((world - start) * d).sum(axis=1)
        met, _ = self.others[board.key].first_met(start, d, 1.0 + away.max(initial=0.0), others)
        return (met >= away) & ((d * T_w_o[:, :3, 1]).sum(axis=1) > 0.0) & (rays.weight > 0.0)


def _columns(job: Job, camera: str, boards: list[Board], seen: list[list[Sighting]]) -> list[np.ndarray]:
    """Columns of `HEADER`, with image points in OpenCV's pixels."""
    time_ns = job.data.time_ns(camera)
    rows = [
        (frame, t, board, sighting)
        for frame, t, sightings in zip(job.data.frames, time_ns, seen, strict=True)
        for board, sighting in zip(boards, sightings, strict=True)
    ]
    many = [len(board.corners) for _, _, board, _ in rows]
    first = [np.repeat([row[k] for row in rows], many) for k in (0, 1)]
    keys, numbers = np.repeat([board.key for _, _, board, _ in rows], many), np.concatenate(list(map(np.arange, many)))
    return [
        *first,
        keys,
        numbers,
        np.concatenate([s.uv for *_, s in rows]) - 0.5,
        np.concatenate([s.state for *_, s in rows]),
        np.concatenate([board.corners for _, _, board, _ in rows]),
        np.concatenate([s.world for *_, s in rows]),
    ]


def _target(board: Board) -> dict | None:
    """A board as Kalibr's target files have it; None where a scale has stretched its tags."""
    block, (x, _, z) = board.block, np.broadcast_to(np.asarray(board.block.scale, float), 3).tolist()
    if block.pattern == "checkerboard":
        return {
            "target_type": "checkerboard",
            "targetCols": block.columns,
            "targetRows": block.rows,
            "rowSpacingMeters": block.square_m * z,
            "colSpacingMeters": block.square_m * x,
        }
    if x != z:
        return None
    return {
        "target_type": "aprilgrid",
        "tagCols": block.columns,
        "tagRows": block.rows,
        "tagSize": block.tag_m * x,
        "tagSpacing": block.spacing or SPACING,
    }
