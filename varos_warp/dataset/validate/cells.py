"""Where in a table something is wrong: file, line as an editor counts it, column and value."""

from pathlib import Path

import numpy as np

from varos_warp.dataset import files
from varos_warp.dataset.reader.dataset import Dataset


def place(data: Dataset, path: Path, row: int, column: int | str | None = None) -> str:
    """Such as ``vehicle0/imu0/imu0_data.csv:301: a_RS_S_y = 0.25``; line 1 is the header, row 0 is in line 2."""
    where = f"{path.relative_to(data.root).as_posix()}:{row + 2}"
    if column is None:
        return where
    table = files.read_csv(path)
    name = column if isinstance(column, str) else list(table)[column]
    return f"{where}: {files.plain_name(name)} = {table[name].tolist()[row]}"


def wrong_rows(data: Dataset, path: Path, problem: str, wrong: np.ndarray, off: np.ndarray, columns) -> list[str]:
    """One problem for all rows that are wrong, which names the first and its worst column.

    Args:
        data: The dataset.
        path: Of the table.
        problem: What is wrong.
        wrong: bool [N].
        off: How far off entries are, [N, k].
        columns: Their k numbers in the table.
    """
    rows = np.flatnonzero(wrong)
    if not rows.size:
        return []
    more = f" (and {len(rows) - 1} more lines)" if len(rows) > 1 else ""
    worst = columns[int(np.argmax(np.abs(off[rows[0]])))]
    return [f"{place(data, path, rows[0], worst)}: {problem}{more}"]
