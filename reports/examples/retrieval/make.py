"""What two, four and eight bands say of an atmosphere: ``python -m tools.reports retrieval`` makes this report anew."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from cpic_core import numeric_context, write_text
from cpic_planner import confirm_scene
from cpic_planner.report.export import Observed, band_covariance, observed
from cpic_planner.results import ConfirmResult
from cpic_planner.validation import AlbedoFit, AlbedoModel, fit_albedo, planet_albedo_model
from simulator import load_instrument, load_scene, spectrum_generator
from simulator.config import Instrument, Scene
from simulator.passbands import Passbands
from tools.report_parts import table

HERE = Path(__file__).resolve().parent
EXTRA = {"F580": (580, 30, 0.91), "F620": (620, 25, 0.92), "F780": (780, 25, 0.78), "F890": (890, 25, 0.46)}
"""Bands beside those of the instrument: middle and width in nm, quantum efficiency as of their neighbours."""
CHOICES = {
    2: ("F520", "F720"),
    4: ("F520", "F662", "F720", "F850"),
    8: ("F520", "F580", "F620", "F662", "F720", "F780", "F850", "F890"),
}
DRAWS, CHECKS = 12, 200
FRAMES = {"exposure_s": 9.5, "n_frames": 100, "em_gain": 150.0, "visits": 1}
LABELS = {"log10_mh": "log10 [M/H]", "log10_fsed": "log10 f_sed"}
TRUE = {"log10_mh": 1.0, "log10_fsed": 0.5}
BETWEEN = (1.25, 0.6)
"""Metallicity and clouds in the middle of a cell of the model's grid."""


def paper_planet() -> Scene:
    """Return the paper's planet with clouds inside the range of the model; its own are at the end of it."""
    tree = load_scene("paper_example").model_dump(mode="json")
    tree["planets"][0]["albedo"] |= TRUE
    return load_scene(tree)


def model_of(names: Sequence[str], instrument: Instrument) -> AlbedoModel:
    """Return the planet's contrasts in some bands."""
    light, passbands = spectrum_generator(paper_planet())[1].light, Passbands.from_instrument(instrument)
    return planet_albedo_model(light, [passbands.bands[passbands.index(name)] for name in names])


def fits_of(result: ConfirmResult, instrument: Instrument) -> dict[int, list[AlbedoFit]]:
    """Return the fit of each draw, by the number of bands."""
    items: dict[tuple[str, int], Observed] = {(item.band.band, item.row.realisation): item for item in observed(result)}
    found: dict[int, list[AlbedoFit]] = {}
    for number, names in CHOICES.items():
        model = model_of(names, instrument)
        for draw in range(1, DRAWS + 1):
            seen = [items[name, draw] for name in names]
            covariance, _ = band_covariance(seen)
            assert np.count_nonzero(covariance) == len(seen)  # contrasts have nothing in common: errors are all of it
            errors = np.sqrt(np.diag(covariance)).tolist()
            pairs = [(item.row.contrast, error) for item, error in zip(seen, errors, strict=True)]
            found.setdefault(number, []).append(fit_albedo(dict(zip(names, pairs, strict=True)), model))
    return found


def gaussian_coverage(model: AlbedoModel, errors: Sequence[float], truth: tuple[float, float] | None) -> list[float]:
    """Return how often the interval of each parameter holds the truth where errors are Gaussian.

    ``truth`` None: each time another one, spread like the prior.
    """
    rng, held = np.random.default_rng(1), np.zeros(2)
    for _ in range(CHECKS):
        true = truth or (float(rng.uniform(0.0, 2.0)), float(rng.uniform(-2.0, model.log10_fsed[-1])))
        drawn = (model.contrast(*true) + np.multiply(errors, rng.normal(size=len(errors)))).tolist()
        fit = fit_albedo(dict(zip(model.bands, zip(drawn, errors, strict=True), strict=True)), model)
        for at, name in enumerate(("log10_mh", "log10_fsed")):
            low, high = fit.interval(name)
            held[at] += low <= true[at] <= high
    return (held / CHECKS).tolist()


def main() -> None:
    """Observe, fit, and write figure and report."""
    bands = {
        name: {"camera": "VIS", "center_nm": middle, "width_nm": width, "t_opt": 0.19, "qe": qe}
        for name, (middle, width, qe) in EXTRA.items()
    }
    instrument = load_instrument({"kind": "instrument", "base": "cpic_default", "bands": bands})
    result = confirm_scene(
        paper_planet(), instrument=instrument, bands=CHOICES[8], realisations=DRAWS, audit=False, **FRAMES
    )
    with numeric_context():
        found = fits_of(result, instrument)
        model = model_of(CHOICES[4], instrument)
        spread = gaussian_coverage(model, found[4][0].errors.tolist(), None)
        there = gaussian_coverage(model, found[4][0].errors.tolist(), (TRUE["log10_mh"], TRUE["log10_fsed"]))
        between = gaussian_coverage(model, found[4][0].errors.tolist(), BETWEEN)
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    rows = []
    for axes, (name, label) in zip(figure.subplots(1, 2), LABELS.items(), strict=True):
        for place, (number, fits) in enumerate(found.items()):
            ends = np.array([fit.interval(name) for fit in fits])
            x = place + np.linspace(-0.3, 0.3, DRAWS)
            axes.vlines(x, *ends.T, color=f"C{place}", lw=2.5)
            axes.plot(x, [fit.median(name) for fit in fits], "o", color=f"C{place}", ms=4)
            width = np.diff(ends, axis=1)
            inside = int(((ends[:, 0] <= TRUE[name]) & (TRUE[name] <= ends[:, 1])).sum())
            rows.append([label, number, f"{np.median(width):.2g}", f"{inside} of {DRAWS}"])
        axes.axhline(TRUE[name], color="0.4", ls="--", lw=1.0)
        axes.set(xticks=range(len(found)), xticklabels=[f"{number} bands" for number in found], ylabel=label)
    figure.savefig(HERE / "intervals.png", dpi=110)
    snr = ", ".join(f"{band.band} {band.recovered_snr:.0f}" for band in result.bands)
    parts = [
        "# Metallicity and clouds from two, four and eight bands",
        "The planet of the paper, 10 times solar metallicity, with f_sed 3.2 (its own 6 is the end of the range), "
        f"observed once in each of eight bands with {FRAMES['n_frames']} frames of {FRAMES['exposure_s']} s, and "
        f"fitted by `cpic_planner.validation.fit_albedo`; {DRAWS} draws of the whole observation. SNR: {snr}. "
        f"Four bands are those of the instrument, the others {', '.join(EXTRA)}.",
        table(["", "bands", "width of the 68 % interval, median", "holds the truth"], rows),
        "Contrasts of different bands have no noise in common: "
        "their covariance, with which the fit is made, is that of single bands. "
        "Where truths are spread like the prior and errors are Gaussian, the intervals of four bands hold "
        f"{spread[0]:.0%} of the metallicities and {spread[1]:.0%} of f_sed; at one truth amid the nodes of the model, "
        f"log10 [M/H] {BETWEEN[0]} and log10 f_sed {BETWEEN[1]}, {between[0]:.0%} and {between[1]:.0%}; at the truth "
        "of this example, on the node at 10 times solar metallicity and beside that at f_sed 3, "
        f"{there[0]:.0%} and {there[1]:.0%}. The model is linear between nodes; beside its kinks the middle of a "
        "posterior is not the truth, whatever the data: medians of f_sed are high here with Gaussian errors too.",
        "![68 % intervals and medians of twelve draws, the truth dashed](intervals.png)",
        "Made by `python -m tools.reports retrieval`.",
    ]
    write_text(HERE / "report.md", "\n\n".join(parts) + "\n")


if __name__ == "__main__":
    main()
