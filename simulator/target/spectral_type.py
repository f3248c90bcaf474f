"""Spectral types as inputs of a scene; the sequences are facts: :mod:`catalogs.spectral_types`."""

from __future__ import annotations

from catalogs.spectral_types import SpectralType, StellarParameters, parse_spectral_type, stellar_parameters

__all__ = ["SpectralType", "StellarParameters", "parse_spectral_type", "stellar_parameters"]
