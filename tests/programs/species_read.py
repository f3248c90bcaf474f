"""Read photometry with species, run in its own environment without a network, and draw it."""

import json
import sys
from pathlib import Path

import h5py
import numpy as np
from astropy.table import Table
from species import SpeciesInit
from species.data.database import Database
from species.phot.syn_phot import SyntheticPhotometry
from species.plot.plot_spectrum import plot_spectrum
from species.read.read_object import ReadObject

folder, picture = Path(sys.argv[1]), sys.argv[2]
SpeciesInit()
database = Database()
table = Table.read(folder / "photometry.ecsv", format="ascii.ecsv")
table = table[table["realisation"] == 1]
names = {str(band): f"CPIC/{band}" for band in table["band"]}
for band, name in names.items():
    database.add_filter(name, filename=str(folder / f"passband-{band}.txt"), detector_type="photon")
# Flux densities need no Vega, but species asks the network for it unless there is one.
with h5py.File(database.database, "a") as file:
    file["spectra/calibration/vega"] = np.array([[0.3, 1.0, 3.0], [1e-8] * 3, [1e-10] * 3])
points = {names[row["band"]]: (float(row["flux"]), float(row["flux_error"])) for row in table}
database.add_object("planet", parallax=(740.7, 0.1), flux_density=points)
planet, lengths = ReadObject("planet"), np.linspace(0.3, 1.1, 200_001)
told = {
    band: {
        "point": planet.get_photometry(name, return_mag=False).tolist(),
        "of_wavelength": float(SyntheticPhotometry(name).spectrum_to_flux(lengths, lengths)[0]),
    }
    for band, name in names.items()
}
shown = {name: {"marker": "s", "ms": 4.0, "color": "tab:blue", "ls": "none"} for name in names.values()}
box = database.get_object("planet", inc_phot=True)
plot_spectrum([box], filters=list(names.values()), plot_kwargs=[shown], xlim=(0.45, 0.9), output=picture)
print(json.dumps(told))
