"""Every image by itself: its size and type, PNG against EXR against exposure, C against D, S against its table."""

import hashlib
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from varos_warp.dataset import files
from varos_warp.dataset.noise_pass import is_repeatable, noise_of, noisy_pixels
from varos_warp.dataset.progress import in_threads
from varos_warp.dataset.reader.dataset import Dataset, read_exposures
from varos_warp.dataset.validate.outcome import Validation
from varos_warp.dataset.validate.pending import Pending
from varos_warp.dataset.validate.views import back_project
from varos_warp.dataset.write import texts as writers
from varos_warp.errors import InputError
from varos_warp.render.image import exposure
from varos_warp.render.image.outputs import DEPTH_LEVELS, OUTPUTS, to_half


def check_images(data: Dataset, result: Validation, pending: Pending, quiet: bool) -> None:
    """Every image decodes to its size and type; the 8 bit ones are their EXR exposed; C and D agree.

    A and B are looked at once the exposure of all frames is done.
    """
    problems: list[str] = []
    angles: list[float] = []
    frames, exposed = pending.ready(data), [o for o in data.outputs if OUTPUTS[o].is_color and not pending.files]
    for camera in data.cameras:
        colors = [Exposures(data, result, camera, output) for output in exposed]
        for images in in_threads(f"images {camera}", partial(_FrameImages, data, camera, colors), frames, quiet=quiet):
            problems += images.found.problems
            result.files_read += images.found.files_read
            angles += images.angles
        for color in colors:
            problems += color.verdicts()
    result.add_all(problems, "images")
    if angles:
        result.measure("C against the slopes of D, median angle", np.median(angles), 30.0, "deg")


class _FrameImages:
    """The images of one frame of a camera: each file is read once, and held against the others."""

    def __init__(self, data: Dataset, camera: str, colors: list["Exposures"], frame: int):
        self.data, self.camera, self.frame = data, camera, frame
        self.found = Validation(data.root)
        self.angles: list[float] = []
        """The median angle between C and the slopes of D [deg], where there are both."""
        self.shape = data.camera(camera)["height"], data.camera(camera)["width"]
        for color in colors:
            self._guard(color.check, self)
        for output, check in (("A", self._linear), ("D", self._steps), ("S", self._segments), ("C", self._normals)):
            if output in data.outputs:
                self._guard(check)

    def _guard(self, check, *args) -> None:
        """Run a check; what cannot be read is a problem, the other checks go on."""
        try:
            check(*args)
        except InputError as error:
            self.found.problems.append(self.found.problem_of(error))

    def tell(self, name: str, problem: str) -> None:
        """Note a problem of a file."""
        self.found.problems.append(f"{name}: {problem}")

    def png(self, output: str) -> Path:
        """The finished image."""
        return self.data.layout.png(self.camera, output, self.frame)

    def exr(self, path: Path) -> dict[str, np.ndarray]:
        """Channels of an EXR."""
        channels = files.read_exr(path)
        self.found.files_read += 1
        return channels

    def pixels(self, output: str) -> np.ndarray:
        """Pixels of a PNG, of the size and type that they must have."""
        row, pixels = OUTPUTS[output], files.read_png(self.png(output))
        self.found.files_read += 1
        shape = (*self.shape, 3) if row.channels == 3 else self.shape
        if pixels.shape != shape or pixels.dtype != row.dtype:
            raise InputError(f"is {pixels.dtype} {pixels.shape}, not {np.dtype(row.dtype)} {shape}",
                             file=self.png(output))
        return pixels

    @cached_property
    def depth(self) -> np.ndarray | None:
        """Pixels of D, where there is D."""
        return self.pixels("D") if "D" in self.data.outputs else None

    def _linear(self) -> None:
        """A as rendered has its size, finite values and errors, layers that sum to it; undenoised, it is A_exr."""
        path = self.data.layout.linear(self.camera, self.frame)
        if not path.is_file():
            return
        channels, name = self.exr(path), f"A_linear/{path.name}"
        if any(c.shape != self.shape or not np.isfinite(c).all() for c in channels.values()):
            return self.tell(name, "has values that are not finite, or another size")
        if missing := {"R", "G", "B"} - set(channels):
            return self.tell(name, f"has no channel {sorted(missing)[0]}")
        for c in "RGB":
            layers = [values.astype(float) for channel, values in channels.items()
                      if channel.endswith(f".{c}") and not channel.startswith("stderr.")]
            if layers and np.abs(sum(layers) - channels[c]).max() > 1e-4 * max(np.abs(channels[c]).max(), 1e-30):
                self.tell(name, f"has layers that do not sum to channel {c}")
            if f"stderr.{c}" in channels and channels[f"stderr.{c}"].min() < 0.0:
                self.tell(name, "has a negative standard error")
        if self.data.meta["samples"]["denoise"] == "none":
            made = to_half(np.stack([channels[c] for c in "RGB"], -1))[0]
            if not np.array_equal(made.astype(np.float32), self.data.linear("A", self.frame, self.camera)):
                self.tell(name, "is not the image of A_exr, though nothing was denoised")

    def _steps(self) -> None:
        """D is its EXR in steps, where there is one."""
        depth, path = self.depth, self.data.layout.exr(self.camera, "D", self.frame)
        if path.is_file():
            distance = self.exr(path)["Z" if self.data.meta["depth"]["kind"] == "z" else "range"]
            made = OUTPUTS["D"].encode(distance, self.data.scale("D", self.frame, self.camera))
            if not np.array_equal(made, depth):
                self.tell(self.png("D").name, "is not its EXR (D_exr) in steps of D")

    def _segments(self) -> None:
        """S numbers only what segments.json lists, and has something wherever D has."""
        pixels = self.pixels("S")
        if unknown := set(np.unique(pixels).tolist()) - {0, *(row["id"] for row in self.data.segments())}:
            self.tell(self.png("S").name, f"segments.json does not list {sorted(unknown)[:5]}")
        if self.depth is not None and ((pixels == 0) & (self.depth < DEPTH_LEVELS)).any():
            self.tell(self.png("S").name, "has nothing where D has a surface")

    def _normals(self) -> None:
        """Where C has no surface D has none within its range, C faces the camera, and D slopes as C says."""
        pixels = self.pixels("C")
        if self.depth is None:
            return
        normal, missing = self.data.image("C", self.frame, self.camera), ~np.any(pixels, axis=-1)
        if (missing & (self.depth < DEPTH_LEVELS)).any():
            self.tell(self.png("C").name, "has no surface where D has one")
        points, rays = back_project(self.data, self.frame, self.camera)
        away = np.einsum("...i,...i", normal, rays / np.linalg.norm(rays, axis=-1, keepdims=True)) > 0.2
        if away.mean() > 0.05:
            self.tell(self.png("C").name, f"{100 * away.mean():.0f} % of its normals point away from the camera")
        slope = _normals_of(points, rays)
        both = np.isfinite(slope).all(-1) & ~missing
        if both.any():
            cosine = np.einsum("...i,...i", slope[both], normal[both])
            self.angles.append(float(np.degrees(np.median(np.arccos(np.clip(cosine, -1, 1))))))


def _normals_of(points: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Unit normals [H, W, 3] towards the camera from central differences of points; NaN at borders and at edges."""
    normal = np.full(points.shape, np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        across, down = points[1:-1, 2:] - points[1:-1, :-2], points[2:, 1:-1] - points[:-2, 1:-1]
        n = np.cross(across, down)
        n /= np.linalg.norm(n, axis=-1, keepdims=True)
        n *= -np.sign(np.einsum("...i,...i", n, rays[1:-1, 1:-1]))[..., None]
        # a step in depth between neighbours is an edge, not a slope
        second = np.linalg.norm(points[1:-1, 2:] + points[1:-1, :-2] - 2 * points[1:-1, 1:-1], axis=-1)
        smooth = second < 0.2 * np.linalg.norm(across, axis=-1)
    normal[1:-1, 1:-1] = np.where(smooth[..., None], n, np.nan)
    return normal


# ------------------------------------------------------------------------------------------------------------- A and B


class Exposures:
    """A or B of one camera: of PNG, EXR and table of exposures, the one that does not fit the others is named.

    The table holds statistics of each EXR, gains that follow from the statistics of all frames, and each PNG is an EXR
    times its gain. What a wrong file holds instead is looked for among the other frames.
    """

    def __init__(self, data: Dataset, result: Validation, camera: str, output: str):
        self.data, self.result, self.camera, self.output = data, result, camera, output
        self.path = data.layout.exposures(camera, output)
        self.has_noise = output == "A" and data.has_noise("A")
        self.expected: dict[str, int] = {}
        """Frame by the digest of what its PNG must be."""
        self.wrong_png: dict[int, str] = {}
        """Digest by frame."""
        self.wrong_statistics: dict[int, exposure.Statistics] = {}
        self.flaw, self.table = None, {}
        """Gain and statistics by frame, or why the table cannot be used."""
        try:
            rows = read_exposures(self.path)
            if bad := [f for f in data.frames if f not in rows or not 0.0 < rows[f][0] < np.inf]:
                raise InputError(f"the exposure table lacks a positive gain for frame {bad[0]}", file=self.path)
            self.table = rows
        except InputError as error:
            self.flaw = result.problem_of(error)

    def check(self, images: _FrameImages) -> None:
        """Read one frame, and note what does not fit."""
        data, frame, camera, output = self.data, images.frame, self.camera, self.output
        pixels, exr = images.pixels(output), data.layout.exr(camera, output, frame)
        linear = data.linear(output, frame, camera)
        images.found.files_read += 1
        if linear.shape != pixels.shape or not np.isfinite(linear).all():
            return images.tell(exr.name, "has values that are not finite, or another size than its PNG")
        if frame not in self.table:
            return
        gain, known = self.table[frame]
        if not _same(exposure.statistics(linear), known):
            self.wrong_statistics[frame] = exposure.statistics(linear)
        if self.has_noise:
            if is_repeatable(data) and not np.array_equal(noisy_pixels(data, *noise_of(data), frame, camera), pixels):
                images.tell(images.png("A").name, "is not its EXR with the noise of dataset.json")
            pixels = data.pixels("A", frame, camera, truth=True)
        made = OUTPUTS[output].encode(linear, gain)
        self.expected.setdefault(_digest(made), frame)
        if not np.array_equal(made, pixels):
            self.wrong_png[frame] = _digest(pixels)

    def verdicts(self) -> list[str]:
        """What is wrong, once all frames are read."""
        if self.flaw:
            return [self.flaw]
        return self._wrong_gains() + [self._verdict(f) for f in sorted(self.wrong_png.keys() | self.wrong_statistics)]

    def _verdict(self, frame: int) -> str:
        statistics = self.wrong_statistics.get(frame)
        png = ("A_clean/" if self.has_noise else "") + self.data.layout.png(self.camera, self.output, frame).name
        exr = self.data.layout.exr(self.camera, self.output, frame).name
        if statistics is None:
            other = self.expected.get(self.wrong_png[frame])
        else:
            other = next((f for f, (_, known) in self.table.items() if f != frame and _same(known, statistics)), None)
        holds = "" if other is None else f"; it is that of frame {other}"
        if statistics is None:
            return f"{png}: is not its EXR with the gain of the exposure table{holds}"
        if frame in self.wrong_png:
            return f"{exr}: is not the image that was exposed: neither its PNG nor its row of the exposure table{holds}"
        if other is not None:
            return f"{png} and {exr}: are not those of the exposure table{holds}"
        where = self.result.cell(self.path, list(self.table).index(frame), "log_average")
        return f"{where}: log_average and highlight of frame {frame} are not those of its EXR"

    def _wrong_gains(self) -> list[str]:
        """Gains follow from the statistics of all frames, as the scene asks for."""
        setting = self.data.meta["color"]["exposure"][self.output]
        time_s = files.read_csv(self.path)[writers.TIME] * 1e-9
        made = exposure.gains(setting, self.output, time_s, [known for _, known in self.table.values()])
        wrong = [f for f, gain in zip(self.table, made, strict=True) if not np.isclose(self.table[f][0], gain, 1e-9, 0)]
        if not wrong:
            return []
        more = f" and of {len(wrong) - 1} more" if wrong[1:] else ""
        where = self.result.cell(self.path, list(self.table).index(wrong[0]), "gain")
        return [f"{where}: the gain of frame {wrong[0]}{more} does not follow from the table's log_average "
                f"and highlight by the exposure {setting!r}"]


def _same(one: exposure.Statistics, other: exposure.Statistics) -> bool:
    """Equal to the rounding of a mean of logarithms."""
    return np.allclose([one.log_average, one.highlight], [other.log_average, other.highlight], 1e-9, 0, equal_nan=True)


def _digest(pixels: np.ndarray) -> str:
    return hashlib.sha256(np.ascontiguousarray(pixels).tobytes()).hexdigest()
