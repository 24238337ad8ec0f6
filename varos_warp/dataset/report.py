"""What a person looks at: a contact sheet of the images, and one self-contained HTML page of a whole dataset."""

import base64
import html
import io
from pathlib import Path

import numpy as np

from varos_warp.dataset import files
from varos_warp.dataset.layout import Dataset
from varos_warp.errors import InputError

# ------------------------------------------------------------------------------------------------------------- images


def spread(frames: list[int], count: int) -> list[int]:
    """At most ``count`` of the frames, evenly spread from the first to the last."""
    picks = np.unique(np.linspace(0, len(frames) - 1, min(count, len(frames))).round().astype(int))
    return [frames[i] for i in picks]


def preview(data: Dataset, output: str, frame: int, camera: str | None, width: int):
    """A small picture (PIL) for the eye: A, B and C as they are, D from near (bright) to far (dark), S by object."""
    from PIL import Image

    pixels = data.pixels(output, frame, camera)
    if output == "D":
        pixels = _depth_colors(pixels)
    elif output == "S":
        pixels = _segment_colors(pixels)
    image = Image.fromarray(pixels)
    return image.resize((width, max(1, round(image.height * width / image.width))), Image.Resampling.BOX)


def _depth_colors(pixels: np.ndarray) -> np.ndarray:
    """Colours of D over the distances that this image has; black where nothing is within the range."""
    from matplotlib import colormaps

    hit = pixels < 65535
    near, far = (pixels[hit].min(), pixels[hit].max()) if hit.any() else (0, 1)
    near, far = float(near) + 1.0, float(far) + 2.0
    share = np.log(far / (pixels + 1.0)) / np.log(far / near)
    colors = (colormaps["viridis"](np.clip(share, 0, 1))[..., :3] * 255).astype(np.uint8)
    colors[~hit] = 0
    return colors


def _segment_colors(pixels: np.ndarray) -> np.ndarray:
    """A colour for each number, unlike those of its neighbours (hues a golden section apart); black where it is 0."""
    from matplotlib.colors import hsv_to_rgb

    number = pixels.astype(float)
    hsv = np.stack([number * 0.618034 % 1.0, 0.4 + 0.5 * (number * 0.37 % 1.0), np.where(pixels > 0, 0.95, 0.0)], -1)
    return (hsv_to_rgb(hsv) * 255).astype(np.uint8)


def whole_frames(data: Dataset, camera: str) -> list[int]:
    """Frames of which every output is there."""
    return [f for f in data.frames if all(files.is_complete(data.layout.png(camera, o, f)) for o in data.outputs)]


def contact_sheet(data: Dataset, path: Path, columns: int = 5, width: int = 384) -> None:
    """One picture of a dataset: a row for each of A, B, C, D (of each camera), a column for each of some frames."""
    from PIL import Image, ImageDraw

    rows = []
    for camera in data.cameras:
        picks = spread(whole_frames(data, camera), columns)
        rows += [[(preview(data, o, f, camera, width), f"{camera} {o} {f}") for f in picks] for o in data.outputs]
    rows = [row for row in rows if row]
    if not rows:
        return
    heights = [row[0][0].height + 2 for row in rows]
    sheet = Image.new("RGB", (max(map(len, rows)) * (width + 2), sum(heights)), "white")
    draw = ImageDraw.Draw(sheet)
    for y, row in zip(np.cumsum([0, *heights]).tolist(), rows, strict=False):
        for i, (image, label) in enumerate(row):
            sheet.paste(image, (i * (width + 2), y))
            draw.text((i * (width + 2) + 5, y + 3), label, fill="white", stroke_width=1, stroke_fill="black")
    files.write_png(path, np.asarray(sheet))


def _embed(data: bytes, kind: str) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"


def _thumbnail(data: Dataset, output: str, frame: int, camera: str) -> str:
    buffer = io.BytesIO()
    preview(data, output, frame, camera, 400).save(buffer, "PNG")
    return f'<img src="{_embed(buffer.getvalue(), "png")}" alt="{camera} {output} {frame}">'


# -------------------------------------------------------------------------------------------------------------- plots


def _figure(draw, width: float = 9.0, height: float = 3.2, columns: int = 1) -> str:
    """An SVG from ``draw(*axes)``."""
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasSVG(figure)
    draw(*np.atleast_1d(figure.subplots(1, columns)))
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    return f'<img class="plot" src="{_embed(buffer.getvalue(), "svg+xml")}" alt="plot">'


def _lines(axis, x, columns, names, title: str, unit: str) -> None:
    for values, name in zip(np.atleast_2d(columns), names, strict=True):
        axis.plot(x, values, label=name, lw=1)
    axis.set(title=title, xlabel="time [s]", ylabel=unit)
    axis.grid(alpha=0.3)
    if len(names) > 1:
        axis.legend(fontsize="small")


def _thin(table: dict, most: int = 4000) -> dict:
    """Every n-th row, so that a page of a long sequence stays small."""
    step = -(-len(table["time_ns"]) // most)
    return {name: values[::step] for name, values in table.items()}


def _trajectory(data: Dataset) -> str:
    state = _thin(data.states())
    position, time = state["position"], state["time_ns"] * 1e-9

    def draw(top, side, speed):
        for axis, (i, j), names in ((top, (0, 1), "xy"), (side, (1, 2), "yz")):
            axis.plot(position[:, i], position[:, j], lw=1)
            axis.plot(*position[0, [i, j]], "o", color="green", label="start")
            axis.set(title=f"{names[0]} and {names[1]} [m]", xlabel=names[0], ylabel=names[1], aspect="equal")
            axis.set_adjustable("datalim")
            axis.grid(alpha=0.3)
        _lines(speed, time, np.linalg.norm(state["velocity"], axis=1), ["speed"], "speed", "m/s")

    return _figure(draw, 12, 3.6, 3)


def _sensors(data: Dataset) -> str:
    parts = []
    if "imu0" in data.meta["sensors"]:
        imu = _thin(data.imu())
        time = imu["time_ns"] * 1e-9

        def draw(left, right):
            _lines(left, time, imu["acceleration"].T, "xyz", "IMU: specific force", "m/s²")
            _lines(right, time, imu["angular_velocity"].T, "xyz", "IMU: angular velocity", "rad/s")

        parts.append(_figure(draw, 12, 3.2, 2))
    if "depth0" in data.meta["sensors"]:
        gauge = _thin(data.depth_gauge())
        time_gauge = gauge["time_ns"] * 1e-9
        parts.append(_figure(lambda axis: _lines(axis, time_gauge, gauge["depth"], ["depth"], "depth gauge",
                                                 "m below the surface"), 6))
    return "".join(parts)


def _exposures(data: Dataset) -> str:
    series = []
    for camera in data.cameras:
        for output in data.outputs:
            if data.layout.camera_file(camera, f"_exposure_{output}.csv").is_file():
                series.append((f"{camera} {output}", data.gains(output, camera)))
    if not series:
        return "<p>None yet.</p>"

    def draw(axis):
        for name, gains in series:
            axis.plot(list(gains), list(gains.values()), ".-", lw=1, ms=3, label=name)
        axis.set(title="exposure gain", xlabel="frame", yscale="log")
        axis.grid(alpha=0.3)
        axis.legend(fontsize="small")

    return _figure(draw)


# --------------------------------------------------------------------------------------------------------------- page


def _table(rows) -> str:
    cells = "".join(f"<tr><th>{html.escape(str(k))}</th><td>{html.escape(str(v))}</td></tr>" for k, v in rows)
    return f"<table>{cells}</table>"


def _overview(data: Dataset) -> str:
    meta, water = data.meta, data.meta["water"]
    vectors = {name: ", ".join(f"{x:.4g}" for x in water[name]) for name in ("sigma_a", "sigma_s", "albedo")}
    cameras = "; ".join(f"{c['id']}: {c['width']} x {c['height']}, f = {c['K_opencv'][0][0]:.1f} px, {c['mount']}"
                        for c in meta["cameras"])
    return _table([
        ("frames", f"{len(data)} of {meta['frames']['of']} at {meta['frames']['rate_hz']:g} Hz"),
        ("outputs", ", ".join(data.outputs) or "none"), ("cameras", cameras), ("lights", len(meta["lights"])),
        ("water", f"{water['source']}, g = {water['g']:g}"), *((f"{k} (R, G, B)", v) for k, v in vectors.items()),
        ("device", (meta["device"] or {}).get("model", "nothing rendered yet")), ("seed", meta["seed"]),
        ("versions", ", ".join(f"{k} {v}" for k, v in meta["versions"].items())),
    ])


def _plan(data: Dataset) -> str:
    plan = data.meta["samples"]["plan"]
    if not plan:
        return "<p>Nothing is rendered yet.</p>"
    reasons = "".join(f"<li>{html.escape(str(reason))}</li>" for reason in plan.get("reasons", []))
    rest = [(k, v) for k, v in plan.items() if not isinstance(v, list | dict)]
    return _table([*rest, ("denoise", data.meta["samples"]["denoise"])]) + f"<ul>{reasons}</ul>"


def _timings(data: Dataset) -> str:
    rows = []
    for path in sorted((data.root / "log").glob("*.json")):
        log = files.read_json(path)
        seconds = np.array([frame["seconds"] for frame in log["frames"]])
        rows.append((log["ended"], f"{log['model']} ({log['device']}): {len(seconds)} frames in {seconds.sum():.1f} s, "
                     f"median {np.median(seconds):.3g} s, compiling {log['compile_seconds']:.1f} s"))
    return _table(rows) if rows else "<p>None.</p>"


def _frames(data: Dataset, columns: int) -> str:
    rows = []
    for camera in data.cameras:
        for output in data.outputs:
            cells = "".join(f"<td>{_thumbnail(data, output, f, camera)}<br>frame {f}</td>"
                            for f in spread(whole_frames(data, camera), columns))
            rows.append(f"<tr><th>{camera} {output}</th>{cells}</tr>" if cells else "")
    return f'<table class="frames">{"".join(rows)}</table>' if any(rows) else "<p>None yet.</p>"


_STYLE = """body{font:15px/1.45 system-ui,sans-serif;margin:2em auto;max-width:1300px;padding:0 1em;color:#222}
table{border-collapse:collapse}th{text-align:left;vertical-align:top;padding-right:1.2em;font-weight:600}
td,th{padding-top:.15em;padding-bottom:.15em}.frames img{width:100%;max-width:400px}.frames td{text-align:center;
font-size:small;padding:2px}.plot{max-width:100%}h2{margin-top:1.6em;border-bottom:1px solid #ccc}"""


def write_report(data: Dataset, path: Path, columns: int = 4) -> Path:
    """Write one HTML page that needs no other file.

    Args:
        data: The dataset.
        path: Of the page.
        columns: Frames shown.

    Raises:
        InputError: If something in the dataset cannot be read.
    """
    if not data.layout.states.is_file():
        raise InputError("there is no vehicle in the dataset", file=data.layout.states,
                         remedy="`varos-warp simulate` into the same folder adds it.")
    sections = {"Overview": _overview(data), "Frames": _frames(data, columns), "Trajectory": _trajectory(data),
                "Sensors": _sensors(data), "Exposure": _exposures(data), "Plan": _plan(data), "Timings": _timings(data)}
    body = "".join(f"<h2>{name}</h2>{content}" for name, content in sections.items())
    title = html.escape(data.meta["name"])
    files.write_bytes(path, f"<!doctype html><html lang=en><meta charset=utf-8><title>{title}</title><style>{_STYLE}"
                            f"</style><h1>{title}</h1>{body}</html>\n".encode())
    return path
