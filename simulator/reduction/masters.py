"""Masters: which calibration frames go into them, how they are combined with their noise, and their files."""

import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from cpic_core import FloatArray, InputError, Record, whole_file
from simulator.camera import MaskBit
from simulator.camera.calibration_set import flaw_mask, read_calibration_map, warm_from_e_s
from simulator.products.keywords import Card, append_image, append_primary
from simulator.reduction.frames import mean_pixels, raw_variance, staged
from simulator.reduction.level0 import Level0, nearness
from simulator.reduction.level1 import card_of, fits_units, identity
from simulator.reduction.steps import Calibration, Master, calibration, collected, light

MAP_KINDS = ("flat", "dark", "cic", "bad_columns", "bias")
MASTER_KINDS = ("BIAS", "DARK", "FLAT")
LEAST_RESPONSE = 0.5
"""A pixel of less response than this, against the mean, is bad."""
_SIGNIFICANT = 5.0
_ALIKE, _ALIKE_K = 0.01, 1.0


class Plan(Record):
    """A master that is to be made.

    Attributes
    ----------
    kind : {"BIAS", "DARK", "FLAT"}
    name : str
        Of the master, and of its file without the ending.
    files : tuple of Level0
        Calibration files of one gain and exposure.
    uses : tuple of Plan
        Masters that it is made with.
    """

    kind: str
    name: str
    files: tuple[Level0, ...]
    uses: tuple["Plan", ...] = ()

    def all(self) -> Iterator["Plan"]:
        """Yield the masters that it needs, and itself."""
        for plan in self.uses:
            yield from plan.all()
        yield self


def plans_for(level0: Level0, found: Iterable[Level0]) -> dict[str, Plan]:
    """Return the masters for a sequence by their kind, as far as there are frames for them.

    Of each kind the frames of the nearest gain are taken, for a dark those nearest in gain and exposure together, for a
    flat first those of the same band. Darks of a detector that is warmer or colder by more than 1 K are passed over.

    Parameters
    ----------
    level0 : Level0
    found : iterable of Level0
        Calibration files.
    """
    own = [item for item in found if item.shape == level0.shape and item.path != level0.path]
    chosen: dict[str, Plan] = {}

    def of(kind: str, to: Level0) -> list[Level0]:
        """Return the files of a kind that are nearest to a sequence: all of one gain, exposure and band."""

        def far(item: Level0) -> tuple[bool, float]:
            other_band = kind == "FLAT" and item.header.get("FILTER") != to.header.get("FILTER")
            apart = nearness(item.em_gain, to.em_gain)
            return other_band, apart + (nearness(item.exposure_s, to.exposure_s) if kind == "DARK" else 0.0)

        usable = [item for item in own if item.kind == kind and (kind != "DARK" or _as_warm(item, to))]
        if not usable:
            return []
        best = min(usable, key=lambda item: (far(item), str(item.path)))
        return [item for item in usable if _alike(item, best)]

    def plan(kind: str, to: Level0) -> Plan | None:
        files = of(kind, to)
        if not files:
            return None
        needed = {"BIAS": (), "DARK": ("BIAS",), "FLAT": ("BIAS", "DARK")}[kind]
        uses = tuple(made for other in needed if (made := plan(other, files[0])) is not None)
        first = files[0]
        name = f"{kind.lower()}_gain{first.em_gain:g}"
        name += f"_{first.exposure_s:g}s" if kind != "BIAS" else ""
        name += f"_{first.header.get('FILTER', 'any')}" if kind == "FLAT" else ""
        name += f"_{zlib.crc32(repr([file.path.name for file in files] + [used.name for used in uses]).encode()):08x}"
        return Plan(kind, name, tuple(files), uses)

    for kind in MASTER_KINDS:
        if (made := plan(kind, level0)) is not None:
            chosen[kind] = made
    return chosen


def _as_warm(item: Level0, to: Level0) -> bool:
    a, b = item.header.get("CCDTEMP"), to.header.get("CCDTEMP")
    return not (isinstance(a, int | float) and isinstance(b, int | float)) or abs(a - b) <= _ALIKE_K


def _alike(a: Level0, b: Level0) -> bool:
    """Return whether frames of two files can be averaged."""
    same = a.header.get("FILTER") == b.header.get("FILTER") or a.kind != "FLAT"
    gains = nearness(a.em_gain, b.em_gain) < _ALIKE and a.detector.gain_e_adu == b.detector.gain_e_adu
    return same and gains and nearness(a.exposure_s, b.exposure_s) < _ALIKE and _as_warm(a, b)


class Masters(Record, eq=False):
    """Calibrations at hand for a sequence.

    Attributes
    ----------
    made : mapping of str to (Master, float)
        Masters from frames by kind, each with the exposure of its frames (s).
    maps : mapping of str to Path
        FITS maps without noise by kind: ``flat``, ``dark`` (e-/s), ``cic``, ``bad_columns``, ``bias``.
    """

    made: Mapping[str, tuple[Master, float]]
    maps: Mapping[str, Path]

    def _map(self, kind: str, level0: Level0) -> FloatArray:
        return read_calibration_map(kind, str(self.maps[kind]), level0.detector)

    def calibration(self, level0: Level0, columns: Master | None = None) -> Calibration:
        """Return the calibration of a sequence: masters from frames, else from maps, else what the camera states.

        Parameters
        ----------
        level0 : Level0
        columns : Master, optional
            Structure of the bias that the frames themselves show, for want of a better one.
        """
        detector, section, t = level0.detector, level0.sections["active"], level0.exposure_s
        image = level0.sections.get("image", section)
        cic = np.zeros(level0.shape)
        if "cic" in self.maps:
            cic = self._map("cic", level0)
        elif detector.switches.clock_charge:
            cic[:, image[1]] = detector.cic_e
        bias = columns or Master(np.zeros(level0.shape), name="none: the level of overscan alone")
        if "BIAS" in self.made:
            bias = self.made["BIAS"][0]
        elif "bias" in self.maps:
            values = self._map("bias", level0)
            bias = Master(values - np.median(values), name=f"{self.maps['bias'].name}, without noise")
        dark_e = np.zeros(level0.shape)
        dark_e[image] = detector.dark_rate_e_s * t
        dark = Master(dark_e, name=f"none: {detector.dark_rate_e_s:.3g} e-/s of the instrument")
        if "DARK" in self.made:
            master, dark_s = self.made["DARK"]
            dark = master.times(t / dark_s) if dark_s > 0 else master
        elif "dark" in self.maps:
            rate = self._map("dark", level0)
            mask = flaw_mask(np.zeros(level0.shape, dtype=np.bool_), rate, section)
            dark = Master(rate * t, mask=mask, name=f"{self.maps['dark'].name}, without noise")
        flat = Master(np.ones(level0.shape), name="none, 1 everywhere")
        if "FLAT" in self.made:
            flat = self.made["FLAT"][0]
        elif "flat" in self.maps:
            flat = _as_flat(self._map("flat", level0), section, f"{self.maps['flat'].name}, without noise")
        if "bad_columns" in self.maps:
            bad = (self._map("bad_columns", level0) > 0).astype(np.uint8) * np.uint8(MaskBit.BAD)
            flat = replace(flat, mask=bad if flat.mask is None else bad | flat.mask)
        return calibration(detector, level0.em_gain, t, bias=bias, dark=dark, flat=flat, cic_e=cic)


def _as_flat(values: FloatArray, section: tuple[slice, slice], name: str, **noise: FloatArray) -> Master:
    """Return a flat of mean 1 over the good active pixels, and 1 where there is no response to divide by."""
    active = np.zeros(values.shape, dtype=np.bool_)
    active[section] = True
    middle = float(np.median(values[section]))
    good = active & (values > LEAST_RESPONSE * middle)
    mean = float(values[good].mean())
    mask = np.where(active & ~good, np.uint8(MaskBit.BAD), np.uint8(0))
    shared = {key: np.where(good, one / mean, 0.0) for key, one in noise.items()}
    return Master(np.where(good, values / mean, 1.0), shared, mask, name)


def make_master(plan: Plan, masters: Masters, scratch: Path | None = None) -> Master:
    """Return the master of calibration frames, with its noise.

    Bias: the mean without the level of each frame, and without the clock-induced charge that the camera states; that is
    taken off again by its own step, so that for frames of the same gain it cancels whatever it is. Dark: the mean
    electrons in its exposure. Flat: light without dark current over its mean. Cosmic rays are taken out of darks and
    flats in time.

    Parameters
    ----------
    plan : Plan
    masters : Masters
        What it uses.
    scratch : Path, optional
        Folder for raw frames on the way.

    Raises
    ------
    InputError
        If a flat has no light.
    """
    level0 = plan.files[0]
    known = masters.calibration(level0)
    name = f"{plan.name} ({', '.join(file.path.name for file in plan.files)})"
    to_adu = known.em_gain / known.gain_e_adu
    with staged(
        plan.files, known.bias if plan.kind != "BIAS" else Master(0.0 * known.cic_e), known.cic_e, scratch
    ) as frames:
        if plan.kind == "BIAS":
            mean, count = frames.mean()
            noise = np.sqrt(raw_variance(known.cic_e * to_adu, known, level0) / np.maximum(count, 1))
            return Master(mean - known.cic_e * to_adu, {plan.name: noise}, None, name)
        frames.reject()
        pixels = mean_pixels(frames, known)
    active = level0.sections["active"]
    if plan.kind == "DARK":
        made = collected(pixels, known)
        assert made.variance is not None
        noise = np.sqrt(made.variance)
        rate, t = made.image, max(level0.exposure_s, 1e-6)
        warm = warm_from_e_s(rate / t, active)
        # So far above that noise does not lift it there.
        sure = (rate - _SIGNIFICANT * np.sqrt(made.variance + made.shared_variance)) / t
        mask = np.where(sure >= 10.0 * warm, np.uint8(MaskBit.HOT), np.where(sure >= warm, np.uint8(MaskBit.WARM), 0))
        return Master(rate, {**made.shared, plan.name: noise}, mask.astype(np.uint8), name)
    made = light(pixels, known)
    assert made.variance is not None
    if not float(np.median(made.image[active])) > 0.0:
        raise InputError("FLAT", str(level0.path), allowed="frames with light on the active pixels")
    return _as_flat(made.image, active, name, **made.shared, **{plan.name: np.sqrt(made.variance)})


def write_master(path: Path, master: Master, exposure_s: float) -> None:
    """Write a master: ``VALUE``, ``MASK``, and one ``NOISE`` for itself and each master that it was made with."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as file:
        cards: list[Card] = [*identity(path), ("EXPTIME", exposure_s, "[s] of its frames")]
        cards.append(card_of("NAME", master.name, "what it was made of"))
        append_primary(file, cards)
        append_image(file, master.value, [], "VALUE", 1)
        if master.mask is not None:
            append_image(file, master.mask, [], "MASK", 1)
        for number, (name, one) in enumerate(master.shared.items(), start=1):
            append_image(file, one.astype(np.float32), [("MASTER", name, "whose noise this is")], "NOISE", number)


def read_master(path: Path) -> tuple[Master, float]:
    """Read a master that `write_master` wrote, and the exposure of its frames."""
    with fits_units(path) as units:
        shared = {
            str(unit.header["MASTER"]): np.array(unit.data, dtype=np.float64) for unit in units if unit.name == "NOISE"
        }
        mask = np.array(units["MASK"].data, dtype=np.uint8) if "MASK" in units else None
        head = units[0].header
        value = np.array(units["VALUE"].data, dtype=np.float64)
        return Master(value, shared, mask, str(head["NAME"])), float(head["EXPTIME"])


def map_kind(path: Path) -> str:
    """Return the kind of a FITS map, by its card ``MAPKIND`` or its name; empty if it is none."""
    with fits_units(path) as units:
        kind = str(units[0].header.get("MAPKIND", path.name.split(".")[0]))
    return kind if kind in MAP_KINDS else ""


def files_under(place: Path) -> Iterator[tuple[Path, bool]]:
    """Yield a FITS file that is named, or those below a folder, with whether it is named itself.

    Truth, Level-1 files, masters, and what begins with a dot are none of a tree.

    Parameters
    ----------
    place : Path
    """
    if not place.is_dir():
        yield place, True
        return
    for path in sorted(place.rglob("*.fit*")):
        hidden = any(part.startswith(".") or part in ("Truth", "Masters") for part in path.relative_to(place).parts)
        if not hidden and "_TRUTH" not in path.name and "_L1" not in path.name and path.is_file():
            yield path, False
