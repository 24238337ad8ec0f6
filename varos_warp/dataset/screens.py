"""Screens on which a preview is shown: a PNG file in a folder, or the viewer Rerun."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from varos_warp.dataset import files
from varos_warp.dataset.view import frustum, moved_by, open_viewer
from varos_warp.errors import InputError, optional
from varos_warp.products.images.registry import OUTPUTS
from varos_warp.scene.description.image_types import AMBIENT, WATER
from varos_warp.scene.frames import camera_pose, intrinsics


class FolderScreen:
    """Keeps ``preview.png`` in a folder, which must be no dataset, up to date; it is replaced as a whole."""

    outputs = WATER

    def __init__(self, folder: Path):
        if (folder / "dataset.json").exists():
            raise InputError(
                "is a dataset, which holds its own files alone", file=folder, key="-o", remedy="Name another folder."
            )
        self.file = folder / "preview.png"

    def place(self, view) -> None:
        """Nothing: a picture does not say where it was taken."""

    def show(self, _letter: str, pixels: np.ndarray) -> None:
        """Write an image, uint8 [H, W, 3]."""
        files.write_png(self.file, pixels)

    def tell(self, words: str) -> None:
        """Nothing: the terminal tells it."""


class RerunScreen:
    """Shows A, B, the course and the camera; each save of the scene is a step of the time line ``save``.

    Args:
        stream: A `rerun.RecordingStream`; absent: a new one, for which the viewer is opened when there is a scene.

    Raises:
        InputError: If Rerun is not installed; and later, if it cannot be opened.
    """

    outputs = WATER + AMBIENT

    def __init__(self, stream=None):
        self.rr = optional("rerun", "the viewer Rerun", "view", ", or write PNG files with -o FOLDER", key="preview")
        self.stream, self._saves = stream, 0

    def place(self, view) -> None:
        """Begin a step: where the camera is on which course. The first opens the viewer."""
        rr, camera = self.rr, view.camera
        if self.stream is None:
            self.stream = rr.RecordingStream("varos_warp_preview")
            open_viewer(self.stream, _blueprint(), "preview", "Write PNG files with -o FOLDER.")
        self.stream.set_time("save", sequence=self._saves)
        self._saves += 1
        T, origin = camera_pose(camera, view.T_w_v), moved_by(view.course)
        self.stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        self.stream.log("world/course", rr.LineStrips3D([view.course - origin], colors=[240, 180, 60]))
        self.stream.log(
            "world/camera",
            rr.Transform3D(
                translation=T[:3, 3] - origin, quaternion=Rotation.from_matrix(T[:3, :3]).as_quat(canonical=True)
            ),
            frustum(rr, intrinsics(camera), *camera.resolution),
        )
        self.tell("")

    def show(self, letter: str, pixels: np.ndarray) -> None:
        """Replace an image, uint8 [H, W, 3], of this step."""
        self.stream.log(f"world/camera/{letter}", self.rr.Image(pixels))

    def tell(self, words: str) -> None:
        """Show what is wrong with the scene."""
        self.stream.log("message", self.rr.TextDocument(words))


def _blueprint():
    """The images at the left, the world and what is wrong with the scene at the right."""
    import rerun.blueprint as rrb

    images = [
        rrb.Spatial2DView(origin=f"world/camera/{letter}", name=f"{letter}: {OUTPUTS[letter].content}")
        for letter in RerunScreen.outputs
    ]
    world = rrb.Spatial3DView(origin="world", name="World", contents=["+ $origin/**", "- $origin/camera/B"])
    others = rrb.Vertical(images[1], world, rrb.TextDocumentView(origin="message"), row_shares=[3, 3, 1])
    return rrb.Blueprint(
        rrb.Horizontal(images[0], others, column_shares=[2, 1]),
        rrb.TimePanel(state="collapsed", timeline="save"),
        collapse_panels=True,
    )
