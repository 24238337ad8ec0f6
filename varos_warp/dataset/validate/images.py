"""Every image by itself: its size and type, what its type checks, exposure; and C, S and F against D."""

import hashlib
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from varos_warp.dataset import files
from varos_warp.dataset.layout import TIME
from varos_warp.dataset.noise_pass import is_repeatable, noise_of, noisy_pixels
from varos_warp.dataset.progress import in_threads
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.reader.exposures import MEAN, exposure_columns, exposure_rule, read_exposures
from varos_warp.dataset.reader.points import along_axis, pixel_rays
from varos_warp.dataset.reader.rows import sight
from varos_warp.dataset.validate import flows, objects, surfaces
from varos_warp.dataset.validate.completeness import Pending
from varos_warp.dataset.validate.outcome import Validation
from varos_warp.dataset.write.develop import dithered
from varos_warp.dataset.write.expose import twin_gains
from varos_warp.errors import InputError
from varos_warp.products.images.depth import DEPTH_LEVELS
from varos_warp.products.images.flow import FlowImage
from varos_warp.products.images.normals import decode_normal
from varos_warp.products.images.protocol import ImageProduct
from varos_warp.products.images.radiance import encode_color
from varos_warp.products.images.registry import OUTPUTS, colors
from varos_warp.render.image import exposure
from varos_warp.render.image.dither import Dither
from varos_warp.scene.description.image_types import DEPTH, FLOW, NORMALS, SEGMENTS, WATER
from varos_warp.scene.frames import inverse

BORDER_OF_C = 40
"""Steps of 8 bits by which C changes at a border: 18 degrees."""


def check_images(data: Dataset, result: Validation, pending: Pending, quiet: bool) -> None:
    """Every image decodes to its size and type; the 8 bit ones are their EXR exposed; C, D and S agree.

    A and B are looked at once the exposure of all frames is done.
    """
    problems: list[str] = []
    angles: list[float] = []
    frames, exposed = pending.ready(data), [] if pending.files else colors(data.outputs)
    boxes: dict[int, np.ndarray] = {}
    result.guard(lambda: boxes.update(objects.boxes(data)))
    for camera in data.cameras:
        exposures, sums = [Exposures(data, result, camera, output) for output in exposed], {}
        read = partial(_FrameImages, data, camera, exposures, boxes)
        for images in in_threads(f"images {camera}", read, frames, quiet=quiet):
            problems += images.found.problems
            result.files_read += images.found.files_read
            angles += images.angles
            for key, values in images.sums.items():
                sums[key] = sums.get(key, 0) + values
        for one in exposures:
            problems += one.verdicts()
        surfaces.check_sums(result, camera, sums)
        if "places" in sums:
            objects.check_places(data, result, camera, boxes, sums["places"])
    result.add_all(problems, "images")
    if angles:
        result.measure("C against the slopes of D, median angle", np.median(angles), 30.0, "deg")


class _FrameImages:
    """The images of one frame of a camera: each file is read once, and held against the others."""

    def __init__(
        self, data: Dataset, camera: str, exposures: list["Exposures"], boxes: dict[int, np.ndarray], frame: int
    ):
        self.data, self.camera, self.boxes, self.frame = data, camera, boxes, frame
        self.found = Validation(data.root)
        self.kept: dict[str, np.ndarray] = {}
        """What finished images hold, but those of radiance: several checks look at it."""
        self.angles: list[float] = []
        """The median angle between C and the slopes of D [deg], where there are both."""
        self.sums: dict[str, np.ndarray] = {}
        """Sums of `surfaces`: jumps of D at borders of ``S`` and ``C``, and ``slopes``; and of `objects`:
        ``places``."""
        self.shape = data.camera(camera)["height"], data.camera(camera)["width"]
        for one in exposures:
            self.found.guard(one.check, self)
        for output in data.outputs:
            self.found.guard(self._check, OUTPUTS[output])
        for pair, check in (
            (DEPTH, self._holes),
            (SEGMENTS, self._segments),
            (NORMALS, self._normals),
            (FLOW, self._flow),
        ):
            if {pair, DEPTH} <= {*data.outputs}:
                self.found.guard(check)

    def _check(self, product: ImageProduct) -> None:
        """What an image type checks itself."""
        for name, problem in product.check(self):
            self.tell(name, problem)

    def tell(self, name: str, problem: str) -> None:
        """Note a problem of a file."""
        self.found.problems.append(f"{name}: {problem}")

    def file(self, output: str) -> Path:
        """Path of the finished image."""
        return self.data.layout.image(self.camera, output, self.frame)

    def exr(self, path: Path) -> dict[str, np.ndarray]:
        """Channels of an EXR."""
        channels = files.read_exr(path)
        self.found.files_read += 1
        return channels

    def pixels(self, output: str) -> np.ndarray:
        """What a finished image holds, of the size and type that it must have."""
        if output in self.kept:
            return self.kept[output]
        product, pixels = OUTPUTS[output], files.read_image(self.file(output))
        self.found.files_read += 1
        shape = (*self.shape, 3) if product.channels == 3 else self.shape
        if pixels.shape != shape or pixels.dtype != product.dtype:
            raise InputError(
                f"is {pixels.dtype} {pixels.shape}, not {np.dtype(product.dtype)} {shape}", file=self.file(output)
            )
        return pixels if product.is_color else self.kept.setdefault(output, pixels)

    def along_axis(self, distance: np.ndarray) -> np.ndarray:
        """Distances [H, W] [m] along the pixels' rays in the water as planar depth."""
        return along_axis(distance, self.data.camera_model(self.camera))

    @cached_property
    def planar(self) -> np.ndarray:
        """D in metres along the camera's axis [H, W]."""
        return self.data.planar_depth(self.frame, self.camera, self.pixels(DEPTH))

    @cached_property
    def flow(self) -> FlowImage:
        """F with all its digits."""
        self.found.files_read += 1
        return self.data.flow(self.frame, self.camera)

    @cached_property
    def jumps(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Jumps of D, as `surfaces.jumps` has them."""
        return surfaces.jumps(self.pixels(DEPTH))

    @cached_property
    def has_normal(self) -> np.ndarray:
        """True where C has a surface, bool [H, W]."""
        x, y, z = np.moveaxis(self.pixels(NORMALS), -1, 0)
        return x | y | z > 0  # any(-1) is slow in numpy

    def _holes(self) -> None:
        """D has no hole where C or S goes on."""
        surface, labels = None, None
        if SEGMENTS in self.data.outputs:
            surface, labels = self.pixels(SEGMENTS) > 0, self.pixels(SEGMENTS)[..., None]
        elif NORMALS in self.data.outputs:
            surface, labels = self.has_normal, self.pixels(NORMALS)
        if surface is not None and (count := surfaces.holes(self.pixels(DEPTH), surface, labels)):
            self.tell(self.file(DEPTH).name, f"has holes: nothing in {count} pixels within a near surface")

    def _segments(self) -> None:
        """S has something wherever D has, and where the scene's objects are."""
        pixels = self.pixels(SEGMENTS)
        if ((pixels == 0) & (self.pixels(DEPTH) < DEPTH_LEVELS)).any():
            self.tell(self.file(SEGMENTS).name, "has nothing where D has a surface")
        self.sums[SEGMENTS] = surfaces.border_counts(self.jumps, pixels[..., None], 0)
        if self.boxes:
            model, T_w_c = self.data.camera_model(self.camera), sight(self.data, self.frame, self.camera)
            self.sums["places"] = objects.sums_in(self.planar, model, T_w_c, pixels, self.boxes)

    def _normals(self) -> None:
        """D has no surface within its range where C has none, C faces the camera, and D slopes as C says."""
        if ((self.pixels(DEPTH) < DEPTH_LEVELS) & ~self.has_normal).any():
            self.tell(self.file(NORMALS).name, "has no surface where D has one")
        self.sums[NORMALS] = surfaces.border_counts(self.jumps, self.pixels(NORMALS), BORDER_OF_C)
        away, cosine, sums = zip(*map(self._slopes, surfaces.bands(*self.shape)), strict=True)
        if (share := np.mean(away)) > 0.05:
            self.tell(self.file(NORMALS).name, f"{100 * share:.0f} % of its normals point away from the camera")
        if (cosine := np.concatenate(cosine)).size:
            self.angles.append(float(np.degrees(np.arccos(np.clip(np.median(cosine), -1, 1)))))
        self.sums["slopes"] = sum(sums)

    def _flow(self) -> None:
        """F follows from D, the poses and the camera."""
        if self.flow.flow.shape[:2] == self.shape:
            name = self.data.layout.exr(self.camera, FLOW, self.frame).name
            for problem in flows.against_depth(self.data, self.camera, self.frame, self.flow, self.pixels(DEPTH)):
                self.tell(name, problem)

    def _slopes(self, rows: slice) -> tuple[float, np.ndarray, np.ndarray]:
        """Share of C that points away, cosines of C and the slopes of D, `surfaces.slope_sums`; of a band of rows."""
        depth = self.planar[rows]
        # in the camera's axes and about it, so that single precision is enough wherever the world's origin is
        model, T_w_c = self.data.camera_model(self.camera), self.data.T_w_c(self.frame, self.camera)
        R, (row, col) = T_w_c[:3, :3].astype(np.float32), np.indices(depth.shape)
        origins, rays = pixel_rays(model, row + rows.start, col)
        origins, rays = origins.astype(np.float32), rays.astype(np.float32)
        along = depth if model.is_pinhole else (depth - origins[..., 2]) / rays[..., 2]
        if (T_w_rows := sight(self.data, self.frame, self.camera)).ndim == 3:
            T = (inverse(T_w_c) @ T_w_rows[rows]).astype(np.float32)  # to the axes at the time stamp
            origins, rays = (
                np.einsum("hij,hwj->hwi", T[:, :3, :3], np.broadcast_to(x, rays.shape)) for x in (origins, rays)
            )
            origins = origins + T[:, None, :3, 3]
        normal, to_pixel = decode_normal(self.pixels(NORMALS)[rows]), rays @ R.T
        away = np.einsum("...i,...i", normal, to_pixel) > 0.2 * np.sqrt(np.einsum("...i,...i", rays, rays))
        with np.errstate(invalid="ignore"):
            slope = surfaces.normals_of(origins + rays * along[..., None].astype(np.float32), rays) @ R.T
        noise = surfaces.slope_noise(depth, model.K, self.data.meta["depth"]["scale_m"])
        both = np.isfinite(slope).all(-1) & self.has_normal[rows]
        return (
            float(away.mean()),
            np.einsum("...i,...i", slope[both], normal[both]),
            surfaces.slope_sums(normal, slope, noise, rows.start, self.shape[0]),
        )


# ------------------------------------------------------------------------------------------------------------- A and B


class Exposures:
    """A, B or P of one camera: of PNG, EXR and table of exposures, the one that does not fit the others is named.

    The table holds statistics of each EXR, gains that follow from the statistics of all frames, and each PNG is an EXR
    times its gain. What a wrong file holds instead is looked for among the other frames.
    """

    def __init__(self, data: Dataset, result: Validation, camera: str, output: str):
        self.data, self.result, self.camera, self.output = data, result, camera, output
        self.path = data.layout.exposures(camera, output)
        self.has_noise = output == WATER and data.has_noise(WATER)
        self.rule = exposure.Rule("adaptive")
        self.dither = Dither(data.meta["seed"]) if data.is_dithered else None
        self.expected: dict[str, int] = {}
        """Frame by the digest of what its PNG must be."""
        self.wrong_png: dict[int, str] = {}
        """Digest by frame."""
        self.wrong_statistics: dict[int, exposure.Statistics] = {}
        self.flaw, self.table = None, {}
        """Gain and statistics by frame, or why the table cannot be used."""
        try:
            self.rule = exposure_rule(data.meta, data.camera(camera), output, data.layout.metadata)
            rows = read_exposures(self.path, self.rule)
            if bad := [f for f in data.frames if f not in rows or not _is_positive(rows[f][0])]:
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
        if not _same(found := self.rule.statistics(linear), known):
            self.wrong_statistics[frame] = found
        if self.has_noise:
            if is_repeatable(data) and not np.array_equal(noisy_pixels(data, *noise_of(data), frame, camera), pixels):
                images.tell(images.file(WATER).name, "is not its EXR with the noise of dataset.json")
            pixels = data.pixels(WATER, frame, camera, truth=True)
        made = self._developed(linear, gain, frame)
        self.expected.setdefault(_digest(made), frame)
        if not np.array_equal(made, pixels):
            self.wrong_png[frame] = _digest(pixels)

    def _developed(self, linear: np.ndarray, gain: exposure.FrameGain, frame: int) -> np.ndarray:
        """What the PNG of linear radiance must be."""
        matrix = self.data.color_matrix(self.camera)
        if self.dither is None:
            return encode_color(linear, gain, matrix)
        return dithered(linear.astype(np.float16), gain, self.dither, self.camera, self.output, frame, matrix)

    def verdicts(self) -> list[str]:
        """What is wrong, once all frames are read."""
        if self.flaw:
            return [self.flaw]
        return self._wrong_gains() + [self._verdict(f) for f in sorted(self.wrong_png.keys() | self.wrong_statistics)]

    def _verdict(self, frame: int) -> str:
        statistics = self.wrong_statistics.get(frame)
        png = self.data.layout.image(self.camera, self.output, frame).name
        png = f"{WATER}_clean/{png}" if self.has_noise else png
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
        known = self.table[frame][1]
        if self.rule.balance is not None and _same(replace(statistics, channels=known.channels), known):
            where = self.result.cell(self.path, list(self.table).index(frame), "highlight_red")
            return f"{where}: statistics of the channels of frame {frame} are not those of its EXR"
        if self.rule.meter and _same(replace(statistics, metered=known.metered, mean=known.mean), known):
            column = MEAN if statistics.metered == known.metered else self.rule.meter.column
            where = self.result.cell(self.path, list(self.table).index(frame), column)
            return f"{where}: is not what its meter reads in the EXR of frame {frame}"
        where = self.result.cell(self.path, list(self.table).index(frame), "log_average")
        return f"{where}: log_average and highlight of frame {frame} are not those of its EXR"

    def _wrong_gains(self) -> list[str]:
        """Gains follow from the statistics of all frames, as the scene asks for, or of P from those of A."""
        made, problem = self._expected_gains()
        wrong = [
            f for f, gain in zip(self.table, made, strict=True) if not np.isclose(self.table[f][0], gain, 1e-9, 0).all()
        ]
        if not wrong:
            return []
        more = f" and of {len(wrong) - 1} more" if wrong[1:] else ""
        where = self.result.cell(self.path, list(self.table).index(wrong[0]), exposure_columns(self.rule)[1])
        return [f"{where}: the gain of frame {wrong[0]}{more} {problem}"]

    def _expected_gains(self) -> tuple[np.ndarray, str]:
        """What the gains of the table should be, and what is wrong with others."""
        rule = self.rule
        if OUTPUTS[self.output].like:
            weight = self.data.camera_model(self.camera).axis_weight
            of_a = twin_gains(self.data.layout, rule, self.camera, list(self.table), weight)
            if of_a is not None:
                return of_a, "is not that of A times what the port lets through"
        time_s = files.read_csv(self.path)[TIME] * 1e-9
        made = rule.gains(self.output, time_s, [known for _, known in self.table.values()])
        told = "log_average and highlight" if rule.meter is None else f"{rule.meter.column} and {MEAN}"
        told += "" if rule.balance is None else f", with those of channels, and by the white balance {rule.balance}"
        shown = rule.gain if rule.meter is None else rule.meter.model_dump()
        return made, f"does not follow from the table's {told} by the exposure {shown!r}"


def _of_channels(known: exposure.Statistics) -> list[float]:
    channels = known.channels
    return [] if channels is None else [*channels.highlight, *channels.mean, *(channels.metered or ())]


def _is_positive(gain: exposure.FrameGain) -> bool:
    return bool(np.all(np.greater(gain, 0.0) & np.isfinite(gain)))


def _same(one: exposure.Statistics, other: exposure.Statistics) -> bool:
    """Equal to the rounding of a mean of logarithms."""
    numbers = [
        [known.log_average, known.highlight, known.metered or 0.0, known.mean or 0.0, *_of_channels(known)]
        for known in (one, other)
    ]
    return np.allclose(*numbers, 1e-9, 0, equal_nan=True)


def _digest(pixels: np.ndarray) -> str:
    return hashlib.sha256(np.ascontiguousarray(pixels).tobytes()).hexdigest()
