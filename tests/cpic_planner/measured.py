"""A band of a confirmed target, as tests of words, pictures and verdicts need it."""

from cpic_planner.results import BandConfirmation


def band(name, **more):
    """A band that was observed; what is given stands instead."""
    usual = {"status": "ok", "reason": "", "message": "", "separation_arcsec": 0.5, "pa_deg": 315.0}
    return BandConfirmation(band=name, **usual | more)


def refused(name):
    return band(name, status="saturated", reason="adc_range", pa_deg=0.0)
