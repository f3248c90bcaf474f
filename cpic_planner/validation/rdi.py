"""Reference-star differential imaging: projection of the science frames off the leading reference modes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from catalogs.errors import InputError
from cpic_planner.validation.modes import leading_modes, row_norm
from cpic_planner.validation.region import as_images, checked_frames, checked_region, region_rows
from simulator.numeric import numeric_context

__all__ = ["Centering", "RdiResult", "rdi_subtract"]

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
Centering = Literal["none", "spatial", "temporal"]

# Smallest amplitude of a mode relative to the references before centring: below it there is only rounding.
ROUNDING_CUT = 1e-13


@dataclass(frozen=True, eq=False)
class RdiResult:
    """Outcome of `rdi_subtract`.

    Attributes
    ----------
    residuals : ndarray
        Science frames minus their projection, shape of ``science``; 0 outside ``region``.
    modes_requested, modes_used : int
        Number of modes asked for and subtracted.
    truncated : bool
        Whether fewer modes were used because the references have no more (``modes_used`` is then their rank).
    centering : str
        Which mean was removed first.
    region : ndarray of bool
        Pixels (y, x) that took part.
    modes : ndarray
        Orthonormal modes, (modes_used, region pixels).
    eigenvalues : ndarray
        Their eigenvalues in the Gram matrix of the centred references, descending.
    """

    residuals: FloatArray
    modes_requested: int
    modes_used: int
    truncated: bool
    centering: Centering
    region: BoolArray
    modes: FloatArray = field(repr=False)
    eigenvalues: FloatArray = field(repr=False)

    def project(self, template: npt.ArrayLike) -> FloatArray:
        """What the subtraction leaves of a planet.

        The subtraction is linear in the science frame (plus, for temporal centring, a constant that no planet
        enters), so this image is the forward model of a planet absent from the references.

        Parameters
        ----------
        template : array_like
            Image or images of the planet, (y, x) or (n, y, x), without the star.

        Returns
        -------
        ndarray
            Same shape; 0 outside the region.
        """
        images = checked_frames("template", template)
        if images.shape[-2:] != self.region.shape:
            raise InputError("template", images.shape, unit="px", allowed=f"images of {self.region.shape}")
        rows = region_rows("template", images, self.region)
        if self.centering == "spatial":
            rows = rows - rows.mean(axis=1, keepdims=True)
        return as_images(_remove(rows, self.modes), self.region, images.shape)

    def throughput(
        self, template: npt.ArrayLike, aperture: npt.ArrayLike, *, background: npt.ArrayLike | None = None
    ) -> float:
        """Fraction of a planet's aperture flux that survives the subtraction.

        Parameters
        ----------
        template : array_like
            Image of the planet, (y, x), any scale.
        aperture : array_like
            Weight of each pixel in the photometric aperture, (y, x), at least 0.
        background : array_like of bool, optional
            Pixels whose mean is subtracted as background by the photometry: the planet's light there then
            counts as lost, as it does in the measurement.

        Returns
        -------
        float
            Aperture sum of `project` (minus background) over aperture sum of ``template``. Light outside the
            region counts as lost.

        Raises
        ------
        InputError
            If shapes differ, or the template has no light in the aperture.
        """
        planet, weights = np.asarray(template, dtype=np.float64), np.asarray(aperture, dtype=np.float64)
        for key, image in (("template", planet), ("aperture", weights)):
            if image.shape != self.region.shape:
                raise InputError(key, image.shape, unit="px", allowed=f"one image of {self.region.shape}")
        incoming = float(np.sum(planet * weights))
        if not incoming > 0:
            raise InputError("template", incoming, allowed="a positive sum inside the aperture")
        left = self.project(planet)
        surviving = float(np.sum(left * weights))
        if background is not None:
            pixels = checked_region("background", background, self.region.shape)
            surviving -= float(left[pixels].mean() * weights.sum())
        return surviving / incoming


@numeric_context()
def rdi_subtract(
    science: npt.ArrayLike,
    references: npt.ArrayLike,
    n_modes: int,
    *,
    region: npt.ArrayLike | None = None,
    centering: Centering = "spatial",
) -> RdiResult:
    """Subtract from each science frame its projection on the leading modes of the references.

    Parameters
    ----------
    science : array_like
        One frame (y, x) or several (n, y, x).
    references : array_like
        Reference frames (m, y, x) of the same field, at least one. A planet in them would be partly
        subtracted in a way that `RdiResult.throughput` does not model.
    n_modes : int
        Number of modes, at least 0; more than the numerical rank is truncated to it.
    region : array_like of bool, optional
        Pixels (y, x) to use; all by default. Nothing else is read, and residuals are 0 elsewhere.
    centering : {"spatial", "none", "temporal"}, optional
        Remove from every frame its own mean over the region (as KLIP does), nothing, or the mean reference
        frame.

    Returns
    -------
    RdiResult

    Raises
    ------
    InputError
        If shapes do not fit, a pixel inside the region is not finite (naming it), the region is empty, or
        ``n_modes`` or ``centering`` is not allowed.

    Notes
    -----
    The modes are the eigenvectors of the Gram matrix of the centred references carried to pixel space, that
    is their right singular vectors: the Karhunen-Loeve images of Soummer et al. 2012 (ApJ 755, L28) with
    spatial centring, the principal components of Amara & Quanz 2012 (MNRAS 427, 948) with temporal centring.
    How they are computed: `cpic_planner.validation.modes.leading_modes`. Modes with an eigenvalue below 1e-12
    of the largest, or at the level of rounding, do not exist numerically and are dropped.

    References without planet leave nothing of the planet in the modes: the subtraction is a fixed projection
    for it and takes about ``modes / pixels`` of its light where the modes are noise. `RdiResult.throughput`
    gives the exact fraction.
    """
    if centering not in get_args(Centering):
        raise InputError("centering", centering, allowed=", ".join(get_args(Centering)))
    if isinstance(n_modes, bool) or not isinstance(n_modes, int | np.integer) or n_modes < 0:
        raise InputError("n_modes", n_modes, allowed="an integer of at least 0")
    targets, library = checked_frames("science", science), checked_frames("references", references)
    if library.ndim != 3 or library.shape[0] < 1:
        raise InputError("references", library.shape, allowed="at least one frame, shape (m, y, x)")
    if targets.shape[-2:] != library.shape[-2:]:
        raise InputError("references", library.shape, unit="px", allowed=f"frames of {targets.shape[-2:]} as science")
    pixels = checked_region("region", region, targets.shape[-2:])
    rows, refs = region_rows("science", targets, pixels), region_rows("references", library, pixels)

    floor = ROUNDING_CUT * row_norm(refs)
    # Rows are copies: new memory for each step would cost more time than the arithmetic.
    if centering == "spatial":
        rows -= rows.mean(axis=1, keepdims=True)
        refs -= refs.mean(axis=1, keepdims=True)
    elif centering == "temporal":
        mean = refs.mean(axis=0)
        rows -= mean
        refs -= mean
    modes, singular = leading_modes(refs, int(n_modes), floor)
    used = len(singular)
    return RdiResult(
        residuals=as_images(_remove(rows, modes), pixels, targets.shape),
        modes_requested=int(n_modes),
        modes_used=used,
        truncated=used < n_modes,
        centering=centering,
        region=pixels,
        modes=modes,
        eigenvalues=np.square(singular),
    )


def _remove(rows: FloatArray, modes: FloatArray) -> FloatArray:
    out = (rows @ modes.T) @ modes
    return np.subtract(rows, out, out=out)
