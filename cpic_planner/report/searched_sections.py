"""The reports of contrast curves and of operating characteristics; their sections are entries of two registries."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from cpic_core import Registry
from cpic_planner import results
from cpic_planner.jobs import RunFolder
from cpic_planner.registry import LIBRARIES
from cpic_planner.report import document as doc
from cpic_planner.report.console_etc import flag_lines
from cpic_planner.report.drawing import Picture
from cpic_planner.report.numbers import duration_text, full_name
from cpic_planner.report.searched_figures import curve_pictures, roc_pictures
from cpic_planner.report.searched_words import curve_sentences, roc_sentences
from cpic_planner.report.words import prose, terms
from cpic_planner.report.write import page_html

CURVE_PRODUCTS = ("curve.csv", "completeness.csv", "recovered.csv", "report.html")
"""Names of the files of a report of contrast curves."""
ROC_PRODUCTS = ("roc.csv", "report.html")
"""Names of the files of a report of operating characteristics."""
_WORDS = "contrast; significance; threshold; speckle floor; blind search; separation; dark hole; core throughput; RDI"
_PROGRAMME = (
    "band:row,left separation_arcsec contrast visits frames em_gain visit_time_s time_s resolution_elements images"
)


@dataclass(frozen=True)
class SearchedReport:
    """Searches and their pictures, by the keys of `searched_figures.curve_pictures` or `roc_pictures`."""

    result: Any
    pictures: Mapping[str, Picture]


CURVE_SECTIONS: Registry[doc.Section[SearchedReport]] = Registry("section")
"""Sections of the report of contrast curves, in their order."""
ROC_SECTIONS: Registry[doc.Section[SearchedReport]] = Registry("section")
"""Sections of the report of operating characteristics, in their order."""


def write_curve(folder: RunFolder, result: results.CurveResult) -> None:
    """Write ``curve.csv``, ``completeness.csv``, ``recovered.csv`` and ``report.html``, each whole."""
    folder.write("curve.csv", _csv(results.CurveRow, result.points))
    folder.write("completeness.csv", completeness_csv(result))
    folder.write("recovered.csv", _csv(results.RecoveredRow, result.recovered))
    about = "Contrast curves for CPI-C: how faint a planet one programme of the star shows, by separation and band."
    page = SearchedReport(result, curve_pictures(result))
    folder.write("report.html", _page(CURVE_SECTIONS, page, result, "contrast curve", about, curve_sentences(result)))


def write_roc(folder: RunFolder, result: results.RocResult) -> None:
    """Write ``roc.csv`` and ``report.html``, each whole."""
    folder.write("roc.csv", _csv(results.RocRow, result.levels))
    about = "Operating characteristic for CPI-C: how likely a search finds a planet, against its false alarms."
    page = SearchedReport(result, roc_pictures(result))
    folder.write("report.html", _page(ROC_SECTIONS, page, result, "detection statistics", about, roc_sentences(result)))


def completeness_csv(result: results.CurveResult) -> str:
    """Return the maps of completeness as CSV, one line a band, separation and contrast."""
    names = ("band", "separation_arcsec", "contrast", "azimuth_share", "chance", "chance_known_place")
    rows = []
    for one in result.maps:
        columns = zip(one.separation_arcsec, one.azimuth_share, one.chance, one.chance_known_place, strict=True)
        for place, share, *chances in columns:
            for cell in zip(one.contrast, *chances, strict=True):
                contrast, blind, known = cell
                rows.append(dict(zip(names, (one.band, place, contrast, share, blind, known), strict=True)))
    return results.csv_text(names, rows)


def _csv(kind: type[results.Result], rows: Sequence[results.Result]) -> str:
    return results.csv_text(results.names_of(kind), [results.values_of(row) for row in rows])


def _page(
    sections: Registry[doc.Section[doc.D]],
    page: doc.D,
    result: results.SearchedResult,
    what: str,
    about: str,
    sentences: Sequence[str],
) -> str:
    star = full_name(result.target, result.hip)
    title = f"CPI-C {what} of {star}, configuration {result.config_hash}"
    summary = [doc.Paragraph(" ".join(sentences), "lead")]
    return page_html(doc.document_of(sections, page, title=title, heading=star, about=about, summary=summary))


@doc.section_of(CURVE_SECTIONS, "curves", "Contrast curves")
def _curves(page: SearchedReport) -> Iterator[doc.Block]:
    yield doc.Figure(page.pictures["curves"], key="curves")
    layout = (
        "band:row,left separation_arcsec contrast_limit_blind contrast_limit_known_place contrast_limit_threshold "
        "measured_limit measured_throughput core_throughput azimuth_share threshold"
    )
    yield doc.table(
        "Contrast limits",
        "Limits by band and separation.",
        doc.row_columns(results.CurveRow, layout),
        page.result.points,
    )


@doc.section_of(CURVE_SECTIONS, "completeness", "Completeness")
def _completeness(page: SearchedReport) -> Iterator[doc.Block]:
    if "maps" in page.pictures:
        yield doc.Figure(page.pictures["maps"], key="maps")


@doc.section_of(CURVE_SECTIONS, "injected", "Injected planets")
def _injected(page: SearchedReport) -> Iterator[doc.Block]:
    if "recovered" not in page.pictures:
        return
    yield doc.Figure(page.pictures["recovered"], key="recovered")
    layout = (
        "band:row,left separation_arcsec contrast n_injected n_recovered recovered recovered_low recovered_high "
        "predicted"
    )
    caption = "Planets found by blind searches, with the interval that holds 68 %, and what the law expects."
    yield doc.table("Injected planets", caption, doc.row_columns(results.RecoveredRow, layout), page.result.recovered)


@doc.section_of(ROC_SECTIONS, "detections", "Detections and false alarms")
def _detections(page: SearchedReport) -> Iterator[doc.Block]:
    for key, picture in page.pictures.items():
        yield doc.Figure(picture, key=key)
    layout = (
        "band:row,left sigma false_alarms detection_probability false_alarms_known_place "
        "detection_probability_known_place n_searches n_false n_planets n_detected recovered"
    )
    caption = "Levels of a detection: what the law expects, and what searches of simulated images counted."
    yield doc.table("Levels", caption, doc.row_columns(results.RocRow, layout), page.result.levels)


@doc.section_of(CURVE_SECTIONS, "programmes", "Programmes and assumptions")
@doc.section_of(ROC_SECTIONS, "programmes", "Programmes and assumptions")
def _programmes(page: SearchedReport) -> Iterator[doc.Block]:
    """Yield the programme of each band, and what was taken for granted."""
    result = page.result
    kind = results.RocProgramme if isinstance(result, results.RocResult) else results.SearchedProgramme
    caption = "The programme that every number of a band is about."
    yield doc.table("Programmes", caption, doc.row_columns(kind, _PROGRAMME), result.bands)
    for one in result.bands:
        if one.message or one.images_message:
            yield doc.Paragraph(f"{one.band}: {one.message or one.images_message}", "note")
    if flags := flag_lines(result.bands, result.note):
        yield doc.Items(flags)
    library = LIBRARIES[result.reference_library]
    yield doc.Facts(
        [
            ("Instrument", result.instrument),
            ("Wall time", f"at most {duration_text(result.time_s)} a band"),
            ("Level", f"the false-alarm probability of {result.sigma:g}σ in each resolution element"),
            ("Reference library", [f"{library.meaning} (", doc.code(library.name), f"); {result.n_modes} modes."]),
            ("Date", result.date_utc[:10]),
            ("Star table", result.catalogue),
            *doc.notes_fact(result.notes),
        ]
    )


@doc.section_of(CURVE_SECTIONS, "reproduce", "Reproducing this")
@doc.section_of(ROC_SECTIONS, "reproduce", "Reproducing this")
def _reproduced(page: SearchedReport) -> Iterator[doc.Block]:
    tables = "`curve.csv`, `completeness.csv`, `recovered.csv`" if page.result.kind == "curve" else "`roc.csv`"
    note = f"Numbers in full: `{page.result.kind}.json`; tables: {tables}."
    yield from doc.reproduced_blocks(page.result, doc.marked(note))
    yield doc.Items(prose()["credits"])
    yield doc.Fold("Glossary", [doc.Facts(terms(_WORDS))])
