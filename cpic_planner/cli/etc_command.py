"""``cpic etc``."""

from __future__ import annotations

import math
from typing import Annotated, Any

import typer

from cpic_planner.cli.options import (
    DEFAULT_TIME_S,
    AlbedoOption,
    BandOption,
    CatalogOption,
    CloudsOption,
    CompanionsOption,
    InsolationOption,
    InstrumentOption,
    JsonOption,
    MetallicityOption,
    OnOff,
    PhaseFunctionOption,
    albedo_from,
    planet_from,
)
from cpic_planner.cli.output import console, print_json
from cpic_planner.cli.output import note as tell
from cpic_planner.etc.answer import EtcAnswer

__all__ = ["HELP", "etc"]

HELP = """Ask the exposure-time calculator about one star: time for an SNR, SNR for a time, or the contrast limit.

Without a separation the planet stands where the answer is best in each band: least time, clearest detection, or
faintest limit. A given time is an upper bound: the walk of the wavefront can make a shorter visit better.

Examples:

  cpic etc "tau Cet" --snr 10

  cpic etc "alpha Cen B" --time-s 7200 --separation-arcsec 0.65 --band F520 --band F662

  cpic etc "HD 10700" --semi-major-axis-au 1.5 --contrast-limit

  cpic etc "alpha Cen B" --distance-pc 1.35 --separation-arcsec 0.65 --log10-mh 1 --log10-fsed 1 --insolation-au 2

  cpic etc "eps Eri" --contrast 5e-9 --separation-arcsec 0.6 --snr 5 --json

  cpic etc "my star" --catalog my_stars.csv --snr 10"""


def etc(
    target: Annotated[
        str, typer.Argument(help='Star: "HIP 8102", "tau Cet", "alpha Cen B", "HD 10700", "61 Cyg A" ...')
    ],
    snr: Annotated[float | None, typer.Option("--snr", help="Ask for the wall time that reaches this SNR.")] = None,
    time_s: Annotated[
        float | None,
        typer.Option(
            "--time-s",
            help=f"Wall time in s, readouts and reference frames included [default: {DEFAULT_TIME_S:g}].",
        ),
    ] = None,
    contrast_limit: Annotated[
        bool, typer.Option("--contrast-limit", help="Ask for the faintest contrast detected in --time-s.")
    ] = False,
    bands: BandOption = None,
    separation_arcsec: Annotated[
        float | None,
        typer.Option("--separation-arcsec", help="Projected separation, on the diagonal of a quadrant."),
    ] = None,
    semi_major_axis_au: Annotated[
        float | None,
        typer.Option(
            "--semi-major-axis-au",
            help="Radius of a circular orbit; gives separation and distance at --phase-deg.",
        ),
    ] = None,
    contrast: Annotated[
        float | None, typer.Option("--contrast", help="Planet-to-star ratio instead of a planet model.")
    ] = None,
    radius_rjup: Annotated[
        float | None, typer.Option("--planet-radius-rjup", help="Planet radius in R_J = 71 492 km [default: 1].")
    ] = None,
    phase_deg: Annotated[
        float | None, typer.Option("--phase-deg", help="Phase angle, above 0 and below 180 deg [default: 90].")
    ] = None,
    albedo: AlbedoOption = None,
    log10_mh: MetallicityOption = None,
    log10_fsed: CloudsOption = None,
    insolation_au: InsolationOption = None,
    phase_function: PhaseFunctionOption = None,
    exposure_s: Annotated[
        float | None, typer.Option("--exposure-s", help="Frame exposure, instead of the best.")
    ] = None,
    frames: Annotated[
        int | None, typer.Option("--frames", min=1, help="Science frames of --exposure-s; sets the time.")
    ] = None,
    em_gain: Annotated[float | None, typer.Option("--em-gain", help="EM gain, instead of the best.")] = None,
    distance_pc: Annotated[
        float | None, typer.Option("--distance-pc", help="Distance, instead of the catalogue's.")
    ] = None,
    companions: CompanionsOption = OnOff.ON,
    catalog: CatalogOption = "snapshot",
    instrument: InstrumentOption = None,
    as_json: JsonOption = False,
) -> None:
    """Answer and print."""
    from dataclasses import replace

    import numpy as np

    from catalogs.catalogue import open_catalogue
    from catalogs.errors import InputError
    from cpic_planner.etc import questions
    from cpic_planner.etc.model import build_model
    from cpic_planner.etc.place import check_range
    from cpic_planner.etc.result import etc_result
    from cpic_planner.optimiser import best_separations
    from cpic_planner.targets import find_target
    from simulator.config import load_instrument

    _refuse_together({"--snr": snr, "--time-s": time_s}, "one asks for a time, the other gives it")
    _refuse_together({"--snr": snr, "--contrast-limit": contrast_limit or None}, "two questions")
    _refuse_together({"--snr": snr, "--frames": frames}, "--frames sets the time that --snr asks for")
    _refuse_together({"--time-s": time_s, "--frames": frames}, "both set the time")
    _refuse_together(
        {"--separation-arcsec": separation_arcsec, "--semi-major-axis-au": semi_major_axis_au},
        "both place the planet",
    )
    _refuse_together({"--contrast-limit": contrast_limit or None, "--contrast": contrast}, "the limit is the answer")
    planet_options = {"--planet-radius-rjup": radius_rjup, "--albedo": albedo, "--log10-mh": log10_mh,
                      "--log10-fsed": log10_fsed, "--insolation-au": insolation_au,
                      "--phase-function": phase_function}  # fmt: skip
    for name, value in planet_options.items():
        _refuse_together({name: value, "--contrast": contrast}, "a given contrast needs no planet")
        _refuse_together({name: value, "--contrast-limit": contrast_limit or None}, "the limit holds for any planet")
    if semi_major_axis_au is None:
        phase: dict[str, object] = {"--phase-deg": phase_deg}
        _refuse_together(phase | {"--contrast": contrast}, "a given contrast needs no phase")
        _refuse_together(phase | {"--contrast-limit": contrast_limit or None}, "the limit holds for any phase")
    phase_deg = 90.0 if phase_deg is None else phase_deg
    if frames is not None and exposure_s is None:
        raise InputError("--frames", frames, allowed="together with --exposure-s")
    table = open_catalogue(catalog)
    for remark in table.notes:
        tell(remark)
    star, note = find_target(target, companions=companions.value, catalog=table)
    if table.kind != "snapshot":
        note = "; ".join(filter(None, (note, f"star data: {table.provenance}")))
    if distance_pc is not None:
        there = check_range("--distance-pc", distance_pc, 0.01, 1e5, "pc")
        # The same star in the sky from elsewhere: its luminosity follows the square of the distance.
        brighter = (there / star.distance_pc) ** 2
        star = replace(star, distance_pc=np.array([there]), luminosity_lsun=star.luminosity_lsun * brighter)
    model = build_model(load_instrument(instrument), bands)
    reflects = albedo_from(albedo, log10_mh, log10_fsed, insolation_au, phase_function)
    planet = planet_from(1.0 if radius_rjup is None else radius_rjup, phase_deg, reflects)
    if semi_major_axis_au is not None:
        check_range("--semi-major-axis-au", semi_major_axis_au, 1e-3, 1e5, "au")
        separation_arcsec = semi_major_axis_au * math.sin(math.radians(phase_deg)) / float(star.distance_pc[0])
    wall = DEFAULT_TIME_S if time_s is None else time_s
    if frames is not None and exposure_s is not None:
        wall = model.instrument.overhead_s + frames * model.frame_pace_s(exposure_s)
    fixed: dict[str, Any] = {"exposure_s": exposure_s, "em_gain": em_gain}

    def ask(band: str, place: float, *, refine: bool = False) -> EtcAnswer:
        where: dict[str, Any] = {"separation_arcsec": place, "bands": [band]} | fixed
        if contrast_limit:
            return questions.contrast_limit(model, star, time_s=wall, exact=frames is not None, **where)[0]
        where |= {"planet": planet, "contrast": contrast}
        if snr is not None:
            return questions.exposure_time(model, star, snr=snr, refine=refine, **where)[0]
        return questions.signal_to_noise(model, star, time_s=wall, exact=frames is not None, **where)[0]

    if separation_arcsec is None:
        places = best_separations(model, ask, largest=snr is None and not contrast_limit)
    else:
        places = dict.fromkeys(model.bands, separation_arcsec)
    answers = [ask(band, place, refine=True) for band, place in places.items()]
    result = etc_result(
        model,
        star,
        answers,
        note=note,
        catalogue=table.provenance,
        planet=None if contrast is not None or contrast_limit else planet,
        asked={"snr": snr, "time_s": wall if snr is None else None, "limit": contrast_limit, "contrast": contrast}
        | {"places": places, "phase_deg": phase_deg}
        | fixed,
    )
    if as_json:
        print_json(result)
        return
    from cpic_planner.report.console import print_etc

    print_etc(result, console())


def _refuse_together(options: dict[str, object], why: str) -> None:
    given = [name for name, value in options.items() if value is not None]
    if len(given) > 1:
        from catalogs.errors import InputError

        raise InputError(given[0], f"given with {given[1]}", allowed="one of the two", hint=why)
