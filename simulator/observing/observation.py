"""The only composer: scene + instrument + settings -> frames, with expectation, truth and ledger.

Its light: what stays the same during a sequence, on the pixels of a window and in its columns beyond it, and images of
the star at the epochs of a visit of a programme.
"""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from cpic_core import (
    BoolArray,
    FloatArray,
    InputError,
    PathPart,
    Record,
    check_number,
    check_pair,
    check_whole,
    check_word,
    numeric_context,
    stream,
)
from simulator import imaging
from simulator.config import MAX_FRAMES, Drift, Instrument, Scene, Timing, checked_utc, load_instrument, load_scene
from simulator.effects import sky_rate_e_s_arcsec2, stray_light_parts
from simulator.knobs import Knobs, Quantity, checked_tolerance, resolve_knobs
from simulator.ledger import MAX_EPOCHS, Choice, checked_quantities, effect_ledger, observation_choice
from simulator.observing import sequence
from simulator.signal import INTERLEAVED, programme_law
from simulator.target import ExtendedRate, Source, extended_rates, scene_sources, wcs_keywords

MAX_VISIT = 999_999
_ANNULUS_LAMBDA_D = 1.5  # half width of the ring whose mean a table's estimate of drift refers to


class Visit(Record):
    """The visit of a programme that a sequence is; its random streams are named by it.

    Attributes
    ----------
    scene, kind, role, band : str
    realisation : int
    number : int
        Of the visit, from 0.
    timing : Timing
    """

    scene: str
    kind: str
    role: str
    band: str
    realisation: int
    number: int = 0
    timing: Timing = field(default_factory=Timing)

    @property
    def path(self) -> tuple[PathPart, ...]:
        """Names of the random streams of the visit."""
        first = (self.scene, self.kind, self.role, self.band, self.realisation)
        return (*first, "visit", self.number) if self.number else first

    def streams(
        self, drift: Drift, visit_s: float, seed: int
    ) -> tuple[np.random.Generator, np.random.Generator, imaging.SharedTerms]:
        """Return the streams of the offset and of the walk, and what the visit shares; arguments as of `shared`."""
        return stream(seed, *self.path, "visit"), stream(seed, *self.path, "walk"), self.shared(drift, visit_s, seed)

    def shared(self, drift: Drift, visit_s: float, seed: int) -> imaging.SharedTerms:
        """Return what the wavefront shares with the other visits of the programme.

        Parameters
        ----------
        drift : Drift
        visit_s : float
            Length of the visit, s.
        seed : int
        """
        gap_s = visit_s if self.timing.gap_s is None else self.timing.gap_s
        correlation = drift.correlation(gap_s)
        before = range(self.number - 1, -1, -1) if correlation > 0 else ()
        first = dataclasses.replace(self, number=0)
        science = self.role == "science" and drift.common_nm > 0
        return imaging.SharedTerms(
            correlation=correlation,
            earlier=tuple(stream(seed, *dataclasses.replace(self, number=k).path, "visit") for k in before),
            common=stream(seed, *first.path, "common") if science else None,
            # One telescope: science and references, of whatever star and band, swing alike.
            orbit=stream(seed, "orbit", self.realisation) if drift.orbital_nm > 0 else None,
            timing=self.timing,
            reference=self.role == "reference",
            visit=self.number,
        )


def visit_stamps(
    imager: imaging.Imager | imaging.FocalGrid,
    drift: Drift,
    epochs: int,
    visit_s: float,
    seed: int,
    visit: Visit,
    *,
    star_arcsec: tuple[float, float] = (0.0, 0.0),
) -> FloatArray:
    """Return the images of the unit star at every epoch of a visit.

    Parameters
    ----------
    imager : Imager or FocalGrid
    drift : Drift
    epochs : int
    visit_s : float
        Length of the visit.
    seed : int
    visit : Visit
        The offset and the walk of the visit have streams of their own.
    star_arcsec : tuple of float
        As of `simulator.imaging.visit_frames`.
    """
    offset, walk, shared = visit.streams(drift, visit_s, seed)
    return imaging.visit_frames(
        imager, drift, epochs, visit_s / epochs, offset, walk, star_arcsec=star_arcsec, shared=shared
    )


def table_stamps(psf: imaging.TablePsf, drift: Drift, visit_s: float, seed: int, visits: Sequence[Visit]) -> FloatArray:
    """Return the images of the unit star in visits behind a coronagraph of which a table is known.

    Parameters
    ----------
    psf : TablePsf
    drift, visit_s, seed
        As of `visit_stamps`; the drift counts where the table does not say how stable its contrast is.
    visits : sequence of Visit

    Returns
    -------
    ndarray, shape (visits, n, n)
        Of the mean wavefront of each.
    """
    place, images = psf.figures.floor_separation_arcsec, []
    for one in visits:
        first = dataclasses.replace(one, number=0)
        own, common = _variances(psf, drift, visit_s, one)
        wave = psf.field.astype(np.complex128)
        for name, variance, streams in (("visit", own, one), ("common", common, first)):
            if variance.any():
                wave += psf.moved(place, variance, stream(seed, *streams.path, name))
        images.append(np.abs(wave) ** 2)
    return np.array(images)


def brightest_stamp(psf: imaging.TablePsf, drift: Drift, visit_s: float, visit: Visit) -> FloatArray:
    """Return the brightest that the unit star is in any visit of a role; arguments as of `table_stamps`."""
    own, common = _variances(psf, drift, visit_s, visit)
    return psf.brightest(psf.figures.floor_separation_arcsec, own + common)


def _variances(psf: imaging.TablePsf, drift: Drift, visit_s: float, visit: Visit) -> tuple[FloatArray, FloatArray]:
    """Return the variance of sums over a core, by separation, of a visit's own and of what science visits share."""
    place = psf.figures.floor_separation_arcsec
    law = programme_law(psf.figures, drift, place, _ANNULUS_LAMBDA_D, timing=visit.timing)
    own, shared = (law.science, law.common) if visit.role == "science" else (law.reference, None)
    common = np.zeros(place.shape) if shared is None else np.broadcast_to(shared.variance(visit_s), place.shape)
    return np.broadcast_to(own.variance(visit_s), place.shape), common


def star_stamps(
    optics: imaging.AnyPsf,
    drift: Drift,
    epochs: int,
    visit_s: float,
    seed: int,
    visit: Visit,
    star_arcsec: tuple[float, float] = (0.0, 0.0),
) -> FloatArray:
    """Return the images of the unit star at the epochs of a visit, or the one of optics known by images alone.

    Parameters
    ----------
    optics : Psf or ExternalPsf
    drift, epochs, visit_s, seed, visit, star_arcsec
        As of `visit_stamps`.
    """
    if not isinstance(optics, imaging.ExternalPsf):
        return visit_stamps(optics.imager, drift, epochs, visit_s, seed, visit, star_arcsec=star_arcsec)
    if any(star_arcsec):
        return optics.at(*star_arcsec)[None]
    if isinstance(optics, imaging.TablePsf):
        return table_stamps(optics, drift, visit_s, seed, [visit])
    return optics.on_axis[None]


def visit_waves(
    light: imaging.VisitLight, drift: Drift, epochs: int, visit_s: float, seed: int, visits: Iterable[Visit]
) -> FloatArray:
    """Return the wavefronts of visits in the numbers of an expansion of their light, nm, shape (visits, epochs, r + 1).

    Parameters
    ----------
    light : VisitLight
    drift, epochs, visit_s, seed
        As of `visit_stamps`.
    visits : iterable of Visit
    """
    each_s = visit_s / epochs
    every = [
        list(imaging.wavefronts(light, drift, epochs, each_s, *one.streams(drift, visit_s, seed))) for one in visits
    ]
    return np.array(every)


def static_light(
    psf: imaging.AnyPsf,
    instrument: Instrument,
    band: str,
    area: imaging.Window,
    sources: Sequence[Source],
    extended: Sequence[ExtendedRate],
    *,
    full: bool,
    sky_e_s_arcsec2: float,
    roll_deg: float,
    star_arcsec: tuple[float, float],
    model: imaging.SceneModel,
) -> tuple[FloatArray, FloatArray | None, dict[str, FloatArray]]:
    """Return everything on a window but the stamp of the star, and what smears into a window from beyond it.

    Parameters
    ----------
    psf : Psf or ExternalPsf
    instrument : Instrument
        With its switches.
    band : str
    area : Window
    sources : sequence of Source
        The central star first.
    extended : sequence of ExtendedRate
    full : bool
        Whether the window is the whole frame.
    sky_e_s_arcsec2 : float
        Sky in front of the telescope.
    roll_deg, star_arcsec, model
        As `simulator.imaging.frame.off_axis_light`.

    Returns
    -------
    static_e_s : ndarray
        Electrons per second on the pixels of the window: everything but the stamp of the star; on a whole frame with
        its far wings.
    beyond_e_s : ndarray, shape (columns,), or None
        In all active rows beyond the window, summed over each of its columns: what a transfer without a shutter smears
        into it. None for whole frames and where nothing smears. Far wings of planets are left out: they are below
        those of the star by their contrast.
    stray_e_s : dict of str to ndarray
        Of ``static_e_s``, the parts that are given on the detector, by origin.
    """
    detector = instrument.detector_of(band)
    seen, inside, beyond = area, slice(None), None  # the window alone, unless light beyond it smears into it
    if not full and detector.line_shift_s > 0:
        seen, inside, beyond = _columns_of(instrument, band, area)
    corner = (detector.star_row - seen.centre[0], detector.star_column - seen.centre[1])
    stray = stray_light_parts(instrument, band, detector.shape, first_pixel=corner, window=seen.shape)
    sky = sky_e_s_arcsec2 * psf.pixel_scale_arcsec**2 * psf.apodizer_energy
    whole = np.asarray(sky * imaging.sky_transmission(psf, seen) + sum(stray.values()))
    bright = bool(extended) or any(source.kind == "star" for source in sources[1:])
    others = imaging.off_axis_light(
        psf, seen if bright else area, sources[1:], extended, roll_deg=roll_deg, star_arcsec=star_arcsec, model=model
    )
    if bright or full:
        whole += others
    else:
        whole[inside] += others
    if full:
        whole += sources[0].rate_e_s * imaging.full_star_map(psf, area, star_arcsec)
    columns = None
    if beyond is not None:
        columns = whole[beyond].sum(axis=0)
        columns += sources[0].rate_e_s * imaging.star_column_light(psf, seen, beyond, star_arcsec)
    return whole[inside].copy(), columns, {name: part[inside] for name, part in stray.items()}


def _columns_of(instrument: Instrument, band: str, area: imaging.Window) -> tuple[imaging.Window, slice, BoolArray]:
    """Return the columns of a window over all active rows, where it lies in them, and the active rows beyond it."""
    detector = instrument.detector_of(band)
    active = detector.sections["active"][0]
    low = detector.star_row - area.centre[0]
    first, stop = min(low, active.start), max(low + area.rows.size, active.stop)
    pixel = instrument.pixel_scale_arcsec(band)
    centre = detector.star_row - first
    tall = imaging.Window(imaging.centred_axis(stop - first, pixel, centre), area.columns, (centre, area.centre[1]))
    inside = slice(low - first, low - first + area.rows.size)
    row = np.arange(first, stop)
    beyond = (row >= active.start) & (row < active.stop)
    beyond[inside] = False
    return tall, inside, beyond


WindowName = Literal["full", "hole"]
Role = Literal["science", "reference", "calibration"]
SkyKind = Literal["SCI", "DSF", "CALS"]
MAX_OFFSET_ARCSEC = 8.0


class Observation(sequence.FrameSequence, eq=False):
    """Frames of a scene, made one at a time; made by `observe`.

    Attributes
    ----------
    window : {"full", "hole"}
        Whole detector, or the square stamp around the star that holds the dark hole.
    visit : Visit
        Which visit of a programme it is, and when its visits are.
    expected : ndarray
        Mean ADU of a frame, averaged over the drift of the visit.
    truth : Truth
    ledger : tuple of EffectRow
    tolerance : float
        Error that was traded for speed.
    choice : Choice or None
        What was left out for it, and the predicted error; None without a tolerance.
    header : dict
    """

    scene: Scene = field(kw_only=True)
    role: Role = field(kw_only=True)
    visit: Visit = field(kw_only=True)
    window: WindowName = field(kw_only=True)
    star_offset_arcsec: tuple[float, float] = field(kw_only=True)
    scene_model: imaging.SceneModel = field(kw_only=True)
    psf: imaging.AnyPsf = field(kw_only=True)
    area: imaging.Window = field(kw_only=True)
    truth: sequence.Truth = field(kw_only=True)
    tolerance: float = field(default=0.0, kw_only=True)
    choice: Choice | None = field(default=None, kw_only=True)

    @property
    def estimated_error(self) -> imaging.PsfError | None:
        """Numerical error of the point-spread functions; None for those of a file. Takes half a second once."""
        return None if isinstance(self.psf, imaging.ExternalPsf) else self.psf.estimated_error

    def at_visit(self, number: int) -> "Observation":
        """Return the same observation in another visit of its programme, with a wavefront and noise of its own.

        Parameters
        ----------
        number : int
            Of the visit, from 0.
        """
        one = dataclasses.replace(self.visit, number=check_whole("visit", number, 0, MAX_VISIT))
        light, star = self.light, self.light.star
        if star is not None:
            stamps = star_stamps(
                self.psf,
                self.instrument.drift,
                len(star.rate_e_s),
                (self.exposure_s + self.readout_s) * self.n_frames,
                self.seed,
                one,
                self.star_offset_arcsec,
            )
            rate_e_s = self.truth.sources[0].rate_e_s * stamps
            light = dataclasses.replace(light, star=dataclasses.replace(star, rate_e_s=rate_e_s))
        return dataclasses.replace(self, visit=one, path=one.path, light=light)

    @property
    def calibration_files(self) -> list[str]:
        """Names of the files that optics, sky, particles and camera were read from."""
        own = [self.psf.file] if isinstance(self.psf, imaging.ExternalPsf) and self.psf.file else []
        return [*super().calibration_files, *own]


@numeric_context()
def observe(
    scene: Scene | Mapping[str, Any] | str | Path,
    *,
    band: str,
    exposure_s: float,
    n_frames: int = 1,
    em_gain: float = 1.0,
    seed: int = 1,
    fidelity: str | Knobs = "standard",
    tolerance: float = 0.0,
    quantity: Quantity | Sequence[Quantity] | None = None,
    roll_deg: float = 0.0,
    instrument: Instrument | Mapping[str, Any] | str | None = None,
    role: Role = "science",
    realisation: int = 0,
    visit: int = 0,
    visits: int = 1,
    timing: Timing = INTERLEAVED,
    window: WindowName = "full",
    star_offset_arcsec: tuple[float, float] = (0.0, 0.0),
    scene_model: imaging.SceneModel = "exact",
    psf: imaging.ExternalPsf | None = None,
    kind: SkyKind = "SCI",
    start_utc: str | None = None,
    switches: Mapping[str, bool] | None = None,
    max_epochs: int = MAX_EPOCHS,
) -> Observation:
    """Set up a simulated sequence; frames are drawn when they are asked for.

    Parameters
    ----------
    scene : Scene, mapping, str or Path
        The scene, or what `simulator.load_scene` reads: ``"paper_example"``, ``"my_scene.yaml"``.
    band : str
        Band of either camera.
    exposure_s : float
        Exposure of a frame, 1e-6 to 1e6 s.
    n_frames : int
        Frames of the sequence, 1 to 1e6.
    em_gain : float
        Actual EM gain, 1 to the detector's maximum; 1 in the near infrared.
    seed : int
        Seed of every random number.
    fidelity : str or Knobs
        Accuracy of the optics.
    tolerance : float
        Error against the same observation with 0 that may be traded for speed, 0 to 0.5. At 0 everything that exists is
        modelled; above, the effect ledger leaves out what is predicted to change less, and lowers the settings of the
        optics from those of ``fidelity``; see the notes.
    quantity : str or sequence of str, optional
        What the tolerance holds for: ``planet_flux``, ``snr``, ``pixel_map``; all three where the scene has planets and
        the pixel map where not, by default.
    roll_deg : float
        Turns sky and sources on the detector, never mask, hole or speckles.
    instrument : Instrument, mapping or str, optional
        What `simulator.load_instrument` reads; the default instrument otherwise.
    role : {"science", "reference", "calibration"}
        Names the visit: each has its own wavefront offset and its own noise.
    realisation : int
        Number of the noise realisation, 0 to 2**31 - 1; see the notes.
    visit : int
        Number of the visit in a programme, from 0: each has its own wavefront offset, walk and noise.
    visits : int
        Visits of the programme, whose SNR a tolerance holds for.
    timing : Timing
        When the visits of the programme are; visits that follow at once, references interleaved by default.
    window : {"full", "hole"}
        Whole detector, or the stamp around the centre of the mask.
    star_offset_arcsec : tuple of float
        Place of the central star relative to the centre of the mask on the detector, x and y: off the mask for
        calibration, at most 8 arcsec either way. The whole sky moves with it.
    scene_model : {"exact", "paper"}
        ``exact``: every source at its place behind the mask. ``paper``: the shortcut of Zhu et al. 2025, in which
        sources other than the star go to the nearest of 4 x 4 cells of a pixel and no mask hides them.
    psf : ExternalPsf, optional
        Point-spread functions from a file (`simulator.load_psf`) instead of the model's; they do not drift. Those that
        the instrument names beside a table by default.
    kind : {"SCI", "DSF", "CALS"}
        Science, dense star field, or calibration star.
    start_utc : str, optional
        Beginning of the first frame, as ``2028-01-01T00:00:00``; that of the instrument's mission otherwise. Zodiacal
        light and the rate of cosmic rays depend on it.
    switches : mapping of str to bool, optional
        Effects of the camera to switch on or off, by name; the instrument's otherwise.
    max_epochs : int
        Most epochs of a visit at which the drift of the wavefront is sampled, 1 to 1000; frames between two epochs
        share one.

    Returns
    -------
    Observation

    Raises
    ------
    InputError
        For anything out of range.

    Notes
    -----
    Random numbers depend on ``seed``, the name of the scene, ``kind``, ``role``, ``band``, ``realisation``, ``visit``,
    the number of the frame and the effect, and on nothing else. The science visits of a realisation have one screen in
    common that its references have not, and one map swings with the orbit in all of them. Sequences that differ only in
    exposure, gain, roll, switches or the like therefore draw common random numbers: their difference shows the setting
    and not the noise. Give each its own ``realisation`` (or ``seed``) where their noise has to be independent.

    A tolerance leaves frames frames and the window as it is. What is left out stands in ``ledger`` with its predicted
    size (`simulator.ledger`), and in ``choice``; the truth names every source of the scene.
    """
    scene = load_scene(scene)
    instrument = instrument if isinstance(instrument, Instrument) else load_instrument(instrument)
    channel = instrument.channel_of(band)
    exposure = sequence.checked_exposure(exposure_s)
    channel.check_gain(em_gain)
    checked_tolerance(tolerance)
    check_number("roll_deg", roll_deg, "deg")
    for name, value, allowed in (
        ("role", role, Role),
        ("window", window, WindowName),
        ("scene_model", scene_model, imaging.SceneModel),
        ("kind", kind, SkyKind),
    ):
        check_word(name, value, get_args(allowed))
    if not isinstance(timing, Timing):
        raise InputError("timing", timing, allowed="a Timing")
    frames = check_whole("n_frames", n_frames, 1, MAX_FRAMES)
    number = check_whole("realisation", realisation, 0, sequence.MAX_REALISATION)
    star = check_pair("star_offset_arcsec", star_offset_arcsec, MAX_OFFSET_ARCSEC, "arcsec")
    start = checked_utc("start_utc", instrument.mission.start_utc if start_utc is None else start_utc)
    psf = imaging.psf_of_table(instrument, band) if psf is None else psf
    if psf is not None:
        _check_psf(psf, band, instrument, tolerance)
    if quantity is not None:
        checked_quantities(quantity, planets=bool(scene.planets))
    epochs = check_whole("max_epochs", max_epochs, 1, 1000)
    turn, turns = check_whole("visit", visit, 0, MAX_VISIT), check_whole("visits", visits, 1, MAX_VISIT + 1)
    knobs = resolve_knobs(fidelity)
    full = window == "full"
    choice = None
    if tolerance > 0:
        choice = observation_choice(
            scene,
            instrument,
            tolerance=tolerance,
            quantity=quantity,
            finest=knobs,
            full=full,
            band=band,
            exposure_s=exposure,
            n_frames=frames,
            em_gain=float(em_gain),
            roll_deg=roll_deg,
            star_offset_arcsec=star,
            scene_model=scene_model,
            start_utc=start,
            switches=switches,
            max_epochs=epochs,
            visits=turns,
            timing=timing,
        )
        instrument = choice.drifting(instrument)
        switches = {**({} if switches is None else switches), **choice.switches}
        epochs = min(epochs, choice.epochs)
        knobs = choice.knobs
    left_out = () if choice is None else choice.left_out
    switched = instrument.switched(switches, camera=channel.name)
    optics = imaging.single_band_psf(band, fidelity=knobs, instrument=instrument) if psf is None else psf
    sources = scene_sources(scene, instrument, band, roll_deg=roll_deg)
    area = imaging.window_of(optics, instrument, full=full)
    one = Visit(scene.name, kind, role, band, number, turn, timing)
    detector = channel.detector
    corner = (detector.star_row - area.centre[0], detector.star_column - area.centre[1])
    epochs, visit_s = min(frames, epochs), (exposure + detector.readout_s) * frames
    stamps = star_stamps(optics, instrument.drift, epochs, visit_s, seed, one, star)
    cstar = scene.cstar
    sky = sky_rate_e_s_arcsec2(instrument, band, ra_deg=cstar.ra_deg, dec_deg=cstar.dec_deg, start_utc=start)
    shown = [sources[0], *(source for source in sources[1:] if source.name not in left_out)]
    extended = [item for item in extended_rates(scene, instrument, band) if item.source.name not in left_out]
    static_e_s, beyond_e_s, stray_e_s = static_light(
        optics,
        switched,
        band,
        area,
        shown,
        extended,
        full=full,
        sky_e_s_arcsec2=0.0 if choice is not None and not choice.sky else sky.rate_e_s_arcsec2,
        roll_deg=roll_deg,
        star_arcsec=star,
        model=scene_model,
    )
    pixel = optics.pixel_scale_arcsec
    x_pixel = tuple(area.centre[1] + (source.x_arcsec + star[0]) / pixel for source in sources)
    y_pixel = tuple(area.centre[0] + (source.y_arcsec + star[1]) / pixel for source in sources)
    rows, columns, part = area.stamp(stamps.shape[1])
    light = sequence.Light(static_e_s, sequence.Stamps(sources[0].rate_e_s * stamps, rows, columns, part), beyond_e_s)
    if choice is None:
        ledger = effect_ledger(
            scene,
            switched,
            band=band,
            scene_model=scene_model,
            hole_state=optics.hole_state,
            sky=sky,
            stray=stray_e_s,
            start_utc=start,
        )
    else:
        ledger = choice.rows
    keywords: dict[str, Any] = {
        "OBJECT": scene.name,
        "ROLE": role,
        "ROLL": roll_deg,
        "STAROFFX": star[0],
        "STAROFFY": star[1],
        **_optics_keywords(instrument, band, optics),
        "SCENEMOD": scene_model,
        "TOLERANC": float(tolerance),
        **wcs_keywords(
            pixel,
            (x_pixel[0], y_pixel[0]),
            (cstar.ra_deg, cstar.dec_deg),
            roll_deg=roll_deg,
            parity=instrument.detector.parity,
        ),
    }
    return Observation(
        kind=kind,
        name=scene.name,
        instrument=switched,
        camera=channel.name,
        band=band,
        exposure_s=exposure,
        n_frames=frames,
        em_gain=float(em_gain),
        seed=seed,
        path=one.path,
        start_utc=start,
        light=light,
        first_pixel=None if full else corner,
        keywords=keywords,
        scene=scene,
        role=role,
        visit=one,
        realisation=number,
        window=window,
        roll_deg=roll_deg,
        star_offset_arcsec=star,
        scene_model=scene_model,
        psf=optics,
        area=area,
        truth=sequence.Truth(sources, x_pixel, y_pixel),
        ledger=ledger,
        tolerance=float(tolerance),
        choice=choice,
    )


def _optics_keywords(instrument: Instrument, band: str, optics: imaging.AnyPsf) -> dict[str, Any]:
    """Return the keywords of the optics."""
    values: dict[str, Any] = {
        "HOLEMODE": instrument.dark_hole.mode,
        "HOLE": optics.hole_state,
        "HOLEIN": imaging.zone_of(instrument, band).inner_corner_arcsec,
    }
    if not isinstance(optics, imaging.ExternalPsf):
        # That of the standard settings: the core table of others takes longer than their images.
        values["IWA"] = imaging.psf_metrics(instrument, band).iwa_arcsec
        values["FIDELITY"] = optics.knobs.tier
        return values
    values["IWA"] = optics.metrics.iwa_arcsec
    values["FIDELITY"] = "external"
    values["PSFHASH"] = optics.content_hash
    if optics.file:
        values["PSFFILE"] = optics.file
    return values


def _check_psf(psf: imaging.ExternalPsf, band: str, instrument: Instrument, tolerance: float) -> None:
    if not isinstance(psf, imaging.ExternalPsf):
        raise InputError("psf", psf, allowed="what load_psf returns")
    if psf.band not in ("", band):
        raise InputError("psf", psf.band, allowed=f"a PSF of {band}")
    if psf.instrument.content_hash != instrument.content_hash:
        raise InputError("psf", psf.instrument.name, allowed=f"a PSF of {instrument.name}: load_psf(..., instrument=)")
    if tolerance > 0:
        raise InputError("tolerance", tolerance, allowed="0 with a PSF from a file", hint="sizes are of the own optics")
