"""What each image shows, object by object: what is seen of it, all of it, and where it is.

An object is what has a number in S: an object of the scene file, the body of another vehicle, a copy of a scatter or,
with ``render.segments: fine``, of growth. What grows on it is a part of it, unless it has numbers of its own.
"""

import contextlib
import warnings
from dataclasses import dataclass

import numpy as np

from varos_warp.dataset.export.shared.job import Job
from varos_warp.dataset.geometry import rebuilt
from varos_warp.dataset.reader.rows import sight
from varos_warp.errors import InputError
from varos_warp.products.images.segments import block_of
from varos_warp.render.silhouettes import SURFACE, Silhouettes
from varos_warp.scene.description.classes import WATER_CLASS, class_of
from varos_warp.scene.description.image_types import SEGMENTS
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.frames import inverse, pose_matrix, transform
from varos_warp.scene.geometry.course import local_origin
from varos_warp.scene.geometry.parts import Instances, Part
from varos_warp.scene.optics.camera import pixel_centres
from varos_warp.sim.clock import frame_time_ns
from varos_warp.sim.companions import motions

AT_HAND = "Name the folder of the scene file with --scene-dir."
WATER_NUMBER = 1 << 16
"""Number of pixels where nothing is hit, beyond all numbers of S."""


@dataclass(frozen=True)
class Thing:
    """What has a number in S, but the terrain."""

    number: int
    key: str
    """Its key in the scene file, such as ``objects.3`` or ``scatter.0.17``."""
    category: str


@dataclass(frozen=True)
class Label:
    """A thing in an image."""

    thing: Thing
    visible: np.ndarray
    """Pixels that show it: places in the flattened image, ascending, int64 [N]."""
    whole: np.ndarray | None
    """Pixels that would show it if nothing else were there, and the camera saw ``margin`` more pixels on each side:
    places in that larger image. None: not known."""
    T_c_o: np.ndarray | None
    """Pose [4, 4] of its axes in those of the camera (OpenCV) [m], at the frame's time; None: not known."""

    @property
    def share(self) -> float | None:
        """The visible share of ``whole``."""
        return None if self.whole is None else len(self.visible) / len(self.whole)


class Labels:
    """The labels of a dataset; with ``must_be_whole``, it refuses one whose scene's files are not at hand."""

    def __init__(self, job: Job, must_be_whole: bool = False):
        self.job, self.data = job, job.data
        self.scene = scene_from_dict(self.data.meta["scene"])
        rows = {row["key"]: row["id"] for row in self.data.segments()}
        self.terrain = rows.pop(SURFACE, None)
        self.things = {number: Thing(number, key, class_of(block_of(self.scene, key))) for key, number in rows.items()}
        self.parts: list[Part | Instances] = []
        self.silhouettes: Silhouettes | None = None
        try:
            self._rebuild(rows)
        except InputError as error:
            if must_be_whole:
                raise InputError(
                    f"what is hidden of objects cannot be known: {error.problem}",
                    file=self.data.root,
                    remedy=f"{AT_HAND} coco and yolo go without.",
                ) from None
            warnings.warn(
                f"what is hidden of objects is left out, amodal boxes and visible shares: {error.problem}. {AT_HAND}",
                stacklevel=4,
            )
        self._T_w_o = self._poses()

    def _rebuild(self, numbers: dict[str, int]) -> None:
        """Build anew what the dataset was made of; refuses other files, and what S does not number."""
        self.scene, parts = rebuilt(self.data, self.job.scene_dir)
        names = {name for part in parts for name in (part.names if isinstance(part, Instances) else [part.name])}
        fine = self.scene.render.segments == "fine"
        if lost := {name for name in names - {SURFACE} if fine or not name.startswith("growth.")} ^ (
            numbers.keys() - {self.scene.own_body}
        ):
            raise InputError(f"{min(lost)} is not as it was when the dataset was made, by another version")
        self.parts = parts
        self.silhouettes = Silhouettes(self.scene, parts, numbers, self._origin())
        self._motions = motions(self.scene)

    def _origin(self) -> np.ndarray:
        """Return the origin of the local world; without the file of a course it lies among the cameras' places."""
        with contextlib.suppress(InputError):
            return local_origin(self.scene, self.parts)
        return np.round(np.mean([self.data.views(camera)[1][:, :3, 3].mean(0) for camera in self.data.cameras], axis=0))

    @property
    def categories(self) -> list[str]:
        """Classes of things, in the order of the scene file."""
        return list(dict.fromkeys(thing.category for thing in self.things.values()))

    @property
    def surfaces(self) -> dict[int, str]:
        """Classes of what is no thing, by the numbers of their pixels: the terrain, if there is one, and the water."""
        ground = {} if self.terrain is None else {self.terrain: class_of(self.scene.terrain, True)}
        return ground | {WATER_NUMBER: WATER_CLASS}

    def numbers(self, frame: int, camera: str) -> np.ndarray:
        """S int32 [H, W]; `WATER_NUMBER` where nothing is hit, 0 where the lens or the port sees no water."""
        S = self.data.image(SEGMENTS, frame, camera)
        return np.where((S == 0) & self._sees_water(camera), WATER_NUMBER, S)

    def _sees_water(self, camera: str) -> np.ndarray:
        def seen() -> np.ndarray:
            about, model = self.data.camera(camera), self.data.camera_model(camera)
            if model.is_pinhole:
                return np.ones((about["height"], about["width"]), bool)
            return model.rays(pixel_centres(about["width"], about["height"])).weight > 0.0

        return self.data._once(("sees", camera), seen)

    def of(self, frame: int, camera: str, margin: tuple[int, int] = (0, 0)) -> list[Label]:
        """Labels of all things that an image shows, or would show if nothing hid them, by their numbers.

        ``margin``: rows and columns beyond the image that ``whole`` has, too; a thing must have a pixel in the image.
        """
        S = self.data.image(SEGMENTS, frame, camera)
        flat = S.ravel()
        order = np.argsort(flat, kind="stable")
        found, first = np.unique(flat[order], return_index=True)
        visible = dict(zip(found.tolist(), np.split(order, first[1:]), strict=True))
        whole = self._whole(frame, camera, margin)
        size, none = S.shape, np.empty(0, np.int64)
        labels = []
        for number in sorted({*visible, *whole} & self.things.keys()):
            seen, own = visible.get(number, none), None
            if self.silhouettes:
                # rounding, of copies that a GPU joins to the one mesh, loses no pixel that is seen
                own = np.union1d(whole.get(number, none), moved(seen, size, margin))
            if len(seen) or within(own, size, margin).any():
                labels.append(Label(self.things[number], seen, own, self._T_c_o(number, frame, camera)))
        return labels

    def _whole(self, frame: int, camera: str, margin: tuple[int, int]) -> dict[int, np.ndarray]:
        if self.silhouettes is None:
            return {}
        time_ns = frame_time_ns(frame, self.data.meta["frames"]["rate_hz"])
        view = next(view for view in self.scene.vehicle.cameras if view.id == camera)

        def poses(offset_ns: np.ndarray) -> dict[str, np.ndarray]:
            return {key: course(time_ns + offset_ns) for key, course in self._motions.items()}

        return self.silhouettes.of(view, sight(self.data, frame, camera), poses, margin)

    # ----------------------------------------------------------------------------------------------------- poses

    def _poses(self) -> dict[str, np.ndarray]:
        """Poses T_w_o of things, [4, 4] or that at every frame [N, 4, 4], by key, as far as they are known."""
        found = {f"objects.{i}": pose_matrix(block) for i, block in enumerate(self.scene.objects)}
        for group in self.parts:
            if isinstance(group, Instances):
                R = group.T_w_o[:, :3, :3] / group.scale[:, None, None]
                found |= dict(zip(group.names, transform(R, group.T_w_o[:, :3, 3]), strict=True))
        return found | {key: self.data.poses(key)[1] for key in self.data.moving}

    def _T_c_o(self, number: int, frame: int, camera: str) -> np.ndarray | None:
        T_w_o = self._T_w_o.get(self.things[number].key)
        if T_w_o is None:
            return None
        now = T_w_o[self.data._index(frame)] if T_w_o.ndim == 3 else T_w_o
        return inverse(self.data.T_w_c(frame, camera)) @ now


def moved(pixels: np.ndarray, size: tuple[int, int], margin: tuple[int, int]) -> np.ndarray:
    """Places of an image's pixels in the larger one with a margin; ``size`` and ``margin`` are rows and columns."""
    row, col = np.divmod(pixels, size[1])
    return (row + margin[0]) * (size[1] + 2 * margin[1]) + col + margin[1]


def within(pixels: np.ndarray, size: tuple[int, int], margin: tuple[int, int]) -> np.ndarray:
    """Which of the pixels of the larger image lie in the image itself, bool [N]."""
    row, col = np.divmod(pixels, size[1] + 2 * margin[1])
    return (row >= margin[0]) & (row < margin[0] + size[0]) & (col >= margin[1]) & (col < margin[1] + size[1])
