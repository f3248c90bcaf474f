"""Spectra of stars and planets: ``python -m tools.reports spectra`` makes this report anew.

How far the star is from the Sun that was measured, and the parametric albedo from the model grid to which it was
fitted. The comparison with the model grid needs its table of band albedos, which is not part of the project: give it
with ``-- --table FILE``. Without it ``errors.csv`` of the last such run is kept and quoted.
"""

from __future__ import annotations

import argparse
import csv
import io
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from catalogs import Band, load_albedo, load_reference_spectrum
from cpic_core import write_bytes, write_text
from cpic_planner.report import style
from simulator.config import load_instrument
from simulator.passbands import Passbands, v_photon_rate, vega_v_photon_rate
from simulator.target import load_parametric_grid, planet_albedo, stellar_spectrum
from simulator.target.albedo import phase_curve
from tools.calibrate_albedo.grid_fit import BANDS_NM, Measured, band_albedo, fit_parameters, read_table
from tools.report_parts import png

HERE = Path(__file__).resolve().parent

# Okabe-Ito colours, told apart with any colour vision; the ordered series run through viridis.
BLUE, ORANGE, GREEN, GREY = "#0072B2", "#E69F00", "#009E73", "#999999"
SUN = {"teff_k": 5772.0, "log_g": 4.44, "magnitude_v": -26.76}


def albedo_figure() -> Figure:
    """Parametric albedo over metallicity and over sedimentation efficiency, at 2 au."""
    figure = Figure(figsize=(10.0, 7.6), layout="constrained")
    panels = figure.subplots(2, 1, sharex=True)
    colours = style_colours(6)
    for (value, fsed), colour in zip(((m, 0.5) for m in (0.0, 0.5, 1.0, 1.5, 2.0)), colours, strict=False):
        curve(panels[0], value, fsed, colour, f"{value:g}")
    jupiter = load_albedo("jupiter")
    panels[0].plot(jupiter.wavelength_nm, jupiter.albedo, color="black", lw=0.7, ls=":", label="Jupiter, measured")
    for (metal, value), colour in zip(((0.5, f) for f in (-2.0, -1.0, -0.5, 0.0, 0.5, 0.778)), colours, strict=True):
        curve(panels[1], metal, min(value, np.log10(6.0)), colour, f"{value:g}")
    panels[0].set_title("Metallicity: log10 (Z / Z$_\\odot$), at log10 f$_{sed}$ = 0.5")
    panels[1].set_title("Sedimentation efficiency: log10 f$_{sed}$, at log10 (Z / Z$_\\odot$) = 0.5")
    panels[1].set_xlabel("wavelength (nm)")
    for panel in panels:
        for name, config in load_instrument().bands.items():
            if config.camera == "VIS":
                panel.axvspan(
                    config.center_nm - config.width_nm / 2,
                    config.center_nm + config.width_nm / 2,
                    color=GREY,
                    alpha=0.2,
                    lw=0,
                )
                panel.text(config.center_nm, 0.87, name, ha="center", va="top", fontsize=8)
        panel.set(xlim=(400, 1050), ylim=(0, 0.9), ylabel="geometric albedo")
        panel.legend(loc="lower left", ncols=3)
        panel.grid(True)
    return figure


def style_colours(number: int) -> list[tuple[float, ...]]:
    """Colours of an ordered series, dark to light."""
    from matplotlib import colormaps

    return [colormaps["viridis"](0.9 * i / (number - 1)) for i in range(number)]


def curve(panel: Axes, log10_mh: float, log10_fsed: float, colour: tuple[float, ...], label: str) -> None:
    """One parametric albedo at 2 au."""
    wavelength = np.arange(400.0, 1051.0, 1.0)
    albedo = planet_albedo(wavelength, log10_mh=log10_mh, log10_fsed=log10_fsed, insolation_au=2.0)
    panel.plot(wavelength, albedo, color=colour, lw=1.2, label=label)


def sun_rows() -> list[tuple[int, float, float, float]]:
    """Ratio of the model Sun to the measured one in sliding bands: width, worst deviation, where, rms."""
    star = stellar_spectrum(**SUN)
    sun = load_reference_spectrum("sun")
    scale = 10 ** (-0.4 * SUN["magnitude_v"]) * vega_v_photon_rate() / v_photon_rate(sun.wavelength_nm, sun.photlam)
    rows = []
    for width in (50, 60, 80, 100):
        centres = np.arange(400.0 + width / 2, 1000.0 - width / 2 + 0.1, 5.0)
        bands = Passbands.from_bands(Band(f"b{c:g}", "VIS", float(c), float(width), 1.0, 1.0) for c in centres)
        ours = bands.spectrum_rate_e_s(star.wavelength_nm, star.photlam, 1.0)
        away = ours / (scale * bands.spectrum_rate_e_s(sun.wavelength_nm, sun.photlam, 1.0)) - 1.0
        worst = int(np.argmax(np.abs(away)))
        rows.append((width, float(away[worst]), float(centres[worst]), float(np.sqrt(np.mean(away**2)))))
    return rows


def albedo_errors(table: Path) -> list[dict[str, str]]:
    """Differences from the model grid: fitted, and each band held out of the fit in turn."""
    measured, grid = read_table(table), load_parametric_grid()
    fitted = away_from(measured, grid.parameters)
    ratio = phase_curve(grid.phase, measured.phase_deg)[..., None] * measured.full_phase[:, :, :, None]
    phase = np.abs(ratio - measured.albedo)
    rows = []
    for column, name in enumerate(BANDS_NM):
        refit = fit_parameters(measured, grid.wavelength_nm, grid.methane_per_km_am, without=name)
        held_out = away_from(measured, refit)
        rows.append(
            {"band": name}
            | summary("fitted", fitted[..., column], measured)
            | summary("held_out", held_out[..., column], measured)
            | {"phase_rms": f"{np.sqrt(np.mean(phase[..., column] ** 2)):.4f}"}
        )
    return rows


def away_from(measured: Measured, parameters: np.ndarray) -> np.ndarray:
    """Absolute differences in albedo, shape (fsed, insolation, metallicity, band)."""
    grid = load_parametric_grid()
    metal = np.broadcast_to(measured.log10_mh, measured.full_phase.shape[:3]).ravel()
    flat = parameters.reshape(-1, parameters.shape[-1])
    ours = band_albedo(flat, metal, grid.wavelength_nm, grid.methane_per_km_am)
    return np.abs(ours.reshape(measured.full_phase.shape) - measured.full_phase)


def summary(kind: str, away: np.ndarray, measured: Measured) -> dict[str, str]:
    """Median at 2 au, median, 95th percentile and largest difference."""
    at_two = away[:, measured.insolation_au == 2.0]
    values = {
        "median_2au": np.median(at_two),
        "median": np.median(away),
        "p95": np.percentile(away, 95),
        "max": away.max(),
    }
    return {f"{kind}_{name}": f"{value:.4f}" for name, value in values.items()}


def main() -> None:
    """Write the report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--table", type=Path, help="band albedos of the public model grid")
    options = parser.parse_args()
    errors_file = HERE / "errors.csv"
    if options.table is not None:
        rows = albedo_errors(options.table)
        text = io.StringIO()
        writer = csv.DictWriter(text, rows[0], lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
        write_text(errors_file, text.getvalue())
    with errors_file.open(encoding="utf-8", newline="") as stream:
        errors = list(csv.DictReader(stream))
    with style():
        write_bytes(HERE / "albedo.png", png(albedo_figure(), 120))
    write_text(HERE / "report.md", "\n".join(report(errors)))
    print(HERE / "report.md")


def report(errors: list[dict[str, str]]) -> list[str]:
    """Lines of the report."""
    return [
        "# Spectra of stars and planets",
        "",
        "Regenerate with `python -m tools.reports spectra`; everything below is written by it.",
        "",
        "## Stars",
        "",
        f"A star of {SUN['teff_k']:g} K, log g {SUN['log_g']:g}, solar metallicity at V = {SUN['magnitude_v']:g} "
        "against the measured Sun (CALSPEC) scaled to the same V, in top-hat bands every 5 nm within 400-1000 nm:",
        "",
        "| width of the bands (nm) | worst deviation | centred on (nm) | rms |",
        "|---|---|---|---|",
        *(f"| {width} | {worst:+.1%} | {centre:g} | {rms:.1%} |" for width, worst, centre, rms in sun_rows()),
        "",
        "From 600 nm on the level is that of the Sun as TSIS-1 has measured it (0.3 %; `reports/external`, light of",
        "stars): from 635 to 1580 nm ours is within 1 % of it, where the level of PHOENIX-ACES has 0.3 to 4.5 % more.",
        "CALSPEC's Sun of 2001 has 2 % more light near 830 nm.",
        "",
        "Is that right for other stars? Against V, I, J and H of 44 dwarfs of 5200 to 6500 K (Casagrande et al. 2006;",
        "zero points of 2MASS by CALSPEC, Maiz Apellaniz & Pantaleoni Gonzalez 2018) the level of ACES has 2.4 % too",
        "much light in I, 2.8 % in J and 6.0 % in H, in the median, with no trend of temperature; of that 0.7, -0.2",
        "and 1.3 % are left. Dwarfs of 4600 to 4800 K have no excess in I and J and 1 % in H: the correction fades",
        "between 5200 and 4600 K. `tests/external/test_stellar_flux.py` holds half of these stars.",
        "",
        "## Planets",
        "",
        "![parametric geometric albedos](albedo.png)",
        "",
        "The model is ours: Rayleigh scattering over a cloud deck with methane absorption, seven parameters at each of",
        "480 nodes fitted to the six public band albedos of the models of Batalha et al. 2018 (AJ 156, 158). It is not",
        "their model. The dotted line is Jupiter as measured (Karkoschka 1998): its blue absorber is not in any of",
        "the models; take `jupiter` where Jupiter itself is meant.",
        "",
        "Differences from the models in geometric albedo, absolute values. *Fitted*: all bands were used.",
        "*Held out*: the band was left out of the fit at all nodes.",
        "",
        "| band | fitted: median at 2 au | median, all | 95 % | largest | held out: median at 2 au | median, all "
        "| 95 % | largest | phase curves: rms |",
        "|---|---|---|---|---|---|---|---|---|---|",
        *("| " + " | ".join([row["band"].removeprefix("albedo_"), *list(row.values())[1:]]) + " |" for row in errors),
        "",
    ]


if __name__ == "__main__":
    main()
