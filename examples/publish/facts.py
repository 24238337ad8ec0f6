"""What is so of the datasets that are published: read from them, never typed."""

import os
import subprocess
from dataclasses import dataclass
from pathlib import Path

import varos_warp as vw
from varos_warp.dataset.write.checksums import read_checksums
from varos_warp.errors import InputError

LICENCES = {
    "cc-by-4.0": "https://creativecommons.org/licenses/by/4.0/",
    "cc0-1.0": "https://creativecommons.org/publicdomain/zero/1.0/",
    "apache-2.0": "https://www.apache.org/licenses/LICENSE-2.0",
}
"""Licences by the names that Hugging Face has for them."""


@dataclass
class Facts:
    """The datasets of a publication and what was made of them by whom."""

    kind: str
    datasets: list[vw.Dataset]
    sums: list[dict[str, str]]
    """Of each dataset the SHA-256 of its files."""
    licence: str
    url: str | None
    commit: str | None
    date: str | None
    command: str
    """What made them."""

    @classmethod
    def of(cls, kind: str, roots: list[Path], repository: Path, licence: str, url: str | None, command: str) -> "Facts":
        """Open the datasets.

        Raises:
            InputError: If one is not complete.
        """
        sums = [read_checksums(root) for root in roots]
        for root, listed in zip(roots, sums, strict=True):
            if not listed:
                raise InputError("has no checksums: it is not complete", file=root, remedy="Run the command again.")
        commit, date = git(repository)
        return cls(kind, [vw.Dataset(root) for root in roots], sums, licence, url, commit, date, command)

    @property
    def name(self) -> str:
        """Of the data set, with the version of varos_warp that made it."""
        return f"varos_warp-{self.kind}-{self.version}"

    @property
    def version(self) -> str:
        """Of varos_warp, as the datasets say."""
        return self.datasets[0].meta["versions"]["varos_warp"]

    def meaning(self, letter: str) -> str:
        """What an image of a type holds, as the datasets say."""
        return self.datasets[0].meta["conventions"].get(letter, "described in README.txt of each dataset")

    @property
    def images(self) -> int:
        """Number of images through all cameras, in all waters."""
        return sum(len(data) * len(data.cameras) * len(data.outputs) for data in self.datasets)

    @property
    def rows(self) -> int:
        """Number of views: a frame through a camera in a water."""
        return sum(len(data) * len(data.cameras) for data in self.datasets)


def git(repository: Path) -> tuple[str | None, str | None]:
    """Commit of the repository and its date; ``-modified`` if files differ from it.

    Where there is no git, the commit is what ``$VAROS_WARP_COMMIT`` says, if it says something, and the date None.
    """
    given = os.environ.get("VAROS_WARP_COMMIT")

    def ask(*words: str) -> str:
        return subprocess.run(
            ["git", "-C", str(repository), *words], capture_output=True, text=True, check=True
        ).stdout.strip()

    try:
        if Path(ask("rev-parse", "--show-toplevel")).resolve() != repository:
            return given, None
        changed = "-modified" if ask("status", "--porcelain", "--untracked-files=no") else ""
        return ask("rev-parse", "HEAD") + changed, ask("log", "-1", "--format=%cs")
    except (OSError, subprocess.CalledProcessError):
        return given, None
