from cpic_core.quantities import unit_of as unit_of
from simulator.config.base import (
    FrozenModel as FrozenModel,
    Sourced as Sourced,
    at as at,
    bounds_of as bounds_of,
    canonical_json as canonical_json,
    canonical_keys as canonical_keys,
    content_hash as content_hash,
    deep_merge as deep_merge,
    inside as inside,
    limits_of as limits_of,
    nearest as nearest,
    plain_numbers as plain_numbers,
    to_unit as to_unit,
    validate as validate,
)
from simulator.config.bodies import (
    MAX_SEPARATION_ARCSEC as MAX_SEPARATION_ARCSEC,
    Planet as Planet,
    SceneStar as SceneStar,
    declination_deg as declination_deg,
    right_ascension_deg as right_ascension_deg,
)
from simulator.config.coronagraph_table import (
    CoronagraphTable as CoronagraphTable,
    shipped_tables as shipped_tables,
    table_path as table_path,
)
from simulator.config.detector import (
    CONVERTER_ASSUMED as CONVERTER_ASSUMED,
    AnyDetector as AnyDetector,
    Detector as Detector,
    InfraredDetector as InfraredDetector,
    ReadoutMode as ReadoutMode,
    Section as Section,
)
from simulator.config.instrument import (
    ARCSEC_PER_RAD as ARCSEC_PER_RAD,
    BandConfig as BandConfig,
    Instrument as Instrument,
    InstrumentLike as InstrumentLike,
    load_instrument as load_instrument,
)
from simulator.config.light import (
    LOG10_FSED_MAX as LOG10_FSED_MAX,
    STAR_MODELS as STAR_MODELS,
    AlbedoSpec as AlbedoSpec,
    AlbedoValue as AlbedoValue,
    ConstantAlbedo as ConstantAlbedo,
    GridAlbedo as GridAlbedo,
    MeasuredAlbedo as MeasuredAlbedo,
    ParametricAlbedo as ParametricAlbedo,
    Real as Real,
    SpectrumTable as SpectrumTable,
    TableAlbedo as TableAlbedo,
    albedo_spec as albedo_spec,
    names_file as names_file,
)
from simulator.config.presets import (
    preset_names as preset_names,
    preset_path as preset_path,
    preset_tree as preset_tree,
    tree_over_preset as tree_over_preset,
)
from simulator.config.scene import (
    SCENE_KEYS as SCENE_KEYS,
    Place as Place,
    Scene as Scene,
    load_scene as load_scene,
    place as place,
    true_distance_au as true_distance_au,
)
from simulator.config.scene_files import (
    ASSUMED_PA_DEG as ASSUMED_PA_DEG,
    SIMULATION_KEYS as SIMULATION_KEYS,
    StarColumns as StarColumns,
    companion_of as companion_of,
    is_table as is_table,
    load_simulation as load_simulation,
    scenes_from_table as scenes_from_table,
    simulation_of as simulation_of,
)
from simulator.config.simulation import (
    PROGRAMME_KEYS as PROGRAMME_KEYS,
    SKY_KINDS as SKY_KINDS,
    SequenceConfig as SequenceConfig,
    SequenceKind as SequenceKind,
    SequenceSettings as SequenceSettings,
    SimulationConfig as SimulationConfig,
    meaningful_keys as meaningful_keys,
    of_no_use as of_no_use,
)
from simulator.config.sky import (
    CosmicRayConfig as CosmicRayConfig,
    DiscSource as DiscSource,
    ExtendedSource as ExtendedSource,
    ExtraLight as ExtraLight,
    ImageSource as ImageSource,
    PaperTracks as PaperTracks,
    PhysicalTracks as PhysicalTracks,
    RingSource as RingSource,
    TemplateTracks as TemplateTracks,
)
from simulator.config.telescope import (
    FIRST_YEAR as FIRST_YEAR,
    LAST_YEAR as LAST_YEAR,
    CameraName as CameraName,
    Channel as Channel,
    Drift as Drift,
    OrbitConfig as OrbitConfig,
    ReferenceScheme as ReferenceScheme,
    Timing as Timing,
    Utc as Utc,
    checked_utc as checked_utc,
    julian_year as julian_year,
)
