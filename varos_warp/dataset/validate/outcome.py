"""What validation found: problems, and measures beside their limits."""

import contextlib
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from varos_warp.dataset import files
from varos_warp.errors import InputError

KEPT = Path("log", "validation.json")
"""Path in a dataset of its last outcome; the log has no checksums."""

MOST_PROBLEMS = 20
"""Most problems of one kind that are listed singly."""


@dataclass
class Validation:
    """Outcome: it is valid when there are no problems."""

    root: Path
    """Folder of the dataset; problems name files below it."""
    problems: list[str] = field(default_factory=list)
    measures: list[dict] = field(default_factory=list)
    """name, value, limit, unit of each measured quantity."""
    files_read: int = 0
    """Images decoded."""
    files_hashed: int = 0
    """Files held against their checksums; 0: the dataset has none."""

    def measure(self, name: str, value: float, limit: float, unit: str, told: bool = False) -> None:
        """Note a quantity; above its limit (or NaN) it is a problem, unless its rows are ``told`` of already."""
        self.measures.append({"name": name, "value": float(value), "limit": float(limit), "unit": unit})
        if not told and not value <= limit:
            self.add(f"{name}: {value:.4g} {unit}, more than {limit:.4g}")

    def add(self, problem: str) -> None:
        """Note a problem, once."""
        if problem not in self.problems:
            self.problems.append(problem)

    def add_all(self, problems: list[str], what: str) -> None:
        """Note problems of one kind; of very many only how many there are."""
        new = [problem for problem in dict.fromkeys(problems) if problem not in self.problems]
        for problem in new[:MOST_PROBLEMS]:
            self.add(problem)
        if len(new) > MOST_PROBLEMS:
            self.add(f"... and {len(new) - MOST_PROBLEMS} more {what} like these")

    def name(self, path: Path) -> str:
        """A file's path in the dataset."""
        return path.relative_to(self.root).as_posix()

    def cell(self, path: Path, row: int, column: int | str) -> str:
        """A cell: ``vehicle0/imu0/imu0_data.csv:301: a_RS_S_y = 0.25``; line 1 is the header, row 0 is in line 2."""
        table = files.read_csv(path)
        name = column if isinstance(column, str) else list(table)[column]
        return f"{self.name(path)}:{row + 2}: {files.plain_name(name)} = {table[name].tolist()[row]}"

    def add_rows(self, path: Path, problem: str, wrong: np.ndarray, off: np.ndarray, columns) -> bool:
        """Note one problem for all wrong rows, bool [N], naming the first and its worst cell; whether there are any.

        ``off`` [N, k] is how far entries are off, ``columns`` their k numbers in the table.
        """
        rows = np.flatnonzero(wrong)
        if rows.size:
            more = f" (and {len(rows) - 1} more lines)" if len(rows) > 1 else ""
            worst = columns[int(np.argmax(np.abs(off[rows[0]])))]
            self.add(f"{self.cell(path, rows[0], worst)}: {problem}{more}")
        return bool(rows.size)

    def plain(self) -> dict:
        """Everything as JSON has it: whether the dataset is valid, then the fields; null for NaN and infinity."""
        fields = asdict(self)
        del fields["root"]
        return {"valid": not self.problems, **json.loads(json.dumps(fields), parse_constant=lambda _: None)}

    def keep(self) -> None:
        """Leave the outcome in the dataset's log, for `varos-warp report`; not where nothing can be written."""
        content = {"ended": datetime.now(UTC).isoformat(timespec="seconds"), **self.plain()}
        with contextlib.suppress(InputError):
            files.write_json(self.root / KEPT, content)

    def guard(self, check: Callable, *args) -> None:
        """Run a check; a damaged file is one problem, and the other checks go on."""
        try:
            check(*args)
        except InputError as error:
            self.add(self.problem_of(error))
        except (KeyError, IndexError, ValueError, TypeError) as error:
            self.add(f"{check.__name__.removeprefix('check_')}: cannot be checked: {error!r}")

    def problem_of(self, error: InputError) -> str:
        """An error without the folder that all files share."""
        return error.message.replace(f"{self.root}/", "", 1)
