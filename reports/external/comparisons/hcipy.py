"""Point-spread functions before and behind the mask: HCIPy."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from reports.external.comparison import GIVEN, Reference, Row

TITLE = "Point-spread functions: HCIPy"
REFERENCE = Reference("HCIPy", "0.7.1", "package index, `FraunhoferPropagator`", ("hcipy==0.7.1",))
TEXT = """
Band F662 of the default instrument: apodizer, static wavefront with the mirror in it, and photon spectrum are ours,
given to HCIPy as arrays on 128 x 128 cells and at 16 wavelengths. HCIPy propagates them to the focal plane; averaging
over open parts of pixels and over the pointing jitter (five nodes each), the mask and the photometric aperture are
written anew beside it. Ours at the fidelity `reference` takes 7 wavelengths, at `standard` 4; the difference between
the two is what the tier costs, not what the propagation does. No other part of the image chain has a common ancestor
with HCIPy's: ours is products of matrices folded by the symmetry of the pupil.
"""
BAND, WAVELENGTHS, NODES, HOLE_PIXELS, BOX_PIXELS = "F662", 16, 5, 95, 17
PLANETS = ((0.43, 0.43), (0.25, 0.30))  # x and y, arcsec: in the open, and beside the mask
PIXELS = ((20, 25), (33, -30), (-14, 40), (-28, -19))  # in the hole, x and y from the star
FIDELITIES = {"reference": 1e-4, "standard": 5e-3}  # tolerances: what a tier is allowed to cost in light
RADIANS = np.pi / 180.0 / 3600.0


def given() -> dict[str, Any]:
    """Return the optics that both start from."""
    from simulator import Knobs, load_instrument
    from simulator.imaging.build import build_imager

    imager = build_imager(load_instrument(), BAND, Knobs(wavelength_nodes=WAVELENGTHS))
    assert imager.static is not None
    hole = imager.geometry.hole
    edge = (len(hole) - HOLE_PIXELS) // 2
    numbers = ("diameter_m", "pixel_scale_arcsec", "mask_half_width_arcsec", "aperture_radius_arcsec", "jitter_arcsec")
    return {name: getattr(imager, name) for name in (*numbers, "transmission", "wavelengths_m", "weights")} | {
        "opd_nm": imager.static.opd_nm,
        "amplitude": imager.static.amplitude,
        "hole": hole[edge : edge + HOLE_PIXELS, edge : edge + HOLE_PIXELS],
    }


def checks(optics: Any) -> dict[str, float]:
    """Return numbers that tell whether the optics are the recorded ones."""
    light = optics["transmission"] ** 2
    phase = float(np.sqrt(np.average(optics["opd_nm"] ** 2, weights=light)))
    return {"light behind the apodizer": float(light.mean()), "rms of the wavefront (nm)": phase}


def peer() -> dict[str, Any]:
    """Ask HCIPy."""
    with np.load(GIVEN) as file:
        optics = dict(file)
    bench = Bench(optics)
    axis = (np.arange(HOLE_PIXELS) - HOLE_PIXELS // 2) * bench.pixel
    box = (np.arange(BOX_PIXELS) - BOX_PIXELS // 2) * bench.pixel
    star, unmasked = bench.image(axis, axis, masked=True), bench.image(box, box, masked=False)
    dark = star[optics["hole"]] / unmasked.max()
    middle = HOLE_PIXELS // 2
    found = {
        "input": checks(optics),
        "peak": float(unmasked.max()),
        "core": float(np.sum(unmasked * bench.covered(box, box, (0.0, 0.0)))),
        "mean": float(dark.mean()),
        "rms": float(np.sqrt(np.mean(dark**2))),
        "pixels": [float(star[middle + y, middle + x] / unmasked.max()) for x, y in PIXELS],
        "planets": [],
    }
    for x, y in PLANETS:
        near = [np.rint(place / bench.pixel) * bench.pixel + box for place in (y, x)]
        image = bench.image(*near, masked=True, source=(x, y))
        found["planets"].append(float(np.sum(image * bench.covered(*near, (x, y)))))
    return found


class Bench:
    """The optics in HCIPy, and what pixels, mask, pointing and aperture make of its field."""

    def __init__(self, optics: dict[str, Any]) -> None:
        import hcipy

        self.optics, self.pixel = optics, float(optics["pixel_scale_arcsec"])
        self.grid = hcipy.make_pupil_grid(len(optics["transmission"]), float(optics["diameter_m"]))

    def nodes(self, centres: NDArray[np.float64], masked: bool) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return places of one axis (arcsec from the star) and the weights of each pixel there."""
        places, weights = np.polynomial.legendre.leggauss(NODES)
        shifts, shares = np.polynomial.hermite_e.hermegauss(NODES)
        bar = float(self.optics["mask_half_width_arcsec"]) if masked else 0.0
        found, sums = [], []
        for index, centre in enumerate(centres):
            low, high = centre - self.pixel / 2.0, centre + self.pixel / 2.0
            for start, stop in ((low, min(high, -bar)), (max(low, bar), high)):
                if stop <= start:
                    continue
                middle, half = (start + stop) / 2.0, (stop - start) / 2.0
                found.append(np.add.outer(middle + half * places, self.optics["jitter_arcsec"] * shifts).ravel())
                row = np.zeros((len(centres), NODES**2))
                row[index] = np.multiply.outer(half / self.pixel * weights, shares / shares.sum()).ravel()
                sums.append(row)
        return np.concatenate(found), np.concatenate(sums, axis=1)

    def image(
        self,
        y: NDArray[np.float64],
        x: NDArray[np.float64],
        *,
        masked: bool,
        source: tuple[float, float] = (0.0, 0.0),
    ) -> NDArray[np.float64]:
        """Return the light in pixels as a fraction of that on the clear disc."""
        import hcipy

        (rows, row_sums), (columns, column_sums) = self.nodes(y, masked), self.nodes(x, masked)
        down, across = (rows - source[1]) * RADIANS, (columns - source[0]) * RADIANS
        focal = hcipy.CartesianGrid(hcipy.SeparatedCoords([across, down]), weights=1.0)
        propagator = hcipy.FraunhoferPropagator(self.grid, focal)
        diameter, cells = float(self.optics["diameter_m"]), len(self.optics["transmission"])
        total = np.zeros((len(y), len(x)))
        for wavelength, weight in zip(self.optics["wavelengths_m"], self.optics["weights"], strict=True):
            phase = 2e-9 * np.pi / wavelength * self.optics["opd_nm"]
            pupil = self.optics["transmission"] * self.optics["amplitude"] * np.exp(1j * phase)
            pupil = pupil / np.sqrt(np.pi / 4.0 * diameter**2)  # one photon on the clear disc
            field = propagator.forward(hcipy.Wavefront(hcipy.Field(pupil.ravel(), self.grid), wavelength))
            light = np.abs(np.asarray(field.electric_field.shaped)) ** 2
            width = diameter / cells / wavelength  # cells are squares, HCIPy's samples are points
            light *= np.multiply.outer(np.sinc(down * width) ** 2, np.sinc(across * width) ** 2)
            total += weight * (row_sums @ light @ column_sums.T)
        return total * (self.pixel * RADIANS) ** 2

    def covered(
        self, y: NDArray[np.float64], x: NDArray[np.float64], centre: tuple[float, float], parts: int = 200
    ) -> NDArray[np.float64]:
        """Return the share of every pixel inside the photometric aperture."""
        inside = (np.arange(parts) + 0.5) / parts - 0.5
        down = np.add.outer(y - centre[1], inside * self.pixel)
        across = np.add.outer(x - centre[0], inside * self.pixel)
        distance = np.hypot(down[:, None, :, None], across[None, :, None, :])
        return (distance <= float(self.optics["aperture_radius_arcsec"])).mean(axis=(2, 3))


def rows(recorded: dict[str, Any]) -> list[Row]:
    """Return the numbers of both."""
    from simulator import load_instrument, single_band_psf
    from simulator.imaging import overlap_weights
    from simulator.imaging.psf import Psf

    def core(psf: Psf, image: NDArray[np.float64], x: float = 0.0, y: float = 0.0) -> float:
        """Return the light of an image in the aperture at a place."""
        pixel, middle = psf.pixel_scale_arcsec, len(image) // 2
        column, row = (round(place / pixel) for place in (x, y))
        radius = psf.imager.aperture_radius_arcsec / pixel
        weights = overlap_weights(radius, y / pixel - row, x / pixel - column)
        half = len(weights) // 2
        lines, columns = (slice(middle + place - half, middle + place + half + 1) for place in (row, column))
        return float(np.sum(image[lines, columns] * weights))

    instrument, found = load_instrument(), []
    for name, value in checks(given()).items():
        found.append(Row(f"input: {name}", recorded["input"][name], value, 1e-9, "the same arrays"))
    for fidelity, tolerance in FIDELITIES.items():
        psf = single_band_psf(BAND, fidelity=fidelity, instrument=instrument)
        middle, peak = len(psf.on_axis) // 2, float(psf.off_axis.max())
        contrast = psf.on_axis / peak
        dark = contrast[psf.geometry.hole]
        why = f"nodes over the band: 16 in theirs, {psf.knobs.wavelength_nodes} in ours"
        numbers = [
            ("brightest pixel without mask, fraction of the light on the clear disc", recorded["peak"], peak),
            ("light in the aperture without mask", recorded["core"], core(psf, psf.off_axis)),
            ("mean raw contrast of the hole", recorded["mean"], float(dark.mean())),
            ("rms raw contrast of the hole", recorded["rms"], float(np.sqrt(np.mean(dark**2)))),
        ]
        for (x, y), theirs in zip(PIXELS, recorded["pixels"], strict=True):
            numbers.append((f"raw contrast of pixel {x:+d}, {y:+d}", theirs, contrast[middle + y, middle + x]))
        for (x, y), theirs in zip(PLANETS, recorded["planets"], strict=True):
            numbers.append((f"planet in its aperture at {x:g}, {y:g} arcsec", theirs, core(psf, psf.at(x, y), x, y)))
        for what, theirs, ours in numbers:
            about = "our shares of pixels in a circle are good to 1e-4" if "aperture" in what else why
            found.append(Row(f"{what}, `{fidelity}`", theirs, float(ours), tolerance, about))
    return found
