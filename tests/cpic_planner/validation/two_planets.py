"""A star like alpha Cen B with planets, and its visits: observed, not yet drawn."""

from cpic_planner.confirm.scene import _work
from cpic_planner.queries import ConfirmQuestion
from cpic_planner.validation import visit_pair


def scene_of(*places):
    """Places are separation in arcsec and position angle in degrees, of b, c and so on."""
    body = {"radius_rjup": 1, "phase_deg": 90, "albedo": "jupiter"}
    planets = [
        body | {"name": name, "separation_arcsec": separation, "pa_deg": angle}
        for name, (separation, angle) in zip("bcd", places, strict=False)
    ]
    return {"name": "s", "cstar": {"v_mag": 1.35, "spectral_type": "K1V", "distance_pc": 1.35}, "planets": planets}


def visits_of(scene, **settings):
    usual = {"bands": ("F520",), "exposure_s": 4.0, "n_frames": 60, "em_gain": 300.0, "audit": False}
    (task,) = _work(ConfirmQuestion.of(usual | {"scene": scene} | settings)).tasks
    return visit_pair(task)
