"""Every image by itself: its size and type, PNG against EXR against exposure, C against D, S against its table."""

import hashlib
from functools import partial

import numpy as np

from varos_warp.dataset import files
from varos_warp.dataset.noise_pass import is_repeatable, noisy_pixels
from varos_warp.dataset.progress import in_threads
from varos_warp.dataset.reader.dataset import Dataset, read_exposures
from varos_warp.dataset.validate.cells import place
from varos_warp.dataset.validate.outcome import Validation, problem_of
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
        colors = [Exposures(data, camera, output) for output in exposed]
        check = partial(_check_frame, data, camera, colors)
        for found, slopes in in_threads(f"images {camera}", check, frames, quiet=quiet):
            problems += found.problems
            result.files_read += found.files_read
            angles += slopes
        for color in colors:
            problems += color.verdicts()
    result.add_all(problems, "images")
    if angles:
        result.measure("C against the slopes of D, median angle", np.median(angles), 30.0, "deg")


def _check_frame(data: Dataset, camera: str, colors: list["Exposures"], frame: int) -> tuple[Validation, list[float]]:
    """What is wrong with one frame, and the median angle between C and the slopes of D, if it has them."""
    found, angles = Validation(), []
    for check in (*(color.check for color in colors), _linear_agrees, _depth_exr_agrees, _segments_agree):
        found.problems += _guarded(data, check, data, found, frame, camera)
    found.problems += _guarded(data, _geometry_agrees, data, found, frame, camera, angles)
    return found, angles


def _guarded(data: Dataset, check, *args) -> list[str]:
    try:
        return check(*args)
    except InputError as error:
        return [problem_of(data.root, error)]


def _read(data: Dataset, result: Validation, output: str, frame: int, camera: str) -> np.ndarray:
    """Pixels of a PNG, of the size and type that they must have."""
    path, about, row = data.layout.png(camera, output, frame), data.camera(camera), OUTPUTS[output]
    pixels = files.read_png(path)
    result.files_read += 1
    shape = (about["height"], about["width"], 3)[:3 if row.channels == 3 else 2]
    if pixels.shape != shape or pixels.dtype != row.dtype:
        raise InputError(f"is {pixels.dtype} {pixels.shape}, not {np.dtype(row.dtype)} {shape}", file=path)
    return pixels


# ------------------------------------------------------------------------------------------------------------- A and B


class Exposures:
    """A or B of one camera: of PNG, EXR and table of exposures, the one that does not fit the others is named.

    The table holds statistics of each EXR, gains that follow from the statistics of all frames, and each PNG is an EXR
    times its gain. What a wrong file holds instead is looked for among the other frames.
    """

    def __init__(self, data: Dataset, camera: str, output: str):
        self.data, self.camera, self.output = data, camera, output
        self.path = data.layout.camera_file(camera, f"_exposure_{output}.csv")
        self.expected: dict[str, int] = {}
        """Frame by the digest of what its PNG must be."""
        self.wrong_png: dict[int, str] = {}
        """Digest by frame."""
        self.wrong_statistics: dict[int, exposure.Statistics] = {}
        self.flaw, self.table = None, {}
        try:
            self.table = self._read_table()
        except InputError as error:
            self.flaw = problem_of(data.root, error)

    def _read_table(self) -> dict[int, tuple[float, exposure.Statistics]]:
        """Gain and statistics by frame."""
        rows = read_exposures(self.path)
        bad = [frame for frame in self.data.frames if frame not in rows or not 0.0 < rows[frame][0] < np.inf]
        if bad:
            raise InputError(f"the exposure table lacks a positive gain for frame {bad[0]}", file=self.path)
        return rows

    def check(self, data: Dataset, result: Validation, frame: int, camera: str) -> list[str]:
        """Read one frame, and note what does not fit."""
        output, clean = self.output, data.has_noise("A") and self.output == "A"
        pixels = _read(data, result, output, frame, camera)
        exr = data.layout.exr(camera, output, frame)
        linear = data.linear(output, frame, camera)
        result.files_read += 1
        if linear.shape != pixels.shape or not np.isfinite(linear).all():
            return [f"{exr.name}: has values that are not finite, or another size than its PNG"]
        if frame not in self.table:
            return []
        gain, known = self.table[frame]
        if not _same(exposure.statistics(linear), known):
            self.wrong_statistics[frame] = exposure.statistics(linear)
        problems = []
        if clean:
            if not np.array_equal(noisy_pixels(data, frame, camera), pixels) and is_repeatable(data):
                problems = [f"{data.layout.png(camera, 'A', frame).name}: is not its EXR with the noise of "
                            "dataset.json"]
            pixels = data.pixels("A", frame, camera, truth=True)
        made = OUTPUTS[output].encode(linear, gain)
        self.expected.setdefault(_digest(made), frame)
        if not np.array_equal(made, pixels):
            self.wrong_png[frame] = _digest(pixels)
        return problems

    def verdicts(self) -> list[str]:
        """What is wrong, once all frames are read."""
        if self.flaw:
            return [self.flaw]
        problems = self._wrong_gains()
        for frame in sorted(self.wrong_png.keys() | self.wrong_statistics.keys()):
            problems.append(self._verdict(frame))
        return problems

    def _verdict(self, frame: int) -> str:
        layout, statistics = self.data.layout, self.wrong_statistics.get(frame)
        png = layout.png(self.camera, self.output, frame)
        name = png.name if not (self.output == "A" and self.data.has_noise("A")) else f"A_clean/{png.name}"
        exr = layout.exr(self.camera, self.output, frame).name
        if statistics is None:
            other = self.expected.get(self.wrong_png[frame])
            holds = "" if other is None else f"; it is that of frame {other}"
            return f"{name}: is not its EXR with the gain of the exposure table{holds}"
        other = next((f for f, (_, known) in self.table.items() if f != frame and _same(known, statistics)), None)
        holds = "" if other is None else f"; it is that of frame {other}"
        if frame in self.wrong_png:
            return f"{exr}: is not the image that was exposed: neither its PNG nor its row of the exposure table{holds}"
        if other is not None:
            return f"{name} and {exr}: are not those of the exposure table{holds}"
        where = place(self.data, self.path, list(self.table).index(frame), "log_average")
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
        where = place(self.data, self.path, list(self.table).index(wrong[0]), "gain")
        return [f"{where}: the gain of frame {wrong[0]}{more} does not follow from the table's log_average "
                f"and highlight by the exposure {setting!r}"]


def _same(one: exposure.Statistics, other: exposure.Statistics) -> bool:
    """Equal to the rounding of a mean of logarithms."""
    return np.allclose([one.log_average, one.highlight], [other.log_average, other.highlight], 1e-9, 0, equal_nan=True)


def _digest(pixels: np.ndarray) -> str:
    return hashlib.sha256(np.ascontiguousarray(pixels).tobytes()).hexdigest()


def _linear_agrees(data: Dataset, result: Validation, frame: int, camera: str) -> list[str]:
    """A as rendered has its size, finite values and errors, layers that sum to it, and is A_exr where none denoised."""
    path = data.layout.linear(camera, frame)
    if "A" not in data.outputs or not path.is_file():
        return []
    channels = files.read_exr(path)
    result.files_read += 1
    about = data.camera(camera)
    if any(c.shape != (about["height"], about["width"]) or not np.isfinite(c).all() for c in channels.values()):
        return [f"{path.name} (A_linear): has values that are not finite, or another size"]
    if missing := {"R", "G", "B"} - set(channels):
        return [f"{path.name} (A_linear): has no channel {sorted(missing)[0]}"]
    problems = []
    for c in "RGB":
        layers = [name for name in channels if name.endswith(f".{c}") and not name.startswith("stderr.")]
        total = sum(channels[name].astype(float) for name in layers)
        scale = max(np.abs(channels[c]).max(), 1e-30)
        if layers and np.abs(total - channels[c]).max() > 1e-4 * scale:
            problems.append(f"{path.name} (A_linear): its layers do not sum to channel {c}")
        if f"stderr.{c}" in channels and channels[f"stderr.{c}"].min() < 0.0:
            problems.append(f"{path.name} (A_linear): has a negative standard error")
    if data.meta["samples"]["denoise"] == "none":
        made = to_half(np.stack([channels[c] for c in "RGB"], -1))[0]
        if not np.array_equal(made.astype(np.float32), data.linear("A", frame, camera)):
            problems.append(f"{path.name}: A_linear and A_exr are not the same image, though nothing was denoised")
    return problems


# ------------------------------------------------------------------------------------------------------------ C, D, S


def _geometry_agrees(data: Dataset, result: Validation, frame: int, camera: str, angles: list[float]) -> list[str]:
    """Where C has no surface D has none within its range, C faces the camera, and D slopes as C says."""
    images = {o: _read(data, result, o, frame, camera) for o in "CD" if o in data.outputs}
    if len(images) < 2:
        return []
    name, problems = data.layout.png(camera, "C", frame).name, []
    normal, missing = data.image("C", frame, camera), ~np.any(images["C"], axis=-1)
    if (missing & (images["D"] < DEPTH_LEVELS)).any():
        problems.append(f"{name}: has no surface where D has one")
    points, rays = back_project(data, frame, camera)
    away = np.einsum("...i,...i", normal, rays / np.linalg.norm(rays, axis=-1, keepdims=True)) > 0.2
    if away.mean() > 0.05:
        problems.append(f"{name}: {100 * away.mean():.0f} % of its normals point away from the camera")
    slope = _normals_of(points, rays)
    both = np.isfinite(slope).all(-1) & ~missing
    if both.any():
        cosine = np.einsum("...i,...i", slope[both], normal[both])
        angles.append(float(np.degrees(np.median(np.arccos(np.clip(cosine, -1, 1))))))
    return problems


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


def _depth_exr_agrees(data: Dataset, result: Validation, frame: int, camera: str) -> list[str]:
    """D is its EXR in steps."""
    path = data.layout.exr(camera, "D", frame)
    if "D" not in data.outputs or not path.is_file():
        return []
    channels = files.read_exr(path)
    result.files_read += 1
    distance = channels["Z" if data.meta["depth"]["kind"] == "z" else "range"]
    made = OUTPUTS["D"].encode(distance, data.scale("D", frame, camera))
    same = np.array_equal(made, data.pixels("D", frame, camera))
    return [] if same else [f"{data.layout.png(camera, 'D', frame).name}: is not its EXR (D_exr) in steps of D"]


def _segments_agree(data: Dataset, result: Validation, frame: int, camera: str) -> list[str]:
    """S numbers only what segments.json lists, and has something wherever D has."""
    if "S" not in data.outputs:
        return []
    name, pixels = data.layout.png(camera, "S", frame).name, _read(data, result, "S", frame, camera)
    problems = []
    if unknown := set(np.unique(pixels).tolist()) - {0, *(row["id"] for row in data.segments())}:
        problems.append(f"{name}: segments.json does not list {sorted(unknown)[:5]}")
    if "D" in data.outputs and ((pixels == 0) & (data.pixels("D", frame, camera) < DEPTH_LEVELS)).any():
        problems.append(f"{name}: has nothing where D has a surface")
    return problems
