"""One frame of a dataset: its images are read when they are first asked for, and kept as long as the frame is."""

from functools import cached_property
from typing import Any

import numpy as np

from varos_warp.dataset.files import channels_of, read_exr
from varos_warp.dataset.reader import rows
from varos_warp.dataset.reader.points import along_ray, colour_offsets
from varos_warp.errors import InputError
from varos_warp.products.images.registry import OUTPUTS
from varos_warp.products.images.transmittance import LEAST
from varos_warp.render.image.exposure import FrameGain
from varos_warp.scene.description.image_types import AMBIENT, DEPTH, NORMALS, SEGMENTS, TWIN, WATER


class Frame:
    """What one camera sees at one time; `Dataset.__getitem__` makes it.

    Nothing is read before it is asked for; every file is read once. Pickled, it takes its place along, not its images.

    Args:
        data: The `Dataset`.
        index: Place of the frame in the dataset, 0 to ``len(data) - 1``.
        camera: Id of the camera.

    Raises:
        InputError: By every property, if a file it reads is missing or damaged; the message names it.
    """

    def __init__(self, data: Any, index: int, camera: str):
        self.data, self.index, self.camera = data, index, camera
        self.number: int = data.frames[index]
        """Number of the frame in the sequence, which is in the file names."""

    def __repr__(self) -> str:
        return f"Frame({self.number}, camera {self.camera}, {self.time_ns * 1e-9:g} s)"

    def __reduce__(self) -> tuple[Any, ...]:
        return Frame, (self.data, self.index, self.camera)

    # ---------------------------------------------------------------------------------------------------- images

    @cached_property
    def A(self) -> np.ndarray:
        """Underwater image uint8 [H, W, 3], sRGB after exposure: the pixels of the PNG."""
        return self.data.pixels(WATER, self.number, self.camera)

    @cached_property
    def B(self) -> np.ndarray:
        """Image without water, uint8 [H, W, 3], sRGB after exposure."""
        return self.data.pixels(AMBIENT, self.number, self.camera)

    @cached_property
    def C(self) -> np.ndarray:
        """Unit world normals float32 [H, W, 3]; zero where nothing was hit."""
        return self.data.image(NORMALS, self.number, self.camera)

    @cached_property
    def D(self) -> np.ndarray:
        """Distance [m] float32 [H, W], of the kind in ``data.meta["depth"]["kind"]``; inf where there is none."""
        return self.data.image(DEPTH, self.number, self.camera)

    @cached_property
    def S(self) -> np.ndarray:
        """Numbers of objects int32 [H, W], as ``data.segments()`` lists them; 0 where nothing was hit."""
        return self.data.image(SEGMENTS, self.number, self.camera)

    @cached_property
    def P(self) -> np.ndarray:
        """A without port, distortion and vignetting (the twin), uint8 [H, W, 3], sRGB after exposure."""
        return self.data.pixels(TWIN, self.number, self.camera)

    @property
    def F(self) -> np.ndarray:
        """Optical flow to the next frame of the sequence float32 [H, W, 2] [pixels], right and down; NaN: not known.

        It is known of what is hidden there, too (`F_occluded`), and of what leaves the image.
        """
        return self._flow.flow

    @property
    def F_occluded(self) -> np.ndarray:
        """What something hides in the next frame, bool [H, W]."""
        return self._flow.occluded

    @property
    def F_motion(self) -> np.ndarray:
        """Scene flow [m] float32 [H, W, 3]: places in the next camera's axes less those in this one's; NaN: nothing."""
        return self._flow.motion

    @cached_property
    def _flow(self) -> Any:
        return self.data.flow(self.number, self.camera)

    def __getattr__(self, name: str) -> Any:
        """Images of the types that have no property here, by their letters, as `Dataset.image` decodes them."""
        if name not in OUTPUTS:
            raise AttributeError(f"a frame has no {name}")
        image = self.data.image(name, self.number, self.camera)
        self.__dict__[name] = image
        return image

    @cached_property
    def A_radiance(self) -> np.ndarray:
        """Linear radiance [W/sr/m^2] of A, float32 [H, W, 3], before exposure: from the half floats of its EXR."""
        return self.data.linear(WATER, self.number, self.camera)

    @cached_property
    def A_stderr(self) -> np.ndarray:
        """Standard error [W/sr/m^2] of each pixel of A before denoising, float32 [H, W, 3]; of ``--linear-exr``."""
        return self.data.stderr(self.number, self.camera)

    @cached_property
    def B_radiance(self) -> np.ndarray:
        """Linear radiance [W/sr/m^2] of B, float32 [H, W, 3], before exposure."""
        return self.data.linear(AMBIENT, self.number, self.camera)

    @cached_property
    def P_radiance(self) -> np.ndarray:
        """Linear radiance [W/sr/m^2] of P, float32 [H, W, 3], before exposure."""
        return self.data.linear(TWIN, self.number, self.camera)

    def gain(self, output: str = WATER) -> FrameGain:
        """What the radiance of A, B or P was multiplied with before the sRGB curve; with white balance by channel."""
        return self.data.gain(output, self.number, self.camera)

    @cached_property
    def range(self) -> np.ndarray:
        """Distance [m] float64 [H, W] along the rays in the water to what they hit; inf where D has none.

        From D's EXR where the run kept it (``render.depth_exr``), else from D, which is rounded to its steps.
        """
        path = self.data.layout.exr(self.camera, DEPTH, self.number)
        if path.exists():
            return channels_of(path, read_exr(path), "range")[0].astype(float)
        depth, kind = self.D.astype(float), self.data.meta["depth"]["kind"]
        return depth if kind == "range" else along_ray(depth, self.data.camera_model(self.camera))

    @cached_property
    def effective_attenuation(self) -> np.ndarray:
        """-ln(T) / r [1/m] of each pixel and channel, float64 [H, W, 3], of images T and D; NaN where nothing is seen.

        In water of three channels it is their extinction a + b everywhere; by wavelength it falls with the distance r,
        as a channel loses first what is absorbed most.

        Raises:
            InputError: The dataset has no T or no D.
        """
        if lacks := [letter for letter in ("T", DEPTH) if letter not in self.data.outputs]:
            raise InputError(
                f"effective attenuation needs images T and D, and there is no {' and no '.join(lacks)}",
                file=self.data.root,
                remedy="Add them to render.outputs and `run` again: it makes what is missing.",
            )
        r, T = self.range[..., None], self.T.astype(float)
        known = np.isfinite(r) & (r > 0.0) & (T > LEAST)
        return np.where(known, -np.log(np.where(known, T, 1.0)) / np.where(known, r, 1.0), np.nan)

    def colour_offsets(self, channel: str) -> np.ndarray:
        """Offset at which a channel shows what each pixel shows in green, right and down, float64 [H, W, 2] [pixels].

        Exact for the distances of D; 0 where all channels have one index, NaN where D has none.
        """
        depth = self.data.planar_depth(self.number, self.camera)
        return colour_offsets(depth, self.data.camera_model(self.camera), channel)

    # ------------------------------------------------------------------------------------------ where and when

    @property
    def time_ns(self) -> int:
        """Nanoseconds since the sequence began; with a shutter, of the middle of the middle row's exposure."""
        return int(self.data.views(self.camera)[0][self.index])

    @property
    def T_w_c(self) -> np.ndarray:
        """Pose float64 [4, 4] of the camera, OpenCV axes: camera to world."""
        return self.data.T_w_c(self.number, self.camera)

    @property
    def T_w_c_rows(self) -> np.ndarray:
        """Pose float64 [H, 4, 4] of the camera at each row's time; all are `T_w_c` without a rolling shutter."""
        return self.data.T_w_c_rows(self.number, self.camera)

    @property
    def row_times_ns(self) -> np.ndarray:
        """Middle of the exposure of each row, int64 [H]: nanoseconds since the sequence began."""
        return self.time_ns + rows.offsets_ns(self.data.camera(self.camera))

    @property
    def exposure_s(self) -> float:
        """How long each pixel is exposed [s]; 0: an instant."""
        return rows.exposure_s(self.data.camera(self.camera))

    @property
    def T_w_v(self) -> np.ndarray:
        """Pose float64 [4, 4] of the vehicle: vehicle to world."""
        return self.data.T_w_v(self.number)

    @property
    def K_opencv(self) -> np.ndarray:
        """Intrinsics float64 [3, 3] in pixels; the centre of the top left pixel is (0, 0): OpenCV, Kalibr, KITTI."""
        return self.data.intrinsics(self.camera, "opencv")

    @property
    def K_center_half(self) -> np.ndarray:
        """Intrinsics float64 [3, 3] in pixels; the centre of the top left pixel is (0.5, 0.5): COLMAP, nerfstudio."""
        return self.data.intrinsics(self.camera, "center_half")

    @property
    def K(self) -> np.ndarray:
        """`K_center_half`; with OpenCV it is half a pixel off, so take `K_opencv` there."""
        return self.K_center_half
