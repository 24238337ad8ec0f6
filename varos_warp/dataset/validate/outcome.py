"""What validation found: problems, and measures beside their limits."""

import contextlib
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path

from varos_warp.dataset import files
from varos_warp.errors import InputError

KEPT = Path("log", "validation.json")
"""Where in a dataset its last outcome lies; the log has no checksums."""

MOST_PROBLEMS = 20
"""Of one kind that are listed singly."""


@dataclass
class Validation:
    """Outcome: it is valid when there are no problems."""

    problems: list[str] = field(default_factory=list)
    measures: list[dict] = field(default_factory=list)
    """name, value, limit, unit of each measured quantity."""
    files_read: int = 0
    """Images decoded."""
    files_hashed: int = 0
    """Files held against their checksums; 0: the dataset has none."""

    def measure(self, name: str, value: float, limit: float, unit: str, told: list[str] | None = None) -> None:
        """Note a quantity; above its limit (or NaN) it is a problem, ``told`` in its place where that is more exact."""
        self.measures.append({"name": name, "value": float(value), "limit": float(limit), "unit": unit})
        if told:
            self.add_all(told, "rows")
        elif not value <= limit:
            self.add(f"{name}: {value:.4g} {unit}, more than {limit:.4g}")

    def add(self, problem: str) -> None:
        """Note a problem, once."""
        if problem not in self.problems:
            self.problems.append(problem)

    def add_all(self, problems: list[str], what: str) -> None:
        """Note problems of one kind; of very many only how many there are."""
        for problem in problems[:MOST_PROBLEMS]:
            self.add(problem)
        if len(problems) > MOST_PROBLEMS:
            self.add(f"... and {len(problems) - MOST_PROBLEMS} more {what} like these")

    def plain(self) -> dict:
        """Everything as JSON has it: whether the dataset is valid, then the fields; null for NaN and infinity."""
        return {"valid": not self.problems, **json.loads(json.dumps(asdict(self)), parse_constant=lambda _: None)}

    def keep(self, root: Path) -> None:
        """Leave the outcome in the dataset's log, for `varos-warp report`; not where nothing can be written."""
        content = {"ended": datetime.now(UTC).isoformat(timespec="seconds"), **self.plain()}
        with contextlib.suppress(InputError):
            files.write_json(root / KEPT, content)

    def guard(self, root: Path, check: Callable, *args) -> None:
        """Run a check; a damaged file is one problem, and the other checks go on."""
        try:
            check(*args)
        except InputError as error:
            self.add(problem_of(root, error))
        except (KeyError, IndexError, ValueError, TypeError) as error:
            self.add(f"{check.__name__.removeprefix('check_')}: cannot be checked: {error!r}")


def problem_of(root: Path, error: InputError) -> str:
    """An error without the folder that all files share."""
    return error.message.replace(f"{root}/", "", 1)
