"""Does the prediction hold? Recovered against predicted SNR."""

from __future__ import annotations

import numpy as np

from cpic_planner.models import BandConfirmation, ConfirmResult, PlanResult
from cpic_planner.report.drawing import Picture, band_style, new_figure, save, style
from cpic_planner.validation.calibration import PREDICTION_ERROR

_LOG_SPAN = 15.0


def snr_figure(result: PlanResult | ConfirmResult) -> Picture:
    """Draw recovered against predicted SNR of every band that was measured, with the mean ratio and its error."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    items = measurements_of(result)
    looks = band_style([item.band for item in items])
    pairs: dict[str, list[tuple[float, float, float]]] = {band: [] for band in looks}
    for item in items:
        if item.predicted_snr is not None and item.recovered_snr is not None:
            pairs[item.band].append((item.predicted_snr, item.recovered_snr, item.recovered_snr_error or 0.0))
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
        ratio, error = result.calibration.get("ratio"), result.calibration.get("error")
        if ratio is not None and error is not None:
            axes.fill_between(
                line, (ratio - error) * line, (ratio + error) * line, color="#B03060", alpha=0.18, lw=0.0, zorder=1
            )
            axes.plot(
                line,
                ratio * line,
                color="#B03060",
                lw=1.2,
                ls="--",
                zorder=2,
                label=f"recovered / predicted\n{ratio:.2f} ± {error:.2f}",
            )
        for band in looks:
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
            alt=f"Recovered against predicted SNR of {len(everything)} measurements, with the line of equality.",
            caption=f"Each symbol is one planet in one band: the mean of up to {result.realisations} realisations, "
            "each with a drift of the wavefront and a noise of its own, with the error of that mean. The dashed line "
            "is the mean ratio of all, the band around it its error, which holds the accuracy of a prediction at one "
            f"place ({100 * PREDICTION_ERROR:g} %) too.",
        )


def measurements_of(result: PlanResult | ConfirmResult) -> list[BandConfirmation]:
    """Every band of every target or planet, measured or not."""
    if isinstance(result, ConfirmResult):
        return list(result.bands)
    return [band for target in result.targets for band in target.bands]
