"""Figures of what images recover, and the parts of reports that show measurements and pictures."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter

import numpy as np

from cpic_planner import results
from cpic_planner.report import document as doc, drawing, numbers, words
from cpic_planner.report.cells import Cells
from cpic_planner.report.drawing import BAND_STYLE, Look, Picture, band_style, literal, new_figure, save, style
from cpic_planner.report.numbers import MISSING, contrast_text, decimals
from cpic_planner.report.panel_figure import PANEL_NOTE, shown_in_both_lights
from cpic_planner.report.summary import ModelledGroup, ModelledRow, dial_text, error_text, modelled_groups, size_order
from cpic_planner.report.words import DRAWN_AS, STAR_FLUX, orbits_text, plus_minus, reason_text, status_text
from cpic_planner.validation import PREDICTION_ERROR
from simulator.config import Instrument, Scene
from simulator.target import LitPlanet, spectrum_generator

_LOG_SPAN = 15.0
_ROOM = 1.4
"""Room around the points of a logarithmic figure, as a factor."""
_MARGIN_NM = 40.0
_SHIFT_NM = 4.0
_CONTRAST_SPAN = 5.0
_POINT: Look = {"ms": 7, "mec": "white", "mew": 0.6}


def snr_figure(result: results.PlanResult | results.ConfirmResult) -> Picture:
    """Draw recovered against predicted SNR of every band that was measured, with the mean ratio and its error."""
    every = measurements_of(result)
    items = [item for item in every if item.predicted_snr is not None and item.recovered_snr is not None]
    names = ("predicted_snr", "recovered_snr", "recovered_snr_error")
    x, y, errors = (np.array([getattr(item, name) or 0.0 for item in items]) for name in names)
    with style():
        figure = new_figure(4.9)
        axes = figure.add_subplot()
        axes.grid(visible=True)
        axes.set(xlabel="predicted SNR (analytic model)", ylabel="recovered SNR (simulated images)")
        # The points decide the frame, not their error bars: one long bar would push all points into a corner.
        top = x.max(initial=1.0)
        ends = np.array([[0.0, top], [y.min(initial=0.0), y.max(initial=0.2 * top)]]) * 1.2
        if items and top > _LOG_SPAN * x.min() and y.min() > 0:
            axes.set(xscale="log", yscale="log")
            ends = np.array([[x.min() / _ROOM, x.max() * _ROOM], [y.min() / _ROOM, y.max() * _ROOM]])
            for axis in (axes.xaxis, axes.yaxis):  # plain numbers, few enough not to touch
                drawing.plain_ticks(axis, 1.0, 2.0, 5.0)
        line = ends[0]
        axes.set(xlim=line, ylim=ends[1])
        axes.plot(line, line, color="#444444", lw=1.2, zorder=2, label="recovered = predicted")
        ratio, error = result.calibration.get("etc_ratio"), result.calibration.get("etc_ratio_error")
        if ratio is not None and error is not None:
            low, high = line / (ratio + error), line / max(ratio - error, 0.1 * ratio)
            axes.fill_between(line, low, high, color="#B03060", alpha=0.18, lw=0.0, zorder=1)
            label = f"predicted over recovered\n{ratio:.2f} ± {error:.2f}"
            axes.plot(line, line / ratio, color="#B03060", lw=1.2, ls="--", zorder=2, label=label)
        for band, (colour, marker) in band_style([item.band for item in every]).items():
            own = np.array([item.band == band for item in items], bool)
            if own.any():
                look = _POINT | {"fmt": marker, "color": colour, "lw": 1.2, "capsize": 2.5, "zorder": 4}
                axes.errorbar(x[own], y[own], yerr=errors[own], label=f"{band} ({own.sum()})", **look)
        if not items:
            axes.text(0.5, 0.5, "no band was measured", transform=axes.transAxes, ha="center")
        figure.legend(loc="outside right upper", alignment="left")
        return save(
            figure,
            alt=f"Recovered against predicted SNR of {len(items)} measurements, with the line of equality.",
            caption=f"Each symbol is one planet in one band: the mean of up to {result.realisations} realisations, "
            "each with a drift of the wavefront and a noise of its own, with the error of that mean. The dashed line "
            "is the mean of predicted over recovered SNR, the band around it its error, which holds the accuracy of a "
            f"prediction at one place ({100 * PREDICTION_ERROR:g} %) too.",
        )


def measurements_of(result: results.PlanResult | results.ConfirmResult) -> list[results.BandConfirmation]:
    """Return every band of every target or planet, measured or not."""
    if isinstance(result, results.ConfirmResult):
        return list(result.bands)
    return [band for target in result.targets for band in target.bands]


def spectrum_figure(scene: Scene, instrument: Instrument, bands: Sequence[results.BandConfirmation]) -> Picture | None:
    """Draw what was measured of every planet on its contrast as a function of wavelength.

    Parameters
    ----------
    scene : Scene
    instrument : Instrument
        Its bands place the points.
    bands : sequence of BandConfirmation
        Those without a measurement are passed over.

    Returns
    -------
    Picture or None
        None where nothing was measured.
    """
    measured = [item for item in bands if item.recovered_contrast is not None]
    lights = {row.name: row.light for row in spectrum_generator(scene) if isinstance(row.light, LitPlanet)}
    names = [planet.name for planet in scene.planets if any(item.planet == planet.name for item in measured)]
    if not names:
        return None
    edges = [instrument.bands[item.band] for item in measured]
    low = min(band.center_nm - 0.5 * band.width_nm for band in edges) - _MARGIN_NM
    high = max(band.center_nm + 0.5 * band.width_nm for band in edges) + _MARGIN_NM
    with style():
        figure = new_figure(4.2)
        axes = figure.add_subplot()
        axes.grid(visible=True)
        axes.set(xlabel="wavelength (nm)", ylabel="contrast (planet over star)", xlim=(low, high))
        heights: list[float] = []
        for number, name in enumerate(names):
            light, (colour, marker) = lights[name], BAND_STYLE[number % len(BAND_STYLE)]
            inside = (light.wavelength_nm >= low) & (light.wavelength_nm <= high)
            x, y = light.wavelength_nm[inside], light.contrast[inside]
            axes.plot(x, y, color=colour, lw=1.0, alpha=0.55, label=literal(f"{name}: input"))
            own = [item for item in measured if item.planet == name]
            centre = np.array([instrument.bands[item.band].center_nm for item in own])
            half = np.array([0.5 * instrument.bands[item.band].width_nm for item in own])
            true, value, error, mean = (
                np.array([getattr(item, key) or 0.0 for item in own])
                for key in ("true_contrast", "recovered_contrast", "contrast_error", "contrast_mean_error")
            )
            label = "input in the band" if number == 0 else ""
            axes.hlines(true, centre - half, centre + half, color="#222222", lw=2.0, zorder=3, label=label)
            place = centre + _SHIFT_NM * (number - 0.5 * (len(names) - 1))
            axes.errorbar(place, value, yerr=error, fmt="none", ecolor=colour, elinewidth=1.1, capsize=4.0, zorder=4)
            look = _POINT | {"fmt": marker, "color": colour, "elinewidth": 3.2, "zorder": 5}
            axes.errorbar(place, value, yerr=mean, label=literal(f"{name}: recovered"), **look)
            heights += [*(value + error), *(value - error), *true]
        if min(heights) > 0 and max(heights) > _CONTRAST_SPAN * min(heights):
            axes.set_yscale("log")
        figure.legend(loc="outside right upper", alignment="left")
        drawn = f"{', '.join(names)} in {len(measured)} measurements"
        return save(
            figure,
            alt=f"Recovered contrasts of {drawn}, on the spectrum of the scene.",
            caption="Points: mean contrast over the realisations, the thick bar its error, the thin bar that of one "
            "observation. Curve: the contrast of the scene; black dashes: its mean over each band, weighted with the "
            "star's detected light, which is what a measurement should give.",
        )


MEASURED_NOTE = "measurements as a table: `measurements.csv`. Times, host and package versions of the run: `run.json`."
"""Which files have the measurements and the story of a run."""


def instrument_fact(result: results.ImagedResult) -> doc.Inline:
    """Return which instrument images and predictions are of, and how the images are made."""
    more = f", {dial_text(result)}. Every default value has its source and confidence in the instrument preset."
    return [doc.code(result.instrument), more]


def outcome(band: results.BandConfirmation) -> doc.Mark:
    """Return the badge of what became of a planet in the images of a band."""
    if band.status != "ok":
        return doc.badge(band.status, status_text(band.status))
    return doc.badge("ok", "detected") if band.detected else doc.badge("unreachable", "not detected")


def _of(count: int | None, n: int | None) -> str:
    return MISSING if count is None else f"{count} of {n}"


def _predicted_error(band: results.BandConfirmation) -> str:
    return error_text(band.modelled.predicted_error) if band.modelled else MISSING


def _contrast_error(band: results.BandConfirmation) -> doc.Inline:
    if band.contrast_error is None:
        return MISSING
    return doc.lines(f"± {contrast_text(band.contrast_error, 2)}", f"± {contrast_text(band.contrast_mean_error, 2)}")


def _position(band: results.BandConfirmation) -> doc.Inline:
    if band.found_separation_arcsec is None:
        return MISSING
    return doc.lines(
        f"{decimals(band.found_separation_arcsec, 4)} ± {decimals(band.found_separation_error_arcsec, 4)}″",
        f"PA {decimals(band.found_pa_deg, 2)} ± {decimals(band.found_pa_error_deg, 2)}°",
    )


def _star_flux(band: results.BandConfirmation) -> str:
    error = "" if band.star_flux_error is None else f" ({numbers.percent_text(band.star_flux_error)})"
    return STAR_FLUX.get(band.star_flux, band.star_flux) + error if band.star_flux else MISSING


def _verdict(band: results.BandConfirmation) -> str:
    why = band.message or reason_text(band.reason)
    return plus_minus(band.verdict) + (f": {why}" if why else "")


def _quantities() -> list[doc.Column[results.BandConfirmation]]:
    """Return the rows of the table of measurements, one a quantity."""
    return doc.row_columns(
        results.BandConfirmation,
        "outcome separation_arcsec pa_deg frames em_gain integration_s time_s realisations predicted_error "
        "predicted_snr recovered_snr etc_ratio predicted_significance recovered_significance threshold n_detected "
        "search_snr search_threshold n_significant false_detections found true_contrast recovered_contrast "
        "contrast_error star_flux rdi_throughput rdi_modes_used core_throughput n_background_apertures "
        "saturated_in_hole saturated_outside verdict",
        outcome=Cells("", outcome, label="outcome"),
        realisations=lambda band: doc.lines(
            numbers.count_text(band.realisations), doc.small(DRAWN_AS[band.drawn_as] if band.drawn_as else "")
        ),
        predicted_error=Cells("", _predicted_error, label="predicted error of the images", unit="beside the reference"),
        n_detected=lambda band: _of(band.n_detected, band.realisations),
        n_significant=lambda band: _of(band.n_significant, band.realisations),
        found=Cells("", _position, label="found at", unit="first realisation that finds it"),
        contrast_error=Cells("", _contrast_error, label="its error", unit="one observation; mean"),
        star_flux=_star_flux,
        verdict=_verdict,
    )


def measure_table(
    name: str, bands: Sequence[results.BandConfirmation], caption: str, chosen: str | None = None
) -> doc.Table:
    """Return what was predicted and measured, a row a quantity and a column a band.

    Parameters
    ----------
    name : str
        Target or planet.
    bands : sequence of BandConfirmation
    caption : str
        What the table is of.
    chosen : str, optional
        Band whose column is shaded.
    """

    def column(band: results.BandConfirmation) -> doc.Column[doc.Column[results.BandConfirmation]]:
        picked = band.band == chosen
        heading: doc.Inline = [band.band, " ", doc.small("(chosen)")] if picked else band.band
        return doc.Column(heading, lambda quantity: quantity.value(band), look="pick" if picked else "")

    def named(quantity: doc.Column[results.BandConfirmation]) -> doc.Inline:
        return [quantity.heading, " ", doc.small(f"({quantity.unit})")] if quantity.unit else quantity.heading

    first: doc.Column[doc.Column[results.BandConfirmation]] = doc.Column("Quantity", named, look="row left")
    text = f"{caption} Recovered numbers are those of one observation, averaged over the realisations."
    if any(band.search_threshold is not None for band in bands):
        text = f"{text} {words.prose()['two_statistics']}"
    return doc.table(f"Bands of {name}", text, [first, *map(column, bands)], _quantities(), look="bands")


def _audit_columns() -> list[doc.Column[tuple[results.BandConfirmation, results.AuditRecord]]]:
    return doc.row_columns(
        results.AuditRecord,
        "band:row frames_run frames_in_all predicted_snr recovered_snr true_contrast contrast deviation_sigma detected "
        "false_detections hits rejected_fraction saturated_in_hole saturated_outside",
        of=itemgetter(1),
        band=Cells("", lambda case: case[0].band, right=False, label="band"),
        true_contrast=Cells("", lambda case: contrast_text(case[0].true_contrast), label="true contrast"),
        detected=lambda case: doc.badge("ok", "found") if case[1].detected else doc.badge("unreachable", "not found"),
    )


def audit_blocks(name: str, bands: Iterable[results.BandConfirmation]) -> Iterator[doc.Block]:
    """Yield the table of the realisations that were run frame by frame, if there are any."""
    audited = [(band, band.audit) for band in bands if band.audit is not None]
    if audited:
        caption = (
            "Audited: one more realisation of the programme with every effect of the camera, calibrated and cleaned of "
            "particles. The stated part of its frames is run one by one, beside frames of the same light and random "
            "numbers without these effects; what they change is carried to all frames. Deviation: measured less true "
            "contrast, in units of its error."
        )
        yield doc.table(f"Frame by frame, {name}", caption, _audit_columns(), audited)


def picture_blocks(images: Mapping[str, Picture], keys: Iterable[str], name: str) -> Iterator[doc.Block]:
    """Yield image panels, those that there are of some keys, and before them how to read them."""
    shown = [shown_in_both_lights(images[key]) for key in keys if key in images]
    if shown:
        yield doc.Paragraph(PANEL_NOTE, "note")
    yield from (doc.Figure(picture, before=name) for picture in shown)


@dataclass(frozen=True)
class _EffectRow:
    """One effect in all images of a report: its largest size, and what became of it in how many of them."""

    row: ModelledRow
    where: str
    words: dict[str, int]

    @property
    def decision(self) -> doc.Inline:
        """What became of the effect; where that differs between images, in how many."""
        kept = "ok" if self.row.effect.decision == "kept" else "unreachable"
        others = ", ".join(f"{word} in {count}" for word, count in self.words.items())
        return doc.lines(doc.badge(kept, self.row.word), doc.small(others) if len(self.words) > 1 else "")


_EFFECTS: tuple[doc.Column[_EffectRow], ...] = (
    doc.Column("Effect", lambda item: item.row.effect.effect, look="row left"),
    doc.Column("Predicted size", lambda item: item.row.size or MISSING, "largest of flux and SNR"),
    doc.Column("Largest in", lambda item: item.where, look="left"),
    doc.Column("Modelled", lambda item: item.decision, look="left"),
    doc.Column("How, or why not", lambda item: item.row.effect.reason, look="left wide"),
)


def _effect_rows(groups: Sequence[ModelledGroup]) -> list[_EffectRow]:
    """Return every effect once, largest first."""
    every: dict[str, list[tuple[ModelledGroup, ModelledRow]]] = {}
    for group in groups:
        for row in group.rows:
            every.setdefault(row.effect.effect, []).append((group, row))
    rows = []
    for found in every.values():
        group, largest = max(found, key=lambda item: size_order(item[1].effect))
        words: Counter[str] = Counter()
        for other, row in found:
            words[row.word] += len(other.names)
        alike = len({row.size for _, row in found}) == 1
        rows.append(_EffectRow(largest, largest.where or ("" if alike else group.names[0]), dict(words)))
    return sorted(rows, key=lambda item: -size_order(item.row.effect))


def modelled_blocks(named: Sequence[tuple[str, results.ModellingRecord]]) -> Iterator[doc.Block]:
    """Yield how images were made, each distinct way in a paragraph, and a folded table of all effects."""
    groups = modelled_groups(named)
    if not groups:
        yield doc.Paragraph("No image was made.")
        return
    for group in groups:
        knobs = group.knobs[:1].upper() + group.knobs[1:]
        made = f": {group.members}. {knobs}. Predicted error beside the reference: {group.errors}."
        yield doc.Paragraph([doc.strong(group.title), made])
    rows = _effect_rows(groups)
    caption = (
        "Sizes are closed-form predictions of the relative change of what is measured if the effect is left out or "
        "done more coarsely, after the reduction; a dash where none can be given. What is left out is left out because "
        "the sum of such sizes stays within what was asked for, or because it is not there."
    )
    yield doc.Fold(f"All effects ({len(rows)})", [doc.table("Effects in the images", caption, _EFFECTS, rows)])


def not_modelled_blocks(items: Sequence[str]) -> Iterator[doc.Block]:
    """Yield what neither images drawn as sums nor predictions hold."""
    yield doc.Items(items) if items else doc.Paragraph("Nothing is listed.")
    yield doc.Paragraph(
        "Realisations that are drawn as sums of frames leave these out, and so does the prediction. The audited ones, "
        "a part of whose frames are run one by one, hold whatever the camera of the instrument has switched on. An "
        "effect that is missing from both sides does not show in their comparison.",
        "note",
    )


def visits_facts(target: results.ConfirmedTarget) -> dict[str, str]:
    """Return the visits of a confirmed target, in words by heading: those of the ranking, or of a schedule."""
    if target.roll_deg is not None:
        own = ", ".join(f"{band.visits} in {band.band}" for band in target.bands if band.visits is not None)
        return {"Visits": f"{own or 'none'}, reduced together", "Roll": f"{target.roll_deg:g} deg"}
    star = target.ranked
    if star.visits is None or star.visit_time_s is None:
        return {}
    span = "" if star.span_days is None else f" over {numbers.significant(star.span_days, 2)} days"
    paid = orbits_text([star])
    visits = f"{star.visits} of {numbers.duration_text(star.visit_time_s)}{span}, reduced together"
    return {"Visits": f"{visits}; {paid}" if paid else visits}
