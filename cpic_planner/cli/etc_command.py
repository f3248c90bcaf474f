"""``cpic etc``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cpic_planner.cli.etc_dial import (
    EtcCheck,
    EtcFidelityOption,
    EtcRealisationsOption,
    EtcSeedOption,
    EtcToleranceOption,
)
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
from cpic_planner.cli.strategy_options import (
    CountingOption,
    CountingSigmaOption,
    ExozodiOption,
    LibraryOption,
    ReferenceRatioOption,
    ReferenceTeffOption,
    ReferenceVMagOption,
    RollOption,
    model_from,
    refuse_together,
    strategy_from,
)
from cpic_planner.registry.libraries import DEFAULT_LIBRARY

if TYPE_CHECKING:
    from catalogs.catalogue import Catalogue
    from cpic_planner.targets import Targets

__all__ = ["HELP", "etc"]

HELP = """Ask the exposure-time calculator about one star: time for a level, SNR for a time, or the contrast limit.

--snr, --sigma or --detect ask for the least wall time that reaches it; with --contrast-limit they are the level of the
limit (--detect if none is given). Without any of these the answer is the SNR in --time-s. Without a separation the
planet stands where the answer is best in each band: least time, clearest detection, or faintest limit. A given time is
an upper bound: the walk of the wavefront can make a shorter visit better.

Status ok says that there is a number, not that the planet is detected: the verdict says that. Detected: at least half
of such visits show the planet at its known place (verdict_mode known_place); the probability that a search finds it
which does not know the place stands beside it. An answer that is not a detection says what limits it (limited_by), the
single change that would make it one in the same time: speckles (no drift of the wavefront), background (no light and
noise but the planet's own and the speckles), else photons: the planet is too faint.

The answers are closed forms, in milliseconds (--fidelity quick). --fidelity standard observes each of them in images,
drawn as sums of frames until their SNR is known to 5 %, and states flux and SNR of images over closed form; reference
draws every frame with every effect of the camera, in minutes. --tolerance 0.05 makes images only where the stated error
of the closed forms is larger than that, and says so where none of the two is that good. Answers stay those of the
closed forms: what images say stands beside them.

Examples:

  cpic etc "tau Cet" --detect --separation-arcsec 0.45

  cpic etc "tau Cet"

  cpic etc "tau Cet" --snr 8

  cpic etc "tau Cet" --detect --budget

  cpic etc "alpha Cen B" --time-s 7200 --separation-arcsec 0.65 --band F520 --band F662 --explain

  cpic etc "HD 10700" --semi-major-axis-au 1.5 --contrast-limit

  cpic etc "eps Eri" --contrast-limit --sigma 5 --separation-arcsec 0.4 --separation-arcsec 0.6 --plot limit.png

  cpic etc "alpha Cen B" --distance-pc 1.35 --separation-arcsec 0.65 --log10-mh 1 --log10-fsed 1 --insolation-au 2

  cpic etc "eps Eri" --contrast 5e-9 --separation-arcsec 0.6 --snr 5 --json

  cpic etc "eps Eri" --library reference_star --reference-v-mag 2.5 --exozodi 3 --photon-counting

  cpic etc "my star" --catalog my_stars.csv --snr 10

  cpic etc "tau Cet" --band F520 --time-s 7200 --fidelity standard

  cpic etc "eps Eri" --band F662 --detect --tolerance 0.05"""


def etc(
    target: Annotated[
        str, typer.Argument(help='Star: "HIP 8102", "tau Cet", "alpha Cen B", "HD 10700", "61 Cyg A" ...')
    ],
    snr: Annotated[float | None, typer.Option("--snr", help="Level: photometric SNR.")] = None,
    sigma: Annotated[
        float | None, typer.Option("--sigma", help="Level: plain significance, of noise without the planet.")
    ] = None,
    detect: Annotated[
        bool, typer.Option("--detect", help="Level: a detection, by the small-sample threshold at that separation.")
    ] = False,
    time_s: Annotated[
        float | None,
        typer.Option(
            "--time-s",
            help=f"Wall time in s, readouts and reference frames included [default: {DEFAULT_TIME_S:g}].",
        ),
    ] = None,
    contrast_limit: Annotated[
        bool, typer.Option("--contrast-limit", help="Ask for the faintest contrast that reaches the level in --time-s.")
    ] = False,
    bands: BandOption = None,
    separations: Annotated[
        list[float] | None,
        typer.Option(
            "--separation-arcsec", help="Projected separation, on the diagonal of a quadrant; repeat for several."
        ),
    ] = None,
    semi_major_axis_au: Annotated[
        float | None,
        typer.Option(
            "--semi-major-axis-au",
            help="Radius of a circular orbit; gives separation and distance at --phase-deg.",
        ),
    ] = None,
    contrasts: Annotated[
        list[float] | None,
        typer.Option(
            "--contrast",
            help="Planet-to-star ratio instead of a planet model; repeat for several (as many as separations, or one "
            "of them).",
        ),
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
    library: LibraryOption = DEFAULT_LIBRARY,
    reference_v_mag: ReferenceVMagOption = None,
    reference_teff_k: ReferenceTeffOption = None,
    reference_ratio: ReferenceRatioOption = None,
    roll_deg: RollOption = None,
    photon_counting: CountingOption = False,
    counting_sigma: CountingSigmaOption = None,
    exozodi: ExozodiOption = None,
    distance_pc: Annotated[
        float | None, typer.Option("--distance-pc", help="Distance, instead of the catalogue's.")
    ] = None,
    companions: CompanionsOption = OnOff.ON,
    catalog: CatalogOption = "snapshot",
    instrument: InstrumentOption = None,
    budget: Annotated[
        bool, typer.Option("--budget", help="Print the noise budget of every answer [default: of the best].")
    ] = False,
    explain: Annotated[bool, typer.Option("--explain", help="Say which EM gains spare what of the frame.")] = False,
    plot: Annotated[
        Path | None, typer.Option("--plot", help="Draw the answer into FILE.png, .pdf or .svg as well.")
    ] = None,
    fidelity: EtcFidelityOption = None,
    tolerance: EtcToleranceOption = None,
    realisations: EtcRealisationsOption = None,
    seed: EtcSeedOption = None,
    as_json: JsonOption = False,
) -> None:
    """Answer and print."""
    from catalogs.catalogue import open_catalogue
    from catalogs.errors import InputError
    from cpic_planner.cli.etc_question import EtcQuestion
    from cpic_planner.etc.place import check_range
    from cpic_planner.etc.result import etc_result

    check = EtcCheck.of(fidelity, tolerance, realisations, seed)
    level: dict[str, object] = {"--snr": snr, "--sigma": sigma, "--detect": detect or None}
    refuse_together(level, "one level at a time")
    if not contrast_limit:
        for name, value in level.items():
            refuse_together({name: value, "--time-s": time_s}, "one asks for a time, the other gives it")
            refuse_together({name: value, "--frames": frames}, f"--frames sets the time that {name} asks for")
    refuse_together({"--time-s": time_s, "--frames": frames}, "both set the time")
    refuse_together(
        {"--separation-arcsec": separations, "--semi-major-axis-au": semi_major_axis_au}, "both place the planet"
    )
    refuse_together({"--contrast-limit": contrast_limit, "--contrast": contrasts}, "the limit is the answer")
    refuse_together({"--budget": budget, "--json": as_json}, "JSON holds every budget")
    refuse_together({"--explain": explain, "--json": as_json}, "JSON holds all gains")
    planet_options: dict[str, object] = {
        "--planet-radius-rjup": radius_rjup,
        "--albedo": albedo,
        "--log10-mh": log10_mh,
        "--log10-fsed": log10_fsed,
        "--insolation-au": insolation_au,
        "--phase-function": phase_function,
    }
    if semi_major_axis_au is None:
        planet_options["--phase-deg"] = phase_deg
    for name, value in planet_options.items():
        refuse_together({name: value, "--contrast": contrasts}, "a given contrast needs no planet")
        refuse_together({name: value, "--contrast-limit": contrast_limit}, "the limit holds for any planet")
    if frames is not None and exposure_s is None:
        raise InputError("--frames", frames, allowed="together with --exposure-s")
    if separations and contrasts and len(separations) != len(contrasts) and min(len(separations), len(contrasts)) > 1:
        raise InputError(
            "--contrast", f"{len(contrasts)} times", allowed=f"once, or {len(separations)} times as --separation-arcsec"
        )
    if plot is not None:
        from cpic_planner.report.etc_figures import check_figure_name

        check_figure_name(plot)
    strategy = strategy_from(
        library,
        reference_v_mag=reference_v_mag,
        reference_teff_k=reference_teff_k,
        reference_ratio=reference_ratio,
        roll_deg=roll_deg,
        photon_counting=photon_counting,
        counting_sigma=counting_sigma,
    )
    table = open_catalogue(catalog)
    for remark in table.notes:
        tell(remark)
    star, note = _star(target, companions, table, distance_pc)
    model = model_from(instrument, bands, strategy, exozodi_zodis=exozodi)
    phase = 90.0 if phase_deg is None else phase_deg
    reflects = albedo_from(albedo, log10_mh, log10_fsed, insolation_au, phase_function)
    planet = planet_from(1.0 if radius_rjup is None else radius_rjup, phase, reflects)
    if semi_major_axis_au is not None:
        check_range("--semi-major-axis-au", semi_major_axis_au, 1e-3, 1e5, "au")
        separations = [semi_major_axis_au * math.sin(math.radians(phase)) / float(star.distance_pc[0])]
    wall = DEFAULT_TIME_S if time_s is None else time_s
    question = EtcQuestion(
        wall,
        planet,
        snr,
        sigma,
        detect,
        contrast_limit,
        tuple(contrasts) if contrasts else None,
        exposure_s,
        em_gain,
        frames,
    )
    answers = question.ask(model, star, separations) if separations else question.ask_at_best(model, star)
    known = None if contrasts or contrast_limit else planet
    answers = check.checked(model, star, answers, known)
    result = etc_result(
        model,
        star,
        answers,
        note=note,
        catalogue=table.provenance,
        planet=known,
        asked={"snr": snr, "sigma": sigma, "detect": detect, "time_s": None if question.asks_time else wall}
        | {"limit": contrast_limit, "contrast": contrasts, "places": [one.separation_arcsec for one in answers]}
        | {"phase_deg": phase, "exposure_s": exposure_s, "em_gain": em_gain, "n_frames": frames}
        | check.asked,
        dial=check.dial,
        seed=check.seed,
    )
    if plot is not None:
        from cpic_planner.report.console_etc import best_row
        from cpic_planner.report.etc_curves import etc_curves
        from cpic_planner.report.etc_figures import etc_figure, write_figure

        best, allowed = best_row(result), wall
        if best is not None and best.time_s is not None and (question.asks_time or frames is not None):
            allowed = best.time_s
        curves = etc_curves(
            model,
            star,
            answers,
            time_s=allowed,
            best_band=result.best_band,
            snr=snr,
            sigma=sigma,
            exposure_s=exposure_s,
            em_gain=em_gain,
        )
        write_figure(etc_figure(result, curves), plot)
        tell(f"wrote {plot}")
    if as_json:
        print_json(result)
        return
    from cpic_planner.report.console_etc import print_etc
    from cpic_planner.report.console_etc_fidelity import print_fidelity

    print_etc(result, console(), asked=question.words, placed=bool(separations), every_budget=budget, explain=explain)
    print_fidelity(result, console())


def _star(target: str, companions: OnOff, table: Catalogue, distance_pc: float | None) -> tuple[Targets, str]:
    """The star, perhaps at another distance, and remarks about it."""
    from dataclasses import replace

    import numpy as np

    from cpic_planner.etc.place import check_range
    from cpic_planner.targets import find_target

    star, note = find_target(target, companions=companions.value, catalog=table)
    if table.kind != "snapshot":
        note = "; ".join(filter(None, (note, f"star data: {table.provenance}")))
    if distance_pc is None:
        return star, note
    there = check_range("--distance-pc", distance_pc, 0.01, 1e5, "pc")
    # The same star in the sky from elsewhere: its luminosity follows the square of the distance.
    brighter = (there / star.distance_pc) ** 2
    return replace(star, distance_pc=np.array([there]), luminosity_lsun=star.luminosity_lsun * brighter), note
