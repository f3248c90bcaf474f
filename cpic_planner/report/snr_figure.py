"""Does the prediction hold? Recovered against predicted SNR."""

from __future__ import annotations

import numpy as np

from cpic_planner.models import BandConfirmation, PlanResult
from cpic_planner.report.drawing import Picture, band_style, new_figure, save, style
from cpic_planner.validation.calibration import snr_scatter

__all__ = ["snr_figure"]

_LOG_SPAN = 15.0


def snr_figure(plan: PlanResult) -> Picture:
    """Draw recovered against predicted SNR of every confirmed band."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    bands = list(dict.fromkeys(band.band for target in plan.targets for band in target.bands))
    looks = band_style(bands)
    pairs: dict[str, list[tuple[float, float, float]]] = {band: [] for band in bands}
    for target in plan.targets:
        for item in target.bands:
            found = _pair(item)
            if found is not None:
                pairs[item.band].append(found)
    everything = [pair for group in pairs.values() for pair in group]
    with style():
        figure = new_figure(4.9)
        axes = figure.add_subplot()
        axes.grid(visible=True)
        axes.set(xlabel="predicted SNR (analytic model)", ylabel="recovered SNR (simulated images)")
        top = 1.12 * max([max(p, r + e) for p, r, e in everything], default=10.0)
        low_predicted = min([p for p, _, _ in everything], default=1.0)
        line = np.linspace(0.0, top, 200)
        if everything and top / low_predicted > _LOG_SPAN and min(r - e for _, r, e in everything) > 0:
            axes.set(xscale="log", yscale="log")
            floor = 0.6 * min(min(p, r - e) for p, r, e in everything)
            line = np.geomspace(floor, top, 200)
            axes.set(xlim=(floor, top), ylim=(floor, top))
            for axis in (axes.xaxis, axes.yaxis):  # plain numbers, few enough not to touch
                axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
                axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
                axis.set_minor_formatter(NullFormatter())
        else:
            axes.set(xlim=(0.0, top), ylim=(min([0.0] + [r - 1.3 * e for _, r, e in everything]), top))
        axes.plot(line, line, color="#444444", lw=1.2, zorder=2, label="recovered = predicted")
        ratio, error = plan.calibration.get("ratio"), plan.calibration.get("error")
        if ratio is not None and error is not None:
            axes.plot(
                line,
                ratio * line,
                color="#B03060",
                lw=1.2,
                ls="--",
                zorder=2,
                label=f"mean ratio {ratio:.2f} ± {error:.2f}",
            )
        for band in bands:
            if not pairs[band]:
                continue
            predicted, recovered, errors = np.array(pairs[band]).T
            colour, marker = looks[band]
            axes.errorbar(
                predicted,
                recovered,
                yerr=errors,
                fmt=marker,
                color=colour,
                ms=7,
                mec="white",
                mew=0.6,
                lw=1.2,
                capsize=2.5,
                zorder=4,
                label=f"{band} ({len(predicted)})",
            )
        if not everything:
            axes.text(0.5, 0.5, "no band was measured", transform=axes.transAxes, ha="center")
        figure.legend(loc="outside right upper", alignment="left")
        return save(
            figure,
            "svg",
            alt=f"Recovered against predicted SNR of {len(everything)} confirmed bands, with the line of equality.",
            caption="Each symbol is one target in one band: one draw of the noise. Its error bar is the unit noise of "
            "an SNR combined with the uncertainty of the noise itself, which is estimated from the few apertures at "
            "one separation. Systematic differences show as a trend away from the line.",
        )


def _pair(item: BandConfirmation) -> tuple[float, float, float] | None:
    if item.predicted_snr is None or item.recovered_snr is None:
        return None
    scatter = snr_scatter(item.predicted_snr, item.predicted_significance or 0.0, item.n_background_apertures)
    return item.predicted_snr, item.recovered_snr, scatter
