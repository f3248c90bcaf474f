"""Level-1 files: which visit each is of, and what they show, registered and reduced as simulated frames are.

A Level-1 file has an image of every frame in electrons at the register input and beside it a mask with the bits of
`simulator.camera.MaskBit`, as `cpic reduce` writes them. Visits are told apart by the headers. The stack that is left
has the orientation of the detector: places are turned to the sky by POS_ANG0.
"""

import functools
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatch
from pathlib import Path
from typing import Any, Self

import numpy as np

from cpic_core import FloatArray, InputError, NDArray, Record
from cpic_planner.results import ProductVisitRecord, SourceRecord
from cpic_planner.validation.astrometry import fit_position
from cpic_planner.validation.frames import CalibratedFrames
from cpic_planner.validation.measure import is_covered, measured_at, place_at, speckles_of, with_image
from cpic_planner.validation.rdi import pedestal_e
from cpic_planner.validation.realise import (
    ROLES,
    FrameStatistics,
    Realisation,
    VisitPair,
    WholeFrames,
    reduced_frames,
    whole_frames,
)
from cpic_planner.validation.registration import LEAST_PIXELS, Shift, measured_shift, moved, star_light
from cpic_planner.validation.search import MATCH_LAMBDA_D, BlindSearch
from cpic_planner.validation.star_flux import StarFlux, is_far, observe_off_mask, star_flux_off_mask
from simulator.camera import MaskBit
from simulator.observing import Observation, Role
from simulator.reduction import fits_units, named_header

_SPOILT = MaskBit.BAD | MaskBit.HOT | MaskBit.SATURATED | MaskBit.COSMIC_RAY | MaskBit.SATELLITE_TRAIL
_KINDS = ("SCI", "CALS")
_OFF_MASK_ARCSEC = 0.1  # a star so far from the centre of the mask along both axes is shown, not hidden
_STAR = ("OBJECT", "RA_OBJ", "DEC_OBJ")
_SAME_DEG, _SAME_SCALE = 1.0 / 3600.0, 0.01
_CELL_LAMBDA_D = 2.0


class Level1File(Record):
    """One file: its place, its keywords under the names of the table, and how many frames it has.

    Attributes
    ----------
    path : Path
    header : mapping
        Of the primary unit and of the first image.
    n_frames : int
    """

    path: Path
    header: Mapping[str, Any]
    n_frames: int

    @classmethod
    def of(cls, path: Path) -> Self:
        """Return a file, without any frame if it is no Level 1 of a scene or a star.

        Raises
        ------
        InputError
            If it is no FITS file.
        """
        with fits_units(path) as units:
            headers = [unit.header for unit in _images_and_masks(units)]
            header = (named_header(headers[0]) if headers else {}) | named_header(units[0].header)
        images = sum(one["BITPIX"] < 0 for one in headers)
        paired = 2 * images == len(headers)
        return cls(path, header, images if paired and header.get("OBSTYPE", _KINDS[0]) in _KINDS else 0)

    def value(self, key: str, kind: type = float) -> Any:
        """Return the value of a keyword.

        Raises
        ------
        InputError
            Where it is missing or of another kind.
        """
        found = self.header.get(key)
        if found is None or isinstance(found, bool) or not isinstance(found, (int, float) if kind is float else kind):
            raise InputError(f"{self.path.name}: {key}", found, allowed=f"a {'number' if kind is float else 'word'}")
        return kind(found)

    @property
    def star_offset_arcsec(self) -> tuple[float, float]:
        """Place of the star beside the centre of the mask, x and y."""
        return float(self.header.get("STAROFFX") or 0.0), float(self.header.get("STAROFFY") or 0.0)

    def pixel_scale_arcsec(self, otherwise: float) -> float:
        """Return the side of a pixel, that of the instrument (``otherwise``) where the header does not state it."""
        return float(self.value("PIXSCALE")) if "PIXSCALE" in self.header else otherwise

    @property
    def roll_deg(self) -> float:
        """Position angle of the detector's +y axis."""
        return float(self.value("POS_ANG0"))

    @property
    def half_length_s(self) -> float:
        """Half of the time from the begin of the first exposure to the end of the last, s."""
        readout_s = float(self.header.get("READTIME") or 0.0)
        return 0.5 * (self.n_frames * (float(self.value("EXPTIME")) + readout_s) - readout_s)

    @property
    def star_deg(self) -> tuple[float, float] | None:
        """Right ascension and declination of the star, ICRS; None where the header does not state them."""
        found = self.header.get("RA_OBJ"), self.header.get("DEC_OBJ")
        return None if None in found else (float(self.value("RA_OBJ")), float(self.value("DEC_OBJ")))

    def frames(self) -> Iterator[tuple[FloatArray, NDArray[np.uint8]]]:
        """Yield the images in electrons, and their masks, one frame at a time."""
        with fits_units(self.path) as units:
            image = None
            for unit in _images_and_masks(units):
                if unit.header["BITPIX"] < 0:
                    image = unit.data
                elif image is not None:
                    yield np.asarray(image, dtype=np.float64), np.asarray(unit.data, dtype=np.uint8)
                    image = None
                del unit.data  # or the file would be in memory as a whole


def _images_and_masks(units: Any) -> list[Any]:
    """Return the units of two axes that are no errors."""
    images = [unit for unit in units if unit.is_image and unit.header.get("NAXIS") == 2]
    return [unit for unit in images if not str(unit.header.get("EXTNAME", "")).upper().startswith("ERR")]


def level1_files(folder: Path) -> list[Level1File]:
    """Return the Level-1 files of scenes and stars below a folder, in the order of their begin.

    Raises
    ------
    InputError
        If there is none; where there are Level-0 files instead, saying so.
    """
    every = [Level1File.of(path) for path in sorted(folder.rglob("*.fits")) if "Truth" not in path.parts]
    found = [one for one in every if one.n_frames]
    if not found:
        raw = sum(str(one.header.get("BUNIT", "")).lower() == "adu" for one in every)
        hint = f"{raw} Level-0 files are there: reduce them first with cpic reduce" if raw else ""
        allowed = "a folder with Level-1 files: an image in electrons and a mask for each frame"
        raise InputError("from_products", str(folder), allowed=allowed, hint=hint)
    return sorted(found, key=lambda one: (float(one.header.get("EXPSTART") or 0.0), str(one.path)))


class Level1Programme(Record):
    """The visits of one star in one band that are reduced together.

    Attributes
    ----------
    band : str
    visits : mapping
        Files of each visit, in the order of time: ``science``, ``reference`` and ``off_mask``.
    """

    band: str
    visits: Mapping[str, tuple[tuple[Level1File, ...], ...]]

    @functools.cached_property
    def first(self) -> Level1File:
        """The first file of the science visits."""
        return self.visits["science"][0][0]

    def n_frames(self, role: str) -> int:
        """Return the number of frames of all visits of a role."""
        return sum(one.n_frames for visit in self.visits[role] for one in visit)

    @property
    def exposure_s(self) -> float:
        """Exposure of a frame."""
        return float(self.first.value("EXPTIME"))

    @property
    def em_gain(self) -> float:
        """Gain of the register; 1 of a camera without one."""
        return float(self.first.header.get("EMGAIN") or 1.0)

    @property
    def middle_mjd(self) -> float | None:
        """Mean of the middles of the science exposures, MJD (UTC); None where a file does not state its begin."""
        files = [one for visit in self.visits["science"] for one in visit]
        if any(one.header.get("EXPSTART") is None for one in files):
            return None
        middles = [one.value("EXPSTART") + one.half_length_s / 86400.0 for one in files]
        return float(np.average(middles, weights=[one.n_frames for one in files]))

    @property
    def other_star(self) -> bool:
        """Whether the references show another star: coordinates more than an arcsecond away."""
        first, second = self.first.star_deg, self._reference.star_deg
        if first is None or second is None:
            return self.first.header.get("OBJECT") != self._reference.header.get("OBJECT")
        turn = (first[0] - second[0] + 180.0) % 360.0 - 180.0
        return math.hypot(turn * math.cos(math.radians(first[1])), first[1] - second[1]) > _SAME_DEG

    @property
    def _reference(self) -> Level1File:
        return self.visits["reference"][0][0]

    @property
    def rolls_deg(self) -> tuple[float, float]:
        """Rolls of the science and of the reference visits."""
        return self.first.roll_deg, self._reference.roll_deg

    def files(self) -> dict[str, Any]:
        """Return the files as plain data, for a task."""
        return {role: [[str(one.path) for one in visit] for visit in own] for role, own in self.visits.items()}

    def check(self, pixel_scale_arcsec: float) -> None:
        """Refuse visits that cannot be reduced together.

        Parameters
        ----------
        pixel_scale_arcsec : float
            Of the band of the instrument.

        Raises
        ------
        InputError
            Naming the file and the keyword.
        """
        for role in ROLES:
            for one in (file for visit in self.visits[role] for file in visit):
                mine = self.first if role == ROLES[0] else self._reference
                same = [(key, self.first) for key in ("EXPTIME", "EMGAIN")] + [(key, mine) for key in _STAR]
                for key, other in same:
                    wanted, given = other.header.get(key), one.header.get(key)
                    if wanted != given:
                        raise InputError(f"{one.path.name}: {key}", given, allowed=f"{wanted}, as in {other.path}")
                if abs(one.roll_deg - mine.roll_deg) > 1e-6:
                    allowed = f"{mine.roll_deg:g}, as in {mine.path.name}"
                    raise InputError(f"{one.path.name}: POS_ANG0", one.roll_deg, unit="deg", allowed=allowed)
                scale = one.pixel_scale_arcsec(pixel_scale_arcsec)
                if abs(scale / pixel_scale_arcsec - 1.0) > _SAME_SCALE:
                    allowed = f"{pixel_scale_arcsec:g}, that of the instrument in {self.band}"
                    raise InputError(f"{one.path.name}: PIXSCALE", scale, unit="arcsec", allowed=allowed)


def level1_programmes(
    folder: Path, bands: Sequence[str] | None = None, references: Sequence[str] = ()
) -> list[Level1Programme]:
    """Return the programmes whose Level-1 files are below a folder, one a band.

    Parameters
    ----------
    folder : Path
    bands : sequence of str, optional
        Those that are wanted; all that there are by default.
    references : sequence of str
        Patterns of names below the folder whose files are references, whatever their headers say.

    Raises
    ------
    InputError
        If a file lacks its band, or a band its science or its reference visits.
    """
    by_band: dict[str, dict[str, dict[Any, list[Level1File]]]] = {}
    for one in level1_files(folder):
        band = one.value("FILTER", str)
        name, role = one.path.relative_to(folder).as_posix(), one.header.get("ROLE", ROLES[0])
        if min(map(abs, one.star_offset_arcsec)) > _OFF_MASK_ARCSEC:
            role = "off_mask"
        elif any(fnmatch(name, pattern) or fnmatch(name, f"{pattern}/*") for pattern in references):
            role = ROLES[1]
        visit = one.header.get("VISIT") or name
        by_band.setdefault(band, {}).setdefault(role, defaultdict(list))[visit].append(one)
    found = []
    for band in bands or by_band:
        roles = by_band.get(band, {})
        for role in ROLES:
            if role not in roles:
                hint = "--references names files that are references" if role == ROLES[1] else ""
                allowed = f"a folder with a {role} visit in {band} (ROLE in the headers)"
                raise InputError("from_products", str(folder), allowed=allowed, hint=hint)
        visits = {role: tuple(map(tuple, roles.get(role, {}).values())) for role in (*ROLES, "off_mask")}
        found.append(Level1Programme(band, visits))
    return found


def programme_of(task_files: Mapping[str, Sequence[Sequence[str]]], band: str) -> Level1Programme:
    """Return the programme of the files of a task."""
    visits = {
        role: tuple(tuple(Level1File.of(Path(path)) for path in visit) for visit in own)
        for role, own in task_files.items()
    }
    return Level1Programme(band, visits)


def _cut(files: Iterable[Level1File], seen: Observation, shape: tuple[int, int], centre: tuple[int, int]) -> Any:
    """Return calibrated frames of a part of the detector, and how far each has the star from the centre of a pixel.

    Parameters
    ----------
    files : iterable of Level1File
    seen : Observation
        The same observation as it would be simulated.
    shape, centre : tuple of int
        Of the part: its size, and the row and column of it where the centre of the mask belongs.
    """
    images, masks, rests = [], [], []
    for one in files:
        scale = one.pixel_scale_arcsec(seen.psf.geometry.pixel_scale_arcsec)
        offset = [part / scale for part in one.star_offset_arcsec]
        x, y = float(one.value("CRPIX1")) - 1.0 - offset[0], float(one.value("CRPIX2")) - 1.0 - offset[1]
        first = round(y) - centre[0], round(x) - centre[1]
        place = tuple(slice(low, low + side) for low, side in zip(first, shape, strict=True))
        for image, mask in one.frames():
            if min(first) < 0 or image[place].shape != shape:
                allowed = f"places of mask and star whose {shape[0]} x {shape[1]} pixels around are in the image"
                raise InputError(f"{one.path.name}: CRPIX1, CRPIX2", (x + 1, y + 1), unit="px", allowed=allowed)
            rests.append((x - round(x), y - round(y)))
            images.append(image[place])
            masks.append(mask[place])
    electrons, mask = np.stack(images), np.stack(masks)
    usable = ((mask & np.uint8(_SPOILT)) == 0) & np.isfinite(electrons)
    detector, lost = seen.channel.detector, ((mask & np.uint8(MaskBit.SATURATED)) != 0).sum(axis=0)
    frames = CalibratedFrames(
        electrons=np.where(usable, electrons, 0.0),
        usable=usable,
        pedestal_e=np.full(shape, pedestal_e(detector, seen.exposure_s)),
        response=np.ones(shape),
        n_lost=lost,
        struck=(mask & np.uint8(MaskBit.COSMIC_RAY)) != 0,
        lost_in=0,
        lost_outside=int(lost.sum()),
        n_frames=len(electrons),
        exposure_s=seen.exposure_s,
        em_gain=seen.em_gain,
        detector=detector,
    )
    return frames, rests


def realise_files(
    visits: VisitPair, programme: Level1Programme
) -> tuple[VisitPair, Realisation, FrameStatistics, list[ProductVisitRecord]]:
    """Read the frames of a programme, register them, and reduce them as those of a simulation.

    Parameters
    ----------
    visits : VisitPair
        The same programme as it would be simulated: optics, detector and reduction.
    programme : Level1Programme

    Returns
    -------
    visits : VisitPair
        With the brightness of the science star over that of another reference star, as the images show it.
    realisation : Realisation
    statistics : FrameStatistics
    records : list of ProductVisitRecord
        Which files were read, and how far their star was from the place in the headers.

    Notes
    -----
    The mean image of each visit is compared with that of all visits, each frame with the mean of its visit, by the
    light off the mask and beyond the dark hole. Frames are moved by what is significant, and by the part of a pixel
    that the headers state, in one step.
    """
    geometry = visits.geometry
    side, star = geometry.stamp_pixels, star_light(geometry)
    read: list[tuple[Role, int, tuple[Level1File, ...], WholeFrames]] = []
    for role in ROLES:
        for number, files in enumerate(programme.visits[role]):
            seen = visits.visit(role, 0)
            frames, rests = _cut(files, seen, (side, side), (side // 2, side // 2))
            frames = replace(frames, pedestal_e=frames.pedestal_e + visits.smear_e(role))
            whole = whole_frames(frames, geometry.hole)
            placed = [_placed(image, -x, -y) for image, (x, y) in zip(whole.electrons, rests, strict=True)]
            read.append((role, number, files, whole._replace(electrons=np.stack(placed))))
    cell = _CELL_LAMBDA_D * geometry.lambda_d_arcsec / geometry.pixel_scale_arcsec
    region = star & np.logical_and.reduce([whole.usable.any(axis=0) for *_, whole in read])
    means = [whole.electrons.mean(axis=0) for *_, whole in read]
    template = np.mean([mean / np.abs(mean[region]).mean() for mean in means], axis=0)
    records, ready = [], {role: list[WholeFrames]() for role in ROLES}
    for (role, number, files, whole), mean in zip(read, means, strict=True):
        shift = measured_shift(mean, template, region, cell)
        x, y = _significant(shift)
        steps = [_significant(measured_shift(image, mean, region, cell)) for image in whole.electrons]
        moves = zip(whole.electrons, steps, strict=True)
        images = [_placed(image, -x - step[0], -y - step[1]) for image, step in moves]
        ready[role].append(whole._replace(electrons=np.stack(images)))
        first = files[0]
        record = ProductVisitRecord(
            band=programme.band,
            role=role,
            visit=number + 1,
            files=[str(one.path) for one in files],
            n_frames=len(images),
            exposure_s=programme.exposure_s,
            em_gain=programme.em_gain,
            roll_deg=first.roll_deg,
            mjd=first.header.get("EXPSTART"),
            shift_x_pixel=shift and shift.x_pixel,
            shift_y_pixel=shift and shift.y_pixel,
            shift_x_error_pixel=shift and shift.x_error_pixel,
            shift_y_error_pixel=shift and shift.y_error_pixel,
            moved=(x, y) != (0.0, 0.0),
            frames_moved=sum(any(step) for step in steps),
        )
        records.append(record)
    if programme.other_star:
        images = [np.mean([one.electrons.mean(axis=0) for one in ready[role]], axis=0)[region] for role in ROLES]
        visits = replace(visits, scale=float(images[0] @ images[1] / (images[1] @ images[1])))
    realisation, statistics = reduced_frames(visits, ready["science"], ready["reference"])
    return visits, realisation, statistics, records


def _significant(shift: Shift | None) -> tuple[float, float]:
    return (shift.x_pixel, shift.y_pixel) if shift is not None and shift.significant else (0.0, 0.0)


def _placed(image: FloatArray, x_pixel: float, y_pixel: float) -> FloatArray:
    return moved(image, x_pixel, y_pixel) if math.hypot(x_pixel, y_pixel) >= LEAST_PIXELS else image


def star_of_files(visits: VisitPair, programme: Level1Programme) -> StarFlux | None:
    """Return the rate of the star from the files that show it off the mask; None where there is none.

    Parameters
    ----------
    visits : VisitPair
    programme : Level1Programme

    Raises
    ------
    InputError
        If the star saturates there.
    """
    series = programme.visits["off_mask"]
    if not series:
        return None
    files, task = series[0], visits.task
    seen = observe_off_mask(
        visits.plan.science_scene,
        task.band,
        instrument=visits.instrument,
        fidelity=visits.modelling.knobs,
        exposure_s=float(files[0].value("EXPTIME")),
        n_frames=sum(one.n_frames for one in files),
        em_gain=float(files[0].header.get("EMGAIN") or 1.0),
        offset_arcsec=files[0].star_offset_arcsec,
    ).unwrap()
    shape, centre = seen.shape, seen.area.centre
    if is_far(seen.psf, seen.star_offset_arcsec):
        side = len(seen.psf.off_axis)
        x, y = (round(part / seen.psf.geometry.pixel_scale_arcsec) for part in seen.star_offset_arcsec)
        shape, centre = (side, side), (side // 2 - y, side // 2 - x)
    frames, _ = _cut(files, seen, shape, centre)
    answer = star_flux_off_mask(seen, frames)
    if answer.value is None:
        raise InputError(
            "file", files[0].path.name, allowed="a star off the mask that no limit cuts", hint=answer.message
        )
    return answer.value


def starlight_e_s(visits: VisitPair, realisation: Realisation) -> float:
    """Return the rate of the star that the light which the mask leaves stands for, by the model of the optics.

    It scales what is believed of the speckles before their noise is fitted, and no answer.

    Parameters
    ----------
    visits : VisitPair
    realisation : Realisation
    """
    light = realisation.science_e / realisation.reduced.integration_s
    model, region = np.asarray(visits.optics.on_axis, float), star_light(visits.geometry) & (realisation.science_e != 0)
    design = np.stack([model[region], np.ones(np.count_nonzero(region))])
    rate = float(np.linalg.lstsq(design.T, light[region], rcond=None)[0][0])
    return max(rate, 1.0)


def sources_of(
    visits: VisitPair, realisation: Realisation, blind: BlindSearch, star: StarFlux | None, programme: Level1Programme
) -> list[SourceRecord]:
    """Return what a blind search detects: its place fitted, its light by forced photometry there.

    Parameters
    ----------
    visits : VisitPair
    realisation : Realisation
    blind : BlindSearch
    star : StarFlux or None
        None where the star's light is not known: there are then no contrasts.
    programme : Level1Programme
    """
    stack, geometry, first = realisation.reduced, visits.geometry, programme.first
    known = [] if visits.task.bare else visits.science.truth.sources[1:]
    model = None if star is None else speckles_of(visits, star.rate_e_s)
    reach = MATCH_LAMBDA_D * geometry.lambda_d_arcsec
    records = []
    for one in blind.detections:
        others = [(other.x_arcsec, other.y_arcsec) for other in blind.detections if other is not one]
        names = [it.name for it in known if math.hypot(it.x_arcsec - one.x_arcsec, it.y_arcsec - one.y_arcsec) <= reach]
        fit = fit_position(
            stack, visits.optics, one.x_arcsec, one.y_arcsec, roll_deg=programme.rolls_deg[0], exclude=others
        )
        place = (fit.x_arcsec, fit.y_arcsec) if fit.converged else (one.x_arcsec, one.y_arcsec)
        planet = with_image(visits, place_at(geometry, visits.strategy, "", (place,), others))
        whole = is_covered(stack.region, planet.apertures[0] * geometry.hole)
        light = measured_at(visits, realisation, planet, 1.0, model) if whole else None
        told: dict[str, Any] = {"snr": None, "search_snr": one.snr_mf, "search_threshold": one.threshold}
        told |= {"band": programme.band, "source": names[0] if names else "", "mjd": programme.middle_mjd}
        if light is not None:
            told |= {"rate_e_s": light.contrast, "rate_error_e_s": light.contrast_error, "snr": light.snr}
        if light is not None and star is not None:
            contrast = light.contrast / star.rate_e_s
            error = math.hypot(light.contrast_error, contrast * star.error_e_s) / star.rate_e_s
            told |= {"contrast": contrast, "contrast_error": error}
        if first.star_deg is not None:  # an arcsecond on the sphere is flat to 1e-11 deg
            ra, dec = first.star_deg
            told["dec_deg"] = dec + fit.north_arcsec / 3600.0
            told["ra_deg"] = (ra + fit.east_arcsec / 3600.0 / math.cos(math.radians(dec))) % 360.0
        records.append(SourceRecord.of(fit, **told))
    return records
