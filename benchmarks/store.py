"""Writes the rows of a measurement as they come: a run that is killed leaves complete files of what was done."""

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
        """Keep a row of A or sensors."""
        self.rows.setdefault(output, []).append(row)
        self.save()

    def forget(self, scenes: list[str], outputs) -> None:
        """Drop the rows of these scenes and outputs, which are to be measured anew."""
        for output in outputs:
            kept = [row for row in self.rows.pop(output, []) if row.get("scene", scenes[0]) not in scenes]
            if kept:
                self.rows[output] = kept
        if "A" in outputs:
            self.scenes = {name: facts for name, facts in self.scenes.items() if name not in scenes}
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


def reopen(folder: Path, facts: dict) -> Store:
    """A store that goes on with what is in ``folder``, if that was measured by the same code on the same machine."""
    file = folder / "bench.json"
    if not file.exists():
        return Store(folder, facts)
    before = load(file)
    known, scenes = before.pop("machine"), before.pop("scenes")
    same = {**known, "date": ""} == {**facts, "date": ""}
    return Store(folder, facts, before, scenes) if same else Store(folder, facts)


def load(path: Path) -> dict:
    """What a run wrote to ``bench.json``."""
    return read_json(path)
