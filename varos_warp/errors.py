"""What the command line prints as a single message: bad input (status 2), and images that could not be made (1)."""

from pathlib import Path
from typing import Any


class InputError(ValueError):
    """Something the user gave cannot be used; says where it stands, what it is and how to mend it."""

    def __init__(self, problem: str, *, file: str | Path | None = None, key: str | None = None,
                 value: Any = None, remedy: str | None = None, line: int | None = None):
        self.problem, self.file, self.key, self.value, self.remedy, self.line = problem, file, key, value, remedy, line
        super().__init__(self.message)

    @property
    def message(self) -> str:
        """``file:line: key = value: problem. Remedy.`` with the parts that are known."""
        where = ":".join(str(part) for part in (self.file, self.line) if part is not None)
        what = self.key if self.value is None else f"{self.key} = {self.value!r}" if self.key else repr(self.value)
        text = ": ".join(part for part in (where, what, self.problem) if part)
        return f"{text}. {self.remedy}" if self.remedy else text


class RunFailed(RuntimeError):
    """Some images could not be made; all others are, and the same command tries again."""
