from simulator.signal.companions import (
    CompanionTables as CompanionTables,
    companion_tables as companion_tables,
)
from simulator.signal.light import (
    annulus_apertures as annulus_apertures,
    aperture_exozodi as aperture_exozodi,
    drift_halo as drift_halo,
    exozodi_disc as exozodi_disc,
    lit_rows as lit_rows,
    sky_pixel_e_s as sky_pixel_e_s,
    spot as spot,
    wing as wing,
)
from simulator.signal.saturation import (
    Wells as Wells,
    frame_limit as frame_limit,
    gain_caps as gain_caps,
    largest_gain as largest_gain,
    longest_exposure_s as longest_exposure_s,
    overflow as overflow,
    pixel_saturated as pixel_saturated,
)
from simulator.signal.speckle_modes import (
    MOST_REFERENCES as MOST_REFERENCES,
    BandModes as BandModes,
    ModeFactors as ModeFactors,
    SpeckleModes as SpeckleModes,
)
from simulator.signal.speckle_visits import (
    REGION_LAMBDA_D as REGION_LAMBDA_D,
    OpticalBand as OpticalBand,
    hole_changes as hole_changes,
    placed as placed,
    visit_changes as visit_changes,
)
from simulator.signal.speckles import (
    INTERLEAVED as INTERLEAVED,
    ProgrammeLaw as ProgrammeLaw,
    SpeckleLaw as SpeckleLaw,
    annulus_floor as annulus_floor,
    error_light_share as error_light_share,
    error_variance_nm2 as error_variance_nm2,
    programme_law as programme_law,
    programme_parts as programme_parts,
    speckle_law as speckle_law,
    unit_parts as unit_parts,
)
from simulator.signal.whitening import (
    Whitening as Whitening,
    speckle_covariance as speckle_covariance,
    with_noise as with_noise,
)
