from catalogs.stellar_physics import StellarParameters as StellarParameters, stellar_parameters as stellar_parameters
from simulator.target.albedo import (
    albedo_notes as albedo_notes,
    albedo_source as albedo_source,
    load_parametric_grid as load_parametric_grid,
    needs_insolation as needs_insolation,
    parametric_family as parametric_family,
    phase_value as phase_value,
    planet_albedo as planet_albedo,
)
from simulator.target.contrast import (
    contrast_at as contrast_at,
    lambert_phase as lambert_phase,
    planet_contrast as planet_contrast,
    sin_phase as sin_phase,
)
from simulator.target.lights import LitPlanet as LitPlanet, LitStar as LitStar
from simulator.target.sources import (
    ExtendedRate as ExtendedRate,
    Source as Source,
    detector_to_sky as detector_to_sky,
    extended_rates as extended_rates,
    scene_sources as scene_sources,
    sky_to_detector as sky_to_detector,
    spectrum_generator as spectrum_generator,
    wcs_keywords as wcs_keywords,
)
from simulator.target.star_spectrum import (
    STAR_FLAGS as STAR_FLAGS,
    StarSpectrum as StarSpectrum,
    read_spectrum as read_spectrum,
    star_photlam as star_photlam,
    stellar_spectrum as stellar_spectrum,
)
