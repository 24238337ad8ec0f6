"""Noise profiles: those that come with the package, files of one's own, and several joined into one."""

from pathlib import Path

from varos_warp.errors import InputError, warn
from varos_warp.products.sensors.registry import SENSORS
from varos_warp.scene.angles import odd_gyroscope
from varos_warp.scene.description.noise_profile import NoiseProfile
from varos_warp.scene.file.camera_noise import WHAT, named_profiles, profile_path
from varos_warp.scene.file.imu_files import file_and_imu, noise_in, tells_of_imu
from varos_warp.scene.file.load import validated
from varos_warp.scene.file.yaml_files import parse_file


def load_profile(name: str | Path, imu_rate_hz: float | None = None) -> NoiseProfile:
    """A profile that comes with the package, by its name, or one of your own or of an IMU (imu_files.py), by its path.

    Args:
        name: Name or path; of one of several IMUs in a file, ``FILE#imu1``.
        imu_rate_hz: Of the readings of the IMU that gets it [Hz], for files of other programs; None: not known.

    Raises:
        InputError: There is none, or it is not what a profile may be.
    """
    path, imu = file_and_imu(profile_path(name))
    source = parse_file(path, WHAT, f"Give a file, or one of: {', '.join(named_profiles())}.", NoiseProfile)
    if imu or tells_of_imu(source.data):
        profile = NoiseProfile(name=path.stem, imu=noise_in(source, imu, imu_rate_hz))
    else:
        profile = validated(source)
    if profile.imu is not None and (words := odd_gyroscope(profile.imu)):
        warn(f"{path}: {words}")
    return profile if "name" in profile.model_fields_set else profile.model_copy(update={"name": path.stem})


def merge_profiles(profiles: list[NoiseProfile]) -> NoiseProfile:
    """Join profiles of different sensors into one.

    Raises:
        InputError: Two of them hold the same sensor.
    """
    merged: dict = {"name": "+".join(profile.name for profile in profiles)}
    for profile in profiles:
        for sensor in (*(sensor.key for sensor in SENSORS), "camera"):
            block = getattr(profile, sensor)
            if block is not None and sensor in merged:
                raise InputError(
                    f"two profiles tell of the {sensor}",
                    key="--profile",
                    value=profile.name,
                    remedy="Leave one out, or write the one you mean into a file.",
                )
            merged |= {sensor: block} if block is not None else {}
    return NoiseProfile(**merged)
