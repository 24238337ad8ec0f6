"""The steps from mesh files to a terrain, timed and counted: what ``varos-warp preprocess`` does."""

import contextlib
import sys
import time
from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from pydantic import ValidationError

from varos_warp.errors import InputError, warn
from varos_warp.scene.description.placed import Placed
from varos_warp.scene.description.survey import ENDINGS, Heights, ending
from varos_warp.scene.description.world import Preprocess
from varos_warp.scene.file.problems import input_error
from varos_warp.scene.file.source import Source
from varos_warp.scene.geometry.joining import crop, join, median_edge, merge_equal, merge_near
from varos_warp.scene.geometry.mesh_files import read_mesh
from varos_warp.scene.geometry.rounding import single_precision_step
from varos_warp.scene.geometry.survey import Survey, read_survey
from varos_warp.scene.geometry.terrain import repair
from varos_warp.scene.geometry.terrain.closing import close, without_skirt
from varos_warp.scene.geometry.terrain.comparison import DISTANCE_SAMPLES, compare, mesh_facts
from varos_warp.scene.geometry.terrain.decimation import decimate_closed
from varos_warp.scene.geometry.terrain.kept import Model
from varos_warp.scene.geometry.terrain.smoothing import ROUGH_DEG, roughness_deg, smooth
from varos_warp.scene.geometry.terrain.wrapping import is_sheet, shrinkwrap

STEPS = ("read", "merge", "repair", "smooth", "shrinkwrap", "decimate", "close", "compare")

NOT_READING = ("kind", "file", "origin", "preprocess", "detail", "shading")
"""Keys of a terrain of kind heights that do not tell how its files are read, beside those of ``Placed``."""
FAR_M = 10_000.0
"""How far away a mesh must lie to be worked on about its own lower corner [m]."""
SMOOTH = "--smooth 10, or smoothing_rounds: 10"


@dataclass
class Log:
    """What was done to a mesh: seconds of wall clock and counts by step, and warnings."""

    progress: object = None
    """Called with the name of a step and the share of it that is done, 0 to 1."""
    seconds: Counter = field(default_factory=Counter)
    counts: Counter = field(default_factory=Counter)
    warnings: list = field(default_factory=list)
    closed: bool = False
    """True if the mesh has got a skirt."""

    @contextlib.contextmanager
    def step(self, name: str):
        """Time a step; yields a function that takes the share that is done."""

        def share(done):
            if self.progress is not None:
                self.progress(name, done)

        start = time.perf_counter()
        share(0.0)
        yield share
        self.seconds[name] += time.perf_counter() - start
        share(1.0)

    def count(self, mesh_and_counts):
        """Take the counts of a repair; returns its mesh."""
        mesh, counts = mesh_and_counts
        self.counts.update(counts)
        return mesh


def preprocess(vertices, faces, *, key="preprocess", device="cpu", log=None, **options):
    """A terrain made fit for use.

    Args:
        vertices: float64 [V, 3] [m].
        faces: int32 [F, 3].
        key: Where the options stand, for messages.
        device: Where the projections run.
        log: Takes times, counts and warnings; none: warnings are Python's.
        options: Those of ``scene.description.world.Preprocess``.

    Returns:
        Vertices float64 [V, 3] and faces int32 [F, 3].

    Raises:
        InputError: Nothing is left, the tolerance is larger than the mesh's edges, an option is none, or a step ruins
            the mesh.
    """
    try:
        asked = Preprocess(**options)
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(
            first["msg"].removeprefix("Value error, "),
            key=".".join(map(str, (key, *first["loc"]))),
            value=first["input"],
            remedy="docs/terrain.md tells of the options.",
        ) from None
    if log is None:
        result = preprocess(vertices, faces, key=key, device=device, log=(log := Log()), **options)
        for text in log.warnings:
            warn(f"{key}: {text}")
        return result
    vertices, faces, origin = _repair(vertices, faces, asked, key, device, log)
    asked = _about(origin, asked)
    wraps, decimates = asked.shrinkwrap_resolution is not None, asked.target_vertices is not None
    model, sheet = Model(vertices, faces, device, asked.region) if wraps or decimates else None, False
    if wraps:
        with log.step("shrinkwrap") as share:
            sheet = is_sheet(vertices, faces)
            vertices, faces = _wrap(vertices, faces, asked, sheet, device=device, key=key, share=share)
            log.counts["vertices_of_the_shrinkwrap"] = len(vertices)
            _refuse_loss(
                model,
                (vertices, faces),
                log,
                key=f"{key}.shrinkwrap_resolution",
                value=asked.shrinkwrap_resolution,
                remedy="Leave the shrinkwrap out (--shrinkwrap none, or no such key): the model is thinner "
                "than it can tell, or in pieces; or give it one side of a shell only",
            )
    how = asked.close if sheet else "none"
    if decimates:
        vertices, faces = _decimate(vertices, faces, asked, how, sheet, model=model, key=key, log=log)
    with log.step("close"):
        log.closed = how != "none"
        vertices, faces = close(vertices, faces, how)
    return vertices + origin if origin.any() else vertices, faces


def _far_origin(vertices) -> np.ndarray:
    """Return where to work on a mesh, float64 [3]: its lower corner along the axes in which it is far away, else 0.

    Steps that decide by the last digits, as decimation does, then give a mesh at UTM coordinates as at the origin.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    return np.where((low > FAR_M) | (high < -FAR_M), np.floor(low), 0.0)


def _about(origin, asked: Preprocess) -> Preprocess:
    """Return the options with the region about another origin."""
    if asked.region is None or not origin.any():
        return asked
    xmin, ymin, xmax, ymax = np.subtract(asked.region, np.tile(origin[:2], 2)).tolist()
    return asked.model_copy(update={"region": (xmin, ymin, xmax, ymax)})


def _decimate(vertices, faces, asked, how, sheet, *, model, key, log):
    """The surface with as many vertices as asked, closed as ``how`` says; as it is if it has fewer."""
    target, count = asked.target_vertices, len(close(vertices, faces, how)[0])
    if target > count:
        log.warnings.append(
            f"{target} vertices were asked for, but the surface has only {count}, and decimation adds "
            "none; a larger --shrinkwrap N (shrinkwrap_resolution) makes it finer"
        )
    if target >= count:
        return vertices, faces
    with log.step("decimate") as share:
        vertices, faces = decimate_closed(vertices, faces, target, how, sheet, share)
        wrong = {"key": f"{key}.target_vertices", "value": target}
        remedy = "Raise it or leave the decimation out"
        if len(faces) == 0 or len(close(vertices, faces, how)[0]) > target:
            raise InputError("nothing is left of the mesh with so few vertices", **wrong, remedy=f"{remedy}.")
        _refuse_loss(model, (vertices, faces), log, **wrong, remedy=f"{remedy}; smooth a rough survey first ({SMOOTH})")
    return vertices, faces


def _wrap(vertices, faces, asked, sheet, *, device, key, share):
    """The model shrinkwrapped; a refusal names the key."""
    try:
        return shrinkwrap(
            vertices, faces, asked.shrinkwrap_resolution, asked.region, sheet=sheet, device=device, progress=share
        )
    except InputError as error:
        raise error.but(key=f"{key}.{error.key}", value=asked.shrinkwrap_resolution) from None


def _refuse_loss(model, mesh, log, *, key, value, remedy):
    """Refuse what a step made of the model if it is a ruin; warn if it lost much."""
    lost, ruined = model.lost_in(*mesh)
    if lost is not None and not ruined:
        log.warnings.append(f"{key} {lost}")
    if ruined:
        raise InputError(lost, key=key, value=value, remedy=f"{remedy}.")


def _repair(vertices, faces, asked, key, device, log):
    """Return the mesh cropped, merged, cleaned, its faces up, its holes filled, smoothed; about an origin [3]."""
    with log.step("merge"):
        vertices, faces = log.count(repair.drop_not_finite(vertices, faces))
        if asked.region is not None and len(faces):
            vertices, faces = crop(vertices, faces, asked.region, key)
        count, origin = len(vertices), _far_origin(vertices) if len(faces) else np.zeros(3)
        if origin.any():
            vertices = vertices - origin
        if len(faces):
            vertices, faces = merge_near(vertices, faces, asked.merge_tolerance_m, key)
        log.counts["merged_vertices"] += count - len(vertices)
    with log.step("repair"):
        vertices, faces = log.count(repair.drop_useless(vertices, faces))
        if len(faces) == 0:
            raise InputError(
                "no triangles are left",
                key=key,
                remedy="All were degenerate: look at the mesh, and lower merge_tolerance_m.",
            )
        vertices, faces = log.count(repair.orient(vertices, faces, device))
        widest = repair.HOLE_EDGES * median_edge(vertices, faces) if asked.fill_holes_m is None else asked.fill_holes_m
        vertices, faces = log.count(repair.fill_holes(vertices, faces, widest))
    with log.step("smooth"):
        if asked.smoothing_rounds:
            vertices = smooth(vertices, faces, asked.smoothing_rounds)
        rough = roughness_deg(vertices, faces) if asked.target_vertices is not None else 0.0
        if rough > ROUGH_DEG and is_sheet(vertices, faces):
            log.warnings.append(
                f"the survey is rough: neighbouring faces differ by {rough:.0f} degrees on average, "
                f"and fewer of them will be shards; smooth it first ({SMOOTH})"
            )
    return vertices, faces, origin


def preprocess_meshes(
    files,
    vertices: int | None = None,
    *,
    scale: float = 1.0,
    up_axis: str | None = None,
    region=None,
    samples: int = DISTANCE_SAMPLES,
    device: str = "cpu",
    progress=None,
    survey: dict | None = None,
    **options,
):
    """Join mesh and survey files and make one terrain of them; what ``varos-warp preprocess`` does.

    Args:
        files: Mesh files, and survey files of one kind, which are read together.
        vertices: Target number of vertices; none: do not decimate.
        scale: What the coordinates are multiplied by, to be metres.
        up_axis: Which axis of the files points up: x, y or z; none: as they say.
        region: See ``Preprocess``; so too the other options.
        samples: Points on either surface from which the error is measured.
        device: Where the projections run.
        progress: Called with the name of a step and the share of it that is done.
        survey: Keys of ``scene.description.survey.Heights`` for the survey files.

    Returns:
        The mesh (vertices float64 [V, 3], faces int32 [F, 3]) and a report: ``before`` (vertices at the same place
        taken for one) and ``after`` as from ``mesh_facts``, the distances and normals of ``compare`` (of the surface,
        without skirt and bottom), the facts of the ``survey`` if there is one, ``counts`` of what was removed and
        added, ``seconds`` by step, ``peak_memory_gb`` of the process, and ``warnings``.
    """
    log = Log(progress)
    with log.step("read"):
        read = _read_survey([file for file in files if ending(str(file)) in ENDINGS], survey)
        meshes = [read_mesh(file, "MESH", up_axis) for file in files if ending(str(file)) not in ENDINGS]
        original = join([*([(read.vertices, read.faces)] if read else []), *meshes])
        if len(original[1]) == 0:
            raise InputError("no mesh files are given", key="MESH", remedy="Name at least one.")
        original = log.count(repair.drop_not_finite(original[0] * scale, original[1]))
        count = len(original[0])
        original = merge_equal(*original)
        log.counts["merged_vertices"] += count - len(original[0])
    if len(original[1]) == 0:
        raise InputError("no triangles are left", key="MESH", remedy="All have vertices that are NaN or infinite.")
    warning = repair.suspicious_size(original[0])
    log.warnings += [warning] if warning else []
    log.warnings += read.warnings if read else []
    if step := single_precision_step(original[0] / scale):
        log.warnings.append(f"places were rounded to {step:.2g} m, as single precision has them so far from the origin")
    result = preprocess(*original, region=region, target_vertices=vertices, device=device, log=log, **options)
    with log.step("compare"):
        surface = without_skirt(*result, result[0][:, 2].min()) if log.closed else result
        compared = original if region is None else crop(*original, region, "preprocess")
        report = {
            "files": [str(file) for file in files],
            "before": mesh_facts(*original),
            "after": mesh_facts(*result),
            **compare(compared, surface, samples, device=device, region=region),
        }
    if read:
        report["survey"] = read.facts
    return result, {
        **report,
        "counts": dict(log.counts),
        "seconds": {k: round(v, 3) for k, v in log.seconds.items()},
        "peak_memory_gb": _peak_gb(),
        "warnings": log.warnings,
    }


def _read_survey(files, keys: dict | None) -> Survey | None:
    """Return the surface of survey files; None if there are none."""
    if not files:
        if keys:
            raise InputError(
                "is for survey files, and none is given",
                key="survey",
                remedy=f"Leave it out; survey files are {', '.join(ENDINGS)}.",
            )
        return None
    if other := sorted(set(keys or ()) & {*Placed.model_fields, *NOT_READING}):
        raise InputError(
            "does not tell how survey files are read",
            key=f"survey.{other[0]}",
            remedy="Leave it out; a scene that names the result can have it.",
        )
    block = {**(keys or {}), "kind": "heights", "file": [str(file) for file in files]}
    try:
        asked = Heights(**block)
    except ValidationError as error:
        found = input_error(error, Source(block, Heights))
        more = f"{found.remedy or ''} `varos-warp schema terrain.heights` tells of the keys.".strip()
        raise found.but(key=f"survey.{found.key}", remedy=more) from None
    return read_survey(asked, key="survey")


def _peak_gb() -> float | None:
    """Peak memory of the process [GB]; None where the system does not tell."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    unit = 1e-9 if sys.platform == "darwin" else 1024e-9
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit, 3)
