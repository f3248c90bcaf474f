from cpic_planner.etc.budget import (
    binding_limits as binding_limits,
    inherited_terms as inherited_terms,
    largest_term as largest_term,
    limit_of as limit_of,
    reached as reached,
    remedies as remedies,
    without_background as without_background,
    without_speckles as without_speckles,
)
from cpic_planner.etc.cases import (
    Cases as Cases,
    FixedFrames as FixedFrames,
    cases_by_camera as cases_by_camera,
    cases_of as cases_of,
    fixed_frames as fixed_frames,
)
from cpic_planner.etc.chances import (
    LEAST_PROBABILITY as LEAST_PROBABILITY,
    Prospect as Prospect,
    prospect_of as prospect_of,
    visit_chances as visit_chances,
)
from cpic_planner.etc.detection import (
    MAX_SIGMA as MAX_SIGMA,
    MIN_ELEMENTS as MIN_ELEMENTS,
    SearchedRegion as SearchedRegion,
    equivalent_sigma as equivalent_sigma,
    false_alarms as false_alarms,
    log_tail as log_tail,
    near_threshold as near_threshold,
    search_threshold as search_threshold,
    searched_region as searched_region,
    snr_at as snr_at,
    threshold_array as threshold_array,
    verdict_of as verdict_of,
)
from cpic_planner.etc.detection_law import (
    LAW_ERROR as LAW_ERROR,
    MAP_VISITS as MAP_VISITS,
    PRIORS as PRIORS,
    SearchLaw as SearchLaw,
    band_law as band_law,
    light_share as light_share,
    lit_share as lit_share,
    needed_margin as needed_margin,
    own_share as own_share,
    speckled_share as speckled_share,
)
from cpic_planner.etc.fidelity import closed_form_fidelity as closed_form_fidelity
from cpic_planner.etc.frames import (
    FrameChoice as FrameChoice,
    FrameProblem as FrameProblem,
    best_exposure_s as best_exposure_s,
    best_in_visit as best_in_visit,
    frame_problem as frame_problem,
    least_time as least_time,
    smooth_least_visit_s as smooth_least_visit_s,
)
from cpic_planner.etc.model import (
    ONE_VISIT as ONE_VISIT,
    EtcModel as EtcModel,
    FrameCamera as FrameCamera,
    Programme as Programme,
    build_model as build_model,
    check_range as check_range,
    diagonal as diagonal,
    effective_visits as effective_visits,
    hole_notes as hole_notes,
    place_status as place_status,
    usable_range_arcsec as usable_range_arcsec,
)
from cpic_planner.etc.noise import (
    MODES_LIMITED as MODES_LIMITED,
    MODES_NOT_COUNTED as MODES_NOT_COUNTED,
    MODES_NOT_MODELLED as MODES_NOT_MODELLED,
    Objective as Objective,
    StackNoise as StackNoise,
    error_noise as error_noise,
    own_noise as own_noise,
    stack_noise as stack_noise,
    with_modes as with_modes,
)
from cpic_planner.etc.photon_counting import (
    MAX_MEAN_E as MAX_MEAN_E,
    CountingLaw as CountingLaw,
    counting_probabilities as counting_probabilities,
    counting_variance as counting_variance,
)
from cpic_planner.etc.programmes import (
    Programmes as Programmes,
    SearchMotion as SearchMotion,
    Span as Span,
    motion_factor as motion_factor,
    programme_columns as programme_columns,
    programme_days as programme_days,
    programme_fields as programme_fields,
)
from cpic_planner.etc.questions import (
    TRIAL_CONTRAST as TRIAL_CONTRAST,
    contrast_limit as contrast_limit,
    contrast_limits as contrast_limits,
    etc_result as etc_result,
    signal_to_noise as signal_to_noise,
    times_of as times_of,
)
from cpic_planner.etc.rates import (
    FARTHEST_ARCSEC as FARTHEST_ARCSEC,
    NEAREST_ARCSEC as NEAREST_ARCSEC,
    QUADRANTS as QUADRANTS,
    ApertureRates as ApertureRates,
    aperture_rates as aperture_rates,
    companion_saturates as companion_saturates,
    diagonal_pa_deg as diagonal_pa_deg,
    insolation_distance_au as insolation_distance_au,
    kinds_by_albedo as kinds_by_albedo,
    mixture_contrast as mixture_contrast,
    planet_offsets as planet_offsets,
    planets_of as planets_of,
    reference_contrast as reference_contrast,
    reference_distance_au as reference_distance_au,
    reference_notes as reference_notes,
    reflected_contrast as reflected_contrast,
)
from cpic_planner.etc.searches import (
    CaseArrays as CaseArrays,
    mapped as mapped,
    whole_steps as whole_steps,
)
