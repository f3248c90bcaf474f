"""Light of a scene that stays the same during a sequence: on the pixels of a window, and in its columns beyond it.

Images of the star at the epochs of a visit, and which visit of a programme that is.
"""

import dataclasses
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from cpic_core import BoolArray, FloatArray, PathPart, stream
from simulator.config import Drift, Instrument, Timing
from simulator.effects import stray_light_parts
from simulator.imaging import (
    AnyPsf,
    ExternalPsf,
    FocalGrid,
    Imager,
    SceneModel,
    SharedTerms,
    TablePsf,
    VisitLight,
    Window,
    centred_axis,
    full_star_map,
    off_axis_light,
    sky_transmission,
    star_column_light,
    visit_frames,
    wavefronts,
)
from simulator.signal import programme_law
from simulator.target import ExtendedRate, Source

MAX_VISIT = 999_999
_ANNULUS_LAMBDA_D = 1.5  # half width of the ring whose mean a table's estimate of drift refers to


@dataclass(frozen=True)
class Visit:
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
    ) -> tuple[np.random.Generator, np.random.Generator, SharedTerms]:
        """Return the streams of the offset and of the walk, and what the visit shares; arguments as of `shared`."""
        return stream(seed, *self.path, "visit"), stream(seed, *self.path, "walk"), self.shared(drift, visit_s, seed)

    def shared(self, drift: Drift, visit_s: float, seed: int) -> SharedTerms:
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
        return SharedTerms(
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
    imager: Imager | FocalGrid,
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
    return visit_frames(imager, drift, epochs, visit_s / epochs, offset, walk, star_arcsec=star_arcsec, shared=shared)


def table_stamps(psf: TablePsf, drift: Drift, visit_s: float, seed: int, visits: Sequence[Visit]) -> FloatArray:
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


def brightest_stamp(psf: TablePsf, drift: Drift, visit_s: float, visit: Visit) -> FloatArray:
    """Return the brightest that the unit star is in any visit of a role; arguments as of `table_stamps`."""
    own, common = _variances(psf, drift, visit_s, visit)
    return psf.brightest(psf.figures.floor_separation_arcsec, own + common)


def _variances(psf: TablePsf, drift: Drift, visit_s: float, visit: Visit) -> tuple[FloatArray, FloatArray]:
    """Return the variance of sums over a core, by separation, of a visit's own and of what science visits share."""
    place = psf.figures.floor_separation_arcsec
    law = programme_law(psf.figures, drift, place, _ANNULUS_LAMBDA_D, timing=visit.timing)
    own, shared = (law.science, law.common) if visit.role == "science" else (law.reference, None)
    common = np.zeros(place.shape) if shared is None else np.broadcast_to(shared.variance(visit_s), place.shape)
    return np.broadcast_to(own.variance(visit_s), place.shape), common


def star_stamps(
    optics: AnyPsf,
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
    if not isinstance(optics, ExternalPsf):
        return visit_stamps(optics.imager, drift, epochs, visit_s, seed, visit, star_arcsec=star_arcsec)
    if any(star_arcsec):
        return optics.at(*star_arcsec)[None]
    if isinstance(optics, TablePsf):
        return table_stamps(optics, drift, visit_s, seed, [visit])
    return optics.on_axis[None]


def visit_waves(
    light: VisitLight, drift: Drift, epochs: int, visit_s: float, seed: int, visits: Iterable[Visit]
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
    every = [list(wavefronts(light, drift, epochs, each_s, *one.streams(drift, visit_s, seed))) for one in visits]
    return np.array(every)


@dataclass(frozen=True, eq=False)
class StaticLight:
    """Light that does not change, electrons per second; made by `static_light`.

    Attributes
    ----------
    static_e_s : ndarray
        On the pixels of the window: everything but the stamp of the star; on a whole frame with its far wings.
    beyond_e_s : ndarray, shape (columns,), or None
        In all active rows beyond the window, summed over each of its columns: what a transfer without a shutter smears
        into it. None for whole frames and where nothing smears. Far wings of planets are left out: they are below
        those of the star by their contrast.
    stray_e_s : dict of str to ndarray
        Of ``static_e_s``, the parts that are given on the detector, by origin.
    """

    static_e_s: FloatArray
    beyond_e_s: FloatArray | None
    stray_e_s: dict[str, FloatArray]


def static_light(
    psf: AnyPsf,
    instrument: Instrument,
    band: str,
    area: Window,
    sources: Sequence[Source],
    extended: Sequence[ExtendedRate],
    *,
    full: bool,
    sky_e_s_arcsec2: float,
    roll_deg: float,
    star_arcsec: tuple[float, float],
    model: SceneModel,
) -> StaticLight:
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
    """
    detector = instrument.detector_of(band)
    seen, inside, beyond = area, slice(None), None  # the window alone, unless light beyond it smears into it
    if not full and detector.line_shift_s > 0:
        seen, inside, beyond = _columns_of(instrument, band, area)
    corner = (detector.star_row - seen.centre[0], detector.star_column - seen.centre[1])
    stray = stray_light_parts(instrument, band, detector.shape, first_pixel=corner, window=seen.shape)
    sky = sky_e_s_arcsec2 * psf.pixel_scale_arcsec**2 * psf.apodizer_energy
    whole = np.asarray(sky * sky_transmission(psf, seen) + sum(stray.values()))
    bright = bool(extended) or any(source.kind == "star" for source in sources[1:])
    others = off_axis_light(
        psf, seen if bright else area, sources[1:], extended, roll_deg=roll_deg, star_arcsec=star_arcsec, model=model
    )
    if bright or full:
        whole += others
    else:
        whole[inside] += others
    if full:
        whole += sources[0].rate_e_s * full_star_map(psf, area, star_arcsec)
    columns = None
    if beyond is not None:
        columns = whole[beyond].sum(axis=0)
        columns += sources[0].rate_e_s * star_column_light(psf, seen, beyond, star_arcsec)
    return StaticLight(whole[inside].copy(), columns, {name: part[inside] for name, part in stray.items()})


def _columns_of(instrument: Instrument, band: str, area: Window) -> tuple[Window, slice, BoolArray]:
    """Return the columns of a window over all active rows, where it lies in them, and the active rows beyond it."""
    detector = instrument.detector_of(band)
    active = detector.sections["active"][0]
    low = detector.star_row - area.centre[0]
    first, stop = min(low, active.start), max(low + area.rows.size, active.stop)
    pixel = instrument.pixel_scale_arcsec(band)
    centre = detector.star_row - first
    tall = Window(centred_axis(stop - first, pixel, centre), area.columns, (centre, area.centre[1]))
    inside = slice(low - first, low - first + area.rows.size)
    row = np.arange(first, stop)
    beyond = (row >= active.start) & (row < active.stop)
    beyond[inside] = False
    return tall, inside, beyond
