"""Times that other calculators find from their own rates, and those that we find from the same rates."""

from __future__ import annotations

from typing import Any

from reports.external.comparison import Reference, Row

TITLE = "Time from given rates"
REFERENCE = Reference(
    "AYO, EBS and EXOSIMS in the comparison of Stark et al. 2025, and Roman's cgi_noise",
    "sheet of 2025-09-23, commit 597dbfb",
    "arXiv 2502.18556, repository eleonoraalei/pyEDITH, tests/validation_tests_battery/ETC_cal_detect.xlsx; "
    "repository roman-corgi/cgi_noise",
)
TEXT = """
Rates of planet, background (starlight, zodiacal and exozodiacal light, dark charge, light of other stars) and noise
floor are theirs; `time_for_rates` with the convention of each code turns them into a time. The sheet asks for SNR 7,
cgi_noise for SNR 5. No other of the conventions fits any of the codes: what the codes call an exposure time differs by
more than a factor of two for the same rates.
"""
STARK_SNR, CGI_SNR = 7.0, 5.0
REFUSED = "not achievable"


def rows(recorded: dict[str, Any]) -> list[Row]:
    """Return the times of both."""
    from cpic_planner import Reason, snr_for_rates, time_for_rates

    found = []
    for case in recorded["stark"]:
        about = {"floor_rate": case["floor"], "snr": STARK_SNR, "convention": case["code"]}
        ours = time_for_rates(case["planet"], case["background"], **about).unwrap()
        what = f"time (s), {case['code'].upper()}, {case['star']}, {case['wavelength_nm']} nm"
        why = (
            "two of six are 0.3 to 0.4 % off; the sheet does not say why"
            if case["code"] == "exosims"
            else "printed digits"
        )
        found.append(Row(what, case["time_s"], float(ours), 5e-3, why))
    for case in recorded["cgi_noise"]:
        about = {"floor_rate": case["floor"], "convention": "cgi_noise"}
        answer = time_for_rates(case["planet"], case["variance"], snr=CGI_SNR, **about)
        place = f"{case['scenario']}, V = {case['v_mag']}, {case['radius_rjup']:g} R_J"
        if case["time_s"] is None:
            ours = REFUSED if answer.reason == Reason.SPECKLE_FLOOR else answer.status.value
            found.append(Row(f"time (s), cgi_noise, {place}", REFUSED, ours, 1e-3))
            continue
        endless = snr_for_rates(case["planet"], case["variance"], time_s=1e20, **about).unwrap()
        why = "rates are printed with four or five digits"
        found.append(Row(f"time (s), cgi_noise, {place}", case["time_s"], float(answer.unwrap()), 5e-4, why))
        found.append(
            Row(f"SNR after endless time, cgi_noise, {place}", case["critical_snr"], float(endless), 5e-4, why)
        )
    return found
