from simulator.detectors.chains import (
    INFRARED as INFRARED,
    VISIBLE as VISIBLE,
    Chain as Chain,
    DarkCurrent as DarkCurrent,
    InfraredFlaws as InfraredFlaws,
    PixelFlaws as PixelFlaws,
    Switches as Switches,
    added_variance as added_variance,
    chain_preset as chain_preset,
    dark_law_e_s as dark_law_e_s,
    in_sums as in_sums,
    noise_terms as noise_terms,
    numbers_model as numbers_model,
    rows_of as rows_of,
    switches_model as switches_model,
)
from simulator.detectors.collection import (
    Blooming as Blooming,
    FullWell as FullWell,
    Nonlinearity as Nonlinearity,
    output_curve as output_curve,
    pixel_curve as pixel_curve,
)
from simulator.detectors.effect import (
    LIMIT_KERNELS as LIMIT_KERNELS,
    Effect as Effect,
    Exposure as Exposure,
    Place as Place,
    Setting as Setting,
    Sizes as Sizes,
    Work as Work,
    sizes as sizes,
)
from simulator.detectors.gain import (
    GAIN_LIMIT as GAIN_LIMIT,
    excess_noise_factor2 as excess_noise_factor2,
    generating_function as generating_function,
    noise_factor2 as noise_factor2,
    stage_probability as stage_probability,
)
from simulator.detectors.infrared import (
    ARRIVAL as ARRIVAL,
    HITS as HITS,
    Coupled as Coupled,
    Coupling as Coupling,
    Hits as Hits,
    InfraredPersistence as InfraredPersistence,
    InterpixelCapacitance as InterpixelCapacitance,
    LateCharge as LateCharge,
    LossAtFullWell as LossAtFullWell,
    PastExposure as PastExposure,
    Persistence as Persistence,
    ResetElectrons as ResetElectrons,
    checked_hits as checked_hits,
    neighbour_kernel as neighbour_kernel,
    tracks_of as tracks_of,
)
from simulator.detectors.readout import (
    BiasStructure as BiasStructure,
    ReadNoiseElectrons as ReadNoiseElectrons,
    wave_angles as wave_angles,
)
from simulator.detectors.register import (
    LargestGain as LargestGain,
    RegisterClockCharge as RegisterClockCharge,
    StageCharge as StageCharge,
    Stages as Stages,
)
from simulator.detectors.transfer import (
    ChargeTransfer as ChargeTransfer,
    ClockInduced as ClockInduced,
    ParallelTransfer as ParallelTransfer,
    SerialTransfer as SerialTransfer,
    Smear as Smear,
)
from simulator.detectors.variance import (
    MOST as MOST,
    FrameTerm as FrameTerm,
    aperture_noise_pixels as aperture_noise_pixels,
    clean_fraction as clean_fraction,
    frame_variance_e2 as frame_variance_e2,
    frames_per_clean as frames_per_clean,
    ramp_factors as ramp_factors,
)
