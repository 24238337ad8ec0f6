"""The report: one HTML page of a whole dataset that needs no other file and no network, and the contact sheet.

The page is ``data/report/page.html`` with its style and scripts put in; everything it shows stands in it as JSON.
"""

import base64
import hashlib
import html
import json
import re
from collections.abc import Iterable
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

import varos_warp
from varos_warp.dataset import files
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.report import facts
from varos_warp.dataset.report.course import course_pictures, scene_parts
from varos_warp.dataset.report.curves import attenuation, curves
from varos_warp.dataset.report.facts import Raw
from varos_warp.dataset.write.pictures import Filmstrip, contact_sheet, filmstrip, preview, spread, whole_frames
from varos_warp.errors import counted
from varos_warp.products.images.registry import OUTPUTS
from varos_warp.scene.description.image_types import DEPTH

__all__ = ["contact_sheet", "preview", "spread", "whole_frames", "write_page", "write_report"]

SCRIPTS = ("app.js", "plots.js", "start.js")


def write_report(data: Dataset, path: Path, quiet: bool = True) -> Path:
    """Write one HTML page that needs no other file; its size stays below 20 MB however long the dataset is.

    Raises:
        InputError: If something in the dataset cannot be read.
    """
    strip, scene = filmstrip(data, quiet), scene_parts(data)
    return write_page(
        path,
        title=data.meta["name"],
        root=data.root.absolute().name,
        tiles=facts.headline(data),
        notes=_warnings(facts.warnings(data, scene.warnings)),
        content=_content(data, strip),
        sections=_sections(data, strip, _course(course_pictures(data, scene), scene.missing)),
    )


def write_page(
    path: Path,
    *,
    title: str,
    root: str,
    tiles: Iterable[tuple[str, str]],
    notes: str,
    content: dict[str, Any],
    sections: list[tuple[str, str, str]],
) -> Path:
    """Write a page of the report's form.

    Args:
        path: The file.
        title: Its heading.
        root: Of what it tells.
        tiles: (value, name) of what stands first.
        notes: HTML after them.
        content: What its scripts draw: ``frames``, ``times``, ``cameras``, ``images``, ``outputs``, ``plots``,
            ``attenuation``, as data/report/start.js has it.
        sections: (id, heading, HTML) in order.
    """
    script = "\n".join(map(_text, SCRIPTS))
    words = {
        "title": html.escape(title),
        "version": html.escape(varos_warp.__version__),
        "root": html.escape(root),
        "style": _text("page.css"),
        "script": script,
        "script_hash": base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        "tiles": "".join(
            f"<div><dt>{html.escape(name)}</dt><dd>{html.escape(value)}</dd></div>" for value, name in tiles
        ),
        "warnings": notes,
        "data": _json(content),
    }
    words["nav"] = "".join(f'<a href="#{key}">{name}</a>' for key, name, _ in sections)
    words["sections"] = "".join(f'<section id="{key}"><h2>{name}</h2>{body}</section>' for key, name, body in sections)
    page = re.sub(r"\{\{(\w+)\}\}", lambda match: words[match[1]], _text("page.html"))
    files.write_bytes(path, page.encode())
    return path


def _text(name: str) -> str:
    return (resources.files("varos_warp") / "data" / "report" / name).read_text(encoding="utf-8")


def _json(content: Any) -> str:
    """JSON that may stand inside of a script element."""
    return json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


# ------------------------------------------------------------------------------------------------- what scripts draw


def _content(data: Dataset, strip: Filmstrip) -> dict[str, Any]:
    """Everything that the page's scripts show."""
    times = data.views()[0][np.searchsorted(data.frames, strip.frames)] * 1e-9
    return {
        "frames": strip.frames,
        "times": times.tolist(),
        "cameras": [{"id": camera} for camera in data.cameras],
        "images": strip.images,
        "outputs": [{"letter": o, "content": OUTPUTS[o].content} for o in data.outputs],
        "plots": curves(data, times),
        "attenuation": attenuation(data),
    }


# ---------------------------------------------------------------------------------------------------- what is written


def _warnings(found: list[str]) -> str:
    if not found:
        return '<p class="good">Nothing to warn of.</p>'
    rows = "".join(f"<li>{html.escape(text)}</li>" for text in found)
    return f'<div class="warnings" role="note"><b>Before you use it</b><ul>{rows}</ul></div>'


def _sections(data: Dataset, strip: Filmstrip, course: str) -> list[tuple[str, str, str]]:
    """(id, title, HTML) of every section, in order."""
    return [
        ("frames", "Frames", _frames(data, strip)),
        ("course", "Course", course),
        ("curves", "Sensors and exposure", '<div id="plots"></div>'),
        (
            "water",
            "Water, cameras, sensors",
            (
                f'<div class="two"><div class="card">{facts.water(data)}</div><div id="water-plot"></div></div>'
                f'<div class="card stack" style="margin-top:12px">{facts.cameras(data)}{facts.equipment(data)}</div>'
            ),
        ),
        ("plan", "Plan", f'<div class="card stack">{facts.plan(data)}</div>'),
        ("timings", "Rendering", f'<div class="card">{facts.timings(data)}{facts.measures(data)}</div>'),
        ("provenance", "What it was made of", f'<div class="card">{facts.provenance(data)}</div>'),
    ]


def _frames(data: Dataset, strip: Filmstrip) -> str:
    if not strip.frames:
        return "<p class=empty>None yet.</p>"
    total = sum(len(whole_frames(data, camera)) for camera in data.cameras[:1])
    of = f"{len(strip.frames)} of {counted(total, 'frame')}, evenly spread"
    shown = "every frame" if len(strip.frames) == total else of
    legend, about = "", data.camera()
    if DEPTH in data.outputs:
        from matplotlib import colormaps
        from matplotlib.colors import to_hex

        stops = ", ".join(to_hex(colormaps["viridis"](1 - i / 8)) for i in range(9))
        near, far = strip.near_far
        bar = f'<i style="background:linear-gradient(90deg,{stops})"></i>'
        legend = f'<span class="legend">D: {near:.3g} m {bar} {far:.3g} m</span>'
    shape = f"--n:{len(data.outputs)};--aspect:{about['width'] / about['height']:.4g}"
    return Raw(f'''<div class="head"><span class="note">{shown}, {strip.width} pixels wide<span class="wide">; click an
image to enlarge it, arrow keys step, space plays</span></span><span class="choice"><button type="button"
data-layout="focus" aria-pressed="true">one large</button><button type="button" data-layout="grid"
aria-pressed="false">side by side</button></span></div>
<div id="viewer" class="focus" style="{shape}"></div>
{_text("transport.html")}{legend}
<h3>Contact sheet</h3><div id="sheet"></div>''')


def _course(pictures: dict[str, str], missing: str | None) -> str:
    note = (
        "" if missing is None else (f'<p class="note">The scene’s meshes cannot be drawn ({html.escape(missing)}).</p>')
    )
    images = "".join(
        f'<img src="data:image/png;base64,{picture}" alt="The course seen {name}">'
        for name, picture in pictures.items()
    )
    return f"""<div class="card"><div class="course">{images}</div></div>{note}
<p class="note"><code>varos-warp view</code> shows the world in three dimensions, and every pose.</p>"""
