"""Rows of a measurement on disk as they come: a run that is killed leaves whole files of what was done."""

import csv
import io
from dataclasses import dataclass, field
from pathlib import Path

from varos_warp.dataset.files import read_json, write_bytes, write_json


@dataclass
class Store:
    """``bench.json`` with facts and all rows, and a CSV file for each output, written anew with every row.

    Args:
        folder: where they are written.
        facts: about the machine; they stand in every row of the CSV files, too.
    """

    folder: Path
    facts: dict
    rows: dict[str, list[dict]] = field(default_factory=dict)
    scenes: dict[str, dict] = field(default_factory=dict)
    """What holds for a whole scene: times of compilation, what was left out and why."""

    def add(self, output: str, row: dict) -> None:
        """Keep a row of A, D or sensors."""
        self.rows.setdefault(output, []).append(row)
        self.save()

    def save(self) -> None:
        """Write what there is."""
        write_json(self.folder / "bench.json", self.content())
        for output, rows in self.rows.items():
            write_bytes(self.folder / f"{output}.csv", self._csv(rows).encode())

    def content(self) -> dict:
        """What ``bench.json`` holds."""
        return {"machine": self.facts, "scenes": self.scenes, **self.rows}

    def _csv(self, rows: list[dict]) -> str:
        names = list(dict.fromkeys(name for row in rows for name in row))
        text = io.StringIO()
        writer = csv.DictWriter(text, [*names, *self.facts], restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(row | self.facts for row in rows)
        return text.getvalue()


def load(path: Path) -> dict:
    """What a run wrote to ``bench.json``."""
    return read_json(path)
