"""IES LM-63 read a second time, apart from the package: the intensity towards one direction after the other.

By the definitions of LM-63-2002 and EN 13032-1: symmetry folds the direction's angles into those of the file, where the
package unfolds the file.
"""

import numpy as np
from scipy.interpolate import RegularGridInterpolator


def ies_text(
    kind,
    vertical,
    horizontal,
    candela,
    *,
    header="IESNA:LM-63-2002",
    tilt="TILT=NONE",
    multiplier=1.0,
    unit=2,
    opening="0 0 0",
    lumens=-1,
    ballast=1.0,
):
    """A file with intensities [horizontal, vertical]."""

    def row(values):
        return " ".join(f"{value:.6f}" for value in values)

    numbers = f"1 {lumens} {multiplier:g} {len(vertical)} {len(horizontal)} {'CBA'.index(kind) + 1} {unit} {opening}"
    lines = [header, "[TEST] none", "[MANUFAC] none", tilt, numbers, f"{ballast:g} 1 60"]
    return "\n".join([*lines, *map(row, [vertical, horizontal, *candela])]) + "\n"


def intensity_by_hand(text: str, ahead, up, right) -> np.ndarray:
    """Intensities towards unit vectors with these parts along the axis, the lamp's upward direction and its right."""
    numbers = [float(word) for word in text.split("TILT=NONE", 1)[1].split()]
    nv, nh, kind = int(numbers[3]), int(numbers[4]), int(numbers[5])
    vertical, horizontal = numbers[13 : 13 + nv], numbers[13 + nv : 13 + nv + nh]
    candela = numbers[2] * np.reshape(numbers[13 + nv + nh :], (nh, nv))
    v, h = {1: type_c, 2: type_b, 3: type_a}[kind](*np.array([ahead, up, right]), horizontal)
    if kind != 1 and vertical[0] == 0.0:
        v = np.abs(v)
    if nh == 1:
        return np.interp(v, vertical, candela[0], left=0.0, right=0.0)
    at = RegularGridInterpolator((horizontal, vertical), candela, bounds_error=False, fill_value=0.0)
    return at(np.stack([h, v], axis=-1))


def type_c(ahead, up, right, horizontal):
    c = np.degrees(np.arctan2(-right, up)) % 360.0  # counter-clockwise from behind: 90 is left
    first, last = horizontal[0], horizontal[-1]
    if (first, last) == (90.0, 270.0):
        c = np.where((c < 90.0) | (c > 270.0), (180.0 - c) % 360.0, c)
    elif last in (90.0, 180.0):
        c = np.minimum(c, 360.0 - c)
        c = np.minimum(c, 180.0 - c) if last == 90.0 else c
    return np.degrees(np.arccos(ahead)), c


def type_b(ahead, up, right, horizontal):
    h = np.degrees(np.arcsin(right))
    return np.degrees(np.arctan2(up, ahead)), np.abs(h) if horizontal[0] == 0.0 else h


def type_a(ahead, up, right, horizontal):
    h = np.degrees(np.arctan2(right, ahead))
    return np.degrees(np.arcsin(up)), np.abs(h) if horizontal[0] == 0.0 else h


def smooth(ahead, up, right):
    """A lamp of no symmetry whose second derivatives over angles are at most 6 times its peak of about 1000."""
    return 400.0 * (1.0 + ahead) * (1.0 + 0.5 * up - 0.3 * right + 0.4 * up * right)


def measured(kind, vertical, horizontal):
    """`smooth`, made symmetric as the first and last horizontal angle say, at the angles of a file."""
    h, v = np.meshgrid(np.radians(horizontal), np.radians(vertical), indexing="ij")
    if kind == "C":
        return smooth(np.cos(v), np.sin(v) * np.cos(h), -np.sin(v) * np.sin(h))
    if kind == "B":
        return smooth(np.cos(h) * np.cos(v), np.cos(h) * np.sin(v), np.sin(h))
    return smooth(np.cos(h) * np.cos(v), np.sin(v), np.cos(v) * np.sin(h))
