"""Facts for the page, as tables: the dataset, its water, cameras and sensors, the plan, the runs, what looks wrong."""

import contextlib
import itertools
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
import yaml

from varos_warp.dataset import files
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.reader.rows import lasts
from varos_warp.dataset.report.curves import ROUNDING, logs
from varos_warp.dataset.validate.outcome import KEPT
from varos_warp.dataset.write.pictures import Filmstrip, whole_frames
from varos_warp.errors import InputError, counted
from varos_warp.products.images.registry import OUTPUTS
from varos_warp.scene.description.image_types import WATER
from varos_warp.scene.optics.distortion import lens_of

MOST_WARNINGS = 40
"""Listed singly."""


class Table(NamedTuple):
    """Plain text; the first column names the rows. On a narrow screen each row becomes a block of named values."""

    rows: Sequence[Sequence[Any]]
    header: Sequence[str] = ()
    kind: str = ""


class Note(NamedTuple):
    """A paragraph of plain text."""

    text: str
    kind: str = "note"


Blocks = list[Table | Note]
"""Tables and notes, as data/report/blocks.html shows them."""


def number(x: float) -> str:
    """Four digits; what only rounding leaves is 0."""
    return f"{0.0 if abs(x) < ROUNDING else x:.4g}"


def numbers(values: Iterable[float], unit: str = "") -> str:
    """Four digits each."""
    return ", ".join(map(number, values)) + (f" {unit}" if unit else "")


# --------------------------------------------------------------------------------------------------------- the dataset


def shown(data: Dataset, strip: Filmstrip) -> str:
    """Tell which frames the page shows."""
    total = len(whole_frames(data, data.cameras[0]))
    of = f"{len(strip.frames)} of {counted(total, 'frame')}, evenly spread"
    return "every frame" if len(strip.frames) == total else of


def headline(data: Dataset) -> list[tuple[str, str]]:
    """(value, name) of what a person asks first."""
    meta, rate = data.meta, data.meta["frames"]["rate_hz"]
    of = counted(meta["frames"]["of"], "frame")
    tiles = [
        (f"{len(data)}", of.partition(" ")[2] if len(data) == meta["frames"]["of"] else f"of {of}"),
        (f"{len(data) / rate:.4g} s", f"at {rate:g} Hz"),
    ]
    if "vehicle" in data.recorded:
        state = data.states()
        step = np.linalg.norm(np.diff(state["position"], axis=0), axis=1)
        depth = meta["surface_depth_m"] - state["position"][:, 2]
        speed = np.linalg.norm(state["velocity"], axis=1).mean()
        tiles += [
            (f"{step.sum():.3g} m", "course"),
            (f"{speed:.2g} m/s", "mean speed"),
            (f"{depth.min():.4g}–{depth.max():.4g} m", "depth"),
        ]
    first = data.camera()
    tiles.append(
        (
            f"{first['width']} × {first['height']}",
            "pixels" if len(data.cameras) == 1 else f"pixels, {len(data.cameras)} cameras",
        )
    )
    seconds = [row["seconds"] for log in logs(data) for row in log["frames"]]
    return tiles + ([(f"{np.median(seconds):.3g} s", "to render a frame")] if seconds else [])


def water(data: Dataset) -> Blocks:
    """Optical properties by channel, or by band."""
    w = data.meta["water"]
    if "bands" in w:
        return _bands(w)
    sigma_t = np.add(w["sigma_a"], w["sigma_s"])
    with np.errstate(divide="ignore"):
        rows = [
            ("absorption a [1/m]", w["sigma_a"]),
            ("scattering b [1/m]", w["sigma_s"]),
            ("extinction c [1/m]", sigma_t),
            ("albedo b / c", w["albedo"]),
            ("mean free path [m]", 1 / sigma_t),
            ("a tenth of the light left at [m]", np.log(10) / sigma_t),
        ]
    text = Table([(name, *map(number, values)) for name, values in rows], ("", "red", "green", "blue"), "numbers rgb")
    phase = {"henyey_greenstein": "Henyey-Greenstein", "fournier_forand": "Fournier-Forand"}.get(w["phase"], w["phase"])
    return [text, Note(f"Given as {w['source']}; {phase} phase function, g = {w['g']:g}.")]


def _bands(w: dict) -> Blocks:
    """Water by wavelength, in the bands of each camera."""
    rows = [
        (bands["camera"], f"{nm:g}", number(a), number(b), number(a + b))
        for bands in w["bands"]
        for nm, a, b in zip(bands["wavelength_nm"], bands["a"], bands["b"], strict=True)
    ]
    text = Table(rows, ("camera", "band [nm]", "a [1/m]", "b [1/m]", "c [1/m]"), "numbers")
    return [text, Note(f"By wavelength: {w['water']}; {w['phase']} phase function of particles, g = {w['g']:g}.")]


def cameras(data: Dataset) -> Blocks:
    """Calibration, and where each camera is."""
    rows = []
    for about in data.meta["cameras"]:
        K = np.array(about["K_opencv"])
        fov = np.degrees(data.camera_model(about["id"]).field_of_view(about["width"], about["height"]))
        place = np.array(about.get("T_v_c") or about.get("T_w_c") or np.full((4, 4), np.nan))[:3, 3]
        stop = f"{about.get('f_stop') or 'pinhole'}{_optics(about)}"
        rows.append(
            (
                about["id"],
                f"{about['width']} × {about['height']}",
                numbers((K[0, 0], K[1, 1])),
                numbers((K[0, 2], K[1, 2])),
                f"{fov[0]:.1f}° × {fov[1]:.1f}°",
                stop,
                number(about["focus_m"]) if about.get("focus_m") else "–",
                f"{about['mount']}: {numbers(place)}",
            )
        )
    files_of_rays = [about["rays"] for about in data.meta["cameras"] if about.get("rays")]
    words = f"Rays of every pixel through lens and port: {', '.join(files_of_rays)}."
    found = Table(
        rows,
        (
            "camera",
            "pixels",
            "fx, fy [px]",
            "cx, cy (OpenCV)",
            "field of view",
            "f-stop",
            "focus [m]",
            "mounted on, at [m]",
        ),
        "numbers",
    )
    return [found, Note(words)] if files_of_rays else [found]


def _optics(about: dict) -> str:
    """Lens, port and shutter in words."""
    lens, port = about.get("distortion"), about.get("port")
    coefficients = lens_of(**lens).k if isinstance(lens, dict) else ()
    return (
        (f", {lens['model']} {numbers(coefficients)}" if isinstance(lens, dict) else "")
        + (f", behind a {port['kind']} port, n = {numbers(about['n_water'])}" if port else "")
        + (f", vignetting {about['vignetting']['kind']}" if about.get("vignetting") else "")
        + (
            f", exposed for {1e3 * about['exposure']['time_s']:g} ms"
            + (f", rolling in {1e3 * readout_s:g} ms" if (readout_s := about["exposure"]["readout_s"]) else "")
            if lasts(about)
            else ""
        )
    )


def _beam(light: dict) -> str:
    """The shape of a light in words."""
    words = {
        "cone_deg": "cone {:g}°",
        "fan_deg": "fan {:g}°",
        "thickness_deg": "{:g}° thick",
        "radius_m": "radius {:g} m",
    }
    found = [word.format(light[key]) for key, word in words.items() if light.get(key)]
    if strobe := light.get("strobe"):
        found.append(f"flashes for {1e3 * strobe['on_s']:g} ms, {1e3 * strobe['delay_s']:g} ms after the time stamp")
    return ", ".join(found)


def equipment(data: Dataset) -> Blocks:
    """Lights and sensors."""
    lights = {f"light {i}": light for i, light in enumerate(data.meta["lights"])}
    for entry in data.meta.get("moving") or ():
        lights |= {f"{entry['key']}, light {i}": light for i, light in enumerate(entry.get("lights") or ())}
    rows = [
        (
            name,
            f"{light.get('kind', '')}, {numbers(light.get('intensity') or (), 'W/sr')}",
            numbers(light.get("position") or (), "m"),
            _beam(light),
        )
        for name, light in lights.items()
    ]
    for name, sensor in data.meta["sensors"].items():
        rows.append(
            (
                name,
                f"{sensor['rate_hz']:g} Hz",
                numbers(np.array(sensor["T_v_s"])[:3, 3], "m"),
                "with noise" if sensor["noise"] else "noise-free",
            )
        )
    return [Table(rows, ("", "", "on its vehicle at", ""), "numbers")]


# ------------------------------------------------------------------------------------------------- plan and rendering


def plan(data: Dataset) -> Blocks:
    """What was decided, why, and the error that it makes; and what makes each output."""
    samples = data.meta["samples"]
    chosen = samples["plan"]
    if not chosen:
        return [Note("Nothing is rendered yet.", "empty")]
    rows = [(d["what"], d["choice"], *_percent(d.get("error")), d["reason"]) for d in chosen.get("decisions") or ()]
    if chosen.get("error"):
        rows.append(("in all", "", *_percent(chosen["error"]), "predicted relative RMSE of an image"))
    text = Table(rows, ("decision", "choice", "red %", "green %", "blue %", "why"), "plan")
    models = [
        (letter, f"{OUTPUTS[letter].content}: {how}")
        for letter, how in (chosen.get("models") or {}).items()
        if letter in data.outputs
    ]
    by = [samples[key] or "nothing" for key in ("denoise", "denoise_b")]
    return [text, Table(models), Note(f"A denoised with {by[0]}, B with {by[1]}.")]


def _percent(error) -> list[str]:
    return ["", "", ""] if not error else [f"{100 * e:.2f}" for e in error]


def timings(data: Dataset) -> Blocks:
    """The runs that rendered the dataset."""
    rows = []
    for log in logs(data):
        seconds = np.array([row["seconds"] for row in log["frames"]])
        rows.append(
            (
                _minute(log.get("ended", "")),
                f"{log.get('model')} ({log.get('device')})",
                len(seconds),
                f"{seconds.sum():.1f} s",
                f"{np.median(seconds):.3g} s" if len(seconds) else "",
                f"{log.get('compile_seconds', 0):.1f} s",
            )
        )
    if not rows:
        return [Note("No run left a log.", "empty")]
    text = Table(rows, ("ended (UTC)", "device", "images", "in all", "median", "compiling"), "numbers")
    stages: Counter[str] = Counter()
    for log in logs(data):
        stages.update(log.get("stages") or {})
    went = ", ".join(f"{stage} {seconds:.1f} s" for stage, seconds in stages.items() if seconds >= 0.05)
    return [text, Note(f"Where the time of the runs went: {went}.")] if went else [text]


def said(data: Dataset) -> list[str]:
    """Messages of the runs, each once."""
    return list(dict.fromkeys(str(message) for log in logs(data) for message in log.get("messages") or []))


def provenance(data: Dataset) -> Blocks:
    """What made the dataset, and of what."""
    meta = data.meta
    rows = [
        ("name", meta["name"]),
        ("sequence, vehicle", f"{meta['sequence']}, {meta['vehicle']}"),
        ("seed", meta["seed"]),
        ("outputs", "; ".join(f"{o}: {OUTPUTS[o].content}" for o in data.outputs) or "none"),
        (
            "depth",
            "{}, {:g} to {:g} m, steps of {:.3g} mm".format(
                meta["depth"]["kind"], *meta["depth"]["range_m"], 1000 * meta["depth"]["scale_m"]
            ),
        ),
        ("noise", _noise(data)),
        ("device", (meta["device"] or {}).get("model", "nothing rendered yet")),
        ("versions", ", ".join(f"{package} {version}" for package, version in meta["versions"].items())),
        *((f"file {name}", f"SHA-256 {digest}") for name, digest in meta["sources"].items()),
    ]
    return [Table(rows)]


def scene_text(data: Dataset) -> str:
    """The scene, every key, as YAML."""
    return yaml.safe_dump(data.meta["scene"], sort_keys=False, default_flow_style=None, width=110)


def _noise(data: Dataset) -> str:
    """Source of the noise in words: a profile, the scene, or none."""
    added = data.meta.get("noise")
    if added and not data.has_scene_noise:
        return f"of the profile {added['profile']['name']}, seed {added['seed']}"
    noisy = [name for name in (*data.meta["sensors"], WATER) if data.has_noise(name)]
    return f"of the scene, in {', '.join(noisy)}" if noisy else "none"


# ------------------------------------------------------------------------------------------------------------ warnings


def warnings(data: Dataset, scene: list[str]) -> list[str]:
    """What a person should know before using the dataset, with what looks wrong in its scene."""
    found = []
    for camera, output in itertools.product(data.cameras, data.outputs):
        missing = [f for f in data.frames if not files.is_complete(data.layout.image(camera, output, f))]
        if missing:
            found.append(
                f"camera {camera}: {output} of {len(missing)} of {counted(len(data), 'frame')} is missing, "
                f"the first of frame {missing[0]}"
            )
    found += scene
    for log in logs(data):
        lost = {row["frame"]: row["lost_samples"] for row in log["frames"] if row.get("lost_samples")}
        if lost:
            found.append(
                f"{counted(sum(lost.values()), 'sample')} in {counted(len(lost), 'frame')} were infinite or "
                f"not a number and count as black; the first in frame {min(lost)}"
            )
    if result := validation(data):
        found += [f"validate: {problem}" for problem in result["problems"]]
    found = list(dict.fromkeys(found))
    more = len(found) - MOST_WARNINGS
    return found if more <= 0 else [*found[:MOST_WARNINGS], f"and {more} more"]


def validation(data: Dataset) -> dict[str, Any] | None:
    """What the last `varos-warp validate` found; None: there was none."""
    with contextlib.suppress(InputError):
        result = files.read_json(data.root / KEPT)
        if isinstance(result, dict) and isinstance(result.get("problems"), list):
            return result
    return None


def measures(data: Dataset) -> dict[str, Any] | None:
    """What `varos-warp validate` measured: ``when``, ``words`` on its problems, ``measures``; None: it did not run."""
    result = validation(data)
    if result is None:
        return None
    rows = [
        (m["name"], "–" if m["value"] is None else f"{m['value']:.4g}", f"{m['limit']:.4g}", m["unit"])
        for m in result.get("measures", [])
    ]
    return {
        "when": _minute(result.get("ended", "")),
        "words": counted(len(result["problems"]) or "no", "problem"),
        "measures": [Table(rows, ("measure", "value", "limit", "unit"), "numbers")],
    }


def _minute(stamp: str) -> str:
    """An ISO time without seconds and zone."""
    return str(stamp).replace("T", " ")[:16]
