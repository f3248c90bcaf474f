"""The registry of reductions: how reference images are combined, and what is taken off science images with them.

An entry says what is subtracted before modes are projected out, what that leaves of a planet, the noise that it adds,
and the words for it; images and the exposure-time calculator take it from here. `Reduction` itself is the mean of the
references, with the principal components around it (Amara & Quanz 2012, MNRAS 427, 948); the others differ from it.
Images are rows of pixels, shape (images, pixels). Two rolls are reduced by the same entry, each the other's reference.
"""

from typing import Annotated

import numpy as np

from cpic_core import FloatArray, Registry


class Reduction:
    """The mean reference image is subtracted; the base of the other reductions.

    Attributes
    ----------
    name : str
        Word for it in options, configurations and results (``centring``).
    meaning : str
        What is taken off before the modes.
    follows_references : bool
        Whether light that all references show alike leaves every image with what is subtracted, and cannot reach the
        modes: then the forward model of a planet in the references is exact.
    needs_images : bool
        Whether the references are needed one by one even where no modes are projected out, and not their sum alone.
    predicted : bool
        Whether the closed forms of the calculator hold: those of the mean of the references and of its modes. The
        calculator refuses a reduction without them.
    """

    name = "temporal"
    meaning = "the mean of the reference frames in every pixel"
    follows_references = True
    needs_images = False
    predicted = True

    def centre(self, science: FloatArray, references: FloatArray) -> None:
        """Take off science and reference images what is subtracted before the modes, in place.

        Parameters
        ----------
        science, references : ndarray, shapes (n, pixels) and (m, pixels)
        """
        centre = self.combined(references)
        science -= centre
        references -= centre

    def combined(self, references: FloatArray) -> FloatArray:
        """Return the image that the references make together, shape (pixels,)."""
        return np.asarray(references.mean(axis=0))

    def left_of(self, planet: FloatArray) -> FloatArray:
        """Return what is left, before the modes, of images of a planet that no reference shows; shape (n, pixels)."""
        return planet

    def reference_variance(self, images: int, n_modes: int) -> float:
        """Return the variance of white noise that the references add, over that of the mean of all of them.

        Parameters
        ----------
        images : int
            Reference images that are combined.
        n_modes : int
            Modes that are projected out after that.
        """
        return 1.0


class SpatialMean(Reduction):
    """Every image loses its own mean over the region, as in KLIP (Soummer et al. 2012, ApJ 755, L28)."""

    name = "spatial"
    meaning = "the mean of each image over the region"
    follows_references = False
    needs_images = True
    predicted = False

    def centre(self, science: FloatArray, references: FloatArray) -> None:
        """Take off every image its own mean; see `Reduction.centre`."""
        science -= science.mean(axis=1, keepdims=True)
        references -= references.mean(axis=1, keepdims=True)

    def left_of(self, planet: FloatArray) -> FloatArray:
        """Return the planet less its mean over the region; see `Reduction.left_of`."""
        return np.asarray(planet - planet.mean(axis=1, keepdims=True))

    def reference_variance(self, images: int, n_modes: int) -> float:
        """Return that of the first mode, which is nearly the mean image; nothing without modes."""
        return float(n_modes > 0)


class Uncentred(SpatialMean):
    """Nothing is taken off before the modes, the first of which is nearly the mean image."""

    name = "none"
    meaning = "nothing"

    def centre(self, science: FloatArray, references: FloatArray) -> None:
        """Leave the images as they are; see `Reduction.centre`."""

    def left_of(self, planet: FloatArray) -> FloatArray:
        """Return all of it; see `Reduction.left_of`."""
        return planet


REDUCTIONS: Registry[Reduction] = Registry("centring", (Reduction(), SpatialMean(), Uncentred()))

ReductionName = Annotated[str, REDUCTIONS]
"""Name of a reduction, as a type."""
DEFAULT_REDUCTION = Reduction.name
