"""Regenerate this report: ``python reports/spectra/make.py`` (a minute; with ``--table`` three).

Stellar and planetary spectra as in the paper (Zhu et al. 2025, its figures of stellar spectra and of geometric
albedos), how far the star is from the Sun that was measured and the parametric albedo from the model grid to which it
was fitted, and the contrasts of the paper's example.

The comparison with the model grid needs its table of band albedos, which is not part of the project: give it with
``--table FILE``. Without it ``errors.csv`` of the last such run is kept and quoted.
"""

from __future__ import annotations

import argparse
import csv
import io
import sys
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from catalogs import Band, load_albedo, load_reference_spectrum, stellar_parameters
from cpic_core import write_bytes, write_text
from cpic_planner.report import style
from simulator.band_integrals import v_photon_rate, vega_v_photon_rate
from simulator.config import load_instrument
from simulator.passbands import Passbands
from simulator.target import contrast_at, load_parametric_grid, parametric_family, planet_albedo, stellar_spectrum
from simulator.target.parametric import phase_curve

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1]))  # the programs of developers are not installed
from tools.calibrate_albedo.grid_fit import BANDS_NM, Measured, band_albedo, fit_parameters, read_table  # noqa: E402
from tools.calibrate_albedo.methane import ANCHORS_PER_KM_AM, Methane, invert_methane  # noqa: E402

# Okabe-Ito colours, told apart with any colour vision; the ordered series run through viridis.
BLUE, ORANGE, GREEN, GREY = "#0072B2", "#E69F00", "#009E73", "#999999"
TYPES = ("F5V", "G5V", "K5V")
MAGNITUDES = ((0.0, BLUE), (3.0, ORANGE), (6.0, GREEN))
PAPER = {"F520": (5.163e-8, 0.11), "F662": (4.737e-8, 0.22), "F720": (3.533e-8, 0.18), "F850": (2.138e-8, 0.18)}
"""Recovered contrasts of the paper's table 1 and their relative standard errors, 1 / SNR."""
SEPARATION_ARCSEC, DISTANCE_PC, HOST = 0.65, 1.35, "K1V"
PARAMETRIC, JUPITER = "parametric albedo of the example", "Jupiter as measured"
SUN = {"teff_k": 5772.0, "log_g": 4.44, "magnitude_v": -26.76}


def stellar_figure() -> Figure:
    """Photon spectra of three types at three magnitudes, with blackbodies."""
    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    panels = figure.subplots(1, 3, sharey=True)
    for panel, spectral_type in zip(panels, TYPES, strict=True):
        for magnitude, colour in MAGNITUDES:
            star = stellar_spectrum(magnitude, spectral_type)
            dark = stellar_spectrum(magnitude, spectral_type, model="blackbody")
            label = f"V = {magnitude:g}"
            panel.plot(star.wavelength_nm, star.photlam, color=colour, lw=0.8, label=label)
            panel.plot(dark.wavelength_nm, dark.photlam, color=colour, lw=1.4, ls="--")
        panel.plot([], [], color="black", lw=1.4, ls="--", label="blackbody")
        panel.set(yscale="log", xlim=(300, 1750), ylim=(0.3, 5e3), xlabel="wavelength (nm)")
        panel.set_title(f"{spectral_type}, {stellar_parameters(spectral_type).teff_k:.0f} K")
        panel.grid(True)
    panels[0].set_ylabel("photon flux density (ph s$^{-1}$ cm$^{-2}$ Å$^{-1}$)")
    panels[0].legend(loc="lower center", ncols=2)
    return figure


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


def f850_figure(widths: np.ndarray, centres: np.ndarray) -> Figure:
    """Contrast of the paper's planet in F850 against the width of the band and against its centre."""
    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    value, error = PAPER["F850"]
    used = load_instrument().bands["F850"]
    for panel, places, now in ((panels[0], widths, used.width_nm), (panels[1], centres, used.center_nm)):
        panel.axhspan(value * (1 - error) * 1e8, value * (1 + error) * 1e8, color=GREY, alpha=0.35, lw=0)
        panel.axhline(value * 1e8, color="black", lw=1.0, label="paper, 2.138e-8 with its standard error")
        for name, colour, line in ((PARAMETRIC, BLUE, "-"), (JUPITER, ORANGE, "--")):
            found = f850_contrasts(name, widths=places) if panel is panels[0] else f850_contrasts(name, centres=places)
            panel.plot(places, found * 1e8, color=colour, lw=1.6, ls=line, label=name)
        panel.axvline(now, color=GREEN, lw=1.0, ls=":", label="assumed here")
        panel.set(ylim=(0, 5.0), xlim=(float(places[0]), float(places[-1])))
        panel.grid(True)
    panels[0].set(xlabel="full width of a top-hat at 850 nm (nm)", ylabel="contrast of the planet (1e-8)")
    panels[1].set(xlabel=f"centre of a top-hat {used.width_nm:g} nm wide (nm)")
    panels[0].legend(loc="lower right")
    return figure


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


def geometric_factor() -> float:
    """Contrast / A_g of the paper's planet."""
    return float(contrast_at(1.0, SEPARATION_ARCSEC * DISTANCE_PC, 90.0, 1.0))


def paper_albedos(bands: Passbands) -> np.ndarray:
    """Band albedos of the paper's planet: log10_mh = log10_fsed = 1 at 2 au."""
    host = stellar_parameters(HOST)
    family = parametric_family(1.0, float(np.log10(6.0)))
    return bands.band_albedo(family.at(2.0), host.teff_k, host.log_g, 0.0)


def f850_contrasts(name: str, *, widths: np.ndarray | None = None, centres: np.ndarray | None = None) -> np.ndarray:
    """Contrast in top-hats at 850 nm of several widths, or of the assumed width at several centres."""
    used = load_instrument().bands["F850"]
    shapes = [(used.center_nm, w) for w in widths] if widths is not None else [(c, used.width_nm) for c in centres]
    bands = Passbands.from_bands(Band(f"b{c:g}_{w:g}", "VIS", float(c), float(w), 1.0, 1.0) for c, w in shapes)
    factor, host = geometric_factor(), stellar_parameters(HOST)
    albedo = parametric_family(1.0, float(np.log10(6.0))).at(2.0) if name == PARAMETRIC else load_albedo("jupiter")
    return factor * bands.band_albedo(albedo, host.teff_k, host.log_g, 0.0)


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
    widths, centres = np.arange(5.0, 301.0, 5.0), np.arange(800.0, 901.0, 1.0)
    with style():
        for name, figure in (
            ("stars", stellar_figure()),
            ("albedo", albedo_figure()),
            ("f850", f850_figure(widths, centres)),
        ):
            image = io.BytesIO()
            figure.savefig(image, format="png", dpi=120, metadata={"Software": None})
            write_bytes(HERE / f"{name}.png", image.getvalue())
    write_text(HERE / "report.md", "\n".join(report(errors, widths, centres, invert_methane())))
    print(HERE / "report.md")


def giant_rows(methane: Methane) -> list[str]:
    """Measured and modelled albedo of the four planets in the visible bands."""
    bands = [band for band in load_instrument().bands.items() if band[1].camera == "VIS"]
    rows = []
    for planet, measured in methane.measured.items():
        cells = [planet.capitalize(), f"{methane.rms(planet, 400.0, 1050.0):.3f}"]
        for _, band in bands:
            inside = np.abs(methane.wavelength_nm - band.center_nm) <= 0.5 * band.width_nm
            cells.append(f"{measured[inside].mean():.3f} / {methane.modelled[planet][inside].mean():.3f}")
        cells.append(f"{methane.mixing_ratio[planet]:.2%}")
        rows.append(f"| {' | '.join(cells)} |")
    head = ["planet", "rms, 400-1050 nm", *(name for name, _ in bands), "CH4/H2 of the fit"]
    return [f"| {' | '.join(head)} |", "|" + "---|" * len(head), *rows]


def report(errors: list[dict[str, str]], widths: np.ndarray, centres: np.ndarray, methane: Methane) -> list[str]:
    """Lines of the report."""
    bands = Passbands.from_instrument(load_instrument())
    factor = geometric_factor()
    found = factor * paper_albedos(bands)
    grid = load_parametric_grid()
    paper_rows = []
    for name, (value, error) in PAPER.items():
        ours = found[bands.index(name)]
        width = bands.bands[bands.index(name)].width_nm
        paper_rows.append(
            f"| {name} | {width:g} | {ours / factor:.3f} | {ours:.3e} | {value:.3e} "
            f"| {ours / value - 1:+.0%} | {(ours / value - 1) / error:+.1f} |"
        )
    value, error = PAPER["F850"]
    by_width, by_centre = f850_contrasts(PARAMETRIC, widths=widths), f850_contrasts(PARAMETRIC, centres=centres)
    least = int(np.argmin(by_width))
    inside = [centres[np.abs(by_centre / value - 1) <= n * error] for n in (1, 2)]
    anchors = ", ".join(
        f"{np.interp(place, grid.wavelength_nm, grid.methane_per_km_am):.3f} ({published} published) at {place:g} nm"
        for place, published in ANCHORS_PER_KM_AM.items()
    )
    return [
        "# Spectra of stars and planets",
        "",
        "Regenerate with `python reports/spectra/make.py`; everything below is written by it.",
        "",
        "## Stars",
        "",
        "![photon spectra of F5V, G5V and K5V stars](stars.png)",
        "",
        "Solid: the embedded grid. Dashed: blackbodies of the same temperature and V magnitude.",
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
        "### The giant planets with the same physics",
        "",
        "The methane coefficients come from the measured albedos of the four giant planets, each two layers of gas of",
        "the same kind over a deck of smooth reflectivity. Band means, measured / modelled:",
        "",
        *giant_rows(methane),
        "",
        f"Coefficients in 1/(km amagat): {anchors}.",
        "",
        "## The paper's example",
        "",
        f"A planet of 1 R_J at {SEPARATION_ARCSEC} arcsec from alpha Cen B ({HOST}) at {DISTANCE_PC} pc, phase 90 deg: "
        f"contrast / A_g = {factor:.4g}. Atmosphere: `log10_mh = 1`, `log10_fsed = 1` (taken as log10 6), "
        "`insolation_au = 2`; band averages under the star's light.",
        "",
        "| band | width (nm) | band albedo | contrast | paper | difference | in the paper's standard errors |",
        "|---|---|---|---|---|---|---|",
        *paper_rows,
        "",
        "![contrast in F850 against width and centre](f850.png)",
        "",
        "The paper does not state the widths. No top-hat centred on 850 nm reaches its F850 value, with this albedo or "
        f"with Jupiter's: the least contrast is {by_width[least]:.2e} ({by_width[least] / value - 1:+.0%}, "
        f"{(by_width[least] / value - 1) / error:+.1f} of the paper's standard errors) at {widths[least]:g} nm. "
        "The gap between the methane bands at 790 and 862-890 nm lies in its middle, and every cloudy model is bright "
        "there. "
        f"A band of the assumed width would have to be centred at {span(inside[0])} (one standard error; "
        f"{span(inside[1])} for two), on the methane band.",
        "",
    ]


def span(places: np.ndarray) -> str:
    """Ranges of a contiguous or broken set of integers, in words."""
    if not places.size:
        return "no place"
    runs = np.split(places, np.flatnonzero(np.diff(places) > 1.5) + 1)
    return " or ".join(f"{run[0]:g}-{run[-1]:g} nm" for run in runs)


if __name__ == "__main__":
    main()
