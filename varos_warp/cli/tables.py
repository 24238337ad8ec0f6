"""What commands print: JSON, and tables of what was planned, found or made."""

import json
from pathlib import Path

from varos_warp.errors import counted, duration


def print_json(content) -> None:
    """Print plain types as JSON."""
    print(json.dumps(content, indent=2, ensure_ascii=False))


def number(x) -> str:
    """Four digits; a dash for None."""
    return "-" if x is None else f"{x:.4g}"


def _short(x) -> str:
    if isinstance(x, list):
        return " to ".join(str([round(v, 2) for v in row]) for row in x)
    return f"{x:.6g}" if isinstance(x, float) else str(x)


def print_table(header: list[str], rows: list[list[str]]) -> None:
    """Print cells under a header; nothing where there are none."""
    if not rows:
        return
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    table = Table(*map(escape, header), header_style="bold", box=None, pad_edge=False)
    for row in rows:
        table.add_row(*map(escape, row))  # [m] is a unit, not a style
    console = Console()
    if not console.is_terminal:
        console.width = 200  # a log is not cut to 80 columns
    console.print(table)


def print_plan(result: dict, plan) -> None:
    """What was decided, why, and the error that it makes; then what makes each output, and the time."""
    if plan.shortfall:
        print(plan.shortfall)
    rows = [[d.what, d.choice, *_percent(d.error), d.reason] for d in plan.decisions]
    if plan.error is not None:
        rows.append(["in all", "", *_percent(plan.error), "noise squared plus the sum of the others squared, its root"])
    print_table(["decision", "choice", "red [%]", "green [%]", "blue [%]", "reason"], rows)
    samples = " without the noise of the samples that are given" * (plan.error is None)
    print(f"errors: predicted relative RMSE of an image{samples}")
    print("models:", *(f"  {name}: {part}" for name, part in result.get("models", {}).items()), sep="\n")
    cost = result.get("cost")
    if cost:
        parts = ", ".join(f"{name} {seconds:g} s" for name, seconds in cost["seconds_by_output"].items())
        print(
            f"cost on {cost['device']}: {cost['seconds_per_frame']:g} s a frame ({parts}), "
            f"{cost['seconds_in_all']:g} s for {counted(cost['frames'], 'frame')}"
        )


def _percent(error) -> list[str]:
    return ["", "", ""] if error is None else [f"{100 * e:.2f}" if e else "0" for e in error]


def print_survey(survey: dict) -> None:
    """Print what a survey holds: the facts of `read_survey`."""
    xmin, ymin, xmax, ymax = survey["extent_m"]
    size, spacing = survey["size"], " x ".join(f"{x:.4g}" for x in survey["spacing_m"])
    what = (
        f"{size[0]} x {size[1]} nodes, {spacing} m apart"
        if survey["grid"]
        else (f"{counted(size, 'point')}, median edge {spacing} m")
    )
    block = " x ".join(map(str, survey.get("block", [1, 1])))
    thin = "" if block == "1 x 1" else f", thinned in blocks of {block}"
    count, area = survey["holes"], survey["hole_area_m2"]
    holes = f"{counted(count, 'hole')} of {area:.4g} m2 in all" if count else "no holes"
    missing = f", {counted(survey['missing'], 'node')} without height" if survey.get("missing") else ""
    print(f"survey {', '.join(survey['files'])}: {what}{thin}; {survey['crs'] or 'coordinate system not told'}")
    print(
        f"  x {xmin:.3f} to {xmax:.3f} m, y {ymin:.3f} to {ymax:.3f} m, heights {survey['heights_m'][0]:.3f} to "
        f"{survey['heights_m'][1]:.3f} m; {holes}{missing}"
    )


def print_preprocessed(out: Path, facts: dict) -> None:
    """The report of `preprocess_meshes` as tables."""
    if "survey" in facts:
        print_survey(facts["survey"])
    print_table(
        ["", "before", "after"],
        [[key.replace("_", " "), _short(facts["before"][key]), _short(value)] for key, value in facts["after"].items()],
    )
    ways = (
        ("from the original to the result", "distance_to_result_m"),
        ("from the result to the original", "distance_to_original_m"),
    )
    print_table(
        ["distance [m], normals [deg]", "rms", "95 %", "largest", "normals: mean", "95 %", "largest"],
        [
            [
                name,
                *(f"{facts[key][x]:.3g}" for x in ("rms", "p95", "max")),
                *(f"{facts[key]['normal_deg'][x]:.3g}" for x in ("mean", "p95", "max")),
            ]
            for name, key in ways
        ],
    )
    symmetric = facts["symmetric_m"]
    print(f"both ways: rms {symmetric['rms']:.3g} m, Hausdorff {symmetric['hausdorff']:.3g} m (sampled)")
    print(*(f"{key.replace('_', ' ')}: {value}" for key, value in facts["counts"].items() if value), sep=", ")
    print(*(f"{key} {value:.1f} s" for key, value in facts["seconds"].items()), sep=", ")
    print(f"{out} is written, and its report {out.with_suffix('.json')}")


def print_sweep(datasets: list[dict]) -> None:
    """What a sweep would make of each dataset, and what it has from others."""

    def rendered(each: dict) -> str:
        letters = f": {', '.join(each['renders'])}" if each["renders"] else ""
        return f"{counted(each['images'], 'image')}{letters}"

    print_table(
        ["dataset", "changes", "state", "renders", "has from", "roughly"],
        [
            [
                each["folder"],
                ", ".join(f"{key}: {value}" for key, value in each["overrides"].items()) or "nothing",
                each["state"],
                rendered(each),
                ", ".join(f"{name}: {', '.join(letters)}" for name, letters in each["from"].items()) or "none",
                duration(each["seconds"]),
            ]
            for each in datasets
        ],
    )


def print_cache(contents) -> None:
    """How full the cache of what is kept is, and with what."""
    print_table(["entry", "size [MB]"], [[name, f"{size / 1e6:.1f}"] for name, size in contents.entries])
    count = len(contents.entries)
    print(
        f"{contents.folder}: {count} entr{'y' if count == 1 else 'ies'}, {contents.bytes / 1e6:.1f} of at "
        f"most {contents.limit / 1e6:.0f} MB"
    )
