from catalogs.known_planets import load_known_planets as load_known_planets
from cpic_core.errors import InputError as InputError
from cpic_planner.api.comparison import compare_answers as compare_answers
from cpic_planner.api.keywords import (
    compare_ranks as compare_ranks,
    compare_strategies as compare_strategies,
    confirm_scene as confirm_scene,
    confirm_targets as confirm_targets,
    contrast_curve as contrast_curve,
    contrast_limit as contrast_limit,
    explain_rank as explain_rank,
    exposure_time as exposure_time,
    make_plan as make_plan,
    optimise as optimise,
    rank_sensitivity as rank_sensitivity,
    rank_targets as rank_targets,
    reduce_products as reduce_products,
    roc_curve as roc_curve,
    signal_to_noise as signal_to_noise,
    simulate_products as simulate_products,
    star_visibility as star_visibility,
)
from cpic_planner.etc.from_rates import (
    CONVENTIONS as CONVENTIONS,
    RateConvention as RateConvention,
    snr_for_rates as snr_for_rates,
    time_for_rates as time_for_rates,
)
from cpic_planner.planets.population import load_population as load_population
from cpic_planner.queries.shared import ReferencePlanet as ReferencePlanet, Strategy as Strategy
from cpic_planner.survey.strategy import load_strategies as load_strategies
from cpic_planner.targets import load_targets as load_targets
from cpic_planner.version import __version__ as __version__
from simulator import (
    Calibration as Calibration,
    ExternalPsf as ExternalPsf,
    Instrument as Instrument,
    Knobs as Knobs,
    NotOk as NotOk,
    Observation as Observation,
    Outcome as Outcome,
    Outcomes as Outcomes,
    Passbands as Passbands,
    Planet as Planet,
    Psf as Psf,
    Reason as Reason,
    Scene as Scene,
    SceneStar as SceneStar,
    Status as Status,
    calibrate as calibrate,
    check_level0 as check_level0,
    lambert_phase as lambert_phase,
    load_dm_surface as load_dm_surface,
    load_instrument as load_instrument,
    load_psf as load_psf,
    load_scene as load_scene,
    observe as observe,
    planet_albedo as planet_albedo,
    planet_contrast as planet_contrast,
    read_level1 as read_level1,
    save_psf as save_psf,
    scenes_from_table as scenes_from_table,
    single_band_psf as single_band_psf,
    spectrum_generator as spectrum_generator,
    star_photlam as star_photlam,
    stream as stream,
    write_coronagraph_table as write_coronagraph_table,
    write_level0 as write_level0,
)
