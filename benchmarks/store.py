"""Writes the rows of a measurement as they come: a run that is killed leaves a complete file of what was done."""

from dataclasses import dataclass, field
from pathlib import Path

from varos_warp.dataset.files import read_json, write_json


@dataclass
class Store:
    """``bench.json`` with facts and all rows, written anew with every row."""

    folder: Path
    facts: dict
    rows: list[dict] = field(default_factory=list)
    scenes: dict[str, dict] = field(default_factory=dict)
    """What holds for a whole scene: times of compilation, what was left out and why."""

    def add(self, row: dict) -> None:
        """Keep a row."""
        self.rows.append(row)
        self.save()

    def forget(self, scenes: list[str]) -> None:
        """Drop the rows of these scenes, which are to be measured anew."""
        self.rows = [row for row in self.rows if row["scene"] not in scenes]
        self.scenes = {name: facts for name, facts in self.scenes.items() if name not in scenes}
        self.save()

    def save(self) -> None:
        """Write what there is."""
        write_json(self.folder / "bench.json", self.content())

    def content(self) -> dict:
        """What ``bench.json`` holds."""
        return {"machine": self.facts, "scenes": self.scenes, "A": self.rows}


def reopen(folder: Path, facts: dict) -> Store:
    """A store that goes on with what is in ``folder``, if that was measured by the same code on the same machine."""
    file = folder / "bench.json"
    before = read_json(file) if file.exists() else {"machine": {}}
    if {**before["machine"], "date": ""} != {**facts, "date": ""}:
        return Store(folder, facts)
    return Store(folder, facts, before["A"], before["scenes"])
