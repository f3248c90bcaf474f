"""Random scenes, drawn as images with planets at random places: what the search finds beside what is predicted."""

import base64
import math
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from cpic_core import FloatArray, stream
from cpic_planner import etc
from cpic_planner.confirm.scene import scene_target
from cpic_planner.etc.detection_law import band_law
from cpic_planner.queries import ConfirmQuestion
from cpic_planner.validation import ConfirmTask, Frames, VisitPair, gap_s, images_of, modelling_of, task_of, visit_pair
from cpic_planner.validation.injection import draw_place, inject
from cpic_planner.validation.measure import maps_of, searcher_of
from simulator.config import load_instrument

SEED, BANDS, VISITS = 8, ("F520", "F662", "F720", "F850"), (1, 2, 4, 8, 16, 64)
LEVELS = (3.0, 4.0, 5.0)
SCATTER = 0.35  # of the brightness of planets about that at which half are found, in the logarithm
_PROBE, _NEAR_LAMBDA_D = 1e-9, 1.5
_STEP_ARCSEC, _STEP_DEX = 1e-4, 1e-3


@dataclass(frozen=True)
class Cell:
    """One scene and programme: the star, the drift, and what else shines.

    ``companion`` and ``background`` are separation (arcsec), position angle (deg) and V magnitude of another star.
    """

    number: int
    band: str
    v_mag: float
    teff_k: float
    visits: int
    visit_h: float
    drift_nm: float
    companion: tuple[float, float, float] | None
    background: tuple[float, float, float] | None

    @classmethod
    def drawn(cls, number: int) -> "Cell":
        """Return the cell of a number."""
        rng = stream(SEED, "cell", number)
        band, visits = BANDS[rng.integers(4)], VISITS[rng.integers(len(VISITS))]
        v_mag, teff_k, visit_h = rng.uniform(0.0, 8.0), rng.uniform(3800.0, 6800.0), 2.0 ** rng.integers(0, 3)
        drift_nm = math.exp(rng.uniform(math.log(0.01), math.log(0.5)))
        far = math.exp(rng.uniform(math.log(2.0), math.log(20.0))), rng.uniform(0.0, 360.0), v_mag + rng.uniform(0, 5)
        near = rng.uniform(0.4, 0.9), 45.0 + 90.0 * rng.integers(4) + rng.uniform(-15.0, 15.0), rng.uniform(18.0, 23.0)
        both = rng.random(2)
        others = far if both[0] < 0.3 else None, near if both[1] < 0.15 else None
        return cls(number, band, float(v_mag), float(teff_k), visits, float(visit_h), float(drift_nm), *others)

    def question(self) -> ConfirmQuestion:
        """Return the question about its images."""
        star: dict[str, Any] = {"magnitude": self.v_mag, "teff_k": self.teff_k, "log_g": 4.4, "metallicity": 0.0}
        star |= {"name": "star", "distance_pc": 10.0, "ra": 100.0, "dec": 40.0}
        others: list[dict[str, Any]] = []
        for name, other, hot in (
            ("companion", self.companion, self.teff_k * 0.85),
            ("star 2", self.background, 4500.0),
        ):
            if other is not None:
                place: dict[str, Any] = {"separation_arcsec": other[0], "pa_deg": other[1], "magnitude": other[2]}
                others.append(
                    place | {"name": name, "model": "blackbody", "teff_k": hot, "companion": name != "star 2"}
                )
        drift = {"visit_nm": self.drift_nm, "walk_nm_per_sqrt_hour": self.drift_nm}
        drift |= {"orbital_nm": min(2.0 * self.drift_nm, 0.1)}
        asked: dict[str, Any] = {
            "scene": {"name": "cell", "kind": "scene", "cstar": star, "planets": [], "stars": others}
        }
        asked |= {"instrument": load_instrument({"drift": drift}), "bands": (self.band,), "audit": False}
        asked |= {"strategy": {"visits": self.visits}, "time_s": 3600.0 * self.visit_h * self.visits}
        return ConfirmQuestion.of(asked)


@dataclass(frozen=True, eq=False)
class Programme:
    """A cell with its model of images and the frames of a visit."""

    cell: Cell
    model: etc.EtcModel
    target: Any
    frames: Frames

    @classmethod
    def of(cls, cell: Cell, frames: Frames | None = None) -> "Programme | None":
        """Return the programme of a cell; None where no frame is possible."""
        question = cell.question()
        model = etc.build_model(images_of(question.instrument), [cell.band], question.strategy)
        target = scene_target(question.looked_at)
        if frames is None:
            x, y = model.metrics[cell.band].zone.middle
            place = math.hypot(x, y)
            (answer,) = etc.signal_to_noise(
                model, target, time_s=question.time_s, separation_arcsec=place, bands=[cell.band], contrast=_PROBE
            )
            if not answer.frames_per_visit or answer.exposure_s is None or answer.em_gain is None:
                return None
            frames = Frames(answer.exposure_s, answer.frames_per_visit, answer.em_gain, cell.visits)
        return cls(cell, model, target, frames)

    def prospect(self, x: FloatArray, y: FloatArray, contrast: FloatArray) -> etc.Prospect:
        """Return what is predicted of planets in the images."""
        visits = etc.Programme.of(self.model.strategy, self.cell.visits, gap_s(self.model, self.cell.band, self.frames))
        setting = self.frames.exposure_s, float(self.frames.n_frames), self.frames.em_gain
        places = x[None], y[None], contrast[None]
        return etc.prospect_of(self.model, self.target, self.cell.band, *places, setting, visits, moving=False)

    def images(self) -> VisitPair:
        """Return its images."""
        scene = self.cell.question().looked_at
        task = task_of(self.model, scene, self.cell.band, self.frames, [], seed=self.cell.number, fidelity="standard")
        assert isinstance(task, ConfirmTask)
        return visit_pair(task, modelling=modelling_of(task))


def measured(number: int, stacks: int, planets: int) -> dict[str, Any] | None:
    """Return planets that were put one at a time into the stacks of a cell, and false alarms without them.

    Parameters
    ----------
    number : int
        Of the cell.
    stacks, planets : int
        Stacks that are drawn, and planets in each.

    Returns
    -------
    dict or None
        None where no frame is possible or sums of frames cannot stand for them.
    """
    cell = Cell.drawn(number)
    programme = Programme.of(cell)
    pair = None if programme is None else programme.images()
    if programme is None or pair is None or pair.stackable.value is None:
        return None
    geometry, rng, maps = pair.geometry, stream(SEED, "planets", number), maps_of(pair)
    rate_e_s = pair.science.truth.sources[0].rate_e_s
    beside = [(one.x_arcsec, one.y_arcsec) for one in pair.science.truth.sources[1:]]
    n = stacks * planets
    places: list[tuple[float, float]] = []
    while len(places) < n:
        reach = geometry.zone.outer_corner_arcsec
        at = draw_place(geometry, math.hypot(*rng.uniform(-reach, reach, 2)), rng)
        if at and all(math.dist(at, one) > _NEAR_LAMBDA_D * geometry.lambda_d_arcsec for one in beside):
            places.append(at)
    x, y = np.array(places).T
    # About where half of the planets of that separation are found, whatever shines at the place.
    alone = replace(programme, target=replace(programme.target, scene=None))
    probe = alone.prospect(x, y, np.full(n, _PROBE))
    law = band_law(programme.model, cell.band)
    where = np.hypot(x, y)[None], etc.speckled_share(probe.noise), 0.5, float(cell.visits)
    half = (_PROBE * law.half(*where, at_place=False) / probe.noise.significance)[0]
    x, y, contrast = unpacked(packed(x, y, half * np.exp(rng.normal(0.1, SCATTER, n))))
    found, placed, alarms, elements = [], [], {f"{level:g}": 0 for level in LEVELS}, 0.0
    for stack in range(stacks):
        reduced = pair.draw(stack).reduced
        search = searcher_of(pair, reduced, rate_e_s, maps)
        empty = search.search(reduced.image_e)
        elements += empty.region.n_elements
        own = [
            one.significance
            for one in empty.candidates
            if all(math.dist((one.x_arcsec, one.y_arcsec), at) > geometry.lambda_d_arcsec for at in beside)
        ]
        for level in LEVELS:
            asked = etc.search_threshold(empty.region, empty.roughness, sigma=level).unwrap()
            alarms[f"{level:g}"] += sum(one >= asked for one in own)
        for k in range(stack * planets, (stack + 1) * planets):
            place = float(x[k]), float(y[k])
            image = np.asarray(pair.optics.at(*place, margin_pixels=0))
            shown = inject(reduced, image, contrast[k] * rate_e_s * reduced.integration_s, rng)
            seen = search.search(shown.image_e, [place])
            match = seen.strongest_near(*place, geometry)
            found.append(int(match is not None and match.detected))
            placed.append(int(seen.at_places[0].detected))
    frames = [programme.frames.exposure_s, programme.frames.n_frames, programme.frames.em_gain]
    both = "".join(str(one + 2 * two) for one, two in zip(found, placed, strict=True))
    return {"cell": asdict(cell), "frames": frames, "planets": packed(x, y, contrast), "shown": both} | {
        "alarms": alarms,
        "elements": elements,
        "stacks": stacks,
    }


def packed(x_arcsec: FloatArray, y_arcsec: FloatArray, contrast: FloatArray) -> str:
    """Return planets as text: their offsets in units of 1e-4 arcsec and contrasts in 1e-3 dex, two bytes each."""
    numbers = np.round([x_arcsec / _STEP_ARCSEC, y_arcsec / _STEP_ARCSEC, np.log10(contrast) / _STEP_DEX])
    return base64.b64encode(numbers.astype("<i2").tobytes()).decode()


def unpacked(planets: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the offsets and contrasts of planets that `packed` wrote."""
    x, y, brightness = np.frombuffer(base64.b64decode(planets), "<i2").reshape(3, -1).astype(float)
    return x * _STEP_ARCSEC, y * _STEP_ARCSEC, 10.0 ** (brightness * _STEP_DEX)
