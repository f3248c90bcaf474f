"""Read the contrasts of a planet with TauREx, run in its own environment."""

import json
import sys

import numpy as np
from taurex.data.spectrum.observed import ObservedSpectrum

seen = ObservedSpectrum(sys.argv[1])
wavenumber = np.linspace(1e4 / 1.1, 1e4 / 0.4, 100_001)
binned = seen.create_binner().bindown(wavenumber, np.full(wavenumber.size, 3e-8))[1]
told = {
    "wavelength": seen.wavelengthGrid,
    "contrast": seen.spectrum,
    "error": seen.errorBar,
    "edges": 1e4 / np.asarray(seen.binEdges),
    "binned": binned,
}
print(json.dumps({name: np.asarray(values).tolist() for name, values in told.items()}))
