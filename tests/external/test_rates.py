"""Times that other calculators find from their own rates, and those that we find from the same rates."""

import numpy as np
import pytest

from cpic_planner import CONVENTIONS, Reason, Status, snr_for_rates, time_for_rates

# Stark et al. 2025 (arXiv 2502.18556): star, wavelength in nm, code, rates of planet, background (starlight, zodiacal
# and exozodiacal light, dark charge, light of other stars) and noise floor in counts per second, science time in s to
# SNR 7. From the sheet of the comparison in the public repository eleonoraalei/pyEDITH,
# tests/validation_tests_battery/ETC_cal_detect.xlsx, snapshot cc9eedf.
STARK = [
    ("HIP 32439", 500, "ayo", 0.0231164, 0.20837217, 2.721932e-06, 40333.99),
    ("HIP 32439", 500, "ebs", 0.02150748, 0.23631653, 2.6623932e-06, 25032.909),
    ("HIP 32439", 500, "exosims", 0.02161315, 0.23135158, 2.6884621e-06, 24348.608),
    ("HIP 32439", 1000, "ayo", 0.01692387, 0.83867945, 1.304861e-05, 289864.5),
    ("HIP 32439", 1000, "ebs", 0.01511871, 0.34234824, 1.2162632e-05, 73391.93),
    ("HIP 32439", 1000, "exosims", 0.01478221, 0.40989744, 1.1147657e-05, 91918.827),
    ("HIP 77052", 500, "ayo", 0.02756076, 0.20808469, 3.124691e-06, 28624.16),
    ("HIP 77052", 500, "ebs", 0.02741471, 0.22169812, 2.8437309e-06, 14454.099),
    ("HIP 77052", 500, "exosims", 0.02655538, 0.29086869, 2.7203629e-06, 20211.033),
    ("HIP 77052", 1000, "ayo", 0.02093859, 0.92178596, 1.564235e-05, 208390.4),
    ("HIP 77052", 1000, "ebs", 0.01853285, 0.29220666, 1.3429563e-05, 41688.182),
    ("HIP 77052", 1000, "exosims", 0.01972369, 0.72459064, 1.3108071e-05, 91268.695),
    ("HIP 26779", 500, "ayo", 0.03003025, 0.14680098, 1.135578e-06, 17584.47),
    ("HIP 26779", 500, "ebs", 0.03218734, 0.21179308, 1.5571206e-06, 10017.002),
    ("HIP 26779", 500, "exosims", 0.03118386, 0.19189882, 1.7537269e-06, 9712.4078),
    ("HIP 26779", 1000, "ayo", 0.02872086, 0.85052778, 2.618442e-05, 102755.7),
    ("HIP 26779", 1000, "ebs", 0.02110762, 0.25138696, 1.3682801e-05, 27648.356),
    ("HIP 26779", 1000, "exosims", 0.03467845, 0.31171573, 2.1408709e-05, 12701.167),
]
# Roman: github.com/roman-corgi/cgi_noise, commit 597dbfb. Scenario, V, radius in R_J, rate of the planet in e-/s, rate
# of the whole variance in e-^2/s (the sum of eight parts printed to four digits), residual speckle in e-/s, time in s
# to SNR 5 and the SNR that no time exceeds; None where cgi_noise refuses with "not achievable".
CGI = [
    ("OPT_IMG_NFB1_HLC", 5, 5.6211, 0.26784, 0.3717888, 0.0008148, 129.58478, 328.7073),
    ("OPT_IMG_NFB1_HLC", 5, 1, 0.008957, 0.0335566, 0.000861, 13597.817, 10.40319),
    ("OPT_IMG_NFB1_HLC", 3, 1, 0.056537, 0.2711109, 0.005435, 2757.6873, 10.40319),
    ("CON_IMG_NFB1_HLC", 5, 5.6211, 0.25621, 0.5287009, 0.002991, 202.02859, 85.67103),
    ("CON_IMG_NFB1_HLC", 5, 1, 0.0089236, 0.2183722, 0.003291, None, None),
    ("CON_IMG_NFB1_HLC", 3, 1, 0.043503, 2.256109, 0.01604, None, None),
    ("OPT_SPEC_NFB3_SPC", 5, 5.6211, 0.035734, 0.09765114, 0.0001432, 1912.7107, 249.5663),
    ("OPT_SPEC_NFB3_SPC", 5, 1, 0.0011309, 0.02974714, 0.0001432, 970499.63, 7.898477),
    ("OPT_SPEC_NFB3_SPC", 3, 1, 0.0071367, 0.1716116, 0.0009036, 140564.11, 7.898477),
    ("CON_SPEC_NFB3_SPC", 5, 5.6211, 0.035749, 0.1546581, 0.0008779, 3071.6772, 40.72068),
    ("CON_SPEC_NFB3_SPC", 5, 1, 0.0011305, 0.0861172, 0.0008772, None, None),
    ("CON_SPEC_NFB3_SPC", 3, 1, 0.0065866, 0.906878, 0.005111, None, None),
]


@pytest.mark.parametrize(("star", "wavelength_nm", "code", "planet", "background", "floor", "time_s"), STARK)
def test_each_code_of_the_comparison_by_its_own_convention(
    star, wavelength_nm, code, planet, background, floor, time_s
):
    found = time_for_rates(planet, background, floor_rate=floor, snr=7.0, convention=code).unwrap()
    assert found == pytest.approx(time_s, rel=5e-3)  # EXOSIMS 4e-3 from its own rates, AYO and EBS 2e-4


@pytest.mark.parametrize("code", ["ayo", "ebs", "exosims"])
def test_no_other_convention_fits(code):
    """A convention that explains a code is the only one of ours that does."""
    rows = [row for row in STARK if row[2] == code]
    planet, background, floor, time_s = np.array([row[3:] for row in rows]).T
    for convention in ({"planet_noise": a, "background_noise": b} for a in (0, 1) for b in (1, 2)):
        found = time_for_rates(planet, background, floor_rate=floor, snr=7.0, convention=convention).unwrap()
        fits = np.abs(found / time_s - 1.0).max() < 5e-3
        own = CONVENTIONS[code]
        assert fits == (convention == {"planet_noise": own.planet_noise, "background_noise": own.background_noise})


@pytest.mark.parametrize(("scenario", "v", "radius", "planet", "variance", "floor", "time_s", "critical"), CGI)
def test_cgi_noise(scenario, v, radius, planet, variance, floor, time_s, critical):
    answer = time_for_rates(planet, variance, floor_rate=floor, snr=5.0, convention="cgi_noise")
    if time_s is None:
        assert (answer.status, answer.reason) == (Status.UNREACHABLE, Reason.SPECKLE_FLOOR)
        return
    assert answer.unwrap() == pytest.approx(time_s, rel=5e-4)  # rates are printed to four or five digits
    endless = snr_for_rates(planet, variance, floor_rate=floor, time_s=1e20, convention="cgi_noise").unwrap()
    assert endless == pytest.approx(critical, rel=5e-4)
