"""Noise of sensors against what defines it: Allan deviation, photon transfer curve, vignetting in closed form."""

import allantools
import numpy as np
import pytest

from varos_warp.products.sensors.depth_gauge import DepthGaugeNoise, depth_gauge_noise
from varos_warp.products.sensors.imu import imu_noise
from varos_warp.scene.description.noise_profile import CameraNoise
from varos_warp.scene.file.noise_profiles import load_profile
from varos_warp.scene.optics.camera import CameraModel, Vignetting, pixel_centres
from varos_warp.sim.sensors.image_noise import expose, frame_generator, to_linear

RATE, COUNT = 200.0, 1 << 20
WHITE, WALK = 0, -2
"""Exponents of the power spectra (Riley, NIST SP 1065)."""


def allan(samples, tau):
    """Allan deviation of samples [N] at tau [s], and its relative standard error from chi-square of its freedom."""
    deviation = allantools.adev(samples, rate=RATE, data_type="freq", taus=[tau])[1][0]
    freedom = min(
        allantools.edf_greenhall(alpha, 2, round(tau * RATE), len(samples), overlapping=False)
        for alpha in (WHITE, WALK)
    )
    return deviation, 1.0 / np.sqrt(2.0 * freedom)


@pytest.mark.subject("IMU and depth gauge")
@pytest.mark.parametrize("profile", ["adis16448", "mpu6050"])
@pytest.mark.parametrize("tau", [0.05, 1.0, 3.0, 30.0])
def test_allan_deviations_of_a_profile_are_those_it_asks_for(truth, profile, tau):
    """N/sqrt(tau) and K sqrt(tau/3), which are N at 1 s and K at 3 s (IEEE Std 952, Kalibr)."""
    model = load_profile(profile).imu
    for name, made in zip(("accelerometer", "gyroscope"), imu_noise(model, COUNT, RATE, seed=5), strict=True):
        N, K = getattr(model, f"{name}_noise_density"), getattr(model, f"{name}_random_walk")
        m = round(tau * RATE)  # a walk in steps, not its integral: (2 m^2 + 1) / (2 m^2)
        expected = np.sqrt(N**2 / tau + K**2 * tau / 3.0 * (1.0 + 0.5 / m**2))
        got, error = allan((made.white + made.bias)[:, 1], tau)
        truth(
            f"{name}, {profile}, tau {tau} s",
            source="sqrt(N^2/tau + K^2 tau/3)",
            expected=expected,
            got=got,
            stderr=error * expected,
        )


def test_slopes_are_minus_one_half_where_white_noise_rules_and_plus_one_half_where_the_walk_does():
    model = load_profile("adis16448").imu
    total = sum(vars(imu_noise(model, COUNT, RATE, 6)[0]).values())[:, 0]
    for taus, slope in (((0.02, 0.1), -0.5), ((20.0, 60.0), 0.5)):
        (low, e_low), (high, e_high) = (allan(total, tau) for tau in taus)
        # the other noise bends the line by the share of its variance at the end that is nearer to it
        share = 3.0 * (2e-3 / 3e-3) ** 2 / np.square(taus[0] if slope > 0 else taus[1])
        bend = 0.5 * (share if slope > 0 else 1.0 / share)
        spread = np.log(taus[1] / taus[0])
        assert np.log(high / low) / spread == pytest.approx(slope, abs=(4 * np.hypot(e_low, e_high) + bend) / spread)


def test_turn_on_biases_scatter_as_asked_and_constant_ones_do_not():
    model = load_profile("mpu6050").imu.model_copy(
        update={"gyroscope_bias": (0.1, -0.2, 0.3), "gyroscope_turn_on_bias": 0.0}
    )
    starts = np.array([[made.bias[0] for made in imu_noise(model, 2, RATE, seed)] for seed in range(400)])
    assert (starts[:, 1] == [0.1, -0.2, 0.3]).all()
    assert starts[:, 0].std() == pytest.approx(0.05, rel=4 / np.sqrt(2 * 1200))
    assert abs(starts[:, 0].mean()) < 4 * 0.05 / np.sqrt(1200)


@pytest.mark.subject("IMU and depth gauge")
def test_a_depth_gauge_has_white_noise_a_bias_that_walks_and_steps(truth):
    model = DepthGaugeNoise(noise_density=5e-4, random_walk=2e-4, bias=0.3, resolution=0.002)
    reading, bias = depth_gauge_noise(model, np.full(COUNT, 80.0), RATE, seed=2)
    assert bias[0] == 0.3
    np.testing.assert_allclose(reading / 0.002, np.rint(reading / 0.002), atol=1e-6)
    variance = 5e-4**2 * RATE + 0.002**2 / 12.0
    truth(
        "variance about bias [m^2]",
        source="density^2 rate + resolution^2/12",
        expected=variance,
        got=(reading - 80.0 - bias).var(),
        stderr=variance * np.sqrt(2.0 / COUNT),
    )
    truth(
        "variance of the steps of the bias",
        source="random walk^2/rate",
        expected=2e-4**2 / RATE,
        got=np.diff(bias).var(),
        stderr=2e-4**2 / RATE * np.sqrt(2.0 / COUNT),
    )


# ------------------------------------------------------------------------------------------------------------- camera


SIDE = 256
"""Pixels along an edge of a flat field."""


def flat(model, radiance, gain=1.0, frame=0):
    return expose(model, np.full((SIDE, SIDE, 3), radiance), gain, frame_generator(7, frame, "M0"))


@pytest.mark.subject("camera")
@pytest.mark.parametrize("exposure", [{"electrons_per_dn": 2.5}, {"electrons_per_radiance": 2.5 * 4000}])
def test_the_photon_transfer_curve_is_a_line_of_slope_one_over_gain(truth, exposure):
    """EMVA 1288: variance = (mean - black)/e + (read/e)^2 + 1/12, e electrons a DN."""
    model = CameraNoise(**exposure, read_noise_electrons=6.0, bits=12, black_level=95)
    for i, level in enumerate([0.0, 0.01, 0.1, 0.5, 0.9]):
        numbers = flat(model, level, frame=i)
        mean, variance = 95 + 4000 * level, 4000 * level / 2.5 + (6.0 / 2.5) ** 2 + 1 / 12
        truth(
            f"mean [DN] at {level}",
            source="black + electrons/e",
            expected=mean,
            got=numbers.mean(),
            stderr=np.sqrt(variance / numbers.size),
        )
        truth(
            f"variance [DN^2] at {level}",
            source="signal/e + (read/e)^2 + 1/12",
            expected=variance,
            got=numbers.var(),
            stderr=variance * np.sqrt((2.0 + 1.0 / max(1e4 * level, 6.0**2)) / numbers.size),
        )


def test_rows_share_the_noise_of_rows():
    model = CameraNoise(electrons_per_dn=1.0, shot_noise=False, row_noise_electrons=8.0, black_level=100)
    numbers = flat(model, 0.2)
    assert (numbers == numbers[:, :1, :1]).all()
    assert numbers[:, 0, 0].std() == pytest.approx(np.hypot(8.0, np.sqrt(1 / 12)), rel=4 / np.sqrt(2 * SIDE))


def test_a_full_well_saturates_below_white_without_noise():
    model = CameraNoise(electrons_per_dn=2.0, full_well_electrons=4000, bits=12)
    assert (flat(model, 3.0) == 2000).all()
    assert (flat(model.model_copy(update={"full_well_electrons": None}), np.inf) == 4095).all()


def test_with_exposure_by_time_the_gain_brings_electrons_and_with_amplification_noise():
    """Four times the gain at a quarter of the light."""
    by_time = CameraNoise(electrons_per_dn=2.0)
    amplified = CameraNoise(electrons_per_radiance=8000.0)
    for model, ratio in ((by_time, 1.0), (amplified, 4.0)):
        bright, dark = flat(model, 0.4, 1.0, 0), flat(model, 0.1, 4.0, 1)
        assert dark.mean() == pytest.approx(bright.mean(), rel=4e-3)
        assert dark.var() / bright.var() == pytest.approx(ratio, rel=8 / np.sqrt(3 * SIDE**2) * 1.5)


@pytest.mark.subject("camera")
def test_vignetting_is_that_of_its_formula(truth):
    K, shape = np.array([[300.0, 0, 80.0], [0, 280.0, 50.0], [0, 0, 1]]), (100, 160)
    model = CameraNoise(electrons_per_dn=1.0, shot_noise=False, bits=16)

    def share(**fall):
        return CameraModel(K, vignetting=Vignetting(**fall)).vignette(pixel_centres(*shape[::-1]))

    numbers = expose(model, np.full((*shape, 3), 0.9), 1.0, frame_generator(0, 0, "x"), share())
    row, col = np.meshgrid(np.arange(100) + 0.5, np.arange(160) + 0.5, indexing="ij")
    angle = np.arctan(np.hypot((col - 80) / 300, (row - 50) / 280))
    truth(
        "cos^4 of the angle to the axis",
        source="0.9 cos^4",
        expected=0.9 * np.cos(angle) ** 4,
        got=to_linear(model, numbers)[..., 0],
        tolerance=0.5 / 65535 * (1 + 1e-9),
        reason="half a step of 16 bit",
    )
    polynomial = share(kind="polynomial", coefficients=(-0.3, 0.1))
    r2 = ((col - 80) ** 2 + (row - 50) ** 2) / (50**2 + 80**2)
    np.testing.assert_allclose(polynomial, 1 - 0.3 * r2 + 0.1 * r2**2, atol=1e-14)


def test_noise_of_a_frame_depends_on_seed_frame_and_camera_only():
    model = CameraNoise(electrons_per_dn=2.0, read_noise_electrons=3.0)

    def made(*key):
        return expose(model, np.full((8, 8, 3), 0.3), 1.0, frame_generator(*key)).tobytes()

    assert made(1, 5, "M0") == made(1, 5, "M0")
    assert len({made(1, 5, "M0"), made(2, 5, "M0"), made(1, 6, "M0"), made(1, 5, "L0")}) == 4
