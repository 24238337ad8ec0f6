"""Noise of an IMU from files of other programs: Kalibr's imu.yaml, EuRoC's sensor.yaml, what imu_utils writes.

Kalibr (kalibr_common/ConfigReader.py) and EuRoC have our four densities under our names; of several IMUs each stands
under a name, imu0, imu1 ... imu_utils (src/imu_an.cpp, getWhiteNoise and getBiasInstability) writes something else:
as ``_n`` the Allan deviation at 1 s times the square root of the rate, the standard deviation of a reading, and as
``_w`` the least Allan deviation, the bias instability. Of white noise N and a random walk K the Allan deviation at a
time t is sqrt(N^2 / t + K^2 t / 3); so of a = n / sqrt(rate) at 1 s and the least w follow

    N^2 = (a^2 + sqrt(a^4 - w^4)) / 2,      K = sqrt(3) w^2 / (2 N).

Its fork (github.com/mintar/imu_utils) writes N and K themselves, and says so in ``unit``.
"""

import re
from dataclasses import replace
from math import isfinite, sqrt
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from varos_warp.errors import InputError, did_you_mean, warn
from varos_warp.files import absolute, is_file
from varos_warp.products.sensors.imu import ImuNoise
from varos_warp.scene.file.problems import input_error
from varos_warp.scene.file.source import Source
from varos_warp.scene.file.yaml_files import parse_file

DENSITIES = tuple(
    f"{sensor}_{kind}" for sensor in ("accelerometer", "gyroscope") for kind in ("noise_density", "random_walk")
)
"""Keys of Kalibr and EuRoC that are ours."""
RATES = ("update_rate", "rate_hz")
"""Keys of Kalibr and of EuRoC for the rate [Hz]."""
BESIDE = tuple(
    "rostopic time_offset model T_i_b accelerometers gyroscopes sensor_type comment T_BS Tw Ta Tg R_IMUtoGYRO "
    "R_IMUtoACC".split()
)
"""Keys of Kalibr, OpenVINS and EuRoC that do not tell of noise."""
MODELS = (None, "calibrated", "kalibr")
"""Models of Kalibr and OpenVINS without scales and misalignments that differ from one."""
SENSORS = {"Gyr": ("gyroscope", "gyr", "rad/s"), "Acc": ("accelerometer", "acc", "m/s^2")}
"""Blocks of imu_utils: our name, the beginning of its keys, and the unit that it writes."""
AXES = ("avg-axis", "x-axis", "y-axis", "z-axis")
WHAT = "file of an IMU's noise"
REMEDY = "Give Kalibr's imu.yaml, EuRoC's sensor.yaml, what imu_utils writes, or a block of keys."


def with_noise_files(source: Source, base_dir: Path) -> Source:
    """The data of a scene with the noise that IMUs have by files in the place of their names.

    Raises:
        InputError: Such a file cannot be read.
    """
    data = source.data
    several = data.get("vehicles") if isinstance(data, dict) else None
    places = [("vehicle",), *(("vehicles", i) for i in range(len(several) if isinstance(several, list) else 0))]
    for place in places:
        imu = source.value((*place, "imu"))
        if isinstance(imu, dict) and isinstance(name := imu.get("noise"), str):
            rate = imu.get("rate_hz", 200.0)
            noise = _noise_of_scene(source, (*place, "imu", "noise"), absolute(base_dir, name), rate)
            data = _put(data, (*place, "imu", "noise"), noise.model_dump(exclude_unset=True))
    return replace(source, data=data)


def _noise_of_scene(source: Source, key: tuple, path: Path, rate_hz: Any) -> ImuNoise:
    file, _ = file_and_imu(path)
    if not is_file(file):
        raise InputError(
            f"there is no such {WHAT} ({file})",
            **source.where(key),
            value=source.value(key),
            remedy="Paths are relative to the scene file.",
        )
    known = isinstance(rate_hz, int | float) and isfinite(rate_hz) and rate_hz > 0
    return read_imu_noise(path, rate_hz if known else 200.0)  # another one is refused with the scene


def _put(data: Any, path: tuple, value: Any) -> Any:
    """Data with another value at a path, of which nothing else is copied."""
    if not path:
        return value
    copy: Any = list(data) if isinstance(data, list) else dict(data)
    copy[path[0]] = _put(data[path[0]], path[1:], value)
    return copy


def read_imu_noise(path: Path, rate_hz: float | None) -> ImuNoise:
    """The noise that a file tells of.

    Args:
        path: The file; of one with several IMUs, ``FILE#imu1``.
        rate_hz: Of the readings that get it [Hz], which is also taken for that of what imu_utils analysed; None: not
            known.

    Raises:
        InputError: It is no such file, or one of its values cannot be; names its line.
    """
    file, name = file_and_imu(path)
    return noise_in(parse_file(file, WHAT, REMEDY, ImuNoise), name, rate_hz)


def tells_of_imu(data: Any) -> bool:
    """Return whether the data of a YAML file are of one of these formats, and no noise profile of ours."""
    return isinstance(data, dict) and (bool({*DENSITIES, *SENSORS} & data.keys()) or any(map(_is_imu, data)))


def noise_in(source: Source, name: str, rate_hz: float | None) -> ImuNoise:
    """The noise in a file that was parsed; ``name`` is that of one of its IMUs, or empty. As `read_imu_noise`."""
    key = _which(source, name)
    block = source.data[key[0]] if key else source.data
    if not isinstance(block, dict):
        raise _problem(source, key, "should be a block of keys", REMEDY)
    return _of_imu_utils(source, rate_hz) if {*SENSORS} & block.keys() else _of_kalibr(source, key, block, rate_hz)


def file_and_imu(path: Path) -> tuple[Path, str]:
    """A file, and the IMU in it that is named behind #."""
    file, mark, name = str(path).rpartition("#")
    return (Path(file), name) if mark and _is_imu(name) else (path, "")


def _is_imu(name: Any) -> bool:
    return isinstance(name, str) and re.fullmatch(r"imu\d+", name) is not None


def _which(source: Source, name: str) -> tuple[str, ...]:
    """Key of the block of one IMU; empty where the file has but one and no name for it."""
    known = [key for key in source.data if _is_imu(key)]
    if name in known or (len(known) == 1 and not name):
        return (name or known[0],)
    if name:
        raise InputError(
            f"has no '{name}'",
            file=source.file,
            remedy=f"It has: {', '.join(known)}." if known else "It tells of one IMU: leave out what is behind #.",
        )
    if known:
        raise InputError(f"tells of {len(known)} IMUs", file=source.file, remedy=f"Name one: FILE#{known[0]}.")
    return ()


def _problem(source: Source, key: tuple, problem: str, remedy: str, value: Any = None) -> InputError:
    return InputError(problem, **source.where(key), value=value, remedy=remedy)


def _of_kalibr(source: Source, key: tuple, block: dict, rate_hz: float | None) -> ImuNoise:
    """Four densities in our units, of Kalibr, OpenVINS or EuRoC."""
    known = (*DENSITIES, *RATES, *BESIDE)
    for name in block:
        if name not in known:
            near = did_you_mean(str(name), known)
            raise _problem(source, (*key, name), "unknown key", near or f"Known here: {', '.join(known)}.")
    if missing := [name for name in DENSITIES if name not in block]:
        raise InputError(f"has no {' and no '.join(missing)}", file=source.file, remedy=REMEDY)
    for name in RATES:
        rate = _number(source, (*key, name), block[name]) if name in block else None
        if rate_hz is not None and rate not in (None, rate_hz):
            warn(
                f"{source.file}: {name} is {rate:g} Hz, but rate_hz of the IMU is {rate_hz:g} Hz; densities hold at "
                "any rate, the standard deviation of a reading is theirs times the root of rate_hz"
            )
    if (model := block.get("model")) not in MODELS:
        warn(f"{source.file}: the model '{model}' has scales and misalignments, which are not simulated; its noise is")
    return _made(source, key, {name: _number(source, (*key, name), block[name]) for name in DENSITIES})


def _made(source: Source, key: tuple, values: dict[str, float]) -> ImuNoise:
    """The block of some values, or what is wrong with one of them in its file."""
    try:
        return ImuNoise.model_validate(values)
    except ValidationError as error:
        lines = {path[len(key) :]: line for path, line in source.lines.items() if path[: len(key)] == key}
        raise input_error(error, Source(values, ImuNoise, source.file, lines)) from None


def _number(source: Source, key: tuple, value: Any) -> float:
    """A finite number; one with an exponent but without a point, such as 1e-3, is text in YAML."""
    try:
        number = float(value) if isinstance(value, int | float | str) and not isinstance(value, bool) else float("nan")
    except ValueError:
        number = float("nan")
    if not isfinite(number) or number < 0.0:
        raise _problem(source, key, "should be a finite number, 0 at least", "Give a number.", value)
    return number


def _of_imu_utils(source: Source, rate_hz: float | None) -> ImuNoise:
    """Densities of what imu_utils found, of the average of its axes."""
    for key in source.data:
        if key not in ("type", "name", *SENSORS):
            raise _problem(source, (key,), "unknown key", f"Known here: type, name, {', '.join(SENSORS)}.")
    values: dict[str, float] = {}
    for block, (sensor, short, _) in SENSORS.items():
        n, w = (_average(source, block, f"{short}_{letter}") for letter in "nw")
        if not _states_densities(source, block):
            n, w = _densities(source, block, n, w, rate_hz)
        values |= {f"{sensor}_noise_density": n, f"{sensor}_random_walk": w}
    if not all(_states_densities(source, block) for block in SENSORS):
        told = ", ".join(f"{key} = {values[key]:.3g}" for key in DENSITIES)
        warn(
            f"{source.file}: imu_utils writes the standard deviation of a reading and the bias instability; taken for "
            f"readings at {rate_hz:g} Hz they are {told} (docs/noise.md)"
        )
    return _made(source, (), values)


def _average(source: Source, block: str, name: str) -> float:
    """A value of the average of the axes."""
    data = source.data.get(block)
    axis = data.get("avg-axis") if isinstance(data, dict) else None
    if not isinstance(axis, dict) or name not in axis:
        raise _problem(source, (block,), f"has no avg-axis with {name}", "Take the file as imu_utils writes it.")
    for key in data:
        if key not in ("unit", *AXES):
            raise _problem(source, (block, key), "unknown key", f"Known here: unit, {', '.join(AXES)}.")
    return _number(source, (block, "avg-axis", name), axis[name])


def _states_densities(source: Source, block: str) -> bool:
    """Return whether the unit says that the values are a density and a random walk, as the fork's does."""
    unit, usual = str(source.data[block].get("unit", "")), SENSORS[block][2]
    words = unit.replace(" ", "")
    if words == usual:
        return False
    if "_w:" in words and words.endswith(f"{'m/s^3' if block == 'Acc' else 'rad/s^2'}/sqrt(Hz)"):
        return True
    raise _problem(
        source,
        (block, "unit"),
        "is a unit that imu_utils does not write",
        f"It writes '{usual}', its fork densities per sqrt(Hz).",
        unit,
    )


def _densities(source: Source, block: str, n: float, w: float, rate_hz: float | None) -> tuple[float, float]:
    """Density and random walk of a standard deviation of readings at a rate, and of the least Allan deviation."""
    if rate_hz is None:
        raise InputError(
            "imu_utils writes the standard deviation of a reading, from which no density follows unless "
            "the rate is known",
            file=source.file,
            remedy="Say the rate of the readings [Hz].",
        )
    a = n / sqrt(rate_hz)
    if w > a:
        raise _problem(
            source,
            (block, "avg-axis"),
            f"its least Allan deviation, {w:.3g}, is more than that at 1 s, {n:.3g} / sqrt({rate_hz:g} Hz) = {a:.3g}",
            "It was analysed at another rate: give the densities themselves.",
        )
    N = sqrt((a * a + sqrt(max(a**4 - w**4, 0.0))) / 2.0)
    return N, sqrt(3.0) * w * w / (2.0 * N) if N else 0.0
