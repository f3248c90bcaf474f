from cpic_core.outcome import (
    NotOk as NotOk,
    Outcome as Outcome,
    Outcomes as Outcomes,
    Reason as Reason,
    Status as Status,
)
from cpic_core.runtime import stream as stream
from simulator.config import (
    Instrument as Instrument,
    Planet as Planet,
    Scene as Scene,
    SceneStar as SceneStar,
    load_instrument as load_instrument,
    load_scene as load_scene,
    scenes_from_table as scenes_from_table,
)
from simulator.imaging.deformable_mirror import load_dm_surface as load_dm_surface
from simulator.imaging.external import ExternalPsf as ExternalPsf, load_psf as load_psf, save_psf as save_psf
from simulator.imaging.psf import Psf as Psf, single_band_psf as single_band_psf
from simulator.imaging.table_psf import write_coronagraph_table as write_coronagraph_table
from simulator.knobs import Knobs as Knobs
from simulator.observing.observation import Observation as Observation, observe as observe
from simulator.observing.sequence import Calibration as Calibration, calibrate as calibrate
from simulator.passbands import Passbands as Passbands
from simulator.products import check_level0 as check_level0, write_level0 as write_level0
from simulator.reduction import read_level1 as read_level1
from simulator.target import (
    lambert_phase as lambert_phase,
    planet_albedo as planet_albedo,
    planet_contrast as planet_contrast,
    star_photlam as star_photlam,
)
from simulator.target.sources import spectrum_generator as spectrum_generator
